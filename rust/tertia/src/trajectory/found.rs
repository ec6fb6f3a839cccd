//! Positions of the instants, smoothed, without what the smooth path contradicts.

use super::failure::Failure;
use super::fixes::Fixes;
use super::measured::{Measured, REDUNDANCY, Record};
use super::path::{Path, Plots, Smoother};
use super::tukey::{EFFICIENCY, tukey};
use crate::base::small::{Factor, Matrix, Vector};
use crate::sensors::Kind;
use crate::smoothing::JerkFit;
use std::rc::Rc;

/// Rounds of looking for measurements that the path contradicts.
const PASSES: usize = 5;
/// Change of a weight that needs no other round.
const UNCHANGED: f64 = 0.05;
/// Rounds with the same jerk.
const RELINEARISED: usize = 2;

/// What has been found so far.
#[derive(Debug)]
pub(super) struct Found<const D: usize, const N: usize> {
    pub measured: Rc<Measured<D>>,
    /// Weights by the path, (N, 5, K); 0 where it contradicts.
    pub trust: Vec<f64>,
    pub fixes: Fixes,
    pub plots: Plots,
    pub path: Path,
    /// Weights with which the measurements are in the positions.
    pub used: Vec<f64>,
}

/// How a path is smoothed: the jerk, if it is given, and buffers.
pub(super) struct Setting<'a, const D: usize, const N: usize> {
    pub record: &'a Record<'a>,
    pub jerk: Option<f64>,
    /// See `Fixes`.
    pub tolerance: f64,
    pub smoother: Smoother<D, N>,
}

/// An intensity that is given.
pub(super) fn known(jerk: f64) -> JerkFit {
    JerkFit { jerk, relative_error: 0.0 }
}

impl<const D: usize, const N: usize> Setting<'_, D, N> {
    /// Smooths positions; without an intensity the likeliest one is taken, near that of before.
    fn smoothed(
        &mut self,
        plots: &Plots,
        jerk: Option<f64>,
        near: Option<f64>,
        components: usize,
    ) -> Result<Path, Failure> {
        let track = plots.track(self.record.time, D)?;
        let fit = match jerk {
            Some(jerk) => known(jerk),
            None => self.smoother.fit(&track, near),
        };
        Ok(self.smoother.smooth(&track, fit, components))
    }
}

