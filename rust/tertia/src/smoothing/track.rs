//! The plots of a target: positions with their covariances, at instants.

use crate::base::basis::Basis;
use crate::base::error::{Error, Result, require_elements, require_times};

/// Products of two standard deviations and of their reciprocals stay finite.
const VARIANCES: std::ops::RangeInclusive<f64> = 1e-140..=1e140;
/// Largest difference of two elements that should be equal, in standard deviations.
const ASYMMETRY: f64 = 1e-10;
/// Share of a variance that the other components must leave unexplained.
const REGULAR: f64 = 1e-13;
/// A plot that is so many times less precise than the last moves the reference halfway.
const FORGETTING: f64 = 1e4;
/// Squares of larger numbers overflow.
const LARGEST: f64 = 1e140;

/// Covariances of the plots, row by row.
#[derive(Clone, Copy, Debug)]
pub enum Noise<'a> {
    /// One matrix (D, D) for all instants.
    Same(&'a [f64]),
    /// A matrix for each instant, (N, D, D).
    Each(&'a [f64]),
}

/// What is known at the first instant besides the plots: mean (3D) and covariance (3D, 3D), in the
/// order positions, velocities, accelerations.
#[derive(Clone, Copy, Debug)]
pub struct Prior<'a> {
    /// The mean.
    pub mean: &'a [f64],
    /// Its covariance, row by row.
    pub covariance: &'a [f64],
}

/// The distinct instants at which an axis is measured, as far as they matter: three of them
/// determine its state.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Seen {
    pub count: usize,
    pub instants: [f64; 2],
}

/// Distinct instants that determine position, velocity and acceleration.
pub(super) const ENOUGH: usize = 3;

impl Seen {
    pub const ALL: Self = Self { count: ENOUGH, instants: [f64::NAN; 2] };

    /// With a plot at `time`, which is not before (or not after) the others.
    pub fn add(&mut self, time: f64) {
        if self.count < ENOUGH && (self.count == 0 || self.instants[self.count - 1] != time) {
            if self.count < 2 {
                self.instants[self.count] = time;
            }
            self.count += 1;
        }
    }

    /// Whether position, velocity and acceleration at `time` are determined. Through two plots goes
    /// a parabola of any curvature, whose slope halfway is that of the chord.
    pub fn determines(&self, time: f64) -> [bool; 3] {
        let [first, second] = self.instants;
        match self.count {
            0 => [false; 3],
            1 => [time == first, false, false],
            2 => [time == first || time == second, time - first == second - time, false],
            _ => [true; 3],
        }
    }
}

/// Plots of a target, ready to be smoothed.
#[derive(Clone, Debug)]
pub struct Track<'a> {
    pub(super) dimension: usize,
    pub(super) times: &'a [f64],
    /// The plots less the trend; nan where there is none.
    pub(super) y: Vec<f64>,
    trend: Trend,
    /// Positions near the plots, at all instants: the state is sought as its difference to them.
    pub(super) reference: Vec<f64>,
    /// Of every instant the inverse of the lower Cholesky factor of what is there (D, D).
    pub(super) whitener: Vec<f64>,
    /// Sum of the logarithms of the determinants of the covariances.
    pub(super) log_determinant: f64,
    /// Numbers measured.
    pub(super) measured: usize,
    /// What the whole track determines.
    pub(super) seen: Vec<Seen>,
    /// Reciprocal of the least standard deviation of an axis.
    pub(super) scale: Vec<f64>,
    /// Rows of information at the first instant, with the right side; empty if there is none.
    pub(super) prior: Vec<f64>,
    /// Each axis alone, where they do not know of each other; else none.
    pub(super) axes: Vec<Self>,
}

/// A parabola of every axis.
#[derive(Clone, Debug, Default)]
struct Trend {
    centre: f64,
    scale: f64,
    /// Of the powers of `(t − centre) / scale`.
    coefficients: Vec<[f64; 3]>,
}

impl Trend {
    fn x(&self, time: f64) -> f64 {
        (time - self.centre) / self.scale
    }

    /// Position, velocity, acceleration.
    fn at(&self, axis: usize, time: f64) -> [f64; 3] {
        let (x, unit, [c0, c1, c2]) = (self.x(time), 1.0 / self.scale, self.coefficients[axis]);
        [c0 + x * (c1 + x * c2), (c1 + 2.0 * x * c2) * unit, 2.0 * c2 * unit * unit]
    }
}

impl<'a> Track<'a> {
    /// The longest step over the shortest, of those that take time.
    pub(super) fn unevenness(&self) -> f64 {
        let steps = self.times.windows(2).map(|pair| pair[1] - pair[0]).filter(|&t| t > 0.0);
        let wider = |(least, most): (f64, f64), t: f64| (least.min(t), most.max(t));
        let (least, most) = steps.fold((f64::INFINITY, 0.0), wider);
        most / least
    }

