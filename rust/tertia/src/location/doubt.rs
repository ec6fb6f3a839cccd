//! What measurements that may be faults add to the covariance of a robust position.
//!
//! Tukey's weights are a compromise between leaving a measurement out and believing it. Where its
//! residual does not tell which is right, the position may be wrong by what lies between the two,
//! and `(J^T W J)^-1` does not know. With a flat density of faults the probability of one follows
//! from the residual that the measurement has when it is left out, and averaging over both
//! hypotheses (Hoeting, Madigan, Raftery, Volinsky 1999) adds `π (1 − π) d d^T`, d the shift of
//! the position between them.

use crate::base::small::{Matrix, Vector, dot};
use crate::sensors::Row;

/// −ln of `ε/(1 − ε) √(2π)/s`: a share ε = 1 % of faults, spread evenly over s = 100 σ.
pub(super) const EVIDENCE: f64 = 8.28;
/// The average over all sizes of a fault is too little for the one that hides best, of four to
/// five sigmas. So many times the spread make normalised errors of at most 1.3 of five sigmas.
pub(super) const SAFETY: f64 = 6.0;
/// Share of a measurement in its own prediction from which on nothing else checks it.
const UNCHECKED: f64 = 1.0 - 1e-6;

/// `c Σ π_i (1 − π_i) d_i d_i^T` from the rows of unit variance, their weights, `−ln` of the odds of
/// a fault before its size is known, and `(J^T W J)^-1`. O(M).
pub(super) fn doubt<const D: usize>(
    rows: impl Iterator<Item = (Row<D>, f64, f64)>,
    inverse: &Matrix<D>,
) -> Matrix<D> {
    let mut sum = [[0.0; D]; D];
    for (Row { residual, gradient }, weight, evidence) in rows {
        // (J^T W J)^-1 j and j^T (J^T W J)^-1 j
        let mut gain: Vector<D> = [0.0; D];
        for i in 0..D {
            gain[i] = dot(&inverse[i], &gradient);
        }
        let leverage = dot(&gain, &gradient);
        let own = weight * leverage;
        if own >= UNCHECKED {
            continue;
        }
        // left out, the residual is r / (1 − w h), its variance 1 + h / (1 − w h)
        let share = (1.0 - own) * (1.0 - own + leverage);
        let odds = (0.5 * residual * residual / share - evidence).exp();
        let probability = odds / (1.0 + odds);
        let spread = SAFETY * probability / (1.0 + odds);
        if spread.is_nan() {
            // beyond doubt
            continue;
        }
        // between no weight and weight 1 the position moves by (J^T W J)^-1 j r / share
        let shift = residual / share;
        for i in 0..D {
            for j in 0..D {
                sum[i][j] += spread * shift * shift * gain[i] * gain[j];
            }
        }
    }
    sum
}
