//! The covariance of the states with the uncertainty of the fitted jerk in it.

use super::failure::Failure;
use super::found::{Found, Setting, known};
use super::path::Path;
use nalgebra::SMatrix;

/// Error of the logarithm of the jerk with which its likelihood is a parabola, almost.
const WELL_KNOWN: f64 = 1.0;
const STEPS: [f64; 4] = [-2.0, -1.0, 1.0, 2.0];
/// Power of the jerk in its prior: between a flat prior of the root, which is too careful where no
/// jerk is seen, and one of the logarithm, which is not careful enough where it is.
const PRIOR: f64 = 0.25;
const MARGIN: f64 = 2.0;
const FALL: f64 = 8.0;
const MOST_JERKS: i32 = 80;
/// Instants that determine a state, and the power of the time with which jerk moves a position.
const STATE: usize = 3;
const STATE_POWER: f64 = 5.0;

/// The mean over intensities by their likelihood, with a prior on their logarithm that rises with
/// the fourth root of the intensity; the covariance of the best where no other is likely.
pub(super) fn mixed<const D: usize, const N: usize>(
    setting: &mut Setting<'_, D, N>,
    found: &Found<D, N>,
    best: &Path,
) -> Result<Vec<f64>, Failure> {
    let paths = likely(setting, found, best)?;
    if paths.is_empty() {
        return Ok(best.covariance.clone());
    }
    let value = |path: &Path| path.summary.log_likelihood + PRIOR * path.fit.jerk.ln();
    let top = paths.iter().map(value).fold(f64::NEG_INFINITY, f64::max);
    let share: Vec<f64> = paths.iter().map(|path| (value(path) - top).exp()).collect();
    let total: f64 = share.iter().sum();
    let mut mixed = best.covariance.clone();
    for (t, own) in mixed.chunks_exact_mut(N * N).enumerate() {
        if own.iter().any(|v| !v.is_finite()) {
            continue;
        }
        own.fill(0.0);
        for (path, share) in paths.iter().zip(&share) {
            let change: [f64; N] =
                std::array::from_fn(|i| path.mean[t * N + i] - best.mean[t * N + i]);
            for i in 0..N {
                for j in 0..N {
                    let other = path.covariance[(t * N + i) * N + j];
                    own[i * N + j] += share / total * (other + change[i] * change[j]);
                }
            }
        }
    }
    Ok(mixed)
}

/// Paths with all intensities that are likely; none where the record says nothing of it. Around a
/// fitted one that is well known; else from hardly any on, until they are unlikely.
fn likely<const D: usize, const N: usize>(
    setting: &mut Setting<'_, D, N>,
    found: &Found<D, N>,
    best: &Path,
) -> Result<Vec<Path>, Failure> {
    let time = setting.record.time;
    let track = found.plots.track(time, D)?;
    let (jerk, error) = (best.fit.jerk, best.fit.relative_error);
    if jerk > 0.0 && error < WELL_KNOWN {
        let near = STEPS
            .map(|step| setting.smoother.smooth(&track, known(jerk * (step * error).exp()), N));
        return Ok([vec![best.clone()], near.to_vec()].concat());
    }
    let known_at: Vec<usize> = (0..time.len()).filter(|&t| found.plots.is_known(t, D)).collect();
    let mut times: Vec<f64> = known_at.iter().map(|&t| time[t]).collect();
    times.dedup();
    let span = times.last().zip(times.first()).map_or(0.0, |(last, first)| last - first);
    if times.len() <= STATE || span == 0.0 {
        return Ok(Vec::new());
    }
    let least = known_at.iter().map(|&t| {
        let own = &found.plots.covariance[t * D * D..];
        let matrix = SMatrix::<f64, D, D>::from_fn(|i, j| own[i * D + j]);
        nalgebra::DMatrix::from_fn(D, D, |i, j| matrix[(i, j)]).symmetric_eigenvalues().min()
    });
    // below the first one the motion is that of none; the likelihood falls as a power
    let first = least.fold(f64::INFINITY, f64::min).ln() - STATE_POWER * span.ln() - MARGIN;
    let (mut paths, mut top) = (Vec::new(), f64::NEG_INFINITY);
    for step in 0..MOST_JERKS {
        let jerk = known((first + f64::from(step)).exp());
        let path = setting.smoother.smooth(&track, jerk, N);
        let value = path.summary.log_likelihood;
        paths.push(path);
        top = top.max(value);
        if value < top - FALL {
            break;
        }
    }
    Ok(paths)
}
