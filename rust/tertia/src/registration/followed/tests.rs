use super::*;
use crate::registration::effect::units;
use crate::registration::sighting::tests::{PRIOR, radar};
use crate::registration::sighting::{ERRORS, Report, Sighting};
use nalgebra::{DMatrix, DVector, Matrix2, Matrix4, Matrix4x2};

const OWN: [f64; 2] = [60.0, 80.0];
const WIDE: [f64; 2] = [130.0, 110.0];

/// Covariances of a filter that assumes too much noise, by its own account and in truth, and the followed
/// track.
fn filtered(steps: usize) -> (Matrix4<f64>, Matrix4<f64>, Followed) {
    let (radar, period, push) = (radar([0.0; 3], 50.0, 0.08), 4.0, 0.5);
    let report = |azimuth| Report {
        radar: 0,
        time: 0.0,
        range: 5e4,
        azimuth,
        height: f64::NAN,
        place: None,
    };
    let mut f = Matrix4::identity();
    (f[(0, 2)], f[(1, 3)]) = (period, period);
    let (h, unknowns) = (Matrix4x2::identity(), std::array::from_fn(|j| Some((j, PRIOR[j]))));
    let mut track = Followed::new(0.0);
    let (mut p, mut truth) =
        (Matrix4::from_diagonal(&[0.0, 0.0, 3e4, 3e4].into()), Matrix4::zeros());
    for n in 0..steps {
        let seen = Sighting::new(&report(0.4 + 0.02 * n as f64), 0.0, &radar, [1.0; 2]).unwrap();
        let axes = Matrix2::from_columns(&seen.axes);
        let noise = |[u, v]: [f64; 2]| {
            axes * Matrix2::from_diagonal(&[u * u, v * v].into()) * axes.transpose()
        };
        if n == 0 {
            truth = p + h * noise(OWN) * h.transpose();
            p += h * noise(WIDE) * h.transpose();
        } else {
            let mut q = Matrix4::zeros();
            for (i, a) in [0.5 * period * period, period].into_iter().enumerate() {
                for (j, b) in [0.5 * period * period, period].into_iter().enumerate() {
                    for axis in 0..2 {
                        q[(2 * i + axis, 2 * j + axis)] = push * push * a * b;
                    }
                }
            }
            (p, truth) = (f * p * f.transpose() + q, f * truth * f.transpose() + q);
            let s = h.transpose() * p * h + noise(WIDE);
            let gain = p * h * s.try_inverse().unwrap();
            let left = Matrix4::identity() - gain * h.transpose();
            p = left * p;
            truth = left * truth * left.transpose() + gain * noise(OWN) * gain.transpose();
        }
        let covariance = std::array::from_fn(|i| p[(i / 4, i % 4)]);
        track.advance(period * n as f64);
        if n == 0 {
            track.begin(&seen, [WIDE, OWN], (&covariance, false), [0.0; 2], &unknowns);
        } else {
            track.correct(&seen, [WIDE, OWN], (&covariance, None), [0.0; 2], &unknowns, period);
        }
        track.limit(&covariance);
    }
    (p, truth, track)
}

#[test]
fn noise_that_stands_for_errors_is_taken_out_of_the_covariance() {
    for steps in [1, 2, 3, 30] {
        let (p, truth, track) = filtered(steps);
        for i in 0..4 {
            for j in 0..4 {
                let scale = (truth[(i, i)] * truth[(j, j)]).sqrt();
                let off = p[(i, j)] - track.excess[i][j] - truth[(i, j)];
                assert!(off.abs() < 1e-9 * scale, "{steps} {i} {j} {off}");
            }
        }
        assert!((p[(0, 0)] - truth[(0, 0)]) > 0.2 * p[(0, 0)]);
    }
}

#[test]
fn a_covariance_keeps_the_share_of_the_noise() {
    let (_, _, mut track) = filtered(10);
    // as a mixture of models may give
    let small = std::array::from_fn(|i| if i % 5 == 0 { 1e3 } else { 0.0 });
    track.limit(&small);
    let left = Matrix4::from_fn(|i, j| small[4 * i + j] - track.excess[i][j]);
    let least = left.symmetric_eigenvalues().min();
    assert!(least >= 0.5e3 * (60.0_f64 / 130.0).powi(2) - 1e-6, "{least}");
}

