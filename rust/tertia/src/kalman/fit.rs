//! Maximum-likelihood estimates of the parameters of the Singer model and of the noise of the plots.
//!
//! The coordinates are `x = ln α` and `y = ln p`, where p is the motion added within some time, in
//! units of the noise; the common scale of noise and motion follows in closed form. The likelihood has
//! a finite limit at both ends of both coordinates. The search climbs by Newton's method from the peaks
//! of a coarse grid, and then compares the result with the limits. The unit of time is the usual
//! interval between plots.

mod climb;
mod likelihood;
mod outliers;
mod recording;

use crate::base::error::{Error, Result};
use climb::{FLAT, Peak, differences, highest_peak};
use likelihood::{DIFFERENCE, Likelihood};
use nalgebra::{Matrix4x2, Vector4};
use std::num::NonZero;

pub use outliers::fit_noise;
pub use recording::{Limit, Recording};

/// Intervals shorter than this share of the mean are between plots of different radars, and do not
/// count as usual.
const BRIEF: f64 = 1e-4;
/// Shortest interval between plots: the rate from two plots that are closer in time would be rounding
/// only.
const TOGETHER: f64 = 1e-10;

/// Maximum-likelihood parameters of a recording.
#[derive(Clone, Debug)]
pub struct NoiseFit {
    /// Estimates of α, σ_a and σ of the plots.
    pub estimates: [f64; 3],
    /// Standard uncertainties of the estimates, to first order; ∞ if the recording does not determine
    /// them.
    pub sigma: [f64; 3],
    /// Standard uncertainty of the density `2 σ_a² / α`.
    pub density_sigma: f64,
    /// Log likelihood at the maximum.
    pub log_likelihood: f64,
    /// Number of plots that have an innovation.
    pub count: usize,
    /// Limits at which the maximum is.
    pub limits: Vec<Limit>,
}

impl NoiseFit {
    /// Fits a recording. The cost is that of about 150 filter runs.
    ///
    /// # Errors
    /// If the plots lie exactly on a line or a parabola, or if every series has too few plots.
    fn of(recording: &Recording<'_>, n_threads: Option<NonZero<usize>>) -> Result<Self> {
        let interval = usual_interval(recording.dt.values())?;
        let scaled = |dt: &f64| Some(dt / interval).filter(|&dt| dt >= TOGETHER).unwrap_or(0.0);
        let dt: Vec<f64> = recording.dt.values().iter().map(scaled).collect();
        let in_intervals = Recording { dt: recording.dt.with(&dt), ..*recording };
        let mut likelihood = Likelihood::try_new(&in_intervals, n_threads)?;
        let peak = highest_peak(&mut likelihood)?;
        let (value, logs) = likelihood.at(peak.at)?;
        likelihood.spread(value, "lies on parabolas; there is no noise to be fitted")?;
        let [alpha, acceleration, noise] = logs.map(f64::exp);
        let [alpha, acceleration] = [alpha / interval, acceleration / interval.powi(2)];
        let density = 2.0 * acceleration * acceleration / alpha;
        let errors = relative_errors(&mut likelihood, &peak)?;
        let sigma = |i: usize, estimate: f64| {
            if errors[i].is_finite() { errors[i] * estimate } else { f64::INFINITY }
        };
        Ok(Self {
            estimates: [alpha, acceleration, noise],
            sigma: [sigma(0, alpha), sigma(1, acceleration), sigma(2, noise)],
            density_sigma: sigma(3, density),
            log_likelihood: value,
            count: likelihood.count(),
            limits: likelihood.limits(peak.at),
        })
    }
}

/// Returns the median of the intervals that are not very short.
fn usual_interval(intervals: &[f64]) -> Result<f64> {
    let mut positive: Vec<f64> = intervals.iter().copied().filter(|&dt| dt > 0.0).collect();
    let mean = positive.iter().sum::<f64>() / positive.len() as f64;
    positive.retain(|&dt| dt > BRIEF * mean);
    positive.sort_by(f64::total_cmp);
    let n = positive.len();
    let [below, above] = [n.saturating_sub(1) / 2, n / 2].map(|i| positive.get(i));
    let reason = "no time passes between them; dt must be positive, or time increase";
    let (below, above) =
        below.zip(above).ok_or(Error::Undetermined { argument: "z has plots, but", reason })?;
    Ok(0.5 * (below + above))
}

/// Returns the standard errors of the logarithms of α, σ_a, σ, and the density.
fn relative_errors(likelihood: &mut Likelihood<'_>, peak: &Peak) -> Result<[f64; 4]> {
    let ([x, y], free) = (peak.at, peak.free);
    let (_, second) = differences(likelihood, peak.at, free)?;
    let information = -second;
    let bounds = likelihood.bounds();
    let inside = [0, 1].map(|i| free[i] && bounds[i][0] < peak.at[i] && peak.at[i] < bounds[i][1]);
    let unknown = Ok([f64::INFINITY; 4]);
    let (covariance, determined) = match inside {
        [true, true] if information.symmetric_eigenvalues().min() > FLAT => {
            let Some(covariance) = information.try_inverse() else { return unknown };
            (covariance, inside)
        }
        [_, true] if information[(1, 1)].is_nan() || information[(1, 1)] <= FLAT => return unknown,
        [true, false] if information[(0, 0)] > FLAT => {
            (nalgebra::Matrix2::new(1.0 / information[(0, 0)], 0.0, 0.0, 0.0), inside)
        }
        [_, second] => {
            let variance = if second { 1.0 / information[(1, 1)] } else { 0.0 };
            (nalgebra::Matrix2::new(0.0, 0.0, 0.0, variance), [false, second])
        }
    };
    let slopes = slopes(likelihood, peak.at, determined)?;
    let mut variances = (slopes * covariance * slopes.transpose()).diagonal();
    // the scale has an error of its own: that of the standard deviation of `count` values
    let of_scale = 1.0 / (2 * likelihood.count()) as f64;
    variances += Vector4::new(0.0, 1.0, 1.0, 4.0) * of_scale;
    let alpha = determined[0];
    let known =
        [alpha, alpha, y < likelihood.infinite_motion(), alpha || x == likelihood::INFINITE_ALPHA];
    Ok([0, 1, 2, 3].map(|i| if known[i] { variances[i].sqrt() } else { f64::INFINITY }))
}

/// Returns the derivatives of the logarithms of α, σ_a, σ, and the density.
fn slopes(
    likelihood: &mut Likelihood<'_>,
    at: [f64; 2],
    free: [bool; 2],
) -> Result<Matrix4x2<f64>> {
    let mut logs = |at: [f64; 2]| -> Result<Vector4<f64>> {
        let finite = |log: f64| if log == f64::NEG_INFINITY { 0.0 } else { log };
        let [alpha, acceleration, noise] = likelihood.at(at)?.1.map(finite);
        Ok(Vector4::new(alpha, acceleration, noise, 2.0 * acceleration - alpha))
    };
    let mut slopes = Matrix4x2::zeros();
    for i in (0..2).filter(|&i| free[i]) {
        let (mut up, mut down) = (at, at);
        up[i] += DIFFERENCE;
        down[i] -= DIFFERENCE;
        slopes.set_column(i, &((logs(up)? - logs(down)?) / (2.0 * DIFFERENCE)));
    }
    Ok(slopes)
}
