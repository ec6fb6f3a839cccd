//! How the state of a track depends on a height that is not known exactly.
//!
//! The filter estimates position and velocity for one assumed height, whose error is common to all plots
//! without a height. By Friedland's separation (1969), the derivative of the state with respect to the height
//! is kept beside the filter: when the height becomes better known, the state moves along this derivative,
//! and until then the variance of the height adds to the covariance.

use super::estimate::Estimate;
use crate::base::plane::Plane;
use crate::registration::restrain;
use nalgebra::SVector;
use serde::{Deserialize, Serialize};

/// Largest gain of a plot: with a larger one, the derivatives would grow from plot to plot.
const LARGEST: f64 = 2.0;

/// Derivatives of position and velocity with respect to the height.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Lean([f64; 4]);

impl Lean {
    /// The derivatives after a first plot, whose position has this derivative.
    pub fn new([x, y]: [f64; 2]) -> Self {
        Self([x, y, 0.0, 0.0])
    }

    /// Derivative of the position, `t` seconds later.
    #[inline]
    pub fn position(&self, t: f64) -> [f64; 2] {
        let [x, y, vx, vy] = self.0;
        [x + t * vx, y + t * vy]
    }

    /// Change of the state that corresponds to a change of the height.
    pub fn step(&self, height: f64) -> SVector<f64, 4> {
        SVector::from(self.0) * height
    }

    #[inline]
    pub fn predict(&mut self, t: f64) {
        let [x, y] = self.position(t);
        (self.0[0], self.0[1]) = (x, y);
    }

    /// Updates after a plot of noise `r` whose innovation has the derivative `by` with respect to the height:
    /// V − K by, with the gain K = P R⁻¹ of the corrected covariance P. As several models have no single gain,
    /// it is limited.
    pub fn correct(&mut self, after: &Estimate<4>, r: Plane, by: [f64; 2]) {
        let (inverse, [p, q, ..]) = (r.inverse(), after.covariance.data.0);
        let gain_of = |east: f64, north: f64| std::array::from_fn(|i| p[i] * east + q[i] * north);
        let mut gain = [gain_of(inverse.xx, inverse.xy), gain_of(inverse.xy, inverse.yy)];
        restrain(&mut gain, 0, LARGEST);
        for (own, (east, north)) in self.0.iter_mut().zip(gain[0].iter().zip(&gain[1])) {
            *own -= east * by[0] + north * by[1];
        }
    }

    /// Covariance of the velocity that is due to this variance of the height.
    pub fn of_velocity(&self, variance: f64) -> Plane {
        along([self.0[2], self.0[3]], variance)
    }

    /// Updates after a velocity of noise `r`: V − K V, as after a plot.
    pub fn take_velocity(&mut self, after: &Estimate<4>, r: Plane) {
        let inverse = r.inverse();
        let [_, _, vx, vy] = self.0;
        let (a, b) = (inverse.xx * vx + inverse.xy * vy, inverse.xy * vx + inverse.yy * vy);
        for i in 0..4 {
            self.0[i] -= after.covariance[(i, 2)] * a + after.covariance[(i, 3)] * b;
        }
    }

    /// Derivative, with respect to the height, of a quantity whose gradient with respect to the state is
    /// `row`.
    pub fn along(&self, row: &[f64; 4]) -> f64 {
        self.0.iter().zip(row).map(|(v, h)| v * h).sum()
    }

    /// Updates after a residual of variance 1 whose gradient with respect to the state is h, in `row`:
    /// V − K h V, with K = P h' of the corrected covariance P.
    pub fn see(&mut self, after: &Estimate<4>, row: &[f64; 4]) {
        let (gain, own) = (after.along(row).0, self.along(row));
        for (v, k) in self.0.iter_mut().zip(gain) {
            *v -= k * own;
        }
    }

    /// The estimate with the variance of the height in its covariance.
    pub fn widened(&self, estimate: &Estimate<4>, variance: f64) -> Estimate<4> {
        let v = SVector::from(self.0);
        let covariance = estimate.covariance + v * v.transpose() * variance;
        Estimate { mean: estimate.mean, covariance }
    }
}

/// `variance · s s'`
#[inline]
pub(in crate::tracker) fn along([x, y]: [f64; 2], variance: f64) -> Plane {
    Plane { xx: variance * x * x, xy: variance * x * y, yy: variance * y * y }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::SMatrix;

    /// The positions of two models may differ by many times the noise of a precise plot.
    #[test]
    fn several_models_that_differ_do_not_lean_farther_and_farther() {
        let spread = SVector::from([40.0, 30.0, 0.0, 0.0]);
        let covariance = SMatrix::identity() + spread * spread.transpose();
        let after = Estimate { mean: SVector::zeros(), covariance };
        let (noise, of_plots) = (Plane { xx: 25.0, xy: 0.0, yy: 2.0 }, [-0.4, 0.2]);
        let mut lean = Lean::default();
        for _ in 0..50 {
            let [x, y] = lean.position(0.0);
            lean.correct(&after, noise, [x - of_plots[0], y - of_plots[1]]);
            assert!(lean.position(0.0).iter().all(|v| v.abs() < 5.0), "{lean:?}");
        }
    }
}
