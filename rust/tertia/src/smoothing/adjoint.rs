//! Smoother with covariances, ten times as fast as that with rows of information, for tracks whose plots are
//! of similar precision.
//!
//! A Kalman filter runs forwards from the first instant at which the plots determine the state, and the
//! adjoint variables run backwards (Bryson, Frazier 1963; Bierman 1977, chapter 10): with λ and Λ, later
//! plots change the filtered state to `x − P λ` and `P − P Λ P`. Differences of variances lose digits if a
//! plot is far more precise than its prediction: then nothing is returned, and [`smooth`](super::smooth) has
//! to be used.

// indices are those of the formulas
#![allow(clippy::needless_range_loop)]

use super::information::{Direction, Information, Logarithms};
use super::motion::{self, ProcessNoise};
use super::opening::of_three;
use super::results::Summary;
use super::rows::{invert, solve, triangularise};
use super::seen::ENOUGH;
use super::track::Track;
use super::whitening::Whitening;
use crate::base::small::{Matrix as Square, add_multiple, dot, product, symmetrise};
use nalgebra::{SMatrix, SVector};
use pulp::{Arch, Simd, WithSimd};
use std::f64::consts::TAU;

/// Variance of a prediction relative to that of its plot from which on too many digits are lost.
pub(super) const LOSS: f64 = 1e6;

/// Number of instants at the start that are smoothed with rows of information, for positions, and for
/// velocities and accelerations. There the filter knows far less than the smoother, and a difference of their
/// variances would be inaccurate.
const OPENING: [usize; 2] = [12, 48];

/// The same as a fraction of the record (one in `LONG_OPENING` instants), for a target that hardly wanders:
/// the variance of its acceleration falls with the fifth power of the time, by 3e6 from there to the end.
const LONG_OPENING: usize = 20;

/// State and covariance after the plot of an instant, and the update by the plot, number by number.
#[derive(Clone, Debug)]
pub(super) struct Step<const M: usize, const N: usize> {
    pub(super) x: [f64; N],
    pub(super) p: Square<N>,
    /// `P h` before each number, the variance `1 + h' P h` of its innovation (0 for a missing number), and
    /// the innovation.
    pub(super) ph: [[f64; N]; M],
    pub(super) s: [f64; M],
    pub(super) innovation: [f64; M],
}

/// Buffers, which grow with the track, for plots of M numbers and a state of N = 3 D.
#[derive(Clone, Debug, Default)]
pub(crate) struct Adjoint<const M: usize, const N: usize> {
    information: Information,
    whitening: Whitening,
    triangle: Vec<f64>,
    /// The first instant that is filtered with covariances.
    pub(super) start: usize,
    /// Rows of information of the instants before it.
    opening: Vec<Vec<f64>>,
    steps: Vec<Step<M, N>>,
}

/// Results.
pub(crate) struct Smoothed<'a> {
    /// States (N, 3D).
    pub mean: &'a mut [f64],
    /// Covariances (N, R, R) of the first R components, or empty.
    pub covariance: &'a mut [f64],
    pub components: usize,
    /// Innovations (N, M) as those of [`smooth`](super::smooth), or empty.
    pub innovation: &'a mut [f64],
    /// Ratio of a variance to that with later plots, or of the variance of a prediction to that of its plot,
    /// beyond which nothing is returned.
    pub loss: f64,
}

impl<const M: usize, const N: usize> Adjoint<M, N> {
    /// Returns the likelihood only.
    pub fn likelihood(&mut self, track: &Track<'_>, motion: ProcessNoise) -> Option<Summary> {
        self.forwards(track, motion, None, (&mut [], LOSS))
    }

