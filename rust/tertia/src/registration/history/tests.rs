//! Errors over time from direct measurements of them.

use super::*;

/// One measurement of each error per period, with this standard deviation in units of that of the prior.
fn said(values: &[Vec<f64>], sigma: f64) -> Vec<Said> {
    let information = sigma.powi(-2);
    let period = |own: &Vec<f64>| Said {
        information: DMatrix::from_diagonal_element(own.len(), own.len(), information),
        score: information * DVector::from_column_slice(own),
    };
    values.iter().map(period).collect()
}

fn middles(count: usize) -> Vec<f64> {
    (0..count).map(|t| 60.0 * t as f64).collect()
}

fn history(values: &[Vec<f64>], sigma: f64, rate: f64) -> History {
    let order = values[0].len();
    let (middles, rates) = (middles(values.len()), vec![rate; order]);
    // a radar for every two errors
    let own: Vec<Vec<usize>> = (0..order / 2).map(|k| vec![2 * k, 2 * k + 1]).collect();
    let course = Course { middles: &middles, rates: &rates, own: &own, changes: &[] };
    History::new(&said(values, sigma), &course)
}

/// Pseudo-random numbers with standard deviation one.
fn noise(i: usize) -> f64 {
    let uniform = |seed: usize| {
        let mixed = (seed as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        ((mixed ^ (mixed >> 29)).wrapping_mul(0xBF58_476D_1CE4_E5B9) >> 11) as f64 / 2f64.powi(53)
    };
    let radius = (-2.0 * uniform(2 * i).max(1e-12).ln()).sqrt();
    radius * (std::f64::consts::TAU * uniform(2 * i + 1)).cos()
}

#[test]
fn constant_errors_are_the_mean_of_all_periods() {
    let values: Vec<Vec<f64>> =
        (0..10).map(|t| (0..4).map(|j| 1.0 + 0.1 * noise(4 * t + j)).collect()).collect();
    let found = history(&values, 0.1, 0.0);
    assert!(found.changes.is_empty());
    for (mean, covariance) in &found.known {
        for j in 0..4 {
            let sum: f64 = values.iter().map(|own| own[j]).sum();
            // ten measurements of variance .01 beside a prior of variance one
            assert!((mean[j] - 100.0 * sum / 1001.0).abs() < 1e-12);
            assert!((covariance[(j, j)] - 1.0 / 1001.0).abs() < 1e-12);
        }
    }
}

#[test]
fn a_change_is_found_with_its_radar_and_its_period() {
    let value = |t: usize, j: usize| {
        let level = if t >= 13 && j == 2 { 3.0 } else { 0.5 };
        level + 0.1 * noise(4 * t + j)
    };
    let values: Vec<Vec<f64>> = (0..30).map(|t| (0..4).map(|j| value(t, j)).collect()).collect();
    for rate in [0.0, 1.0 / 30_000.0] {
        let found = history(&values, 0.1, rate);
        assert_eq!(found.changes, [(13, 1)]);
        for (t, (mean, covariance)) in found.known.iter().enumerate() {
            let expected = if t >= 13 { 3.0 } else { 0.5 };
            assert!((mean[2] - expected).abs() < 4.0 * covariance[(2, 2)].sqrt(), "{t}: {mean}");
        }
    }
}

#[test]
fn drifting_errors_are_followed_within_their_uncertainty() {
    // random walks with the variance of the assumed drift, to which 60 s add 1 - exp(-60 / 15,000)
    let step = (1.0 - (-60.0 / 15_000.0_f64).exp()).sqrt();
    let (mut nees, mut count) = (0.0, 0);
    for seed in 0..20 {
        let mut truth = [0.3, -0.5];
        let mut path = Vec::new();
        for t in 0..60 {
            let at = 1000 * seed + 4 * t;
            for (j, own) in truth.iter_mut().enumerate() {
                *own += step * noise(at + j);
            }
            path.push(truth);
        }
        let measured = |(t, own): (usize, &[f64; 2])| {
            (0..2).map(|j| own[j] + 0.2 * noise(1000 * seed + 4 * t + 2 + j)).collect()
        };
        let values: Vec<Vec<f64>> = path.iter().enumerate().map(measured).collect();
        let found = history(&values, 0.2, 1.0 / 30_000.0);
        assert!(found.changes.is_empty());
        for (own, (mean, covariance)) in path.iter().zip(&found.known) {
            for j in 0..2 {
                nees += (mean[j] - own[j]).powi(2) / covariance[(j, j)];
                count += 1;
            }
        }
    }
    let nees = nees / f64::from(count);
    assert!((0.7..1.3).contains(&nees), "{nees}");
}

#[test]
fn the_likelihood_is_that_of_all_measurements_together() {
    let values = vec![vec![0.4, -0.2], vec![0.9, 0.1], vec![0.2, 0.6]];
    let (middles, rates, own) = (middles(3), vec![1e-3; 2], vec![vec![0, 1]]);
    let course = Course { middles: &middles, rates: &rates, own: &own, changes: &[] };
    let sigma = 0.5;
    let found = Passes::new(&said(&values, sigma), &course, rates.clone(), &[(2, 0)]).likelihood;
    // covariance of each error: of the process, of a change of variance nine before the third period, and of
    // the noise
    let mut process = DMatrix::zeros(3, 3);
    for i in 0..3 {
        for j in 0..3 {
            process[(i, j)] = (-1e-3 * (middles[i] - middles[j]).abs()).exp();
        }
    }
    process[(2, 2)] += 9.0;
    let covariance = process + DMatrix::from_diagonal_element(3, 3, sigma * sigma);
    let inverse = covariance.clone().try_inverse().unwrap();
    let expected: f64 = (0..2)
        .map(|j| {
            let z = DVector::from_iterator(3, values.iter().map(|own| own[j]));
            let square = z.dot(&z) / (sigma * sigma);
            let scale = 3.0 * (sigma * sigma).ln();
            0.5 * (square + scale - z.dot(&(&inverse * &z)) - covariance.determinant().ln())
        })
        .sum();
    assert!((found - expected).abs() < 1e-10, "{found} {expected}");
}

#[test]
fn what_hardly_changes_has_not_changed_suddenly() {
    let value = |t: usize, j: usize| if t >= 13 && j == 2 { 0.05 } else { 0.0 };
    let values: Vec<Vec<f64>> = (0..30).map(|t| (0..4).map(|j| value(t, j)).collect()).collect();
    assert!(history(&values, 0.005, 0.0).changes.is_empty());
    let larger: Vec<Vec<f64>> =
        values.iter().map(|own| own.iter().map(|x| 4.0 * x).collect()).collect();
    assert_eq!(history(&larger, 0.005, 0.0).changes, [(13, 1)]);
}
