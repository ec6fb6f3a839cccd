//! Cholesky factors of covariances.

use crate::base::small::{Matrix, REGULAR};

/// The Cholesky factor of a symmetric matrix, with the reciprocals of its diagonal.
pub(super) struct Root<const D: usize> {
    lower: Matrix<D>,
    reciprocal: [f64; D],
}

impl<const D: usize> Root<D> {
    /// The factor of a matrix; none if the matrix is singular.
    #[inline]
    pub fn new(a: &Matrix<D>) -> Option<Self> {
        let (mut lower, mut reciprocal) = ([[0.0; D]; D], [0.0; D]);
        for i in 0..D {
            let mut pivot = a[i][i];
            for j in 0..i {
                let (own, other, mut sum) = (lower[i], lower[j], a[i][j]);
                for k in 0..j {
                    sum -= own[k] * other[k];
                }
                lower[i][j] = sum * reciprocal[j];
                pivot -= lower[i][j] * lower[i][j];
            }
            if pivot.is_nan() || pivot <= REGULAR * a[i][i] {
                return None;
            }
            reciprocal[i] = pivot.sqrt().recip();
        }
        Some(Self { lower, reciprocal })
    }

    /// Replaces B by `L⁻¹ B`.
    #[inline]
    pub fn whiten<const N: usize>(&self, b: &mut [[f64; N]; D]) {
        for i in 0..D {
            let (mut row, factors) = (b[i], self.lower[i]);
            for k in 0..i {
                let (factor, other) = (factors[k], b[k]);
                for j in 0..N {
                    row[j] -= factor * other[j];
                }
            }
            for x in &mut row {
                *x *= self.reciprocal[i];
            }
            b[i] = row;
        }
    }

    /// `|A|⁻½`
    #[inline]
    pub fn density(&self) -> f64 {
        self.reciprocal.iter().product()
    }
}
