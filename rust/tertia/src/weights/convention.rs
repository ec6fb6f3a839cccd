//! Uncertainty of a sample covariance.

use crate::base::distribution::{
    OUTSIDE_TWO_SIGMA, normal_two_sided, student_two_sided_quantile, two_sigma,
};
use crate::base::error::{Result, require};

/// From this number of degrees of freedom on, Student's distribution is treated as normal.
const NORMAL_FROM: f64 = 1e9;

/// Estimator of a covariance from n measurements.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Convention {
    /// Deviations from the sample mean, divisor n − 1.
    SampleMean,
    /// Deviations from the true mean, divisor n.
    KnownMean,
    /// Deviations from the true mean, divisor n − 1, as (3) to (5) are printed. Biased by n/(n − 1).
    Paper,
    /// First differences of a slowly moving target, `Σ dx dx^T / (2 (n − 1))`.
    Differences,
}

/// The Wishart distribution of a sample covariance, relative to the true covariance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Law {
    /// Degrees of freedom ν.
    pub degrees_of_freedom: f64,
    /// Mean; 1 for an unbiased estimate.
    pub mean: f64,
}

impl Law {
    /// Returns the c of `cov(ŝ_ij, ŝ_ql) = c (s_iq s_jl + s_il s_jq)`, (4).
    pub fn factor(&self) -> f64 {
        self.mean * self.mean / self.degrees_of_freedom
    }

    /// Returns the c of the estimate divided by its own mean.
    pub fn relative_factor(&self) -> f64 {
        1.0 / self.degrees_of_freedom
    }
}

impl Convention {
    /// Returns the distribution for n measurements. For differences, it is the Wishart distribution with the
    /// same covariance; for the other conventions it is exact.
    ///
    /// # Errors
    /// If n is not a whole number of at least 2. It may be infinite for a known covariance.
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

/// Factor by which an estimated sigma must be multiplied so that an interval of two sigmas contains
/// 95.45 %: half of Student's quantile.
pub fn student_factor(degrees_of_freedom: f64) -> f64 {
    if degrees_of_freedom >= NORMAL_FROM {
        return 1.0;
    }
    0.5 * student_two_sided_quantile(OUTSIDE_TWO_SIGMA, degrees_of_freedom)
}

/// [`student_factor`] from simulated ratios of estimated to actual sigma: with this factor, two sigmas
/// contain 95.45 % on average. Cost O(ratios).
pub fn simulated_factor(ratios: &[f64]) -> f64 {
    let outside = |h: f64| {
        ratios.iter().map(|ratio| normal_two_sided(h * ratio)).sum::<f64>() / ratios.len() as f64
    };
    two_sigma(outside, 2.0)
}

/// Returns an error unless the error of an estimate fused with estimated weights has a finite variance.
///
/// In more than one dimension, the two least known sensors must together have more than m + 1 degrees of
/// freedom. Each sensor needs m to be regular; all sensors together must lack fewer than m − 1, because
/// in every direction that is lacking a sensor seems to be exact.
///
/// # Errors
/// Too few degrees of freedom, as described above.
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

/// Returns the smallest number of measurements, equal for all sensors, for which the loss is finite and
/// Wishart matrices can be drawn.
///
/// # Errors
/// Never.
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
