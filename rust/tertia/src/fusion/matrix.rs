//! 3 × 3 matrices of the filters, and the best linear combination of correlated estimates.

use crate::kalman::Transition;
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

/// A pivot below this share of its diagonal element counts as zero: until each radar has three plots,
/// two tracks differ in fewer than three components.
const ZERO_PIVOT: f64 = 1e-9;

pub(super) fn full(p: &[f64; 6]) -> Matrix3<f64> {
    let [p00, p01, p02, p11, p12, p22] = *p;
    Matrix3::new(p00, p01, p02, p01, p11, p12, p02, p12, p22)
}

pub(super) fn packed(p: &Matrix3<f64>) -> [f64; 6] {
    let mean = |i: usize, j: usize| 0.5 * (p[(i, j)] + p[(j, i)]);
    [p[(0, 0)], mean(0, 1), mean(0, 2), p[(1, 1)], mean(1, 2), p[(2, 2)]]
}

/// Returns F and Q.
pub(super) fn matrices(transition: &Transition) -> (Matrix3<f64>, Matrix3<f64>) {
    let [f01, f02, f12, f22] = transition.f;
    (Matrix3::new(1.0, f01, f02, 0.0, 1.0, f12, 0.0, 0.0, f22), full(&transition.q))
}

/// The weights W_i of the combination `Σ W_i x_i` with the least covariance, for estimates whose
/// joint covariance has the blocks `joint(i, j)`.
///
/// With `Δ_i = x_i − x_1`, the combination is `x_1 − cov(x_1, Δ) cov(Δ)^+ Δ`.
pub(super) fn best_weights(
    count: usize,
    joint: impl Fn(usize, usize) -> Matrix3<f64>,
    out: &mut [Matrix3<f64>],
) {
    out[0] = Matrix3::identity();
    if count == 1 {
        return;
    }
    let n = 3 * (count - 1);
    let mut spread = DMatrix::zeros(n, n);
    let mut cross = DMatrix::zeros(n, 3);
    let first = joint(0, 0);
    for i in 1..count {
        let with_first = joint(i, 0);
        cross.fixed_view_mut::<3, 3>(3 * (i - 1), 0).copy_from(&(with_first - first));
        for j in 1..count {
            let block = joint(i, j) - with_first - joint(0, j) + first;
            spread.fixed_view_mut::<3, 3>(3 * (i - 1), 3 * (j - 1)).copy_from(&block);
        }
    }
    let solved = solve_semidefinite(&spread, &cross);
    for i in 1..count {
        let weight = -solved.fixed_view::<3, 3>(3 * (i - 1), 0).transpose();
        out[0] -= weight;
        out[i] = weight;
    }
}

/// Returns an X with `A X = B` for a semidefinite A, computed in units of its diagonal; components
/// that A does not determine are zero.
fn solve_semidefinite(a: &DMatrix<f64>, b: &DMatrix<f64>) -> DMatrix<f64> {
    let n = a.nrows();
    let scale = DVector::from_fn(n, |i, _| {
        let variance = a[(i, i)];
        if variance > 0.0 { 1.0 / variance.sqrt() } else { 0.0 }
    });
    let mut l = DMatrix::from_fn(n, n, |i, j| 0.5 * (a[(i, j)] + a[(j, i)]) * scale[i] * scale[j]);
    let mut x = DMatrix::from_fn(n, b.ncols(), |i, j| b[(i, j)] * scale[i]);
    // L D L^T in place; components without a pivot are skipped
    for j in 0..n {
        for p in 0..j {
            let f = l[(j, p)] * l[(p, p)];
            for i in j..n {
                l[(i, j)] -= f * l[(i, p)];
            }
        }
        let pivot = l[(j, j)];
        let kept = pivot > ZERO_PIVOT;
        l[(j, j)] = if kept { pivot } else { 0.0 };
        for i in j + 1..n {
            l[(i, j)] = if kept { l[(i, j)] / pivot } else { 0.0 };
        }
    }
    for mut column in x.column_iter_mut() {
        for j in 0..n {
            for i in j + 1..n {
                column[i] -= l[(i, j)] * column[j];
            }
        }
        for j in 0..n {
            column[j] = if l[(j, j)] > 0.0 { column[j] / l[(j, j)] } else { 0.0 };
        }
        for j in (0..n).rev() {
            for i in j + 1..n {
                column[j] -= l[(i, j)] * column[i];
            }
        }
        // components without a pivot are zero
        for j in 0..n {
            column[j] *= if l[(j, j)] > 0.0 { scale[j] } else { 0.0 };
        }
    }
    x
}

/// Difference of two vectors; the difference of the first component is wrapped.
pub(super) fn difference(
    x: &Vector3<f64>,
    from: &Vector3<f64>,
    period: Option<f64>,
) -> Vector3<f64> {
    let mut difference = x - from;
    difference[0] = crate::kalman::residual(x[0], from[0], period);
    difference
}
