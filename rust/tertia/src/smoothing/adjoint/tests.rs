//! Comparison with the smoother by rows.

use super::super::smoother::{self, Workspace};
use super::super::whitener::Noise;
use super::*;
use crate::base::checks::assert_within;

const NOISE: [f64; 4] = [4.0, 1.5, 1.5, 2.0];

/// Positions along two axes, with the smoothed states and covariances of both smoothers.
struct Both {
    mean: [Vec<f64>; 2],
    covariance: [Vec<f64>; 2],
    innovation: [Vec<f64>; 2],
    log_likelihood: [f64; 2],
}

impl Both {
    /// Smooths with rows of information, and with covariances.
    fn of(track: &Track<'_>, motion: ProcessNoise, loss: f64) -> Self {
        let n = track.len();
        let [mut mean, mut quick] = [vec![0.0; 6 * n], vec![0.0; 6 * n]];
        let [mut covariance, mut own] = [vec![0.0; 36 * n], vec![0.0; 36 * n]];
        let [mut innovation, mut whitened] = [vec![0.0; 2 * n], vec![0.0; 2 * n]];
        let mut out = crate::smoothing::Smoothed {
            mean: &mut mean,
            covariance: &mut covariance,
            innovation: &mut innovation,
        };
        let expected = smoother::by_rows(track, motion, &mut Workspace::default(), &mut out);
        let mut out = Smoothed {
            mean: &mut quick,
            covariance: &mut own,
            components: 6,
            innovation: &mut whitened,
            loss,
        };
        let summary = Adjoint::<2, 6>::default().smooth(track, motion, &mut out).unwrap();
        Self {
            mean: [mean, quick],
            covariance: [covariance, own],
            innovation: [innovation, whitened],
            log_likelihood: [expected.log_likelihood, summary.log_likelihood],
        }
    }

    /// Returns the largest difference of states, in sigmas, and the largest relative difference of variances.
    fn differences(&self) -> [f64; 2] {
        let [covariance, own] = &self.covariance;
        let mut largest = [0.0_f64; 2];
        for (at, (mean, quick)) in self.mean[0].iter().zip(&self.mean[1]).enumerate() {
            let diagonal = at / 6 * 36 + at % 6 * 7;
            let variance = covariance[diagonal];
            largest[0] = largest[0].max((mean - quick).abs() / variance.sqrt());
            largest[1] = largest[1].max((own[diagonal] / variance - 1.0).abs());
        }
        largest
    }
}

/// The results must be those with rows of information, with missing numbers, equal and irregular times.
#[test]
fn both_ways_of_smoothing_agree() {
    let time: Vec<f64> = (0..60).map(|i| f64::from(i - i % 7 / 6) * 0.7).collect();
    let mut y: Vec<f64> = (0..120).map(|i| (f64::from(i) * 1.7).sin() * 3.0 + 900.0).collect();
    for at in [0, 9, 44, 45, 46, 47, 80] {
        y[at] = f64::NAN;
    }
    let track = Track::try_new(2, &time, &y, Noise::Same(&NOISE), None).unwrap();
    let wandering = [(1e-12, 1e-3), (1e-9, 2.0), (0.3, 0.3)];
    let wandering = wandering
        .map(|(jerk, acceleration)| ProcessNoise { acceleration, ..ProcessNoise::with_jerk(jerk) });
    let stiff = [1e-6, 1e3].map(|last_axis| ProcessNoise {
        last_axis,
        acceleration: 0.3,
        ..ProcessNoise::with_jerk(1e-2)
    });
    let jerks = [0.0, 1e-8, 1e-2, 10.0].map(ProcessNoise::with_jerk);
    for motion in jerks.into_iter().chain(wandering).chain(stiff) {
        let both = Both::of(&track, motion, f64::INFINITY);
        let [expected, quick] = both.log_likelihood;
        assert!((quick - expected).abs() < 1e-9 * expected.abs());
        for (own, other) in both.innovation[0].iter().zip(&both.innovation[1]) {
            assert_eq!(own.is_nan(), other.is_nan());
            assert!(own.is_nan() || (own - other).abs() < 1e-9, "{own} {other}");
        }
        let [states, variances] = both.differences();
        assert!(states < 1e-9, "{motion:?} {states}");
        assert!(variances < 1e-7, "{motion:?} {variances}");
    }
}

/// Ten thousand instants with hardly any jerk: the acceleration is known 1e11 times worse from their first
/// fifty than from all of them, and an antisymmetric part of Λ from rounding would grow on the way back.
#[test]
fn long_records_that_hardly_wander_keep_their_digits() {
    let time: Vec<f64> = (0..10_000).map(f64::from).collect();
    let y: Vec<f64> = (0..20_000).map(|i| (f64::from(i) * 1.7).sin() * 3.0).collect();
    let track = Track::try_new(2, &time, &y, Noise::Same(&NOISE), None).unwrap();
    for jerk in [1e-40, 1e-24, 1e-16, 1e-12] {
        let [states, variances] =
            Both::of(&track, ProcessNoise::with_jerk(jerk), 1e7).differences();
        assert!(states < 1e-7, "{jerk} {states}");
        assert!(variances < 1e-4, "{jerk} {variances}");
    }
}

/// The results must be those with rows of information.
#[test]
fn the_first_three_plots_as_by_rows() {
    let matrices = [4.0, 1.2, 1.2, 1.0, 9.0, -2.0, -2.0, 5.0, 1.0, 0.0, 0.0, 2.0];
    let y = [3.0, -1.0, 4.0, 1.0, 9.0, 2.0];
    for times in [[0.0, 1.0, 2.0], [5.0, 5.3, 9.0]] {
        let track = Track::try_new(2, &times, &y, Noise::Each(&matrices), None).unwrap();
        for (jerk, acceleration, last_axis) in
            [(0.0, 0.0, 1.0), (1e-3, 0.0, 1.0), (2.0, 0.0, 50.0), (1e-6, 0.7, 1e-4)]
        {
            let motion = ProcessNoise { acceleration, last_axis, ..ProcessNoise::with_jerk(jerk) };
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
