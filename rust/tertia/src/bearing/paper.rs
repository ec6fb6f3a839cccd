//! The estimator of Manoilov, Pysarchuk, Pavliuk 2006, as printed and corrected.

use super::blocks::{BlockTable, block_range, student_factor};
use super::rules::{PaperRule, VarianceTest};
use super::workspace::Workspace;
use crate::base::error::{Error, Result};
use crate::base::moments::Moments;
use crate::screening::thompson_tau;

/// Smallest number of blocks for a test among blocks.
const MIN_BLOCKS: usize = 3;

/// Runs stages 1 to 4 as printed; returns value and sigma.
pub(super) fn as_printed(
    rule: &PaperRule,
    workspace: &mut Workspace,
    outlier: &mut [bool],
) -> Result<(f64, f64)> {
    let Workspace { angle, cleaned, scratch, blocks, .. } = workspace;
    // 1: single outliers
    rule.leave_one_out(true)?.screen(angle, outlier, cleaned, scratch)?;
    blocks.fill(cleaned, rule.block_size, scratch)?;
    // 3.1: blocks with an outlying mean; their variances are kept
    let mut flagged = vec![false; blocks.len()];
    if blocks.len() >= MIN_BLOCKS {
        let means = blocks.mean.clone();
        rule.leave_one_out(true)?.screen(&means, &mut flagged, &mut blocks.mean, scratch)?;
    }
    // 3.2 (M5): blocks with too large a variance become copies of the block with the smallest variance
    let extreme = extreme_variances(rule, blocks, &vec![true; blocks.len()]);
    let donor = (0..blocks.len())
        .fold(0, |best, j| if blocks.variance[j] < blocks.variance[best] { j } else { best });
    for j in (0..blocks.len()).filter(|&j| extreme[j]) {
        blocks.mean[j] = blocks.mean[donor];
        blocks.variance[j] = blocks.variance[donor];
        flagged[j] = true;
    }
    // (M6): p_j = D / d_j with D = (Σ 1/d_j)^-1 of the corrected d; (M7): σ = √D
    let variance = blocks.variance.clone();
    blocks.set_weights(|j| 1.0 / variance[j]);
    let total: f64 = variance.iter().map(|d| 1.0 / d).sum();
    flag_members(&flagged, rule.block_size, outlier);
    Ok((blocks.weighted_mean(), total.recip().sqrt()))
}

/// Returns which of the `used` blocks have too large a variance by (M5).
fn extreme_variances(rule: &PaperRule, blocks: &BlockTable, used: &[bool]) -> Vec<bool> {
    let total: f64 =
        blocks.variance.iter().zip(used).filter(|(_, used)| **used).map(|(d, _)| 1.0 / d).sum();
    let exceeds = |k2: f64| {
        let pairs = blocks.variance.iter().zip(used);
        pairs.map(|(d, used)| *used && *d > k2 / total).collect()
    };
    match rule.variance_test {
        VarianceTest::Off => vec![false; blocks.len()],
        VarianceTest::Factor(k2) => exceeds(k2),
        VarianceTest::Student(significance) => {
            exceeds(student_factor(significance, rule.block_size))
        }
        VarianceTest::Cochran(significance) => blocks.extreme_variances(used, significance),
    }
}

/// Runs the corrected algorithm: blocks are excluded instead of copied, the tests among blocks are
/// exact, and sigma is that of the weighted mean, `σ² = s² Σ p_j²/r_j`, with s² pooled over the blocks
/// that are used and their sizes r_j.
pub(super) fn corrected(
    rule: &PaperRule,
    significance: f64,
    workspace: &mut Workspace,
    outlier: &mut [bool],
) -> Result<(f64, f64)> {
    let Workspace { angle, cleaned, scratch, blocks, .. } = workspace;
    rule.leave_one_out(false)?.screen(angle, outlier, cleaned, scratch)?;
    blocks.fill(cleaned, rule.block_size, scratch)?;
    let mut used: Vec<bool> = (0..blocks.len()).map(|j| blocks.degrees(j) > 0.0).collect();
    reject_means(blocks, significance, &mut used)?;
    let extreme = extreme_variances(rule, blocks, &used);
    for j in 0..blocks.len() {
        used[j] &= !extreme[j];
    }
    if !used.contains(&true) {
        return Err(Error::NoBlockLeft { blocks: blocks.len() });
    }
    let (variance, count) = (blocks.variance.clone(), blocks.count.clone());
    blocks.set_weights(|j| if used[j] { count[j] / variance[j] } else { 0.0 });
    let pooled = blocks.pooled_variance(|j| used[j]);
    let spread: f64 = (0..blocks.len())
        .filter(|&j| used[j])
        .map(|j| blocks.weight[j] * blocks.weight[j] / count[j])
        .sum();
    let rejected: Vec<bool> = used.iter().map(|&u| !u).collect();
    flag_members(&rejected, rule.block_size, outlier);
    Ok((blocks.weighted_mean(), (pooled * spread).sqrt()))
}

/// Excludes the blocks whose mean deviates too much from the others by Grubbs' test.
fn reject_means(blocks: &BlockTable, significance: f64, used: &mut [bool]) -> Result<()> {
    let members: Vec<usize> = (0..blocks.len()).filter(|&j| used[j]).collect();
    if members.len() < MIN_BLOCKS {
        return Ok(());
    }
    let means: Vec<f64> = members.iter().map(|&j| blocks.mean[j]).collect();
    Moments::of("theta", &means)?;
    let (mut tau, mut pvalue) = (vec![0.0; means.len()], vec![1.0; means.len()]);
    thompson_tau(&means, &mut tau, &mut pvalue)?;
    for (&j, p) in members.iter().zip(pvalue) {
        used[j] = p * means.len() as f64 >= significance;
    }
    Ok(())
}

/// Marks all measurements of the flagged blocks as outliers.
fn flag_members(flagged: &[bool], size: usize, outlier: &mut [bool]) {
    let n = outlier.len();
    for j in (0..flagged.len()).filter(|&j| flagged[j]) {
        outlier[block_range(j, flagged.len(), size, n)].fill(true);
    }
}
