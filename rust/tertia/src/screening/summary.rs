//! Summary of a cleaned sample.

use crate::base::moments::Moments;

/// Mean and variance of a cleaned sample, and the threshold that was applied.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Summary {
    /// Mean of the cleaned sample.
    pub mean: f64,
    /// Variance of the cleaned sample, divisor n − 1.
    pub variance: f64,
    /// Half width of the band about the mean outside which a measurement is an outlier.
    pub threshold: f64,
}

impl Summary {
    pub(super) fn of_moments(moments: &Moments, threshold: f64) -> Self {
        Self { mean: moments.mean(), variance: moments.variance(), threshold }
    }
}
