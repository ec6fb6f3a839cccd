//! Tukey's biweight, and the scale of the residuals to which it is applied.

use crate::base::distribution::normal_two_sided_quantile;

/// Constant of the biweight for an efficiency of 95 % with normal noise.
pub(in crate::trajectory) const TUKEY: f64 = 4.685;
const Q: f64 = 1.0 / (TUKEY * TUKEY);
/// Mean squared score of Tukey's weights with normal errors; the cut-off at the constant is neglected.
const MEAN_SQUARE: f64 = 1.0 - 12.0 * Q + 90.0 * Q * Q - 420.0 * Q * Q * Q + 945.0 * Q * Q * Q * Q;
/// Mean squared score over mean squared weight.
pub(in crate::trajectory) const TAPERED: f64 =
    MEAN_SQUARE / (1.0 - 4.0 * Q + 18.0 * Q * Q - 60.0 * Q * Q * Q + 105.0 * Q * Q * Q * Q);
/// Two-sided probability beyond which a value is not due to chance: one-sided 5 %.
const CHANCE: f64 = 0.1;
/// Relative standard error of the median size of normal errors, times the root of their number.
pub(in crate::trajectory) const MEDIAN_ERROR: f64 = 1.17;

/// Tukey's weight; 1 if the residual is nan.
pub(in crate::trajectory) fn tukey(residual: f64) -> f64 {
    if residual.is_nan() {
        return 1.0;
    }
    let share = (residual.abs() / TUKEY).min(1.0);
    (1.0 - share * share).powi(2)
}

/// Number of standard errors that is exceeded by chance in one case of 20.
pub(in crate::trajectory) fn chance() -> f64 {
    normal_two_sided_quantile(CHANCE)
}

/// Factor by which residuals exceed their standard deviations, at least 1: from their median, less what may
/// be due to chance.
pub(in crate::trajectory) fn scale(sizes: &mut [f64]) -> f64 {
    let n = sizes.len();
    let (below, &mut upper, _) = sizes.select_nth_unstable_by(n / 2, f64::total_cmp);
    let lower = below.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let median = if n % 2 == 1 { upper } else { 0.5 * (lower + upper) };
    let margin = 1.0 + chance() * MEDIAN_ERROR / (n as f64).sqrt();
    (median / normal_two_sided_quantile(0.5) / margin).max(1.0)
}
