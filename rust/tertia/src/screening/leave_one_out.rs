//! The leave-one-out rule (M2)–(M4): each value against the mean and variance of the others.

use super::{MAX_SHARE, Summary, moments_of_cleaned, moments_of_kept, moments_of_others};
use crate::base::error::{Result, require, require_count};
use crate::base::moments::{BLOCK, Moments};
use pulp::{Simd, WithSimd};

/// A mean that is smaller than this share of the spread has lost three digits to cancellation.
const MIN_MEAN: f64 = 1e-3;
/// Values needed: D'_i has the divisor N − 2.
pub(super) const MIN_COUNT: usize = 3;
/// Repeated passes that replace eat the whole sample below k = 2.1617; refused below this.
const MIN_K_REPLACING_PASSES: f64 = 2.5;
/// Repeated passes that exclude do so below √3.
const MIN_K_EXCLUDING_PASSES: f64 = 1.732_050_807_568_877_2;

/// Which mean and variance the values of one pass are tested with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Statistics {
    /// Those of the sample as corrected so far: what the paper describes.
    Sequential,
    /// Those of the sample at the start of the pass.
    Frozen,
}

/// Direction of a sequential pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// From the first value to the last.
    Forward,
    /// From the last value to the first.
    Backward,
}

/// Leave-one-out mean M'_i (M2) and variance D'_i (M3) of every value. O(N).
///
/// With e_i = y_i − M: `M'_i = M − e_i/(N−1)`, `D'_i = (SS − e_i² N/(N−1)) / (N−2)`.
///
/// # Errors
/// Fewer than 3 values, a value that is not finite, deviations out of range.
///
/// # Panics
/// If the three slices differ in length.
pub fn statistics(y: &[f64], mean: &mut [f64], variance: &mut [f64]) -> Result<()> {
    assert!(y.len() == mean.len() && y.len() == variance.len());
    require_count("y", y.len(), MIN_COUNT)?;
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

/// M'_i in twice the precision, for values that cancel. O(N).
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

/// `a + b` and what its rounding has lost (Knuth).
fn two_sum(a: f64, b: f64) -> (f64, f64) {
    let sum = a + b;
    let b_rounded = sum - a;
    (sum, (a - (sum - b_rounded)) + (b - b_rounded))
}

/// What decides whether a leave-one-out value has lost digits.
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
    // bits of numbers that are not negative are in the order of the numbers, and integers have a
    // maximum that the compiler turns into vectors
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

/// `N (N−2)/k² + N − 1`: divided by k², which may overflow but must not be zero.
#[inline(always)]
fn room(k: f64, n: f64) -> f64 {
    const SMALLEST_K: f64 = 1e-150;
    let k = k.max(SMALLEST_K);
    n * (n - 2.0) / (k * k) + (n - 1.0)
}

/// Marks the values that the rule with frozen statistics finds anomalous. O(N); about one read of
/// memory where the sample is stationary, never more than two; N/85 bytes of memory.
///
/// ```
/// let mut outlier = [false; 6];
/// tertia::screening::mask(&[1.0, 2.0, 1.5, 30.0, 1.2, 1.8], 2.5, &mut outlier)?;
/// assert_eq!(outlier, [false, false, false, true, false, false]);
/// let refused = tertia::screening::mask(&[1.0, f64::NAN, 2.0], 2.5, &mut outlier[..3]);
/// assert!(refused.is_err());
/// # Ok::<(), tertia::Error>(())
/// ```
///
/// # Errors
/// k ≤ 0, fewer than 3 values, a value that is not finite, deviations out of range.
///
/// # Panics
/// If the slices differ in length.
pub fn mask(y: &[f64], k: f64, outlier: &mut [bool]) -> Result<()> {
    assert_eq!(y.len(), outlier.len());
    require("k", k, k > 0.0 && k.is_finite(), "a positive number")?;
    require_count("y", y.len(), MIN_COUNT)?;
    let moments = pulp::Arch::new().dispatch(Mark { y, k, outlier });
    moments.checked("y", &[y]).map(|_| ())
}

struct Mark<'a> {
    y: &'a [f64],
    k: f64,
    outlier: &'a mut [bool],
}

impl WithSimd for Mark<'_> {
    type Output = Moments;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Moments {
        let Self { y, k, outlier } = self;
        if y.len() <= BLOCK { mark(simd, y, k, outlier) } else { mark_blocks(simd, y, k, outlier) }
    }
}