    /// Computes states and covariances of all instants. Cost O(N).
    pub fn smooth(
        &mut self,
        track: &Track<'_>,
        motion: ProcessNoise,
        out: &mut Smoothed<'_>,
    ) -> Option<Summary> {
        let short = OPENING[usize::from(out.components > N / 3)];
        let long = track.len() / LONG_OPENING;
        [Some(short), (long > short).then_some(long)].into_iter().flatten().find_map(|opening| {
            let summary =
                self.forwards(track, motion, Some(opening), (out.innovation, out.loss))?;
            self.backwards(track, motion, out).map(|()| summary)
        })
    }

    fn forwards(
        &mut self,
        track: &Track<'_>,
        motion: ProcessNoise,
        opening: Option<usize>,
        (innovation, loss): (&mut [f64], f64),
    ) -> Option<Summary> {
        if !Self::is_for(track) {
            return None;
        }
        self.steps.clear();
        let quick = if opening.is_none() { of_three::<M, N>(track, motion) } else { None };
        let (step, squares, logarithms) = match quick {
            Some((x, p, logarithms)) => {
                self.start = ENOUGH - 1;
                (Step { x, p, ..Step::new() }, 0.0, logarithms)
            }
            None => self.open(track, motion, opening, innovation)?,
        };
        let steps = opening.map(|_| &mut self.steps);
        let filter =
            Filter { track, motion, start: self.start, step, squares, loss: loss.min(LOSS), steps };
        let (squares, spread) = Arch::new().dispatch(filter)?;
        let later = innovation.chunks_exact_mut(M).skip(self.start + 1);
        for (out, step) in later.zip(self.steps.iter().skip(1)) {
            for i in 0..M {
                out[i] =
                    if step.s[i] > 0.0 { step.innovation[i] / step.s[i].sqrt() } else { f64::NAN };
            }
        }
        Some(Self::summary(track, squares, 2.0 * logarithms.total() + spread.total()))
    }

    /// Whether these are buffers for a track, and its plots determine the state.
    pub(super) fn is_for(track: &Track<'_>) -> bool {
        let usual = track.prior.is_empty() && track.seen.iter().all(|seen| seen.count == ENOUGH);
        usual && 3 * track.dimension == N && track.numbers == M
    }

    /// Returns the likelihood, given the sum of squares and that of the logarithms of variances.
    pub(super) fn summary(track: &Track<'_>, squares: f64, logarithms: f64) -> Summary {
        let count = track.measured - N;
        let logarithm = logarithms + track.log_determinant + count as f64 * TAU.ln();
        Summary { log_likelihood: 0.0 - 0.5 * (squares + logarithm), count }
    }

    /// Returns the state at the first instant that is filtered with covariances.
    pub(super) fn open(
        &mut self,
        track: &Track<'_>,
        motion: ProcessNoise,
        least: Option<usize>,
        innovation: &mut [f64],
    ) -> Option<(Step<M, N>, f64, Logarithms)> {
        let Self { information, whitening, triangle, start, opening, .. } = self;
        information.start(N / 3, &[]);
        opening.clear();
        let (mut squares, mut logarithms, mut settled) = (0.0, Logarithms::NONE, 0);
        for k in 0..track.len() {
            if k > 0 {
                information.advance(N, track, k - 1, motion, Direction::Forwards, &mut logarithms);
            }
            for part in track.parts() {
                if let Some(out) = innovation.chunks_exact_mut(M).nth(k) {
                    let out = &mut out[part.clone()];
                    whitening.innovation(N, track, k, part.start, information, out);
                }
                squares += information.observe(N, track, k, part);
            }
            settled += usize::from(information.rank() == N);
            if settled < least.unwrap_or(1) && (settled == 0 || k + 1 < track.len()) {
                opening.push(information.rows.clone());
                continue;
            }
            *start = k;
            information.complete(N, track, triangle);
            let mut step = Step::new();
            let mut root = vec![0.0; N * N];
            invert(triangle, N + 1, N, &mut root);
            solve(triangle, N + 1, N, &mut step.x);
            for i in 0..N {
                logarithms.add(triangle[i * (N + 1) + i]);
                for j in 0..N {
                    step.p[i][j] = (0..N).map(|l| root[i * N + l] * root[j * N + l]).sum();
                }
            }
            for (x, reference) in step.x.iter_mut().zip(track.reference(k)) {
                *x += reference;
            }
            return Some((step, squares, logarithms));
        }
        None
    }

