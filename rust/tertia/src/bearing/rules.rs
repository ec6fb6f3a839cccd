//! Methods of estimation and their parameters.

use crate::base::error::{Result, require, require_significance};
use crate::screening::{Direction, LeaveOneOutRule, Statistics};

/// Test of whether the variance d_j of a block is too large (M5).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum VarianceTest {
    /// Exact F test of each variance against the others at this significance level (with Bonferroni's
    /// correction for the number of blocks).
    Cochran(f64),
    /// `d_j > k2 (Σ 1/d_j)^-1` with this k2.
    Factor(f64),
    /// The same, with k2 the two-sided quantile of Student's distribution at this significance level:
    /// the paper prescribes this, and the documentation shows that it is impossible.
    Student(f64),
    /// No test.
    Off,
}

/// Method of estimation.
#[derive(Clone, Debug, PartialEq)]
pub enum Method {
    /// Mean of all measurements.
    Mean,
    /// Mean of the measurements that pass the k-sigma rule with this k.
    KSigma(f64),
    /// The algorithm of the paper as printed, except that misprints are corrected.
    Paper(PaperRule),
    /// The algorithm of the paper with exclusion instead of copying, exact tests and the correct sigma;
    /// the block means are tested at the given significance level.
    Corrected(PaperRule, f64),
    /// Mean over hypotheses: the record is clean, or has one-sided, wide or two-sided outliers, which
    /// are isolated or in bursts.
    Robust(RobustRule),
}

/// Parameters of the two methods of the paper.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PaperRule {
    /// Threshold k1 of the leave-one-out rule.
    pub k: f64,
    /// Number of measurements per block.
    pub block_size: usize,
    /// Test of the block variances.
    pub variance_test: VarianceTest,
}

/// Parameters of the robust method.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RobustRule {
    /// Number of measurements per block.
    pub block_size: usize,
    /// Step to which measurements were rounded; 0 if unknown.
    pub rounding: f64,
}

/// What is known about the measurements.
#[derive(Clone, Copy, Debug, Default)]
pub struct Known<'a> {
    /// Standard deviation of the random error of each measurement, for the robust method only; `None`
    /// if it is to be estimated from the scatter.
    pub sigma: Option<&'a [f64]>,
    /// Group of each measurement, from 0 on; measurements of a group share a systematic error. `None`
    /// if all measurements share it.
    pub groups: Option<&'a [f64]>,
    /// Standard deviation of the systematic errors; `None` if it is to be estimated from the
    /// differences between groups.
    pub bias_sigma: Option<f64>,
}

impl PaperRule {
    pub(super) fn validated(&self) -> Result<&Self> {
        match self.variance_test {
            VarianceTest::Cochran(significance) | VarianceTest::Student(significance) => {
                require_significance(significance)?;
            }
            VarianceTest::Factor(k2) => {
                let holds = k2 >= 1.0 && k2.is_finite();
                require("variance_test", k2, holds, "at least 1: d_j is never below (Σ 1/d_j)^-1")?;
            }
            VarianceTest::Off => {}
        }
        Ok(self)
    }

    /// Returns the leave-one-out rule with the threshold k1.
    pub(super) fn leave_one_out(&self, replace: bool) -> Result<LeaveOneOutRule> {
        LeaveOneOutRule::try_new(self.k, Statistics::Sequential, Direction::Forward, replace, 1)
    }
}
