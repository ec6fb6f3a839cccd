//! Plots of several sensors in turn, told apart by the shapes of their covariances.
//!
//! The systematic errors of two sensors differ. One process of correlated noise cannot describe them: a vector
//! that is constant in whitened axes is a different error for each sensor, so that it can explain what
//! contradicts, and takes the path with it. For such plots, noise is white in the models, and lasting errors
//! are added to the covariances of the path: their variance is what the residuals of plots of one sensor have
//! in common over the time that the smoother averages.

use super::model::Faults;
use super::results::Smoothed;
use super::track::Track;
use crate::base::angle::median;
use crate::base::small::{Factor, Matrix, add, dot, rotated, symmetrise};

/// Largest difference between the shapes of the covariances of one sensor, as the divergence between two
/// normal distributions of these covariances.
const ALIKE: f64 = 0.25;
/// Largest number of sensors; if there are more shapes, these change from plot to plot for other reasons.
const MOST: usize = 16;
/// Least share of the plots that follow one of another sensor, and least number of them.
const TURNS: f64 = 0.125;
const LEAST_TURNS: f64 = 4.0;
/// Least number of plots of each sensor of which residuals are compared.
const LEAST_PLOTS: f64 = 5.0;
/// Least share of the variance over the time that is averaged which remains over the whole track if errors do
/// not change.
const CONSTANT: f64 = 0.5;
/// Increase of a variance that is estimated from one number: with two numbers, an ellipse for 95 % contains
/// 90 %, with four 94 %.
const FEW: f64 = 4.0;

/// Covariance of a plot and its inverse, both of determinant 1.
#[derive(Clone, Copy)]
struct Shape<const D: usize> {
    covariance: Matrix<D>,
    information: Matrix<D>,
}

impl<const D: usize> Shape<D> {
    /// Returns none if a component is missing.
    fn of(track: &Track<'_>, k: usize) -> Option<Self> {
        let information = information::<D>(track, k)?;
        let factor = Factor::try_new(&information, 0.0)?;
        let scale = (factor.ln_determinant() / D as f64).exp();
        let covariance = factor.inverse().map(|row| row.map(|c| c * scale));
        Some(Self { covariance, information: information.map(|row| row.map(|c| c / scale)) })
    }

    /// Jeffreys' divergence.
    fn divergence(&self, other: &Self) -> f64 {
        let trace = |a: &Matrix<D>, b: &Matrix<D>| -> f64 {
            (0..D).flat_map(|i| (0..D).map(move |j| (i, j))).map(|(i, j)| a[i][j] * b[i][j]).sum()
        };
        let both = trace(&self.covariance, &other.information)
            + trace(&other.covariance, &self.information);
        0.5 * both - D as f64
    }
}

/// Inverse of the covariance of the position of a plot; none if a component is missing.
fn information<const D: usize>(track: &Track<'_>, k: usize) -> Option<Matrix<D>> {
    let whitener = whitener::<D>(track, k);
    let is_complete = (0..D).all(|i| whitener[i][i] > 0.0 && !track.plot(k)[i].is_nan());
    is_complete.then(|| {
        let of = |i: usize, j: usize| (0..D).map(|r| whitener[r][i] * whitener[r][j]).sum();
        std::array::from_fn(|i| std::array::from_fn(|j| of(i, j)))
    })
}

fn whitener<const D: usize>(track: &Track<'_>, k: usize) -> Matrix<D> {
    let (whitener, m) = (track.whitener(k), track.numbers);
    std::array::from_fn(|i| std::array::from_fn(|j| whitener[i * m + j]))
}

/// Plots of several sensors in turn.
pub(super) struct Interleaved {
    /// Sensor of each plot; none where a component is missing.
    sensor: Vec<Option<usize>>,
    /// Number of plots of each sensor.
    counts: Vec<usize>,
}

impl Interleaved {
    /// Returns none if the plots may be those of one sensor. Cost O(N).
    pub fn find(track: &Track<'_>) -> Option<Self> {
        match track.dimension {
            2 => Self::by_shape::<2>(track),
            3 => Self::by_shape::<3>(track),
            _ => None,
        }
    }

    /// Adds the variance of lasting errors to the covariances of the positions.
    pub fn add_lasting_errors(&self, track: &Track<'_>, faults: &Faults, out: &mut Smoothed<'_>) {
        match track.dimension {
            2 => self.add::<2>(track, faults, out),
            3 => self.add::<3>(track, faults, out),
            _ => (),
        }
    }

    fn by_shape<const D: usize>(track: &Track<'_>) -> Option<Self> {
        let mut sensors: Vec<(Shape<D>, usize)> = Vec::new();
        let (mut last, mut turns) = (None, 0);
        let mut sensor = vec![None; track.len()];
        for (k, from) in sensor.iter_mut().enumerate() {
            let Some(shape) = Shape::of(track, k) else { continue };
            let divergences = sensors.iter().map(|(own, _)| own.divergence(&shape)).enumerate();
            let nearest = divergences.min_by(|a, b| a.1.total_cmp(&b.1));
            let own = match nearest {
                Some((own, divergence)) if divergence < ALIKE => {
                    // a new shape may be that of the same sensor later; only one that returns counts
                    turns += usize::from(last != Some(own));
                    sensors[own] = (shape, sensors[own].1 + 1);
                    own
                }
                _ if sensors.len() == MOST => return None,
                _ => {
                    sensors.push((shape, 1));
                    sensors.len() - 1
                }
            };
            (*from, last) = (Some(own), Some(own));
        }
        let least = (TURNS * track.len() as f64).max(LEAST_TURNS);
        let counts = sensors.into_iter().map(|(_, count)| count).collect();
        (turns as f64 >= least).then_some(Self { sensor, counts })
    }

