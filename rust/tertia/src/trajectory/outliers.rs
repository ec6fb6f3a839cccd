//! The path without what contradicts it.
//!
//! Each measurement belongs to the noise or to the outliers, with a probability that follows from how
//! far it is from the path without it. As a path through many outliers is a bad beginning, the noise
//! is first taken to be as large as the residuals are, then step by step as small as it is.

use super::failure::Failure;
use super::found::{Found, Setting};
use super::measured::{Measured, REDUNDANCY, Record};
use super::mixture::{Compared, Mixture, trust_of};
use super::tukey::{MEDIAN_ERROR, chance};
use crate::base::distribution::normal_two_sided_quantile;
use crate::sensors::Kind;
use std::rc::Rc;

/// Most rounds of weights with the noise as large as it is.
const ROUNDS: usize = 20;
/// Change of a position, over the standard deviation, that needs no other round.
const UNCHANGED: f64 = 0.003;
/// Share of the measurements whose weights may change with the motion as it is.
const FEW: f64 = 0.01;
/// Size of a residual that others of the instant do not contradict: two-sided 1 %.
const DOUBTED: f64 = 0.01;
/// Share of the measurements of an instant that agree, if it is the path that is wrong.
const AGREEING: f64 = 0.8;
/// Least share of a measurement that the others determine.
const REDUNDANT: f64 = 0.1;
/// Measurements over which a running median tells errors that last from single faults, and the
/// variance of a median of so many normal errors, over theirs.
const RUNNING: usize = 5;
const OF_MEDIANS: f64 = 0.287;
/// Running medians that tell what lasts of one station alone.
const ENOUGH: usize = 20;

impl<const D: usize, const N: usize> Found<D, N> {
    /// Fits the path to these measurements without what contradicts it, until nothing changes.
    pub fn without_outliers(
        mut self,
        setting: &mut Setting<'_, D, N>,
        measured: &Rc<Measured<D>>,
    ) -> Result<Self, Failure> {
        self.measured = Rc::clone(measured);
        if self.plots.count(D) < 2 {
            // the others of its instant are all that a measurement is compared with
            let pairs = self.trust.iter_mut().zip(&self.fixes.outlier);
            pairs.filter(|(_, outlier)| **outlier).for_each(|(trust, _)| *trust = 0.0);
            return Ok(self);
        }
        if !setting.record.robust {
            self.relinearise(setting, setting.motion, 1.0)?;
            self.relinearise(setting, setting.motion, 1.0)?;
            return Ok(self);
        }
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
        for _ in 0..ROUNDS {
            if !self.weigh_twice(setting, &mut mixture, false)? {
                break;
            }
        }
        Ok(self)
    }

    /// Judges the measurements by the path, and smooths, once with a new motion and once with the same:
    /// whether the second time has changed anything. The noise may be held.
    fn weigh_twice(
        &mut self,
        setting: &mut Setting<'_, D, N>,
        mixture: &mut Mixture,
        is_held: bool,
    ) -> Result<bool, Failure> {
        self.weigh(setting, mixture, is_held, true)?;
        self.weigh(setting, mixture, is_held, false)
    }

    /// Judges the measurements by the path, and smooths: whether anything has changed.
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

    /// The largest change of a coordinate, over its standard deviation.
    fn moved(&self, before: &[f64]) -> f64 {
        let mut most = 0.0_f64;
        for (t, old) in before.chunks_exact(N).enumerate() {
            for (i, (new, old)) in self.path.position::<D>(t).iter().zip(old).enumerate() {
                let sigma = self.path.covariance[(t * D + i) * D + i].sqrt();
                most = most.max((new - old).abs() / sigma);
            }
        }
        most
    }

    /// The probabilities of all measurements by what the rest of the path says.
    ///
    /// With the residual r, the weight w and g = J P J' / σ²: the path without it predicts it with the
    /// error r / (1 − w g), of the variance σ² (1 + g / (1 − w g)).
    fn trusted(&self, record: &Record<'_>, mixture: &mut Mixture, is_held: bool) -> Vec<f64> {
        let residuals = self.compared(record);
        mixture.fit(&residuals, is_held);
        // what is missing is no outlier, and neither is what nothing is compared with
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
        let limit = mixture.noise * normal_two_sided_quantile(DOUBTED);
        for t in 0..record.len() {
            self.trust_instant(record, t, limit, &mut trust);
        }
        trust
    }

    /// The sizes of all residuals.
    fn sizes(&self, record: &Record<'_>) -> Vec<f64> {
        let mut sizes = Vec::with_capacity(self.measured.len());
        for t in 0..record.len() {
            let sizes_of = self.rows(t).map(|(_, row, _)| row.residual.abs());
            sizes.extend(sizes_of.filter(|size| !size.is_nan()));
        }
        sizes
    }

    /// The residuals of all measurements about the path without them.
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

    /// Trusts an instant whose measurements agree, with as many to spare as it takes to be located
    /// robustly, where the path contradicts most of them: it does not know the motion.
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

    /// Variances of errors that last, of each number of an instant, in the stated ones: what lasts is
    /// no outlier. From running medians of the residuals, of all where one station has few.
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

/// Keeps what is likelier.
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

/// The size of the median of a window.
fn middle(window: &[f64]) -> f64 {
    let mut own: [f64; RUNNING] = std::array::from_fn(|i| window[i]);
    own.sort_unstable_by(f64::total_cmp);
    own[RUNNING / 2].abs()
}

/// The variance of errors that last, from sizes of running medians; none where it may be by chance.
fn variance_of(sizes: &mut [f64]) -> f64 {
    if sizes.is_empty() {
        return 0.0;
    }
    let at = sizes.len() / 2;
    let median = *sizes.select_nth_unstable_by(at, f64::total_cmp).1;
    let margin = 1.0 + chance() * MEDIAN_ERROR * (RUNNING as f64 / sizes.len() as f64).sqrt();
    let size = median / normal_two_sided_quantile(0.5) / margin;
    (size * size - OF_MEDIANS).max(0.0)
}
