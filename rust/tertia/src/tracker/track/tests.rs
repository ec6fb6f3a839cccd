use super::*;
use crate::base::checks::assert_within;
use crate::sensors::{Radar, radar_of};
use crate::tracker::ImmModel;
use crate::tracker::noise::Noise;

fn settings() -> Settings {
    let radar = Radar { max_range: 1e5, ..radar_of([50.0, 1e-3]) };
    let near = Radar { max_range: 1e4, ..radar.clone() };
    Settings::new(vec![radar, near], Motion::Imm(ImmModel::default()))
}

fn plot(time: f64, position: [f64; 2]) -> Measured {
    Measured { time, position, height: f64::NAN, ..Measured::default() }
}

/// A track with two plots.
fn track(settings: &Settings) -> Track {
    let mut track = Track::new(1, &plot(0.0, [3e4, 4e4]), 0.0, settings);
    track.correct(&plot(4.0, [3.08e4, 4.06e4]), settings);
    track
}

#[test]
fn a_late_plot_has_the_error_of_the_velocity() {
    let settings = settings();
    let track = track(&settings);
    let radar = &settings.radars[0];
    let [x, y, vx, vy] = track.estimate.mean.data.0[0];
    let p = track.estimate.covariance;
    let noise = radar.noise_at([x, y], f64::NAN);
    for t in [-3.0, -1.5, 0.0, 2.0] {
        let here = track.brought_here(&plot(4.0 + t, [1e3, 2e3]), &settings);
        let (z, r) = (here.position, here.covariance());
        assert_within(1e-13, z[0], 1e3 - t * vx);
        assert_within(1e-13, z[1], 2e3 - t * vy);
        let square = if t < 0.0 { t * t } else { 0.0 };
        assert_within(1e-13, r.xx, noise.xx + square * p[(2, 2)]);
        assert_within(1e-13, r.xy, noise.xy + square * p[(2, 3)]);
        assert_within(1e-13, r.yy, noise.yy + square * p[(3, 3)]);
    }
}

#[test]
fn a_miss_is_counted_once_per_scan_of_a_radar_that_covers_the_target() {
    let settings = settings();
    let mut track = track(&settings);
    let evidence = |track: &Track| match track.stage {
        Stage::Tentative { misses, evidence, .. } => (misses, evidence),
        Stage::Confirmed => panic!("two plots confirm nothing"),
    };
    let (_, before) = evidence(&track);
    let mut existence = track.existence;
    let mut rows = Vec::new();
    let mut until = |track: &mut Track, end: f64| {
        track.miss(end, &settings, |track, radar| rows.push((track.time, radar)));
        rows.len()
    };
    // the radar sees the target again at 8 s, and may be late by a quarter of a scan
    assert_eq!(until(&mut track, 9.0), 0);
    assert_eq!(until(&mut track, 9.1), 1);
    assert_eq!(until(&mut track, 9.1), 1);
    assert!(track.is_alive(&settings) && track.time == 8.0);
    assert_eq!(until(&mut track, 100.0), 2);
    assert_eq!(rows, [(8.0, 0), (12.0, 0)]);
    let (misses, after) = evidence(&track);
    assert_eq!(misses, 2);
    assert_within(1e-12, after - before, 2.0 * 0.1_f64.ln());
    for _ in 0..2 {
        existence.wait(4.0, 4.0);
        existence.miss(0, &settings);
    }
    assert_within(1e-12, track.existence.probability(), existence.probability());
    assert!(!track.is_alive(&settings));
}

#[test]
fn what_a_radar_does_not_cover_it_does_not_miss() {
    let settings = settings();
    let seen_at = |x: f64, vx: f64, is_confirmed: bool| {
        let first = Measured { radar: 1, ..plot(0.0, [x, 0.0]) };
        let mut track = Track::new(1, &first, 0.0, &settings);
        track.correct(&Measured { radar: 1, ..plot(4.0, [x + 4.0 * vx, 0.0]) }, &settings);
        if is_confirmed {
            track.confirm(&settings);
        }
        let mut missed = 0;
        track.miss(9.1, &settings, |_, _| missed += 1);
        missed
    };
    assert_eq!(seen_at(5e3, 200.0, true), 1);
    // the target has left the range of the radar by then: only a tentative track is missed
    assert_eq!(seen_at(8.7e3, 300.0, true), 0);
    assert_eq!(seen_at(8.7e3, 300.0, false), 1);
}

#[test]
fn a_track_that_is_surely_faster_than_targets_can_be_ends() {
    let settings = Settings { max_speed: 30.0, ..settings() };
    let mut track = track(&settings);
    track.confirm(&settings);
    let mut alive_at = |speed: f64, variance: f64| {
        track.estimate.mean[2] = 0.6 * speed;
        track.estimate.mean[3] = -0.8 * speed;
        track.estimate.covariance[(2, 2)] = variance;
        track.estimate.covariance[(3, 3)] = variance;
        track.estimate.covariance[(2, 3)] = 0.0;
        track.estimate.covariance[(3, 2)] = 0.0;
        (track.speed_probability(&settings), track.is_alive(&settings))
    };
    assert_eq!(alive_at(37.0, 1.0), (1.0, true));
    // one standard deviation, and twenty
    let (one, alive) = alive_at(38.5, 1.0);
    assert_within(1e-12, one, 0.158_655_253_931_457_05);
    assert!(alive);
    assert!(alive_at(57.5, 100.0).1);
    assert!(!alive_at(57.5, 1.0).1);
}

#[test]
fn misses_of_several_radars_are_counted_in_the_order_of_time() {
    let mut settings = settings();
    settings.radars[1] = Radar { scan_period: 10.0, ..settings.radars[0].clone() };
    let mut track = track(&settings);
    track.correct(&Measured { radar: 1, ..plot(5.0, [3.1e4, 4.075e4]) }, &settings);
    track.confirm(&settings);
    let mut rows = Vec::new();
    track.miss(28.0, &settings, |track, radar| rows.push((track.time, radar)));
    let expected = [(8.0, 0), (12.0, 0), (15.0, 1), (16.0, 0), (20.0, 0), (24.0, 0), (25.0, 1)];
    assert_eq!(rows, expected);
}

#[test]
fn a_first_plot_that_two_tracks_have_is_counted_once() {
    let settings = settings();
    let [mut own, mut shared] = [track(&settings), track(&settings)];
    let odds = own.existence.probability() / (1.0 - own.existence.probability());
    shared.share_first(0.75);
    // the plot may be of the other track's target
    let probability = shared.existence.probability();
    assert_within(1e-13, probability / (1.0 - probability), 0.75 * odds);
    let counted = |track: &mut Track, density: f64| {
        track.is_counted = true;
        let mut clutter = [0, 1].map(|sensor| Clutter::of(&settings, sensor));
        clutter[0].pass([0.0, 4.0], || false, &settings.radars[0]);
        let noise = settings.radars.iter().map(Noise::new).collect::<Vec<_>>();
        track.stand(&plot(4.0, [3.08e4, 4.06e4]), density, (&clutter, &noise), &settings);
        track.count(&mut clutter, &settings);
        clutter[0].plots(&settings.radars[0])
    };
    let [both, one] = [&mut own, &mut shared].map(|track| counted(track, 1e-9));
    // the first plot is one scan older, of ten
    assert_within(1e-12, both / one, 1.0 + (-0.1_f64).exp());
}
