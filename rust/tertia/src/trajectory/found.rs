//! Positions along time that fit all measurements at once, without what contradicts the others.
//!
//! What an instant measured is linearised about the path, also where it does not determine a
//! position: one bearing is a line, to which the path is drawn.

use super::failure::Failure;
use super::fixes::Fixes;
use super::instant::{Instant, LEAST_ANCHOR};
use super::measured::{Measured, Record};
use super::path::{Path, Plots, Smoother};
use crate::base::small::{Factor, Matrix, Vector};
use crate::sensors::{Kind, Row};
use crate::smoothing::{ProcessNoise, ProcessNoiseFit};
use std::ops::Range;
use std::rc::Rc;

/// Variance of a direction that an instant does not determine, over that of the path: from which it
/// is none, and with which it stays where it is.
const UNDETERMINED: f64 = 1e4;
const ANCHOR: f64 = 1e6;

/// What has been found so far.
#[derive(Clone, Debug)]
pub(super) struct Found<const D: usize, const N: usize> {
    pub measured: Rc<Measured<D>>,
    /// Probabilities that measurements are no outliers, (N, 5, K).
    pub trust: Vec<f64>,
    pub fixes: Fixes,
    pub plots: Plots,
    pub path: Path,
    /// Information that holds the position where the instant does not determine it (N).
    pub anchor: Vec<f64>,
    /// Standard deviation of the noise over what is stated, at least 1.
    pub scale: f64,
}

/// How a path is smoothed: the motion, if it is given, and buffers.
pub(super) struct Setting<'a, const D: usize, const N: usize> {
    pub record: &'a Record<'a>,
    pub motion: Option<ProcessNoise>,
    pub smoother: Smoother<D, N>,
}

/// A motion that is given.
pub(super) fn known(motion: ProcessNoise) -> ProcessNoiseFit {
    ProcessNoiseFit { motion, relative_error: 0.0 }
}

impl<const D: usize, const N: usize> Setting<'_, D, N> {
    /// Smooths positions; without a motion the likeliest one is taken, near that of before.
    fn smoothed(
        &mut self,
        plots: &Plots,
        motion: Option<ProcessNoise>,
        near: Option<ProcessNoise>,
    ) -> Result<Path, Failure> {
        let track = plots.track(self.record.time, D)?;
        let fit = match motion {
            Some(motion) => known(motion),
            None => self.smoother.fit(&track, near),
        };
        Ok(self.smoother.smooth(&track, fit, D))
    }
}

impl<const D: usize, const N: usize> Found<D, N> {
    /// Locates every instant, by the measurements nearby where its own are too few, and smooths.
    pub fn first(
        setting: &mut Setting<'_, D, N>,
        measured: &Rc<Measured<D>>,
    ) -> Result<Self, Failure> {
        let record = setting.record;
        let trust = vec![1.0; measured.values.len()];
        let (fixes, start) = Fixes::first(record, measured)?;
        let plots = plots_of(&start, D);
        let path = setting.smoothed(&plots, setting.motion, None)?;
        let measured = Rc::clone(measured);
        let anchor = vec![0.0; record.len()];
        let mut found = Self { measured, trust, fixes, plots, path, anchor, scale: 1.0 };
        if !record.robust {
            for _ in 0..2 {
                found.relinearise(setting, Some(found.path.fit.motion), 1.0)?;
            }
        }
        Ok(found)
    }

    /// Linearises what was measured about the path, with a noise so many times as large as stated, and
    /// smooths.
    pub fn relinearise(
        &mut self,
        setting: &mut Setting<'_, D, N>,
        motion: Option<ProcessNoise>,
        scale: f64,
    ) -> Result<(), Failure> {
        if self.plots.count(D) < 2 {
            // a single position is its own path
            return Ok(());
        }
        let near = Some(self.path.fit.motion);
        let mut plots = Plots::none(setting.record.len(), D);
        for t in 0..setting.record.len() {
            let Some((inverse, step)) = self.step(setting.record, t, scale) else { continue };
            let p = self.path.position::<D>(t);
            for i in 0..D {
                plots.position[t * D + i] = p[i] + step[i];
                for j in 0..D {
                    plots.covariance[(t * D + i) * D + j] = inverse[i][j];
                }
            }
        }
        self.path = setting.smoothed(&plots, motion, near)?;
        self.plots = plots;
        Ok(())
    }

