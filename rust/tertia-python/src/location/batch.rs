//! The measurements of the instants of a batch.

use crate::arrays::{Input, Rows, Threads, optional};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use tertia::location::Instant;
use tertia::sensors::KINDS;

/// Number of stations and of dimensions of positions (..., K, D).
pub(super) fn size(stations: &Input<'_>) -> PyResult<(usize, usize)> {
    match stations.shape() {
        [.., k, d @ (2 | 3)] if *k > 0 => Ok((*k, *d)),
        shape => Err(PyValueError::new_err(format!(
            "stations has shape {shape:?}; it must be (..., K, D)"
        ))),
    }
}

/// Returns a height and its standard deviation; `None` if the height is nan.
fn known_height(row: &[f64]) -> Option<(f64, f64)> {
    (!row[0].is_nan()).then(|| (row[0], row[1]))
}

/// The measurements of the instants of a batch: one row for each instant, or one for all.
pub(super) struct Batch<'a> {
    /// Number of stations, and of dimensions of positions.
    pub k: usize,
    pub d: usize,
    pub stations: Rows<'a>,
    pub axes: Option<Rows<'a>>,
    pub values: Rows<'a>,
    pub sigmas: Rows<'a>,
    pub surveys: Option<Rows<'a>>,
    pub height: Option<Rows<'a>>,
    pub initial: Option<Rows<'a>>,
}

impl<'a> Batch<'a> {
    pub fn new(
        stations: &'a Input<'_>,
        axes: Option<&'a Input<'_>>,
        values: &'a Input<'_>,
        sigmas: &'a Input<'_>,
    ) -> PyResult<Self> {
        let (k, d) = size(stations)?;
        let (stations, values) = (stations.blocks("stations", 2)?, values.blocks("values", 2)?);
        let sigmas = sigmas.blocks("sigmas", 2)?;
        let count = values.count();
        values.require(KINDS * k, count)?;
        sigmas.require_shared(KINDS * k, count)?;
        stations.require_shared(k * d, count)?;
        let axes = optional(axes, "axes", (3, k * d * d), count)?;
        Ok(Self {
            k,
            d,
            stations,
            axes,
            values,
            sigmas,
            surveys: None,
            height: None,
            initial: None,
        })
    }

    /// Adds standard deviations of the coordinates of the stations, heights with their standard
    /// deviations, and positions at which the search begins.
    pub fn with(
        self,
        surveys: Option<&'a Input<'_>>,
        height: Option<&'a Input<'_>>,
        initial: Option<&'a Input<'_>>,
    ) -> PyResult<Self> {
        let count = self.count();
        let surveys = optional(surveys, "position_sigmas", (1, self.k), count)?;
        let height = optional(height, "height", (1, 2), count)?;
        let initial = optional(initial, "initial", (1, self.d), count)?;
        Ok(Self { surveys, height, initial, ..self })
    }

    pub fn count(&self) -> usize {
        self.values.count()
    }

    pub fn instant(&self, i: usize) -> Instant<'_> {
        Instant {
            stations: self.stations.shared(i),
            axes: self.axes.as_ref().map(|axes| axes.shared(i)),
            values: self.values.shared(i),
            sigmas: self.sigmas.shared(i),
            position_sigmas: self.surveys.as_ref().map(|surveys| surveys.shared(i)),
            height: self.height.as_ref().and_then(|rows| known_height(rows.shared(i))),
            initial: self.initial.as_ref().map(|initial| initial.shared(i)),
        }
    }

    pub fn instants(&self) -> Vec<Instant<'_>> {
        (0..self.count()).map(|i| self.instant(i)).collect()
    }

    /// Returns what `work` writes for every instant; `nanoseconds` is the cost of one instant.
    pub fn each<T: Clone + Send>(
        &self,
        py: Python<'_>,
        nanoseconds: f64,
        n_threads: Threads,
        unknown: T,
        work: impl Fn(usize, &mut T) -> tertia::Result<()> + Sync + Send,
    ) -> PyResult<Vec<T>> {
        let cost = nanoseconds * self.count() as f64;
        self.values.results(py, cost, n_threads, unknown, |row, _, out| work(row, out))
    }
}
