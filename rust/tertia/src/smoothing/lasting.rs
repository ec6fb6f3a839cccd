//! Smoother for correlated noise: a share of the noise is a Gauss–Markov process for every whitened axis,
//! which is part of the state. Plots may be left out, and the position may jump.
//!
//! A Kalman filter runs forwards from a vague state, and the adjoint variables run backwards (Bryson, Frazier
//! 1963), as in [`adjoint`](super::adjoint); no matrix is inverted.

// indices are those of the formulas
#![allow(clippy::needless_range_loop)]

mod start;

use super::adjoint::update;
use super::components::{Away, Faded, Turn, axes};
use super::diffuse;
use super::information::Logarithms;
use super::model::{Faults, Model};
use super::motion::{self, ProcessNoise};
use super::seen::Quantity;
use super::track::Track;
use crate::base::interrupt::poll;
use crate::base::small::{self, Matrix as Square, dot, symmetrise};
use start::{State, VAGUE, VAGUE_AFTER_ALL, near, prior, vague};

/// Variance of a jump relative to that of a plot, and relative to the square of the jump that the plot shows:
/// the larger these are, the more digits are lost.
const JUMP: [f64; 2] = [1e4, 10.0];
/// Variance of an innovation, relative to that of the plot, from which on rounding is corrected.
const STEEP: f64 = 1e6;
/// Share of a variance that must remain; what is less is rounding.
const LEAST_SHARE: f64 = 1e-11;
/// Largest number of attempts, each of which starts near the result of the one before.
const ATTEMPTS: usize = 12;
/// Largest ratio of the variances of two attempts with which neither is due to rounding.
const ALIKE: f64 = 30.0;

/// Fit of a model: the sums of the squared innovations and of the logarithms of their variances.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fit {
    pub squares: f64,
    pub logarithms: Logarithms,
    /// Number of innovations.
    pub count: usize,
}

impl Fit {
    const NONE: Self = Self { squares: 0.0, logarithms: Logarithms::NONE, count: 0 };
}

/// State and covariance after the plot of an instant, and the update by the plot.
#[derive(Clone, Debug)]
struct Step<const M: usize, const N: usize> {
    x: [f64; N],
    p: Square<N>,
    ph: [[f64; N]; M],
    h: [[f64; N]; M],
    /// Variances of the innovations; 0 for a missing number.
    s: [f64; M],
    innovation: [f64; M],
}

/// Results: states (N, 3D) with covariances, whitened innovations (N, M) of unit variance, and for each
/// instant how much a jump before it would explain, as a chi-square variable.
#[derive(Debug, Default)]
pub(super) struct Found {
    pub mean: Vec<f64>,
    pub covariance: Vec<f64>,
    pub innovation: Vec<f64>,
    pub jump: Vec<f64>,
}

impl Found {
    /// Variances of the first state; 1 for the components of the noise.
    fn first_variances<const N: usize>(&self) -> [f64; N] {
        let states = 3 * axes(N);
        std::array::from_fn(|i| if i < states { self.covariance[i * (states + 1)] } else { 1.0 })
    }
}

/// Whether the variances of two attempts are so similar that neither is due to rounding.
fn are_alike<const N: usize>(own: &[f64; N], other: &[f64; N]) -> bool {
    let ratios = own.iter().zip(other).map(|(own, other)| own / other);
    // nan before the first attempt
    ratios.into_iter().all(|ratio| ratio > 1.0 / ALIKE && ratio < ALIKE)
}

/// Smoother of a track with D axes, plots of M numbers and N = 4 D, or N = 5 D with an oscillation.
pub(super) struct Lasting<const M: usize, const N: usize> {
    start: State<N>,
    /// A vague state near the smoothed first state. The first plots alone may determine this state so badly
    /// that a smoother that starts from them loses all digits.
    smoothed: Option<State<N>>,
    /// Variances of the first state after the last smoothing.
    variances: [f64; N],
    steps: Vec<Step<M, N>>,
    /// Response of the state at each instant to each component of the first state.
    answers: Vec<Square<N>>,
}

impl<const M: usize, const N: usize> Lasting<M, N> {
    /// Returns none if the plots do not determine the state of each axis.
    pub fn new<const S: usize>(track: &Track<'_>, motion: ProcessNoise) -> Option<Self> {
        let d = track.dimension;
        assert!(track.numbers == M && S == 3 * d && axes(N) == d);
        let (x, p) =
            if track.prior.is_empty() { vague::<M, S>(track, motion)? } else { prior(track) };
        let mut start = ([0.0; N], [[0.0; N]; N]);
        start.0[..S].copy_from_slice(&x);
        for i in 0..S {
            start.1[i][..S].copy_from_slice(&p[i]);
        }
        for i in S..N {
            start.1[i][i] = 1.0;
        }
        let variances = [f64::NAN; N];
        Some(Self { start, smoothed: None, variances, steps: Vec::new(), answers: Vec::new() })
    }

