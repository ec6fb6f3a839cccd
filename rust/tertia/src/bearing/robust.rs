//! The default estimator: the mean over all hypotheses about the record.

use super::blocks::BlockTable;
use super::estimate::Estimate;
use super::hypotheses::MAX_SCORE;
use super::rules::RobustRule;
use super::start::{OUTSIDE, rounding_sigma, start};
use super::workspace::Workspace;
use crate::base::distribution::{fisher_upper, fisher_upper_quantile, student_two_sided_quantile};
use crate::base::error::Result;
use crate::base::moments::Moments;
use crate::base::scratch::refill;
use std::f64::consts::PI;

/// Smallest number of measurements.
pub(super) const MIN_COUNT: usize = 5;
/// Significance level at which a disagreement of the blocks increases sigma.
pub(super) const SIGNIFICANCE: f64 = 0.05;
/// Weight of a block, relative to the mean weight, above which it counts in that test.
const LEAST_BLOCK: f64 = 0.1;

/// Estimates `θ = Σ w_m μ_m` over the hypotheses, with the variance `Σ v_m (σ_m² + (μ_m − θ)²)`. The
/// caller computes the polarity.
pub(super) fn estimate(
    rule: &RobustRule,
    correlation: Option<f64>,
    workspace: &mut Workspace,
    outlier: &mut [bool],
) -> Result<Estimate> {
    let Workspace { angle, cleaned, scratch, blocks, hypotheses } = workspace;
    Moments::of("theta", angle)?;
    let Some(start) = start(angle, rule.rounding, scratch) else {
        return Ok(stuck(rule, angle, outlier, blocks));
    };
    hypotheses.read(angle, &start);
    hypotheses.fit(start.step / start.scale, correlation, true);
    let value = hypotheses.mean(|h| h.value);
    let good = hypotheses.mean(|h| h.good);
    let student = 0.5 * student_two_sided_quantile(OUTSIDE, good - 1.0);
    let within = student * student * hypotheses.mean_of_variance(|h| h.variance * h.inflation);
    let between = hypotheses.mean_of_variance(|h| (h.value - value).powi(2));
    let width = start.scale * hypotheses.mean(|h| h.width);
    let mut variance = start.scale * start.scale * (within + between);
    // weight of each measurement in the estimate: value = Σ influence y
    let influence = scratch;
    refill(influence, angle.len(), 0.0);
    for h in &hypotheses.list {
        for (sum, share) in influence.iter_mut().zip(&h.influence) {
            *sum += h.weight * share;
        }
    }
    for (i, flag) in outlier.iter_mut().enumerate() {
        *flag = hypotheses.mean(|h| h.is_good(i)) < 0.5;
    }
    // the values as used in the estimate: the farthest ones are limited
    for ((c, &y), &z) in cleaned.iter_mut().zip(&*angle).zip(&hypotheses.score) {
        *c = if z.abs() < MAX_SCORE { y } else { start.centre + start.scale * z };
    }
    blocks.fill_weighted(cleaned, influence, outlier, rule.block_size);
    let square =
        |i: usize| hypotheses.mean(|h| h.is_good(i)) * (hypotheses.score[i] - value).powi(2);
    let squares: f64 = (0..angle.len()).map(square).sum();
    let spread = start.scale * (squares / good).sqrt();
    let value = start.centre + start.scale * value;
    let pvalue = agreement(blocks, value, start.scale * start.scale * within, good, &mut variance);
    let rest = rounding_sigma(start.step) * rest_of_rounding(spread, start.step);
    variance += rest * rest;
    Ok(Estimate {
        value,
        sigma: variance.sqrt(),
        polarity: 0.0,
        pvalue,
        correlation: correlation.unwrap_or_else(|| hypotheses.mean(|h| h.correlation)),
        effective_number: width * width / variance,
        bias_sigma: f64::NAN,
        noise_factor: f64::NAN,
    })
}

/// Returns the share of the rounding error that remains in the mean of readings with this standard
/// deviation: the first harmonic, `exp(−2 π² (s²/q² − 1/12))` with the step q.
pub(super) fn rest_of_rounding(spread: f64, step: f64) -> f64 {
    if step > 0.0 {
        (-2.0 * PI * PI * ((spread / step).powi(2) - 1.0 / 12.0).max(0.0)).exp()
    } else {
        0.0
    }
}

/// Returns the estimate if all readings are equal: only the rounding step shows how large the error may
/// be.
fn stuck(
    rule: &RobustRule,
    angle: &[f64],
    outlier: &mut [bool],
    blocks: &mut BlockTable,
) -> Estimate {
    outlier.fill(false);
    let n = angle.len();
    blocks.fill_weighted(angle, &vec![1.0 / n as f64; n], outlier, rule.block_size);
    let known = rule.rounding > 0.0;
    Estimate {
        value: angle[0],
        sigma: if known { rounding_sigma(rule.rounding) } else { f64::INFINITY },
        polarity: 0.0,
        pvalue: f64::NAN,
        correlation: f64::NAN,
        effective_number: if known { 1.0 } else { 0.0 },
        bias_sigma: f64::NAN,
        noise_factor: f64::NAN,
    }
}

/// Returns the p-value of the agreement of the block means, `F = Q/(L−1)`, `Q = Σ W_j (m_j − θ)²/σ²`,
/// with weights W_j that sum to one and the variance σ² of θ. If F exceeds its upper 5 % point F₀, the
/// variance is multiplied by F/F₀. The p-value is nan if there are fewer than two blocks.
fn agreement(blocks: &BlockTable, value: f64, within: f64, good: f64, variance: &mut f64) -> f64 {
    let least = LEAST_BLOCK / blocks.len() as f64;
    let counting = || (0..blocks.len()).filter(|&j| blocks.weight[j] > least);
    let degrees = counting().count() as f64 - 1.0;
    if degrees < 1.0 {
        return f64::NAN;
    }
    let term = |j: usize| blocks.weight[j] * (blocks.mean[j] - value).powi(2);
    let f = counting().map(term).sum::<f64>() / within / degrees;
    let pvalue = fisher_upper(f, degrees, good - 1.0);
    if pvalue < SIGNIFICANCE {
        *variance *= f / fisher_upper_quantile(SIGNIFICANCE, degrees, good - 1.0);
    }
    pvalue
}

impl BlockTable {
    /// Fills the table with blocks of measurements whose weights sum to one. Counts and variances are
    /// those of the measurements that are not outliers.
    pub(super) fn fill_weighted(
        &mut self,
        y: &[f64],
        weight: &[f64],
        outlier: &[bool],
        block_size: usize,
    ) {
        for members in self.begin(y.len(), block_size) {
            let total: f64 = weight[members.clone()].iter().sum();
            let origin = y[members.start];
            let term = |i: usize| weight[i] * (y[i] - origin);
            let mean = origin + members.clone().map(term).sum::<f64>() / total;
            let kept = || members.clone().filter(|&i| !outlier[i]);
            let count = kept().count() as f64;
            let centre = kept().map(|i| y[i] - origin).sum::<f64>() / count;
            let squares: f64 = kept().map(|i| (y[i] - origin - centre).powi(2)).sum();
            self.mean.push(if total > 0.0 { mean } else { f64::NAN });
            self.variance.push(if count > 1.0 { squares / (count - 1.0) } else { f64::NAN });
            self.count.push(count);
            self.weight.push(total);
        }
        let total: f64 = self.weight.iter().sum();
        self.weight.iter_mut().for_each(|w| *w /= total);
    }
}
