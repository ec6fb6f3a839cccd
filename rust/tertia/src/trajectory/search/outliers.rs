//! The path without the measurements that contradict it.
//!
//! Each measurement belongs to the noise or to the outliers, with a probability that follows from its
//! distance from the path as determined by the others. Because a path through many outliers is a bad start,
//! the noise is first taken to be as large as the residuals, and is then reduced step by step.

use super::fit::{Found, Setting};
use crate::base::angle::upper_median;
use crate::base::distribution::normal_two_sided_quantile;
use crate::sensors::Kind;
use crate::trajectory::instants::mixture::{Compared, Mixture, trust_of};
use crate::trajectory::instants::tukey::{MEDIAN_ERROR, chance};
use crate::trajectory::measured::{Measured, REDUNDANCY, Record};
use crate::trajectory::path::failure::Failure;
use std::rc::Rc;

/// Largest number of rounds of weighting in which the noise is estimated, too.
pub(in crate::trajectory) const ROUNDS: usize = 20;
/// Change of a position, in standard deviations, up to which no other round is needed.
const UNCHANGED: f64 = 0.003;
/// Share of the measurements whose weights may change without a new motion.
const FEW: f64 = 0.01;
/// Significance of the limit (two-sided 1 %) up to which a residual agrees with the others of its instant.
const DOUBTED: f64 = 0.01;
/// Least share of the measurements of an instant that agree with each other, if the path is wrong there.
const AGREEING: f64 = 0.8;
/// Lower bound of the share of a measurement's error that remains in its residual.
const REDUNDANT: f64 = 0.1;
/// Number of measurements in a running median, which distinguishes lasting errors from single faults, and the
/// variance of the median of this number of normal errors, relative to their variance.
const RUNNING: usize = 5;
const OF_MEDIANS: f64 = 0.287;
/// Number of running medians from which the lasting errors of a single column are estimated.
const ENOUGH: usize = 20;

impl<const D: usize, const N: usize> Found<D, N> {
    /// Fits the path to the measurements except those that contradict it, until nothing changes.
    pub fn without_outliers(
        mut self,
        setting: &mut Setting<'_, D, N>,
        measured: &Rc<Measured<D>>,
    ) -> Result<Self, Failure> {
        if self.plots.count(D) < 2 {
            // a measurement can only be compared with the others of its instant
            self.measured = Rc::clone(measured);
            let pairs = self.trust.iter_mut().zip(&self.fixes.outlier);
            pairs.filter(|(_, outlier)| **outlier).for_each(|(trust, _)| *trust = 0.0);
            return Ok(self);
        }
        if !setting.record.robust {
            self.measured = Rc::clone(measured);
            self.relinearise(setting, setting.motion, 1.0)?;
            self.relinearise(setting, setting.motion, 1.0)?;
            return Ok(self);
        }
        self.weighed(setting, measured, ROUNDS).map(|(found, _)| found)
    }

    /// Weights the measurements by their distances from the path, with a noise that is reduced in steps.
    /// Returns the path with the sizes of noise and outliers.
    pub fn weighed(
        mut self,
        setting: &mut Setting<'_, D, N>,
        measured: &Rc<Measured<D>>,
        rounds: usize,
    ) -> Result<(Self, Mixture), Failure> {
        self.measured = Rc::clone(measured);
        let mut mixture = Mixture::new(self.sizes(setting.record));
        let mut best = None;
        while let Some(sharper) = mixture.sharper() {
            self.weigh_twice(setting, &mut mixture, true)?;
            keep(&mut best, &mixture, &self);
            mixture = sharper;
        }
        if let Some((likeliest, found)) = best {
            self.weigh_twice(setting, &mut mixture, true)?;
            if likeliest.log_evidence > mixture.log_evidence {
                (mixture, self) = (likeliest, found);
            }
        }
        self.refine(setting, &mut mixture, rounds)?;
        Ok((self, mixture))
    }

    /// Weights the measurements until the path does not change, in at most this number of rounds; the noise is
    /// estimated as well.
    pub fn refine(
        &mut self,
        setting: &mut Setting<'_, D, N>,
        mixture: &mut Mixture,
        rounds: usize,
    ) -> Result<(), Failure> {
        for _ in 0..rounds {
            if !self.weigh_twice(setting, mixture, false)? {
                break;
            }
        }
        Ok(())
    }

