//! Trajectory: positions along time from what several stations measured, some of it wrong.
//!
//! By [`reconstruct`] every instant is located, and the positions are smoothed; what the smooth path
//! contradicts is left out, positions are linearised about the path, and constant biases of the
//! stations are estimated from contradictions between them. [`by_polynomials`] smooths positions
//! without a model of motion, [`temporal_first`] what each station measured. Cost O(N K).

// indices are those of the formulas
#![allow(clippy::needless_range_loop)]

mod bias;
mod failure;
mod fixes;
mod found;
mod jerk;
mod measured;
mod path;
mod series;
mod spatial;
mod temporal;
mod tukey;
mod weight;

pub use failure::Failure;
pub use fixes::Fixes;
pub use measured::Record;
pub use series::Polynomials;
pub use spatial::by_polynomials;
pub use temporal::temporal_first;

use crate::sensors::KINDS;
use crate::smoothing::{JerkFit, Summary};
use bias::Biases;
use found::{Found, Setting};
use measured::Measured;
use std::rc::Rc;

/// Rounds of estimating biases.
const ROUNDS: usize = 10;

/// What came out.
#[derive(Clone, Debug)]
pub struct Trajectory {
    /// Positions, velocities and accelerations (N, 3D); nan where unknown.
    pub mean: Vec<f64>,
    /// Their covariances (N, 3D, 3D), ∞ where unknown, with the uncertainty of jerk and biases.
    pub covariance: Vec<f64>,
    /// What the smoother of positions found; none with polynomials, and of smoothed measurements.
    pub smoothed: Option<Smoothed>,
    /// Positions of the single instants.
    pub fixes: Fixes,
    /// Measurements that were left out (N, 4, K).
    pub outlier: Vec<bool>,
    /// Whitened residuals about the trajectory (N, 4, K), without biases.
    pub residual: Vec<f64>,
    /// Biases and their standard deviations (4, K): 0 and ∞ where nothing was measured, 0 and 0 of
    /// kinds that were not asked for. None if none was.
    pub bias: Option<(Vec<f64>, Vec<f64>)>,
}

/// What a smoother with white jerk found.
#[derive(Clone, Debug)]
pub struct Smoothed {
    /// Covariances of the states (N, 3D, 3D) without the uncertainty of jerk and biases.
    pub covariance: Vec<f64>,
    /// Innovations (N, D).
    pub innovation: Vec<f64>,
    /// Likelihood and count.
    pub summary: Summary,
    /// The jerk that was given or found.
    pub fit: JerkFit,
}

impl Trajectory {
    /// States that follow from positions of the instants, without biases.
    fn of_fixes<const D: usize, const N: usize>(
        record: &Record<'_>,
        fixes: Fixes,
        mean: Vec<f64>,
        covariance: Vec<f64>,
    ) -> Self {
        let residual = residuals::<D, N>(record, None, &mean);
        let outlier = fixes.outlier.clone();
        Self { mean, covariance, smoothed: None, fixes, outlier, residual, bias: None }
    }
}

/// Diagonal matrices (N, S, S) of variances (N, S).
fn without_correlations(variance: &[f64], size: usize) -> Vec<f64> {
    let mut matrices = vec![0.0; variance.len() * size];
    for (at, variance) in variance.iter().enumerate() {
        matrices[at * size + at % size] = *variance;
    }
    matrices
}

/// Locates every instant, then smooths the positions. Of the `biased` kinds, in the order of an
/// instant's rows, each station's bias is estimated. N is 3 D.
///
/// # Errors
/// No instant that can be located, or biases that the measurements do not determine.
pub fn reconstruct<const D: usize, const N: usize>(
    record: &Record<'_>,
    jerk: Option<f64>,
    biased: &[usize],
) -> Result<Trajectory, Failure> {
    let mut setting = Setting { record, jerk, smoother: Default::default() };
    let measured = Rc::new(Measured::<D>::new(record, record.values.to_vec()));
    let found = Found::<D, N>::first(&mut setting, &measured)?;
    let found = found.without_outliers(&mut setting, &measured)?;
    let columns = seen(record, biased);
    let (mut found, biases) = bias::rounds(&mut setting, found, &columns, ROUNDS)?;
    found.relinearise(&mut setting, jerk, 0)?;
    let track = found.plots.track(record.time, D)?;
    let fit = setting.smoother.with_error(&track, found.path.fit);
    let (best, innovation) = setting.smoother.finish(&track, fit);
    let mut covariance = match jerk {
        Some(_) => best.covariance.clone(),
        None => jerk::mixed(&mut setting, &found, &best)?,
    };
    if let Some(biases) = &biases {
        biases.add_effect(&mut setting, best.fit.jerk, &mut covariance)?;
    }
    let outlier = (0..found.trust.len()).map(|at| found.is_outlier(at)).collect();
    let residual = residuals::<D, N>(record, biases.as_ref(), &best.mean);
    Ok(Trajectory {
        covariance,
        smoothed: Some(Smoothed {
            covariance: best.covariance,
            innovation,
            summary: best.summary,
            fit: best.fit,
        }),
        mean: best.mean,
        outlier,
        residual,
        bias: biases.map(|biases| by_station(record, &biases, biased)),
        fixes: found.fixes,
    })
}

/// Numbers of an instant whose biases are estimated: of these kinds, what was measured at all.
fn seen(record: &Record<'_>, biased: &[usize]) -> Vec<usize> {
    let (width, k) = (record.width(), record.width() / KINDS);
    let all = biased.iter().flat_map(|kind| kind * k..(kind + 1) * k);
    all.filter(|at| record.values.iter().skip(*at).step_by(width).any(|v| !v.is_nan())).collect()
}

fn by_station(record: &Record<'_>, biases: &Biases, biased: &[usize]) -> (Vec<f64>, Vec<f64>) {
    let (width, k) = (record.width(), record.width() / KINDS);
    let (mut values, mut sigmas) = (vec![0.0; width], vec![0.0; width]);
    for kind in biased {
        sigmas[kind * k..(kind + 1) * k].fill(f64::INFINITY);
    }
    for (i, &column) in biases.columns.iter().enumerate() {
        (values[column], sigmas[column]) = (biases.values[i], biases.sigma(i));
    }
    (values, sigmas)
}

/// Whitened residuals about states, of measurements without their biases.
fn residuals<const D: usize, const N: usize>(
    record: &Record<'_>,
    biases: Option<&Biases>,
    mean: &[f64],
) -> Vec<f64> {
    let width = record.width();
    let values = match biases {
        None => record.values.to_vec(),
        Some(biases) => biases.removed_from(record.values, width),
    };
    let measured = Measured::<D>::new(record, values);
    let mut residual = vec![f64::NAN; record.values.len()];
    for (t, state) in mean.chunks_exact(N).enumerate() {
        for (m, row) in measured.rows(t, &state[..D]) {
            residual[t * width + measured.column[m]] = row.residual;
        }
    }
    residual
}
