//! Tukey's biweight.

/// For an efficiency of 95 % with normal noise.
pub(super) const TUKEY: f64 = 4.685;
const Q: f64 = 1.0 / (TUKEY * TUKEY);
/// Mean of the squared score of Tukey's weights with normal errors, what is beyond left out.
const MEAN_SQUARE: f64 = 1.0 - 12.0 * Q + 90.0 * Q * Q - 420.0 * Q * Q * Q + 945.0 * Q * Q * Q * Q;
/// Mean squared score over mean squared weight.
pub(super) const TAPERED: f64 =
    MEAN_SQUARE / (1.0 - 4.0 * Q + 18.0 * Q * Q - 60.0 * Q * Q * Q + 105.0 * Q * Q * Q * Q);

/// Tukey's weight; 1 where there is no residual.
pub(super) fn tukey(residual: f64) -> f64 {
    if residual.is_nan() {
        return 1.0;
    }
    let share = (residual.abs() / TUKEY).min(1.0);
    (1.0 - share * share).powi(2)
}
