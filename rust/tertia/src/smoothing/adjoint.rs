//! The smoother by covariances, ten times as fast as by rows of information, for tracks whose plots
//! are of similar precision.
//!
//! A Kalman filter goes forwards from the first instant at which the plots determine the state, and
//! the adjoint variables go back (Bryson, Frazier 1963; Bierman 1977, chapter 10): with λ and Λ,
//! what later plots add to the filtered state is `x − P λ` and `P − P Λ P`. Differences of
//! variances lose digits where a plot is far more precise than its prediction: there, nothing is
//! returned, and [`smooth`](super::smooth) has to do it.

// indices are those of the formulas
#![allow(clippy::needless_range_loop)]

use super::information::{Direction, Information, Logarithms};
use super::motion;
use super::rows::{invert, solve};
use super::smoother::Summary;
use super::track::{ENOUGH, Track};
use crate::base::small::{Matrix as Square, dot};
use nalgebra::{SMatrix, SVector};
use pulp::{Arch, Simd, WithSimd};
use std::f64::consts::TAU;

/// Variance of a prediction over that of its plot from which on too many digits are lost.
const LOSS: f64 = 1e6;

/// Instants at the start that are smoothed by rows of information: the filter knows far less there
/// than the smoother, and a difference of their variances would be inaccurate. For positions, and
/// for velocities and accelerations.
const OPENING: [usize; 2] = [12, 48];

/// State and covariance after an instant's plot, and how the plot came in, number by number.
#[derive(Clone, Debug)]
pub(super) struct Step<const D: usize, const N: usize> {
    pub(super) x: [f64; N],
    pub(super) p: Square<N>,
    /// `P h` before each number, the variance `1 + h' P h` of its innovation, 0 where there is no
    /// number, and the innovation.
    ph: [[f64; N]; D],
    s: [f64; D],
    innovation: [f64; D],
}

/// Buffers, which grow with the track.
#[derive(Clone, Debug, Default)]
pub(crate) struct Adjoint<const D: usize, const N: usize> {
    information: Information,
    triangle: Vec<f64>,
    /// The first instant that is filtered by covariances.
    pub(super) start: usize,
    /// Rows of information of the instants before it.
    opening: Vec<Vec<f64>>,
    steps: Vec<Step<D, N>>,
}

/// Where the results go.
pub(crate) struct Smoothed<'a> {
    /// States (N, 3D).
    pub mean: &'a mut [f64],
    /// Covariances (N, R, R) of the first R components, or none.
    pub covariance: &'a mut [f64],
    pub components: usize,
}

impl<const D: usize, const N: usize> Adjoint<D, N> {
    /// The likelihood alone.
    pub fn likelihood(&mut self, track: &Track<'_>, jerk: f64) -> Option<Summary> {
        self.forwards(track, jerk, None)
    }

    /// States and covariances of all instants. Cost O(N).
    pub fn smooth(
        &mut self,
        track: &Track<'_>,
        jerk: f64,
        out: &mut Smoothed<'_>,
    ) -> Option<Summary> {
        let opening = OPENING[usize::from(out.components > D)];
        let summary = self.forwards(track, jerk, Some(opening))?;
        self.backwards(track, jerk, out)?;
        Some(summary)
    }

    fn forwards(
        &mut self,
        track: &Track<'_>,
        jerk: f64,
        opening: Option<usize>,
    ) -> Option<Summary> {
        let usual = track.prior.is_empty() && track.seen.iter().all(|seen| seen.count == ENOUGH);
        if !usual || track.dimension != D || N != 3 * D {
            return None;
        }
        self.steps.clear();
        let (step, squares, logarithms) = self.open(track, jerk, opening)?;
        let steps = opening.map(|_| &mut self.steps);
        let filter = Filter { track, jerk, start: self.start, step, squares, steps };
        let (squares, spread) = Arch::new().dispatch(filter)?;
        let count = track.measured - N;
        let logarithm = 2.0 * logarithms.total() + spread.total() + track.log_determinant;
        let logarithm = logarithm + count as f64 * TAU.ln();
        Some(Summary { log_likelihood: 0.0 - 0.5 * (squares + logarithm), count })
    }

