//! Estimates of several sensors, and of one sensor with a scalar.

use crate::arrays::{Output, Samples, array, chunks, release, repeated, room_for, value_error};
use crate::screening::unknown;
use numpy::PyArrayDyn;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::num::NonZero;
use tertia::batch::for_each_row;
use tertia::fusion::{Agreement, Estimates, FusedEstimate, Scalar, Weighting, fusing};
use tertia::kalman::require_period;

type Array<'py, T> = Bound<'py, PyArrayDyn<T>>;
/// Means, covariances, weights, statistics, their p-values; and degrees of freedom.
type Fused<'py> = ([Array<'py, f64>; 5], Array<'py, i64>);

/// Estimates (..., K, m), covariances (..., K, m, m) and those between sensors (..., K, K, m, m), of
/// one batch; weights (K) for "static".
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Given<'py> {
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

/// Cost of a product of two matrices, measured.
fn product_ns(m: f64) -> f64 {
    20.0 + 2.0 * m.powi(3)
}

/// Cost of the fusion of K estimates of m components, measured.
fn fuse_ns(sensors: usize, m: usize, weighting: &Weighting, joint: bool) -> f64 {
    let (k, m) = (sensors as f64, m as f64);
    // to read the joint covariance
    let reading = if joint { 0.5 * (k * m).powi(3) + 5.0 * (k * m).powi(2) } else { 0.0 };
    200.0
        + reading
        + match weighting {
            Weighting::Matrix if joint => 0.5 * k.powi(3) * product_ns(m),
            Weighting::Matrix => 2.0 * k * product_ns(m),
            Weighting::Intersection => 10.0 * (k * product_ns(m) + k * k * m * m + k.powi(3) / 3.0),
            _ => 2.0 * k * k * m * m,
        }
}

/// Matrices that the kernel keeps for every two sensors.
const MATRICES: usize = 4;

/// Room for the results of a batch.
struct Results<'py> {
    mean: Output<'py, f64>,
    covariance: Output<'py, f64>,
    weights: Output<'py, f64>,
    agreements: Vec<Agreement>,
}

impl<'py> Results<'py> {
    fn new(py: Python<'py>, batch: &[usize], m: usize, weights: &[usize]) -> PyResult<Self> {
        let new = |tail: &[usize]| Output::new(py, &[batch, tail].concat());
        let none = Agreement { statistic: 0.0, degrees_of_freedom: 0, pvalue: 1.0 };
        Ok(Self {
            mean: new(&[m])?,
            covariance: new(&[m, m])?,
            weights: new(weights)?,
            agreements: repeated(none, batch.iter().product())?,
        })
    }

    /// Where each result goes.
    fn rows(
        &mut self,
        m: usize,
        weights: usize,
    ) -> PyResult<impl ExactSizeIterator<Item = (FusedEstimate<'_>, &mut Agreement)> + Send> {
        let count = self.agreements.len();
        Ok(chunks(self.mean.values()?, m, count)
            .zip(chunks(self.covariance.values()?, m * m, count))
            .zip(chunks(self.weights.values()?, weights, count))
            .map(|((mean, covariance), weights)| FusedEstimate { mean, covariance, weights })
            .zip(&mut self.agreements))
    }