    /// Sets the state and covariance of the first instant as found for white noise; smoothing starts near
    /// them.
    pub fn near(mut self, track: &Track<'_>, mean: &[f64], covariance: &[f64]) -> Self {
        if track.prior.is_empty() {
            self.smoothed = near(track, (mean, covariance), &self.start, VAGUE_AFTER_ALL);
        }
        self
    }

    /// Takes over the first state that another engine has found.
    pub fn after(mut self, other: &Self) -> Self {
        (self.smoothed, self.variances) = (other.smoothed, other.variances);
        self
    }

    /// Filters without keeping anything. Cost O(N D³).
    pub fn fit(&self, track: &Track<'_>, model: &Model, faults: &Faults) -> Fit {
        poll();
        let (mut fit, mut faded) = (Fit::NONE, Faded::default());
        let mut step = self.first();
        for k in 0..track.len() {
            step.arrive(track, k, model, faults, &mut faded);
            step.update(track, k, model, faults, &mut fit);
        }
        fit
    }

    /// Smooths; returns none if rounding leaves too little of a variance. Cost O(N D³) for each attempt.
    ///
    /// Rounding adds about `ε ρ²` to a variance, relative to itself, where ρ is the ratio of the variance at
    /// the start to it: a start that is too vague may give too large variances. Therefore smoothing starts
    /// again near its own result, until the result agrees with the start.
    pub fn smooth(
        &mut self,
        track: &Track<'_>,
        model: &Model,
        faults: &Faults,
        out: &mut Found,
    ) -> Option<()> {
        let vague = self.start;
        let mut start = self.smoothed.unwrap_or(vague);
        let mut before = self.variances;
        for attempt in 1..=ATTEMPTS {
            poll();
            self.start = start;
            let is_well = self.pass(track, model, faults, out);
            self.start = vague;
            if !track.prior.is_empty() {
                return is_well.then_some(());
            }
            let own = out.first_variances();
            let found = (&out.mean[..], &out.covariance[..]);
            // in the last attempt, variances that are too large are better than none
            if is_well && (are_alike(&own, &before) || attempt == ATTEMPTS) {
                self.smoothed = near(track, found, &vague, VAGUE_AFTER_ALL);
                self.variances = own;
                return Some(());
            }
            before = if is_well { own } else { [f64::NAN; N] };
            start = near(track, found, &vague, VAGUE).unwrap_or(vague);
        }
        None
    }

    /// Filters and smooths once; returns whether no variance is lost to rounding.
    fn pass(&mut self, track: &Track<'_>, model: &Model, faults: &Faults, out: &mut Found) -> bool {
        let n = track.len();
        let states = 3 * axes(N);
        out.mean.resize(n * states, 0.0);
        out.covariance.resize(n * states * states, 0.0);
        out.innovation.resize(n * M, 0.0);
        out.jump.resize(n, 0.0);
        let (mut step, mut faded, away) = (self.first(), Faded::default(), Away::of(model));
        let mut answer: Square<N> =
            std::array::from_fn(|c| std::array::from_fn(|r| f64::from(r == c)));
        self.steps.clear();
        self.answers.clear();
        let mut unused = Fit::NONE;
        for k in 0..n {
            step.arrive(track, k, model, faults, &mut faded);
            step.update(track, k, model, faults, &mut unused);
            let t = track.times[k] - track.times[k.saturating_sub(1)];
            let turn = Turn::over(t, model);
            let plot = (&step.ph, &step.h, &step.s);
            for column in &mut answer[..states] {
                motion::advance_row(axes(N), column, t, 0.5 * t * t);
                turn.row(column);
                diffuse::update(column, plot);
            }
            self.answers.push(answer);
            self.steps.push(step.clone());
        }
        let mut is_well = true;
        let (mut l, mut big) = ([0.0; N], [[0.0; N]; N]);
        for k in (0..n).rev() {
            // from the state after the plot: that before it may be many times less certain
            let step = &self.steps[k];
            let mean = &mut out.mean[k * states..][..states];
            let rows = away.rows(&step.p);
            for i in 0..states {
                mean[i] = away.whole(&step.x, i) + dot(&rows[i], &l);
            }
            track.add_trend(k, mean);
            let covariance = &mut out.covariance[k * states * states..];
            is_well &= smoothed_covariance(&rows, &away, &big, covariance);
            for answer in &mut self.answers[k][..states] {
                diffuse::smooth(answer, &step.p, &big);
                (0..states).for_each(|i| answer[i] = away.whole(answer, i));
            }
            for i in (0..M).rev() {
                step.back(i, &mut l, &mut big);
                let s = step.s[i];
                out.innovation[k * M + i] =
                    if s > 0.0 { step.innovation[i] / s.sqrt() } else { f64::NAN };
            }
            out.jump[k] = explained(&l, &big);
            if k > 0 {
                let t = track.times[k] - track.times[k - 1];
                back(t, Turn::over(t, model), &mut l, &mut big);
            }
        }
        if is_well && track.prior.is_empty() {
            let found = (&mut out.mean[..], &mut out.covariance[..]);
            diffuse::forget_start(&self.answers, &l, &big, found);
        }
        is_well
    }