    /// Weights the measurements by their distances from the path and smooths, first with a new motion and
    /// then with the same one. Returns whether the second time has changed the path. `is_held`: the noise is
    /// not estimated.
    fn weigh_twice(
        &mut self,
        setting: &mut Setting<'_, D, N>,
        mixture: &mut Mixture,
        is_held: bool,
    ) -> Result<bool, Failure> {
        self.weigh(setting, mixture, is_held, true)?;
        self.weigh(setting, mixture, is_held, false)
    }

    /// Weights the measurements by their distances from the path and smooths. Returns whether the path has
    /// changed.
    fn weigh(
        &mut self,
        setting: &mut Setting<'_, D, N>,
        mixture: &mut Mixture,
        is_held: bool,
        refits: bool,
    ) -> Result<bool, Failure> {
        let trust = self.trusted(setting.record, mixture, is_held);
        let pairs = trust.iter().zip(&self.trust);
        let change: f64 = pairs.map(|(new, old)| (new - old).abs()).sum();
        let is_other = self.scale != mixture.noise || change > FEW * self.measured.len() as f64;
        let before = self.path.mean.clone();
        let motion = match setting.motion {
            None if !refits || !is_other => Some(self.path.fit.motion),
            motion => motion,
        };
        self.trust = trust;
        self.scale = mixture.noise;
        self.relinearise(setting, motion, mixture.noise)?;
        Ok(self.moved(&before) > UNCHANGED)
    }

    /// Largest change of a coordinate, in standard deviations.
    pub fn moved(&self, before: &[f64]) -> f64 {
        let mut most = 0.0_f64;
        for (t, old) in before.chunks_exact(N).enumerate() {
            for (i, (new, old)) in self.path.position::<D>(t).iter().zip(old).enumerate() {
                let sigma = self.path.covariance[(t * D + i) * D + i].sqrt();
                most = most.max((new - old).abs() / sigma);
            }
        }
        most
    }

    /// Returns the probabilities that measurements are not outliers, given the rest of the path.
    ///
    /// With the residual r, the weight w and g = J P J' / σ², the path without the measurement predicts it
    /// with the error r / (1 − w g), whose variance is σ² (1 + g / (1 − w g)).
    fn trusted(&self, record: &Record<'_>, mixture: &mut Mixture, is_held: bool) -> Vec<f64> {
        let residuals = self.compared(record);
        mixture.fit(&residuals, is_held);
        // missing measurements are not outliers, and neither are single arrivals, which nothing is compared
        // with
        let mut trust: Vec<f64> =
            self.measured.values.iter().map(|v| if v.is_nan() { 1.0 } else { 0.0 }).collect();
        for t in 0..record.len() {
            if let Some(at) = self.measured.lone_arrival(t) {
                trust[t * record.width() + at] = 1.0;
            }
        }
        for one in residuals {
            trust[one.at] = trust_of(mixture.densities(&one));
        }
        if self.measured.is_in_pairs() {
            self.trust_pairs(record, &mut trust);
        }
        let limit = mixture.noise * normal_two_sided_quantile(DOUBTED);
        for t in 0..record.len() {
            self.trust_instant(record, t, limit, &mut trust);
        }
        trust
    }

    /// Returns the sizes of all residuals.
    fn sizes(&self, record: &Record<'_>) -> Vec<f64> {
        let mut sizes = Vec::with_capacity(self.measured.len());
        for t in 0..record.len() {
            let sizes_of = self.rows(t).map(|(_, row, _)| row.residual.abs());
            sizes.extend(sizes_of.filter(|size| !size.is_nan()));
        }
        sizes
    }

    /// Returns the residuals of all measurements about the path without them.
    fn compared(&self, record: &Record<'_>) -> Vec<Compared> {
        let mut residuals = Vec::with_capacity(self.measured.len());
        let lasting = self.lasting(record);
        for t in 0..record.len() {
            let covariance = &self.path.covariance[t * D * D..][..D * D];
            for (m, row, common) in self.rows(t) {
                let at = t * record.width() + self.measured.column[m];
                let mut g = common * self.scale * self.scale;
                for i in 0..D {
                    for j in 0..D {
                        g += row.gradient[i] * covariance[i * D + j] * row.gradient[j];
                    }
                }
                if g.is_finite() && !row.residual.is_nan() {
                    let held = self.trust[at] * g / (self.scale * self.scale);
                    let rest = (1.0 - held).max(REDUNDANT);
                    let variance = g / rest + lasting[self.measured.column[m]];
                    let travels = matches!(self.measured.one(m).kind, Kind::Range | Kind::Arrival);
                    let residual = row.residual / rest;
                    residuals.push(Compared { at, residual, variance, held, travels });
                }
            }
        }
        residuals
    }

