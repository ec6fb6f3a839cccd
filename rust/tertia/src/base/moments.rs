//! Mean and variance without loss of digits.
//!
//! An origin inside the sample is subtracted from all values before anything is summed, so a common
//! offset of 1e9 costs no digits. Blocks that fit the L1 cache are summed twice (the mean, then squares
//! about it) and merged. Memory is therefore read once, and the squares never cancel.

use crate::base::error::{Error, Result, require_finite};
use pulp::{Simd, WithSimd};

/// Number of independent sums per block: enough to hide the latency of the adder at 256 bits, and fixed,
/// so that every instruction set returns the same bits.
const LANES: usize = 16;
/// Values per block: 16 KiB, half of the smallest L1 data cache in use.
pub(crate) const BLOCK: usize = 2048;
/// Smallest sum of squares; a smaller one may have lost digits to underflow.
const MIN_SUM_OF_SQUARES: f64 = 1e-280;

/// Count, mean and sum of squared deviations of a sample; the mean is `origin + offset`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moments {
    count: f64,
    origin: f64,
    offset: f64,
    sum_of_squares: f64,
}

impl Moments {
    /// Computes the moments of a sample. O(N), one read of memory.
    ///
    /// # Errors
    /// A value that is not finite, or deviations whose squares exceed the range of a double.
    pub fn of(argument: &'static str, y: &[f64]) -> Result<Self> {
        pulp::Arch::new().dispatch(OfSample(y)).checked(argument, &[y])
    }

    /// [`Moments::of`] for callers that check and dispatch themselves.
    #[inline(always)]
    pub(crate) fn unchecked<S: Simd>(simd: S, y: &[f64]) -> Self {
        // a `for`, because the standard iterators' `fold` is not inlined into dispatched code
        let mut moments = Self::before(y);
        for block in y.chunks(BLOCK) {
            moments = moments.with_block(simd, block);
        }
        moments
    }

    /// Moments of no values, with the origin for the values `y`.
    #[inline(always)]
    pub(crate) fn before(y: &[f64]) -> Self {
        let n = y.len();
        let origin = if n == 0 { 0.0 } else { median_of_three(y[0], y[n / 2], y[n - 1]) };
        Self { count: 0.0, origin, offset: 0.0, sum_of_squares: 0.0 }
    }

    /// Adds at most [`BLOCK`] values.
    #[inline(always)]
    pub(crate) fn with_block<S: Simd>(self, simd: S, block: &[f64]) -> Self {
        let (count, origin) = (block.len() as f64, self.origin);
        let offset = sum_of_deviations(simd, block, origin) / count;
        let sum_of_squares = sum_of_squares(simd, block, origin, offset);
        self.merge(Self { count, origin, offset, sum_of_squares })
    }

    /// Moments of two samples together (Chan, Golub, LeVeque 1979).
    #[inline(always)]
    pub fn merge(self, other: Self) -> Self {
        if self.count == 0.0 {
            return other;
        }
        if other.count == 0.0 {
            return self;
        }
        let count = self.count + other.count;
        let delta = (other.origin - self.origin) + (other.offset - self.offset);
        let share = other.count / count;
        Self {
            count,
            origin: self.origin,
            offset: self.offset + delta * share,
            sum_of_squares: self.sum_of_squares
                + other.sum_of_squares
                + delta * delta * self.count * share,
        }
    }

    /// Returns the moments, or the error in one of `samples` that makes them unusable.
    pub(crate) fn checked(self, argument: &'static str, samples: &[&[f64]]) -> Result<Self> {
        let squares = self.sum_of_squares;
        if squares.is_finite() && squares >= MIN_SUM_OF_SQUARES {
            return Ok(self);
        }
        let all = || samples.iter().copied().flatten();
        for sample in samples {
            require_finite(argument, sample)?;
        }
        let constant = all().all(|v| Some(v) == all().next());
        if constant { Ok(self) } else { Err(Error::OutOfRange { argument }) }
    }

    /// Number of measurements, as a double.
    pub fn count(&self) -> f64 {
        self.count
    }

    /// Sample mean M.
    pub fn mean(&self) -> f64 {
        self.origin + self.offset
    }

    /// Sum of squared deviations SS.
    pub fn sum_of_squares(&self) -> f64 {
        self.sum_of_squares
    }

    /// Sample variance D, divisor N − 1.
    pub fn variance(&self) -> f64 {
        self.sum_of_squares / (self.count - 1.0)
    }

    /// `y − M`, without the rounding of M.
    #[inline(always)]
    pub fn deviation(&self, y: f64) -> f64 {
        (y - self.origin) - self.offset
    }

    /// Share of SS that disappears if a value with this deviation is removed: `e² N/(N−1) / SS`.
    #[inline(always)]
    pub fn share(&self, deviation: f64) -> f64 {
        deviation * deviation * self.count / (self.count - 1.0) / self.sum_of_squares
    }

    /// Moments without one value of the sample, by downdating; exact to rounding if the
    /// [`Moments::share`] of the value is at most one half.
    #[inline(always)]
    pub fn without(&self, y: f64) -> Self {
        let e = self.deviation(y);
        Self {
            count: self.count - 1.0,
            origin: self.origin,
            // M' = M − e/(N−1)
            offset: self.offset - e / (self.count - 1.0),
            // SS' = SS − e² N/(N−1)
            sum_of_squares: self.sum_of_squares - e * e * (self.count / (self.count - 1.0)),
        }
    }

    /// Moments with one additional value at the mean: the mean and the squares do not change.
    pub fn with_one_at_mean(self) -> Self {
        Self { count: self.count + 1.0, ..self }
    }

    /// Whether `|y − M| > half_width`; false for nan.
    #[inline(always)]
    pub fn is_beyond(&self, y: f64, half_width: f64) -> bool {
        self.deviation(y).abs() > half_width
    }

