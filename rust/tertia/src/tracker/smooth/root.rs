//! Roots of covariances.

use crate::base::small::{Matrix, REGULAR};

/// The Cholesky factor of a symmetric matrix, with the reciprocals of its diagonal.
pub(super) struct Root<const D: usize> {
    lower: Matrix<D>,
    reciprocal: [f64; D],
}

impl<const D: usize> Root<D> {
    /// None where the matrix is singular.
    #[inline]
    pub fn new(a: &Matrix<D>) -> Option<Self> {
        let (mut lower, mut reciprocal) = ([[0.0; D]; D], [0.0; D]);
        for i in 0..D {
            let mut pivot = a[i][i];
            for j in 0..i {
                let mut sum = a[i][j];
                for k in 0..j {
                    sum -= lower[i][k] * lower[j][k];
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

    /// `L⁻¹ B` in place of B.
    #[inline]
    pub fn whiten<const N: usize>(&self, b: &mut [[f64; N]; D]) {
        for i in 0..D {
            for k in 0..i {
                for j in 0..N {
                    b[i][j] -= self.lower[i][k] * b[k][j];
                }
            }
            for x in &mut b[i] {
                *x *= self.reciprocal[i];
            }
        }
    }

    /// `|A|⁻½`
    #[inline]
    pub fn density(&self) -> f64 {
        self.reciprocal.iter().product()
    }
}
