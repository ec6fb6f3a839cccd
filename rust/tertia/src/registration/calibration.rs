//! Systematic error of one sensor from targets whose positions are known.
//!
//! The measured minus the expected value is `y = c + Σ (a_k sin kα + b_k cos kα) + g(t) + e`: c is constant
//! with a wide prior, the coefficients are N(0, (σ_d/k)²), g is Gauss–Markov with variance σ_g² and
//! correlation time τ, and e has the stated standard deviation or a larger one. A Kalman filter gives the
//! likelihood of σ_d, σ_g and τ on a grid, over which the results are averaged. Cost O(N) for each point of
//! the grid, times the square of the number of unknowns. The order of the series is that of the largest
//! likelihood. Errors that vary with the direction but are not in the series are detected by products of
//! residuals in neighbouring directions, whose mean is the variance of these errors.

use crate::base::angle::median;
use crate::base::interrupt::poll;
use nalgebra::{DMatrix, DVector};
use std::f64::consts::TAU;
use std::ops::RangeInclusive;

/// Standard deviations of the coefficients and of the drift, in units of that of the measurements.
const SCALES: [f64; 7] = [0.12, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0];
/// Correlation times, as fractions of the duration of the record.
const TIMES: [f64; 4] = [0.5, 0.15, 0.05, 0.015];
/// Standard deviation of the constant, relative to the larger of the largest residual and the stated standard
/// deviation.
const WIDE: f64 = 10.0;
/// Prior odds of no coefficients, or of no drift, against a single scale.
const NOTHING: f64 = 2.0;
const UNLIKELY: f64 = 0.01;
/// Constant of Tukey's weights, and number of rounds; in the first, all weights are 1.
const TUKEY: f64 = 4.685;
const ROUNDS: usize = 3;
/// Largest size, in standard deviations, of residuals in products.
const LARGEST: f64 = 3.0;
/// Number of standard errors above which a mean product of residuals is not due to chance: 1 % are above.
const SIGNIFICANT: f64 = 2.326;
/// Largest angle between neighbouring directions, radians.
const NEIGHBOURS: f64 = 0.09;
/// Median size of a standard normal variable.
const MEDIAN_SIZE: f64 = 0.674_489_750_196_081_7;

/// Measured minus expected values, with their times and directions.
#[derive(Clone, Copy, Debug)]
pub struct Run<'a> {
    /// Times, not decreasing, in seconds.
    pub time: &'a [f64],
    /// Differences.
    pub residual: &'a [f64],
    /// Directions in radians.
    pub azimuth: &'a [f64],
    /// Standard deviation of a measurement.
    pub sigma: f64,
}

/// Constant and coefficients with their covariance, and the drift.
#[derive(Clone, Debug)]
pub struct Calibration {
    /// c, a_1, b_1, a_2, …
    pub mean: DVector<f64>,
    /// Covariance of the mean.
    pub covariance: DMatrix<f64>,
    /// Variance of the drift.
    pub drift: f64,
    /// Correlation time of the drift; ∞ if there is no drift.
    pub time: f64,
    /// Variance of a measurement relative to the stated one, at least 1.
    pub growth: f64,
    /// Variance of errors that vary with the direction but are not in the series; 0 if there are none.
    pub remainder: f64,
}

struct Filtered {
    mean: DVector<f64>,
    covariance: DMatrix<f64>,
    value: f64,
    growth: f64,
}

/// Estimates the error as a Fourier series of the order with the largest likelihood.
pub fn calibrate(run: &Run<'_>, orders: RangeInclusive<usize>) -> Calibration {
    let mut found = averaged(run, *orders.start(), &vec![1.0; run.residual.len()]);
    for _ in 1..ROUNDS {
        let (off, scale) = left(run, &found);
        let weight: Vec<f64> = off
            .iter()
            .map(|off| (1.0 - (off.abs() / scale / TUKEY).min(1.0).powi(2)).powi(2))
            .collect();
        let order = likeliest(run, orders.clone(), &weight, &found);
        found = averaged(run, order, &weight);
    }
    found.remainder = remainder(run, &found);
    found
}

/// Returns the residuals after subtraction of the series, and a robust standard deviation of them.
fn left(run: &Run<'_>, found: &Calibration) -> (Vec<f64>, f64) {
    let order = found.mean.len() / 2;
    let measured = run.residual.iter().zip(run.azimuth);
    let off: Vec<f64> = measured.map(|(r, a)| r - terms(*a, order).dot(&found.mean)).collect();
    let mut sizes: Vec<f64> = off.iter().map(|off| off.abs()).collect();
    (off, (median(&mut sizes) / MEDIAN_SIZE).max(run.sigma))
}

