//! Plots of a target: positions with their covariances at instants, and velocities if these are measured.

use super::seen::{ENOUGH, Quantity, Seen};
use super::whitener::{LARGEST, Noise, Whitened, whiten_as};
use crate::base::basis::Basis;
use crate::base::error::{Error, Result, require_times};
use std::ops::Range;

/// Ratio of the variance of a plot to that of the last one with which it moves the reference halfway.
const FORGETTING: f64 = 1e4;

/// Velocities that are measured with the positions.
#[derive(Clone, Copy, Debug)]
pub struct Velocities<'a> {
    /// (N, D); nan where a component is missing.
    pub velocity: &'a [f64],
    /// Covariances of the velocities; their errors are independent of those of the positions.
    pub noise: Noise<'a>,
}

/// Prior of the state at the first instant: mean (3D) and covariance (3D, 3D), in the order positions,
/// velocities, accelerations.
#[derive(Clone, Copy, Debug)]
pub struct Prior<'a> {
    /// Mean of the state.
    pub mean: &'a [f64],
    /// Covariance of the state, row by row.
    pub covariance: &'a [f64],
}

/// Plots of a target, ready to be smoothed.
#[derive(Clone, Debug)]
pub struct Track<'a> {
    pub(super) dimension: usize,
    /// Number M of components of a plot: D positions, and D velocities if these are measured.
    pub(super) numbers: usize,
    pub(super) times: &'a [f64],
    /// The plots (N, M) less the trend; nan where missing.
    pub(super) y: Vec<f64>,
    trend: Trend,
    /// Positions near the plots, at all instants: the state is estimated as its difference from them.
    pub(super) reference: Vec<f64>,
    /// For each instant, the inverse of the lower Cholesky factor of the covariance of the measured
    /// components (M, M).
    pub(super) whitener: Vec<f64>,
    /// Sum of the logarithms of the determinants of the covariances.
    pub(super) log_determinant: f64,
    /// Number of measured components.
    pub(super) measured: usize,
    /// What the whole track determines, for each axis.
    pub(super) seen: Vec<Seen>,
    /// Reciprocal of the least standard deviation of each component; if it is never measured, 1 for a
    /// position and 0 for a velocity.
    pub(super) scale: Vec<f64>,
    /// Rows of information of the prior at the first instant, with the right-hand side; empty if there is no
    /// prior.
    pub(super) prior: Vec<f64>,
    /// The single axes, if their errors are independent; else empty.
    pub(super) axes: Vec<Self>,
}

/// A parabola for each axis.
#[derive(Clone, Debug, Default)]
struct Trend {
    centre: f64,
    scale: f64,
    /// Coefficients of the powers of `(t − centre) / scale`.
    coefficients: Vec<[f64; 3]>,
}

impl Trend {
    fn x(&self, time: f64) -> f64 {
        (time - self.centre) / self.scale
    }

    /// Position, velocity and acceleration of the trend.
    fn at(&self, axis: usize, time: f64) -> [f64; 3] {
        let (x, unit, [c0, c1, c2]) = (self.x(time), 1.0 / self.scale, self.coefficients[axis]);
        [c0 + x * (c1 + x * c2), (c1 + 2.0 * x * c2) * unit, 2.0 * c2 * unit * unit]
    }
}

impl<'a> Track<'a> {
    /// Longest step relative to the shortest, without steps of zero duration.
    pub(super) fn unevenness(&self) -> f64 {
        let steps = self.times.windows(2).map(|pair| pair[1] - pair[0]).filter(|&t| t > 0.0);
        let wider = |(least, most): (f64, f64), t: f64| (least.min(t), most.max(t));
        let (least, most) = steps.fold((f64::INFINITY, 0.0), wider);
        most / least
    }

    /// Largest distance of a component from the trend, over its least standard deviation.
    pub(super) fn farthest(&self) -> f64 {
        let scales = self.scale.iter().cycle();
        // nan is not larger
        self.y.iter().zip(scales).fold(0.0_f64, |most, (y, scale)| most.max(y.abs() * scale))
    }

    /// Sets up a track of N plots in D dimensions: `times` (N), not decreasing, `y` (N, D), nan where a
    /// component is missing. Slices of other lengths panic.
    ///
    /// # Errors
    /// A plot is infinite, times decrease, or a matrix is no covariance where there is a plot.
    pub fn try_new(
        dimension: usize,
        times: &'a [f64],
        y: &[f64],
        noise: Noise<'_>,
        prior: Option<Prior<'_>>,
    ) -> Result<Self> {
        Self::with_velocities(dimension, times, y, noise, None, prior)
    }

