//! The variance of errors, from the medians of squared differences of successive measurements.

use serde::{Deserialize, Serialize};

/// Number of differences over which a variance is estimated, and number before which no estimate is returned
/// or used.
pub(in crate::tracker) const WINDOW: f64 = 4000.0;
pub(in crate::tracker) const ENOUGH: f64 = 40.0;
/// Median of a squared standard normal error, and the best step, up or down, of the logarithm of its
/// estimate.
const MEDIAN: f64 = 0.454_936_423_119_572_7;
const STEP: f64 = 2.33;
/// Variance of third differences of independent errors of variance 1.
pub(in crate::tracker) const THIRD: f64 = 20.0;
/// Standard deviation of the logarithm of the variance, times the root of the number of differences
/// (simulated, because differences share plots).
pub(in crate::tracker) const SPREAD: f64 = 2.7;
/// Number of sigmas by which a variance must exceed the stated one before it is used, and from which on it is used
/// whole, or by which it may be larger than estimated.
pub(in crate::tracker) const SURE: f64 = 2.0;
const WHOLE: f64 = 4.0;

/// The size of the errors in one direction, such as that along or across the beam.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Size {
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

    /// The part of a `ratio` of variances above 1 that this number of differences makes sure.
    pub fn sure(&self, ratio: f64) -> f64 {
        let excess = ratio.ln() * self.count.sqrt() / SPREAD;
        let part = (excess - SURE) / (WHOLE - SURE) * (WHOLE / excess);
        if excess > SURE { ratio.powf(part.min(1.0)) } else { 1.0 }
    }

    /// The largest ratio of variances that this number of differences leaves possible.
    pub fn most(&self, ratio: f64) -> f64 {
        ratio * (WHOLE * SPREAD / self.count.sqrt()).exp()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_within;

    #[test]
    fn a_larger_variance_is_used_as_far_as_it_is_sure() {
        let sure = |sigmas: f64| {
            let size = Size { count: 100.0, level: sigmas * SPREAD / 10.0 };
            size.sure(size.level.exp()).ln() / SPREAD * 10.0
        };
        assert_eq!([sure(-3.0), sure(1.9)], [0.0; 2]);
        for (sigmas, used) in [(2.5, 1.0), (3.0, 2.0), (4.0, 4.0), (6.0, 6.0)] {
            assert_within(1e-12, sure(sigmas), used);
        }
        assert_eq!(Size { count: 100.0, level: 0.0 }.sure(0.0), 1.0);
    }
}
