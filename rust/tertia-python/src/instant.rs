//! Bindings of `tertia::fusion::fusing`.

use crate::arrays::{Output, Samples, array, chunks, release, repeated, room_for, value_error};
use crate::screening::unknown;
use numpy::PyArrayDyn;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::num::NonZero;
use tertia::batch::for_each_row;
use tertia::fusion::{Consistency, Instant, InstantFusion, Weighting, fusing};
use tertia::kalman::require_period;

type Array<'py, T> = Bound<'py, PyArrayDyn<T>>;
type Fused<'py> = ([Array<'py, f64>; 5], Array<'py, i64>);

/// Estimates (..., K, m), covariances (..., K, m, m) and those between sensors (..., K, K, m, m), of
/// one batch; weights (K) for "static".
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Instants<'py> {
    estimates: Bound<'py, PyAny>,
    covariances: Bound<'py, PyAny>,
    cross_covariances: Option<Bound<'py, PyAny>>,
    weights: Option<Vec<f64>>,
    method: String,
    period: Option<f64>,
}

fn weighting(name: &str, weights: Option<Vec<f64>>) -> PyResult<Weighting> {
    Ok(match name {
        "equal" => Weighting::Equal,
        "static" => Weighting::Static(weights.unwrap_or_default()),
        "posterior" => Weighting::Posterior,
        "matrix" => Weighting::Matrix,
        "covariance-intersection" => Weighting::Intersection,
        other => {
            let choices = "'matrix', 'posterior', 'covariance-intersection', 'static' or 'equal'";
            return Err(unknown("method", other, choices));
        }
    })
}

/// Cost of the fusion of K estimates of m components, measured.
fn fuse_ns(sensors: usize, m: usize, weighting: &Weighting, joint: bool) -> f64 {
    let (k, m) = (sensors as f64, m as f64);
    let product = 20.0 + 2.0 * m.powi(3);
    // to read the joint covariance
    let reading = if joint { 0.5 * (k * m).powi(3) + 5.0 * (k * m).powi(2) } else { 0.0 };
    200.0
        + reading
        + match weighting {
            Weighting::Matrix if joint => 0.5 * k.powi(3) * product,
            Weighting::Matrix => 2.0 * k * product,
            Weighting::Intersection => 10.0 * (k * product + k * k * m * m + k.powi(3) / 3.0),
            _ => 2.0 * k * k * m * m,
        }
}

/// Matrices that the kernel keeps for every two sensors.
const MATRICES: usize = 4;

/// Fused means, covariances, weights, statistics of consistency, their p-values; and numbers of
/// sensors that have an estimate.
#[pyfunction]
pub fn fuse<'py>(
    py: Python<'py>,
    instants: Instants<'py>,
    n_threads: Option<NonZero<usize>>,
) -> PyResult<Fused<'py>> {
    let estimates = Samples::extract(&instants.estimates, "estimates")?;
    let covariances = Samples::extract(&instants.covariances, "covariances")?;
    let cross = instants.cross_covariances.as_ref();
    let cross = cross.map(|value| Samples::extract(value, "cross_covariances")).transpose()?;
    let weighting = weighting(&instants.method, instants.weights)?;
    if let Some(period) = instants.period {
        require_period(period).map_err(value_error)?;
    }
    let &[.., sensors, m] = estimates.shape() else {
        return Err(PyValueError::new_err("estimates must be of shape (..., K, m)"));
    };
    let pairs = if cross.is_some() { sensors.saturating_mul(sensors) } else { sensors };
    room_for::<f64>(MATRICES.saturating_mul(pairs).saturating_mul(m).saturating_mul(m))?;
    let (x, s) = (estimates.blocks(2)?, covariances.blocks(3)?);
    let cross = cross.as_ref().map(|samples| samples.blocks(4)).transpose()?;
    let count = x.count();
    let new = |tail: &[usize]| Output::new(py, &[x.batch(), tail].concat());
    let (mut mean, mut covariance) = (new(&[m])?, new(&[m, m])?);
    let mut weights = Output::new(py, s.shape)?;
    let mut found = repeated(Consistency { statistic: 0.0, p_value: 1.0, present: 0 }, count)?;
    let outputs = chunks(mean.values()?, m, count)
        .zip(chunks(covariance.values()?, m * m, count))
        .zip(chunks(weights.values()?, s.len(), count))
        .map(|((mean, covariance), weights)| InstantFusion { mean, covariance, weights })
        .zip(&mut found);
    let cost = fuse_ns(sensors, m, &weighting, cross.is_some()) * count as f64;
    release(py, cost, || {
        let new = || fusing(sensors, m, weighting.clone(), instants.period);
        let items = x.iter().zip(s.iter()).enumerate().zip(outputs);
        for_each_row(items, cost, n_threads, new, |solver, ((row, (x, s)), (mut out, found))| {
            let cross = cross.as_ref().map(|rows| &rows.values[row * rows.len()..][..rows.len()]);
            let instant = Instant { estimates: x, covariances: s, cross };
            *found = solver.fuse(&instant, &mut out)?;
            Ok(())
        })
    })
    .map_err(|failure| s.error(failure))?;
    let column = |f: fn(&Consistency) -> f64| array(py, x.batch(), found.iter().map(f).collect());
    let (statistic, p_value) = (column(|c| c.statistic)?, column(|c| c.p_value)?);
    let present = array(py, x.batch(), found.iter().map(|c| c.present as i64).collect())?;
    let [mean, covariance, weights] = [mean, covariance, weights].map(Output::into_array);
    Ok(([mean, covariance, weights, statistic, p_value], present))
}
