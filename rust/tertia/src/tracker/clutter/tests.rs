//! Tests of the density of false plots.

use super::super::clutter::tally::FEWEST;
use super::*;
use crate::base::checks::assert_within;
use crate::sensors::{Channel, Detection, Identities, radar_of};
use crate::tracker::{ImmModel, Motion, Plot, Row, Tracker};
use std::iter::zip;

/// A plot without height and identity.
fn bare(time: f64, [range, azimuth]: [f64; 2], radar: usize) -> Plot {
    let (height, identities) = (f64::NAN, Identities::NONE);
    let (report, detection) = (None, None);
    Plot { time, range, azimuth, radar, height, identities, detection, report }
}

#[test]
fn first_plots_of_targets_that_are_confirmed_are_no_false_plots() {
    let radar = Radar { max_range: 1e5, ..radar_of([50.0, 1e-3]) };
    let settings = Settings::new(vec![radar.clone()], Motion::Imm(ImmModel::default()));
    let mut tracker = Tracker::try_new(settings).unwrap();
    let (mut statuses, mut rows) = (Vec::new(), Vec::<Row>::new());
    for scan in 0..8 {
        // thirty aircraft on a circle fly outwards
        let plots: Vec<Plot> = (0..30)
            .map(|k| {
                let azimuth = 0.2 * f64::from(k);
                let time = 4.0 * (f64::from(scan) + azimuth / std::f64::consts::TAU);
                bare(time, [4e4 + 200.0 * time, azimuth], 0)
            })
            .collect();
        tracker.track(&plots[..], None, &mut statuses, &mut rows, None).unwrap();
    }
    assert_within(1e-12, tracker.clutter[0].plots(&radar), FEWEST);
}

#[test]
fn false_plots_that_tentative_tracks_take_are_false_all_the_same() {
    let radars = [[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]].map(|[x, y]| Radar {
        position: [x * 1e4, y * 1e4, 0.0],
        max_range: 1e5,
        ..radar_of([50.0, 1e-3])
    });
    let settings = Settings::new(radars.to_vec(), Motion::Imm(ImmModel::default()));
    let mut tracker = Tracker::try_new(settings).unwrap();
    let (mut statuses, mut rows) = (Vec::new(), Vec::<Row>::new());
    for scan in 0..20 {
        let plots = false_plots(scan, 4 * 300, 4);
        tracker.track(&plots[..], None, &mut statuses, &mut rows, None).unwrap();
        let mean = 0.25 * zip(&tracker.clutter, &radars).map(|(own, r)| own.plots(r)).sum::<f64>();
        // in the first scans, chains of two false plots look like targets
        let bound = if scan < 5 { 0.25 } else { 0.1 };
        assert_within(bound, mean / 300.0, 1.0);
    }
}

#[test]
fn second_plots_of_targets_are_no_false_plots() {
    let radar = Radar { max_range: 1e5, ..radar_of([50.0, 1e-3]) };
    let settings = Settings::new(vec![radar.clone()], Motion::Imm(ImmModel::default()));
    let false_plots_of = |distances: &[f64]| {
        let mut tracker = Tracker::try_new(settings.clone()).unwrap();
        let (mut statuses, mut rows) = (Vec::new(), Vec::<Row>::new());
        for scan in 0..4 {
            let mut plots = false_plots(scan, 20, 1);
            for k in 0..10 {
                // aircraft on a circle fly outwards
                let azimuth = 0.6 * f64::from(k);
                let time = 4.0 * (f64::from(scan) + azimuth / std::f64::consts::TAU);
                let range = 4e4 + 200.0 * time;
                plots.extend(distances.iter().map(|more| bare(time, [range + more, azimuth], 0)));
            }
            tracker.track(&plots[..], None, &mut statuses, &mut rows, None).unwrap();
        }
        tracker.clutter[0].plots(&radar)
    };
    assert_within(0.1, false_plots_of(&[0.0, 120.0]) / false_plots_of(&[0.0]), 1.0);
}

