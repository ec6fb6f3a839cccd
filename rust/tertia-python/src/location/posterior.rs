//! Bindings for the probability density of positions from a few bearings.

use super::batch::Batch;
use super::region::{Regions, regions};
use crate::arrays::{Array, Input, Output, Threads, array, columns, repeated};
use pyo3::prelude::*;
use tertia::location::{
    Bearings, Decay, Instant, Outline, Posterior, STEPS, Status, Summary, Weights,
    pooled as pooled_weights,
};
use tertia::sensors::KINDS;

type Located<'py> = (Output<'py>, Output<'py>, Output<'py>, Array<'py>, [Array<'py>; 4]);
/// Result for an instant: its summary, the number of bearings, the residuals.
type Found = (Option<Summary>, usize, Vec<f64>);

/// Cost of an instant, which determines the number of threads.
const INSTANT_NS: f64 = 1e6;

/// Stations, their axes, measured values and standard deviations.
type Measured<'py> = (Input<'py>, Option<Input<'py>>, Input<'py>, Input<'py>);

/// The bearings of a batch.
struct Sight<'a> {
    batch: Batch<'a>,
    max_range: f64,
    decay: Decay,
}

impl<'a> Sight<'a> {
    fn new(measured: &'a Measured<'_>, max_range: f64) -> PyResult<Self> {
        let (stations, axes, values, sigmas) = measured;
        let batch = Batch::new(stations, axes.as_ref(), values, sigmas)?;
        batch.stations.require_shared(2 * batch.k, batch.count())?;
        let decay = Decay::new(batch.k, &batch.sigmas.values);
        Ok(Self { batch, max_range, decay })
    }

    fn posterior(&self, row: usize) -> Option<Posterior> {
        let Instant { stations, axes, values, sigmas, .. } = self.batch.instant(row);
        Posterior::new(&Bearings { stations, axes, values, sigmas }, self.max_range)
    }

    /// Returns what `work` writes for every instant whose bearings intersect.
    fn each<T: Clone + Send>(
        &self,
        py: Python<'_>,
        n_threads: Threads,
        unknown: T,
        work: impl Fn(usize, &Posterior, &mut T) + Sync + Send,
    ) -> PyResult<Vec<T>> {
        self.batch.each(py, INSTANT_NS, n_threads, unknown, |row, out| {
            if let Some(posterior) = self.posterior(row) {
                work(row, &posterior, out);
            }
            Ok(())
        })
    }
}

/// Positions, covariances, residuals, log weights of the values of the noise factor (true sigma divided
/// by stated sigma); status, numbers of bearings, noise factors, shares of the probability at the limit
/// of range.
#[pyfunction]
pub fn locate_posterior<'py>(
    py: Python<'py>,
    measured: Measured<'py>,
    max_range: f64,
    pooled: bool,
    n_threads: Threads,
) -> PyResult<Located<'py>> {
    let sight = Sight::new(&measured, max_range)?;
    let (batch, decay) = (&sight.batch, &sight.decay);
    let likelihoods: Vec<Option<Weights>> = match pooled {
        true => sight.each(py, n_threads, None, |_, posterior, out| {
            *out = posterior.ln_likelihood(decay);
        })?,
        false => repeated(None, batch.count())?,
    };
    let weights = pooled_weights(&likelihoods);
    let shape = batch.values.batch();
    let (mut position, mut covariance) =
        (Output::new(py, shape, &[2])?, Output::new(py, shape, &[2, 2])?);
    let mut residual: Output = batch.values.output(py)?;
    let unknown: Found = (None, 0, vec![f64::NAN; KINDS * batch.k]);
    let found = sight.each(py, n_threads, unknown, |row, posterior, out| {
        let (summary, bearings, residual) = out;
        let own = posterior.summary(decay, &weights[row]);
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

/// Computes regions of highest density.
#[pyfunction]
pub fn posterior_regions<'py>(
    py: Python<'py>,
    measured: Measured<'py>,
    max_range: f64,
    weights: Input<'py>,
    probability: f64,
    n_threads: Threads,
) -> PyResult<Regions<'py>> {
    let sight = Sight::new(&measured, max_range)?;
    let weights = weights.points::<STEPS>("weights", 1)?;
    let found = sight.each(py, n_threads, Outline::empty(), |row, posterior, out| {
        *out = posterior.region(&sight.decay, &weights[row], probability);
    })?;
    regions(py, sight.batch.values.batch(), &found)
}

/// Computes radii about points that contain this probability.
#[pyfunction]
pub fn posterior_radii<'py>(
    py: Python<'py>,
    measured: Measured<'py>,
    max_range: f64,
    weights: Input<'py>,
    centres: Input<'py>,
    probability: f64,
    n_threads: Threads,
) -> PyResult<Array<'py>> {
    let sight = Sight::new(&measured, max_range)?;
    let weights = weights.points::<STEPS>("weights", 1)?;
    let centres = centres.pairs("centres")?;
    let found = sight.each(py, n_threads, f64::NAN, |row, posterior, out| {
        *out = posterior.radius(&sight.decay, &weights[row], probability, centres[row]);
    })?;
    array(py, sight.batch.values.batch(), found)
}
