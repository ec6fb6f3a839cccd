//! A worked example: three plots of one target on one axis, given in any order.

use super::*;
use crate::base::checks::assert_within;
use crate::base::plane::Plane;
use crate::sensors::{Identities, Radar, radar_of};
use crate::tracker::filter::Filter;
use crate::tracker::motion::estimate::Estimate;
use crate::tracker::motion::{ImmModel, Motion};
use crate::tracker::plot::Measured;
use crate::tracker::plot::level::Level;
use crate::tracker::settings::Settings;
use crate::tracker::track::{Stage, Track};
use nalgebra::{SMatrix, SVector};

/// Distance of the target, north of the two radars, at time 0, m.
const START: f64 = 1e5;
/// Time (s), measured distance since time 0 (m), and radar.
const PLOTS: [(f64, f64, usize); 3] = [(4.0, 830.0, 0), (6.0, 1160.0, 1), (8.0, 1620.0, 0)];
const ORDERS: [[usize; 3]; 6] = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];

fn radar() -> Radar {
    Radar { max_range: 2e5, ..radar_of([50.0, 0.08_f64.to_radians()]) }
}

fn plot((time, way, radar_index): (f64, f64, usize)) -> Plot {
    let range = (START + way) / radar().stretch();
    Plot {
        time,
        range,
        azimuth: 0.0,
        radar: radar_index,
        height: f64::NAN,
        identities: Identities::NONE,
        detection: None,
        report: None,
    }
}

/// A tracker with a track whose target flies 200 m/s to the north at time 0.
fn tracker() -> LagTracker {
    let motion = Motion::Cv(0.1);
    let settings =
        Settings { clutter_density: 1e-10, ..Settings::new(vec![radar(), radar()], motion) };
    let mut tracker = Tracker::try_new(settings.clone()).unwrap();
    let first = plot((-4.0, -800.0, 0));
    let own = (&radar(), settings.geometry(0));
    let first = Measured::new(0, &first, own, radar().stretch(), &Level::default());
    let mut track = Track::new(1, &first, 0.0, &settings);
    let Plane { xx, .. } = radar().noise_at([0.0, START], f64::NAN);
    let covariance = SMatrix::from_diagonal(&SVector::from([xx, 2500.0, 100.0, 100.0]));
    track.estimate = Estimate { mean: SVector::from([0.0, START, 0.0, 200.0]), covariance };
    track.filter = Filter::new(&motion, track.estimate);
    (track.stage, track.time) = (Stage::Confirmed, 0.0);
    tracker.tracks.push(track);
    let kept = tracker.keep();
    let mut tracker = LagTracker::try_new(tracker, 10.0).unwrap();
    // a tracker usually begins without tracks, but this one has a track at time 0
    tracker.kept = VecDeque::from([(0, kept)]);
    tracker
}

/// The state at the last plot.
fn last(plots: &[(f64, f64, usize)]) -> Estimate<4> {
    let mut tracker = tracker();
    let (mut rows, mut statuses) = (Vec::new(), Vec::new());
    for &own in plots {
        tracker.track(&[plot(own)][..], Some(8.0), &mut statuses, &mut rows, None).unwrap();
    }
    rows.clear();
    tracker.finish(&mut rows, None);
    let at = |row: &&Row| row.plot.is_some() && row.time == 8.0;
    rows.iter().find(at).expect("a row of the last plot").estimate
}

fn assert_state(state: &Estimate<4>, [way, speed]: [f64; 2], covariance: [f64; 3]) {
    assert_within(1e-9, state.mean[1] - START, way);
    assert_within(1e-9, state.mean[3], speed);
    for ((i, j), expected) in [(1, 1), (1, 3), (3, 3)].into_iter().zip(covariance) {
        assert_within(1e-9, state.covariance[(i, j)], expected);
    }
}

#[test]
fn plots_in_any_order_have_the_state_of_plots_in_order() {
    let covariance = [1_135.936_549_24, 146.090_879_029, 41.841_590_048_6];
    for order in ORDERS {
        let state = last(&order.map(|k| PLOTS[k]));
        assert_state(&state, [1_602.208_404_13, 199.917_192_751], covariance);
    }
}

#[test]
fn without_the_late_plot_the_state_is_another() {
    let covariance = [1_535.650_195_27, 175.690_804_416, 44.033_548_195_7];
    let state = last(&[PLOTS[0], PLOTS[2]]);
    assert_state(&state, [1_622.281_820_28, 201.403_685_96], covariance);
}

#[test]
fn a_tracker_that_has_had_plots_cannot_have_them_again() {
    let settings = Settings::new(vec![radar(), radar()], Motion::Cv(0.1));
    let mut tracker = Tracker::try_new(settings).unwrap();
    let (mut rows, mut statuses) = (Vec::new(), Vec::new());
    let plots = PLOTS.map(plot);
    tracker.track(&plots[..], Some(9.0), &mut statuses, &mut rows, None).unwrap();
    let refused = LagTracker::try_new(tracker.clone(), 10.0).unwrap_err();
    assert!(refused.to_string().contains("has had no plots"), "{refused}");
    // without a lag, no plots are processed again
    let mut tracker = LagTracker::try_new(tracker, 0.0).unwrap();
    let later = plot((12.0, 2400.0, 0));
    tracker.track(&[later][..], Some(13.0), &mut statuses, &mut rows, None).unwrap();
    assert_eq!(tracker.tracker().plots(), 4);
}

/// Returns the statuses and the rows that a tracker of one radar with a lag of 20 s gives for these calls.
fn given(calls: &[Vec<Plot>]) -> (Vec<PlotStatus>, Vec<Row>) {
    let motion = Motion::Imm(ImmModel::default());
    let usual = Settings::new(vec![radar()], motion);
    let settings = Settings { clutter_density: 1e-15, ..usual };
    let mut tracker = LagTracker::try_new(Tracker::try_new(settings).unwrap(), 20.0).unwrap();
    let (mut all, mut rows, mut statuses) = (Vec::new(), Vec::new(), Vec::new());
    for plots in calls {
        let end = plots.iter().map(|plot| plot.time + 0.02).fold(0.0, f64::max);
        tracker.track(&plots[..], Some(end), &mut statuses, &mut rows, None).unwrap();
        all.append(&mut statuses);
    }
    (all, rows)
}

#[test]
fn second_plots_are_duplicates_with_a_lag_as_without() {
    let mut calls = vec![Vec::new(); 20];
    for (scan, own) in calls.iter_mut().enumerate() {
        for target in 0..40 {
            let (time, azimuth) =
                (4.0 * scan as f64 + 0.09 * f64::from(target), 0.15 * f64::from(target));
            let first = Plot { azimuth, ..plot((time, 150.0 * time, 0)) };
            let second = Plot { time: time + 0.01, range: first.range + 30.0, ..first };
            own.extend([first, second]);
        }
    }
    let (statuses, _) = given(&calls);
    let count = |wanted| statuses.iter().filter(|status| **status == wanted).count();
    assert!(count(PlotStatus::Duplicate) > 600);
    assert_eq!(count(PlotStatus::Invalid), 0);
}

#[test]
fn rows_with_another_probability_or_a_shared_plot_are_not_the_same() {
    let calls: Vec<_> =
        (0..5).map(|k| vec![plot((4.0 * f64::from(k), 800.0 * f64::from(k), 0))]).collect();
    let row = given(&calls).1.pop().unwrap();
    assert!(row.is_same(&row.clone()));
    assert!(!row.is_same(&Row { association_probability: 0.7, ..row }));
    assert!(!row.is_same(&Row { merged: true, ..row }));
}