    fn add<const D: usize>(&self, track: &Track<'_>, faults: &Faults, out: &mut Smoothed<'_>) {
        let size = 3 * D;
        let residuals = self.residuals::<D>(track, faults, out.mean);
        let plots = averaged::<D>(track, out.covariance).max(LEAST_PLOTS * self.number());
        let reach = plots * track.span() / track.len() as f64;
        let variance = self.lasting_variance(track, &residuals, reach);
        let mut last = vec![None; self.counts.len()];
        // before its first plot, a sensor counts as at this plot
        let plots = (0..track.len()).rev().chain(0..track.len());
        for (at, k) in plots.enumerate() {
            if let Some(sensor) = self.sensor[k] {
                last[sensor] = information::<D>(track, k);
            }
            let Some(errors) = self.errors(&last).filter(|_| at >= track.len()) else { continue };
            let own = &mut out.covariance[k * size * size..][..size * size];
            for (i, j) in (0..D * D).map(|place| (place / D, place % D)) {
                own[i * size + j] += variance * errors[i][j];
            }
        }
    }

    /// Variance of the lasting errors of a sensor, relative to that of its plots, for an interval of 90 to 95 %:
    /// few sensors whose errors do not change show little of it.
    fn lasting_variance<const D: usize>(
        &self,
        track: &Track<'_>,
        residuals: &[Option<[f64; D]>],
        reach: f64,
    ) -> f64 {
        let number = self.number();
        let near = self.variance(track, residuals, reach);
        let all = self.variance(track, residuals, f64::INFINITY);
        let spans = if all > CONSTANT * near { 1.0 } else { track.span() / reach };
        let seen = D as f64 * (number - 1.0) * spans.max(1.0);
        near * number / (number - 1.0) * (1.0 + FEW / seen)
    }

    /// Effective number of sensors.
    fn number(&self) -> f64 {
        let sum = self.counts.iter().sum::<usize>() as f64;
        sum * sum / self.counts.iter().map(|&n| (n as f64).powi(2)).sum::<f64>()
    }

    /// Covariance of the weighted mean of the sensors if each has one error, of the covariance of its plots.
    fn errors<const D: usize>(&self, information: &[Option<Matrix<D>>]) -> Option<Matrix<D>> {
        let (mut total, mut errors) = ([[0.0; D]; D], [[0.0; D]; D]);
        for (own, &count) in information.iter().zip(&self.counts) {
            let Some(own) = own else { continue };
            let count = count as f64;
            add(&mut total, &own.map(|row| row.map(|c| c * count)));
            add(&mut errors, &own.map(|row| row.map(|c| c * count * count)));
        }
        let inverse = Factor::try_new(&total, 0.0)?.inverse();
        let product = |a: &Matrix<D>, b: &Matrix<D>| -> Matrix<D> {
            let of = |i: usize, j: usize| (0..D).map(|r| a[i][r] * b[r][j]).sum();
            std::array::from_fn(|i| std::array::from_fn(|j| of(i, j)))
        };
        let mut covariance = product(&product(&inverse, &errors), &inverse);
        symmetrise(&mut covariance);
        Some(covariance)
    }

    /// Whitened residuals; none where a plot is incomplete or left out.
    fn residuals<const D: usize>(
        &self,
        track: &Track<'_>,
        faults: &Faults,
        mean: &[f64],
    ) -> Vec<Option<[f64; D]>> {
        let parts = track.parts().count();
        let of = |k: usize| {
            self.sensor[k].filter(|_| !faults.gross[k * parts])?;
            let mut trend = vec![0.0; 3 * D];
            track.add_trend(k, &mut trend);
            let plot = track.plot(k);
            let away = std::array::from_fn(|i| plot[i] - (mean[k * 3 * D + i] - trend[i]));
            Some(rotated(&whitener::<D>(track, k), &away))
        };
        (0..track.len()).map(of).collect()
    }

    /// Mean product of two residuals of the same sensor within a time, at least 0.
    fn variance<const D: usize>(
        &self,
        track: &Track<'_>,
        residuals: &[Option<[f64; D]>],
        reach: f64,
    ) -> f64 {
        let (mut products, mut pairs) = (0.0, 0);
        for sensor in 0..self.counts.len() {
            let own = (0..track.len()).filter(|&k| self.sensor[k] == Some(sensor));
            let own: Vec<(f64, [f64; D])> =
                own.filter_map(|k| Some((track.times[k], residuals[k]?))).collect();
            let (mut sum, mut first) = ([0.0; D], 0);
            for (at, (time, value)) in own.iter().enumerate() {
                while time - own[first].0 > reach {
                    (0..D).for_each(|i| sum[i] -= own[first].1[i]);
                    first += 1;
                }
                products += dot(&sum, value);
                pairs += D * (at - first);
                (0..D).for_each(|i| sum[i] += value[i]);
            }
        }
        if pairs > 0 { (products / pairs as f64).max(0.0) } else { 0.0 }
    }
}

/// Number of plots that the smoother averages: the median ratio of the variance of a plot to that of the
/// position.
fn averaged<const D: usize>(track: &Track<'_>, covariance: &[f64]) -> f64 {
    let size = 3 * D;
    let ratio = |k: usize| {
        let information = information::<D>(track, k)?;
        let own = &covariance[k * size * size..];
        let of = |i: usize| (0..D).map(|j| information[i][j] * own[i * size + j]).sum::<f64>();
        Some(D as f64 / (0..D).map(of).sum::<f64>())
    };
    median(&mut (0..track.len()).filter_map(ratio).collect::<Vec<f64>>())
}