    /// The state at the first instant that is filtered by covariances.
    pub(super) fn open(
        &mut self,
        track: &Track<'_>,
        jerk: f64,
        least: Option<usize>,
    ) -> Option<(Step<D, N>, f64, Logarithms)> {
        let Self { information, triangle, start, opening, .. } = self;
        information.start(D, &[]);
        opening.clear();
        let (mut squares, mut logarithms, mut settled) = (0.0, Logarithms::NONE, 0);
        for k in 0..track.len() {
            if k > 0 {
                information.advance(N, track, k - 1, jerk, Direction::Forwards, &mut logarithms);
            }
            squares += information.observe(N, track, k);
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
            for i in 0..D {
                step.x[i] += track.reference(k)[i];
            }
            return Some((step, squares, logarithms));
        }
        None
    }

    fn backwards(&self, track: &Track<'_>, jerk: f64, out: &mut Smoothed<'_>) -> Option<()> {
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
            }
            if k > self.start {
                step.back(track.whitener(k), &mut l, (components > 0).then_some(&mut big));
                let t = track.times[k] - track.times[k - 1];
                move_back(t, &mut l, (components > 0).then_some(&mut big));
            }
        }
        self.before(track, jerk, out, &l, &big)
    }

    /// The instants before the plots determine the state: with the rows of information Λ and η up
    /// to one and the state x' after it, `(Λ + F' Q^-1 F) x = η + F' Q^-1 x'`.
    fn before(
        &self,
        track: &Track<'_>,
        jerk: f64,
        out: &mut Smoothed<'_>,
        l: &[f64; N],
        big: &Square<N>,
    ) -> Option<()> {
        let first = &self.steps[0];
        let mut x = SVector::<f64, N>::from_fn(|i, _| first.x[i] - dot(&first.p[i], l));
        let mut p = SMatrix::<f64, N, N>::from_fn(|i, j| first.p[i][j]);
        let big = SMatrix::<f64, N, N>::from_fn(|i, j| big[i][j]);
        p -= p * big * p;
        for k in (0..self.start).rev() {
            let t = track.times[k + 1] - track.times[k];
            if t > 0.0 {
                let f = motion::<D, N>(t);
                if jerk == 0.0 {
                    let back = motion::<D, N>(-t);
                    (x, p) = (back * x, back * p * back.transpose());
                } else {
                    let weight = f.transpose() * precision::<D, N>(t, jerk);
                    let mut information = weight * f;
                    let mut right = weight * x;
                    for row in self.opening[k].chunks_exact(N + 1) {
                        let r = SVector::<f64, N>::from_fn(|i, _| row[i]);
                        let own: f64 = (0..D).map(|i| row[i] * track.reference(k)[i]).sum();
                        information += r * r.transpose();
                        right += r * (row[N] + own);
                    }
                    let factor = information.cholesky()?;
                    let gain = factor.solve(&weight);
                    x = factor.solve(&right);
                    p = factor.inverse() + gain * p * gain.transpose();
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
        Some(())
    }
}

/// The filter by covariances, for the vectors of the machine.
struct Filter<'a, const D: usize, const N: usize> {
    track: &'a Track<'a>,
    jerk: f64,
    start: usize,
    step: Step<D, N>,
    squares: f64,
    /// Where the steps are kept, if they are.
    steps: Option<&'a mut Vec<Step<D, N>>>,
}

impl<const D: usize, const N: usize> WithSimd for Filter<'_, D, N> {
    /// The sum of squares, and the variances of the innovations.
    type Output = Option<(f64, Logarithms)>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Self::Output {
        let Self { track, jerk, start, mut step, mut squares, mut steps } = self;
        let mut spread = Logarithms::NONE;
        for k in start + 1..track.len() {
            if let Some(steps) = steps.as_deref_mut() {
                steps.push(step.clone());
            }
            step.predict(track.times[k] - track.times[k - 1], jerk);
            squares += step.update(track, k, &mut spread)?;
        }
        if let Some(steps) = steps {
            steps.push(step);
        }
        Some((squares, spread))
    }
}

