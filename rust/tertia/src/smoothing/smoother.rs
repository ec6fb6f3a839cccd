//! State at every instant from all plots: the information of the plots up to it and of those after it are two
//! sets of rows, which are solved together.
//!
//! The estimate is that of Rauch, Tung and Striebel (1965) for an unknown first state. No covariance is
//! inverted and nothing is subtracted from a variance, so plots of any precision, steps of any length and
//! motion without noise need no special treatment.

use super::information::{Direction, Information, Logarithms, complete};
use super::motion::ProcessNoise;
use super::quick::Quick;
use super::results::{Smoothed, Summary};
use super::rows::{invert, solve};
use super::track::Track;
use super::unresolved::add_unresolved;
use super::whitening::Whitening;
use crate::base::interrupt::poll;
use crate::base::scratch::refill;
use std::f64::consts::TAU;

/// Buffers, which grow with the track.
#[derive(Clone, Debug, Default)]
pub struct Workspace {
    quick: Quick,
    information: Information,
    whitening: Whitening,
    triangle: Vec<f64>,
    state: Vec<f64>,
    root: Vec<f64>,
    sums: Vec<f64>,
    /// For each instant, the rows of the plots up to it.
    forwards: Vec<f64>,
}

/// Calls a kernel with the order of the state as a constant, if it is one of the usual ones.
macro_rules! with_order {
    ($dimension:expr, $kernel:ident($($argument:expr),*)) => {
        match $dimension {
            1 => $kernel(3, $($argument),*),
            2 => $kernel(6, $($argument),*),
            3 => $kernel(9, $($argument),*),
            d => $kernel(3 * d, $($argument),*),
        }
    };
}

/// Smooths a track. Cost O(N D³).
pub fn smooth(
    track: &Track<'_>,
    motion: ProcessNoise,
    workspace: &mut Workspace,
    out: &mut Smoothed<'_>,
) -> Summary {
    poll();
    let quick = workspace.quick.smooth(track, motion, out);
    let summary = quick.unwrap_or_else(|| by_rows(track, motion, workspace, out));
    add_unresolved(track, motion, 3 * track.dimension, out.covariance);
    summary
}

/// Smooths any track, with rows of information.
pub(super) fn by_rows(
    track: &Track<'_>,
    motion: ProcessNoise,
    workspace: &mut Workspace,
    out: &mut Smoothed<'_>,
) -> Summary {
    workspace.forwards.clear();
    let states = 3 * track.dimension;
    workspace.forwards.reserve(track.len() * states * (states + 1));
    let keep = Some(&mut *out.innovation);
    let summary = with_order!(track.dimension, forwards(track, motion, workspace, keep));
    with_order!(track.dimension, backwards(track, motion, workspace, out));
    summary
}

/// Returns the likelihood only. Cost O(N D³).
pub(crate) fn likelihood(
    track: &Track<'_>,
    motion: ProcessNoise,
    workspace: &mut Workspace,
) -> Summary {
    poll();
    let quick = workspace.quick.likelihood(track, motion);
    quick.unwrap_or_else(|| with_order!(track.dimension, forwards(track, motion, workspace, None)))
}

/// Filters forwards. If innovations are wanted, the rows that the backward pass needs are kept.
#[inline(always)]
fn forwards(
    n: usize,
    track: &Track<'_>,
    motion: ProcessNoise,
    workspace: &mut Workspace,
    mut innovations: Option<&mut [f64]>,
) -> Summary {
    let (d, width) = (n / 3, n + 1);
    let Workspace { information, forwards, whitening, triangle, .. } = workspace;
    information.start(d, &track.prior);
    let (mut squares, mut logarithms) = (0.0, Logarithms::NONE);
    for k in 0..track.len() {
        if k > 0 {
            information.advance(n, track, k - 1, motion, Direction::Forwards, &mut logarithms);
        }
        for part in track.parts() {
            let all = innovations.as_deref_mut().unwrap_or_default();
            if let Some(out) = all.chunks_exact_mut(track.numbers).nth(k) {
                let out = &mut out[part.clone()];
                whitening.innovation(n, track, k, part.start, information, out);
            }
            squares += information.observe(n, track, k, part);
        }
        if innovations.is_some() {
            let start = forwards.len();
            forwards.extend_from_slice(&information.rows);
            forwards.resize(start + n * width, 0.0);
        }
    }
    information.complete(n, track, triangle);
    for i in 0..n {
        logarithms.add(triangle[i * width + i]);
    }
    let used = if track.prior.is_empty() { track.rank() } else { 0 };
    let count = track.measured - used;
    let logarithm = 2.0 * logarithms.total() + track.log_determinant + count as f64 * TAU.ln();
    // no plots: 0, not −0
    Summary { log_likelihood: 0.0 - 0.5 * (squares + logarithm), count }
}

