//! Mistakes that are easily made with blocks: each of these tests fails if one of them is made.

use super::*;
use crate::registration::sighting::Report;
use crate::registration::sighting::tests::{PRIOR, radar};

const NONE: [Errors; 2] = [[0.0; ERRORS]; 2];

fn radars() -> Vec<Radar> {
    vec![radar([0.0; 3], 10.0, 0.01), radar([6e4, 0.0, 100.0], 15.0, 0.02)]
}

/// Plots without noise of a target 9 km high on this path, every two seconds, by the radars in turn.
fn plots(path: impl Fn(f64) -> [f64; 2], errors: &[Errors; 2]) -> Vec<TargetPlot> {
    let (radars, height) = (radars(), 9e3);
    let plot = |i: usize| {
        let (time, k) = (2.0 * i as f64, i % 2);
        let ([x, y], [offset, gain, azimuth, ..]) = (path(time), errors[k]);
        let own = radars[k].position;
        let (east, north, up) = (x - own[0], y - own[1], height - own[2]);
        let range = (1.0 + gain) * east.hypot(north).hypot(up) + offset;
        let azimuth = east.atan2(north) + azimuth;
        let report = Report { radar: k, time, range, azimuth, height, place: None };
        TargetPlot { report, target: 1, turn_probability: 0.0 }
    };
    (0..10).map(plot).collect()
}

fn straight(time: f64) -> [f64; 2] {
    [2e4 + 180.0 * time, 3e4 + 90.0 * time]
}

/// A turn with 3 m/s².
fn turn(time: f64) -> [f64; 2] {
    let (speed, rate) = (200.0_f64, 0.015);
    let (sine, cosine) = (rate * time).sin_cos();
    [2e4 + speed / rate * sine, 3e4 + speed / rate * (1.0 - cosine)]
}

/// The sums of one block, if the errors have this standard deviation in units of that of the prior.
fn summed(plots: &[TargetPlot], sigma: f64) -> Sums {
    summed_by(plots, sigma, [false; 2])
}

fn summed_by(plots: &[TargetPlot], sigma: f64, slant: [bool; 2]) -> Sums {
    let unknowns = numbered(&[PRIOR; 2]);
    let (mut sums, covariance) = (Sums::new(8, 2), sigma * sigma * DMatrix::identity(8, 8));
    let mut known = Known::new(&covariance);
    let ways = Ways { radars: &radars(), slant: &slant };
    sums.add(plots, &ways, &unknowns, &NONE, &[[1.0; 2]; 2], &mut known);
    sums
}

fn total(pairs: &[[f64; 2]]) -> f64 {
    pairs.iter().flatten().sum()
}

#[test]
fn plots_without_a_height_are_at_that_of_the_others() {
    let mut plots = plots(straight, &NONE);
    let whole = summed(&plots, 1.0);
    plots[3].report.height = f64::NAN;
    let found = summed(&plots, 1.0);
    // on the ground, this plot would be a kilometre off and would be left out
    assert!(total(&found.square) < 1e-6, "{:?}", found.square);
    let (all, used) = (total(&whole.redundancy), total(&found.redundancy));
    assert!((used - all).abs() < 1e-9, "{used} {all}");
}

#[test]
fn one_radar_says_nothing_of_its_errors_but_of_its_noise() {
    let mut plots = plots(straight, &NONE);
    plots.retain(|plot| plot.report.radar == 0);
    let found = summed(&plots, 1.0);
    assert_eq!(found.blocks, [0, 0]);
    assert_eq!(found.information, DMatrix::identity(8, 8));
    assert_eq!(found.score.amax(), 0.0);
    assert!(total(&found.redundancy[..1]) > 3.0);
}

#[test]
fn a_turn_is_no_error() {
    let mut plots = plots(turn, &NONE);
    // the turn is not announced: unexpected motion is refused
    assert_eq!(summed(&plots, 1.0).blocks, [0, 1]);
    plots[4].turn_probability = 0.9;
    let found = summed(&plots, 1.0);
    assert_eq!(found.blocks, [1, 0]);
    let step = found.information.cholesky().unwrap().solve(&found.score);
    assert!(step.amax() < 0.2, "{step}");
}

#[test]
fn a_block_that_is_refused_says_nothing() {
    let mut plots = plots(straight, &NONE);
    for (plot, off) in plots.iter_mut().zip([9e3, -7e3, 5e3, 11e3, -13e3, 6e3]) {
        plot.report.range += off;
    }
    let found = summed(&plots, 1.0);
    assert_eq!(found.blocks, [0, 1]);
    assert_eq!(found.information, DMatrix::identity(8, 8));
    assert_eq!((total(&found.square), total(&found.redundancy)), (0.0, 0.0));
}

#[test]
fn what_uncertain_errors_explain_is_no_misfit() {
    let mut off = [0.0; ERRORS];
    [off[0], off[AZIMUTH]] = [3.0 * PRIOR[0], 3.0 * PRIOR[AZIMUTH]];
    let plots = plots(straight, &[[0.0; ERRORS], off]);
    assert_eq!(summed(&plots, 1.0).blocks, [1, 0]);
    assert_eq!(summed(&plots, 1e-3).blocks, [0, 1]);
}

/// A target 9 km high, whose height is unknown, is 0.6 to 2 km nearer on the ground than its slant ranges
/// say. This must not be taken for errors of the radars, and an error of an azimuth must still be found.
#[test]
fn unknown_heights_are_no_errors_of_ranges() {
    let azimuth = 1e-3;
    let mut errors = NONE;
    errors[1][AZIMUTH] = azimuth;
    let mut plots = plots(straight, &errors);
    for plot in &mut plots {
        plot.report.height = f64::NAN;
    }
    let step = |slant: [bool; 2]| {
        let found = summed_by(&plots, 100.0, slant);
        assert_eq!(found.blocks, [1, 0], "{slant:?}");
        let cholesky = found.information.cholesky().unwrap();
        (cholesky.solve(&found.score), cholesky.inverse())
    };
    let (known, covariance) = step([true; 2]);
    for k in 0..8 {
        let off = known[k] - if k == 6 { azimuth / PRIOR[2] } else { 0.0 };
        assert!(off.abs() < 1.5 * covariance[(k, k)].sqrt(), "{k}: {off}");
    }
    // the same ranges taken as ranges on the ground
    let (taken, covariance) = step([false; 2]);
    let worst = (0..8).map(|k| taken[k].abs() / covariance[(k, k)].sqrt()).fold(0.0, f64::max);
    assert!(worst > 5.0, "{worst}");
}
