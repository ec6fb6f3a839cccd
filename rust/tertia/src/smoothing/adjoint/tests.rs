//! Beside the smoother by rows.

use super::super::smoother::{self, Workspace};
use super::super::track::Noise;
use super::*;
use crate::base::checks::assert_within;

/// The same as by rows of information, with missing numbers, equal and irregular times.
#[test]
fn both_ways_of_smoothing_agree() {
    let time: Vec<f64> = (0..60).map(|i| f64::from(i - i % 7 / 6) * 0.7).collect();
    let mut y: Vec<f64> = (0..120).map(|i| (f64::from(i) * 1.7).sin() * 3.0 + 900.0).collect();
    for at in [0, 9, 44, 45, 46, 47, 80] {
        y[at] = f64::NAN;
    }
    let noise = [4.0, 1.5, 1.5, 2.0];
    let track = Track::try_new(2, &time, &y, Noise::Same(&noise), None).unwrap();
    let wandering = [(1e-12, 1e-3), (1e-9, 2.0), (0.3, 0.3)];
    let wandering = wandering.map(|(jerk, acceleration)| ProcessNoise { jerk, acceleration });
    for motion in [0.0, 1e-8, 1e-2, 10.0].map(ProcessNoise::with_jerk).into_iter().chain(wandering)
    {
        let [mut mean, mut quick] = [vec![0.0; 360], vec![0.0; 360]];
        let [mut covariance, mut own] = [vec![0.0; 2160], vec![0.0; 2160]];
        let [mut innovation, mut whitened] = [vec![0.0; 120], vec![0.0; 120]];
        let mut out = crate::smoothing::Smoothed {
            mean: &mut mean,
            covariance: &mut covariance,
            innovation: &mut innovation,
        };
        let expected =
            smoother::by_rows(&track, motion, &mut Workspace::default(), &mut out).log_likelihood;
        let mut adjoint = Adjoint::<2, 6>::default();
        let mut out = Smoothed {
            mean: &mut quick,
            covariance: &mut own,
            components: 6,
            innovation: &mut whitened,
            loss: f64::INFINITY,
        };
        let summary = adjoint.smooth(&track, motion, &mut out).unwrap();
        assert!((summary.log_likelihood - expected).abs() < 1e-9 * expected.abs());
        for (own, other) in innovation.iter().zip(&whitened) {
            assert_eq!(own.is_nan(), other.is_nan());
            assert!(own.is_nan() || (own - other).abs() < 1e-9, "{own} {other}");
        }
        for k in 0..60 {
            for i in 0..6 {
                let sigma = covariance[(k * 6 + i) * 6 + i].sqrt();
                let error = (mean[k * 6 + i] - quick[k * 6 + i]).abs() / sigma;
                assert!(error < 1e-9, "{motion:?}, instant {k}, component {i}: {error}");
                let ratio = own[(k * 6 + i) * 6 + i] / (sigma * sigma);
                assert!((ratio - 1.0).abs() < 1e-7, "{motion:?} {k} {i} {ratio}");
            }
        }
    }
}

/// The same by rows of information.
#[test]
fn the_first_three_plots_as_by_rows() {
    let matrices = [4.0, 1.2, 1.2, 1.0, 9.0, -2.0, -2.0, 5.0, 1.0, 0.0, 0.0, 2.0];
    let y = [3.0, -1.0, 4.0, 1.0, 9.0, 2.0];
    for times in [[0.0, 1.0, 2.0], [5.0, 5.3, 9.0]] {
        let track = Track::try_new(2, &times, &y, Noise::Each(&matrices), None).unwrap();
        for (jerk, acceleration) in [(0.0, 0.0), (1e-3, 0.0), (2.0, 0.0), (1e-6, 0.7)] {
            let motion = ProcessNoise { jerk, acceleration };
            let (x, p, logarithms) = of_three::<2, 6>(&track, motion).unwrap();
            let mut engine = Adjoint::<2, 6>::default();
            let (expected, _, total) = engine.open(&track, motion, None, &mut []).unwrap();
            assert_within(1e-10, logarithms.total(), total.total());
            for i in 0..6 {
                assert!((x[i] - expected.x[i]).abs() < 1e-10 * expected.p[i][i].sqrt());
                for j in 0..6 {
                    let size = (expected.p[i][i] * expected.p[j][j]).sqrt();
                    assert!((p[i][j] - expected.p[i][j]).abs() < 1e-10 * size);
                }
            }
        }
    }
}
