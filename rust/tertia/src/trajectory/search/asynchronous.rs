//! Search for the path where hardly any instant has a position of its own, as where stations measure in turn.
//!
//! The first path is then rough, and a motion that is estimated about a path far from the target is agile
//! enough to bend the path into agreement with the measurements. Therefore paths of given motions, from stiff
//! to agile, are fitted as well, from the first positions and, as by graduated optimisation, from a path of the
//! next stiffer motion through all measurements. The path with the largest marginal likelihood is refined with
//! a motion that is estimated about it.

use super::fit::{Found, Setting};
use super::outliers::ROUNDS;
use crate::base::small::{Factor, Matrix, Vector, dot};
use crate::smoothing::ProcessNoise;
use crate::trajectory::instants::fixes::HARDLY_ANY;
use crate::trajectory::instants::mixture::Mixture;
use crate::trajectory::measured::{Measured, bending};
use crate::trajectory::mirror::Mirror;
use crate::trajectory::path::failure::Failure;
use std::f64::consts::TAU;
use std::rc::Rc;

/// Gain of ln of the likelihood from which another path is preferred.
const LIKELIER: f64 = 3.0;
/// Distance by which the stiffest motion bends a path in the time of the record, relative to the distance
/// between the stations, and the ratio of the jerks of two motions.
const STIFF: f64 = 0.1;
const RATIO: f64 = 100.0;
/// Number of instants in which the most agile motion bends a path by the distance between the stations.
const BEND: f64 = 8.0;
/// Fall of ln of the likelihood, from that of the likeliest motion, from which no motion that is more agile is
/// tried.
const FALL: f64 = 20.0;
/// Largest number of rounds of weighting with a given motion.
const FEW: usize = 4;
/// Largest number of steps towards a path of a given motion, and the change of a position, in standard
/// deviations, that ends them.
const STEPS: usize = 15;
const NEAR: f64 = 0.1;

/// A path with the sizes of noise and outliers, and ln of its marginal likelihood.
pub(in crate::trajectory) struct Candidate<const D: usize, const N: usize> {
    pub found: Found<D, N>,
    mixture: Mixture,
    pub value: f64,
}

impl<const D: usize, const N: usize> Found<D, N> {
    /// Returns the path without the measurements that contradict it and, if hardly any instant has a
    /// position, ln of its likelihood. The search is then repeated with given motions if it `is_wide`, and so
    /// it is if the path was far from the target.
    pub fn sought(
        setting: &mut Setting<'_, D, N>,
        measured: &Rc<Measured<D>>,
        mirror: Option<Mirror<D>>,
        is_wide: bool,
    ) -> Result<(Self, Option<f64>), Failure> {
        let is_mirrored = mirror.is_some();
        let first = Self::first(setting, measured, mirror)?;
        if !setting.record.robust || first.plots.count(D) < 2 {
            let found = first.without_outliers(setting, measured)?;
            return Ok((found.crossed(setting, measured, Mixture::new(Vec::new()))?, None));
        }
        let is_open = first.is_open(is_mirrored);
        let start = is_wide.then(|| first.clone());
        let usual = first.weighed(setting, measured, ROUNDS);
        let is_lost = is_wide && usual.as_ref().is_ok_and(|(found, _)| found.was_far);
        if !is_open && !is_lost {
            let (found, mixture) = usual?;
            return Ok((found.crossed(setting, measured, mixture)?, None));
        }
        let usual = usual.and_then(|(found, mixture)| Candidate::new(found, mixture, setting));
        let given = setting.motion;
        let other = start.and_then(|start| Self::of_motions(setting, measured, start));
        setting.motion = given;
        let other = other.map(|other| other.settled(setting));
        let best = match (usual, other) {
            (Ok(usual), Some(Ok(other))) if other.value > usual.value + LIKELIER => other,
            (Err(_), Some(Ok(other))) => other,
            (usual, _) => usual?,
        };
        let best = best.crossed(setting, measured)?;
        Ok((best.found, Some(best.value)))
    }

    /// Returns the likeliest path of motions from stiff to agile.
    fn of_motions(
        setting: &mut Setting<'_, D, N>,
        measured: &Rc<Measured<D>>,
        first: Self,
    ) -> Option<Candidate<D, N>> {
        let mut best: Option<Candidate<D, N>> = None;
        let mut plain = first.clone();
        for motion in motions(setting) {
            setting.motion = Some(motion);
            let mut anew = first.clone();
            let starts = [
                anew.smooth_again(setting).map(|()| anew),
                plain.approach(setting).map(|()| plain.clone()),
            ];
            let mut top = f64::NEG_INFINITY;
            for start in starts.into_iter().flatten() {
                let Ok((found, mixture)) = start.weighed(setting, measured, FEW) else { continue };
                let Ok(own) = Candidate::new(found, mixture, setting) else { continue };
                top = top.max(own.value);
                if best.as_ref().is_none_or(|best| own.value > best.value) {
                    best = Some(own);
                }
            }
            if best.as_ref().is_some_and(|best| top < best.value - FALL) {
                break;
            }
        }
        best
    }