    fn first(&self) -> Step<M, N> {
        let (x, p) = self.start;
        Step { x, p, ph: [[0.0; N]; M], h: [[0.0; N]; M], s: [0.0; M], innovation: [0.0; M] }
    }
}

impl<const M: usize, const N: usize> Step<M, N> {
    /// `x = F x`, `P = F P F' + Q`, and a jump if there is one.
    #[inline(always)]
    fn arrive(
        &mut self,
        track: &Track<'_>,
        k: usize,
        model: &Model,
        faults: &Faults,
        faded: &mut Faded,
    ) {
        if k == 0 {
            return;
        }
        let t = track.times[k] - track.times[k - 1];
        if t > 0.0 {
            let motion = model.motion.times(faults.levels.motion(k));
            self.predict(t, faded.over(t, model), motion);
        }
        if faults.jumps[k] {
            for (i, plot) in track.plot(k)[..axes(N)].iter().enumerate() {
                let shown = if plot.is_nan() { 0.0 } else { plot - self.x[i] };
                self.p[i][i] += JUMP[0] / track.scale[i].powi(2) + JUMP[1] * shown * shown;
            }
        }
    }

    #[inline(always)]
    fn predict(&mut self, t: f64, turn: &Turn, motion: ProcessNoise) {
        turn.row(&mut self.x);
        self.p.iter_mut().for_each(|row| turn.row(row));
        turn.rows(&mut self.p);
        motion::advance(axes(N), &mut self.x, &mut self.p, t, motion);
        turn.add_noise(&mut self.p);
    }

    /// Updates the state by the plot of an instant, number by number, because these are whitened.
    #[inline(always)]
    fn update(
        &mut self,
        track: &Track<'_>,
        k: usize,
        model: &Model,
        faults: &Faults,
        fit: &mut Fit,
    ) {
        let (plot, whitener) = (track.plot(k), track.whitener(k));
        let d = axes(N);
        for i in 0..M {
            self.s[i] = 0.0;
            if plot[i].is_nan() || faults.gross[(k * M + i) / d] {
                continue;
            }
            let mut h = [0.0; N];
            h[..=i].copy_from_slice(&whitener[i * M..][..=i]);
            let (mut variance, share) = model.noise(Quantity::of(i, d));
            if i < d {
                variance *= faults.levels.noise(k);
            }
            h[3 * d + i % d] = (share * variance).sqrt();
            if i < d && model.wanders() {
                (0..=i).for_each(|j| h[3 * d + j] = model.wandering[j] * h[j]);
            } else if N > 4 * d {
                let rate = model.natural_frequency();
                (0..d).for_each(|j| h[4 * d + j] = rate * model.wandering[j] * h[d + j]);
            }
            let mut late = 0.0;
            if i >= d && model.velocity_time_offset != 0.0 {
                // a velocity that lags measures v - a lag
                for j in (d..=i).filter(|&j| !plot[j].is_nan()) {
                    h[j + d] = -h[j] * model.velocity_time_offset;
                    late -= h[j + d] * track.trend_acceleration(j - d);
                }
            }
            // a missing component has no row, and no column in the rows of the others
            let there = (0..=i).filter(|&j| !plot[j].is_nan());
            let measured: f64 = there.map(|j| h[j] * plot[j]).sum();
            let (mut predicted, mut ph) = (0.0, [0.0; N]);
            for c in 0..N {
                // most elements are zero
                if h[c] != 0.0 {
                    predicted += h[c] * self.x[c];
                    small::add_multiple(&mut ph, h[c], &self.p[c]);
                }
            }
            let innovation = measured + late - predicted;
            let s = (1.0 - share) * variance + dot(&ph, &h);
            let gain = update(&mut self.x, &mut self.p, &ph, innovation, s);
            let own = (1.0 - share) * variance;
            if s > STEEP * own {
                let reciprocal = 1.0 / s;
                self.correct(&h, &ph.map(|ph| ph * reciprocal), own);
            }
            fit.squares += innovation * gain;
            // a variance lost to rounding leaves no likelihood
            fit.logarithms.add(if s > 0.0 { s } else { f64::NAN });
            fit.count += 1;
            (self.h[i], self.ph[i], self.s[i], self.innovation[i]) = (h, ph, s, innovation);
        }
    }

