//! Bindings of `tertia::smoothing`.

use crate::arrays::{
    Array, Input, Integers, Output, Threads, array, columns, repeated, value_error,
};
use pyo3::prelude::*;
use std::borrow::Cow;
use tertia::smoothing::{
    self, Degree, Fit, Noise, NoiseFit, Options, Polynomial, Prior, ProcessNoise, ProcessNoiseFit,
    Record, Smoothed, Summary, Track, Velocities, Workspace,
};

/// Cost of an instant and tap of the polynomial, which determines the number of threads.
const TAP_NS: f64 = 2.0;
/// Cost of an instant of the smoother with a state of three, which determines the number of threads.
const SMOOTH_NS: f64 = 500.0;
/// Number of filters in a fit of the jerk.
const FIT: f64 = 20.0;

type Fitted<'py> = (Output<'py>, Output<'py>, Output<'py, i64>, Array<'py>, Array<'py>);
type States<'py> = (Output<'py>, Output<'py>, Output<'py>, Output<'py, bool>);
/// Log-likelihoods, counts, jerks with their sigmas, correlation times, noise factors, frequencies.
type Scalars<'py> = (Array<'py>, Integers<'py>, [Array<'py>; 9]);

/// Value, sigma, degree, residual variance and degrees of freedom of every row. `time` and
/// `variance` may have one row for all, and `variance` one number per row.
#[pyfunction]
#[allow(clippy::too_many_arguments)] // those of the Python function
pub fn local_polynomial<'py>(
    py: Python<'py>,
    y: Input<'py>,
    time: Option<Input<'py>>,
    variance: Option<Input<'py>>,
    window: usize,
    degree: usize,
    adaptive: bool,
    derivative: usize,
    significance: f64,
    n_threads: Threads,
) -> PyResult<Fitted<'py>> {
    let rows = y.rows("y", 0)?;
    let time = time.as_ref().map(|time| time.rows("time", 0)).transpose()?;
    let variance = variance.as_ref().map(|value| value.rows("variance", 0)).transpose()?;
    let chosen = if adaptive { Degree::Adaptive(degree) } else { Degree::Fixed(degree) };
    let polynomial =
        Polynomial::try_new(window, chosen, derivative, significance).map_err(value_error)?;
    let (mut value, mut sigma, mut used) = (rows.output(py)?, rows.output(py)?, rows.output(py)?);
    let none = Fit { residual_variance: f64::NAN, degrees_of_freedom: f64::NAN };
    let mut fits = repeated(none, rows.count())?;
    let cost = TAP_NS * rows.size() * window.min(rows.len()) as f64;
    let outputs = value.rows()?.zip(sigma.rows()?).zip(used.rows()?).zip(&mut fits);
    let new = || polynomial.clone();
    rows.each(py, cost, n_threads, outputs, new, |polynomial, (row, y), out| {
        let (((value, sigma), degree), fit) = out;
        let time = time.as_ref().map(|rows| rows.shared(row));
        let variance = variance.as_ref().map(|rows| rows.shared(row));
        let record = Record { y, time, variance };
        *fit = polynomial.smooth(&record, &mut smoothing::Output { value, sigma, degree })?;
        Ok(())
    })?;
    let of: [fn(&Fit) -> f64; 2] = [|fit| fit.residual_variance, |fit| fit.degrees_of_freedom];
    let [residual_variance, degrees] = columns(py, rows.batch(), &fits, of)?;
    Ok((value, sigma, used, residual_variance, degrees))
}

/// Tracks of D axes; `time`, `covariance`, `jerk` and `initial` (mean, then covariance row by row)
/// may have one row for all.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Tracks<'py> {
    y: Input<'py>,
    time: Input<'py>,
    covariance: Input<'py>,
    /// Whether every instant has a covariance of its own.
    each: bool,
    /// Velocities, their covariances, and whether every instant has one of its own.
    velocity: Option<(Input<'py>, Input<'py>, bool)>,
    jerk: Option<Input<'py>>,
    initial: Option<Input<'py>>,
    correlation_time: Option<f64>,
    robust: bool,
}