impl<const D: usize, const N: usize> Found<D, N> {
    /// Locates and smooths what was measured, all of it.
    pub fn first(
        setting: &mut Setting<'_, D, N>,
        measured: &Rc<Measured<D>>,
    ) -> Result<Self, Failure> {
        let made = |setting: &mut Setting<'_, D, N>| {
            let trust = vec![1.0; measured.values.len()];
            Self::made(setting, measured, setting.jerk, trust, None, D)
        };
        let found = made(setting)?;
        setting.tolerance = found.tolerance(setting.record, measured);
        if setting.tolerance > 1.0 { made(setting) } else { Ok(found) }
    }

    /// Locates every instant with these weights, and smooths.
    fn made(
        setting: &mut Setting<'_, D, N>,
        measured: &Rc<Measured<D>>,
        jerk: Option<f64>,
        trust: Vec<f64>,
        before: Option<&Self>,
        components: usize,
    ) -> Result<Self, Failure> {
        let same = before.filter(|before| Rc::ptr_eq(&before.measured, measured));
        let old = same.map(|before| (&before.fixes, before.trust.as_slice()));
        let fixes = Fixes::locate(setting.record, measured, &trust, setting.tolerance, old)?;
        let plots = plots_of(&fixes, D);
        let near = before.map(|before| before.path.fit.jerk);
        // where nothing will be linearised, this is the last word
        let last = if plots.count(D) < 2 { D } else { 0 };
        let path = setting.smoothed(&plots, jerk, near, last)?;
        let measured = Rc::clone(measured);
        let mut found = Self { measured, trust, fixes, plots, path, used: Vec::new() };
        found.used = found.weights(setting.record);
        for round in 1..=RELINEARISED {
            let components = if round == RELINEARISED { components } else { 0 };
            found.relinearise(setting, Some(found.path.fit.jerk), components)?;
        }
        Ok(found)
    }

    /// Linearises about the path in place of each position, whose error is larger.
    pub fn relinearise(
        &mut self,
        setting: &mut Setting<'_, D, N>,
        jerk: Option<f64>,
        components: usize,
    ) -> Result<(), Failure> {
        if self.plots.count(D) < 2 {
            // a single position is its own path
            return Ok(());
        }
        let near = Some(self.path.fit.jerk);
        let mut plots = self.plots.clone();
        for t in (0..setting.record.len()).filter(|&t| self.fixes.is_located(t)) {
            let p = self.path.position::<D>(t);
            let Some((inverse, step)) = self.step(setting.record, t, p) else { continue };
            let factor = if self.is_robust(setting.record, t) { EFFICIENCY } else { 1.0 };
            for i in 0..D {
                plots.position[t * D + i] = p[i] + step[i];
                for j in 0..D {
                    plots.covariance[(t * D + i) * D + j] = factor * inverse[i][j];
                }
            }
        }
        self.path = setting.smoothed(&plots, jerk, near, components)?;
        self.plots = plots;
        Ok(())
    }

    /// The covariance of an instant's position about another one, and the way to it.
    fn step(&self, record: &Record<'_>, t: usize, p: &[f64]) -> Option<(Matrix<D>, Vector<D>)> {
        if p.iter().any(|v| v.is_nan()) {
            return None;
        }
        let width = self.trust.len() / self.fixes.fixes.len();
        let (mut normal, mut right) = ([[0.0; D]; D], [0.0; D]);
        let common = record.common_variance();
        // the error that range differences share is one unknown more: its column, row and right
        let (mut column, mut corner, mut rest) = ([0.0; D], 1.0, 0.0);
        for (m, row) in self.measured.rows(t, p) {
            let weight = self.used[t * width + self.measured.column[m]];
            if weight == 0.0 {
                continue;
            }
            let mut row = row;
            let one = self.measured.one(m);
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
        let factor = Factor::try_new(&normal, 0.0)?;
        Some((factor.inverse(), factor.solve(&right)))
    }

    /// Whether an instant is located robustly.
    fn is_robust(&self, record: &Record<'_>, t: usize) -> bool {
        record.robust && self.fixes.fixes[t].degrees_of_freedom >= REDUNDANCY as i64
    }

    /// The weights with which the measurements are in the positions.
    fn weights(&self, record: &Record<'_>) -> Vec<f64> {
        let (width, mut used) = (record.width(), vec![0.0; self.trust.len()]);
        for t in (0..record.len()).filter(|&t| self.fixes.is_located(t)) {
            let robust = self.is_robust(record, t);
            for (m, row) in self.measured.rows(t, &self.fixes.position[t * D..][..D]) {
                let at = t * width + self.measured.column[m];
                let size = row.residual / self.fixes.tolerance;
                let inside = if robust { tukey(size) } else { 1.0 };
                used[at] = if row.residual.is_nan() { 0.0 } else { self.trust[at] * inside };
            }
        }
        used
    }

    /// Leaves out what the smooth path contradicts, until nothing else is.
    pub fn without_outliers(
        self,
        setting: &mut Setting<'_, D, N>,
        measured: &Rc<Measured<D>>,
    ) -> Result<Self, Failure> {
        let robust = setting.record.robust;
        let same = Rc::ptr_eq(&self.measured, measured);
        if !same {
            setting.tolerance = self.tolerance(setting.record, measured);
        }
        let mut found = self;
        for pass in 0..if robust { PASSES } else { 1 } {
            let judged = robust && (pass > 0 || same);
            let trust = if judged { found.trusted(setting.record) } else { found.trust.clone() };
            let pairs = trust.iter().zip(&found.trust);
            let unchanged = pairs.fold(0.0_f64, |most, (new, old)| most.max((new - old).abs()));
            if unchanged < UNCHANGED && Rc::ptr_eq(&found.measured, measured) {
                break;
            }
            let jerk = Some(found.path.fit.jerk);
            found = Self::made(setting, measured, jerk, trust, Some(&found), 0)?;
            found.relinearise(setting, setting.jerk, D)?;
        }
        Ok(found)
    }

    /// What was left out in space, or is contradicted.
    pub fn is_outlier(&self, at: usize) -> bool {
        self.fixes.outlier[at] || self.trust[at] == 0.0
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
