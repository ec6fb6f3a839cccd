//! Bounds of normalised squared errors.

use crate::base::distribution::chi_square_upper_quantile;
use crate::base::error::{Result, require};

/// Largest number of degrees of freedom: with more, the computation of tails takes seconds.
const MAX_DEGREES_OF_FREEDOM: usize = 100_000_000;

/// Returns the bounds within which the mean of `count` normalised squared errors of `dimension`
/// components lies with this probability if their covariances are right.
///
/// # Errors
/// If the probability is not between 0 and 1, or there are no errors or too many.
pub fn consistency_bounds(probability: f64, count: usize, dimension: usize) -> Result<[f64; 2]> {
    let holds = probability > 0.0 && probability < 1.0;
    require("probability", probability, holds, "between 0 and 1 (exclusive)")?;
    let nu = count.saturating_mul(dimension);
    let requirement = "such that count times dimension is between 1 and 1e8";
    require("count", count as f64, (1..=MAX_DEGREES_OF_FREEDOM).contains(&nu), requirement)?;
    let outside = 0.5 * (1.0 - probability);
    let bound = |p: f64| chi_square_upper_quantile(p, nu) / count as f64;
    Ok([bound(1.0 - outside), bound(outside)])
}