/// False plots of a scan; fractional parts of multiples of squares are as good as random numbers.
fn false_plots(scan: u32, count: u32, radars: usize) -> Vec<Plot> {
    let plot = |k: u32| {
        let square = f64::from(count * scan + k).powi(2);
        let [a, b] = [0.618_033_988_75, 0.414_213_562_37].map(|u| (square * u).fract());
        let (range, azimuth) = (1e5 * a.sqrt(), std::f64::consts::TAU * b);
        bare(4.0 * (f64::from(scan) + b), [range, azimuth], k as usize % radars)
    };
    (0..count).map(plot).collect()
}

/// A plot at this time that has been weighed against false plots.
fn plot_at(time: f64) -> Weighed {
    let plot = Measured { time, position: [3e4, 4e4], ..Measured::default() };
    Weighed::new(&plot, 1e-9)
}

/// Plots of tentative tracks that are certainly false: as many of each of two plots as `counts` says.
fn held(clutter: &Clutter, radar: &Radar, counts: [usize; 2], plots: [&Weighed; 2]) -> Held {
    let mut held = Held::default();
    for (count, plot) in counts.into_iter().zip(plots) {
        (0..count).for_each(|_| clutter.add(&mut held, radar, plot, 1.0));
    }
    held
}

/// A radar that detects echoes with a probability of 0.85 and replies with 0.95. The number of false echoes
/// per scan is known unless it is nan.
fn with_channels(clutter_per_scan: f64) -> Radar {
    let channel = |detection_probability, clutter_per_scan| {
        Some(Channel { detection_probability, sigmas: [50.0, 1e-3], clutter_per_scan })
    };
    let radar = Radar { max_range: 1e5, ..radar_of([50.0, 1e-3]) };
    let channels = [channel(0.85, clutter_per_scan), channel(0.95, f64::NAN), None];
    radar.with_channels(channels).unwrap()
}

#[test]
fn plots_weigh_what_their_way_of_detection_says() {
    let radar = with_channels(f64::NAN);
    let settings = Settings::new(vec![radar.clone()], Motion::Cv(1.0));
    let mut clutter = Clutter::of(&settings, 0);
    let gain = |clutter: &Clutter, d| gain_by_way(&clutter.all(), &radar, Some(d));
    // without false plots there are only new targets, which are detected like all others
    for detection in [Detection::Psr, Detection::Ssr, Detection::PsrSsr] {
        assert!(gain(&clutter, detection).abs() < 1e-14);
    }
    assert_eq!(gain_by_way(&clutter.lately, &radar, None), 0.0);
    clutter.pass([0.0, 8.0], || false, &radar);
    let echo = Weighed { detection: Some(Detection::Psr), ..plot_at(8.0) };
    clutter.hold(held(&clutter, &radar, [100, 0], [&echo; 2]));
    // 100 echoes in two scans
    let (seen, share, echoes) = (0.9925, 0.0425 / 0.9925, 100.0 / 2.0);
    let all = echoes + (0.1425 + 0.8075) / seen;
    assert_within(1e-12, clutter.plots(&radar), all);
    assert_within(1e-12, gain(&clutter, Detection::Psr), (share * all / echoes).ln());
    assert_within(1e-12, gain(&clutter, Detection::PsrSsr), all.ln());
    // if the tracks are of targets, their plots were no false plots
    clutter.hold(Held::default());
    assert!(gain(&clutter, Detection::Psr).abs() < 1e-12);
}

#[test]
fn false_plots_that_are_known_are_not_counted() {
    let radar = with_channels(40.0);
    let settings = Settings::new(vec![radar.clone()], Motion::Cv(1.0));
    let clutter = Clutter::of(&settings, 0);
    assert_within(1e-12, clutter.plots(&radar), 40.0 + 0.95 / 0.9925);
    // a known density is divided among the channels in the same way
    let dense = Clutter::of(&Settings { clutter_density: 1e-9, ..settings }, 0);
    assert_within(1e-12, dense.density(&radar), 1e-9);
    let gains = [clutter, dense].map(|own| gain_by_way(&own.lately, &radar, Some(Detection::Psr)));
    assert_within(1e-14, gains[0], gains[1]);
}