/// Returns the order with the largest likelihood, without a drift or with the one that was found.
fn likeliest(
    run: &Run<'_>,
    orders: RangeInclusive<usize>,
    weight: &[f64],
    found: &Calibration,
) -> usize {
    let drift = (found.drift / found.growth).sqrt();
    let drifts = if drift > 0.0 { vec![(0.0, 0.0), (drift, found.time)] } else { vec![(0.0, 0.0)] };
    let mut best = (f64::NEG_INFINITY, *orders.start());
    for order in orders.clone().filter(|_| orders.start() < orders.end()) {
        let rows: Vec<DVector<f64>> = run.azimuth.iter().map(|a| terms(*a, order)).collect();
        let mut values = Vec::new();
        for (own, prior) in of_coefficients(order) {
            for (drift, time) in &drifts {
                let point = [own * run.sigma, *drift, *time];
                values.push(prior + filter(run, &rows, weight, point).value);
            }
        }
        let top = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let value = top + values.iter().map(|value| (value - top).exp()).sum::<f64>().ln();
        if value > best.0 {
            best = (value, order);
        }
    }
    best.1
}

/// Standard deviations of the coefficients, in units of that of the measurements, and ln of their prior.
fn of_coefficients(order: usize) -> Vec<(f64, f64)> {
    if order == 0 {
        return vec![(0.0, 0.0)];
    }
    let total = (NOTHING + SCALES.len() as f64).ln();
    let none = (0.0, NOTHING.ln() - total);
    std::iter::once(none).chain(SCALES.map(|scale| (scale, -total))).collect()
}

/// Returns the mean product of residuals in neighbouring directions, less that due to the drift; 0 if it may
/// be due to chance. O(N log N).
fn remainder(run: &Run<'_>, found: &Calibration) -> f64 {
    let (off, scale) = left(run, found);
    let off: Vec<f64> =
        off.iter().map(|off| off.clamp(-LARGEST * scale, LARGEST * scale)).collect();
    let direction: Vec<f64> = run.azimuth.iter().map(|a| a.rem_euclid(TAU)).collect();
    let mut order: Vec<usize> = (0..off.len()).collect();
    order.sort_by(|i, j| direction[*i].total_cmp(&direction[*j]));
    let (mut sum, mut squares, mut drifts, mut count) = (0.0, 0.0, 0.0, 0.0);
    for (&i, &j) in order.iter().zip(order.iter().cycle().skip(1)) {
        let turn = (direction[j] - direction[i]).rem_euclid(TAU);
        if turn < NEIGHBOURS && i != j {
            sum += off[i] * off[j];
            squares += 0.5 * (off[i].powi(2) + off[j].powi(2));
            drifts += found.drift * (-(run.time[j] - run.time[i]).abs() / found.time).exp();
            count += 1.0;
        }
    }
    // a drift is known from as many independent values as there are correlation times
    let span = run.time[run.time.len() - 1] - run.time[0];
    let unknown = if drifts > 0.0 { drifts * (2.0 * found.time / span).sqrt() } else { 0.0 };
    let chance = SIGNIFICANT * (squares / f64::sqrt(count) + unknown);
    if sum - drifts > chance { (sum - drifts) / count } else { 0.0 }
}

/// `1, sin α, cos α, sin 2α, …`
fn terms(azimuth: f64, order: usize) -> DVector<f64> {
    let harmonics = (1..=order).flat_map(|k| {
        let (sine, cosine) = (k as f64 * azimuth).sin_cos();
        [sine, cosine]
    });
    DVector::from_iterator(1 + 2 * order, std::iter::once(1.0).chain(harmonics))
}

