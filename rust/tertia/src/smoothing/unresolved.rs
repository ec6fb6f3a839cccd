//! The velocity of a target whose position is a random walk.
//!
//! White velocity stands for a velocity that changes so often between two plots that these do not show it.
//! The state contains only the velocity of the drift. With the correlation time τ, a velocity of variance s²
//! moves the position like white velocity of the intensity `2 s² τ`; plots at steps T show this as white if τ
//! is below about T/3. The variance of the velocity is computed for τ = T/4; with T/2, it would be that of the
//! mean velocity over a step.

use super::motion::ProcessNoise;
use super::track::Track;
use crate::base::angle::median;

/// Correlation time of the velocity, relative to the step between plots.
const CORRELATION: f64 = 0.25;

/// Adds the variance of the velocity about its drift to covariances of the first components (N, R, R) of the
/// states. Nothing is added if velocities are measured, because these are those of the state.
pub(crate) fn add_unresolved(
    track: &Track<'_>,
    motion: ProcessNoise,
    components: usize,
    covariance: &mut [f64],
) {
    let d = track.dimension;
    if motion.velocity == 0.0 || track.numbers > d || components < 2 * d {
        return;
    }
    let measured = (0..track.len()).filter(|&k| track.plot(k).iter().any(|y| !y.is_nan()));
    let mut times: Vec<f64> = measured.map(|k| track.times[k]).collect();
    times.dedup();
    let mut steps: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    if steps.is_empty() {
        return;
    }
    let variance = 0.5 * motion.velocity / (CORRELATION * median(&mut steps));
    for own in covariance.chunks_exact_mut(components * components) {
        for axis in 0..d {
            own[(d + axis) * (components + 1)] += motion.on(axis, d) * variance;
        }
    }
}
