//! A worked example: two crossing tracks, six scans.

use crate::sensors::{Identities, Radar, radar_of};
use crate::tracker::filter::Filter;
use crate::tracker::live::Tracker;
use crate::tracker::motion::estimate::Estimate;
use crate::tracker::motion::{ImmModel, Motion};
use crate::tracker::plot::level::Level;
use crate::tracker::plot::{Measured, Plot};
use crate::tracker::rows::row::Row;
use crate::tracker::settings::Settings;
use crate::tracker::settings::association::Association;
use crate::tracker::settings::mht::Mht;
use crate::tracker::track::{Stage, Track};
use nalgebra::{SMatrix, SVector};
use std::num::NonZero;

const SCANS: [[[f64; 2]; 2]; 6] = [
    [[153.7, 100_016.9], [-75.4, 100_237.0]],
    [[535.5, 100_060.9], [686.8, 100_196.4]],
    [[1569.0, 100_117.4], [1282.2, 100_226.3]],
    [[2117.1, 100_273.0], [2482.4, 100_096.4]],
    [[3387.5, 100_241.0], [3296.5, 100_065.4]],
    [[4153.1, 100_353.1], [3873.3, 99_969.4]],
];

fn radar() -> Radar {
    Radar { max_range: 2e5, ..radar_of([50.0, 0.08_f64.to_radians()]) }
}

fn plot(time: f64, [x, y]: [f64; 2]) -> Plot {
    let (range, azimuth) = (x.hypot(y) / radar().stretch(), x.atan2(y));
    Plot {
        time,
        range,
        azimuth,
        radar: 0,
        height: f64::NAN,
        identities: Identities::NONE,
        detection: None,
        report: None,
    }
}

/// Numbers of hypotheses before each scan, and the states in the end.
fn tracked(association: Association) -> (Vec<usize>, Vec<Estimate<4>>) {
    let motion = Motion::Imm(ImmModel::default());
    let settings =
        Settings { association, clutter_density: 1e-10, ..Settings::new(vec![radar()], motion) };
    let mut tracker = Tracker::try_new(settings.clone()).unwrap();
    for (number, (y, vy)) in [(100_000.0, 15.0), (100_300.0, -15.0)].into_iter().enumerate() {
        let first = plot(-4.0, [-800.0, y - 4.0 * vy]);
        let own = (&radar(), settings.geometry(0));
        let first = Measured::new(0, &first, own, radar().stretch(), &Level::default());
        let mut track = Track::new(number as u64 + 1, &first, 0.0, &settings);
        let r = radar().noise_at([0.0, y], f64::NAN);
        let mut covariance = SMatrix::from_diagonal(&SVector::from([r.xx, r.yy, 100.0, 100.0]));
        (covariance[(0, 1)], covariance[(1, 0)]) = (r.xy, r.xy);
        track.estimate = Estimate { mean: SVector::from([0.0, y, 200.0, vy]), covariance };
        track.filter = Filter::new(&motion, track.estimate);
        (track.stage, track.time) = (Stage::Confirmed, 0.0);
        tracker.tracks.push(track);
    }
    let mut counts = Vec::new();
    for (scan, places) in SCANS.iter().enumerate() {
        counts.push(tracker.clusters.0.iter().map(|c| c.hypotheses.len()).sum::<usize>().max(1));
        let time = 4.0 * scan as f64;
        let plots = places.map(|place| plot(time, place));
        let mut rows: Vec<Row> = Vec::new();
        let one = NonZero::new(1);
        tracker.track(&plots[..], Some(time), &mut Vec::new(), &mut rows, one).unwrap();
    }
    let confirmed = tracker.tracks.iter().filter(|track| track.is_confirmed());
    (counts, confirmed.map(|track| track.estimate).collect())
}

#[test]
fn one_hypothesis_confuses_what_several_do_not() {
    let (counts, states) = tracked(Association::Gnn);
    assert_eq!(counts, [1; 6]);
    let expected = [
        [3975.01027737, 100_020.475091, 198.639267425, -11.0209579941],
        [4014.40436278, 100_303.734884, 206.938319264, 7.04943652371],
    ];
    assert_near(&states, expected);
    let (counts, states) = tracked(Association::Mht(Mht::default()));
    let expected = [
        [4030.90645154, 100_348.358726, 203.795025574, 17.179854629],
        [3952.3277287, 99_993.2025869, 201.499420289, -14.4542968245],
    ];
    assert_near(&states, expected);
    assert_eq!(counts, [1, 1, 2, 4, 4, 5]);
}

fn assert_near(states: &[Estimate<4>], expected: [[f64; 4]; 2]) {
    for (state, expected) in states.iter().zip(expected) {
        for (x, y) in state.mean.iter().zip(expected) {
            assert!((x - y).abs() < 1e-8 * y.abs().max(100.0), "{} {expected:?}", state.mean);
        }
    }
}
