//! Detection of sudden changes of the errors of a radar by likelihood ratios.

use super::gaussian::scaled;
use crate::base::matrix::{inverse, solve_definite};
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

/// Odds from which a change is accepted.
pub(super) const ODDS: f64 = 1e6;
/// Odds between two radars up to which either may have changed.
const RIVAL: f64 = 20.0;

/// Information of one scan about the errors, and their estimate before it.
#[derive(Clone, Debug, Serialize, Deserialize, PartialEq)]
pub(super) struct Scan {
    pub time: f64,
    pub information: DMatrix<f64>,
    /// Score about errors of zero.
    pub score: DVector<f64>,
    pub mean: DVector<f64>,
    pub covariance: DMatrix<f64>,
}

impl Scan {
    /// Multiplies its information, and that from which the errors before it were estimated, by a factor.
    pub fn scale(&mut self, factor: f64) {
        self.information *= factor;
        self.score *= factor;
        if let Some(covariance) = scaled(&self.covariance, factor) {
            self.covariance = covariance;
        }
    }
}

/// Discrepancy between new information about the errors and their estimate before it.
pub(super) struct Surprise {
    score: DVector<f64>,
    information: DMatrix<f64>,
}

impl Surprise {
    /// From errors with this mean and covariance, and the information and score about errors of zero. None if
    /// they cannot be compared.
    pub fn new(
        (mean, covariance): (&DVector<f64>, &DMatrix<f64>),
        (information, score): (&DMatrix<f64>, &DVector<f64>),
    ) -> Option<Self> {
        let order = mean.len();
        let off = score - information * mean;
        let sum = DMatrix::identity(order, order) + information * covariance;
        let inverse = inverse(&sum)?;
        Some(Self { score: &inverse * off, information: inverse * information })
    }

    /// Returns ln of the odds that the errors in these columns have changed in between by about `size`
    /// standard deviations of the prior, and the largest change of one of them that is then expected.
    pub fn odds(&self, columns: &[usize], size: f64) -> Option<(f64, f64)> {
        if columns.is_empty() {
            return None;
        }
        let g = DVector::from_iterator(columns.len(), columns.iter().map(|&c| self.score[c]));
        let jump = size * size;
        let element = |i: usize, j: usize| jump * self.information[(columns[i], columns[j])];
        let mut sum = DMatrix::from_fn(columns.len(), columns.len(), element);
        (0..columns.len()).for_each(|i| sum[(i, i)] += 1.0);
        let mut expected = jump * &g;
        if !solve_definite(&mut sum, expected.as_mut_slice()) {
            return None;
        }
        let ln_determinant: f64 = sum.diagonal().iter().map(|pivot| pivot.ln()).sum();
        Some((0.5 * g.dot(&expected) - 0.5 * ln_determinant, expected.amax()))
    }
}

/// A sudden change of the errors of a radar.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Change {
    /// The first scan after it.
    pub from: usize,
    /// The radars whose errors may have changed, the likeliest first: only the difference between the clocks of
    /// two radars is observed, for example.
    pub radars: Vec<usize>,
    /// Size in standard deviations of the prior, which counts if several radars may have changed: what they have
    /// in common is not observed.
    pub size: f64,
}

/// Returns the likeliest change by about `size` standard deviations of the prior; `own` holds the columns of
/// each radar.
pub(super) fn changed(recent: &[Scan], own: &[Vec<usize>], size: f64) -> Option<Change> {
    let order = recent.first()?.mean.len();
    let (mut information, mut score) = (DMatrix::zeros(order, order), DVector::zeros(order));
    let mut best: Option<(f64, Change)> = None;
    for (from, scan) in recent.iter().enumerate().rev() {
        information += &scan.information;
        score += &scan.score;
        let said = (&information, &score);
        let Some(surprise) = Surprise::new((&scan.mean, &scan.covariance), said) else { continue };
        let of = |(k, columns): (usize, &Vec<usize>)| Some((k, surprise.odds(columns, size)?));
        let mut found: Vec<_> = own.iter().enumerate().filter_map(of).collect();
        found.sort_by(|a, b| b.1.0.total_cmp(&a.1.0));
        let Some(&(_, (odds, change))) = found.first() else { continue };
        if odds > ODDS.ln() && best.as_ref().is_none_or(|(most, _)| odds > *most) {
            let rivals = found.iter().filter(|(_, own)| own.0 > odds - RIVAL.ln());
            let radars: Vec<usize> = rivals.map(|(k, _)| *k).collect();
            let size = if radars.len() > 1 { change.max(size) } else { size };
            best = Some((odds, Change { from, radars, size }));
        }
    }
    best.map(|(_, change)| change)
}

#[cfg(test)]
mod tests {
    use super::super::gaussian::Gaussian;
    use super::*;

    /// Scaled information gives the scaled estimate of a scan.
    #[test]
    fn information_is_scaled_before_and_in_a_scan() {
        let mut before = Gaussian::new(vec![0.0; 2]);
        let information = DMatrix::from_row_slice(2, 2, &[3.0, 1.0, 1.0, 3.0]);
        before.update(&information, &DVector::from_row_slice(&[2.0, -1.0]));
        let mut scan = Scan {
            time: 0.0,
            information: DMatrix::from_row_slice(2, 2, &[5.0, -2.0, -2.0, 1.0]),
            score: DVector::from_row_slice(&[1.0, 3.0]),
            mean: before.mean.clone(),
            covariance: before.covariance.clone(),
        };
        let mut after = before.clone();
        after.update(&scan.information, &scan.score);
        scan.scale(0.25);
        let mut scaled_after = before;
        scaled_after.covariance = scan.covariance.clone();
        scaled_after.update(&scan.information, &scan.score);
        let expected = scaled(&after.covariance, 0.25).unwrap();
        assert!((scaled_after.covariance - expected).amax() < 1e-12);
    }
}