    /// Completes `P − K H P` to `(I − K H) P (I − K H)' + K R K'` (Joseph): in exact arithmetic, nothing
    /// changes; what rounding has left of a variance far above R vanishes.
    #[cold]
    fn correct(&mut self, h: &[f64; N], gain: &[f64; N], own: f64) {
        let left = small::rotated(&self.p, h);
        for r in 0..N {
            small::add_multiple(&mut self.p[r], gain[r] * own - left[r], gain);
        }
        // the rows of what is measured are less precise than its columns
        for r in 0..N {
            for c in 0..r {
                self.p[c][r] = self.p[r][c];
            }
        }
    }

    /// Takes the adjoint variables back across the i-th number.
    #[inline(always)]
    fn back(&self, i: usize, l: &mut [f64; N], big: &mut Square<N>) {
        if self.s[i] == 0.0 {
            return;
        }
        let (h, reciprocal) = (&self.h[i], 1.0 / self.s[i]);
        let gain: [f64; N] = std::array::from_fn(|c| self.ph[i][c] * reciprocal);
        let along = self.innovation[i] * reciprocal - dot(&gain, l);
        for r in 0..N {
            l[r] += h[r] * along;
        }
        // `(I − K H)' Λ (I − K H) + H' H / s`, from the left and then from the right: sums that cancel are formed
        // twice
        let moved = small::product(big, &gain);
        for r in 0..N {
            small::add_multiple(&mut big[r], -h[r], &moved);
        }
        let moved = small::rotated(big, &gain);
        for r in 0..N {
            small::add_multiple(&mut big[r], h[r] * reciprocal - moved[r], h);
        }
    }
}

/// `T (P − P Λ P) T'` of the states, with the rows of `T P`; returns whether rounding leaves enough of the
/// variances.
fn smoothed_covariance<const N: usize>(
    rows: &Square<N>,
    away: &Away<N>,
    big: &Square<N>,
    out: &mut [f64],
) -> bool {
    let (states, mut is_well) = (3 * axes(N), true);
    for i in 0..states {
        let seen = small::product(big, &rows[i]);
        for j in 0..=i {
            let before = away.whole(&rows[i], j);
            let value = before - dot(&rows[j], &seen);
            out[i * states + j] = value;
            out[j * states + i] = value;
            is_well &= i != j || value > LEAST_SHARE * before;
        }
    }
    is_well
}

/// `F' λ` and `F' Λ F`
#[inline(always)]
fn back<const N: usize>(t: f64, turn: Turn, l: &mut [f64; N], big: &mut Square<N>) {
    if t == 0.0 {
        return;
    }
    let turn = turn.transposed();
    turn.row(l);
    big.iter_mut().for_each(|row| turn.row(row));
    motion::turn_back(axes(N), t, l, Some(big));
    turn.rows(big);
    symmetrise(big);
}

/// `λ' Λ^-1 λ` of the positions: how much a jump before this instant would explain (de Jong, Penzer 1998).
fn explained<const N: usize>(l: &[f64; N], big: &Square<N>) -> f64 {
    let mut factor = [[0.0; N]; N];
    let (mut white, mut sum) = ([0.0; N], 0.0);
    for i in 0..axes(N) {
        for j in 0..=i {
            let inner: f64 = (0..j).map(|k| factor[i][k] * factor[j][k]).sum();
            let value = big[i][j] - inner;
            if i == j {
                if value.is_nan() || value <= 1e-12 * big[i][i] {
                    return 0.0;
                }
                factor[i][i] = value.sqrt();
            } else {
                factor[i][j] = value / factor[j][j];
            }
        }
        let inner: f64 = (0..i).map(|k| factor[i][k] * white[k]).sum();
        white[i] = (l[i] - inner) / factor[i][i];
        sum += white[i] * white[i];
    }
    sum
}
