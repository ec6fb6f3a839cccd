//! The default estimator: the mean of good measurements in blocks weighted by moderated variances.

use super::blocks::BlockTable;
use super::rules::RobustRule;
use super::workspace::Workspace;
use crate::base::distribution::{digamma, trigamma, trigamma_inverse};
use crate::base::error::Result;

/// Fewest measurements.
pub(super) const MIN_COUNT: usize = 5;

/// Detection, then `θ = Σ w m / Σ w` with `w = r/d~` over blocks: (value, sigma).
///
/// `σ = max(1, √(Q/(L'−1))) / √Σw` with `Q = Σ w (m − θ)²`: if the blocks differ by more than their
/// noise, sigma grows accordingly.
pub(super) fn estimate(
    rule: &RobustRule,
    workspace: &mut Workspace,
    outlier: &mut [bool],
) -> Result<(f64, f64)> {
    let Workspace { angle, cleaned, scratch, blocks, bursts } = workspace;
    let summary = rule.bursts.screen(angle, outlier, cleaned, bursts)?;
    blocks.fill(cleaned, rule.block_size, scratch)?;
    let floor = bursts.rounding_sigma();
    if summary.variance == 0.0 {
        let count = blocks.count.clone();
        blocks.set_weights(|j| count[j]);
        let step = nearest_difference(angle, summary.mean);
        return Ok((summary.mean, floor.max(step / 12_f64.sqrt())));
    }
    let overall = summary.variance.max(floor * floor);
    // rounding that is coarse relative to the noise: a block's variance depends on its mean
    let coarse = bursts.step().powi(2) > summary.variance;
    let variance =
        if coarse { vec![overall; blocks.len()] } else { moderated(blocks, floor, overall) };
    let information: Vec<f64> = blocks.count.iter().zip(variance).map(|(r, d)| r / d).collect();
    blocks.set_weights(|j| information[j]);
    let value = blocks.weighted_mean();
    let filled: Vec<usize> = (0..blocks.len()).filter(|&j| blocks.count[j] > 0.0).collect();
    let term = |&j: &usize| information[j] * (blocks.mean[j] - value).powi(2);
    let q = filled.iter().map(term).sum::<f64>() / (filled.len() as f64 - 1.0).max(1.0);
    let total: f64 = information.iter().sum();
    Ok((value, q.max(1.0).sqrt() / total.sqrt()))
}

/// Distance of the nearest measurement that differs from the only value kept, zero if there is none:
/// an upper bound of the rounding step.
fn nearest_difference(angle: &[f64], kept: f64) -> f64 {
    let distances = angle.iter().map(|v| (v - kept).abs()).filter(|&d| d > 0.0);
    let nearest = distances.fold(f64::INFINITY, f64::min);
    if nearest.is_finite() { nearest } else { 0.0 }
}

/// Variances shrunk towards their common value (Smyth 2004): the spread of `ln d_j` in excess of that
/// of chi-square noise is their true spread.
///
/// `e_j = ln d_j − ψ(ν_j/2) + ln(ν_j/2)`, `ψ'(ν0/2) = var(e) − mean ψ'(ν_j/2)`,
/// `s0² = exp(mean e + ψ(ν0/2) − ln(ν0/2))`, `d~ = (ν0 s0² + ν d)/(ν0 + ν)`; pooled where the
/// right-hand side is not positive. Nowhere below `floor²`; `overall` where every block is constant.
fn moderated(blocks: &BlockTable, floor: f64, overall: f64) -> Vec<f64> {
    let degrees = |j: usize| blocks.degrees(j);
    let estimated: Vec<usize> =
        (0..blocks.len()).filter(|&j| degrees(j) > 0.0 && blocks.variance[j] > 0.0).collect();
    let within = blocks.pooled_variance(|_| true);
    let least = floor * floor;
    let pooled = if within > 0.0 { within.max(least) } else { overall };
    let count = estimated.len() as f64;
    let log_variance = |j: usize| {
        let half = 0.5 * degrees(j);
        blocks.variance[j].ln() - digamma(half) + half.ln()
    };
    let mean = |f: &dyn Fn(usize) -> f64| estimated.iter().map(|&j| f(j)).sum::<f64>() / count;
    let centre = mean(&log_variance);
    let spread = mean(&|j| (log_variance(j) - centre).powi(2)) * count / (count - 1.0);
    let excess = spread - mean(&|j| trigamma(0.5 * degrees(j)));
    if count < 2.0 || excess <= 0.0 {
        return vec![pooled; blocks.len()];
    }
    let half = trigamma_inverse(excess);
    let prior = (centre + digamma(half) - half.ln()).exp();
    let nu0 = 2.0 * half;
    let posterior = |j: usize| match degrees(j) {
        0.0 => prior,
        nu => (nu0 * prior + nu * blocks.variance[j]) / (nu0 + nu),
    };
    (0..blocks.len()).map(|j| posterior(j).max(least)).collect()
}
