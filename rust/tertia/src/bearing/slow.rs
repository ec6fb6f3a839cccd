//! Records whose level changes slowly because the direction finder drifts or the target moves.
//!
//! The level consists of straight lines between the middles of blocks, and the levels of the blocks are
//! an AR(1) process. Thus a drift is not mistaken for outliers, and sigma includes slow changes through
//! the differences of the blocks.

use super::blocks::block_range;
use super::start::{MAD_TO_SIGMA, OUTSIDE, rounding_sigma};
use crate::base::angle::median;
use crate::base::autoregression::Autoregression;
use crate::base::distribution::student_two_sided_quantile;
use crate::base::exponential::sum_of_logarithms;
use std::f64::consts::PI;

/// Shortest block length.
const SHORTEST: usize = 5;
/// Smallest number of blocks.
const FEWEST: usize = 6;
/// With more blocks than this, the levels may follow bursts.
const MANY: usize = 24;
/// Degrees of freedom of the errors about medians, which may include outliers.
const FREEDOM: f64 = 3.0;
/// Lines between the means of blocks reduce the variance of the errors by this share of the variance of
/// such a mean.
const LINES: f64 = 5.0 / 6.0;
/// Errors beyond this many sigmas may be outliers.
const NEAR: f64 = 3.0;
/// Smallest expected number of good measurements of a block whose level counts.
const LEAST_GOOD: f64 = 1.0;

/// Levels of the blocks of a record.
#[derive(Clone, Debug, Default)]
pub(super) struct Levels {
    /// Number of measurements of a block; the last block includes the remainder.
    size: usize,
    /// Level of each block; nan if the block has no good measurements.
    pub level: Vec<f64>,
    /// Weight of a good measurement of each block, by which each block counts according to its length.
    pub factor: Vec<f64>,
    /// Mean number of good measurements per block.
    pub good: f64,
}

impl Levels {
    pub fn block(&self, i: usize) -> usize {
        (i / self.size).min(self.level.len() - 1)
    }

    /// Returns the medians of blocks of this size. O(N).
    pub fn medians(y: &[f64], size: usize) -> Self {
        let blocks = y.len() / size;
        let middle = |j: usize| median(&mut y[block_range(j, blocks, size, y.len())].to_vec());
        let level: Vec<f64> = (0..blocks).map(middle).collect();
        Self { size, level, factor: vec![1.0; blocks], good: y.len() as f64 / blocks as f64 }
    }

    /// Returns the means of the good measurements of the same blocks; `good` is their probability.
    /// O(N).
    pub fn means(&self, y: &[f64], good: impl Fn(usize) -> f64) -> Self {
        let blocks = self.level.len();
        let mut found = Self { size: self.size, ..Self::default() };
        let mut total = 0.0;
        for j in 0..blocks {
            let members = block_range(j, blocks, self.size, y.len());
            let count = members.len() as f64;
            let of_block: f64 = members.clone().map(&good).sum();
            let sum: f64 = members.map(|i| good(i) * y[i]).sum();
            let counts = of_block >= LEAST_GOOD;
            found.level.push(if counts { sum / of_block } else { f64::NAN });
            found.factor.push(if counts { count / of_block } else { 0.0 });
            total += of_block;
        }
        found.good = total / blocks as f64;
        found
    }

    /// Computes the residuals of the measurements from straight lines between the levels at the middles
    /// of the blocks. They are enlarged to the size of the errors about the true level, because the
    /// lines leave only `1 − 5/(6 n)` of the variance with n measurements per block. O(N).
    pub fn residuals(&self, y: &[f64], fallback: &Self, residual: &mut Vec<f64>) {
        let blocks = self.level.len();
        let grown = (1.0 - LINES / self.good.max(2.0)).powf(-0.5);
        let level =
            |j: usize| if self.level[j].is_nan() { fallback.level[j] } else { self.level[j] };
        let middle = |j: usize| {
            let members = block_range(j, blocks, self.size, y.len());
            0.5 * (members.start + members.end - 1) as f64
        };
        residual.clear();
        residual.extend(y.iter().enumerate().map(|(i, y)| {
            let (j, at) = (self.block(i), i as f64);
            let k = if at < middle(j) { j.saturating_sub(1) } else { (j + 1).min(blocks - 1) };
            let share = if k == j { 0.0 } else { (at - middle(j)) / (middle(k) - middle(j)) };
            grown * (y - level(j) - share * (level(k) - level(j)))
        }));
    }

    /// Reads the levels that count. Returns their number, and the log of their evidence relative to
    /// levels that differ only by noise of this variance.
    pub fn read(&self, noise: f64, errors: &mut Autoregression) -> (f64, f64) {
        let noise = noise.max(f64::MIN_POSITIVE);
        let counting = || self.level.iter().enumerate().filter(|(_, l)| !l.is_nan());
        errors.read(counting().map(|(j, l)| (j, *l)), None);
        let count = counting().count() as f64;
        let ratio = (self.good * errors.variance() / noise).max(1.0);
        (count, errors.gain() - 0.5 * (count - 1.0) * ratio.ln())
    }
}

/// Returns the variance of the mean of the levels from their scatter, such that twice its square root
/// covers 95 %.
pub(super) fn variance_of_mean(errors: &Autoregression, count: f64) -> f64 {
    let student = 0.5 * student_two_sided_quantile(OUTSIDE, (count - 1.0).max(1.0));
    student * student * errors.variance() / count * errors.inflation()
}

