//! Angles and sums of costs in the lanes of vectors.

use super::Loss;
use super::lane::{LANES, Lanes};
use crate::base::vector::Vector;
use crate::sensors::{SMALL_TANGENT, TERMS};
use pulp::Simd;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};

/// Number of likelihoods, each at least 2.5e-4, whose product does not underflow.
const FACTORS: usize = 64;
/// Largest t for which the arc tangent is computed as `atan t = t + t³ P(t²)/Q(t²)` (Moshier's Cephes).
/// The coefficients begin with the highest power.
const SMALLER_TANGENT: f64 = 0.66;
const P: [f64; 5] = [
    -8.750_608_600_031_904e-1,
    -1.615_753_718_733_365e1,
    -7.500_855_792_314_705e1,
    -1.228_866_684_490_136_2e2,
    -6.485_021_904_942_025e1,
];
const Q: [f64; 6] = [
    1.0,
    2.485_846_490_142_306_4e1,
    1.650_270_098_316_988_6e2,
    4.328_810_604_912_902_5e2,
    4.853_903_996_359_137e2,
    1.945_506_571_482_614e2,
];

/// Sum of costs; for a mixture, likelihoods are added instead, and their logarithm is taken at the end.
pub(in crate::location) struct Total<S: Simd> {
    lanes: Lanes<S>,
    is_mixture: bool,
    sum: Vector<S>,
    likelihood: Vector<S>,
    count: usize,
}

impl<S: Simd> Total<S> {
    #[inline(always)]
    pub fn new(lanes: Lanes<S>, loss: Loss) -> Self {
        let is_mixture = matches!(loss, Loss::Mixture { .. });
        Self { lanes, is_mixture, sum: lanes.splat(0.0), likelihood: lanes.splat(1.0), count: 0 }
    }

    #[inline(always)]
    pub fn add(&mut self, cost: Vector<S>) {
        if !self.is_mixture {
            self.sum += cost;
            return;
        }
        self.likelihood = self.likelihood * cost;
        self.count += 1;
        if self.count.is_multiple_of(FACTORS) {
            self.sum -= self.lanes.ln(self.likelihood);
            self.likelihood = self.lanes.splat(1.0);
        }
    }

    #[inline(always)]
    pub fn finish(self) -> Vector<S> {
        if self.is_mixture { self.sum - self.lanes.ln(self.likelihood) } else { self.sum }
    }
}

impl<S: Simd> Lanes<S> {
    #[inline(always)]
    fn ln(self, x: Vector<S>) -> Vector<S> {
        let mut values = [1.0; LANES];
        x.store(&mut values, 0);
        for value in &mut values[..S::F64_LANES] {
            *value = value.ln();
        }
        Vector::load(self.simd, &values, 0)
    }

    /// Returns the angle of a direction: by its series, or by a rational function in lanes where it is
    /// not small.
    #[inline(always)]
    pub fn angle(self, sine: Vector<S>, cosine: Vector<S>) -> Vector<S> {
        let t = sine / cosine;
        let s = t * t;
        let mut sum = self.splat(0.0);
        for term in TERMS {
            sum = s * (self.splat(term) - sum);
        }
        let angle = t - t * sum;
        let small = sine.abs().at_most(self.splat(SMALL_TANGENT) * cosine);
        let is_small = self.splat(1.0).or(small, self.splat(0.0));
        if is_small.all_positive() {
            return angle;
        }
        let other = if self.cut { self.splat(f64::INFINITY) } else { self.any_angle(sine, cosine) };
        angle.or(small, other)
    }

    /// Returns `atan2(sine, cosine)`, accurate to two units in the last place.
    #[inline(always)]
    fn any_angle(self, sine: Vector<S>, cosine: Vector<S>) -> Vector<S> {
        let (zero, a, b) = (self.splat(0.0), sine.abs(), cosine.abs());
        let (less, more) = (a.min(b), a.max(b));
        // relative to π/4 if the tangent is large
        let small = less.at_most(self.splat(SMALLER_TANGENT) * more);
        let t = less.or(small, less - more) / more.or(small, less + more);
        let s = t * t;
        let (mut p, mut q) = (zero, zero);
        for term in P {
            p = p * s + self.splat(term);
        }
        for term in Q {
            q = q * s + self.splat(term);
        }
        let octant = zero.or(small, self.splat(FRAC_PI_4)) + (t + t * s * p / q);
        let quadrant = octant.or(a.at_most(b), self.splat(FRAC_PI_2) - octant);
        let half = quadrant.or(zero.at_most(cosine), self.splat(PI) - quadrant);
        half.or(zero.at_most(sine), -half)
    }
}
