//! Prior of the systematic errors.

use super::survey;
use crate::sensors::KINDS;
use crate::trajectory::measured::{Record, seen};
use crate::trajectory::search::fit::Found;

/// Share of the variance of the error of heights that drifts; the correlation time is estimated.
const HEIGHT_DRIFT: f64 = 0.5;

/// Prior of the lasting errors.
#[derive(Clone, Debug)]
pub struct Prior {
    /// Standard deviations, 5 K numbers: 0 for trusted columns, nan for those to be estimated. If there are
    /// heights, that of their lasting error follows, then those of the clocks of the stations, K numbers, none
    /// of them nan.
    pub sigma: Vec<f64>,
    /// Shares of the variance that drift, and the correlation times (6 K); nan: to be estimated.
    pub share: Vec<f64>,
    /// See `share`.
    pub time: Vec<f64>,
    /// Standard deviations of azimuth errors that depend on the direction (N, K); none: 0.
    pub deviation: Option<Vec<f64>>,
    /// Shares of the drifting variances that are due to survey errors (5 K), whose effect on the path is
    /// computed from the directions of the target instead; empty: 0.
    pub surveyed: Vec<f64>,
}

impl Prior {
    /// Inserts a lasting error of the heights, with this standard deviation, between those of the measurements
    /// of K stations and those of their clocks.
    pub fn with_heights(mut self, sigma: f64, k: usize) -> Self {
        self.sigma.insert(KINDS * k, sigma);
        self.share.insert(KINDS * k, HEIGHT_DRIFT);
        self.time.insert(KINDS * k, f64::NAN);
        self
    }

    /// Adds these variances (5 K) of errors that are due to survey errors to the drifts of the errors whose size
    /// is stated: otherwise they would be taken for errors that do not change.
    fn with_surveys(&self, variances: &[f64]) -> Self {
        let mut own = Self { surveyed: vec![0.0; variances.len()], ..self.clone() };
        if !self.sigma.iter().any(|sigma| *sigma > 0.0) {
            return own;
        }
        for (at, &variance) in variances.iter().enumerate().filter(|(_, v)| **v > 0.0) {
            let stated = self.sigma[at].powi(2);
            if stated.is_nan() {
                continue;
            }
            // a stated error without a share is constant
            let share = if self.share[at].is_nan() { 0.0 } else { self.share[at] };
            let drift = share * stated + variance;
            own.sigma[at] = (stated + variance).sqrt();
            own.share[at] = drift / (stated + variance);
            own.surveyed[at] = variance / drift;
        }
        own
    }

    /// Share of the drifting variance of a column that is not due to survey errors.
    pub(in crate::trajectory) fn unsurveyed(&self, column: usize) -> f64 {
        1.0 - self.surveyed.get(column).unwrap_or(&0.0)
    }

    /// Columns with measurements that may have lasting errors, and the clocks that may have errors.
    pub(in crate::trajectory) fn columns(&self, record: &Record<'_>) -> Vec<usize> {
        let width = record.width();
        let seen = |at: &usize| record.values.iter().skip(*at).step_by(width).any(|v| !v.is_nan());
        (0..width)
            .filter(|at| self.sigma[*at] != 0.0)
            .filter(seen)
            .chain(self.clocks(record))
            .collect()
    }

    /// Clocks of stations with measurements that depend on them; they are counted after the columns.
    pub(in crate::trajectory) fn clocks(&self, record: &Record<'_>) -> impl Iterator<Item = usize> {
        let (width, k) = (record.width(), record.width() / KINDS);
        let timed = seen(record, &[0, 1, 2]);
        let is_timed = move |station: usize| timed.iter().any(|column| column % k == station);
        (0..k)
            .filter(move |own| self.sigma[width + own] > 0.0 && is_timed(*own))
            .map(move |k| width + k)
    }
}

/// Assumptions about the systematic errors.
#[derive(Clone, Debug)]
pub enum Systematic {
    /// Constant biases of these kinds, in the order of an instant's rows, of which nothing is known; the
    /// other kinds have none.
    Flat(Vec<usize>),
    /// Lasting errors whose size is known or can be estimated.
    Lasting(Prior),
}

impl Systematic {
    /// Adds survey errors of the stations, as seen from a path.
    pub(in crate::trajectory) fn with_surveys<const D: usize, const N: usize>(
        &self,
        record: &Record<'_>,
        found: &Found<D, N>,
    ) -> Self {
        match (self, survey::variances(record, found)) {
            (Self::Lasting(prior), Some(variances)) => {
                Self::Lasting(prior.with_surveys(&variances))
            }
            _ => self.clone(),
        }
    }

    /// Stated standard deviation of the systematic error of a column: 0 if it is to be estimated, ∞ if nothing
    /// is known about it.
    pub(in crate::trajectory) fn sigma(&self, column: usize, record: &Record<'_>) -> f64 {
        match self {
            Self::Flat(kinds) if kinds.contains(&record.kind_of(column)) => f64::INFINITY,
            Self::Lasting(prior) if !prior.sigma[column].is_nan() => prior.sigma[column],
            _ => 0.0,
        }
    }

    /// Whether a column has no systematic error; k is the number of stations.
    pub(in crate::trajectory) fn is_trusted(&self, column: usize, k: usize) -> bool {
        match self {
            Self::Flat(kinds) => !kinds.contains(&(column / k)),
            Self::Lasting(prior) => prior.sigma[column] == 0.0,
        }
    }
}
