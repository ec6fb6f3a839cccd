use super::*;
use crate::base::interrupt::Flag;
use crate::sensors::{Identities, radar_of};
use crate::tracker::rows::row::Row;
use crate::tracker::{Motion, Plot};
use std::panic::{AssertUnwindSafe, catch_unwind};

/// A radar with a plot of each of ten targets in every scan of four seconds.
fn plots(scans: usize) -> Vec<Plot> {
    let plot = |i: usize| {
        let (time, azimuth) = (0.4 * i as f64, 0.6 * (i % 10) as f64);
        let (height, identities) = (f64::NAN, Identities::NONE);
        let (report, detection, range) = (None, None, 4e4 + 60.0 * time);
        Plot { time, range, azimuth, radar: 0, height, identities, detection, report }
    };
    (0..10 * scans).map(plot).collect()
}

/// Interrupts the call when it has given this number of rows.
struct Stopping(usize, Flag);

impl Rows for Stopping {
    fn wants(&self, _: bool) -> bool {
        true
    }

    fn push(&mut self, _: &Row) {
        self.0 = self.0.saturating_sub(1);
        if self.0 == 0 {
            self.1.set();
        }
    }
}

#[test]
fn an_interrupted_tracker_goes_on_with_later_plots() {
    let settings = Settings::new(vec![radar_of([50.0, 1e-3])], Motion::Cv(1.0));
    let mut tracker = Tracker::try_new(settings).unwrap();
    let (all, flag) = (plots(20), Flag::default());
    let mut rows = Stopping(80, flag.clone());
    let stopped = catch_unwind(AssertUnwindSafe(|| {
        flag.watch(|| tracker.track(&all[..150], None, &mut Vec::new(), &mut rows, None))
    }));
    assert!(stopped.is_err() && tracker.waits().is_some());
    let (mut statuses, mut rows) = (Vec::new(), Vec::<Row>::new());
    tracker.track(&all[150..], None, &mut statuses, &mut rows, None).unwrap();
    assert!(statuses.iter().all(|status| matches!(status, PlotStatus::Track(_))));
    assert_eq!(rows.last().unwrap().plot, Some(199));
}

#[test]
fn tracks_are_moved_by_their_numbers_whatever_their_order() {
    let settings = Settings::new(vec![radar_of([50.0, 1e-3])], Motion::Cv(1.0));
    let mut tracker = Tracker::try_new(settings).unwrap();
    let plots = [0.1, 0.9, 1.7, 2.5].map(|azimuth| {
        let (height, identities) = (f64::NAN, Identities::NONE);
        let (report, detection) = (None, None);
        Plot { time: 0.0, range: 4e4, azimuth, radar: 0, height, identities, detection, report }
    });
    tracker.track(&plots[..], None, &mut Vec::new(), &mut Vec::<Row>::new(), None).unwrap();
    // as if one track had continued under an older number
    tracker.tracks.swap(0, 2);
    let before: Vec<_> = tracker.tracks.iter().map(|track| track.estimate.mean[0]).collect();
    let moved =
        [1, 3, 4, 9].map(|number: u64| (number, 0.0, [100.0 * number as f64, 0.0, 0.0, 0.0]));
    tracker.shift(&moved);
    for (track, before) in tracker.tracks.iter().zip(before) {
        let expected = if track.number == 2 { 0.0 } else { 100.0 * track.number as f64 };
        assert!((track.estimate.mean[0] - before - expected).abs() < 1e-9);
    }
}
