//! The estimator of Manoilov, Pysarchuk, Pavliuk 2006, as printed and corrected.

use super::groups::{GroupTable, group_range, student_factor};
use super::{GroupRule, VarianceTest, Workspace};
use crate::base::error::{Error, Result};
use crate::base::moments::Moments;
use crate::screening::thompson_tau;

/// Groups that a test among groups needs.
const MIN_GROUPS: usize = 3;

/// Stages 1 to 4 as printed: (value, sigma).
pub(super) fn as_printed(
    rule: &GroupRule,
    workspace: &mut Workspace,
    outlier: &mut [bool],
) -> Result<(f64, f64)> {
    let Workspace { angle, cleaned, scratch, groups, .. } = workspace;
    // 1: single anomalies
    rule.leave_one_out(true)?.screen(angle, outlier, cleaned, scratch)?;
    groups.fill(cleaned, rule.group_size, scratch)?;
    // 3.1: groups with an anomalous mean; their variances stay
    let mut flagged = vec![false; groups.len()];
    if groups.len() >= MIN_GROUPS {
        let means = groups.mean.clone();
        rule.leave_one_out(true)?.screen(&means, &mut flagged, &mut groups.mean, scratch)?;
    }
    // 3.2 (M5): groups with an anomalous variance become copies of the quietest
    let extreme = extreme_variances(rule, groups, &vec![true; groups.len()]);
    let donor = (0..groups.len())
        .fold(0, |best, j| if groups.variance[j] < groups.variance[best] { j } else { best });
    for j in (0..groups.len()).filter(|&j| extreme[j]) {
        groups.mean[j] = groups.mean[donor];
        groups.variance[j] = groups.variance[donor];
        flagged[j] = true;
    }
    // (M6): p_j = D / d_j with D = (Σ 1/d_j)^-1 of the corrected d; (M7): σ = √D
    let variance = groups.variance.clone();
    groups.set_weights(|j| 1.0 / variance[j]);
    let total: f64 = variance.iter().map(|d| 1.0 / d).sum();
    flag_members(&flagged, rule.group_size, outlier);
    Ok((groups.weighted_mean(), total.recip().sqrt()))
}

/// (M5) among the `used` groups.
fn extreme_variances(rule: &GroupRule, groups: &GroupTable, used: &[bool]) -> Vec<bool> {
    let total: f64 =
        groups.variance.iter().zip(used).filter(|(_, used)| **used).map(|(d, _)| 1.0 / d).sum();
    let is_extreme = |j: usize| match rule.variance_test {
        VarianceTest::Off => false,
        VarianceTest::Factor(k2) => groups.variance[j] > k2 / total,
        VarianceTest::Student(level) => {
            groups.variance[j] > student_factor(level, rule.group_size) / total
        }
        VarianceTest::Cochran(level) => groups.variance_is_extreme(j, |i| used[i], level),
    };
    (0..groups.len()).map(|j| used[j] && is_extreme(j)).collect()
}

/// Exclusion instead of copying, exact tests among groups, and the sigma that belongs to it:
/// `σ² = s² Σ p_j²/r_j`, s² pooled over the groups used, r_j their sizes.
pub(super) fn corrected(
    rule: &GroupRule,
    level: f64,
    workspace: &mut Workspace,
    outlier: &mut [bool],
) -> Result<(f64, f64)> {
    let Workspace { angle, cleaned, scratch, groups, .. } = workspace;
    rule.leave_one_out(false)?.screen(angle, outlier, cleaned, scratch)?;
    groups.fill(cleaned, rule.group_size, scratch)?;
    let measured: Vec<bool> = (0..groups.len()).map(|j| groups.degrees(j) > 0.0).collect();
    let mut used = measured.clone();
    reject_means(groups, level, &mut used)?;
    let extreme = extreme_variances(rule, groups, &used);
    for j in 0..groups.len() {
        used[j] &= !extreme[j];
    }
    if !used.contains(&true) {
        return Err(Error::NoGroupLeft { groups: groups.len() });
    }
    let (variance, count) = (groups.variance.clone(), groups.count.clone());
    groups.set_weights(|j| if used[j] { count[j] / variance[j] } else { 0.0 });
    let pooled = groups.pooled_variance(|j| used[j]);
    let spread: f64 = (0..groups.len())
        .filter(|&j| used[j])
        .map(|j| groups.weight[j] * groups.weight[j] / count[j])
        .sum();
    let rejected: Vec<bool> = used.iter().map(|&u| !u).collect();
    flag_members(&rejected, rule.group_size, outlier);
    Ok((groups.weighted_mean(), (pooled * spread).sqrt()))
}

/// Drops the groups whose mean is too far from the others' by Grubbs' test.
fn reject_means(groups: &GroupTable, level: f64, used: &mut [bool]) -> Result<()> {
    let members: Vec<usize> = (0..groups.len()).filter(|&j| used[j]).collect();
    if members.len() < MIN_GROUPS {
        return Ok(());
    }
    let means: Vec<f64> = members.iter().map(|&j| groups.mean[j]).collect();
    Moments::of("theta", &means)?;
    let (mut tau, mut p_value) = (vec![0.0; means.len()], vec![1.0; means.len()]);
    thompson_tau(&means, &mut tau, &mut p_value)?;
    for (&j, p) in members.iter().zip(p_value) {
        used[j] = p * means.len() as f64 >= level;
    }
    Ok(())
}

/// Marks every measurement of a flagged group.
fn flag_members(flagged: &[bool], size: usize, outlier: &mut [bool]) {
    let n = outlier.len();
    for j in (0..flagged.len()).filter(|&j| flagged[j]) {
        outlier[group_range(j, flagged.len(), size, n)].fill(true);
    }
}