    /// As [`Track::try_new`], with measured velocities.
    ///
    /// # Errors
    /// Those of [`Track::try_new`].
    pub fn with_velocities(
        dimension: usize,
        times: &'a [f64],
        y: &[f64],
        noise: Noise<'_>,
        velocities: Option<Velocities<'_>>,
        prior: Option<Prior<'_>>,
    ) -> Result<Self> {
        require_times(times, LARGEST)?;
        let (d, n) = (dimension, times.len());
        let mut parts = vec![Whitened::try_new(["y", "covariance"], d, y, noise, n)?];
        if let Some(Velocities { velocity, noise }) = velocities {
            let names = ["velocity", "velocity_covariance"];
            parts.push(Whitened::try_new(names, d, velocity, noise, n)?);
        }
        let Whitened { y, whitener, log_determinant, measured } = Whitened::together(parts, d, n);
        let numbers = if velocities.is_some() { 2 * d } else { d };
        let mut track = Self {
            dimension,
            numbers,
            times,
            y,
            trend: Trend::default(),
            reference: vec![0.0; n * d],
            whitener,
            log_determinant,
            measured,
            seen: vec![if prior.is_some() { Seen::ALL } else { Seen::NONE }; d],
            scale: vec![0.0; numbers],
            prior: Vec::new(),
            axes: Vec::new(),
        };
        track.look_through();
        track.set_trend();
        track.set_reference();
        match prior {
            Some(prior) => track.set_prior(prior)?,
            None => track.axes = track.split(),
        }
        Ok(track)
    }

    /// Finds what the plots determine, and the least standard deviations of their components.
    fn look_through(&mut self) {
        let (d, m) = (self.dimension, self.numbers);
        for (k, plot) in self.y.chunks_exact(m.max(1)).enumerate() {
            for (i, _) in plot.iter().enumerate().filter(|(_, y)| !y.is_nan()) {
                self.seen[i % d].add(Quantity::of(i, d), self.times[k]);
                self.scale[i] = self.scale[i].max(self.whitener[(k * m + i) * m + i]);
            }
        }
        for scale in &mut self.scale[..d] {
            *scale = if *scale > 0.0 { *scale } else { 1.0 };
        }
    }

    /// Returns the single axes, if there are several and their errors are independent.
    fn split(&self) -> Vec<Self> {
        let (d, m) = (self.dimension, self.numbers);
        let mixed = |(at, h): (usize, &f64)| *h != 0.0 && at / m % m % d != at % m % d;
        if d < 2 || self.whitener.iter().enumerate().any(mixed) {
            return Vec::new();
        }
        // every d-th value of each row, starting with that of the axis
        let column = |values: &[f64], axis: usize| -> Vec<f64> {
            values.iter().skip(axis).step_by(d).copied().collect()
        };
        let of = |axis: usize| {
            let y = column(&self.y, axis);
            let rows = self.whitener.chunks_exact(m).skip(axis).step_by(d);
            Self {
                dimension: 1,
                numbers: m / d,
                times: self.times,
                measured: y.iter().filter(|y| !y.is_nan()).count(),
                y,
                trend: Trend::default(),
                reference: column(&self.reference, axis),
                whitener: rows.flat_map(|row| column(row, axis)).collect(),
                // counted once, with the first axis
                log_determinant: if axis == 0 { self.log_determinant } else { 0.0 },
                seen: vec![self.seen[axis]],
                scale: column(&self.scale, axis),
                prior: Vec::new(),
                axes: Vec::new(),
            }
        };
        (0..d).map(of).collect()
    }

    /// Subtracts the parabola that is nearest to the plots. It is a motion without jerk, so the remaining
    /// motion obeys the same model, but is much smaller.
    fn set_trend(&mut self) {
        let (d, m) = (self.dimension, self.numbers);
        let span = self.span();
        let (first, last) = (self.times.first(), self.times.last());
        let centre = first.zip(last).map_or(0.0, |(first, last)| first + 0.5 * (last - first));
        self.trend = Trend { centre, scale: 0.5 * span, coefficients: Vec::new() };
        let (mut basis, mut c, mut at) = (Basis::default(), Vec::new(), Vec::new());
        for axis in 0..d {
            let there = || (0..self.len()).filter(|&k| !self.plot(k)[axis].is_nan());
            let x: Vec<f64> = there().map(|k| self.trend.x(self.times[k])).collect();
            let least = self.scale[axis];
            let w = |k: usize| (self.whitener[(k * m + axis) * m + axis] / least).powi(2);
            let w: Vec<f64> = there().map(w).collect();
            let mut y: Vec<f64> = there().map(|k| self.plot(k)[axis]).collect();
            let distinct = x.chunk_by(|a, b| a == b).count();
            let mut powers = [0.0; 3];
            if distinct > 0 {
                basis.build(distinct.min(ENOUGH) - 1, &x, &w);
                basis.fit(&w, &mut y, &mut c);
                for (order, power) in powers.iter_mut().enumerate() {
                    basis.derivatives(order, 0.0, &mut at);
                    *power = c.iter().zip(&at).map(|(c, p)| c * p).sum();
                }
                powers[2] *= 0.5;
            }
            self.trend.coefficients.push(powers);
        }
        for k in 0..self.len() {
            for i in 0..m {
                self.y[k * m + i] -= self.trend.at(i % d, self.times[k])[i / d];
            }
        }
    }

