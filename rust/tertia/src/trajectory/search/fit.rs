//! A path that fits all measurements at once, except those that contradict the others.
//!
//! The measurements of each instant are linearised about the path, even if they do not determine a position:
//! a single bearing is a line towards which the path is drawn.

use crate::base::small::{Factor, Matrix, Vector, add_outer, rotated};
use crate::sensors::Row;
use crate::smoothing::{ProcessNoise, ProcessNoiseFit};
use crate::trajectory::instants::fixes::Fixes;
use crate::trajectory::instants::instant::{Instant, LEAST_ANCHOR, Seen};
use crate::trajectory::measured::{Measured, Place, Record};
use crate::trajectory::mirror::{Mirror, Sides};
use crate::trajectory::path::failure::Failure;
use crate::trajectory::path::{Path, Plots, Smoother};
use std::ops::Range;
use std::rc::Rc;

/// Ratio of the variance of an instant's position to that of the path from which a direction counts as
/// undetermined, and the ratio with which an undetermined direction is tied to the path.
const UNDETERMINED: f64 = 1e4;
const ANCHOR: f64 = 1e6;

/// Factor of the variance that the doubt about outliers adds.
const DOUBT: f64 = 2.0;

/// State of the reconstruction.
#[derive(Clone, Debug)]
pub(in crate::trajectory) struct Found<const D: usize, const N: usize> {
    pub measured: Rc<Measured<D>>,
    /// Probabilities that measurements are not outliers, (N, 5, K).
    pub trust: Vec<f64>,
    pub fixes: Fixes,
    pub plots: Plots,
    pub path: Path,
    /// Information that ties the position to the path where the instant does not determine it (N).
    pub anchor: Vec<f64>,
    /// Side of the plane of the stations on which the path is; none if the stations are not in a plane.
    pub sides: Option<Sides<D>>,
    /// Errors of the clocks, besides the given ones, that measurements are corrected for (K); none: 0.
    pub clocks: Vec<f64>,
    /// Standard deviation of the noise relative to the stated one, at least 1.
    pub scale: f64,
    /// Whether a step was too long for its derivatives: the path was then far from the target.
    pub was_far: bool,
    /// Whether the path is the final one: its covariance includes the doubt about which measurements are
    /// outliers.
    pub is_last: bool,
}

/// How a path is smoothed: the motion if it is given, and buffers.
pub(in crate::trajectory) struct Setting<'a, const D: usize, const N: usize> {
    pub record: &'a Record<'a>,
    pub motion: Option<ProcessNoise>,
    pub smoother: Smoother<D, N>,
}

/// Returns a motion that is given as a fit without error.
pub(in crate::trajectory) fn known(motion: ProcessNoise) -> ProcessNoiseFit {
    ProcessNoiseFit { motion, relative_error: 0.0 }
}