    /// The largest distance of a plot from the trend, in the least standard deviations of its axis.
    pub(super) fn farthest(&self) -> f64 {
        let axes = self.scale.iter().cycle();
        // nan is not larger
        self.y.iter().zip(axes).fold(0.0_f64, |most, (y, scale)| most.max(y.abs() * scale))
    }

    /// A track of N plots in D dimensions: `times` (N), not decreasing, `y` (N, D), nan where a
    /// component is missing. Slices of other lengths panic.
    ///
    /// # Errors
    /// A plot that is infinite, times that decrease, or a covariance that is none where there is a
    /// plot.
    pub fn try_new(
        dimension: usize,
        times: &'a [f64],
        y: &[f64],
        noise: Noise<'_>,
        prior: Option<Prior<'_>>,
    ) -> Result<Self> {
        require_times(times, LARGEST)?;
        let (d, n) = (dimension, times.len());
        assert_eq!(y.len(), n * d);
        let requirement = "a plot must be a finite number, or nan for none";
        require_elements("y", y, d, |y| y.is_nan() || y.abs() <= LARGEST, requirement)?;
        let mut track = Self {
            dimension,
            times,
            y: y.to_vec(),
            trend: Trend::default(),
            reference: vec![0.0; n * d],
            whitener: vec![0.0; n * d * d],
            log_determinant: 0.0,
            measured: 0,
            seen: vec![if prior.is_some() { Seen::ALL } else { Seen::default() }; d],
            scale: vec![0.0; d],
            prior: Vec::new(),
            axes: Vec::new(),
        };
        let mut last: Option<(Vec<bool>, f64)> = None;
        for k in 0..n {
            let there: Vec<bool> = track.plot(k).iter().map(|y| !y.is_nan()).collect();
            track.measured += there.iter().filter(|&&there| there).count();
            let (before, rest) = track.whitener.split_at_mut(k * d * d);
            let whitener = &mut rest[..d * d];
            let log_determinant = match (noise, &last) {
                (Noise::Same(_), Some((same, determinant))) if *same == there => {
                    whitener.copy_from_slice(&before[(k - 1) * d * d..]);
                    *determinant
                }
                (Noise::Same(matrix), _) => whiten(&[], matrix, &there, whitener)?,
                (Noise::Each(matrices), _) => {
                    whiten(&[k], &matrices[k * d * d..][..d * d], &there, whitener)?
                }
            };
            track.log_determinant += log_determinant;
            for (axis, _) in there.iter().enumerate().filter(|&(_, &there)| there) {
                track.seen[axis].add(times[k]);
                let size = track.whitener[(k * d + axis) * d + axis];
                track.scale[axis] = track.scale[axis].max(size);
            }
            last = Some((there, log_determinant));
        }
        for scale in &mut track.scale {
            *scale = if *scale > 0.0 { *scale } else { 1.0 };
        }
        track.set_trend();
        track.set_reference();
        match prior {
            Some(prior) => track.set_prior(prior)?,
            None => track.axes = track.split(),
        }
        Ok(track)
    }

    /// The axes, if there are several whose errors are independent.
    fn split(&self) -> Vec<Self> {
        let d = self.dimension;
        let mixed = |(at, h): (usize, &f64)| *h != 0.0 && at / d % d != at % d;
        if d < 2 || self.whitener.iter().enumerate().any(mixed) {
            return Vec::new();
        }
        let column = |values: &[f64], axis: usize| -> Vec<f64> {
            values.chunks_exact(d).map(|each| each[axis]).collect()
        };
        let of = |axis: usize| {
            let y = column(&self.y, axis);
            Self {
                dimension: 1,
                times: self.times,
                measured: y.iter().filter(|y| !y.is_nan()).count(),
                y,
                trend: Trend::default(),
                reference: column(&self.reference, axis),
                whitener: self.whitener.chunks_exact(d * d).map(|h| h[axis * (d + 1)]).collect(),
                // once for all of them
                log_determinant: if axis == 0 { self.log_determinant } else { 0.0 },
                seen: vec![self.seen[axis]],
                scale: vec![self.scale[axis]],
                prior: Vec::new(),
                axes: Vec::new(),
            }
        };
        (0..d).map(of).collect()
    }