    /// Distance of the mean from that of other moments with the same origin.
    #[inline(always)]
    pub(crate) fn distance(&self, other: &Self) -> f64 {
        (self.offset - other.offset).abs()
    }

    /// Bound of the rounding error of [`Moments::deviation`] for values within `half_width` of the mean.
    #[inline(always)]
    pub(crate) fn rounding(&self, half_width: f64) -> f64 {
        4.0 * f64::EPSILON * (self.offset.abs() + half_width)
    }
}

/// Runs [`Moments::unchecked`] with the widest vectors of the machine.
struct OfSample<'a>(&'a [f64]);

impl WithSimd for OfSample<'_> {
    type Output = Moments;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Moments {
        Moments::unchecked(simd, self.0)
    }
}

/// Sum of `y − origin`.
#[inline(always)]
fn sum_of_deviations<S: Simd>(simd: S, y: &[f64], origin: f64) -> f64 {
    let shift = simd.splat_f64s(origin);
    let (sum, rest) = sum_by(simd, y, |v| simd.sub_f64s(v, shift));
    sum + rest.iter().map(|v| v - origin).sum::<f64>()
}

/// Sum of `(y − origin − offset)²`.
#[inline(always)]
fn sum_of_squares<S: Simd>(simd: S, y: &[f64], origin: f64, offset: f64) -> f64 {
    let (shift, mean) = (simd.splat_f64s(origin), simd.splat_f64s(offset));
    let (sum, rest) = sum_by(simd, y, |v| {
        let e = simd.sub_f64s(simd.sub_f64s(v, shift), mean);
        simd.mul_f64s(e, e)
    });
    let square = |v: &f64| (v - origin - offset) * (v - origin - offset);
    sum + rest.iter().map(square).sum::<f64>()
}

/// Sum of `f` over all values that fill the lanes; also returns the remaining values.
#[inline(always)]
fn sum_by<S: Simd>(simd: S, y: &[f64], f: impl Fn(S::f64s) -> S::f64s) -> (f64, &[f64]) {
    let (chunks, rest) = y.as_chunks::<LANES>();
    let mut lanes = [0.0; LANES];
    let sums = S::as_mut_simd_f64s(&mut lanes).0;
    for chunk in chunks {
        for (sum, &v) in sums.iter_mut().zip(S::as_simd_f64s(chunk).0) {
            *sum = simd.add_f64s(*sum, f(v));
        }
    }
    let mut width = LANES / 2;
    while width > 0 {
        for i in 0..width {
            lanes[i] += lanes[i + width];
        }
        width /= 2;
    }
    (lanes[0], rest)
}

#[inline(always)]
fn median_of_three(a: f64, b: f64, c: f64) -> f64 {
    a.max(b).min(a.min(b).max(c))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 0, 1, …, n − 1: mean (n−1)/2, SS = n (n² − 1)/12, both exact.
    fn ramp(n: usize, offset: f64) -> Vec<f64> {
        (0..n).map(|i| offset + i as f64).collect()
    }

    #[test]
    fn ramps_have_known_moments_whatever_the_offset() {
        for n in [1, 2, 15, 16, 17, 2047, 2048, 2049, 10_000] {
            for offset in [0.0, 1e9, -1e12] {
                let moments = Moments::of("y", &ramp(n, offset)).unwrap();
                let exact = n as f64 * ((n * n) as f64 - 1.0) / 12.0;
                assert_eq!(moments.mean(), offset + (n as f64 - 1.0) / 2.0);
                assert!((moments.sum_of_squares() - exact).abs() <= 1e-14 * exact);
            }
        }
    }

    #[test]
    fn without_a_value_equals_the_moments_of_the_others() {
        let y = ramp(5000, 1e6);
        let all = Moments::of("y", &y).unwrap();
        for i in [0, 1, 2499, 4999] {
            let others = [&y[..i], &y[i + 1..]].concat();
            let (down, anew) = (all.without(y[i]), Moments::of("y", &others).unwrap());
            assert!((down.mean() / anew.mean() - 1.0).abs() < 1e-15);
            assert!((down.variance() / anew.variance() - 1.0).abs() < 1e-13);
        }
    }

    #[test]
    fn deviations_keep_what_the_mean_cannot_hold() {
        // the mean 1e16 + 3 lies between two doubles, whose spacing is 2
        let y = [1e16, 1e16 + 2.0, 1e16 + 2.0, 1e16 + 8.0];
        let moments = Moments::of("y", &y).unwrap();
        assert_eq!(y.map(|v| moments.deviation(v)), [-3.0, -1.0, -1.0, 5.0]);
    }

    /// The architecture promises the same bits for any width of the vectors.
    #[test]
    fn every_instruction_set_returns_the_same_bits() {
        for n in [3, 17, 100, 2049, 10_000] {
            let y: Vec<f64> = (0..n).map(|i| (i as f64 * 0.754_877_666).fract() + 1e6).collect();
            let narrow = Moments::unchecked(pulp::Scalar, &y);
            let widest = pulp::Arch::new().dispatch(OfSample(&y));
            assert_eq!(narrow, widest);
        }
    }

    #[test]
    fn what_cannot_be_squared_is_an_error() {
        assert!(matches!(
            Moments::of("y", &[0.0, f64::NAN]),
            Err(Error::InvalidMeasurement { index: 1, .. })
        ));
        for scale in [1e160, 1e-160] {
            let y = [0.0, scale, -scale];
            assert!(matches!(Moments::of("y", &y), Err(Error::OutOfRange { .. })), "{scale:e}");
        }
        assert_eq!(Moments::of("y", &[1e300; 3]).unwrap().sum_of_squares(), 0.0);
    }
}
