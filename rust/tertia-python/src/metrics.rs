//! Bindings of `tertia::metrics`.

use crate::arrays::{Array, Input, array, release, value_error};
use pyo3::prelude::*;
use tertia::metrics::{self, POWERS, Worth};

/// Cost of a row and axis over all models, for the decision whether to release the interpreter's lock.
const ROW_NS: f64 = 2000.0;

/// Probabilities of models of how long errors last, and numbers of rows that are worth one independent value.
#[pyfunction]
pub fn lasting<'py>(
    py: Python<'py>,
    errors: Input<'py>,
    gaps: Input<'py>,
) -> PyResult<(Array<'py>, Array<'py>)> {
    let (errors, gaps) = (errors.rows("errors", 1)?, gaps.rows("gaps", 0)?);
    let found = release(py, ROW_NS * errors.size(), || {
        metrics::lasting(&errors.values, errors.len(), &gaps.values)
    })?
    .map_err(value_error)?;
    let shape = [found.probability.len(), POWERS.len()];
    let rows = array(py, &shape, found.rows_per_value.into_iter().flatten())?;
    Ok((array(py, &shape[..1], found.probability)?, rows))
}

/// Distribution of the number of independent values that a record is worth: numbers, probabilities,
/// degrees of freedom.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Record<'py> {
    number: Input<'py>,
    probability: Input<'py>,
    degrees_of_freedom: f64,
}

impl Record<'_> {
    fn with<T>(&self, of: impl FnOnce(&Worth) -> tertia::Result<T>) -> PyResult<T> {
        let number = self.number.rows("number", 0)?;
        let probability = self.probability.rows("probability", 0)?;
        let degrees_of_freedom = self.degrees_of_freedom;
        of(&Worth { number: &number.values, probability: &probability.values, degrees_of_freedom })
            .map_err(value_error)
    }
}

/// Interval of the expectation of positive values.
#[pyfunction]
pub fn mean_interval(
    mean: f64,
    ratio: f64,
    worth: Record<'_>,
    confidence_level: f64,
) -> PyResult<[f64; 2]> {
    worth.with(|worth| metrics::mean_interval(mean, ratio, worth, confidence_level))
}

/// Interval of a probability.
#[pyfunction]
pub fn share_interval(share: f64, worth: Record<'_>, confidence_level: f64) -> PyResult<[f64; 2]> {
    worth.with(|worth| metrics::share_interval(share, worth, confidence_level))
}

/// Range of shares that may be observed for an event of this probability.
#[pyfunction]
pub fn rank_interval(
    probability: f64,
    worth: Record<'_>,
    confidence_level: f64,
) -> PyResult<[f64; 2]> {
    worth.with(|worth| metrics::rank_interval(probability, worth, confidence_level))
}

/// Weights of the powers of the correlation of normal variables, whose sum is the correlation of two
/// indicators: that a sum of `axes` squares, or (0 axes) one variable, is below its quantile.
#[pyfunction]
pub fn indicator_powers(axes: usize, probability: f64) -> PyResult<Vec<f64>> {
    metrics::indicator_powers(axes, probability).map(Vec::from).map_err(value_error)
}

/// Quantile of chi-square.
#[pyfunction]
pub fn chi_square_quantile(probability: f64, degrees_of_freedom: usize) -> PyResult<f64> {
    metrics::chi_square_quantile(probability, degrees_of_freedom).map_err(value_error)
}
