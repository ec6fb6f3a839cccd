//! Screening: which measurements of a sample are anomalous.
//!
//! Sources: Manoilov, Pysarchuk, Pavliuk 2006, equations (M1)–(M4); Motylev 2010, (R1)–(R3);
//! Fisch, Eckley, Fearnhead 2022 for points and bursts.

mod bursts;
mod hypothesis;
mod k_sigma;
mod leave_one_out;

pub use bursts::{BurstRule, BurstWorkspace};
pub(crate) use hypothesis::extreme_variance_pvalue;
pub use hypothesis::{
    OutlierTest, Test, cochran, critical_value, false_alarm_probability, grubbs, t_test,
    thompson_tau, z_test,
};
pub use k_sigma::{KSigmaRule, Replacement};
pub use leave_one_out::{Direction, LeaveOneOutRule, Statistics, mask, statistics};

pub use crate::base::angle::unwrap_about_median;

use crate::base::error::{Error, Result};
use crate::base::moments::Moments;

/// A value with a larger share of the sum of squares is not downdated but left out anew.
const MAX_SHARE: f64 = 0.5;

/// The cleaned sample in numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Summary {
    /// Mean of the cleaned sample.
    pub mean: f64,
    /// Variance of the cleaned sample, divisor n − 1.
    pub variance: f64,
    /// Half width of the band about the mean outside which a measurement is anomalous.
    pub threshold: f64,
}

impl Summary {
    fn of_moments(moments: &Moments, threshold: f64) -> Self {
        Self { mean: moments.mean(), variance: moments.variance(), threshold }
    }
}

/// Moments of the values that are not nan.
fn moments_of_kept(cleaned: &[f64], scratch: &mut Vec<f64>) -> Result<Moments> {
    if !cleaned.iter().any(|v| v.is_nan()) {
        return Moments::of("y", cleaned);
    }
    scratch.clear();
    scratch.extend(cleaned.iter().copied().filter(|v| !v.is_nan()));
    Moments::of("y", scratch)
}

/// As [`moments_of_kept`], and at least two values must be left.
fn moments_of_cleaned(cleaned: &[f64], scratch: &mut Vec<f64>) -> Result<Moments> {
    let moments = moments_of_kept(cleaned, scratch)?;
    if moments.count() < 2.0 {
        return Err(Error::AllAnomalous { kept: moments.count() as usize, count: cleaned.len() });
    }
    Ok(moments)
}

/// Moments of all kept values but `cleaned[i]`: by downdating where that is exact to rounding,
/// anew where `cleaned[i]` makes up more than half of the sum of squares (at most two values can).
fn moments_of_others(
    cleaned: &[f64],
    i: usize,
    moments: &Moments,
    scratch: &mut Vec<f64>,
) -> Result<Moments> {
    if moments.share(moments.deviation(cleaned[i])) <= MAX_SHARE {
        return Ok(moments.without(cleaned[i]));
    }
    scratch.clear();
    let others = cleaned[..i].iter().chain(&cleaned[i + 1..]);
    scratch.extend(others.copied().filter(|v| !v.is_nan()));
    Moments::of("y", scratch)
}

#[cfg(test)]
mod tests {
    /// Twelve digits; the expected values are printed with 15.
    pub(super) fn assert_close(actual: f64, expected: f64) {
        let error = (actual / expected - 1.0).abs();
        assert!(error < 1e-12, "{actual:.17e} is not {expected:.17e}: {error:.1e}");
    }

    /// Noise without a generator: mean 0, between −2 and 2.
    pub(super) fn noise(i: usize) -> f64 {
        let phase = |step: f64| (i as f64 * step).fract() * 2.0 - 1.0;
        phase(0.754_877_666_246_692_8) + phase(0.569_840_290_998_053_3)
    }
}