/// Means, covariances, innovations and outliers; log-likelihoods, counts, jerks, acceleration
/// noise, the estimated noise, and the angular frequencies of oscillations.
#[pyfunction]
pub fn smooth<'py>(
    py: Python<'py>,
    tracks: Tracks<'py>,
    n_threads: Threads,
) -> PyResult<(States<'py>, Scalars<'py>)> {
    let (y, time) = (tracks.y.blocks("y", 2)?, tracks.time.rows("time", 0)?);
    let covariance = tracks.covariance.blocks("covariance", if tracks.each { 3 } else { 2 })?;
    let jerk = tracks.jerk.as_ref().map(|jerk| jerk.rows("jerk", 1)).transpose()?;
    let initial = tracks.initial.as_ref().map(|value| value.rows("initial", 1)).transpose()?;
    let velocity = tracks.velocity.as_ref().map(|(velocity, covariance, each)| {
        let velocity = velocity.blocks("velocity", 2)?;
        let axes = if *each { 3 } else { 2 };
        Ok::<_, PyErr>((velocity, covariance.blocks("velocity_covariance", axes)?, *each))
    });
    let velocity = velocity.transpose()?;
    let (d, n) = (y.shape[y.shape.len() - 1], time.len());
    let numbers = if velocity.is_some() { 2 * d } else { d };
    let (states, each) = (3 * d, tracks.each);
    let new = |tail: &[usize]| Output::new(py, y.batch(), tail);
    let (mut mean, mut matrices) = (new(&[n, states])?, new(&[n, states, states])?);
    let mut innovation = new(&[n, numbers])?;
    let mut outlier = Output::new(py, y.batch(), &[n, numbers / d.max(1)])?;
    let mut summaries = repeated(unsmoothed(), y.count())?;
    let passes = if jerk.is_some() { 1.0 } else { 1.0 + FIT };
    let cost = SMOOTH_NS * passes * y.size() * numbers as f64;
    let outputs = mean.rows()?.zip(matrices.rows()?).zip(innovation.rows()?.zip(outlier.rows()?));
    let outputs = outputs.zip(&mut summaries);
    y.each(py, cost, n_threads, outputs, Workspace::default, |workspace, (row, y), out| {
        let (((mean, covariance_out), (innovation, outlier)), summary) = out;
        let noise_of =
            |matrices, each| if each { Noise::Each(matrices) } else { Noise::Same(matrices) };
        let noise = noise_of(covariance.shared(row), each);
        let velocities = velocity.as_ref().map(|(velocity, covariance, each)| Velocities {
            velocity: velocity.shared(row),
            noise: noise_of(covariance.shared(row), *each),
        });
        let prior = initial.as_ref().map(|initial| {
            let (mean, covariance) = initial.shared(row).split_at(states);
            Prior { mean, covariance }
        });
        let time = time.shared(row);
        let (kept, repeats) = without_repeats(d, y, noise, tracks.robust);
        let track = Track::with_velocities(d, time, &kept, noise, velocities, prior)?;
        let options = Options {
            jerk: jerk.as_ref().map(|jerk| jerk.shared(row)[0]),
            correlation_time: tracks.correlation_time,
            robust: tracks.robust,
        };
        let mut results = Smoothed { mean, covariance: covariance_out, innovation };
        *summary = smoothing::smooth_with_noise(&track, &options, workspace, &mut results, outlier);
        for (outlier, repeats) in outlier.chunks_exact_mut((numbers / d.max(1)).max(1)).zip(repeats)
        {
            outlier[0] |= repeats;
        }
        Ok(())
    })?;
    Ok(((mean, matrices, innovation, outlier), scalars(py, y.batch(), &summaries)?))
}

/// Returns the plots (N, D) with repeated plots left out, and which these are. Repeated plots are left
/// out only if `robust` is set.
fn without_repeats<'a>(
    d: usize,
    y: &'a [f64],
    noise: Noise<'_>,
    robust: bool,
) -> (Cow<'a, [f64]>, Vec<bool>) {
    let repeats = if robust { smoothing::repeated(d, y, noise) } else { Vec::new() };
    if !repeats.contains(&true) {
        return (Cow::Borrowed(y), repeats);
    }
    let keep = |(at, y): (usize, &f64)| if repeats[at / d] { f64::NAN } else { *y };
    let kept = y.iter().enumerate().map(keep).collect();
    (Cow::Owned(kept), repeats)
}

/// Result of a track that is not smoothed yet.
fn unsmoothed() -> (Summary, NoiseFit) {
    let motion = ProcessNoiseFit { motion: ProcessNoise::with_jerk(0.0), relative_error: f64::NAN };
    (Summary { log_likelihood: 0.0, count: 0 }, NoiseFit::as_stated(motion))
}

/// Log-likelihoods, counts, and the estimates of motion and noise.
fn scalars<'py>(
    py: Python<'py>,
    batch: &[usize],
    summaries: &[(Summary, NoiseFit)],
) -> PyResult<Scalars<'py>> {
    type Scalar = fn(&(Summary, NoiseFit)) -> f64;
    let of: [Scalar; 10] = [
        |(summary, _)| summary.log_likelihood,
        |(_, noise)| noise.motion.motion.jerk,
        |(_, noise)| noise.motion.sigma(),
        |(_, noise)| noise.motion.motion.acceleration,
        |(_, noise)| noise.correlation_time,
        |(_, noise)| noise.noise_factor,
        |(_, noise)| noise.velocity_noise_factor,
        |(_, noise)| noise.velocity_time_offset,
        |(_, noise)| noise.motion.motion.velocity,
        |(_, noise)| noise.frequency,
    ];
    let [likelihood, noise @ ..] = columns(py, batch, summaries, of)?;
    let count = array(py, batch, summaries.iter().map(|(summary, _)| summary.count as i64))?;
    Ok((likelihood, count, noise))
}