    /// Takes the parabola out that is nearest to the plots. It is a motion without jerk, so what is
    /// left moves as before, but far less.
    fn set_trend(&mut self) {
        let d = self.dimension;
        let span = self.span();
        let (first, last) = (self.times.first(), self.times.last());
        let centre = first.zip(last).map_or(0.0, |(first, last)| first + 0.5 * (last - first));
        self.trend = Trend { centre, scale: 0.5 * span, coefficients: Vec::new() };
        let (mut basis, mut c, mut at) = (Basis::default(), Vec::new(), Vec::new());
        for axis in 0..d {
            let there = || (0..self.len()).filter(|&k| !self.plot(k)[axis].is_nan());
            let x: Vec<f64> = there().map(|k| self.trend.x(self.times[k])).collect();
            let least = self.scale[axis];
            let w = |k: usize| (self.whitener[(k * d + axis) * d + axis] / least).powi(2);
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
            for axis in 0..d {
                self.y[k * d + axis] -= self.trend.at(axis, self.times[k])[0];
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

    /// Follows the plots, but not those that are much less precise than others.
    fn set_reference(&mut self) {
        let (d, n) = (self.dimension, self.len());
        for axis in 0..d {
            let first = (0..n).map(|k| self.y[k * d + axis]).find(|y| !y.is_nan());
            let (mut position, mut variance) = (first.unwrap_or(0.0), f64::INFINITY);
            for k in 0..n {
                let y = self.y[k * d + axis];
                if !y.is_nan() {
                    variance *= FORGETTING;
                    let own = self.whitener[(k * d + axis) * d + axis].powi(-2);
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

    /// Instants.
    pub fn len(&self) -> usize {
        self.times.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.times.is_empty()
    }

    pub(super) fn plot(&self, k: usize) -> &[f64] {
        &self.y[k * self.dimension..][..self.dimension]
    }

    pub(super) fn reference(&self, k: usize) -> &[f64] {
        &self.reference[k * self.dimension..][..self.dimension]
    }

    pub(super) fn whitener(&self, k: usize) -> &[f64] {
        let size = self.dimension * self.dimension;
        &self.whitener[k * size..][..size]
    }

    /// Time from the first instant to the last; 1 if it is 0.
    pub(super) fn span(&self) -> f64 {
        match self.times {
            [first, .., last] if last > first => last - first,
            _ => 1.0,
        }
    }

    /// What the plots determine, in numbers.
    pub(super) fn rank(&self) -> usize {
        self.seen.iter().map(|seen| seen.count).sum()
    }
}

/// The inverse of the Cholesky factor of the covariance of what is there, and ln of its determinant.
fn whiten(place: &[usize], matrix: &[f64], there: &[bool], out: &mut [f64]) -> Result<f64> {
    whiten_as("covariance", place, matrix, there, out)
}

fn whiten_as(
    argument: &'static str,
    place: &[usize],
    matrix: &[f64],
    there: &[bool],
    out: &mut [f64],
) -> Result<f64> {
    let m = there.len();
    let at = |i: usize, j: usize| [place, &[i, j]].concat();
    let present: Vec<usize> = (0..m).filter(|&i| there[i]).collect();
    let mut factor = vec![0.0; m * m];
    let mut log_determinant = 0.0;
    out.fill(0.0);
    for &i in &present {
        for &j in &present {
            let value = matrix[i * m + j];
            let requirement = "every element must be a finite number where there is a plot";
            if !value.is_finite() {
                return Err(Error::InvalidElement {
                    argument,
                    index: at(i, j),
                    value,
                    requirement,
                });
            }
        }
        let value = matrix[i * m + i];
        if !VARIANCES.contains(&value) {
            let requirement = "variances must be positive, between 1e-140 and 1e140";
            return Err(Error::InvalidElement { argument, index: at(i, i), value, requirement });
        }
    }
    for &i in &present {
        for &j in present.iter().take_while(|&&j| j <= i) {
            let (lower, upper) = (matrix[i * m + j], matrix[j * m + i]);
            let scale = (matrix[i * m + i] * matrix[j * m + j]).sqrt();
            if (upper - lower).abs() > ASYMMETRY * scale {
                return Err(Error::NotSymmetric { argument, index: at(j, i), upper, lower });
            }
            let mut sum = upper + 0.5 * (lower - upper);
            for &k in present.iter().take_while(|&&k| k < j) {
                sum -= factor[i * m + k] * factor[j * m + k];
            }
            if i != j {
                factor[i * m + j] = sum / factor[j * m + j];
                continue;
            }
            let share = sum / matrix[i * m + i];
            let index = place.to_vec();
            if share <= -REGULAR {
                return Err(Error::Indefinite { argument, index });
            }
            if share <= REGULAR {
                return Err(Error::Singular { argument, index });
            }
            factor[i * m + i] = sum.sqrt();
            log_determinant += sum.ln();
        }
    }
    // N = L^-1, row by row
    for &i in &present {
        let reciprocal = 1.0 / factor[i * m + i];
        for &j in present.iter().take_while(|&&j| j < i) {
            let between = present.iter().filter(|&&k| j <= k && k < i);
            let sum: f64 = between.map(|&k| factor[i * m + k] * out[k * m + j]).sum();
            out[i * m + j] = -sum * reciprocal;
        }
        out[i * m + i] = reciprocal;
    }
    Ok(log_determinant)
}
