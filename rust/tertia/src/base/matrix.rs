//! Covariance matrices, with an order that is known at compile time (on the stack) or not (`Dyn`).
//!
//! All comparisons are in units of the diagonal of the matrix, so the units of the components may differ
//! greatly in size.

use crate::base::error::{Error, Result};
use nalgebra::allocator::Allocator;
use nalgebra::{DMatrix, DefaultAllocator, Dim, OMatrix};

/// A matrix of order D.
pub(crate) type Square<D> = OMatrix<f64, D, D>;

/// Range of variances for which products of four standard deviations and their reciprocals remain finite.
const VARIANCES: std::ops::RangeInclusive<f64> = 1e-140..=1e140;
/// Largest difference of elements mirrored at the diagonal, in standard deviations.
pub(crate) const ASYMMETRY: f64 = 1e-10;
/// A matrix is semidefinite if its correlation matrix is, after this is added to the diagonal. It is
/// larger than the rounding error of a zero, and smaller than any measurement resolves.
const SEMIDEFINITE: f64 = 1e-13;
/// Smallest share of a variance that the other components must leave unexplained in a regular matrix.
const REGULAR: f64 = 1e-13;

/// Evaluates an expression with the order as a constant if it is small: the matrices are then on the
/// stack, and the evaluation is several times as fast.
macro_rules! with_order {
    ($dimension:expr, |$order:ident| $body:expr) => {
        $crate::base::matrix::with_order!($dimension, |$order| $body, 1 2 3 4 5 6 7 8 9)
    };
    ($dimension:expr, |$order:ident| $body:expr, $($small:literal)*) => {
        match $dimension {
            $($small => {
                let $order = nalgebra::Const::<$small>;
                $body
            })*
            large => {
                let $order = nalgebra::Dyn(large);
                $body
            }
        }
    };
}
pub(crate) use with_order;

pub(crate) fn zeros<D: Dim>(order: D) -> Square<D>
where
    DefaultAllocator: Allocator<D, D>,
{
    Square::zeros_generic(order, order)
}

/// Reads a covariance, named `argument[place]` in errors; both halves must agree. `factor` becomes its
/// factor as in [`factorise`], with a small addition to the diagonal.
pub(crate) fn read_covariance<D: Dim>(
    argument: &'static str,
    place: &[usize],
    values: &[f64],
    out: &mut Square<D>,
    factor: &mut Square<D>,
) -> Result<()>
where
    DefaultAllocator: Allocator<D, D>,
{
    let m = out.nrows();
    let at = |i: usize, j: usize| [place, &[i, j]].concat();
    let refuse = |i: usize, j: usize, requirement| {
        let value = values[i * m + j];
        Err(Error::InvalidElement { argument, index: at(i, j), value, requirement })
    };
    for i in 0..m {
        for j in 0..m {
            if !values[i * m + j].is_finite() {
                return refuse(i, j, "every element must be a finite number");
            }
        }
        if !VARIANCES.contains(&values[i * m + i]) {
            return refuse(i, i, "variances must be positive, between 1e-140 and 1e140");
        }
    }
    for j in 0..m {
        for i in 0..=j {
            let (upper, lower) = (values[i * m + j], values[j * m + i]);
            let mean = if upper == lower {
                upper
            } else {
                let scale = (values[i * m + i] * values[j * m + j]).sqrt();
                if (upper - lower).abs() > ASYMMETRY * scale {
                    let index = at(i, j);
                    return Err(Error::NotSymmetric { argument, index, upper, lower });
                }
                upper + 0.5 * (lower - upper)
            };
            (out[(i, j)], out[(j, i)]) = (mean, mean);
            (factor[(i, j)], factor[(j, i)]) = (mean, mean);
        }
        factor[(j, j)] *= 1.0 + SEMIDEFINITE;
    }
    if factorise(factor, 0.0) {
        Ok(())
    } else {
        Err(Error::Indefinite { argument, index: place.to_vec() })
    }
}

