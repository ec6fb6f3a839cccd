//! Test whether innovations are as expected if the noise is as stated.

use crate::base::distribution::chi_square_upper;

/// Number of standard deviations by which statistics of innovations may differ from expected values.
const SUSPICIOUS: f64 = 1.5;
/// Probability that the largest innovation of a healthy track is found suspicious.
const OUTLIER: f64 = 0.05;

/// Properties that innovations are expected to have.
#[derive(Clone, Copy, Debug)]
pub(super) struct Expected {
    /// They are as large as stated, and not correlated.
    pub white: bool,
    /// None of them is far too large.
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
