//! Symmetric 2×2 matrices in the plane of east and north.

use serde::{Deserialize, Serialize};

/// Symmetric 2×2 matrix in the plane of east and north.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Plane {
    /// Variance east.
    pub xx: f64,
    /// Covariance of east and north.
    pub xy: f64,
    /// Variance north.
    pub yy: f64,
}

impl Plane {
    pub(crate) fn plus(self, other: Self) -> Self {
        Self { xx: self.xx + other.xx, xy: self.xy + other.xy, yy: self.yy + other.yy }
    }

    pub(crate) fn scaled(self, by: f64) -> Self {
        Self { xx: by * self.xx, xy: by * self.xy, yy: by * self.yy }
    }

    pub(crate) fn determinant(self) -> f64 {
        self.xx * self.yy - self.xy * self.xy
    }

    /// The inverse; the caller ensures that the matrix is positive definite.
    pub(crate) fn inverse(self) -> Self {
        let scale = 1.0 / self.determinant();
        Self { xx: self.yy * scale, xy: -self.xy * scale, yy: self.xx * scale }
    }

    /// `v' M v`
    pub(crate) fn form(self, v: [f64; 2]) -> f64 {
        self.xx * v[0] * v[0] + 2.0 * self.xy * v[0] * v[1] + self.yy * v[1] * v[1]
    }

    /// `M v`
    pub(crate) fn times(self, [x, y]: [f64; 2]) -> [f64; 2] {
        [self.xx * x + self.xy * y, self.xy * x + self.yy * y]
    }
}