    /// Fits the path to all measurements with the motion of the setting.
    fn approach(&mut self, setting: &mut Setting<'_, D, N>) -> Result<(), Failure> {
        for _ in 0..STEPS {
            let before = self.path.mean.clone();
            self.relinearise(setting, setting.motion, 1.0)?;
            if self.moved(&before) < NEAR {
                break;
            }
        }
        Ok(())
    }

    /// Whether hardly any instant has a position of its own.
    fn is_open(&self, is_mirrored: bool) -> bool {
        let n = self.fixes.fixes.len();
        let enough = (0..n).filter(|&t| self.measured.comparable(t) >= D).count();
        self.fixes.are_hardly_located() && (!is_mirrored || HARDLY_ANY * enough <= n)
    }

    /// Smooths the positions with the motion of the setting.
    fn smooth_again(&mut self, setting: &mut Setting<'_, D, N>) -> Result<(), Failure> {
        self.path = setting.smoothed(&self.plots, setting.motion, None)?;
        self.stay_beside();
        Ok(())
    }

    /// Returns ln of the marginal likelihood of the measurements, up to a constant. The measurements are
    /// linearised about the path, and whether they are outliers is averaged over with the probabilities of
    /// the path (a lower bound of the likelihood).
    fn evidence(
        &mut self,
        setting: &mut Setting<'_, D, N>,
        mixture: &Mixture,
    ) -> Result<f64, Failure> {
        let n = setting.record.len();
        let mut sum = 0.0;
        for t in 0..n {
            for (m, row, _) in self.rows(t) {
                let trust = self.trust[t * self.measured.width + self.measured.column[m]];
                if !row.residual.is_nan() {
                    sum += mixture.bound(row.residual, trust);
                }
            }
        }
        let before = self.path.mean.clone();
        (self.plots, self.path) =
            self.linearised(setting, Some(self.path.fit.motion), self.scale)?;
        for t in (0..n).filter(|&t| self.plots.is_known(t, D)) {
            let step: Vector<D> =
                std::array::from_fn(|i| self.plots.position[t * D + i] - before[t * N + i]);
            let spread: Matrix<D> = std::array::from_fn(|i| {
                std::array::from_fn(|j| self.plots.covariance[(t * D + i) * D + j])
            });
            let Some(factor) = Factor::try_new(&spread, 0.0) else { return Ok(f64::NAN) };
            let square = dot(&step, &factor.solve(&step));
            sum += 0.5 * (square + factor.ln_determinant() + D as f64 * TAU.ln());
        }
        Ok(sum + self.path.summary.log_likelihood)
    }
}

impl<const D: usize, const N: usize> Candidate<D, N> {
    pub fn new(
        found: Found<D, N>,
        mixture: Mixture,
        setting: &mut Setting<'_, D, N>,
    ) -> Result<Self, Failure> {
        let value = found.clone().evidence(setting, &mixture)?;
        let value = if value.is_nan() { f64::NEG_INFINITY } else { value };
        Ok(Self { found, mixture, value })
    }

    /// Refines the path with the motion that is given or estimated.
    fn settled(self, setting: &mut Setting<'_, D, N>) -> Result<Self, Failure> {
        let Self { mut found, mut mixture, .. } = self;
        found.relinearise(setting, setting.motion, mixture.noise)?;
        found.refine(setting, &mut mixture, ROUNDS)?;
        Self::new(found, mixture, setting)
    }
}

/// Returns motions from stiff to agile; none if the stations are at one place.
fn motions<const D: usize, const N: usize>(setting: &Setting<'_, D, N>) -> Vec<ProcessNoise> {
    let record = setting.record;
    let Some(unit) = bending::<D>(record) else { return Vec::new() };
    let bends = (record.len() as f64 / BEND).max(1.0);
    let count = 1 + ((bends.powi(5) / (STIFF * STIFF)).ln() / RATIO.ln()) as i32;
    let jerk = |i: i32| unit * STIFF * STIFF * RATIO.powi(i);
    (0..count).map(|i| ProcessNoise::with_jerk(jerk(i))).collect()
}
