//! Fusion of the estimates of several sensors, and of one sensor with a scalar.

use super::MATRICES;
use crate::arrays::{
    Array, Input, Integers, Output, Threads, array, choice, columns, repeated, room_for,
};
use crate::kalman::check_period;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use tertia::fusion::{
    Agreement, EFFECT_STEPS, Estimates, FusedEstimate, Scalar, Weighting, fusing,
};

/// Means, covariances, weights, sigmas of systematic errors, statistics, p-values; and degrees of freedom.
type Fused<'py> =
    ((Output<'py>, Output<'py>, Output<'py>, Output<'py>, Array<'py>, Array<'py>), Integers<'py>);

/// Estimates (..., K, m), covariances (..., K, m, m) and cross covariances of sensors (..., K, K, m, m)
/// with the same batch; weights (K) for "static", corrections (..., K, m) for "paper".
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Given<'py> {
    estimates: Input<'py>,
    covariances: Input<'py>,
    cross_covariances: Option<Input<'py>>,
    corrections: Option<Input<'py>>,
    weights: Option<Vec<f64>>,
    method: String,
    /// Whether systematic errors are estimated from contradictions; for the method "matrix".
    random_effects: bool,
    period: Option<f64>,
}

fn weighting(name: &str, weights: Option<Vec<f64>>) -> PyResult<Weighting> {
    let choices = [
        ("matrix", Weighting::Matrix),
        ("posterior", Weighting::Posterior),
        ("covariance-intersection", Weighting::Intersection),
        ("static", Weighting::Static(weights.unwrap_or_default())),
        ("equal", Weighting::Equal),
        ("paper", Weighting::Paper),
    ];
    choice("method", name, &choices)
}

/// Cost of a product of two matrices, as measured.
fn product_ns(m: f64) -> f64 {
    20.0 + 2.0 * m.powi(3)
}

/// Cost of the fusion of K estimates of m components, as measured.
fn fuse_ns(sensors: usize, m: usize, weighting: &Weighting, joint: bool) -> f64 {
    let (k, m) = (sensors as f64, m as f64);
    // cost of reading the joint covariance
    let reading = if joint { 0.5 * (k * m).powi(3) + 5.0 * (k * m).powi(2) } else { 0.0 };
    200.0
        + reading
        + match weighting {
            Weighting::Matrix if joint => 0.5 * k.powi(3) * product_ns(m),
            Weighting::Matrix => 2.0 * k * product_ns(m),
            Weighting::RandomEffects => EFFECT_STEPS as f64 * 4.0 * k * product_ns(m),
            Weighting::Intersection => 10.0 * (k * product_ns(m) + k * k * m * m + k.powi(3) / 3.0),
            _ => 2.0 * k * k * m * m,
        }
}

/// Arrays for the results of a batch.
struct Results<'py> {
    mean: Output<'py>,
    covariance: Output<'py>,
    weights: Output<'py>,
    bias_sigma: Output<'py>,
    agreements: Vec<Agreement>,
}

impl<'py> Results<'py> {
    fn new(py: Python<'py>, batch: &[usize], m: usize, weights: &[usize]) -> PyResult<Self> {
        let new = |tail: &[usize]| Output::new(py, batch, tail);
        let none = Agreement { statistic: 0.0, degrees_of_freedom: 0, pvalue: 1.0 };
        Ok(Self {
            mean: new(&[m])?,
            covariance: new(&[m, m])?,
            weights: new(weights)?,
            bias_sigma: new(&[m])?,
            agreements: repeated(none, batch.iter().product())?,
        })
    }

    /// Returns the places for the results of each row.
    fn rows(
        &mut self,
    ) -> PyResult<impl ExactSizeIterator<Item = (FusedEstimate<'_>, &mut Agreement)> + Send> {
        Ok(self
            .mean
            .rows()?
            .zip(self.covariance.rows()?)
            .zip(self.weights.rows()?.zip(self.bias_sigma.rows()?))
            .map(|((mean, covariance), (weights, bias_sigma))| FusedEstimate {
                mean,
                covariance,
                weights,
                bias_sigma,
            })
            .zip(&mut self.agreements))
    }