    fn backwards(
        &self,
        track: &Track<'_>,
        motion: ProcessNoise,
        out: &mut Smoothed<'_>,
    ) -> Option<()> {
        let (mut l, mut big) = ([0.0; N], [[0.0; N]; N]);
        let components = out.components;
        for k in (self.start..track.len()).rev() {
            let step = &self.steps[k - self.start];
            let mean = &mut out.mean[k * N..][..N];
            for i in 0..N {
                mean[i] = step.x[i] - dot(&step.p[i], &l);
            }
            track.add_trend(k, mean);
            if components > 0 {
                let size = components * components;
                let covariance = &mut out.covariance[k * size..][..size];
                step.smoothed_covariance(&big, components, covariance);
                let left = |i: usize| covariance[i * (components + 1)] * out.loss >= step.p[i][i];
                if out.loss < f64::INFINITY && !(0..components).all(left) {
                    return None;
                }
            }
            if k > self.start {
                step.back(track.whitener(k), &mut l, (components > 0).then_some(&mut big));
                let t = track.times[k] - track.times[k - 1];
                move_back(t, &mut l, (components > 0).then_some(&mut big));
            }
        }
        self.before(track, motion, out, &l, &big)
    }

    /// Smooths the instants of the opening. The rows of information up to an instant, and those of the motion
    /// to the state x' after it, are triangularised: `T x = c + D x'`.
    fn before(
        &self,
        track: &Track<'_>,
        motion: ProcessNoise,
        out: &mut Smoothed<'_>,
        l: &[f64; N],
        big: &Square<N>,
    ) -> Option<()> {
        let first = &self.steps[0];
        let mut x = SVector::<f64, N>::from_fn(|i, _| first.x[i] - dot(&first.p[i], l));
        let mut p = SMatrix::<f64, N, N>::from_fn(|i, j| first.p[i][j]);
        let big = SMatrix::<f64, N, N>::from_fn(|i, j| big[i][j]);
        p -= p * big * p;
        let (mut rows, mut sums) = (Vec::new(), vec![0.0; 2 * N + 1]);
        for k in (0..self.start).rev() {
            let t = track.times[k + 1] - track.times[k];
            if t > 0.0 && motion.is_certain() {
                let back = steady::<N>(-t);
                (x, p) = (back * x, back * p * back.transpose());
            } else if t > 0.0 {
                self.tie(track, k, motion, &mut rows);
                triangularise(&mut rows, 2 * N + 1, N, &mut sums);
                let row = |i: usize| &rows[i * (2 * N + 1)..][..2 * N + 1];
                let triangle = SMatrix::<f64, N, N>::from_fn(|i, j| row(i)[j]);
                let root = triangle.solve_upper_triangular(&SMatrix::identity())?;
                let later = SMatrix::<f64, N, N>::from_fn(|i, j| row(i)[N + 1 + j]);
                let gain = root * later;
                x = root * SVector::from_fn(|i, _| row(i)[N]) + gain * x;
                let terms = gain.component_mul(&gain) * p.diagonal();
                p = root * root.transpose() + gain * p * gain.transpose();
                // the terms cancel if a long step is traced back
                if (0..N).any(|i| terms[i] > out.loss * p[(i, i)]) {
                    return None;
                }
            }
            let mean = &mut out.mean[k * N..][..N];
            mean.copy_from_slice(x.as_slice());
            track.add_trend(k, mean);
            let c = out.components;
            for i in 0..c {
                for j in 0..c {
                    out.covariance[(k * c + i) * c + j] = 0.5 * (p[(i, j)] + p[(j, i)]);
                }
            }
        }
        x.iter().all(|x| x.is_finite()).then_some(())
    }