impl<const D: usize, const N: usize> Step<D, N> {
    pub(super) fn new() -> Self {
        Self { x: [0.0; N], p: [[0.0; N]; N], ph: [[0.0; N]; D], s: [0.0; D], innovation: [0.0; D] }
    }

    /// `x = F x`, `P = F P F' + Q`
    #[inline(always)]
    pub(super) fn predict(&mut self, t: f64, jerk: f64) {
        if t == 0.0 {
            return;
        }
        motion::advance::<D, N>(&mut self.x, &mut self.p, t, jerk);
    }

    /// Takes in the plot of an instant, number by number: they are whitened. Returns the sum of
    /// squares that it adds.
    #[inline(always)]
    fn update(&mut self, track: &Track<'_>, k: usize, spread: &mut Logarithms) -> Option<f64> {
        let (plot, whitener) = (track.plot(k), track.whitener(k));
        let mut squares = 0.0;
        for i in 0..D {
            self.s[i] = 0.0;
            if plot[i].is_nan() {
                continue;
            }
            let (mut ph, mut innovation) = ([0.0; N], 0.0);
            for j in 0..=i {
                let h = whitener[i * D + j];
                if h != 0.0 {
                    innovation += h * (plot[j] - self.x[j]);
                    for c in 0..N {
                        ph[c] += h * self.p[j][c];
                    }
                }
            }
            let s = 1.0 + (0..=i).map(|j| whitener[i * D + j] * ph[j]).sum::<f64>();
            if !(1.0..LOSS).contains(&s) {
                return None;
            }
            let reciprocal = 1.0 / s;
            let gain = innovation * reciprocal;
            for r in 0..N {
                self.x[r] += ph[r] * gain;
                for c in 0..N {
                    self.p[r][c] -= ph[r] * ph[c] * reciprocal;
                }
            }
            squares += innovation * gain;
            spread.add(s);
            (self.ph[i], self.s[i], self.innovation[i]) = (ph, s, innovation);
        }
        Some(squares)
    }

    /// `P − P Λ P` of the first components.
    #[inline(always)]
    fn smoothed_covariance(&self, big: &Square<N>, components: usize, out: &mut [f64]) {
        for i in 0..components {
            let mut row = [0.0; N];
            for k in 0..N {
                let factor = self.p[i][k];
                for c in 0..N {
                    row[c] += factor * big[k][c];
                }
            }
            for j in 0..=i {
                let value = self.p[i][j] - dot(&row, &self.p[j]);
                out[i * components + j] = value;
                out[j * components + i] = value;
            }
        }
    }

