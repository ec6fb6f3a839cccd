//! Errors of a radar that have changed suddenly, by the likelihood of the last scans.

use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

/// Odds that a change needs.
const ODDS: f64 = 1e6;

/// What one scan said of the errors, and what was known before it.
#[derive(Clone, Debug, Serialize, Deserialize, PartialEq)]
pub(super) struct Scan {
    pub time: f64,
    pub information: DMatrix<f64>,
    /// About errors of zero.
    pub score: DVector<f64>,
    pub mean: DVector<f64>,
    pub covariance: DMatrix<f64>,
}

/// The first scan after a change of the errors of a radar, by so many standard deviations of the
/// prior, and this radar; `own` are its columns.
pub(super) fn changed(recent: &[Scan], own: &[Vec<usize>], size: f64) -> Option<(usize, usize)> {
    let order = recent.first()?.mean.len();
    let (mut information, mut score) = (DMatrix::zeros(order, order), DVector::zeros(order));
    let mut best: Option<(f64, usize, usize)> = None;
    for (i, scan) in recent.iter().enumerate().rev() {
        information += &scan.information;
        score += &scan.score;
        let off = &score - &information * &scan.mean;
        let sum = DMatrix::identity(order, order) + &information * &scan.covariance;
        let Some(inverse) = sum.try_inverse() else { continue };
        let (g, t) = (&inverse * off, &inverse * &information);
        for (k, columns) in own.iter().enumerate().filter(|(_, columns)| !columns.is_empty()) {
            let g = DVector::from_iterator(columns.len(), columns.iter().map(|&c| g[c]));
            let t = t.select_rows(columns).select_columns(columns);
            let jump = size * size;
            let m = DMatrix::identity(columns.len(), columns.len()) + jump * t;
            let Some(inverse) = m.clone().try_inverse() else { continue };
            let odds = 0.5 * jump * g.dot(&(inverse * &g)) - 0.5 * m.determinant().ln();
            if odds > ODDS.ln() && best.is_none_or(|(most, ..)| odds > most) {
                best = Some((odds, i, k));
            }
        }
    }
    best.map(|(_, from, radar)| (from, radar))
}
