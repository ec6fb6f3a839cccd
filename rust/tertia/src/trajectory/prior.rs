//! Prior of the systematic errors.

use super::measured::{Record, seen};
use crate::sensors::KINDS;

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

    /// Columns with measurements that may have lasting errors, and the clocks that may have errors.
    pub(super) fn columns(&self, record: &Record<'_>) -> Vec<usize> {
        let width = record.width();
        let seen = |at: &usize| record.values.iter().skip(*at).step_by(width).any(|v| !v.is_nan());
        (0..width)
            .filter(|at| self.sigma[*at] != 0.0)
            .filter(seen)
            .chain(self.clocks(record))
            .collect()
    }

    /// Clocks of stations with measurements that depend on them; they are counted after the columns.
    pub(super) fn clocks(&self, record: &Record<'_>) -> impl Iterator<Item = usize> {
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
    /// Stated standard deviation of the systematic error of a column: 0 if it is to be estimated, ∞ if nothing
    /// is known about it.
    pub(super) fn sigma(&self, column: usize, record: &Record<'_>) -> f64 {
        match self {
            Self::Flat(kinds) if kinds.contains(&record.kind_of(column)) => f64::INFINITY,
            Self::Lasting(prior) if !prior.sigma[column].is_nan() => prior.sigma[column],
            _ => 0.0,
        }
    }

    /// Whether a column has no systematic error; k is the number of stations.
    pub(super) fn is_trusted(&self, column: usize, k: usize) -> bool {
        match self {
            Self::Flat(kinds) => !kinds.contains(&(column / k)),
            Self::Lasting(prior) => prior.sigma[column] == 0.0,
        }
    }
}