    /// Adds the reference and the trend of instant `k` to a state.
    pub(super) fn restore(&self, k: usize, state: &mut [f64]) {
        for (position, reference) in state.iter_mut().zip(self.reference(k)) {
            *position += reference;
        }
        self.add_trend(k, state);
    }

    /// Adds the trend of instant `k` to a state.
    pub(super) fn add_trend(&self, k: usize, state: &mut [f64]) {
        let d = self.dimension;
        for axis in 0..d {
            let [position, velocity, acceleration] = self.trend.at(axis, self.times[k]);
            state[axis] += position;
            state[d + axis] += velocity;
            state[2 * d + axis] += acceleration;
        }
    }

    /// Position of the trend of an axis at instant `k`.
    pub(super) fn trend_position(&self, axis: usize, k: usize) -> f64 {
        self.trend.at(axis, self.times[k])[0]
    }

    /// Acceleration of the trend of an axis.
    pub(super) fn trend_acceleration(&self, axis: usize) -> f64 {
        self.trend.at(axis, self.trend.centre)[2]
    }

    /// Sets the reference, which follows the plots, except those that are much less precise than others.
    fn set_reference(&mut self) {
        let (d, m, n) = (self.dimension, self.numbers, self.len());
        for axis in 0..d {
            let first = (0..n).map(|k| self.y[k * m + axis]).find(|y| !y.is_nan());
            let (mut position, mut variance) = (first.unwrap_or(0.0), f64::INFINITY);
            for k in 0..n {
                let y = self.y[k * m + axis];
                if !y.is_nan() {
                    variance *= FORGETTING;
                    let own = self.whitener[(k * m + axis) * m + axis].powi(-2);
                    let gain = 1.0 / (1.0 + own / variance);
                    position += gain * (y - position);
                    variance = gain * own;
                }
                self.reference[k * d + axis] = position;
            }
        }
    }

    fn set_prior(&mut self, prior: Prior<'_>) -> Result<()> {
        let (n, argument) = (3 * self.dimension, "initial");
        let requirement = "every mean must be a finite number";
        if let Some(i) = prior.mean.iter().position(|x| x.is_nan() || x.abs() > LARGEST) {
            let value = prior.mean[i];
            return Err(Error::InvalidElement { argument, index: vec![i], value, requirement });
        }
        let mut root = vec![0.0; n * n];
        let log = whiten_as(argument, &[], prior.covariance, &vec![true; n], &mut root)?;
        self.log_determinant += log;
        let mut start = vec![0.0; n];
        if !self.is_empty() {
            self.restore(0, &mut start);
        }
        for row in root.chunks_exact(n) {
            let right = |i: usize| prior.mean[i] - start[i];
            let sum = row.iter().enumerate().map(|(i, r)| r * right(i)).sum();
            self.prior.extend_from_slice(row);
            self.prior.push(sum);
        }
        Ok(())
    }

    /// Ranges of the components of a plot whose errors may be correlated: positions, and velocities.
    pub(super) fn parts(&self) -> impl Iterator<Item = Range<usize>> + use<> {
        let (d, m) = (self.dimension, self.numbers);
        (0..m).step_by(d.max(1)).map(move |first| first..first + d)
    }

    /// Number of instants.
    pub fn len(&self) -> usize {
        self.times.len()
    }

    /// Whether there are no instants.
    pub fn is_empty(&self) -> bool {
        self.times.is_empty()
    }

    pub(super) fn plot(&self, k: usize) -> &[f64] {
        &self.y[k * self.numbers..][..self.numbers]
    }

    pub(super) fn reference(&self, k: usize) -> &[f64] {
        &self.reference[k * self.dimension..][..self.dimension]
    }

    pub(super) fn whitener(&self, k: usize) -> &[f64] {
        let size = self.numbers * self.numbers;
        &self.whitener[k * size..][..size]
    }

    /// Time from the first instant to the last; 1 if it is 0.
    pub(super) fn span(&self) -> f64 {
        match self.times {
            [first, .., last] if last > first => last - first,
            _ => 1.0,
        }
    }

    /// Reciprocals of the least standard deviations of positions.
    pub(super) fn position_scale(&self) -> &[f64] {
        &self.scale[..self.dimension]
    }

    /// Reciprocals of the least standard deviations of velocities, if these are measured.
    pub(super) fn velocity_scale(&self) -> &[f64] {
        &self.scale[self.dimension..]
    }

    /// Number of unknowns that the plots determine.
    pub(super) fn rank(&self) -> usize {
        self.seen.iter().map(|seen| seen.count).sum()
    }
}