/// Plot of a radar in some direction.
fn plot(number: usize, azimuth: f64) -> Sighting {
    let (time, range, height) = (0.0, 5e4, f64::NAN);
    let report = Report { radar: number, time, range, azimuth, height, place: None };
    Sighting::new(&report, 0.0, &radar([0.0; 3], 50.0, 0.08), [1.0; 2]).unwrap()
}

#[test]
fn a_track_moves_with_the_errors() {
    let mut track = Followed::new(0.0);
    let own = [[100.0, 0.0], [0.0, 50.0], [0.0; 2], [0.0; 2]];
    track.update(&plot(1, 0.0), &[[0.5, 0.0, 0.1, 0.0], [0.0, 0.5, 0.0, 0.1]], &own);
    let by = [[9.0; ERRORS], [2.0, -1.0, 7.0, 7.0, 0.0, 0.0, 0.0, 0.0]];
    // the larger offset was part of the position
    assert_eq!(track.moved(&by), [-100.0, 25.0, -20.0, 5.0]);
}

#[test]
fn no_gain_goes_beyond_the_plot() {
    let radar = radar([0.0; 3], 50.0, 0.08);
    let report =
        Report { radar: 0, time: 0.0, range: 5e4, azimuth: 0.0, height: f64::NAN, place: None };
    let seen = Sighting::new(&report, 0.0, &radar, [1.0; 2]).unwrap();
    let covariance = std::array::from_fn(|i| if i % 5 == 0 { 1e6 } else { 0.0 });
    let unknowns = std::array::from_fn(|j| Some((j, PRIOR[j])));
    let mut track = Followed::new(0.0);
    for _ in 0..20 {
        track.correct(&seen, [OWN, OWN], (&covariance, None), [0.0; 2], &unknowns, 4.0);
        let offset = track.parts[0].part[0];
        assert!((0.0..=PRIOR[0] * (1.0 + 1e-9)).contains(&offset[1]), "{offset:?}");
    }
}

/// After a plot of which several models are equally sure, their velocities may still be far apart: the
/// covariance is not that of one filter, and its gain would change the velocity by many times what it should.
#[test]
fn effects_of_errors_do_not_grow() {
    let radar = radar([0.0; 3], 50.0, 0.08);
    let report =
        Report { radar: 0, time: 0.0, range: 2e3, azimuth: 0.0, height: f64::NAN, place: None };
    let seen = Sighting::new(&report, 0.0, &radar, [1.0; 2]).unwrap();
    let (mut covariance, own) = ([0.0; 16], [50.0, 1.0]);
    for (i, j, value) in [(0, 0, 1.0), (1, 1, 100.0), (2, 2, 1e4), (3, 3, 1e4), (0, 2, 90.0)] {
        (covariance[4 * i + j], covariance[4 * j + i]) = (value, value);
    }
    let unknowns = std::array::from_fn(|j| Some((j, PRIOR[j])));
    let mut track = Followed::new(0.0);
    for n in 0..100 {
        track.advance(4.0 * f64::from(n));
        track.correct(&seen, [own, own], (&covariance, None), [0.0; 2], &unknowns, 4.0);
        track.see(4.0 * f64::from(n), 0, [0.0; 2], [0.0; 2]);
    }
    // the displacement of the plot by the azimuth, 2 km away
    let (effect, displaced) = (track.parts[0].part[2], 2e3 * PRIOR[2]);
    assert!((effect[0] - displaced).abs() < 1e-6 * displaced, "{effect:?}");
    assert!(effect[2].abs() < 1e-6 * displaced, "{effect:?}");
}

