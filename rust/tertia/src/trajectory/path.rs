//! Smoothed positions over time: by the quick smoother where it is accurate, else by the general one.

pub(super) mod failure;
pub(super) mod series;

use crate::base::error::Error;
use crate::base::interrupt::poll;
use crate::base::small::{Matrix, Vector};
use crate::smoothing::adjoint::{self, Adjoint};
use crate::smoothing::{
    Family, Noise, Part, ProcessNoise, ProcessNoiseFit, Smoothed, Summary, Track, Workspace,
    add_unresolved, likeliest, likeliest_of, likeliest_part, likelihood, relative_error, smooth,
};
use failure::Failure;
use nalgebra::DMatrix;

/// Ratio of a variance to the variance that remains with later instants, beyond which the quick smoother is
/// not accurate enough: up to this ratio, variances are correct to 1e-4.
const LOSS: f64 = 1e7;

/// Gain of the log-likelihood from which the vertical motion has its own intensity, and from which another round
/// of fits follows; the largest number of rounds.
const CLEARLY: f64 = 2.0;
const AGAIN: f64 = 0.1;
const ROUNDS: usize = 3;

/// Positions with their covariances, (N, D) and (N, D, D); nan where unknown.
#[derive(Clone, Debug)]
pub(super) struct Plots {
    pub position: Vec<f64>,
    pub covariance: Vec<f64>,
}

impl Plots {
    pub fn none(n: usize, d: usize) -> Self {
        Self { position: vec![f64::NAN; n * d], covariance: vec![f64::NAN; n * d * d] }
    }

    /// Sets the position of an instant to a step from `from`, with its covariance.
    pub fn put<const D: usize>(
        &mut self,
        t: usize,
        from: &[f64],
        step: &Vector<D>,
        covariance: &Matrix<D>,
    ) {
        for i in 0..D {
            self.position[t * D + i] = from[i] + step[i];
            for j in 0..D {
                self.covariance[(t * D + i) * D + j] = covariance[i][j];
            }
        }
    }

    pub fn is_known(&self, t: usize, d: usize) -> bool {
        self.covariance[t * d * d..][..d * d].iter().all(|v| v.is_finite())
    }

    pub fn count(&self, d: usize) -> usize {
        (0..self.position.len() / d).filter(|&t| self.is_known(t, d)).count()
    }

    /// Sum of half the ln of the determinants of the known covariances.
    pub fn ln_spread(&self, d: usize) -> f64 {
        let known =
            self.covariance.chunks_exact(d * d).filter(|own| own.iter().all(|v| v.is_finite()));
        let ln = |own: &[f64]| DMatrix::from_row_slice(d, d, own).determinant().ln();
        0.5 * known.map(ln).sum::<f64>()
    }

    pub fn track<'a>(&self, time: &'a [f64], d: usize) -> Result<Track<'a>, Failure> {
        let noise = Noise::Each(&self.covariance);
        Track::try_new(d, time, &self.position, noise, None).map_err(|error| match error {
            // the others are about positions and covariances, which the caller does not know
            Error::InvalidElement { argument: "time", .. }
            | Error::InvalidMeasurement { argument: "time", .. } => Failure::Error(error),
            _ => Failure::Unbounded,
        })
    }
}

/// States of all instants.
#[derive(Clone, Debug)]
pub(super) struct Path {
    /// (N, 3D)
    pub mean: Vec<f64>,
    /// Covariances (N, R, R) of the first R components.
    pub covariance: Vec<f64>,
    pub fit: ProcessNoiseFit,
    pub summary: Summary,
}

impl Path {
    pub fn position<const D: usize>(&self, t: usize) -> &[f64] {
        &self.mean[3 * D * t..][..D]
    }
}

/// Buffers of the smoothers.
#[derive(Debug, Default)]
pub(super) struct Smoother<const D: usize, const N: usize> {
    /// Whether the last axis may have a motion of its own.
    pub separates: bool,
    quick: Adjoint<D, N>,
    workspace: Workspace,
    whole: Vec<f64>,
    innovation: Vec<f64>,
}

