//! Mean and variance of the other values (M2), (M3), for one value or for every value of a sample.

use crate::base::error::{Error, Result, require_sample};
use crate::base::moments::Moments;
use pulp::{Simd, WithSimd};

/// If the share of a value in the sum of squares is larger, the others are summed again instead of downdated.
const MAX_SHARE: f64 = 0.5;
/// If a mean is below this share of the spread, it has lost three digits to cancellation.
const MIN_MEAN: f64 = 1e-3;
/// Smallest sample, because the divisor of D'_i is N − 2.
pub(super) const MIN_COUNT: usize = 3;

/// Moments of the values that are not nan.
pub(super) fn moments_of_kept(cleaned: &[f64], scratch: &mut Vec<f64>) -> Result<Moments> {
    if !cleaned.iter().any(|v| v.is_nan()) {
        return Moments::of("y", cleaned);
    }
    scratch.clear();
    scratch.extend(cleaned.iter().copied().filter(|v| !v.is_nan()));
    Moments::of("y", scratch)
}

/// [`moments_of_kept`] with an error if fewer than two values are left.
pub(super) fn moments_of_cleaned(cleaned: &[f64], scratch: &mut Vec<f64>) -> Result<Moments> {
    let moments = moments_of_kept(cleaned, scratch)?;
    if moments.count() < 2.0 {
        return Err(Error::TooFewLeft { kept: moments.count() as usize, count: cleaned.len() });
    }
    Ok(moments)
}

/// Moments of all kept values except `cleaned[i]`: by downdating if that is exact to rounding. If
/// `cleaned[i]` makes up more than half of the sum of squares (at most two values can), they are
/// summed again.
pub(super) fn moments_of_others(
    cleaned: &[f64],
    i: usize,
    moments: &Moments,
    scratch: &mut Vec<f64>,
) -> Result<Moments> {
    let deviation = moments.deviation(cleaned[i]);
    // a value at the mean has no share, even of a sum of squares that is zero
    if deviation == 0.0 || moments.share(deviation) <= MAX_SHARE {
        return Ok(moments.without(cleaned[i]));
    }
    scratch.clear();
    let others = cleaned[..i].iter().chain(&cleaned[i + 1..]);
    scratch.extend(others.copied().filter(|v| !v.is_nan()));
    Moments::of("y", scratch)
}

/// Computes the leave-one-out mean M'_i (M2) and variance D'_i (M3) of every value. O(N).
///
/// With e_i = y_i − M: `M'_i = M − e_i/(N−1)`, `D'_i = (SS − e_i² N/(N−1)) / (N−2)`.
///
/// # Errors
/// Fewer than 3 values, a value that is not finite, or deviations out of range.
///
/// # Panics
/// If the three slices differ in length.
pub fn statistics(y: &[f64], mean: &mut [f64], variance: &mut [f64]) -> Result<()> {
    assert!(y.len() == mean.len() && y.len() == variance.len());
    require_sample("y", y, MIN_COUNT)?;
    let moments = Moments::of("y", y)?;
    let extremes = pulp::Arch::new().dispatch(Downdate {
        moments: &moments,
        y,
        mean: &mut *mean,
        variance: &mut *variance,
    });
    if extremes.lost > MAX_SHARE * moments.sum_of_squares() {
        let mut scratch = Vec::new();
        for i in 0..y.len() {
            let others = moments_of_others(y, i, &moments, &mut scratch)?;
            (mean[i], variance[i]) = (others.mean(), others.variance());
        }
    }
    if extremes.mean < MIN_MEAN * (moments.sum_of_squares() / moments.count()).sqrt() {
        recompute_means(y, mean);
    }
    Ok(())
}

/// Computes M'_i in double the precision, for values that cancel. O(N).
fn recompute_means(y: &[f64], mean: &mut [f64]) {
    let (mut sum, mut error) = (0.0, 0.0);
    for &v in y {
        let (rounded, lost) = two_sum(sum, v);
        (sum, error) = (rounded, error + lost);
    }
    let others = y.len() as f64 - 1.0;
    for (m, &v) in mean.iter_mut().zip(y) {
        let (rounded, lost) = two_sum(sum, -v);
        *m = (rounded + (error + lost)) / others;
    }
}

/// `a + b` and its rounding error (Knuth).
fn two_sum(a: f64, b: f64) -> (f64, f64) {
    let sum = a + b;
    let b_rounded = sum - a;
    (sum, (a - (sum - b_rounded)) + (b - b_rounded))
}

/// Extremes that show whether a leave-one-out value has lost digits.
struct Extremes {
    /// The largest `e_i² N/(N−1)`.
    lost: f64,
    /// The smallest `|M'_i|`.
    mean: f64,
}

struct Downdate<'a> {
    moments: &'a Moments,
    y: &'a [f64],
    mean: &'a mut [f64],
    variance: &'a mut [f64],
}

impl WithSimd for Downdate<'_> {
    type Output = Extremes;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Extremes {
        downdate(self.moments, self.y, self.mean, self.variance)
    }
}

/// Writes M'_i and D'_i.
#[inline(always)]
fn downdate(moments: &Moments, y: &[f64], mean: &mut [f64], variance: &mut [f64]) -> Extremes {
    let n = moments.count();
    let (centre, squares) = (moments.mean(), moments.sum_of_squares());
    let (per_mean, per_square, per_variance) = (1.0 / (n - 1.0), n / (n - 1.0), 1.0 / (n - 2.0));
    // the bits of non-negative numbers have the order of the numbers, and compilers vectorise the maximum of
    // integers
    let (mut most_lost, mut least_mean) = (0_i64, i64::MAX);
    for ((&v, m), d) in y.iter().zip(mean).zip(variance) {
        let e = moments.deviation(v);
        let lost = e * e * per_square;
        *m = centre - e * per_mean;
        *d = (squares - lost) * per_variance;
        most_lost = most_lost.max(lost.to_bits().cast_signed());
        least_mean = least_mean.min(m.abs().to_bits().cast_signed());
    }
    Extremes {
        lost: f64::from_bits(most_lost.cast_unsigned()),
        mean: f64::from_bits(least_mean.cast_unsigned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_close;

    /// (M2), (M3) computed by hand.
    #[test]
    fn statistics_of_the_others() {
        let y = [12.4, 11.8, 40.0, 12.1, 12.9, 11.5, 20.0, 12.2, 12.0, 11.9];
        let (mut mean, mut variance) = ([0.0; 10], [0.0; 10]);
        statistics(&y, &mut mean, &mut variance).unwrap();
        assert_close(mean[2], 116.8 / 9.0);
        assert_close(variance[2], 7.089_444_444_444_444);
        assert_close(mean[6], 15.2);
        assert_close(variance[6], 86.645);
    }

    /// Summing all others again for every value of a sample would cost O(N²).
    #[test]
    fn equal_values_are_not_summed_again() {
        let (y, mut scratch) = ([7.0; 5], Vec::new());
        let moments = Moments::of("y", &y).unwrap();
        let others = moments_of_others(&y, 2, &moments, &mut scratch).unwrap();
        assert_eq!((others.count(), others.mean(), others.variance()), (4.0, 7.0, 0.0));
        assert!(scratch.is_empty());
    }
}