    /// The covariance of an instant's position about the path, and the way to it.
    fn step(
        &mut self,
        record: &Record<'_>,
        t: usize,
        scale: f64,
    ) -> Option<(Matrix<D>, Vector<D>)> {
        let p = self.path.position::<D>(t);
        let spread: f64 = self.path.covariance[t * D * D..][..D * D].iter().step_by(D + 1).sum();
        if p.iter().any(|v| v.is_nan()) || !spread.is_finite() {
            return None;
        }
        let (mut normal, mut right) = self.information(record, t);
        normal.iter_mut().flatten().chain(&mut right).for_each(|v| *v /= scale * scale);
        let largest: f64 = (0..D).map(|i| normal[i][i]).sum();
        if largest == 0.0 {
            return None;
        }
        if let Some(factor) = Factor::try_new(&normal, 0.0) {
            let inverse = factor.inverse();
            let widest: f64 = (0..D).map(|i| inverse[i][i]).sum();
            if widest < UNDETERMINED * spread && widest * largest < 1.0 / LEAST_ANCHOR {
                self.anchor[t] = 0.0;
                return Some((inverse, factor.solve(&right)));
            }
        }
        let anchor = (1.0 / (ANCHOR * spread)).max(LEAST_ANCHOR * largest);
        self.anchor[t] = anchor * scale * scale;
        (0..D).for_each(|i| normal[i][i] += anchor);
        let factor = Factor::try_new(&normal, 0.0)?;
        Some((factor.inverse(), factor.solve(&right)))
    }

    /// What an instant says of its position, and of the way to it from the path.
    fn information(&self, record: &Record<'_>, t: usize) -> (Matrix<D>, Vector<D>) {
        let width = record.width();
        let (mut normal, mut right) = ([[0.0; D]; D], [0.0; D]);
        let common = record.common_variance();
        // the error that range differences share is one unknown more: its column, row and right
        let (mut column, mut corner, mut rest) = ([0.0; D], 1.0, 0.0);
        let trust = |m: usize| self.trust[t * width + self.measured.column[m]];
        let emission = self.measured.emission(t, self.path.position::<D>(t), trust);
        for (m, row) in self.measured.rows(t, self.path.position::<D>(t)) {
            let weight = trust(m);
            if weight == 0.0 {
                continue;
            }
            let one = self.measured.one(m);
            let Some(mut row) = emission.removed_from(one, row) else { continue };
            if one.kind == Kind::RangeDifference && common > 0.0 {
                let own = (one.precision.powi(-2) - common).sqrt();
                row = row.scaled(1.0 / (own * one.precision));
                // in standard deviations
                let share = weight * common.sqrt() / own;
                corner += share * common.sqrt() / own;
                rest += share * row.residual;
                for i in 0..D {
                    column[i] += share * row.gradient[i];
                }
            }
            for i in 0..D {
                right[i] += weight * row.gradient[i] * row.residual;
                for j in 0..D {
                    normal[i][j] += weight * row.gradient[i] * row.gradient[j];
                }
            }
        }
        for i in 0..D {
            right[i] -= column[i] * rest / corner;
            for j in 0..D {
                normal[i][j] -= column[i] * column[j] / corner;
            }
        }
        (normal, right)
    }

    /// The measurements of an instant about the path, arrivals without the emission that those that are
    /// trusted tell, and the variance of that in the stated one of each.
    pub fn rows(&self, t: usize) -> impl Iterator<Item = (usize, Row<D>, f64)> {
        let (p, width) = (self.path.position::<D>(t), self.measured.width());
        let trust = |m: usize| self.trust[t * width + self.measured.column[m]];
        let emission = self.measured.emission_for_all(t, p, trust);
        self.measured.rows(t, p).filter_map(move |(m, row)| {
            let one = self.measured.one(m);
            Some((m, emission.removed_from(one, row)?, emission.variance(one)))
        })
    }

    /// An instant with what biases do to it, about the path.
    pub fn instant(&self, t: usize, weight: &[f64], columns: &[usize]) -> Instant<D> {
        let p = self.path.position::<D>(t);
        Instant::new(&self.measured, t, p, weight, columns, self.anchor[t])
    }

    /// Several instants as one, with what biases do to them.
    pub fn together(&self, own: Range<usize>, weight: &[f64], columns: &[usize]) -> Instant<D> {
        let at = |t: usize| (t, std::array::from_fn(|i| self.path.position::<D>(t)[i]));
        Instant::together(&self.measured, own.map(at), weight, columns)
    }

    /// Whether the others contradict a measurement more than not.
    pub fn is_outlier(&self, at: usize) -> bool {
        self.trust[at] < 0.5
    }
}

/// The positions of the single instants.
fn plots_of(fixes: &Fixes, d: usize) -> Plots {
    let covariance = fixes.covariance.clone();
    let mut plots = Plots { position: fixes.position.clone(), covariance };
    for t in 0..fixes.fixes.len() {
        if !plots.is_known(t, d) {
            plots.position[t * d..][..d].fill(f64::NAN);
        }
    }
    plots
}
