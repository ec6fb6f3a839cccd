//! How far a track leans on a height that is not known exactly.
//!
//! Its filter knows position and velocity for one height; all plots without a height share the error
//! of that. Friedland's separation (1969) keeps the derivative of the state by the height beside the
//! filter: when the height becomes known better the state moves along it, and until then the variance
//! of the height adds to the covariance.

use super::estimate::Estimate;
use crate::base::plane::Plane;
use nalgebra::SVector;
use serde::{Deserialize, Serialize};

/// Derivatives of position and velocity by the height.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Lean([f64; 4]);

impl Lean {
    /// That of a first plot with this derivative.
    pub fn new([x, y]: [f64; 2]) -> Self {
        Self([x, y, 0.0, 0.0])
    }

    /// Derivative of the position, so many seconds later.
    #[inline]
    pub fn position(&self, t: f64) -> [f64; 2] {
        let [x, y, vx, vy] = self.0;
        [x + t * vx, y + t * vy]
    }

    /// How far the state moves with the height.
    pub fn step(&self, height: f64) -> SVector<f64, 4> {
        SVector::from(self.0) * height
    }

    #[inline]
    pub fn predict(&mut self, t: f64) {
        let [x, y] = self.position(t);
        (self.0[0], self.0[1]) = (x, y);
    }

    /// After a plot of noise `r`, whose innovation changes with the height by `by`: V − K by, with the
    /// gain K = P R⁻¹ of the corrected covariance P.
    pub fn correct(&mut self, after: &Estimate<4>, r: Plane, by: [f64; 2]) {
        let inverse = r.inverse();
        let a = inverse.xx * by[0] + inverse.xy * by[1];
        let b = inverse.xy * by[0] + inverse.yy * by[1];
        for i in 0..4 {
            self.0[i] -= after.covariance[(i, 0)] * a + after.covariance[(i, 1)] * b;
        }
    }

    /// Covariance of the velocity by that of the height.
    pub fn of_velocity(&self, variance: f64) -> Plane {
        along([self.0[2], self.0[3]], variance)
    }

    /// After a velocity of noise `r`: V − K V, as after a plot.
    pub fn take_velocity(&mut self, after: &Estimate<4>, r: Plane) {
        let inverse = r.inverse();
        let [_, _, vx, vy] = self.0;
        let (a, b) = (inverse.xx * vx + inverse.xy * vy, inverse.xy * vx + inverse.yy * vy);
        for i in 0..4 {
            self.0[i] -= after.covariance[(i, 2)] * a + after.covariance[(i, 3)] * b;
        }
    }

    /// Derivative of what depends so on the state.
    pub fn along(&self, row: &[f64; 4]) -> f64 {
        self.0.iter().zip(row).map(|(v, h)| v * h).sum()
    }

    /// After a residual of variance 1 that depends so on the state: V − K h V, with K = P h' of the
    /// corrected covariance P.
    pub fn see(&mut self, after: &Estimate<4>, row: &[f64; 4]) {
        let (gain, own) = (after.along(row).0, self.along(row));
        for (v, k) in self.0.iter_mut().zip(gain) {
            *v -= k * own;
        }
    }

    /// The estimate with the variance of the height.
    pub fn widened(&self, estimate: &Estimate<4>, variance: f64) -> Estimate<4> {
        let v = SVector::from(self.0);
        let covariance = estimate.covariance + v * v.transpose() * variance;
        Estimate { mean: estimate.mean, covariance }
    }
}

/// `variance · s s'`
#[inline]
pub(super) fn along([x, y]: [f64; 2], variance: f64) -> Plane {
    Plane { xx: variance * x * x, xy: variance * x * y, yy: variance * y * y }
}
