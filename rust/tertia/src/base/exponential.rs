//! An exponential function and a logarithm that the compiler can vectorise.

use pulp::{Arch, Simd, WithSimd};
use std::f64::consts::FRAC_1_SQRT_2;

/// Arguments are clamped to ± this value, for which neither the result nor its reciprocal overflows.
pub const LARGEST_EXPONENT: f64 = 700.0;

/// `1.5 · 2^52`: adding a number rounds it to an integer in the last bits of the sum.
const ROUNDING: f64 = 6_755_399_441_055_744.0;
/// ln 2 in two parts; the last bits of the first part are zeros.
const LN_2_HIGH: f64 = 0.693_147_180_369_123_8;
const LN_2_LOW: f64 = 1.908_214_929_270_587_7e-10;
const EXPONENT_BIAS: u64 = 1023;
const FRACTION_BITS: u32 = 52;
/// `1/k!` for k = 2 … 13: the series is exact to a double for |r| ≤ ½ ln 2.
const COEFFICIENTS: [f64; 12] = [
    0.5,
    1.0 / 6.0,
    1.0 / 24.0,
    1.0 / 120.0,
    1.0 / 720.0,
    1.0 / 5_040.0,
    1.0 / 40_320.0,
    1.0 / 362_880.0,
    1.0 / 3_628_800.0,
    1.0 / 39_916_800.0,
    1.0 / 479_001_600.0,
    1.0 / 6_227_020_800.0,
];

/// Four terms of a power series in x from coefficient k on (Estrin 1960): with one term after the other, each
/// would wait for the one before.
#[inline(always)]
fn of_four<const N: usize>(c: &[f64; N], k: usize, x: f64) -> f64 {
    (c[k] + c[k + 1] * x) + (c[k + 2] + c[k + 3] * x) * (x * x)
}

/// `e^x` to a few units in the last place, with the same bits on every processor. With `x = k ln 2 + r`,
/// `2^k` is formed by its exponent bits and `e^r` by its series.
#[inline(always)]
pub fn exp(x: f64) -> f64 {
    let x = x.clamp(-LARGEST_EXPONENT, LARGEST_EXPONENT);
    let shifted = x * std::f64::consts::LOG2_E + ROUNDING;
    let k = shifted - ROUNDING;
    let r = (x - k * LN_2_HIGH) - k * LN_2_LOW;
    let c = &COEFFICIENTS;
    let square = r * r;
    let fourth = square * square;
    let rest = of_four(c, 0, r) + (of_four(c, 4, r) + of_four(c, 8, r) * fourth) * fourth;
    let power = shifted.to_bits().wrapping_add(EXPONENT_BIAS) << FRACTION_BITS;
    (1.0 + (r + square * rest)) * f64::from_bits(power)
}

/// `2^52`: its last bits, replaced by an integer, add this integer.
const INTEGERS: f64 = 4_503_599_627_370_496.0;
/// `1/(2k + 1)` for k = 1 … 10: the series of artanh r is exact to a double for |r| ≤ (√2 − 1)².
const ARTANH: [f64; 10] = [
    1.0 / 3.0,
    1.0 / 5.0,
    1.0 / 7.0,
    1.0 / 9.0,
    1.0 / 11.0,
    1.0 / 13.0,
    1.0 / 15.0,
    1.0 / 17.0,
    1.0 / 19.0,
    1.0 / 21.0,
];
const LANES: usize = 8;

/// Replaces the logarithms of weights by the weights, the largest of which is 1; returns their sum.
pub(crate) fn exponentials<T>(list: &mut [T], logarithm: impl Fn(&mut T) -> &mut f64) -> f64 {
    let highest = list.iter_mut().map(|own| *logarithm(own)).fold(f64::NEG_INFINITY, f64::max);
    let mut sum = 0.0;
    for weight in list.iter_mut().map(logarithm) {
        *weight = (*weight - highest).exp();
        sum += *weight;
    }
    sum
}

/// `ln x` to a few units in the last place for any x from the smallest normal number on, with the same bits
/// on every processor; infinity and nan remain. With `x = 2^k m`, m between √½ and √2, and
/// `r = (m − 1)/(m + 1)`, it is `k ln 2 + 2 artanh r`.
#[inline(always)]
pub fn ln(x: f64) -> f64 {
    let bias = EXPONENT_BIAS << FRACTION_BITS;
    let shifted = x.to_bits().wrapping_sub(FRAC_1_SQRT_2.to_bits()).wrapping_add(bias);
    let biased = shifted >> FRACTION_BITS;
    let k = f64::from_bits(INTEGERS.to_bits() | biased) - (INTEGERS + EXPONENT_BIAS as f64);
    let power = (biased << FRACTION_BITS).wrapping_sub(bias);
    let m = f64::from_bits(x.to_bits().wrapping_sub(power));
    let r = (m - 1.0) / (m + 1.0);
    let square = r * r;
    let eighth = (square * square) * (square * square);
    let rest = ARTANH[8] + ARTANH[9] * square;
    let last = (of_four(&ARTANH, 4, square) + rest * eighth) * eighth;
    let series = square * (of_four(&ARTANH, 0, square) + last);
    let found = k * LN_2_HIGH + (2.0 * r + (2.0 * r * series + k * LN_2_LOW));
    if x <= f64::MAX { found } else { x }
}

struct Logarithms<'a>(&'a [f64]);

impl WithSimd for Logarithms<'_> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> f64 {
        let (chunks, rest) = self.0.as_chunks::<LANES>();
        let mut last = [1.0; LANES];
        last[..rest.len()].copy_from_slice(rest);
        let mut sums = [0.0; LANES];
        for k in 0..=chunks.len() {
            let chunk = if k < chunks.len() { &chunks[k] } else { &last };
            for i in 0..LANES {
                sums[i] += ln(chunk[i]);
            }
        }
        sums.iter().sum()
    }
}

/// Returns the sum of the logarithms of normal positive numbers.
pub fn sum_of_logarithms(x: &[f64]) -> f64 {
    Arch::new().dispatch(Logarithms(x))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_within;

    #[test]
    fn agrees_with_the_standard_library() {
        for i in -7000..=7000 {
            let x = f64::from(i) * 0.1 + 0.013;
            assert_within(1e-15, exp(x), x.clamp(-700.0, 700.0).exp());
        }
        assert_eq!(exp(0.0), 1.0);
        assert_eq!(exp(1e9), exp(LARGEST_EXPONENT));
        assert_eq!(exp(-1e300), exp(-LARGEST_EXPONENT));
    }

    #[test]
    fn the_logarithm_agrees_with_the_standard_library() {
        for i in -7000..=7000 {
            let x = (f64::from(i) * 0.1 + 0.013).exp();
            assert_within(1e-15, ln(x), x.ln());
        }
        for i in 1..2000 {
            let x = 1.0 + f64::from(i - 1000) * 1e-7;
            assert_within(1e-15, ln(x), x.ln());
        }
        assert_eq!([ln(1.0), ln(f64::INFINITY)], [0.0, f64::INFINITY]);
        assert!(ln(f64::NAN).is_nan());
        assert_within(1e-15, ln(f64::MIN_POSITIVE), f64::MIN_POSITIVE.ln());
    }

    #[test]
    fn a_sum_includes_the_last_numbers() {
        let x: Vec<f64> = (1..=19).map(f64::from).collect();
        assert_within(1e-15, sum_of_logarithms(&x), x.iter().map(|x| x.ln()).sum());
        assert_eq!(sum_of_logarithms(&[]), 0.0);
    }
}
