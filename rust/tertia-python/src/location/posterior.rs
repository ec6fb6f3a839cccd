//! Bindings of the density of positions of a few bearings.

use super::region::{Regions, regions};
use super::{optional, size};
use crate::arrays::{Array, Input, Output, Rows, Threads, array, columns, release, repeated};
use pyo3::prelude::*;
use tertia::batch::for_each_row;
use tertia::location::{
    Bearings, Decay, Outline, Posterior, STEPS, Status, Summary, Weights, pooled as pooled_weights,
};
use tertia::sensors::KINDS;

type Located<'py> = (Output<'py>, Output<'py>, Output<'py>, Array<'py>, [Array<'py>; 4]);
/// What is made of an instant: its summary, the number of bearings, residuals.
type Found = (Option<Summary>, usize, Vec<f64>);

/// Cost of an instant, for the choice of threads.
const INSTANT_NS: f64 = 1e6;

/// The bearings of a batch.
struct Batch<'a> {
    k: usize,
    stations: Rows<'a>,
    axes: Option<Rows<'a>>,
    values: Rows<'a>,
    sigmas: Rows<'a>,
    max_range: f64,
    decay: Decay,
}

impl<'a> Batch<'a> {
    fn new(
        stations: &'a Input<'_>,
        axes: Option<&'a Input<'_>>,
        values: &'a Input<'_>,
        sigmas: &'a Input<'_>,
        max_range: f64,
    ) -> PyResult<Self> {
        let (k, d) = size(stations)?;
        let (stations, values) = (stations.blocks("stations", 2)?, values.blocks("values", 2)?);
        let sigmas = sigmas.blocks("sigmas", 2)?;
        let count = values.count();
        stations.require_shared(2 * k, count)?;
        values.require(KINDS * k, count)?;
        sigmas.require_shared(KINDS * k, count)?;
        let axes = optional(axes, "axes", (3, k * d * d), count)?;
        let decay = Decay::new(k, &sigmas.values);
        Ok(Self { k, stations, axes, values, sigmas, max_range, decay })
    }

    fn count(&self) -> usize {
        self.values.count()
    }

    fn posterior(&self, row: usize) -> Option<Posterior> {
        let bearings = Bearings {
            stations: self.stations.shared(row),
            axes: self.axes.as_ref().map(|axes| axes.shared(row)),
            values: self.values.shared(row),
            sigmas: self.sigmas.shared(row),
        };
        Posterior::new(&bearings, self.max_range)
    }

    /// Calls `work` on every instant and where its result goes.
    fn each<T: Send>(
        &self,
        py: Python<'_>,
        n_threads: Threads,
        out: &mut [T],
        work: impl Fn(usize, &Posterior, &mut T) + Sync + Send,
    ) -> PyResult<()> {
        let cost = INSTANT_NS * self.count() as f64;
        let work = |(): &mut (), (row, out): (usize, &mut T)| {
            if let Some(posterior) = self.posterior(row) {
                work(row, &posterior, out);
            }
            Ok(())
        };
        release(py, cost, || {
            for_each_row(out.iter_mut().enumerate(), cost, n_threads, || (), work)
        })?
        .map_err(|failure| self.values.error(failure))
    }
}