/// A deviation is an azimuth error that depends on the direction.
#[test]
fn deviations_of_azimuths() {
    let own = [[0.0; 2], [0.0; 2], [30.0, -60.0], [0.0; 2]];
    let mut track = Followed::new(0.0);
    let (first, second) = (0.7_f64, 2.0_f64);
    track.update(&plot(0, first), &[[1.0, 0.0, 0.2, 0.0], [0.0, 1.0, 0.0, 0.2]], &own);
    track.update(&plot(1, second), &[[0.5, 0.0, 0.1, 0.0], [0.0, 0.5, 0.0, 0.1]], &own);
    // the azimuth and its deviation, half as uncertain, of each radar
    let sigmas = [0.0, 0.0, 2.0, 0.0, 1.0, 1.0, 1.0, 1.0];
    let unknown = |first| {
        let mut next = first..;
        sigmas.map(|sigma| (sigma > 0.0).then(|| (next.next().unwrap(), sigma)))
    };
    let unknowns = vec![unknown(0), unknown(5)];
    let root = DMatrix::from_fn(10, 10, |i, j| ((3 * i + 7 * j) % 11) as f64 / 11.0);
    let covariance = &root * root.transpose();
    let direction = |azimuth: f64| {
        let (twice, weight) = (2.0 * azimuth, 0.5);
        let harmonics = [azimuth.sin(), azimuth.cos(), twice.sin(), twice.cos()];
        [&[1.0][..], &harmonics.map(|value| weight * value)].concat()
    };
    let (mut effects, mut by) = (DMatrix::zeros(4, 10), vec![[0.0; ERRORS]; 2]);
    for (k, azimuth) in [first, second].into_iter().enumerate() {
        for (j, weight) in direction(azimuth).into_iter().enumerate() {
            for i in 0..4 {
                effects[(i, 5 * k + j)] = track.parts[k].part[2][i] * weight;
            }
        }
        let steps = [0.0, 0.0, 1.0, 0.0, 0.5, 1.0, 1.5, 2.0];
        by[k] = std::array::from_fn(|j| units(&unknowns[k])[j] * steps[j]);
    }
    let expected = &effects * &covariance * effects.transpose();
    let added = track.added(&Blocks::new(&covariance, &unknowns));
    let moved = track.moved(&by);
    let steps = DVector::from_fn(10, |i, _| [1.0, 0.5, 1.0, 1.5, 2.0][i % 5]);
    let change = &effects * steps;
    for i in 0..4 {
        assert!((moved[i] + change[i]).abs() < 1e-9 * change.amax(), "{i} {moved:?}");
        for j in 0..4 {
            assert!((added[4 * i + j] - expected[(i, j)]).abs() < 1e-9 * expected.amax());
        }
    }
}

#[test]
fn errors_of_radars_are_correlated() {
    // each on its own, the errors of two radars are large; their sum is small
    let (variance, correlation) = (0.25, -0.9);
    let mut covariance = DMatrix::from_diagonal_element(2 * KINDS, 2 * KINDS, variance);
    for j in 0..KINDS {
        covariance[(j, KINDS + j)] = correlation * variance;
        covariance[(KINDS + j, j)] = correlation * variance;
    }
    let unknown = |first| std::array::from_fn(|j| (j < KINDS).then(|| (first + j, 1.0)));
    let unknowns = vec![unknown(0), unknown(KINDS)];
    let mut track = Followed::new(0.0);
    let own = [[100.0, 0.0], [0.0, 50.0], [30.0, -60.0], [20.0, 10.0]];
    track.update(&plot(0, 0.0), &[[1.0, 0.0, 0.2, 0.0], [0.0, 1.0, 0.0, 0.2]], &own);
    track.update(&plot(1, 0.0), &[[0.5, 0.0, 0.1, 0.0], [0.0, 0.5, 0.0, 0.1]], &own);
    let [first, second] = [0, 1].map(|k| {
        let part = track.parts[k].part;
        Matrix4::from_fn(|i, j| part[j][i])
    });
    let alone = variance * (first * first.transpose() + second * second.transpose());
    let both = correlation * variance * (first * second.transpose() + second * first.transpose());
    let added = track.added(&Blocks::new(&covariance, &unknowns));
    for (place, added) in added.into_iter().enumerate() {
        let (i, j) = (place / 4, place % 4);
        assert!((added - alone[(i, j)] - both[(i, j)]).abs() < 1e-9, "{i} {j} {added}");
    }
    // the variances without the correlation would be several times as large
    assert!(added[0] < 0.2 * alone[(0, 0)], "{} {}", added[0], alone[(0, 0)]);
}