    /// Sets up the rows `[Λ^½, η, 0]` of the information up to instant k, and `[G^-1 F, 0, G^-1]` of the
    /// motion after it, with its noise `G G'`.
    fn tie(&self, track: &Track<'_>, k: usize, motion: ProcessNoise, rows: &mut Vec<f64>) {
        rows.clear();
        for row in self.opening[k].chunks_exact(N + 1) {
            let own: f64 = row.iter().zip(track.reference(k)).map(|(r, near)| r * near).sum();
            rows.extend_from_slice(&row[..N]);
            rows.push(row[N] + own);
            rows.resize(rows.len() + N, 0.0);
        }
        let t = track.times[k + 1] - track.times[k];
        let [g00, g10, g11, g20, g21, g22] = motion.noise_root(t);
        let (h00, h11, h22) = (1.0 / g00, 1.0 / g11, 1.0 / g22);
        let h21 = -g21 * h11 * h22;
        let inverse = [
            [h00, 0.0, 0.0],
            [-g10 * h00 * h11, h11, 0.0],
            [-(g20 * h22 + g10 * h21) * h00, h21, h22],
        ];
        let d = N / 3;
        for axis in 0..d {
            let over = motion.on(axis, d).sqrt().recip();
            for h in inverse.map(|row| row.map(|h| h * over)) {
                let start = rows.len();
                rows.resize(start + 2 * N + 1, 0.0);
                let (now, later) = rows[start..].split_at_mut(N + 1);
                for derivative in 0..3 {
                    later[derivative * d + axis] = h[derivative];
                    now[derivative * d + axis] = h[derivative];
                }
                now[d + axis] += t * h[0];
                now[2 * d + axis] += 0.5 * t * t * h[0] + t * h[1];
            }
        }
    }
}

/// The filter with covariances, compiled for the vector instructions of the machine.
struct Filter<'a, const M: usize, const N: usize> {
    track: &'a Track<'a>,
    motion: ProcessNoise,
    start: usize,
    step: Step<M, N>,
    squares: f64,
    loss: f64,
    /// Where the steps are stored; none if they are not kept.
    steps: Option<&'a mut Vec<Step<M, N>>>,
}

impl<const M: usize, const N: usize> WithSimd for Filter<'_, M, N> {
    /// The sum of squares, and the logarithms of the variances of the innovations.
    type Output = Option<(f64, Logarithms)>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Self::Output {
        let Self { track, motion, start, mut step, mut squares, loss, mut steps } = self;
        let mut spread = Logarithms::NONE;
        for k in start + 1..track.len() {
            if let Some(steps) = steps.as_deref_mut() {
                steps.push(step.clone());
            }
            step.predict(track.times[k] - track.times[k - 1], motion);
            squares += step.update(track, k, loss, &mut spread)?;
        }
        if let Some(steps) = steps {
            steps.push(step);
        }
        Some((squares, spread))
    }
}

impl<const M: usize, const N: usize> Step<M, N> {
    pub(super) fn new() -> Self {
        Self { x: [0.0; N], p: [[0.0; N]; N], ph: [[0.0; N]; M], s: [0.0; M], innovation: [0.0; M] }
    }

    /// `x = F x`, `P = F P F' + Q`
    #[inline(always)]
    pub(super) fn predict(&mut self, t: f64, motion: ProcessNoise) {
        if t == 0.0 {
            return;
        }
        motion::advance(N / 3, &mut self.x, &mut self.p, t, motion);
    }