/// Positions, covariances, residuals, logarithms of the weights of the factor between true and
/// stated sigma; problems, numbers of bearings, factors, shares of the mass at the limit of range.
#[pyfunction]
#[allow(clippy::too_many_arguments)] // the Python signature
pub fn locate_posterior<'py>(
    py: Python<'py>,
    stations: Input<'py>,
    axes: Option<Input<'py>>,
    values: Input<'py>,
    sigmas: Input<'py>,
    max_range: f64,
    pooled: bool,
    n_threads: Threads,
) -> PyResult<Located<'py>> {
    let batch = Batch::new(&stations, axes.as_ref(), &values, &sigmas, max_range)?;
    let count = batch.count();
    let mut likelihoods: Vec<Option<Weights>> = repeated(None, count)?;
    if pooled {
        batch.each(py, n_threads, &mut likelihoods, |_, posterior, out| {
            *out = posterior.ln_likelihood(&batch.decay);
        })?;
    }
    let weights = pooled_weights(&likelihoods);
    let shape = batch.values.batch();
    let (mut position, mut covariance) =
        (Output::new(py, shape, &[2])?, Output::new(py, shape, &[2, 2])?);
    let mut residual: Output = batch.values.output(py)?;
    let mut found: Vec<Found> = repeated((None, 0, vec![f64::NAN; KINDS * batch.k]), count)?;
    batch.each(py, n_threads, &mut found, |row, posterior, (summary, bearings, residual)| {
        let own = posterior.summary(&batch.decay, &weights[row]);
        *bearings = posterior.residuals(own.factor, own.mean, residual);
        *summary = Some(own);
    })?;
    for (((summary, _, from), residual), (position, covariance)) in
        found.iter().zip(residual.rows()?).zip(position.rows()?.zip(covariance.rows()?))
    {
        residual.copy_from_slice(from);
        let nan = Summary::UNKNOWN;
        let own = summary.as_ref().unwrap_or(&nan);
        position.copy_from_slice(&own.mean);
        covariance.copy_from_slice(own.covariance.as_flattened());
    }
    let weights = array(py, &[shape, &[STEPS]].concat(), weights.into_iter().flatten())?;
    let of: [fn(&Found) -> f64; 4] = [
        |(own, ..)| if own.is_some() { 0.0 } else { f64::from(Status::TooFew as u8) },
        |(_, bearings, _)| *bearings as f64,
        |(own, ..)| own.map_or(f64::NAN, |own| own.factor),
        |(own, ..)| own.map_or(f64::NAN, |own| own.edge),
    ];
    let found = columns(py, shape, &found, of)?;
    Ok((position, covariance, residual, weights, found))
}

/// Regions of highest density.
#[pyfunction]
#[allow(clippy::too_many_arguments)] // the Python signature
pub fn posterior_regions<'py>(
    py: Python<'py>,
    stations: Input<'py>,
    axes: Option<Input<'py>>,
    values: Input<'py>,
    sigmas: Input<'py>,
    max_range: f64,
    weights: Input<'py>,
    probability: f64,
    n_threads: Threads,
) -> PyResult<Regions<'py>> {
    let batch = Batch::new(&stations, axes.as_ref(), &values, &sigmas, max_range)?;
    let weights = weights.points::<STEPS>("weights", 1)?;
    let mut found = repeated(Outline::empty(), batch.count())?;
    batch.each(py, n_threads, &mut found, |row, posterior, out| {
        *out = posterior.region(&batch.decay, &weights[row], probability).outline;
    })?;
    regions(py, batch.values.batch(), &found)
}

/// Radii about points that hold so much of the density.
#[pyfunction]
#[allow(clippy::too_many_arguments)] // the Python signature
pub fn posterior_radii<'py>(
    py: Python<'py>,
    stations: Input<'py>,
    axes: Option<Input<'py>>,
    values: Input<'py>,
    sigmas: Input<'py>,
    max_range: f64,
    weights: Input<'py>,
    centres: Input<'py>,
    probability: f64,
    n_threads: Threads,
) -> PyResult<Array<'py>> {
    let batch = Batch::new(&stations, axes.as_ref(), &values, &sigmas, max_range)?;
    let weights = weights.points::<STEPS>("weights", 1)?;
    let centres = centres.pairs("centres")?;
    let mut found = repeated(f64::NAN, batch.count())?;
    batch.each(py, n_threads, &mut found, |row, posterior, out| {
        *out = posterior.radius(&batch.decay, &weights[row], probability, centres[row]);
    })?;
    array(py, batch.values.batch(), found)
}
