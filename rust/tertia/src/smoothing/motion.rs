//! Motion of a state from one instant to the next, with a random jerk.

// indices are those of the formulas
#![allow(clippy::needless_range_loop)]

use crate::base::small::Matrix as Square;

/// `x = F x`, `P = F P F' + Q` of the first `3 D` components: positions, velocities, accelerations.
///
/// What further components move by is the caller's; their rows and columns are moved along. `O(N²)`.
#[inline(always)]
pub(super) fn advance<const D: usize, const N: usize>(
    x: &mut [f64; N],
    p: &mut Square<N>,
    t: f64,
    jerk: f64,
) {
    let half = 0.5 * t * t;
    advance_row::<D, N>(x, t, half);
    for row in &mut *p {
        advance_row::<D, N>(row, t, half);
    }
    for i in 0..D {
        for c in 0..N {
            let (v, a) = (p[D + i][c], p[2 * D + i][c]);
            p[i][c] += t * v + half * a;
            p[D + i][c] += t * a;
        }
    }
    // an asymmetry of rounding grows: after 300 steps it cost the likelihood seven digits
    for r in 0..N {
        for c in 0..r {
            p[r][c] = p[c][r];
        }
    }
    let q = jerk * t;
    let (pp, pv, pa) = (q * t * t * t * t / 20.0, q * t * t * t / 8.0, q * t * t / 6.0);
    let (vv, va) = (q * t * t / 3.0, q * t / 2.0);
    for i in 0..D {
        p[i][i] += pp;
        p[i][D + i] += pv;
        p[D + i][i] += pv;
        p[i][2 * D + i] += pa;
        p[2 * D + i][i] += pa;
        p[D + i][D + i] += vv;
        p[D + i][2 * D + i] += va;
        p[2 * D + i][D + i] += va;
        p[2 * D + i][2 * D + i] += q;
    }
}

/// `F x`, where x is any row of positions, velocities and accelerations.
#[inline(always)]
pub(super) fn advance_row<const D: usize, const N: usize>(row: &mut [f64; N], t: f64, half: f64) {
    for i in 0..D {
        let (v, a) = (row[D + i], row[2 * D + i]);
        row[i] += t * v + half * a;
        row[D + i] += t * a;
    }
}
