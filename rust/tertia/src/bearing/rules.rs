//! How a bearing is estimated.

use crate::base::error::{Result, require, require_significance};
use crate::screening::{Direction, LeaveOneOutRule, Statistics};

/// When the variance d_j of a block is too large (M5).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum VarianceTest {
    /// Exact F test of each variance against the others at this significance (Bonferroni over the
    /// blocks).
    Cochran(f64),
    /// `d_j > k2 (Σ 1/d_j)^-1` with this k2.
    Factor(f64),
    /// The same with the two-sided Student quantile at this significance: what the paper prescribes,
    /// and the documentation shows to be impossible.
    Student(f64),
    /// Never.
    Off,
}

/// Method of estimation.
#[derive(Clone, Debug, PartialEq)]
pub enum Method {
    /// Mean of all measurements.
    Mean,
    /// Mean of the measurements that pass the k-sigma rule with this k.
    KSigma(f64),
    /// The paper's algorithm as printed, misprints mended.
    Paper(PaperRule),
    /// The same with exclusion instead of copying, exact tests and the right sigma; the means of
    /// blocks are tested at the given significance.
    Corrected(PaperRule, f64),
    /// Mean over the hypotheses clean, one-sided, two-sided, with outliers that are isolated or in
    /// bursts.
    Robust(RobustRule),
}

/// Parameters of the two methods of the paper.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PaperRule {
    /// Threshold k1 of the leave-one-out rule.
    pub k: f64,
    /// Measurements per block.
    pub block_size: usize,
    /// Rule for the blocks' variances.
    pub variance_test: VarianceTest,
}

/// Parameters of the robust method.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RobustRule {
    /// Measurements per block.
    pub block_size: usize,
    /// Step to which measurements were rounded; 0: unknown.
    pub rounding: f64,
}

/// What is known of measurements.
#[derive(Clone, Copy, Debug, Default)]
pub struct Known<'a> {
    /// Standard deviation of the random error of each measurement, for the robust method only. None:
    /// found from the scatter.
    pub sigma: Option<&'a [f64]>,
    /// Group of each measurement, from 0 on: those of a group share a systematic error. None: all
    /// do.
    pub groups: Option<&'a [f64]>,
    /// Standard deviation of the systematic errors; none: found from the differences of groups.
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

    /// The leave-one-out rule with k1.
    pub(super) fn leave_one_out(&self, replace: bool) -> Result<LeaveOneOutRule> {
        LeaveOneOutRule::try_new(self.k, Statistics::Sequential, Direction::Forward, replace, 1)
    }
}
