//! Bindings of `tertia::smoothing`.

use crate::arrays::{Output, Samples, array, chunks, release, repeated, value_error};
use crate::kalman::shared;
use numpy::PyArrayDyn;
use pyo3::prelude::*;
use std::num::NonZero;
use tertia::batch::for_each_row;
use tertia::smoothing::{
    self, Degree, Fit, JerkFit, Noise, Polynomial, Prior, Record, Smoothed, Summary, Track,
    Workspace,
};

/// Cost of an instant and tap of the polynomial, for the choice of threads.
const TAP_NS: f64 = 2.0;
/// Cost of an instant of the smoother with a state of three, likewise.
const SMOOTH_NS: f64 = 500.0;
/// Filters in a fit of the jerk.
const FIT: f64 = 20.0;

type Array<'py> = Bound<'py, PyArrayDyn<f64>>;
type Threads = Option<NonZero<usize>>;
type Fitted<'py> = (Array<'py>, Array<'py>, Bound<'py, PyArrayDyn<i64>>, Array<'py>, Array<'py>);
type Smooth<'py> = (
    Array<'py>,
    Array<'py>,
    Array<'py>,
    Array<'py>,
    Bound<'py, PyArrayDyn<i64>>,
    Array<'py>,
    Array<'py>,
);

/// Value, sigma, degree, residual variance and degrees of freedom of every row. `time` and
/// `variance` may have one row for all, `variance` one number in a row.
#[pyfunction]
#[allow(clippy::too_many_arguments)] // those of the Python function
pub fn local_polynomial<'py>(
    py: Python<'py>,
    y: &Bound<'py, PyAny>,
    time: Option<&Bound<'py, PyAny>>,
    variance: Option<&Bound<'py, PyAny>>,
    window: usize,
    degree: usize,
    adaptive: bool,
    derivative: usize,
    significance: f64,
    n_threads: Threads,
) -> PyResult<Fitted<'py>> {
    let samples = Samples::extract(y, "y")?;
    let time = time.map(|time| Samples::extract(time, "time")).transpose()?;
    let variance = variance.map(|value| Samples::extract(value, "variance")).transpose()?;
    let rows = samples.rows(0)?;
    let time = time.as_ref().map(|time| time.rows(0)).transpose()?;
    let variance = variance.as_ref().map(|variance| variance.rows(0)).transpose()?;
    let chosen = if adaptive { Degree::Adaptive(degree) } else { Degree::Fixed(degree) };
    let polynomial =
        Polynomial::try_new(window, chosen, derivative, significance).map_err(value_error)?;
    let (n, count) = (rows.len(), rows.count());
    let mut value = Output::new(py, rows.shape)?;
    let mut sigma = Output::new(py, rows.shape)?;
    let mut used = Output::new(py, rows.shape)?;
    let mut fits =
        repeated(Fit { residual_variance: f64::NAN, degrees_of_freedom: f64::NAN }, count)?;
    let cost = TAP_NS * (n * count) as f64 * window.min(n) as f64;
    let outputs = chunks(value.values()?, n, count)
        .zip(chunks(sigma.values()?, n, count))
        .zip(chunks(used.values()?, n, count))
        .zip(&mut fits);
    release(py, cost, || {
        let items = rows.iter().enumerate().zip(outputs);
        let new = || polynomial.clone();
        for_each_row(items, cost, n_threads, new, |polynomial, ((row, y), out)| {
            let (((value, sigma), degree), fit) = out;
            let time = time.as_ref().map(|rows| shared(rows, row));
            let variance = variance.as_ref().map(|rows| shared(rows, row));
            let record = Record { y, time, variance };
            *fit = polynomial.smooth(&record, &mut smoothing::Output { value, sigma, degree })?;
            Ok(())
        })
    })
    .map_err(|failure| rows.error(failure))?;
    let column = |f: fn(&Fit) -> f64| array(py, rows.batch(), fits.iter().map(f).collect());
    Ok((
        value.into_array(),
        sigma.into_array(),
        used.into_array(),
        column(|fit| fit.residual_variance)?,
        column(|fit| fit.degrees_of_freedom)?,
    ))
}

