//! An exponential function that the compiler can vectorise.

/// Arguments are clamped to ± this value, for which neither the result nor its reciprocal overflows.
pub const LARGEST_EXPONENT: f64 = 700.0;

/// `1.5 · 2^52`: adding a number rounds it to an integer in the last bits of the sum.
const ROUNDING: f64 = 6_755_399_441_055_744.0;
/// ln 2 in two parts; the last bits of the first part are zeros.
const LN_2_HIGH: f64 = 0.693_147_180_369_123_8;
const LN_2_LOW: f64 = 1.908_214_929_270_587_7e-10;
const EXPONENT_BIAS: u64 = 1023;
const FRACTION_BITS: u32 = 52;
/// `1/k!` for k = 13 … 0: the series is exact to a double for |r| ≤ ½ ln 2.
const COEFFICIENTS: [f64; 14] = [
    1.0 / 6_227_020_800.0,
    1.0 / 479_001_600.0,
    1.0 / 39_916_800.0,
    1.0 / 3_628_800.0,
    1.0 / 362_880.0,
    1.0 / 40_320.0,
    1.0 / 5_040.0,
    1.0 / 720.0,
    1.0 / 120.0,
    1.0 / 24.0,
    1.0 / 6.0,
    0.5,
    1.0,
    1.0,
];

/// `e^x` to a few units in the last place, with the same bits on every processor. With `x = k ln 2 + r`,
/// `2^k` is formed by its exponent bits and `e^r` by its series.
#[inline(always)]
pub fn exp(x: f64) -> f64 {
    let x = x.clamp(-LARGEST_EXPONENT, LARGEST_EXPONENT);
    let shifted = x * std::f64::consts::LOG2_E + ROUNDING;
    let k = shifted - ROUNDING;
    let r = (x - k * LN_2_HIGH) - k * LN_2_LOW;
    // a `for`, because `fold` is not inlined into dispatched code
    let mut series = 0.0;
    for c in COEFFICIENTS {
        series = series * r + c;
    }
    let power = shifted.to_bits().wrapping_add(EXPONENT_BIAS) << FRACTION_BITS;
    series * f64::from_bits(power)
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
}
