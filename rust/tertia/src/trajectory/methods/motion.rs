//! Covariance of the states including the uncertainty of the fitted motion.

use crate::base::exponential::exponentials;
use crate::smoothing::{Family, Part, Track};
use crate::trajectory::path::Path;
use crate::trajectory::path::failure::Failure;
use crate::trajectory::search::fit::{Found, Setting, known};
use nalgebra::SMatrix;

/// Largest error of the logarithm of an intensity with which its likelihood is nearly a parabola.
const WELL_KNOWN: f64 = 1.0;
const STEPS: [f64; 4] = [-2.0, -1.0, 1.0, 2.0];
/// Power of the intensity in its prior, per logarithm. It is between a flat prior of the root, with which
/// covariances are too large if no process noise is seen, and one of the logarithm, with which they are too
/// small if it is seen.
const PRIOR: f64 = 0.25;
/// Prior probability that the position is a random walk, relative to that of the other motions.
const ROUGH: f64 = 0.02;
const MARGIN: f64 = 2.0;
const FALL: f64 = 8.0;
const MOST_STEPS: i32 = 80;
/// Number of instants that determine a state.
const STATE: usize = 3;

/// Averages the covariances over intensities, weighted by their likelihood and a prior on their logarithm
/// that rises with the fourth root of the intensity; if the vertical motion has an intensity of its own, over
/// that as well. Returns the covariance of the best path if the record does not determine the intensity.
pub(in crate::trajectory) fn mixed<const D: usize, const N: usize>(
    setting: &mut Setting<'_, D, N>,
    found: &Found<D, N>,
    best: &Path,
) -> Result<Vec<f64>, Failure> {
    let part = Part::of(best.fit.motion);
    let mut mixed = average::<N>(&likely(setting, found, best, part)?, best);
    if part == Part::Others {
        let vertical = average::<N>(&likely(setting, found, best, Part::Last)?, best);
        widen::<N>(&mut mixed, &vertical, &best.covariance);
    }
    Ok(mixed)
}

/// Multiplies standard deviations by the ratio of two others, and covariances with them.
fn widen<const N: usize>(covariance: &mut [f64], wide: &[f64], narrow: &[f64]) {
    let states = covariance.chunks_exact_mut(N * N);
    for ((own, wide), narrow) in
        states.zip(wide.chunks_exact(N * N)).zip(narrow.chunks_exact(N * N))
    {
        let by: [f64; N] =
            std::array::from_fn(|i| (wide[i * (N + 1)] / narrow[i * (N + 1)]).sqrt());
        if by.iter().all(|by| by.is_finite()) {
            (0..N * N).for_each(|at| own[at] *= by[at / N] * by[at % N]);
        }
    }
}

/// Covariances of the mixture of some paths, each with the rise of its prior, about the best one.
fn average<const N: usize>(paths: &[(Path, f64)], best: &Path) -> Vec<f64> {
    if paths.is_empty() {
        return best.covariance.clone();
    }
    let value = |(path, rise): &(Path, f64)| path.summary.log_likelihood + PRIOR * rise;
    let mut share: Vec<f64> = paths.iter().map(value).collect();
    let total = exponentials(&mut share, |share| share);
    let mut mixed = best.covariance.clone();
    for (t, own) in mixed.chunks_exact_mut(N * N).enumerate() {
        if own.iter().any(|v| !v.is_finite()) {
            continue;
        }
        own.fill(0.0);
        for ((path, _), share) in paths.iter().zip(&share) {
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
    mixed
}

/// Returns the paths of all likely intensities of a part of the axes, each with the logarithm of its intensity
/// less some constant; none if the record does not determine the intensity. If the fitted intensity is well
/// known, these are intensities around it, and around those of other families if these are likely: a target that
/// turns or stops between two instants moves like a random walk. Otherwise the intensities begin with one that is
/// practically zero and rise until they are unlikely.
fn likely<const D: usize, const N: usize>(
    setting: &mut Setting<'_, D, N>,
    found: &Found<D, N>,
    best: &Path,
    part: Part,
) -> Result<Vec<(Path, f64)>, Failure> {
    let time = setting.record.time;
    let track = found.plots.track(time, D)?;
    let error = match part {
        Part::Last => setting.smoother.error_of(&track, best.fit.motion, part),
        Part::All | Part::Others => best.fit.relative_error,
    };
    if error < WELL_KNOWN {
        let mut paths = around(setting, &track, best.clone(), part, error);
        let least = best.summary.log_likelihood - FALL;
        let own = Family::that_has(best.fit.motion);
        let others = [(own.other(), 0.0), (Family::Velocity, ROUGH.ln() / PRIOR)];
        for (family, rise) in others.into_iter().filter(|_| part != Part::Last) {
            let fit = setting.smoother.of(family, &track, best.fit.motion, least);
            if let Some(fit) = fit.filter(|fit| fit.relative_error < WELL_KNOWN) {
                let path = setting.smoother.smooth(&track, fit, N);
                let found = around(setting, &track, path, part, fit.relative_error);
                paths.extend(found.into_iter().map(|(path, own)| (path, own + rise)));
            }
        }
        return Ok(paths);
    }
    let family = Family::that_has(best.fit.motion);
    let of = family.part(part, &track, best.fit.motion);
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
    // below the first intensity the path is as without process noise; far above, the likelihood falls as a
    // power
    let first = least.fold(f64::INFINITY, f64::min).ln() - family.power() * span.ln() - MARGIN;
    let (mut paths, mut top) = (Vec::new(), f64::NEG_INFINITY);
    for step in 0..MOST_STEPS {
        let motion = known(of(first + f64::from(step)));
        let path = setting.smoother.smooth(&track, motion, N);
        let value = path.summary.log_likelihood;
        paths.push((path, f64::from(step)));
        top = top.max(value);
        if value < top - FALL {
            break;
        }
    }
    Ok(paths)
}

/// Returns a path with a well known intensity of a part of the axes and paths with others around it, each with
/// the logarithm of its intensity less that of the first.
fn around<const D: usize, const N: usize>(
    setting: &mut Setting<'_, D, N>,
    track: &Track<'_>,
    best: Path,
    part: Part,
    error: f64,
) -> Vec<(Path, f64)> {
    let family = Family::that_has(best.fit.motion);
    let of = family.part(part, track, best.fit.motion);
    let log = family.log_of(part, best.fit.motion);
    let mut paths = vec![(best, 0.0)];
    for step in STEPS {
        let path = setting.smoother.smooth(track, known(of(log + step * error)), N);
        paths.push((path, step * error));
    }
    paths
}