    /// Trusts the two arrivals of an instant alike, because only their difference is known: the odds that one
    /// of them is an outlier are the sum of their odds. If one were trusted more, it would take the place of
    /// the emission, and nothing would be left to compare the other with.
    fn trust_pairs(&self, record: &Record<'_>, trust: &mut [f64]) {
        for t in 0..record.len() {
            let Some(pair) = self.measured.pair(t) else { continue };
            let own = pair.map(|column| t * record.width() + column);
            // 1 + the sum of the odds (1 - p) / p
            let odds = own.iter().map(|&at| 1.0 / trust[at].max(f64::MIN_POSITIVE)).sum::<f64>();
            own.iter().for_each(|&at| trust[at] = 1.0 / (odds - 1.0));
        }
    }

    /// Trusts the measurements of an instant that agree with each other and are enough to locate it robustly,
    /// if the path contradicts most of them: the motion of the path is then wrong.
    fn trust_instant(&self, record: &Record<'_>, t: usize, limit: f64, trust: &mut [f64]) {
        if !self.fixes.is_located(t) {
            return;
        }
        let agrees =
            |at: &usize| !self.fixes.outlier[*at] && self.fixes.residual[*at].abs() <= limit;
        let own = t * record.width()..(t + 1) * record.width();
        let (mut count, mut sum) = (0, 0.0);
        for at in own.clone().filter(agrees) {
            count += 1;
            sum += trust[at];
        }
        let measured = self.measured.instant(t).len() as f64;
        let most = count >= D + REDUNDANCY && count as f64 >= AGREEING * measured;
        if most && sum < 0.5 * count as f64 {
            own.filter(agrees).for_each(|at| trust[at] = 1.0);
        }
    }

    /// Variances of lasting errors of each column, in units of the stated ones: lasting errors are not
    /// outliers. They are estimated from running medians of the residuals; columns with few residuals get the
    /// value of all columns.
    pub fn lasting(&self, record: &Record<'_>) -> Vec<f64> {
        let mut series = vec![Vec::new(); record.width()];
        for t in 0..record.len() {
            for (m, row, _) in self.rows(t) {
                if !row.residual.is_nan() {
                    series[self.measured.column[m]].push(row.residual);
                }
            }
        }
        let sizes = |own: &Vec<f64>| -> Vec<f64> { own.windows(RUNNING).map(middle).collect() };
        let own: Vec<Vec<f64>> = series.iter().map(sizes).collect();
        let all = variance_of(&mut own.concat());
        let of = |mut own: Vec<f64>| if own.len() < ENOUGH { all } else { variance_of(&mut own) };
        own.into_iter().map(of).collect()
    }
}

/// Keeps the likelier state.
fn keep<const D: usize, const N: usize>(
    best: &mut Option<(Mixture, Found<D, N>)>,
    mixture: &Mixture,
    found: &Found<D, N>,
) {
    let likelier = |(one, _): &(Mixture, _)| mixture.log_evidence > one.log_evidence;
    if best.as_ref().is_none_or(likelier) {
        *best = Some((mixture.clone(), found.clone()));
    }
}

/// Absolute value of the median of a window.
fn middle(window: &[f64]) -> f64 {
    let mut own: [f64; RUNNING] = std::array::from_fn(|i| window[i]);
    own.sort_unstable_by(f64::total_cmp);
    own[RUNNING / 2].abs()
}

/// Variance of lasting errors, from the sizes of running medians; 0 if these may be due to chance.
fn variance_of(sizes: &mut [f64]) -> f64 {
    if sizes.is_empty() {
        return 0.0;
    }
    let median = upper_median(sizes);
    let margin = 1.0 + chance() * MEDIAN_ERROR * (RUNNING as f64 / sizes.len() as f64).sqrt();
    let size = median / normal_two_sided_quantile(0.5) / margin;
    (size * size - OF_MEDIANS).max(0.0)
}