fn averaged(run: &Run<'_>, order: usize, weight: &[f64]) -> Calibration {
    let rows: Vec<DVector<f64>> = run.azimuth.iter().map(|a| terms(*a, order)).collect();
    let span = run.time[run.time.len() - 1] - run.time[0];
    let (mut points, mut filtered) = (Vec::new(), Vec::new());
    for (own, of_own) in of_coefficients(order) {
        for drift in std::iter::once(0.0).chain(SCALES) {
            let times = if drift == 0.0 || span == 0.0 { &TIMES[..1] } else { &TIMES[..] };
            let prior = if drift == 0.0 { NOTHING.ln() } else { -(times.len() as f64).ln() };
            if drift > 0.0 && span == 0.0 {
                continue;
            }
            for time in times.iter().map(|part| part * span) {
                let point = [own * run.sigma, drift * run.sigma, time];
                let mut own = filter(run, &rows, weight, point);
                own.value += prior + of_own;
                points.push(point);
                filtered.push(own);
            }
        }
    }
    let top = filtered.iter().map(|own| own.value).fold(f64::NEG_INFINITY, f64::max);
    let share: Vec<f64> = filtered.iter().map(|own| (own.value - top).exp()).collect();
    let total: f64 = share.iter().filter(|w| **w > UNLIKELY).sum();
    let size = 1 + 2 * order;
    let mut sum = Calibration {
        mean: DVector::zeros(size),
        covariance: DMatrix::zeros(size, size),
        drift: 0.0,
        time: 0.0,
        growth: 0.0,
        remainder: 0.0,
    };
    let likely: Vec<usize> = (0..share.len()).filter(|i| share[*i] > UNLIKELY).collect();
    for &i in &likely {
        let w = share[i] / total;
        let own = &filtered[i];
        sum.mean += &own.mean * w;
        let drift = w * own.growth * points[i][1].powi(2);
        sum.drift += drift;
        sum.time += drift * points[i][2];
        sum.growth += w * own.growth;
    }
    for &i in &likely {
        let own = &filtered[i];
        let off = &own.mean - &sum.mean;
        sum.covariance +=
            (&own.covariance * own.growth + &off * off.transpose()) * (share[i] / total);
    }
    sum.time = if sum.drift > 0.0 { sum.time / sum.drift } else { f64::INFINITY };
    sum
}

/// Estimates constant and coefficients, for given standard deviations of coefficients and drift and a given
/// correlation time, with the likelihood and the growth of the noise.
fn filter(
    run: &Run<'_>,
    rows: &[DVector<f64>],
    weight: &[f64],
    [coefficient, drift, time]: [f64; 3],
) -> Filtered {
    let size = rows[0].len();
    let n = size + 1;
    let largest = run.residual.iter().fold(run.sigma, |most, r| most.max(r.abs()));
    let mut mean = DVector::zeros(n);
    let mut covariance = DMatrix::zeros(n, n);
    covariance[(0, 0)] = (WIDE * largest).powi(2);
    for k in 1..size {
        covariance[(k, k)] = (coefficient / k.div_ceil(2) as f64).powi(2);
    }
    covariance[(size, size)] = drift * drift;
    let (mut squares, mut logarithms, mut count) = (0.0, 0.0, 0.0);
    let (mut h, mut last) = (DVector::zeros(n), run.time[0]);
    h[size] = 1.0;
    for (i, row) in rows.iter().enumerate().filter(|(i, _)| weight[*i] > 0.0) {
        poll();
        if drift > 0.0 {
            let rest = (-(run.time[i] - last) / time).exp();
            last = run.time[i];
            mean[size] *= rest;
            covariance.row_mut(size).scale_mut(rest);
            covariance.column_mut(size).scale_mut(rest);
            covariance[(size, size)] += (1.0 - rest * rest) * drift * drift;
        }
        h.rows_mut(0, size).copy_from(row);
        let gain = &covariance * &h;
        let variance = run.sigma * run.sigma / weight[i];
        let s = variance + h.dot(&gain);
        let innovation = run.residual[i] - h.dot(&mean);
        mean += &gain * (innovation / s);
        covariance -= &gain * gain.transpose() / s;
        squares += innovation * innovation / s;
        logarithms += (s / variance).ln();
        count += 1.0;
    }
    let growth: f64 = (squares / f64::max(count - 1.0, 1.0)).max(1.0);
    let value = -0.5 * (logarithms + count * growth.ln() + squares / growth);
    Filtered {
        mean: mean.rows(0, size).into_owned(),
        covariance: covariance.view((0, 0), (size, size)).into_owned(),
        value,
        growth,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A constant is found; its error is that of a mean, and a little more because of a possible drift.
    #[test]
    fn a_constant() {
        let time: Vec<f64> = (0..400).map(f64::from).collect();
        let noise = |i: usize| if i.is_multiple_of(2) { 0.5 } else { -0.5 };
        let residual: Vec<f64> = (0..400).map(|i| 3.0 + noise(i)).collect();
        let run = Run { time: &time, residual: &residual, azimuth: &vec![0.3; 400], sigma: 0.5 };
        let found = calibrate(&run, 0..=0);
        assert!((found.mean[0] - 3.0).abs() < 1e-3);
        let sigma = found.covariance[(0, 0)].sqrt();
        assert!((0.025..0.03).contains(&sigma), "{sigma}");
    }
}
