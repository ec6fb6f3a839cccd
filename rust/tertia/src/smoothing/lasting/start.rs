//! First states of a smoother for correlated noise.

use super::super::adjoint::{self, Adjoint};
use super::super::motion::ProcessNoise;
use super::super::rows::invert;
use super::super::seen::ENOUGH;
use super::super::track::Track;
use crate::base::small::Matrix as Square;
use crate::smoothing::components::axes;

/// Variance of the first state relative to that given by the plots that determine it.
pub(super) const VAGUE: f64 = 1e3;
/// Variance of the first state relative to that of the smoothed first state, if the latter is known.
pub(super) const VAGUE_AFTER_ALL: f64 = 1e4;
/// Least share of a variance that rounding leaves.
const FLOOR: f64 = 1e-13;

/// Mean and covariance.
pub(super) type State<const N: usize> = ([f64; N], Square<N>);

/// Returns a vague state near the known first state; none if that is not finite.
pub(super) fn near<const N: usize>(
    track: &Track<'_>,
    (mean, covariance): (&[f64], &[f64]),
    vague: &State<N>,
    factor: f64,
) -> Option<State<N>> {
    let states = 3 * axes(N);
    let mut trend = vec![0.0; states];
    track.add_trend(0, &mut trend);
    let (mut x, mut p) = *vague;
    for i in 0..states {
        x[i] = mean[i] - trend[i];
        p[i] = [0.0; N];
        p[i][i] = factor * covariance[i * (states + 1)].max(FLOOR * vague.1[i][i]);
    }
    (0..states).all(|i| x[i].is_finite() && p[i][i].is_finite()).then_some((x, p))
}

/// Returns a state at the first instant that agrees with the first plots, but has a far too large covariance.
pub(super) fn vague<const M: usize, const S: usize>(
    track: &Track<'_>,
    motion: ProcessNoise,
) -> Option<([f64; S], Square<S>)> {
    if track.seen.iter().any(|seen| seen.count < ENOUGH) {
        return None;
    }
    let mut adjoint = Adjoint::<M, S>::default();
    let (mut step, ..) = adjoint.open(track, motion, None, &mut [])?;
    let t = track.times[adjoint.start] - track.times[0];
    let mut noise = adjoint::Step::<M, S>::new();
    noise.predict(t, motion);
    for part in [&mut step, &mut noise] {
        part.predict(-t, ProcessNoise::with_jerk(0.0));
    }
    for i in 0..S {
        for j in 0..S {
            step.p[i][j] = VAGUE * (step.p[i][j] + noise.p[i][j]);
        }
    }
    Some((step.x, step.p))
}

/// Returns the prior at the first instant, which is given as rows of information.
pub(super) fn prior<const S: usize>(track: &Track<'_>) -> ([f64; S], Square<S>) {
    // the rows are those of N = L^-1, where L is the factor of the covariance
    let width = S + 1;
    let mut lower = vec![0.0; S * S];
    let mut upper = vec![0.0; S * width];
    for i in 0..S {
        for j in 0..S {
            upper[j * width + i] = track.prior[i * width + j];
        }
    }
    invert(&upper, width, S, &mut lower);
    // inverse of the transpose: rows of `lower` are columns of L
    let l = |i: usize, j: usize| lower[j * S + i];
    let mut x = [0.0; S];
    let mut p = [[0.0; S]; S];
    for i in 0..S {
        x[i] = (0..S).map(|k| l(i, k) * track.prior[k * width + S]).sum();
        for j in 0..S {
            p[i][j] = (0..S).map(|k| l(i, k) * l(j, k)).sum();
        }
    }
    for (x, reference) in x.iter_mut().zip(track.reference(0)) {
        *x += reference;
    }
    (x, p)
}
