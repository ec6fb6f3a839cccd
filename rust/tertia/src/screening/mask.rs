//! The leave-one-out rule with frozen statistics as a mask, with about one read of memory.

use super::leave_one_out::threshold;
use super::others::MIN_COUNT;
use crate::base::error::{Result, require_positive, require_sample};
use crate::base::moments::{BLOCK, Moments};
use pulp::{Simd, WithSimd};

/// Flags the outliers of the rule with frozen statistics. O(N), with about one read of memory if the
/// sample is stationary and never more than two, and N/85 bytes of additional memory.
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
/// k ≤ 0, fewer than 3 values, a value that is not finite, or deviations out of range.
///
/// # Panics
/// If the slices differ in length.
pub fn mask(y: &[f64], k: f64, outlier: &mut [bool]) -> Result<()> {
    assert_eq!(y.len(), outlier.len());
    require_positive("k", k)?;
    require_sample("y", y, MIN_COUNT)?;
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

/// Flags in two reads of memory: one for the moments, one for the flags.
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

/// Flags each block while it is in the cache, with the band of the values so far. Then only those blocks
/// are read again that have a value between the edges of that band and the edges of the final band.
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

/// The band with which a block was flagged, and the smallest distance of its values from the edges of the
/// band.
struct Marked {
    moments: Moments,
    half_width: f64,
    margin: f64,
}

impl Marked {
    /// Whether all flags remain the same with this band.
    #[inline(always)]
    fn holds_for(&self, moments: &Moments, half_width: f64) -> bool {
        let moved = moments.distance(&self.moments) + (self.half_width - half_width).abs();
        let rounding = moments.rounding(half_width) + self.moments.rounding(self.half_width);
        self.margin > moved + rounding
    }
}

/// [`mark_beyond`] that returns the smallest distance of a value from the edges.
#[inline(always)]
fn mark_with_margin(y: &[f64], moments: &Moments, half_width: f64, outlier: &mut [bool]) -> f64 {
    // compared as integers: see `downdate`
    let mut nearest = f64::INFINITY.to_bits().cast_signed();
    for (flag, &v) in outlier.iter_mut().zip(y) {
        let beyond = moments.deviation(v).abs() - half_width;
        *flag = beyond > 0.0;
        nearest = nearest.min(beyond.abs().to_bits().cast_signed());
    }
    f64::from_bits(nearest.cast_unsigned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::noise;

    #[test]
    fn of_a_stationary_sample_few_blocks_are_read_again() {
        let y: Vec<f64> = (0..1000 * BLOCK).map(noise).collect();
        let (moments, blocks) =
            mark_provisionally(pulp::Scalar, &y, 1.5, &mut vec![false; y.len()]);
        let half_width = threshold(1.5, &moments);
        let again = blocks.iter().filter(|b| !b.holds_for(&moments, half_width)).count();
        assert!(again < 250, "{again} of 1000");
    }

    /// Blocks flagged early are flagged again if the band has moved across a value.
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