/// Two reads: moments, then marks.
#[inline(always)]
fn mark<S: Simd>(simd: S, y: &[f64], k: f64, outlier: &mut [bool]) -> Moments {
    let moments = Moments::unchecked(simd, y);
    mark_beyond(y, &moments, threshold(k, &moments), outlier);
    moments
}

#[inline(always)]
fn mark_beyond(y: &[f64], moments: &Moments, half_width: f64, outlier: &mut [bool]) {
    for (flag, &v) in outlier.iter_mut().zip(y) {
        *flag = moments.is_beyond(v, half_width);
    }
}

/// Marks each block, while it is in the cache, with the band of the values so far; afterwards only
/// the blocks that have a value between that band's edges and the final ones are read again.
#[inline(always)]
fn mark_blocks<S: Simd>(simd: S, y: &[f64], k: f64, outlier: &mut [bool]) -> Moments {
    let (moments, blocks) = mark_provisionally(simd, y, k, outlier);
    let half_width = threshold(k, &moments);
    let items = y.chunks(BLOCK).zip(outlier.chunks_mut(BLOCK)).zip(&blocks);
    for ((block, flags), marked) in items {
        if !marked.holds_for(&moments, half_width) {
            mark_beyond(block, &moments, half_width, flags);
        }
    }
    moments
}

#[inline(always)]
fn mark_provisionally<S: Simd>(
    simd: S,
    y: &[f64],
    k: f64,
    outlier: &mut [bool],
) -> (Moments, Vec<Marked>) {
    let mut moments = Moments::before(y);
    let mut blocks = Vec::with_capacity(y.len().div_ceil(BLOCK));
    for (block, flags) in y.chunks(BLOCK).zip(outlier.chunks_mut(BLOCK)) {
        moments = moments.with_block(simd, block);
        let half_width = threshold(k, &moments);
        let margin = mark_with_margin(block, &moments, half_width, flags);
        blocks.push(Marked { moments, half_width, margin });
    }
    (moments, blocks)
}

/// The band a block was marked with, and the distance of its nearest value to the band's edges.
struct Marked {
    moments: Moments,
    half_width: f64,
    margin: f64,
}

impl Marked {
    /// Whether no mark changes with this band.
    #[inline(always)]
    fn holds_for(&self, moments: &Moments, half_width: f64) -> bool {
        let moved = moments.distance(&self.moments) + (self.half_width - half_width).abs();
        let rounding = moments.rounding(half_width) + self.moments.rounding(self.half_width);
        self.margin > moved + rounding
    }
}

/// As [`mark_beyond`]; returns how near to the edges a value comes.
#[inline(always)]
fn mark_with_margin(y: &[f64], moments: &Moments, half_width: f64, outlier: &mut [bool]) -> f64 {
    // as integers: see `downdate`
    let mut nearest = f64::INFINITY.to_bits().cast_signed();
    for (flag, &v) in outlier.iter_mut().zip(y) {
        let beyond = moments.deviation(v).abs() - half_width;
        *flag = beyond > 0.0;
        nearest = nearest.min(beyond.abs().to_bits().cast_signed());
    }
    f64::from_bits(nearest.cast_unsigned())
}

/// The rule is `|y_i − M| > c √D` with `c = k (N−1)^(3/2) / √(N [N(N−2) + k²(N−1)])`; this is c √D.
#[inline(always)]
fn threshold(k: f64, moments: &Moments) -> f64 {
    let n = moments.count();
    (n - 1.0) * (moments.sum_of_squares() / (n * room(k, n))).sqrt()
}

/// The leave-one-out rule and what it does with an anomalous value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LeaveOneOutRule {
    k: f64,
    statistics: Statistics,
    direction: Direction,
    replace: bool,
    passes: usize,
}

impl LeaveOneOutRule {
    /// A rule that calls y_i anomalous if `|M'_i − y_i| > k √D'_i` and replaces it by M'_i or,
    /// without `replace`, excludes it.
    ///
    /// # Errors
    /// k ≤ 0, no pass, or several passes with a k at which they would eat the whole sample.
    pub fn try_new(
        k: f64,
        statistics: Statistics,
        direction: Direction,
        replace: bool,
        passes: usize,
    ) -> Result<Self> {
        require("k", k, k > 0.0 && k.is_finite(), "a positive number")?;
        require("passes", passes as f64, passes >= 1, "at least 1")?;
        if passes > 1 && replace {
            let holds = k >= MIN_K_REPLACING_PASSES;
            require("k", k, holds, "at least 2.5 with passes > 1 and replace=True")?;
        } else if passes > 1 {
            let holds = k >= MIN_K_EXCLUDING_PASSES;
            require("k", k, holds, "at least 1.7321 (√3) with passes > 1 and replace=False")?;
        }
        Ok(Self { k, statistics, direction, replace, passes })
    }