/// Passes backwards and computes the results.
#[inline(always)]
fn backwards(
    n: usize,
    track: &Track<'_>,
    motion: ProcessNoise,
    workspace: &mut Workspace,
    out: &mut Smoothed<'_>,
) {
    let (d, width) = (n / 3, n + 1);
    let Workspace { information, triangle, state, forwards, root, sums, .. } = workspace;
    information.start(d, &[]);
    for (values, size) in [(&mut *root, n * n), (&mut *state, n), (&mut *sums, width)] {
        refill(values, size, 0.0);
    }
    let mut unused = Logarithms::NONE;
    for k in (0..track.len()).rev() {
        triangle.clear();
        triangle.extend_from_slice(&forwards[k * n * width..][..n * width]);
        triangle.extend_from_slice(&information.rows);
        complete(n, track, &track.seen, triangle, sums);
        solve(triangle, width, n, state);
        invert(triangle, width, n, root);
        let mean = &mut out.mean[k * n..][..n];
        mean.copy_from_slice(state);
        track.restore(k, mean);
        let covariance = &mut out.covariance[k * n * n..][..n * n];
        write_square(root, n, covariance);
        for (axis, seen) in track.seen.iter().enumerate() {
            for (derivative, known) in seen.determines(track.times[k]).into_iter().enumerate() {
                if !known {
                    forget(derivative * d + axis, n, mean, covariance);
                }
            }
        }
        if k > 0 {
            information.observe(n, track, k, 0..track.numbers);
            information.advance(n, track, k - 1, motion, Direction::Backwards, &mut unused);
        }
    }
}

/// `U U^T` of an upper triangle U.
#[inline(always)]
fn write_square(u: &[f64], n: usize, out: &mut [f64]) {
    for i in 0..n {
        for j in 0..=i {
            let sum = (i..n).map(|k| u[i * n + k] * u[j * n + k]).sum();
            out[i * n + j] = sum;
            out[j * n + i] = sum;
        }
    }
}

/// Marks a component as unknown.
fn forget(component: usize, n: usize, mean: &mut [f64], covariance: &mut [f64]) {
    mean[component] = f64::NAN;
    for j in 0..n {
        covariance[component * n + j] = 0.0;
        covariance[j * n + component] = 0.0;
    }
    covariance[component * n + component] = f64::INFINITY;
}

#[cfg(test)]
mod tests {
    use super::super::whitener::Noise;
    use super::*;

    fn smoothed(d: usize, times: &[f64], y: &[f64], jerk: f64) -> (Vec<f64>, Vec<f64>, Summary) {
        let (n, states) = (times.len(), 3 * d);
        let unit: Vec<f64> = (0..d * d).map(|i| f64::from(u8::from(i % (d + 1) == 0))).collect();
        let track = Track::try_new(d, times, y, Noise::Same(&unit), None).unwrap();
        let mut mean = vec![0.0; n * states];
        let mut covariance = vec![0.0; n * states * states];
        let mut innovation = vec![0.0; n * d];
        let mut out =
            Smoothed { mean: &mut mean, covariance: &mut covariance, innovation: &mut innovation };
        let summary =
            smooth(&track, ProcessNoise::with_jerk(jerk), &mut Workspace::default(), &mut out);
        (mean, covariance, summary)
    }

    /// Three plots determine a parabola, whatever the jerk; its covariance is that of the plots.
    #[test]
    fn three_plots_are_met() {
        let times = [1.0, 2.0, 4.0];
        let y: Vec<f64> = times.iter().map(|t| 3.0 - 2.0 * t + 5.0 * t * t).collect();
        for jerk in [0.0, 1e-6, 1.0, 1e6] {
            let (mean, covariance, summary) = smoothed(1, &times, &y, jerk);
            assert_eq!(summary.count, 0);
            for k in 0..3 {
                assert!((mean[3 * k] - y[k]).abs() < 1e-12);
                assert!((covariance[9 * k] - 1.0).abs() < 1e-12);
            }
            if jerk == 0.0 {
                assert!((mean[1] - 8.0).abs() < 1e-12 && (mean[2] - 10.0).abs() < 1e-12);
            }
        }
    }

    /// Axes that are not coupled must not affect each other, even if components are missing.
    #[test]
    fn axes_are_independent() {
        let times: Vec<f64> = (0..30).map(|i| f64::from(i) + 0.4 * f64::from(i % 3)).collect();
        let one: Vec<f64> = times.iter().map(|t| (t * 1.3).sin()).collect();
        let other: Vec<f64> =
            one.iter().enumerate().map(|(i, y)| if i % 4 == 1 { f64::NAN } else { *y }).collect();
        let both: Vec<f64> = one.iter().zip(&other).flat_map(|(a, b)| [*a, *b]).collect();
        let (joint, covariance, _) = smoothed(2, &times, &both, 0.1);
        for (axis, y) in [&one, &other].into_iter().enumerate() {
            let (alone, own, _) = smoothed(1, &times, y, 0.1);
            for k in 0..30 {
                for i in 0..3 {
                    assert!((joint[6 * k + 2 * i + axis] - alone[3 * k + i]).abs() < 1e-12);
                    let at = 36 * k + (2 * i + axis) * 7;
                    assert!((covariance[at] / own[9 * k + 4 * i] - 1.0).abs() < 1e-12);
                }
            }
        }
    }
}
