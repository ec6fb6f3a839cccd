//! Gains that all series of a batch share: covariances do not depend on the values of the plots.

use super::filter::Filter;
use super::series::Series;
use super::steps::Steps;

/// Gain, innovation variance and covariance after each step, for series without missing plots that have
/// the same noise, intervals and start.
#[derive(Clone, Debug)]
pub(super) struct Gains {
    pub(super) gain: Vec<[f64; 3]>,
    pub(super) variance: Vec<f64>,
    pub(super) covariance: Vec<[f64; 6]>,
    /// Sums of the logarithms of the innovation variances from each step on.
    pub(super) logarithms: Vec<f64>,
}

impl Gains {
    /// Computes the gains of all series like this one; the values of its plots do not matter. O(steps).
    pub fn new(series: &Series<'_>, filter: Filter) -> Self {
        let n = series.z.len();
        let mut gains = Self {
            gain: Vec::with_capacity(n),
            variance: Vec::with_capacity(n),
            covariance: Vec::with_capacity(n),
            logarithms: vec![0.0; n],
        };
        series.run(filter, |step, state, innovation| {
            let [p00, p01, p02, ..] = state.covariance;
            let r = series.variance.at(step);
            // the first row of (I − K h^T) P⁻ is K R
            gains.gain.push([p00 / r, p01 / r, p02 / r]);
            gains.variance.push(innovation.variance);
            gains.covariance.push(state.covariance);
        });
        let mut sum = 0.0;
        for (total, variance) in gains.logarithms.iter_mut().zip(&gains.variance).rev() {
            sum += variance.ln();
            *total = sum;
        }
        gains
    }

    /// Writes what all series have in common from step `start` on, as far as there is room.
    pub fn put(&self, start: usize, out: &mut Steps<'_>) {
        if !out.variance.is_empty() {
            out.variance[start..].copy_from_slice(&self.variance[start..]);
        }
        if !out.covariance.is_empty() {
            out.covariance[6 * start..].copy_from_slice(self.covariance[start..].as_flattened());
        }
    }
}