    /// Screens `y`: marks anomalous values and writes the cleaned sample (nan where excluded).
    /// O(N) a pass; each of the few values that dominate the sum of squares costs O(N) more.
    ///
    /// # Errors
    /// Fewer than 3 values, a value that is not finite, deviations out of range, or fewer than 2
    /// values left.
    ///
    /// # Panics
    /// If the slices differ in length.
    pub fn screen(
        &self,
        y: &[f64],
        outlier: &mut [bool],
        cleaned: &mut [f64],
        scratch: &mut Vec<f64>,
    ) -> Result<Summary> {
        assert_eq!(y.len(), outlier.len());
        require_count("y", y.len(), MIN_COUNT)?;
        cleaned.copy_from_slice(y);
        outlier.fill(false);
        let mut moments = Moments::of("y", y)?;
        let mut band = threshold(self.k, &moments);
        for _ in 0..self.passes {
            band = threshold(self.k, &moments);
            let found = match self.statistics {
                Statistics::Frozen => self.frozen_pass(&moments, outlier, cleaned, scratch)?,
                Statistics::Sequential => {
                    self.sequential_pass(moments, outlier, cleaned, scratch)?
                }
            };
            if !found {
                break;
            }
            moments = moments_of_cleaned(cleaned, scratch)?;
            if self.statistics == Statistics::Sequential {
                band = threshold(self.k, &moments);
            }
            if moments.count() < MIN_COUNT as f64 {
                break;
            }
        }
        Ok(Summary::of_moments(&moments, band))
    }

    fn frozen_pass(
        &self,
        moments: &Moments,
        outlier: &mut [bool],
        cleaned: &mut [f64],
        scratch: &mut Vec<f64>,
    ) -> Result<bool> {
        let half_width = threshold(self.k, moments);
        let mut replacements = Vec::new();
        for (i, &v) in cleaned.iter().enumerate() {
            if moments.is_beyond(v, half_width) {
                let others = moments_of_others(cleaned, i, moments, scratch)?;
                replacements.push((i, if self.replace { others.mean() } else { f64::NAN }));
            }
        }
        for &(i, value) in &replacements {
            outlier[i] = true;
            cleaned[i] = value;
        }
        Ok(!replacements.is_empty())
    }

    /// A flagged value changes the statistics to exactly M ← M'_i, SS ← SS'_i, so between two
    /// flagged values the pass is a search for the next value outside a fixed band.
    fn sequential_pass(
        &self,
        mut moments: Moments,
        outlier: &mut [bool],
        cleaned: &mut [f64],
        scratch: &mut Vec<f64>,
    ) -> Result<bool> {
        let mut reference = moments.sum_of_squares();
        let mut found = false;
        let mut open = 0..cleaned.len();
        while moments.count() >= MIN_COUNT as f64 {
            let half_width = threshold(self.k, &moments);
            let Some(i) = self.next_beyond(&moments, half_width, cleaned, open.clone()) else {
                break;
            };
            let mut others = moments_of_others(cleaned, i, &moments, scratch)?;
            cleaned[i] = f64::NAN;
            if others.sum_of_squares() < 0.5 * reference {
                // many small downdates have cancelled: start afresh
                others = moments_of_kept(cleaned, scratch)?;
                reference = others.sum_of_squares();
            }
            moments = others;
            if self.replace {
                cleaned[i] = others.mean();
                moments = others.with_one_at_mean();
            }
            outlier[i] = true;
            found = true;
            match self.direction {
                Direction::Forward => open.start = i + 1,
                Direction::Backward => open.end = i,
            }
        }
        Ok(found)
    }