/// `A = L D L^T` in place, D on the diagonal, L (unit lower) below it; the upper half is unchanged.
/// Returns false if a pivot is not above `floor` times its diagonal element. Cost m³/3.
fn factorise<D: Dim>(a: &mut Square<D>, floor: f64) -> bool
where
    DefaultAllocator: Allocator<D, D>,
{
    let m = a.nrows();
    for j in 0..m {
        let variance = a[(j, j)];
        for p in 0..j {
            let f = a[(j, p)] * a[(p, p)];
            for i in j..m {
                a[(i, j)] -= f * a[(i, p)];
            }
        }
        let pivot = a[(j, j)];
        if pivot.is_nan() || pivot <= floor * variance {
            return false;
        }
        let reciprocal = 1.0 / pivot;
        for i in j + 1..m {
            a[(i, j)] *= reciprocal;
        }
    }
    true
}

/// Converts a factor from [`factorise`] to the lower triangle `L √D`.
pub(crate) fn into_cholesky<D: Dim>(factor: &mut Square<D>)
where
    DefaultAllocator: Allocator<D, D>,
{
    let m = factor.nrows();
    for j in 0..m {
        let root = factor[(j, j)].sqrt();
        for i in 0..j {
            factor[(i, j)] = 0.0;
        }
        factor[(j, j)] = root;
        for i in j + 1..m {
            factor[(i, j)] *= root;
        }
    }
}

/// Computes the factor of `x + y` as [`factorise`]; false if the sum is singular to working precision.
pub(crate) fn factorise_sum<D: Dim>(x: &Square<D>, y: &Square<D>, factor: &mut Square<D>) -> bool
where
    DefaultAllocator: Allocator<D, D>,
{
    factor.copy_from(x);
    *factor += y;
    factorise(factor, REGULAR)
}

/// Inverts a factorised matrix; the inverse is exactly symmetric. `factor` is overwritten. Cost m³.
pub(crate) fn invert<D: Dim>(factor: &mut Square<D>, out: &mut Square<D>)
where
    DefaultAllocator: Allocator<D, D>,
{
    let m = factor.nrows();
    // N = L^-1 in place of L
    for j in 0..m {
        for i in j + 1..m {
            factor[(i, j)] = -factor[(i, j)];
        }
        for p in j + 1..m {
            let f = factor[(p, j)];
            for i in p + 1..m {
                factor[(i, j)] -= f * factor[(i, p)];
            }
        }
    }
    // N^T D^-1 N
    for p in 0..m {
        let reciprocal = 1.0 / factor[(p, p)];
        for j in 0..=p {
            let f = if j == p { reciprocal } else { factor[(p, j)] * reciprocal };
            for i in 0..=j {
                let n = if i == p { 1.0 } else { factor[(p, i)] };
                out[(i, j)] = if j == p { n * f } else { out[(i, j)] + n * f };
            }
        }
    }
    for j in 0..m {
        for i in 0..j {
            out[(j, i)] = out[(i, j)];
        }
    }
}

/// Whether the other components leave enough of the variance of every component of `x + y` unexplained:
/// this share is the reciprocal of the variance times that of the inverse.
pub(crate) fn is_regular<D: Dim>(x: &Square<D>, y: &Square<D>, inverse: &Square<D>) -> bool
where
    DefaultAllocator: Allocator<D, D>,
{
    (0..x.nrows()).all(|i| REGULAR * (x[(i, i)] + y[(i, i)]) * inverse[(i, i)] < 1.0)
}

/// `b ← D^-1/2 L^-1 b` for a factorised matrix.
pub(crate) fn half_solve<D: Dim>(factor: &Square<D>, b: &mut Square<D>)
where
    DefaultAllocator: Allocator<D, D>,
{
    let m = factor.nrows();
    for j in 0..m {
        for p in 0..m {
            let f = b[(p, j)];
            for i in p + 1..m {
                b[(i, j)] -= factor[(i, p)] * f;
            }
        }
    }
    for p in 0..m {
        let scale = 1.0 / factor[(p, p)].sqrt();
        for j in 0..m {
            b[(p, j)] *= scale;
        }
    }
}

/// Whether a matrix that was computed from others is a covariance apart from rounding.
pub(crate) fn is_semidefinite<D: Dim>(a: &Square<D>, factor: &mut Square<D>) -> bool
where
    DefaultAllocator: Allocator<D, D>,
{
    factor.copy_from(a);
    for i in 0..a.nrows() {
        factor[(i, i)] *= 1.0 + SEMIDEFINITE;
    }
    factorise(factor, 0.0)
}

