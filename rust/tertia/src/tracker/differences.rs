//! The variance of errors, from the medians of squared differences of successive measurements.

use serde::{Deserialize, Serialize};

/// Number of differences over which a variance is estimated, and number before which no estimate is returned
/// or used.
pub(super) const WINDOW: f64 = 4000.0;
pub(super) const ENOUGH: f64 = 100.0;
/// Median of a squared standard normal error, and the best step, up or down, of the logarithm of its
/// estimate.
const MEDIAN: f64 = 0.454_936_423_119_572_7;
const STEP: f64 = 2.33;
/// Variance of third differences of independent errors of variance 1.
pub(super) const THIRD: f64 = 20.0;
/// Standard deviation of the logarithm of the variance, times the root of the number of differences
/// (simulated, because differences share plots).
pub(super) const SPREAD: f64 = 2.7;
/// Number of sigmas by which a variance must exceed the stated one before it is used.
pub(super) const SURE: f64 = 2.0;

/// The size of the errors in one direction, such as that along or across the beam.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Size {
    pub count: f64,
    /// Logarithm of the variance relative to the stated one, as if errors were independent.
    pub level: f64,
}

impl Size {
    /// Updates the size by a third difference, relative to the stated sigma.
    pub fn saw(&mut self, third: f64) {
        self.count = (self.count + 1.0).min(WINDOW);
        // the first differences may be far off, so steps are limited
        let step = STEP / self.count.max(10.0);
        let median = THIRD * MEDIAN * self.level.exp();
        self.level += if third * third > median { step } else { -step };
    }
}