/// Returns the block lengths with which the record is more likely than with a constant level, for
/// medians, errors with heavy tails and this penalty: the best one, and a long one whose medians do not
/// follow bursts. Unless the good measurements are `correlated`, only a long block length can
/// distinguish bursts from a changing level. `step` is the rounding step. O(N log N).
pub(super) fn block_sizes(
    y: &[f64],
    step: f64,
    penalty: f64,
    correlated: bool,
    errors: &mut Autoregression,
) -> Vec<usize> {
    let middle = median(&mut y.to_vec());
    let mut residual: Vec<f64> = y.iter().map(|v| v - middle).collect();
    let least = rounding_sigma(step).max(f64::MIN_POSITIVE);
    let constant = within(&residual, least, errors).0 + penalty;
    let (mut better, mut size): (Vec<(usize, f64)>, _) = (Vec::new(), SHORTEST);
    while y.len() / size >= FEWEST {
        let levels = Levels::medians(y, size);
        levels.residuals(y, &levels, &mut residual);
        let (likelihood, scale, phi) = within(&residual, least, errors);
        let noise = 0.5 * PI * scale * scale * inflation(phi, levels.good);
        better.push((size, likelihood + levels.read(noise, errors).1));
        size *= 2;
    }
    let long = better.last().map(|found| found.0);
    better.retain(|found| found.1 > constant);
    let few = |found: &(usize, f64)| y.len() / found.0 <= MANY;
    if better.is_empty() || !(correlated || better.iter().any(few)) {
        return Vec::new();
    }
    let best = better.into_iter().max_by(|a, b| a.1.total_cmp(&b.1)).map(|found| found.0);
    best.into_iter().chain(long.filter(|_| long != best)).collect()
}

/// Returns the log likelihood of errors with heavy tails, their scale, which is at least `least`, and
/// their correlation.
fn within(residual: &[f64], least: f64, errors: &mut Autoregression) -> (f64, f64, f64) {
    let mut terms: Vec<f64> = residual.iter().map(|r| r.abs()).collect();
    let scale = (MAD_TO_SIGMA * median(&mut terms)).max(least);
    for (term, r) in terms.iter_mut().zip(residual) {
        *term = 1.0 + (r / scale).powi(2) / FREEDOM;
    }
    let tails = 0.5 * (FREEDOM + 1.0) * sum_of_logarithms(&terms);
    let near = |i: &usize| residual[*i].abs() < NEAR * scale;
    errors.read((0..residual.len()).filter(near).map(|i| (i, residual[i])), None);
    let likelihood = errors.gain() - tails - residual.len() as f64 * scale.ln();
    (likelihood, scale, errors.correlation())
}

/// Returns the variance of the mean of n values of an AR(1) process relative to white noise; a negative
/// correlation counts as zero.
pub(super) fn inflation(phi: f64, n: f64) -> f64 {
    let phi = phi.max(0.0);
    (1.0 + phi) / (1.0 - phi) - 2.0 * phi * (1.0 - phi.powf(n)) / (n * (1.0 - phi).powi(2))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::{assert_close, assert_within};

    #[test]
    fn lines_between_the_middles_of_blocks_follow_a_slope() {
        let y: Vec<f64> = (0..40).map(f64::from).collect();
        let levels = Levels::medians(&y, 10);
        assert_eq!(levels.level, [4.5, 14.5, 24.5, 34.5]);
        let mut residual = Vec::new();
        levels.residuals(&y, &levels, &mut residual);
        assert!(residual[5..35].iter().all(|r| r.abs() < 1e-12));
    }

    #[test]
    fn every_block_counts_by_its_length() {
        let y = [1.0, 2.0, 9.0, 4.0, 5.0, 6.0, 7.0];
        let good = [1.0, 1.0, 0.0, 1.0, 1.0, 1.0, 1.0];
        let levels = Levels::medians(&y, 3).means(&y, |i| good[i]);
        assert_eq!(levels.level, [1.5, 5.5]);
        let weight = |i: usize| good[i] * levels.factor[levels.block(i)];
        assert_eq!((0..3).map(weight).sum::<f64>(), 3.0);
        assert_eq!((3..7).map(weight).sum::<f64>(), 4.0);
    }

    #[test]
    fn a_slope_moves_and_noise_about_a_level_does_not() {
        let noise = |i: usize| [0.3, -0.8, 1.1, -0.2, -1.3, 0.9, 0.4, -0.4][i * 5 % 8];
        let (level, slope): (Vec<f64>, Vec<f64>) =
            (0..120).map(|i| (noise(i), noise(i) + 0.05 * i as f64)).unzip();
        let errors = &mut Autoregression::default();
        assert!(block_sizes(&level, 0.0, 6.0, false, errors).is_empty());
        assert!(!block_sizes(&slope, 0.0, 6.0, false, errors).is_empty());
    }

    /// 1 + 2 Σ (1 − k/n) φ^k over k < n.
    #[test]
    fn inflation_is_the_sum_of_the_correlations() {
        let sum = (1..7).map(|k| (1.0 - f64::from(k) / 7.0) * 0.6_f64.powi(k)).sum::<f64>();
        assert_within(1e-12, inflation(0.6, 7.0), 1.0 + 2.0 * sum);
        assert_close(inflation(-0.5, 7.0), 1.0);
    }
}