/// Assembles blocks of order m, row by row, into one large matrix.
pub(crate) fn assembled<D: Dim>(blocks: &[Square<D>], m: usize) -> DMatrix<f64>
where
    DefaultAllocator: Allocator<D, D>,
{
    let count = blocks.len().isqrt();
    let mut out = large(count * m);
    for (at, block) in blocks.iter().enumerate() {
        for (i, j) in (0..m).flat_map(|i| (0..m).map(move |j| (i, j))) {
            out[(at / count * m + i, at % count * m + j)] = block[(i, j)];
        }
    }
    out
}

/// Returns a matrix of zeros whose order differs from that of the covariances.
pub(crate) fn large(order: usize) -> DMatrix<f64> {
    DMatrix::zeros(order, order)
}

/// [`is_semidefinite`] for a large matrix.
pub(crate) fn is_large_semidefinite(a: &DMatrix<f64>) -> bool {
    is_semidefinite(a, &mut large(a.nrows()))
}

/// `b ← A^-1 b` for a symmetric A, whose lower half is read and overwritten; returns false if A is not
/// positive definite.
pub(crate) fn solve_definite(a: &mut DMatrix<f64>, b: &mut [f64]) -> bool {
    if !factorise(a, 0.0) {
        return false;
    }
    for p in 0..b.len() {
        for i in p + 1..b.len() {
            b[i] -= a[(i, p)] * b[p];
        }
    }
    for p in (0..b.len()).rev() {
        b[p] /= a[(p, p)];
        for i in p + 1..b.len() {
            b[p] -= a[(i, p)] * b[i];
        }
    }
    true
}

/// Inverse of a square matrix, by elimination of columns with exchanges; none if the matrix is singular. With some
/// twenty rows it takes about half the time of `try_inverse`, whose loops are over views.
pub(crate) fn inverse(a: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let n = a.nrows();
    let mut found = a.clone();
    let mut pivots = Vec::with_capacity(n);
    for row in 0..n {
        let size = |column: &usize| found[(row, *column)].abs();
        let pivot = (row..n).max_by(|i, j| size(i).total_cmp(&size(j)))?;
        found.swap_columns(row, pivot);
        pivots.push(pivot);
        let (before, rest) = found.as_mut_slice().split_at_mut(row * n);
        let (own, after) = rest.split_at_mut(n);
        let reciprocal = 1.0 / std::mem::replace(&mut own[row], 1.0);
        if !reciprocal.is_finite() {
            return None;
        }
        own.iter_mut().for_each(|value| *value *= reciprocal);
        for other in before.chunks_exact_mut(n).chain(after.chunks_exact_mut(n)) {
            let share = std::mem::take(&mut other[row]);
            other.iter_mut().zip(&*own).for_each(|(value, own)| *value -= share * own);
        }
    }
    for (row, pivot) in pivots.into_iter().enumerate().rev() {
        found.swap_rows(row, pivot);
    }
    Some(found)
}

/// Replaces a matrix by its mean with its transpose.
pub(crate) fn symmetrise<D: Dim>(a: &mut Square<D>)
where
    DefaultAllocator: Allocator<D, D>,
{
    for j in 0..a.nrows() {
        for i in 0..j {
            let mean = 0.5 * (a[(i, j)] + a[(j, i)]);
            (a[(i, j)], a[(j, i)]) = (mean, mean);
        }
    }
}

/// Writes a matrix row by row.
pub(crate) fn write<D: Dim>(a: &Square<D>, out: &mut [f64])
where
    DefaultAllocator: Allocator<D, D>,
{
    let m = a.nrows();
    for (i, row) in out.chunks_exact_mut(m).enumerate() {
        for (j, value) in row.iter_mut().enumerate() {
            *value = a[(i, j)];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_inverse_needs_exchanges_of_columns() {
        let a = DMatrix::from_row_slice(3, 3, &[0.0, 2.0, 1.0, 1.0, 0.0, 3.0, 4.0, 5.0, 0.0]);
        let found = inverse(&a).unwrap();
        assert!((&a * &found - DMatrix::identity(3, 3)).amax() < 1e-15);
        assert!((found - a.try_inverse().unwrap()).amax() < 1e-15);
        assert_eq!(inverse(&DMatrix::from_row_slice(2, 2, &[1.0, 2.0, 2.0, 4.0])), None);
        assert_eq!(inverse(&DMatrix::from_element(1, 1, f64::NAN)), None);
    }
}
