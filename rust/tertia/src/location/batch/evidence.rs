//! Likelihood of the measurements of an instant for given sizes of the sigmas.
//!
//! The restricted likelihood (Patterson, Thompson 1971) of normal errors and a share of outliers, about
//! the least-squares fit of the measurements that a robust fit keeps.

use crate::base::small::{Factor, Matrix, Vector, add_multiple, add_outer, dot};
use crate::location::descent::Loss;
use crate::location::search::fix::Instant;
use crate::location::solver::record::{NOWHERE, Record};
use crate::location::solver::{Locator, Workspace};
use crate::sensors::{KINDS, Row};

/// Shares of outliers. Relative to the normal density at 0, the density of outliers is [`FLAT`] up to
/// [`EVEN`] stated sigmas, and inversely proportional to the residual beyond, so that an error of any
/// size does not cost less as an outlier than as noise.
const SHARES: [f64; 4] = [0.01, 0.03, 0.1, 0.3];
const FLAT: f64 = 2.506_628_274_631_000_5 / 30.0;
const EVEN: f64 = 15.0;
/// A measurement is kept if its residual is at most this many standard deviations of the residual. With
/// a wider limit, one fault of five sigmas in each instant would increase the estimated sigma, and then
/// be kept.
const KEPT: f64 = 3.0;
/// Variance of standard normal numbers within this limit.
const KEPT_VARIANCE: f64 = 0.973_3;

/// Log likelihoods for each share of outliers.
pub(in crate::location) type ByShare = [f64; SHARES.len()];

/// What the residuals of an instant say about the sigmas.
pub(in crate::location) struct Evidence {
    pub likelihood: Likelihood,
    /// Number of measurements that are kept.
    pub kept: usize,
    /// Number of measurements that are rejected.
    pub rejected: usize,
    /// Kept measurements whose sigmas may be wrong.
    pub free: Vec<Kept>,
}

/// Restricted likelihood of an instant.
pub(in crate::location) struct Likelihood {
    /// Logarithm of the reciprocal root of the determinant of the normal matrix.
    ln_root: f64,
    /// Share of the measurements that are redundant.
    redundant: f64,
    /// Residual of each measurement, and the factor of its variance.
    rows: Vec<(f64, f64)>,
}

impl Likelihood {
    /// Returns the restricted log likelihood.
    pub fn by_share(&self) -> ByShare {
        let mut sum = [self.ln_root; SHARES.len()];
        for &(residual, unit) in &self.rows {
            let normal = (-0.5 * residual * residual).exp() / unit.sqrt();
            let flat = flat(residual, unit);
            for (sum, share) in sum.iter_mut().zip(SHARES) {
                *sum += ((1.0 - share) * normal + share * flat).ln();
            }
        }
        sum
    }

    /// Returns the restricted log likelihood if all redundant measurements were outliers.
    pub fn of_outliers(&self) -> ByShare {
        let (redundant, mut sum) = (self.redundant, [self.ln_root; SHARES.len()]);
        for &(residual, unit) in &self.rows {
            let flat = flat(residual, unit);
            for (sum, share) in sum.iter_mut().zip(SHARES) {
                // the rest fits exactly; with these terms the determinant becomes that for the stated
                // sigmas
                *sum += redundant * (share * flat).ln()
                    + (1.0 - redundant) * ((1.0 - share).ln() - 0.5 * unit.ln());
            }
        }
        sum
    }
}

/// Density of an outlier with this residual, relative to the normal density at 0.
fn flat(residual: f64, unit: f64) -> f64 {
    FLAT * (EVEN / (residual.abs() * unit.sqrt())).min(1.0)
}

/// A measurement that is kept.
pub(in crate::location) struct Kept {
    pub place: usize,
    pub residual: f64,
    /// The squared residual, scaled to that of an untruncated normal number, and its degrees of
    /// freedom.
    pub square: f64,
    pub freedom: f64,
}

impl Locator {
    /// Returns the evidence of an instant of a block after it has been finished. The sigmas that are
    /// `free` to be wrong (5 K marks) must have been multiplied by the square roots of these factors.
    /// Returns `None` if the kept measurements leave a direction undetermined.
    pub(in crate::location) fn evidence<const D: usize>(
        &self,
        instant: &Instant<'_>,
        lane: usize,
        (free, factor): (&[bool], &[f64; KINDS]),
        workspace: &Workspace<D>,
    ) -> Option<Evidence> {
        let Workspace { own, plane, space } = workspace;
        match (D, self.has_arrivals(instant)) {
            (_, false) => own.records[lane].evidence(self, free, factor),
            (2, true) => plane.records[lane].evidence(self, free, factor),
            _ => space.records[lane].evidence(self, free, factor),
        }
    }
}

impl<const D: usize, const N: usize> Record<D, N> {
    fn evidence(
        &self,
        locator: &Locator,
        free: &[bool],
        factor: &[f64; KINDS],
    ) -> Option<Evidence> {
        let Self { measurements, rows, places, .. } = self;
        let loss = locator.loss(rows.len() - N, N > D);
        let marked = measurements.iter().zip(rows);
        let mut keeps: Vec<bool> =
            marked.map(|(m, row)| !loss.of(m.kind).is_fault(row.residual)).collect();
        if loss != Loss::SQUARE {
            let (lower, _) = normal(rows, &keeps)?;
            // a compromise may hide a fault, so the residual is compared with its own sigma
            for (keep, row) in keeps.iter_mut().zip(rows) {
                let rest = 1.0 - dot(&lower.solve(&row.gradient), &row.gradient);
                *keep &= row.residual * row.residual <= KEPT * KEPT * rest.max(0.0);
            }
        }
        let (lower, vector) = normal(rows, &keeps)?;
        // residuals of least squares with the kept measurements: a weighted fit would depend on the
        // weights
        let step = lower.solve(&vector);
        let variance = if loss == Loss::SQUARE { 1.0 } else { KEPT_VARIANCE };
        let stations = free.len() / KINDS;
        let mut likelihood = Likelihood {
            ln_root: -0.5 * lower.ln_determinant(),
            redundant: 1.0 - N as f64 / rows.len() as f64,
            rows: Vec::with_capacity(rows.len()),
        };
        let mut found = Vec::with_capacity(rows.len());
        for ((row, &place), &kept) in rows.iter().zip(places).zip(&keeps) {
            let is_free = place != NOWHERE && free[place];
            let residual = row.residual - dot(&row.gradient, &step);
            let unit = if is_free { factor[place / stations] } else { 1.0 };
            likelihood.rows.push((residual, unit));
            if kept && is_free {
                let leverage = dot(&lower.solve(&row.gradient), &row.gradient);
                let (square, freedom) = (residual * residual / variance, (1.0 - leverage).max(0.0));
                found.push(Kept { place, residual, square, freedom });
            }
        }
        let kept = keeps.iter().filter(|keep| **keep).count();
        Some(Evidence { likelihood, kept, rejected: keeps.len() - kept, free: found })
    }
}

/// Returns the factorised normal equations of the kept rows, and their right side.
fn normal<const N: usize>(rows: &[Row<N>], keeps: &[bool]) -> Option<(Factor<N>, Vector<N>)> {
    let (mut normal, mut vector): (Matrix<N>, Vector<N>) = ([[0.0; N]; N], [0.0; N]);
    for (row, _) in rows.iter().zip(keeps).filter(|(_, keep)| **keep) {
        add_multiple(&mut vector, row.residual, &row.gradient);
        add_outer(&mut normal, 1.0, &row.gradient);
    }
    Some((Factor::try_new(&normal, 0.0)?, vector))
}