#[test]
fn what_is_known_since_leaves_out_the_first_scan() {
    let radar = Radar { max_range: 1e5, ..radar_of([50.0, 1e-3]) };
    let settings = Settings::new(vec![radar.clone()], Motion::Cv(1.0));
    let mut clutter = Clutter::of(&settings, 0);
    let since = |clutter: &Clutter| {
        let known = clutter.known_since(&radar, &plot_at(0.0), (0.0, false));
        known.map(|density| density * clutter.area(&radar))
    };
    assert!(since(&clutter).is_none());
    for (scan, all) in [300, 20, 20].into_iter().enumerate() {
        let times = [0.0, 4.0].map(|end| 4.0 * scan as f64 + end);
        clutter.pass(times, || false, &radar);
        (0..all).for_each(|_| clutter.count(&radar, &plot_at(times[1] - 1e-9)));
        // an estimate from the first scan is better than none
        let expected = f64::from(if scan == 0 { 300 } else { 20 });
        assert_within(1e-8, since(&clutter).unwrap() / expected, 1.0);
    }
    // the same holds for plots of tentative tracks: one of the first scan and two of the last
    clutter.hold(held(&clutter, &radar, [1, 2], [2.0, 12.0].map(plot_at).each_ref()));
    let expected = 20.0 + 2.0 / (1.0 + (-0.1_f64).exp());
    assert_within(1e-8, since(&clutter).unwrap() / expected, 1.0);
}

#[test]
fn plots_of_tentative_tracks_count_by_how_likely_they_are_false() {
    let radar = Radar { max_range: 1e5, ..radar_of([50.0, 1e-3]) };
    let mut clutter = Clutter::new(f64::NAN);
    let settled = plot_at(4.0);
    clutter.pass([0.0, 4.0], || false, &radar);
    (0..60).for_each(|_| clutter.count(&radar, &settled));
    let mut tentative = Held::default();
    (0..40).for_each(|_| clutter.add(&mut tentative, &radar, &settled, 0.25));
    clutter.hold(tentative);
    assert_within(1e-12, clutter.plots(&radar), 70.0);
    clutter.pass([4.0, 24.0], || false, &radar);
    // the first plots have faded for five scans
    let fade = (-0.5_f64).exp();
    clutter.hold(held(&clutter, &radar, [30, 0], [&settled; 2]));
    assert_within(1e-12, clutter.plots(&radar), 90.0 * fade / (fade + 5.0));
    // plots of tentative tracks that are taken over from another tracker count for good
    let mut other = Clutter::new(f64::NAN);
    other.learn(&clutter);
    other.hold(Held::default());
    assert_within(1e-13, other.plots(&radar), clutter.plots(&radar));
    // once all tentative tracks are confirmed, their plots no longer count
    clutter.hold(Held::default());
    assert_within(1e-12, clutter.plots(&radar), 60.0 * fade / (fade + 5.0));
}

#[test]
fn plots_of_one_time_are_those_of_a_scan() {
    let radar = Radar { max_range: 1e5, ..radar_of([50.0, 1e-3]) };
    for (times, have_one_time, scans) in
        [([0.0, 3.0], false, 0.75), ([0.0, 0.0], true, 1.0), ([0.0, 0.1], false, 0.5)]
    {
        let mut clutter = Clutter::new(f64::NAN);
        clutter.pass(times, || have_one_time, &radar);
        (0..60).for_each(|_| clutter.count(&radar, &plot_at(times[1])));
        assert_within(1e-12, clutter.plots(&radar) * scans, 60.0);
    }
}
