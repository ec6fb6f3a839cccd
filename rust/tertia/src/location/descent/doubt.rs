//! Contribution of doubtful measurements, which may be faults, to the covariance of a robust position.
//!
//! Tukey's weights are a compromise between leaving a measurement out and using it. If its residual
//! does not show which is right, the position may be wrong by the difference between the two, which
//! `(J^T W J)^-1` does not include. With a flat density of faults, the probability π of a fault follows
//! from the residual of the measurement from the position without it. Averaging over both hypotheses
//! (Hoeting, Madigan, Raftery, Volinsky 1999) adds `π (1 − π) d d^T`, where d is the shift of the
//! position between them.

use crate::base::small::{Matrix, Vector, add_outer, dot};
use crate::sensors::Row;

/// −ln of `ε/(1 − ε) √(2π)/s` for a share ε = 1 % of faults that are evenly spread over s = 100 σ.
pub(in crate::location) const EVIDENCE: f64 = 8.28;
/// Factor of the added term. The average over all sizes of faults is too small for the faults that are
/// hardest to detect, those of four to five sigmas. With this factor, normalised errors are at most 1.3
/// for faults of five sigmas.
pub(in crate::location) const SAFETY: f64 = 6.0;
/// Share of a measurement in its own prediction from which on no other measurement checks it.
const UNCHECKED: f64 = 1.0 - 1e-6;

/// Returns `c Σ π_i (1 − π_i) d_i d_i^T` from rows of unit variance, each with its weight and `−ln` of
/// the odds of a fault before its size is known, and from `(J^T W J)^-1`. O(M).
pub(in crate::location) fn doubt<const D: usize>(
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
        // without the measurement, the residual is r / (1 − w h), its variance 1 + h / (1 − w h)
        let share = (1.0 - own) * (1.0 - own + leverage);
        let odds = (0.5 * residual * residual / share - evidence).exp();
        let probability = odds / (1.0 + odds);
        let spread = SAFETY * probability / (1.0 + odds);
        if spread.is_nan() {
            // certainly a fault
            continue;
        }
        // between weights 0 and 1 the position moves by (J^T W J)^-1 j r / share
        let shift = residual / share;
        add_outer(&mut sum, spread * shift * shift, &gain);
    }
    sum
}