    /// The adjoint variables before the plot, from those after it.
    #[inline(always)]
    fn back(&self, whitener: &[f64], l: &mut [f64; N], mut big: Option<&mut Square<N>>) {
        for i in (0..D).rev() {
            let s = self.s[i];
            if s == 0.0 {
                continue;
            }
            let reciprocal = 1.0 / s;
            let gain: [f64; N] = std::array::from_fn(|c| self.ph[i][c] * reciprocal);
            let h = &whitener[i * D..][..=i];
            let along = dot(&gain, l) + self.innovation[i] * reciprocal;
            for (l, h) in l.iter_mut().zip(h) {
                *l -= h * along;
            }
            let Some(big) = big.as_deref_mut() else { continue };
            let mut moved = [0.0; N];
            for r in 0..N {
                for c in 0..N {
                    moved[c] += gain[r] * big[r][c];
                }
            }
            let square = dot(&moved, &gain) + reciprocal;
            for (j, h) in h.iter().enumerate() {
                for c in 0..N {
                    big[j][c] -= h * moved[c];
                }
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

/// `F' λ` and `F' Λ F`
#[inline(always)]
fn move_back<const N: usize>(t: f64, l: &mut [f64; N], big: Option<&mut Square<N>>) {
    if t == 0.0 {
        return;
    }
    let (d, half) = (N / 3, 0.5 * t * t);
    let turn = |row: &mut [f64; N]| {
        for i in 0..d {
            let (p, v) = (row[i], row[d + i]);
            row[2 * d + i] += t * v + half * p;
            row[d + i] += t * p;
        }
    };
    turn(l);
    let Some(big) = big else { return };
    big.iter_mut().for_each(turn);
    for i in 0..d {
        for c in 0..N {
            let (p, v) = (big[i][c], big[d + i][c]);
            big[2 * d + i][c] += t * v + half * p;
            big[d + i][c] += t * p;
        }
    }
}

/// F over a time t.
fn motion<const D: usize, const N: usize>(t: f64) -> SMatrix<f64, N, N> {
    let mut f = SMatrix::<f64, N, N>::identity();
    for i in 0..D {
        f[(i, D + i)] = t;
        f[(D + i, 2 * D + i)] = t;
        f[(i, 2 * D + i)] = 0.5 * t * t;
    }
    f
}

/// Q^-1 of white jerk over a time t.
fn precision<const D: usize, const N: usize>(t: f64, jerk: f64) -> SMatrix<f64, N, N> {
    let q = 1.0 / (jerk * t);
    let blocks = [
        [720.0 / t.powi(4), -360.0 / t.powi(3), 60.0 / (t * t)],
        [-360.0 / t.powi(3), 192.0 / (t * t), -36.0 / t],
        [60.0 / (t * t), -36.0 / t, 9.0],
    ];
    SMatrix::from_fn(|i, j| if i % D == j % D { q * blocks[i / D][j / D] } else { 0.0 })
}

#[cfg(test)]
mod tests {
    use super::super::smoother::{self, Workspace};
    use super::super::track::Noise;
    use super::*;

    /// The same as by rows of information, with missing numbers, equal and irregular times.
    #[test]
    fn both_ways_of_smoothing_agree() {
        let time: Vec<f64> = (0..60).map(|i| f64::from(i - i % 7 / 6) * 0.7).collect();
        let mut y: Vec<f64> = (0..120).map(|i| (f64::from(i) * 1.7).sin() * 3.0 + 900.0).collect();
        for at in [0, 9, 44, 45, 46, 47, 80] {
            y[at] = f64::NAN;
        }
        let noise = [4.0, 1.5, 1.5, 2.0];
        let track = Track::try_new(2, &time, &y, Noise::Same(&noise), None).unwrap();
        for jerk in [0.0, 1e-8, 1e-2, 10.0] {
            let [mut mean, mut quick] = [vec![0.0; 360], vec![0.0; 360]];
            let [mut covariance, mut own] = [vec![0.0; 2160], vec![0.0; 2160]];
            let innovation = &mut vec![0.0; 120];
            let mut out =
                smoother::Smoothed { mean: &mut mean, covariance: &mut covariance, innovation };
            let expected =
                smoother::smooth(&track, jerk, &mut Workspace::default(), &mut out).log_likelihood;
            let mut adjoint = Adjoint::<2, 6>::default();
            let mut out = Smoothed { mean: &mut quick, covariance: &mut own, components: 6 };
            let summary = adjoint.smooth(&track, jerk, &mut out).unwrap();
            assert!((summary.log_likelihood - expected).abs() < 1e-9 * expected.abs());
            for k in 0..60 {
                for i in 0..6 {
                    let sigma = covariance[(k * 6 + i) * 6 + i].sqrt();
                    let error = (mean[k * 6 + i] - quick[k * 6 + i]).abs() / sigma;
                    assert!(error < 1e-9, "jerk {jerk}, instant {k}, component {i}: {error}");
                    let ratio = own[(k * 6 + i) * 6 + i] / (sigma * sigma);
                    assert!((ratio - 1.0).abs() < 1e-7, "{jerk} {k} {i} {ratio}");
                }
            }
        }
    }
}