    fn into_fused(self, py: Python<'py>, batch: &[usize]) -> PyResult<Fused<'py>> {
        let of: [fn(&Agreement) -> f64; 2] = [|a| a.statistic, |a| a.pvalue];
        let [statistic, pvalue] = columns(py, batch, &self.agreements, of)?;
        let degrees = self.agreements.iter().map(|a| a.degrees_of_freedom as i64);
        let degrees = array(py, batch, degrees)?;
        let Self { mean, covariance, weights, bias_sigma, .. } = self;
        Ok(((mean, covariance, weights, bias_sigma, statistic, pvalue), degrees))
    }
}

/// Fuses estimates of several sensors.
#[pyfunction]
pub fn fuse<'py>(py: Python<'py>, given: Given<'py>, n_threads: Threads) -> PyResult<Fused<'py>> {
    let cross = given.cross_covariances.as_ref();
    let weighting = match weighting(&given.method, given.weights)? {
        Weighting::Matrix if given.random_effects => Weighting::RandomEffects,
        weighting => weighting,
    };
    check_period(given.period)?;
    let &[.., sensors, m] = given.estimates.shape() else {
        return Err(PyValueError::new_err("estimates must be of shape (..., K, m)"));
    };
    let pairs = if cross.is_some() { sensors.saturating_mul(sensors) } else { sensors };
    room_for::<f64>(MATRICES.saturating_mul(pairs).saturating_mul(m).saturating_mul(m))?;
    if weighting == Weighting::Intersection {
        room_for::<f64>(MATRICES.saturating_mul(sensors).saturating_mul(sensors))?;
    }
    let cross = cross.map(|cross| cross.blocks("cross_covariances", 4)).transpose()?;
    let corrections = given.corrections.as_ref();
    let corrections = corrections.map(|given| given.blocks("corrections", 2)).transpose()?;
    let x = given.estimates.blocks("estimates", 2)?;
    let s = given.covariances.blocks("covariances", 3)?;
    let mut results = Results::new(py, x.batch(), m, &[sensors, m, m])?;
    let cost = fuse_ns(sensors, m, &weighting, cross.is_some()) * x.count() as f64;
    let new = || fusing(sensors, m, weighting.clone(), given.period);
    let outputs = x.iter().zip(results.rows()?);
    s.each(py, cost, n_threads, outputs, new, |solver, (row, s), (x, (mut out, found))| {
        let cross = cross.as_ref().map(|rows| &rows.values[row * rows.len()..][..rows.len()]);
        let corrections =
            corrections.as_ref().map(|rows| &rows.values[row * rows.len()..][..rows.len()]);
        let estimates = Estimates { values: x, covariances: s, cross, corrections };
        *found = solver.fuse(&estimates, &mut out)?;
        Ok(())
    })?;
    results.into_fused(py, x.batch())
}

/// Fuses estimates (..., m) with covariances (..., m, m) and scalars, given as value and sigma (..., 2),
/// whose derivatives are h (..., m); the weights are the gains of the scalars.
#[pyfunction]
pub fn fuse_scalar<'py>(
    py: Python<'py>,
    estimate: Input<'py>,
    covariance: Input<'py>,
    h: Input<'py>,
    scalars: Input<'py>,
    n_threads: Threads,
) -> PyResult<Fused<'py>> {
    let (x, s) = (estimate.blocks("estimate", 1)?, covariance.blocks("covariance", 2)?);
    let (h, scalars) = (h.blocks("h", 1)?, scalars.blocks("scalars", 1)?);
    let m = x.len();
    room_for::<f64>(MATRICES.saturating_mul(m).saturating_mul(m))?;
    let mut results = Results::new(py, x.batch(), m, &[m])?;
    let cost = 2.0 * product_ns(m as f64) * x.count() as f64;
    let new = || fusing(1, m, Weighting::Matrix, None);
    let outputs = x.iter().zip(h.iter().zip(scalars.iter())).zip(results.rows()?);
    s.each(
        py,
        cost,
        n_threads,
        outputs,
        new,
        |solver, (_, s), ((x, (h, z)), (mut out, found))| {
            let scalar = Scalar { estimate: x, covariance: s, h, value: z[0], sigma: z[1] };
            *found = solver.fuse_scalar(&scalar, &mut out)?;
            Ok(())
        },
    )?;
    results.into_fused(py, x.batch())
}
