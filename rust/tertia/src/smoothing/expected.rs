//! Whether innovations look as they should if the noise is as stated.

use crate::base::distribution::chi_square_upper;

/// So many of their standard deviations are innovations allowed to be off.
const SUSPICIOUS: f64 = 1.5;
/// Chance that the largest innovation of a healthy track is looked into.
const OUTLIER: f64 = 0.05;

/// What is asked of innovations.
#[derive(Clone, Copy, Debug)]
pub(super) struct Expected {
    /// That they are as large as stated, and not correlated.
    pub white: bool,
    /// That none is far too large.
    pub normal: bool,
}

impl Expected {
    /// Whether innovations (N, M) are too large, too small, or correlated.
    pub fn are_suspicious(&self, innovation: &[f64], m: usize) -> bool {
        let (mut squares, mut count, mut products, mut pairs) = (0.0, 0.0, 0.0, 0.0);
        let (mut largest, mut instants) = (0.0_f64, 0.0);
        for (k, now) in innovation.chunks_exact(m).enumerate() {
            let own: f64 = now.iter().filter(|x| !x.is_nan()).map(|x| x * x).sum();
            let there = now.iter().filter(|x| !x.is_nan()).count();
            squares += own;
            count += there as f64;
            largest = largest.max(own);
            instants += f64::from(u8::from(there > 0));
            if k > 0 {
                let before = &innovation[(k - 1) * m..][..m];
                for (a, b) in now.iter().zip(before).filter(|(a, b)| !a.is_nan() && !b.is_nan()) {
                    products += a * b;
                    pairs += 1.0;
                }
            }
        }
        if count < 1.0 {
            return false;
        }
        let excess = (squares / count - 1.0) * (0.5 * count).sqrt();
        let lasting = self.white
            && (excess.abs() > SUSPICIOUS
                || (products * count / (squares * f64::sqrt(pairs))).abs() > SUSPICIOUS);
        let outlying = excess > SUSPICIOUS || chi_square_upper(largest, m) < OUTLIER / instants;
        lasting || (self.normal && outlying)
    }
}
