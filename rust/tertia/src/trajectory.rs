//! Trajectory: positions along time from what several stations measured, some of it wrong.
//!
//! By [`reconstruct`] every instant is located, and the positions are smoothed; what the smooth path
//! contradicts is left out, positions are linearised about the path, and constant biases of the
//! stations are estimated from contradictions between them. [`by_polynomials`] smooths positions
//! without a model of motion, [`temporal_first`] what each station measured. Cost O(N K).

// indices are those of the formulas
#![allow(clippy::needless_range_loop)]

pub mod arrivals;
mod bias;
mod failure;
mod fixes;
mod found;
mod jerk;
mod measured;
mod path;
mod result;
mod series;
mod spatial;
mod temporal;
mod tukey;
mod weight;

pub use failure::Failure;
pub use fixes::Fixes;
pub use measured::Record;
pub use result::{Smoothed, Trajectory};
pub use series::Polynomials;
pub use spatial::by_polynomials;
pub use temporal::temporal_first;

use crate::sensors::KINDS;
use bias::Biases;
use found::{Found, Setting};
use measured::{Measured, seen};
use result::residuals;
use std::rc::Rc;

/// Rounds of estimating biases.
const ROUNDS: usize = 10;

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
