//! The fit without plots that are far from the track: otherwise a few outliers would dominate the
//! result.

use super::NoiseFit;
use super::recording::Recording;
use crate::base::angle::require_period;
use crate::base::batch::for_each_row;
use crate::base::error::{Error, Result, require};
use crate::kalman::filter::Filter;
use crate::kalman::model::Singer;
use crate::kalman::series::{PerStep, Series};
use crate::kalman::smoother::{Workspace, smooth};
use crate::kalman::state::residual;
use std::num::NonZero;

/// Smallest number of plots that are fitted.
const FEWEST_PLOTS: usize = 10;
const MOST_PASSES: usize = 10;
/// Smallest variance of a residual, as a share of the variance of a plot: a plot that alone determines
/// the track has no residual of its own.
const LEAST_VARIANCE: f64 = 1e-6;
/// Time per step of the smoother, for the choice of the number of threads.
const STEP_NS: f64 = 120.0;

/// Fits noise and motion to a recording, and returns the marks of the plots that were left out: those
/// more than `gate` standard deviations from the track estimated from all other plots, in repeated
/// passes. Without a gate no plot is left out. The cost is that of about 150 filter runs, and the same
/// again for each pass that finds outliers.
///
/// # Errors
/// If there are fewer than ten plots, the plots lie exactly on a line or a parabola, or no time passes.
pub fn fit_noise(
    recording: &Recording<'_>,
    gate: Option<f64>,
    n_threads: Option<NonZero<usize>>,
) -> Result<(NoiseFit, Vec<bool>)> {
    if let Some(period) = recording.period {
        require_period(period)?;
    }
    if let Some(gate) = gate {
        require("outlier_gate", gate, gate > 0.0, "a positive number")?;
    }
    let mut outlier = vec![false; recording.z.len()];
    let count = present(recording.z);
    if count < FEWEST_PLOTS {
        return Err(Error::TooFew { argument: "z", count, minimum: FEWEST_PLOTS });
    }
    let mut fit = NoiseFit::of(recording, n_threads)?;
    let Some(gate) = gate else { return Ok((fit, outlier)) };
    let mut z = recording.z.to_vec();
    for pass in 1.. {
        let left = Recording { z: &z, ..*recording };
        let far = far_off(&left, &fit, gate, n_threads)?;
        let rest: Vec<f64> =
            z.iter().zip(&far).map(|(&z, &far)| if far { f64::NAN } else { z }).collect();
        if !far.contains(&true) || present(&rest) < FEWEST_PLOTS {
            break;
        }
        outlier.iter_mut().zip(far).for_each(|(outlier, far)| *outlier |= far);
        z = rest;
        if pass == MOST_PASSES {
            break;
        }
        fit = NoiseFit::of(&Recording { z: &z, ..*recording }, n_threads)?;
    }
    Ok((fit, outlier))
}

fn present(z: &[f64]) -> usize {
    z.iter().filter(|z| !z.is_nan()).count()
}

/// Returns marks of the plots that are far from the smoothed track.
fn far_off(
    recording: &Recording<'_>,
    fit: &NoiseFit,
    gate: f64,
    n_threads: Option<NonZero<usize>>,
) -> Result<Vec<bool>> {
    let Recording { z, steps, dt, period } = *recording;
    let [alpha, acceleration_sigma, sigma] = fit.estimates;
    let (model, r) = (Singer::try_new(alpha, acceleration_sigma, true)?, sigma * sigma);
    let mut far = vec![false; z.len()];
    let rows = z.chunks_exact(steps).zip(far.chunks_exact_mut(steps)).enumerate();
    let new = || (Vec::new(), Workspace::default());
    let cost = STEP_NS * z.len() as f64;
    for_each_row(rows, cost, n_threads, new, |(buffer, workspace), (row, (z, far))| {
        let transition = model.over_all(dt.row(row), buffer)?;
        let series = Series::try_new(z, PerStep::Constant(r), transition)?;
        let filter = Filter::new(model.acceleration_variance(), period);
        smooth(&series, filter, workspace, |step, state| {
            let off = residual(z[step], state.mean[0], period);
            // z minus the smoothed angle has the variance R − P; leaving z out multiplies both by the
            // same factor
            let spread = (r - state.covariance[0]).max(LEAST_VARIANCE * r);
            far[step] = off * off > gate * gate * spread;
        });
        Ok(())
    })
    .map_err(|failure| failure.error)?;
    Ok(far)
}