impl<const D: usize, const N: usize> Setting<'_, D, N> {
    /// Smooths positions; if no motion is given, the likeliest one is searched, starting near the previous
    /// one.
    pub fn smoothed(
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
    /// Locates every instant, with the help of neighbouring measurements if its own are too few, and smooths.
    pub fn first(
        setting: &mut Setting<'_, D, N>,
        measured: &Rc<Measured<D>>,
        mirror: Option<Mirror<D>>,
    ) -> Result<Self, Failure> {
        let record = setting.record;
        let trust = vec![1.0; measured.values.len()];
        let (fixes, start) = Fixes::first(record, measured, mirror.as_ref())?;
        let sides = mirror.map(|mirror| Sides::new(mirror, record.len()));
        let plots = plots_of(&start, D);
        let path = setting.smoothed(&plots, setting.motion, None)?;
        let measured = Rc::clone(measured);
        let anchor = vec![0.0; record.len()];
        let (clocks, scale) = (Vec::new(), 1.0);
        let (was_far, is_last) = (false, false);
        let mut found = Self {
            measured,
            trust,
            fixes,
            plots,
            path,
            anchor,
            sides,
            clocks,
            scale,
            was_far,
            is_last,
        };
        found.stay_beside();
        if !record.robust {
            for _ in 0..2 {
                found.relinearise(setting, Some(found.path.fit.motion), 1.0)?;
            }
        }
        Ok(found)
    }

    /// Linearises the measurements about the path, with a noise of `scale` times the stated one, and smooths.
    /// Returns whether the step was too long for the derivatives at some instants, and was shortened.
    pub fn relinearise(
        &mut self,
        setting: &mut Setting<'_, D, N>,
        motion: Option<ProcessNoise>,
        scale: f64,
    ) -> Result<bool, Failure> {
        let whole = self.linearised(setting, motion, scale)?;
        let is_shortened;
        (self.plots, self.path, is_shortened) = self.damped(setting, motion, scale, whole)?;
        self.was_far |= is_shortened;
        self.stay_beside();
        Ok(is_shortened)
    }

    /// Returns the measurements linearised about the path, as positions, and the path through these.
    pub fn linearised(
        &mut self,
        setting: &mut Setting<'_, D, N>,
        motion: Option<ProcessNoise>,
        scale: f64,
    ) -> Result<(Plots, Path), Failure> {
        if self.plots.count(D) < 2 {
            // a single position is the whole path
            return Ok((self.plots.clone(), self.path.clone()));
        }
        let near = Some(self.path.fit.motion);
        let mut plots = Plots::none(setting.record.len(), D);
        for t in 0..setting.record.len() {
            let Some((inverse, step)) = self.step(setting.record, t, scale) else { continue };
            plots.put(t, self.path.position::<D>(t), &step, &inverse);
        }
        let path = setting.smoothed(&plots, motion, near)?;
        Ok((plots, path))
    }

    /// Updates the uncertainty of the distance from the mirror, and reflects positions that are on the wrong
    /// side.
    pub fn stay_beside(&mut self) {
        let Some(sides) = &mut self.sides else { return };
        sides.learn(&self.path.covariance);
        for (t, state) in self.path.mean.chunks_exact_mut(N).enumerate() {
            let position = sides.beside(t, &state[..D]);
            state[..D].copy_from_slice(&position);
        }
    }

    /// Sets whether the path has settled; see [`Sides::is_settled`].
    pub fn settle(&mut self, is_settled: bool) {
        if let Some(sides) = &mut self.sides {
            sides.is_settled = is_settled;
        }
    }

    /// Returns the position of the path, and the point at which derivatives are taken.
    pub fn place(&self, t: usize) -> Place<D> {
        let p = self.path.position::<D>(t);
        self.sides.as_ref().map_or_else(|| Place::at(p), |sides| sides.place(t, p))
    }

    /// Returns the covariance of an instant's position and the step to it from the path.
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
                let step = factor.solve(&right);
                let doubted = if self.is_last { self.doubted(t, inverse) } else { inverse };
                return Some((doubted, step));
            }
        }
        let anchor = (1.0 / (ANCHOR * spread)).max(LEAST_ANCHOR * largest);
        self.anchor[t] = anchor * scale * scale;
        (0..D).for_each(|i| normal[i][i] += anchor);
        let factor = Factor::try_new(&normal, 0.0)?;
        Some((factor.inverse(), factor.solve(&right)))
    }

    /// Returns the covariance of an instant's position with the doubt about which measurements are outliers.
    /// A measurement that is an outlier with probability q and shifts the position by d adds
    /// `q (1 − q) d d'`, twice because q is itself estimated.
    fn doubted(&self, t: usize, inverse: Matrix<D>) -> Matrix<D> {
        let width = self.measured.width;
        let mut whole = inverse;
        for (m, row, _) in self.rows(t) {
            let trust = self.trust[t * width + self.measured.column[m]];
            let pull = row.residual / (self.scale * self.scale);
            let size = DOUBT * trust * (1.0 - trust) * pull * pull;
            if size > 0.0 {
                let shift = rotated(&inverse, &row.gradient);
                add_outer(&mut whole, size, &shift);
            }
        }
        whole
    }

    /// Returns the information of an instant about its position, and the right-hand side for the step from
    /// the path.
    pub fn information(&self, record: &Record<'_>, t: usize) -> (Matrix<D>, Vector<D>) {
        let place = self.place(t);
        let Some(sides) = &self.sides else { return self.summed(record, t, place) };
        if sides.is_settled {
            let (normal, mut right) = self.summed(record, t, place);
            sides.lower(t, &place.position, &mut right);
            return (normal, right);
        }
        // cross terms between coordinates are taken at the position itself: else steps would be too long
        let (mut normal, right) = self.summed(record, t, Place { eye: None, ..place });
        sides.mirror.raise(&mut normal, &self.summed(record, t, place).0);
        (normal, right)
    }

    /// Sums the information and the right-hand side, with the derivatives of `place`.
    fn summed(&self, record: &Record<'_>, t: usize, place: Place<D>) -> (Matrix<D>, Vector<D>) {
        let width = record.width();
        let (mut normal, mut right) = ([[0.0; D]; D], [0.0; D]);
        let trust = |m: usize| self.trust[t * width + self.measured.column[m]];
        let emission = self.measured.emission(t, place, trust);
        for (m, row) in self.measured.rows(t, place) {
            let weight = trust(m);
            if weight == 0.0 {
                continue;
            }
            let one = self.measured.one(m);
            let Some(row) = emission.removed_from(one, row) else { continue };
            for i in 0..D {
                right[i] += weight * row.gradient[i] * row.residual;
            }
            add_outer(&mut normal, weight, &row.gradient);
        }
        (normal, right)
    }

    /// Returns the measurements of an instant about the path: number, residual and derivatives, and the
    /// variance of the emission in units of the stated variance (0 except for arrivals). The emission as
    /// estimated from the trusted arrivals is subtracted from arrivals.
    pub fn rows(&self, t: usize) -> impl Iterator<Item = (usize, Row<D>, f64)> {
        let (place, width) = (self.place(t), self.measured.width);
        let trust = |m: usize| self.trust[t * width + self.measured.column[m]];
        let emission = self.measured.emission_for_all(t, place, trust);
        self.measured.rows(t, place).filter_map(move |(m, row)| {
            let one = self.measured.one(m);
            Some((m, emission.removed_from(one, row)?, emission.variance(one)))
        })
    }

    /// Returns an instant with the position and the velocity of the path.
    fn seen(&self, t: usize) -> Seen<D> {
        let own = &self.path.mean[t * N + D..][..D];
        let velocity = std::array::from_fn(|i| if own[i].is_finite() { own[i] } else { 0.0 });
        Seen { t, place: self.place(t), velocity }
    }

    /// Returns an instant about the path, with the effect of biases in these columns.
    pub fn instant(&self, t: usize, weight: &[f64], columns: &[usize]) -> Instant<D> {
        Instant::new(&self.measured, self.seen(t), weight, columns, self.anchor[t])
    }

    /// Returns several instants combined into one, with the effect of biases in these columns.
    pub fn together(&self, own: Range<usize>, weight: &[f64], columns: &[usize]) -> Instant<D> {
        Instant::together(&self.measured, own.map(|t| self.seen(t)), weight, columns)
    }

    /// Whether a measurement is more likely to be an outlier than not.
    pub fn is_outlier(&self, at: usize) -> bool {
        self.trust[at] < 0.5
    }
}

/// Returns the positions of the single instants.
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