    fn into_arrays(self, py: Python<'py>, batch: &[usize]) -> PyResult<Fused<'py>> {
        let column =
            |of: fn(&Agreement) -> f64| array(py, batch, self.agreements.iter().map(of).collect());
        let (statistic, pvalue) = (column(|a| a.statistic)?, column(|a| a.pvalue)?);
        let degrees = self.agreements.iter().map(|a| a.degrees_of_freedom as i64).collect();
        let degrees = array(py, batch, degrees)?;
        let arrays = [self.mean, self.covariance, self.weights].map(Output::into_array);
        let [mean, covariance, weights] = arrays;
        Ok(([mean, covariance, weights, statistic, pvalue], degrees))
    }
}

/// Estimates of several sensors, fused.
#[pyfunction]
pub fn fuse<'py>(
    py: Python<'py>,
    given: Given<'py>,
    n_threads: Option<NonZero<usize>>,
) -> PyResult<Fused<'py>> {
    let estimates = Samples::extract(&given.estimates, "estimates")?;
    let covariances = Samples::extract(&given.covariances, "covariances")?;
    let cross = given.cross_covariances.as_ref();
    let cross = cross.map(|value| Samples::extract(value, "cross_covariances")).transpose()?;
    let weighting = weighting(&given.method, given.weights)?;
    if let Some(period) = given.period {
        require_period(period).map_err(value_error)?;
    }
    let &[.., sensors, m] = estimates.shape() else {
        return Err(PyValueError::new_err("estimates must be of shape (..., K, m)"));
    };
    let pairs = if cross.is_some() { sensors.saturating_mul(sensors) } else { sensors };
    room_for::<f64>(MATRICES.saturating_mul(pairs).saturating_mul(m).saturating_mul(m))?;
    let (x, s) = (estimates.blocks(2)?, covariances.blocks(3)?);
    let cross = cross.as_ref().map(|samples| samples.blocks(4)).transpose()?;
    let mut results = Results::new(py, x.batch(), m, &[sensors, m, m])?;
    let outputs = results.rows(m, s.len())?;
    let cost = fuse_ns(sensors, m, &weighting, cross.is_some()) * x.count() as f64;
    release(py, cost, || {
        let new = || fusing(sensors, m, weighting.clone(), given.period);
        let items = x.iter().zip(s.iter()).enumerate().zip(outputs);
        for_each_row(items, cost, n_threads, new, |solver, ((row, (x, s)), (mut out, found))| {
            let cross = cross.as_ref().map(|rows| &rows.values[row * rows.len()..][..rows.len()]);
            *found = solver.fuse(&Estimates { values: x, covariances: s, cross }, &mut out)?;
            Ok(())
        })
    })
    .map_err(|failure| s.error(failure))?;
    results.into_arrays(py, x.batch())
}

/// Estimates (..., m) with covariances (..., m, m) and scalars, value and sigma (..., 2), of which
/// h (..., m) are the derivatives; the weights are the scalars' gains.
#[pyfunction]
pub fn fuse_scalar<'py>(
    py: Python<'py>,
    estimate: &Bound<'py, PyAny>,
    covariance: &Bound<'py, PyAny>,
    h: &Bound<'py, PyAny>,
    scalars: &Bound<'py, PyAny>,
    n_threads: Option<NonZero<usize>>,
) -> PyResult<Fused<'py>> {
    let covariance = Samples::extract(covariance, "covariance")?;
    let given = [(estimate, "estimate"), (h, "h"), (scalars, "scalars")];
    let [estimate, h, scalars] = given.map(|(value, name)| Samples::extract(value, name));
    let (estimate, h, scalars) = (estimate?, h?, scalars?);
    let s = covariance.blocks(2)?;
    let (x, h, scalars) = (estimate.blocks(1)?, h.blocks(1)?, scalars.blocks(1)?);
    let m = x.len();
    room_for::<f64>(MATRICES.saturating_mul(m).saturating_mul(m))?;
    let mut results = Results::new(py, x.batch(), m, &[m])?;
    let outputs = results.rows(m, m)?;
    let cost = 2.0 * product_ns(m as f64) * x.count() as f64;
    release(py, cost, || {
        let new = || fusing(1, m, Weighting::Matrix, None);
        let items = x.iter().zip(s.iter()).zip(h.iter().zip(scalars.iter())).zip(outputs);
        for_each_row(items, cost, n_threads, new, |solver, (((x, s), (h, z)), (mut out, found))| {
            let scalar = Scalar { estimate: x, covariance: s, h, value: z[0], sigma: z[1] };
            *found = solver.fuse_scalar(&scalar, &mut out)?;
            Ok(())
        })
    })
    .map_err(|failure| s.error(failure))?;
    results.into_arrays(py, x.batch())
}