/// Tracks of D axes: `time`, `covariance`, `jerk` and `initial` (mean, then covariance row by row)
/// may have one row for all.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Tracks<'py> {
    y: Bound<'py, PyAny>,
    time: Bound<'py, PyAny>,
    covariance: Bound<'py, PyAny>,
    /// Whether every instant has a covariance of its own.
    each: bool,
    jerk: Option<Bound<'py, PyAny>>,
    initial: Option<Bound<'py, PyAny>>,
}

/// Means, covariances, innovations, likelihood, count, jerk and its standard uncertainty.
#[pyfunction]
pub fn smooth<'py>(
    py: Python<'py>,
    tracks: Tracks<'py>,
    n_threads: Threads,
) -> PyResult<Smooth<'py>> {
    let optional = |value: &Option<Bound<'py, PyAny>>, name| {
        value.as_ref().map(|value| Samples::extract(value, name)).transpose()
    };
    let y = Samples::extract(&tracks.y, "y")?;
    let time = Samples::extract(&tracks.time, "time")?;
    let covariance = Samples::extract(&tracks.covariance, "covariance")?;
    let (jerk, initial) = (optional(&tracks.jerk, "jerk")?, optional(&tracks.initial, "initial")?);
    let y = y.blocks(2)?;
    let (time, covariance) = (time.rows(0)?, covariance.blocks(if tracks.each { 3 } else { 2 })?);
    let jerk = jerk.as_ref().map(|jerk| jerk.rows(1)).transpose()?;
    let initial = initial.as_ref().map(|initial| initial.rows(1)).transpose()?;
    let (d, count) = (y.shape[y.shape.len() - 1], y.count());
    let (n, states) = (time.len(), 3 * d);
    let instants = &y.shape[..y.shape.len() - 1];
    let mut mean = Output::new(py, &[instants, &[states]].concat())?;
    let mut matrices = Output::new(py, &[instants, &[states, states]].concat())?;
    let mut innovation = Output::new(py, y.shape)?;
    let unsmoothed = (
        Summary { log_likelihood: 0.0, count: 0 },
        JerkFit { jerk: 0.0, relative_error: f64::NAN },
    );
    let mut summaries = repeated(unsmoothed, count)?;
    let passes = if jerk.is_some() { 1.0 } else { 1.0 + FIT };
    let cost = SMOOTH_NS * passes * (n * count * d * d) as f64;
    let outputs = chunks(mean.values()?, n * states, count)
        .zip(chunks(matrices.values()?, n * states * states, count))
        .zip(chunks(innovation.values()?, n * d, count))
        .zip(&mut summaries);
    release(py, cost, || {
        let items = y.iter().enumerate().zip(outputs);
        for_each_row(items, cost, n_threads, Workspace::default, |workspace, ((row, y), out)| {
            let (((mean, covariance_out), innovation), summary) = out;
            let matrices = shared(&covariance, row);
            let noise = if tracks.each { Noise::Each(matrices) } else { Noise::Same(matrices) };
            let prior = initial.as_ref().map(|initial| {
                let (mean, covariance) = shared(initial, row).split_at(states);
                Prior { mean, covariance }
            });
            let track = Track::try_new(d, shared(&time, row), y, noise, prior)?;
            let fit = match &jerk {
                Some(jerk) => JerkFit { jerk: shared(jerk, row)[0], relative_error: 0.0 },
                None => smoothing::fit_jerk(&track, workspace),
            };
            let mut results = Smoothed { mean, covariance: covariance_out, innovation };
            *summary = (smoothing::smooth(&track, fit.jerk, workspace, &mut results), fit);
            Ok(())
        })
    })
    .map_err(|failure| y.error(failure))?;
    let column =
        |f: fn(&(Summary, JerkFit)) -> f64| array(py, y.batch(), summaries.iter().map(f).collect());
    let counts = summaries.iter().map(|(summary, _)| summary.count as i64).collect();
    Ok((
        mean.into_array(),
        matrices.into_array(),
        innovation.into_array(),
        column(|(summary, _)| summary.log_likelihood)?,
        array(py, y.batch(), counts)?,
        column(|(_, fit)| fit.jerk)?,
        column(|(_, fit)| fit.sigma())?,
    ))
}
