use super::*;
use crate::sensors::{Identities, radar_of};
use crate::tracker::Motion;

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
    // the order after a track has gone on under an older number
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