impl<const D: usize, const N: usize> Smoother<D, N> {
    /// Returns the likeliest motion; the search starts near another motion if one is given.
    pub fn fit(&mut self, track: &Track<'_>, near: Option<ProcessNoise>) -> ProcessNoiseFit {
        let separates = self.separates;
        let last_axis = near.map_or(1.0, |motion| motion.last_axis);
        let value = &mut |motion| self.likelihood(track, motion);
        let mut fit =
            likeliest(track, near, &mut |motion| value(ProcessNoise { last_axis, ..motion }));
        if fit == ProcessNoiseFit::UNDETERMINED {
            return fit;
        }
        fit.motion.last_axis = last_axis;
        if !separates {
            return fit;
        }
        let (mut motion, mut top) = (fit.motion, value(fit.motion));
        let least = if last_axis == 1.0 { top + CLEARLY } else { top };
        for _ in 0..ROUNDS {
            let before = top;
            for part in [Part::Last, Part::Others] {
                if let Some(found) =
                    likeliest_part(track, motion, part, value).filter(|f| f.1 > top)
                {
                    (motion, top) = found;
                }
            }
            if top < least || top - before < AGAIN {
                break;
            }
        }
        if top > least { ProcessNoiseFit { motion, relative_error: f64::NAN } } else { fit }
    }

    /// Returns the likeliest motion of another family with its error, if its log-likelihood is at least `least`.
    pub fn of(
        &mut self,
        family: Family,
        track: &Track<'_>,
        motion: ProcessNoise,
        least: f64,
    ) -> Option<ProcessNoiseFit> {
        let last_axis = motion.last_axis;
        let value = &mut |motion| self.likelihood(track, ProcessNoise { last_axis, ..motion });
        let (mut fit, top) = likeliest_of(family, track, motion, least, value)?;
        fit.motion.last_axis = last_axis;
        (top >= least).then(|| self.with_error(track, fit))
    }

    fn likelihood(&mut self, track: &Track<'_>, motion: ProcessNoise) -> f64 {
        let Self { quick, workspace, .. } = self;
        let summary = quick.likelihood(track, motion);
        summary.unwrap_or_else(|| likelihood(track, motion, workspace)).log_likelihood
    }

    /// Returns the fit with the error of the logarithm of the intensity, which is computed if it is missing.
    pub fn with_error(&mut self, track: &Track<'_>, fit: ProcessNoiseFit) -> ProcessNoiseFit {
        if !fit.relative_error.is_nan() {
            return fit;
        }
        let relative_error = self.error_of(track, fit.motion, Part::of(fit.motion));
        ProcessNoiseFit { relative_error, ..fit }
    }

    /// Returns the error of the logarithm of the intensity of a part of the axes.
    pub fn error_of(&mut self, track: &Track<'_>, motion: ProcessNoise, part: Part) -> f64 {
        let family = Family::that_has(motion);
        let of = family.part(part, track, motion);
        let mut value = |log: f64| self.likelihood(track, of(log));
        let log = family.log_of(part, motion);
        let top = value(log);
        relative_error(log, top, &mut value)
    }

    /// Returns the states, with covariances of the first `components` components.
    pub fn smooth(&mut self, track: &Track<'_>, fit: ProcessNoiseFit, components: usize) -> Path {
        poll();
        let n = track.len();
        let mut mean = vec![f64::NAN; n * N];
        let mut covariance = vec![0.0; n * components * components];
        let mut out = adjoint::Smoothed {
            mean: &mut mean,
            covariance: &mut covariance,
            components,
            innovation: &mut [],
            loss: LOSS,
        };
        if let Some(summary) = self.quick.smooth(track, fit.motion, &mut out) {
            add_unresolved(track, fit.motion, components, &mut covariance);
            return Path { mean, covariance, fit, summary };
        }
        self.whole.resize(n * N * N, 0.0);
        self.innovation.resize(n * D, 0.0);
        let mut out = Smoothed {
            mean: &mut mean,
            covariance: &mut self.whole,
            innovation: &mut self.innovation,
        };
        let summary = smooth(track, fit.motion, &mut self.workspace, &mut out);
        for (whole, own) in self
            .whole
            .chunks_exact(N * N)
            .zip(covariance.chunks_exact_mut((components * components).max(1)))
        {
            for (i, row) in own.chunks_exact_mut(components).enumerate() {
                row.copy_from_slice(&whole[i * N..][..components]);
            }
        }
        Path { mean, covariance, fit, summary }
    }

    /// Returns the states with all covariances and innovations, by the smoother that is accurate for any
    /// track.
    pub fn finish(&mut self, track: &Track<'_>, fit: ProcessNoiseFit) -> (Path, Vec<f64>) {
        let n = track.len();
        let (mut mean, mut covariance) = (vec![0.0; n * N], vec![0.0; n * N * N]);
        let mut innovation = vec![0.0; n * D];
        let mut out =
            Smoothed { mean: &mut mean, covariance: &mut covariance, innovation: &mut innovation };
        let summary = smooth(track, fit.motion, &mut self.workspace, &mut out);
        (Path { mean, covariance, fit, summary }, innovation)
    }
}