    /// Updates the state by the plot of an instant, number by number, because these are whitened. Returns the
    /// sum of squares that the plot adds.
    #[inline(always)]
    pub(super) fn update(
        &mut self,
        track: &Track<'_>,
        k: usize,
        loss: f64,
        spread: &mut Logarithms,
    ) -> Option<f64> {
        let (plot, whitener) = (track.plot(k), track.whitener(k));
        let mut squares = 0.0;
        for i in 0..M {
            self.s[i] = 0.0;
            if plot[i].is_nan() {
                continue;
            }
            let (mut ph, mut innovation) = ([0.0; N], 0.0);
            for j in 0..=i {
                let h = whitener[i * M + j];
                if h != 0.0 {
                    innovation += h * (plot[j] - self.x[j]);
                    add_multiple(&mut ph, h, &self.p[j]);
                }
            }
            let s = 1.0 + (0..=i).map(|j| whitener[i * M + j] * ph[j]).sum::<f64>();
            if !(1.0..loss).contains(&s) {
                return None;
            }
            squares += innovation * update(&mut self.x, &mut self.p, &ph, innovation, s);
            spread.add(s);
            (self.ph[i], self.s[i], self.innovation[i]) = (ph, s, innovation);
        }
        Some(squares)
    }

    /// `P − P Λ P` of the first components.
    #[inline(always)]
    fn smoothed_covariance(&self, big: &Square<N>, components: usize, out: &mut [f64]) {
        for i in 0..components {
            let row = product(big, &self.p[i]);
            for j in 0..=i {
                let value = self.p[i][j] - dot(&row, &self.p[j]);
                out[i * components + j] = value;
                out[j * components + i] = value;
            }
        }
    }

    /// Takes the adjoint variables back across the plot.
    #[inline(always)]
    fn back(&self, whitener: &[f64], l: &mut [f64; N], mut big: Option<&mut Square<N>>) {
        for i in (0..M).rev() {
            let s = self.s[i];
            if s == 0.0 {
                continue;
            }
            let reciprocal = 1.0 / s;
            let gain: [f64; N] = std::array::from_fn(|c| self.ph[i][c] * reciprocal);
            let h = &whitener[i * M..][..=i];
            let along = dot(&gain, l) + self.innovation[i] * reciprocal;
            for (l, h) in l.iter_mut().zip(h) {
                *l -= h * along;
            }
            let Some(big) = big.as_deref_mut() else { continue };
            let moved = product(big, &gain);
            let square = dot(&moved, &gain) + reciprocal;
            for (j, h) in h.iter().enumerate() {
                add_multiple(&mut big[j], -h, &moved);
            }
            for row in 0..N {
                for (j, h) in h.iter().enumerate() {
                    big[row][j] -= h * moved[row];
                }
            }
            for (j, hj) in h.iter().enumerate() {
                for (c, hc) in h.iter().enumerate() {
                    big[j][c] += hj * hc * square;
                }
            }
        }
    }
}

/// Updates a state and its covariance by a number with this innovation of variance `s`, whose covariances with the
/// state are `P H'`; returns the innovation divided by its variance.
#[inline(always)]
pub(super) fn update<const N: usize>(
    x: &mut [f64; N],
    p: &mut Square<N>,
    ph: &[f64; N],
    innovation: f64,
    s: f64,
) -> f64 {
    let reciprocal = 1.0 / s;
    let gain = innovation * reciprocal;
    for r in 0..N {
        x[r] += ph[r] * gain;
        for c in 0..N {
            p[r][c] -= ph[r] * ph[c] * reciprocal;
        }
    }
    gain
}

/// `F' λ` and `F' Λ F`
#[inline(always)]
fn move_back<const N: usize>(t: f64, l: &mut [f64; N], mut big: Option<&mut Square<N>>) {
    if t == 0.0 {
        return;
    }
    motion::turn_back(N / 3, t, l, big.as_deref_mut());
    if let Some(big) = big {
        symmetrise(big);
    }
}

/// Transition matrix F over a time t.
fn steady<const N: usize>(t: f64) -> SMatrix<f64, N, N> {
    let (mut f, d) = (SMatrix::<f64, N, N>::identity(), N / 3);
    for i in 0..d {
        f[(i, d + i)] = t;
        f[(d + i, 2 * d + i)] = t;
        f[(i, 2 * d + i)] = 0.5 * t * t;
    }
    f
}

#[cfg(test)]
mod tests;
