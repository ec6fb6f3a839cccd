//! Angles: wrapping, and unwrapping about the circular median.

use crate::base::error::{Result, require, require_count, require_each, require_finite};
use std::f64::consts::TAU;

/// Largest angle, in periods; larger angles are rounded by more than 1e-7 periods.
const MAX_PERIODS: f64 = 1e9;

/// Adds whole periods to `theta` until it is within half a period of `reference`. A value that is already
/// within half a period is returned bit for bit.
#[inline]
pub(crate) fn nearest(theta: f64, reference: f64, period: f64) -> f64 {
    theta - period * ((theta - reference) / period).round()
}

/// Returns the equivalent of `theta` in [0, period).
#[inline]
pub(crate) fn principal(theta: f64, period: f64) -> f64 {
    let angle = theta.rem_euclid(period);
    // rounded up from just below zero; nan remains nan
    if angle >= period { 0.0 } else { angle }
}

/// Median; for an even number of values, the mean of the two middle ones. O(N); `values` is
/// reordered.
pub(crate) fn median(values: &mut [f64]) -> f64 {
    let n = values.len();
    let (lower, &mut upper, _) = values.select_nth_unstable_by(n / 2, f64::total_cmp);
    if n % 2 == 1 {
        return upper;
    }
    let below = lower.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    below + 0.5 * (upper - below)
}

/// Median; for an even number of values, the larger of the two middle ones. O(N); `values` is reordered.
pub(crate) fn upper_median(values: &mut [f64]) -> f64 {
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// Returns an error unless sums of whole periods remain finite.
///
/// # Errors
/// A period that is not positive, or is above 1e100.
pub fn require_period(period: f64) -> Result<()> {
    let holds = period > 0.0 && period <= 1e100;
    require("period", period, holds, "a positive number, not above 1e100")
}

/// Returns an error for the first angle that is too large to be wrapped; nan is accepted.
pub(crate) fn require_angles(argument: &'static str, theta: &[f64], period: f64) -> Result<()> {
    let holds = |angle: f64| angle.is_nan() || angle.abs() <= MAX_PERIODS * period;
    require_each(argument, theta, holds, "every angle must be within 1e9 periods of zero")
}

/// Unwraps angles about their circular mean, then about the median of the result, so that all are
/// within half a period of the circular median. The number of whole periods is that of the first angle. O(N).
///
/// # Errors
/// An empty sample, an angle that is not finite, or a period that is not positive.
///
/// # Panics
/// If the slices differ in length.
pub fn unwrap_about_median(
    theta: &[f64],
    period: f64,
    unwrapped: &mut [f64],
    scratch: &mut Vec<f64>,
) -> Result<()> {
    require_period(period)?;
    require_count("theta", theta.len(), 1)?;
    require_finite("theta", theta)?;
    require_angles("theta", theta, period)?;
    let (sine, cosine) = theta.iter().fold((0.0, 0.0), |(s, c), &angle| {
        let (sin, cos) = (angle / period * TAU).sin_cos();
        (s + sin, c + cos)
    });
    let mean = nearest(sine.atan2(cosine) / TAU * period, theta[0], period);
    scratch.clear();
    scratch.extend(theta.iter().map(|&angle| nearest(angle, mean, period)));
    let centre = median(scratch);
    for (u, &angle) in unwrapped.iter_mut().zip(theta) {
        *u = nearest(angle, centre, period);
    }
    Ok(())
}
