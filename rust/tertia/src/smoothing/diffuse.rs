//! Exact results of a smoother that starts with an unknown state, from those of one that starts with a vague
//! state.

// indices are those of the formulas
#![allow(clippy::needless_range_loop)]

use super::components::axes;
use crate::base::small::{Matrix as Square, dot, product};

/// Share of the information of the plots about the first state that must remain after rounding.
const LEAST_PIVOT: f64 = 1e-11;

/// Removes the information of the start, exactly (de Jong 1991): with the smoothed responses `B` to the first
/// state and Λ and λ of the first instant, `B Λ^-1 B'` and `B Λ^-1 λ` are added. Cost O(N D³).
pub(super) fn forget_start<const N: usize>(
    answers: &[Square<N>],
    l: &[f64; N],
    big: &Square<N>,
    (mean, covariance): (&mut [f64], &mut [f64]),
) {
    let states = 3 * axes(N);
    let scale: [f64; N] = std::array::from_fn(|i| big[i][i].sqrt());
    let mut factor = [[0.0; N]; N];
    let mut white = [0.0; N];
    for i in 0..states {
        for j in 0..=i {
            let value = big[i][j] / (scale[i] * scale[j]) - dot(&factor[i], &factor[j]);
            if i > j {
                factor[i][j] = value / factor[j][j];
            } else if value > LEAST_PIVOT {
                factor[i][i] = value.sqrt();
            } else {
                // the plots do not determine the path, or the start is not vague
                return;
            }
        }
        white[i] = (l[i] / scale[i] - dot(&factor[i], &white)) / factor[i][i];
    }
    for (k, answer) in answers.iter().enumerate() {
        // columns of B L'^-1
        let mut columns = [[0.0; N]; N];
        for c in 0..states {
            for r in 0..states {
                let inner: f64 = (0..c).map(|j| factor[c][j] * columns[j][r]).sum();
                columns[c][r] = (answer[c][r] / scale[c] - inner) / factor[c][c];
            }
        }
        let shift = product(&columns, &white);
        for r in 0..states {
            let at = k * states + r;
            mean[at] += shift[r];
            let row: [f64; N] = std::array::from_fn(|c| columns[c][r]);
            let more = product(&columns, &row);
            for q in 0..states {
                covariance[at * states + q] += more[q];
            }
        }
    }
}

/// Updates a response to the first state by a plot, `(I − K H) a`, with `P H'`, `H` and the variances of its
/// components.
pub(super) fn update<const M: usize, const N: usize>(
    answer: &mut [f64; N],
    (ph, h, s): (&[[f64; N]; M], &[[f64; N]; M], &[f64; M]),
) {
    for i in (0..M).filter(|&i| s[i] > 0.0) {
        // most elements of h are zero
        let seen = (0..N).filter(|&c| h[i][c] != 0.0);
        let along = seen.map(|c| h[i][c] * answer[c]).sum::<f64>() / s[i];
        for r in 0..N {
            answer[r] -= ph[i][r] * along;
        }
    }
}

/// Updates a response to the first state by all later plots: `(I − P Λ) a`.
pub(super) fn smooth<const N: usize>(answer: &mut [f64; N], p: &Square<N>, big: &Square<N>) {
    let change = product(p, &product(big, answer));
    for r in 0..N {
        answer[r] -= change[r];
    }
}