    fn next_beyond(
        &self,
        moments: &Moments,
        half_width: f64,
        y: &[f64],
        open: std::ops::Range<usize>,
    ) -> Option<usize> {
        let beyond = |v: &f64| moments.is_beyond(*v, half_width);
        let start = open.start;
        let y = &y[open];
        let found = match self.direction {
            Direction::Forward => y.iter().position(beyond),
            Direction::Backward => y.iter().rposition(beyond),
        };
        found.map(|i| start + i)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::screening::tests::{assert_close, noise};

    const SAMPLE: [f64; 10] = [12.4, 11.8, 40.0, 12.1, 12.9, 11.5, 20.0, 12.2, 12.0, 11.9];

    fn screen(rule: LeaveOneOutRule) -> (Vec<usize>, Vec<f64>, Summary) {
        let (mut outlier, mut cleaned) = ([false; 10], vec![0.0; 10]);
        let summary = rule.screen(&SAMPLE, &mut outlier, &mut cleaned, &mut Vec::new()).unwrap();
        ((0..10).filter(|&i| outlier[i]).collect(), cleaned, summary)
    }

    fn rule(statistics: Statistics, direction: Direction, replace: bool) -> LeaveOneOutRule {
        LeaveOneOutRule::try_new(2.5, statistics, direction, replace, 1).unwrap()
    }

    /// (M2), (M3) by hand.
    #[test]
    fn statistics_of_the_others() {
        let (mut mean, mut variance) = ([0.0; 10], [0.0; 10]);
        statistics(&SAMPLE, &mut mean, &mut variance).unwrap();
        assert_close(mean[2], 116.8 / 9.0);
        assert_close(variance[2], 7.089_444_444_444_444);
        assert_close(mean[6], 15.2);
        assert_close(variance[6], 86.645);
    }

    #[test]
    fn direction_and_statistics_decide_what_is_found() {
        let (found, cleaned, summary) =
            screen(rule(Statistics::Sequential, Direction::Forward, true));
        assert_eq!(found, [2, 6]);
        assert_close(cleaned[6], 12.197_530_864_197_53);
        assert_close(summary.variance, 0.213_875_933_546_715);
        let (found, ..) = screen(rule(Statistics::Sequential, Direction::Backward, true));
        assert_eq!(found, [2]);
        let (found, cleaned, _) = screen(rule(Statistics::Frozen, Direction::Forward, true));
        assert_eq!(found, [2]);
        assert_close(cleaned[2], 116.8 / 9.0);
        let (found, cleaned, _) = screen(rule(Statistics::Sequential, Direction::Forward, false));
        assert!(found == [2, 6] && cleaned[2].is_nan() && cleaned[6].is_nan());
    }

    #[test]
    fn threshold_coefficients() {
        for (k, n, c) in [
            (2.5, 10, 1.828_670_745_992_21),
            (2.5, 100, 2.412_598_158_422_82),
            (2.2, 20, 1.916_408_482_272_67),
            (3.0, 100, 2.858_017_487_759_74),
            (2.5, 5, std::f64::consts::SQRT_2),
        ] {
            let y: Vec<f64> = (0..n).map(noise).collect();
            let moments = Moments::of("y", &y).unwrap();
            assert_close(threshold(k, &moments) / moments.variance().sqrt(), c);
        }
    }

    #[test]
    fn of_a_stationary_sample_few_blocks_are_read_again() {
        let y: Vec<f64> = (0..1000 * BLOCK).map(noise).collect();
        let (moments, blocks) =
            mark_provisionally(pulp::Scalar, &y, 1.5, &mut vec![false; y.len()]);
        let half_width = threshold(1.5, &moments);
        let again = blocks.iter().filter(|b| !b.holds_for(&moments, half_width)).count();
        assert!(again < 250, "{again} of 1000");
    }

    /// The blocks marked early are marked again where the band has moved over a value.
    #[test]
    fn a_mask_is_the_same_however_the_sample_drifts() {
        let n = 5 * BLOCK + 77;
        let drifts: [fn(f64) -> f64; 4] = [
            |_| 0.0,
            |t| 8.0 * t,
            |t| -3.0 * t * t,
            |t| {
                if t < 0.01 { 1e12 } else { 0.0 }
            },
        ];
        for drift in drifts {
            let y: Vec<f64> = (0..n).map(|i| noise(i) + drift(i as f64 / n as f64)).collect();
            let moments = Moments::of("y", &y).unwrap();
            let half_width = threshold(1.5, &moments);
            let mut outlier = vec![false; n];
            mask(&y, 1.5, &mut outlier).unwrap();
            let marked = outlier.iter().filter(|&&flag| flag).count();
            assert!(
                marked > 0 && (0..n).all(|i| outlier[i] == moments.is_beyond(y[i], half_width))
            );
        }
    }
}
