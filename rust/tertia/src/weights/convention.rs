//! How well a sample covariance is known.

use crate::base::distribution::{normal_two_sided, student_two_sided_quantile, two_sigma};
use crate::base::error::{Result, require};

/// What two sigmas of a normal variable leave outside, as it is usually rounded.
const OUTSIDE_TWO_SIGMA: f64 = 0.0455;
/// From so many degrees of freedom on, Student's distribution is the normal one.
const NORMAL_FROM: f64 = 1e9;

/// How a covariance was estimated from n measurements.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Convention {
    /// Deviations from the sample mean, divisor n − 1.
    SampleMean,
    /// Deviations from the true mean, divisor n.
    KnownMean,
    /// Deviations from the true mean, divisor n − 1: as (3) to (5) are printed. Biased by n/(n − 1).
    Paper,
    /// First differences of a slowly moving target, `Σ dx dx^T / (2 (n − 1))`.
    Differences,
}

/// The Wishart law of a sample covariance, in units of the true one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Law {
    /// ν.
    pub degrees_of_freedom: f64,
    /// 1 for an unbiased estimate.
    pub mean: f64,
}

impl Law {
    /// The c of `cov(ŝ_ij, ŝ_ql) = c (s_iq s_jl + s_il s_jq)`, (4).
    pub fn factor(&self) -> f64 {
        self.mean * self.mean / self.degrees_of_freedom
    }

    /// The same of the estimate over its own mean.
    pub fn relative_factor(&self) -> f64 {
        1.0 / self.degrees_of_freedom
    }
}

impl Convention {
    /// The law of n measurements. For differences it is the Wishart law with the same covariance;
    /// the others are exact.
    ///
    /// # Errors
    /// n is not a whole number of at least 2, or infinite for a covariance that is known.
    pub fn wishart(self, n: f64) -> Result<Law> {
        let holds = n >= 2.0 && (n.fract() == 0.0 || n == f64::INFINITY);
        require("n", n, holds, "a whole number of at least 2, or inf where it is known exactly")?;
        let (degrees_of_freedom, mean) = match self {
            _ if n == f64::INFINITY => (n, 1.0),
            Self::SampleMean => (n - 1.0, 1.0),
            Self::KnownMean => (n, 1.0),
            Self::Paper => (n, n / (n - 1.0)),
            Self::Differences => ((n - 1.0) * (n - 1.0) / (1.5 * n - 2.0), 1.0),
        };
        Ok(Law { degrees_of_freedom, mean })
    }
}

/// What an estimated sigma is to be multiplied by for an interval of two of them to hold 95.45 %:
/// half of Student's quantile.
pub fn student_factor(degrees_of_freedom: f64) -> f64 {
    if degrees_of_freedom >= NORMAL_FROM {
        return 1.0;
    }
    0.5 * student_two_sided_quantile(OUTSIDE_TWO_SIGMA, degrees_of_freedom)
}

/// The same where the ratio of estimated and actual sigma has been simulated: two sigmas, so
/// multiplied, hold 95.45 % on average. Cost O(ratios).
pub fn simulated_factor(ratios: &[f64]) -> f64 {
    let outside = |h: f64| {
        ratios.iter().map(|ratio| normal_two_sided(h * ratio)).sum::<f64>() / ratios.len() as f64
    };
    two_sigma(outside, 2.0)
}

/// Fails unless the error of an estimate fused with estimated weights has a finite variance.
///
/// In more than one dimension the two least known sensors must have more than m + 1 degrees of
/// freedom together, and all sensors together must lack fewer than m − 1 of the m that each needs
/// to be regular: in every direction that is lacking a sensor seems to be exact.
///
/// # Errors
/// See above.
pub fn require_degrees_of_freedom(
    each: impl Iterator<Item = f64>,
    n: f64,
    dimension: usize,
) -> Result<()> {
    let m = dimension as f64;
    let (mut least, mut lacking) = ([f64::INFINITY; 2], 0.0);
    for nu in each {
        lacking += (m - nu).max(0.0);
        if nu < least[0] {
            least = [nu, least[0]];
        } else if nu < least[1] {
            least[1] = nu;
        }
    }
    let enough = least[0] + least[1] > m + 1.0 && (lacking == 0.0 || lacking < m - 1.0);
    let requirement = "larger: the sensors have too few degrees of freedom in so many dimensions, \
                       and the error of the weights has no finite variance";
    require("n", n, dimension == 1 || enough, requirement)
}

/// The least number of measurements, the same for all sensors, with which the loss is finite and
/// Wishart matrices can be drawn.
///
/// # Errors
/// There is none: never.
pub fn least_count(convention: Convention, sensors: usize, dimension: usize) -> Result<f64> {
    let mut n = 2.0;
    loop {
        let nu = convention.wishart(n)?.degrees_of_freedom;
        let drawable = nu.fract() == 0.0 || nu > dimension as f64 - 1.0;
        let each = std::iter::repeat_n(nu, sensors);
        if drawable && require_degrees_of_freedom(each, n, dimension).is_ok() {
            return Ok(n);
        }
        n += 1.0;
    }
}
