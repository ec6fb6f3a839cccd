//! Search for the likeliest motion of a family with a model of the noise, and for the noise factor.

use super::expected::Expected;
use super::fit::{Family, ProcessNoiseFit, median_step, range};
use super::lasting::{Fit, Found, Lasting};
use super::model::{Faults, LastingNoise, Model};
use super::motion::ProcessNoise;
use super::results::Smoothed;
use super::track::Track;
use std::cell::RefCell;

/// Prior standard deviations of the logarithms of the noise factor and of that of velocities.
const FACTOR_SIGMA: f64 = 0.5;
const VELOCITY_FACTOR_SIGMA: f64 = 1.0;
/// Unit of the search for the time by which velocities lag, relative to the median step.
const OFFSET_STEP: f64 = 0.25;
/// Least gain of the log-likelihood by a noise factor other than 1.
const FACTOR_GAIN: f64 = 2.0;
/// First step of the logarithm of the intensity, and the number of times that it is halved.
const STEP: f64 = 2.0;
const HALVINGS: usize = 4;
/// Step of the logarithm of the intensity in a scan of the whole range, and the largest number of steps in a
/// search.
const SCAN: f64 = 4.0;
const MOST_STEPS: usize = 60;

/// Start of a search: the logarithms of the intensity of the motion and of the factor of the standard
/// deviations of velocities, and the time by which velocities lag.
#[derive(Clone, Copy, Debug)]
pub(super) struct Near {
    pub intensity: f64,
    pub velocity_factor: f64,
    pub velocity_time_offset: f64,
}

impl Near {
    /// Starts near an intensity, with velocities as stated.
    pub fn intensity(intensity: f64) -> Self {
        Self { intensity, velocity_factor: 0.0, velocity_time_offset: 0.0 }
    }
}

/// A model with its likeliest motion, its noise factor, and the logarithm of its likelihood.
#[derive(Clone, Copy, Debug)]
pub(super) struct Candidate {
    pub model: Model,
    pub factor: f64,
    pub value: f64,
}

/// How the noise factor of a model is determined.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Scale {
    /// The factor is 1.
    Stated,
    /// By the likelihood alone; the factor of velocities is given.
    Free,
    /// With a prior about 1.
    Prior,
    /// As [`Self::Prior`], but not below 1: if noise is correlated, small residuals do not show that it is
    /// small.
    Larger,
}

/// A search for the likeliest motions with models of the noise.
pub(super) struct Search<'a, const M: usize, const N: usize> {
    pub track: &'a Track<'a>,
    pub engine: Lasting<M, N>,
    pub jerk: Option<f64>,
    /// Number of measurements that determine the first state.
    used: usize,
    /// Logarithm of a jerk that hardly shows within the track.
    pub low: f64,
    fits: RefCell<Fits>,
}

/// Fits of models with the same faults: searches return to the same models.
#[derive(Default)]
struct Fits {
    faults: Faults,
    known: Vec<(Model, Fit)>,
}

impl<'a, const M: usize, const N: usize> Search<'a, M, N> {
    /// Sets up a search; `white` are the results of smoothing with white noise.
    pub fn new<const S: usize>(
        track: &'a Track<'a>,
        fit: &ProcessNoiseFit,
        jerk: Option<f64>,
        white: &Smoothed<'_>,
    ) -> Option<Self> {
        let (low, _) = range(track, Family::Jerk.power())?;
        let engine = Lasting::new::<S>(track, fit.motion)?;
        let engine = engine.near(track, &white.mean[..S], &white.covariance[..S * S]);
        let used = if track.prior.is_empty() { S } else { 0 };
        Some(Self { track, engine, jerk, used, low, fits: RefCell::default() })
    }

    /// Starts anew with a state as vague as this motion makes it.
    pub fn restart<const S: usize>(&mut self, motion: ProcessNoise) {
        if let Some(engine) = Lasting::new::<S>(self.track, motion) {
            self.engine = engine.after(&self.engine);
            self.fits.take();
        }
    }

    /// Returns the likeliest motion of a family near another one, with the noise factors. The common factor
    /// multiplies both the covariances and the intensities.
    pub fn best(
        &self,
        family: Family,
        lasting: LastingNoise,
        scale: Scale,
        faults: &Faults,
        near: Near,
    ) -> Candidate {
        let motion = family.of(self.track);
        let unit = OFFSET_STEP * median_step(self.track);
        let low = range(self.track, family.power()).map_or(self.low, |(low, _)| low);
        let start =
            [near.intensity.max(low), near.velocity_factor, near.velocity_time_offset / unit];
        let of = |offset: [f64; 3]| {
            let [log, velocity_factor, lag] = std::array::from_fn(|i| start[i] + offset[i]);
            let model = Model {
                lasting,
                velocity_factor: velocity_factor.exp(),
                velocity_time_offset: unit * lag,
                ..Model::as_stated(motion(log))
            };
            match self.jerk {
                Some(jerk) => self.with_jerk(jerk, model, scale, faults),
                None => self.candidate(model, scale, faults),
            }
        };
        let is_moving = self.track.numbers > self.track.dimension;
        let is_doubted = is_moving && matches!(scale, Scale::Prior | Scale::Larger);
        let searched = [self.jerk.is_none(), is_doubted, is_doubted];
        // the offset is a multiple of the last step, so that the search may return to the same models
        let (mut at, mut best) = climb(searched, low - start[0], of);
        for doubt in 1..3 {
            let mut stated = at;
            stated[doubt] = -start[doubt];
            let other = of(stated);
            if other.value > best.value {
                (at, best) = (stated, other);
            }
        }
        best
    }

    /// Returns the likeliest model with the noise as stated in which the position wanders about a path: the
    /// same process as in a model of larger, lasting noise, with the same correlation time.
    pub fn wandering(&self, noise: &Candidate, faults: &Faults) -> Candidate {
        let motion = Family::Jerk.of(self.track);
        let lasting = LastingNoise { time: noise.model.lasting.time, ..LastingNoise::NONE };
        let variance = noise.factor.powi(2);
        let scales = self.track.position_scale().iter();
        let sigma = scales.fold(f64::INFINITY, |least, scale| least.min(1.0 / scale));
        let intensity = (noise.model.motion.jerk * variance).max(f64::MIN_POSITIVE).ln();
        let size = 0.5 * (variance - 1.0).ln() + sigma.ln();
        let of = |[more, larger]: [f64; 2]| {
            let (motion, wandering) = (motion(intensity + more), [(size + larger).exp(); 3]);
            let model = Model { motion, lasting, wandering, ..noise.model };
            self.candidate(model, Scale::Stated, faults)
        };
        let mut found = climb([true, true], self.low - intensity, of).1;
        found.value -= FACTOR_GAIN;
        found
    }

    /// Whether the innovations of the likeliest path near this start are as expected if the noise is as
    /// stated.
    pub fn is_healthy(&mut self, faults: &Faults, near: Near, expected: Expected) -> bool {
        let best = self.best(Family::Jerk, LastingNoise::NONE, Scale::Stated, faults, near);
        let mut found = Found::default();
        let smoothed = self.engine.smooth(self.track, &best.model, faults, &mut found);
        smoothed.is_some() && !expected.are_suspicious(&found.innovation, self.track.numbers)
    }

    /// Returns the likeliest motion with white jerk over the whole range, with the noise as stated, as the
    /// start of a search.
    pub fn likeliest(&self, faults: &Faults) -> Near {
        if self.jerk.is_some() {
            return Near::intensity(self.low);
        }
        let motion = Family::Jerk.of(self.track);
        let (low, high) = range(self.track, Family::Jerk.power()).unwrap_or((self.low, self.low));
        let count = ((high - low) / SCAN).ceil() as usize;
        let logs = (0..=count).map(|i| low + SCAN * i as f64);
        let value =
            |log: f64| self.candidate(Model::as_stated(motion(log)), Scale::Stated, faults).value;
        let values = logs.map(|log| (log, value(log))).filter(|(_, value)| !value.is_nan());
        let best = values.max_by(|a, b| a.1.total_cmp(&b.1));
        Near::intensity(best.map_or(low, |(log, _)| log))
    }

    /// Returns the candidate with this jerk; the model contains the ratio of the jerk to the noise.
    fn with_jerk(&self, jerk: f64, model: Model, scale: Scale, faults: &Faults) -> Candidate {
        let of = |ratio| {
            let model = Model { motion: ProcessNoise::with_jerk(ratio), ..model };
            self.candidate(model, scale, faults)
        };
        let mut found = of(jerk);
        for _ in 0..4 {
            found = of(jerk / found.factor.powi(2));
        }
        found
    }

    fn fit(&self, model: Model, faults: &Faults) -> Fit {
        let mut fits = self.fits.borrow_mut();
        if fits.faults != *faults {
            *fits = Fits { faults: faults.clone(), known: Vec::new() };
        }
        // most models differ in their motion
        let is_known = |(known, _): &&(Model, Fit)| known.motion == model.motion && *known == model;
        if let Some((_, fit)) = fits.known.iter().find(is_known) {
            return *fit;
        }
        let fit = self.engine.fit(self.track, &model, faults);
        fits.known.push((model, fit));
        fit
    }

    /// Returns a model with its noise factor and its likelihood.
    pub fn candidate(&self, model: Model, scale: Scale, faults: &Faults) -> Candidate {
        let fit = self.fit(model, faults);
        let n = fit.count.saturating_sub(self.used) as f64;
        let (log_factor, value) = scaled(&fit, n, scale);
        let value = match scale {
            Scale::Stated | Scale::Free => value,
            Scale::Prior | Scale::Larger => value + prior(&model, log_factor),
        };
        Candidate { model, factor: log_factor.exp(), value }
    }
}

/// Climbs from a start to the likeliest model along the axes that are searched, and returns the way there. The
/// first axis is the logarithm of an intensity, which is at least `low` above that of the start.
pub(super) fn climb<const K: usize>(
    searched: [bool; K],
    low: f64,
    of: impl Fn([f64; K]) -> Candidate,
) -> ([f64; K], Candidate) {
    let mut at = [0.0; K];
    let (mut best, mut step, mut steps) = (of(at), STEP, 0);
    for _ in 0..=HALVINGS {
        for axis in (0..K).filter(|&axis| searched[axis]) {
            for direction in [step, -step] {
                while steps < MOST_STEPS && (axis > 0 || at[0] + direction >= low) {
                    let mut next = at;
                    next[axis] += direction;
                    let other = of(next);
                    steps += 1;
                    if other.value.is_nan() || other.value <= best.value {
                        break;
                    }
                    (at, best) = (next, other);
                }
            }
        }
        step *= 0.5;
    }
    (at, best)
}

/// Logarithm of the prior of the differences of velocities from what is stated, given the logarithm of the
/// common factor: velocities are not more precise than stated.
fn prior(model: &Model, factor: f64) -> f64 {
    let own = model.velocity_factor.ln();
    if own + factor.max(0.0) < 0.0 {
        return f64::NEG_INFINITY;
    }
    let doubts = [own, model.velocity_time_offset].iter().filter(|doubt| **doubt != 0.0).count();
    -0.5 * (own / VELOCITY_FACTOR_SIGMA).powi(2) - FACTOR_GAIN * doubts as f64
}

/// Returns the logarithm of the noise factor, and that of the likelihood with the prior of the factor.
fn scaled(fit: &Fit, n: f64, scale: Scale) -> (f64, f64) {
    let logarithms = fit.logarithms.total();
    let value = |log: f64, precision: f64| {
        let misfit = fit.squares * (-2.0 * log).exp();
        -0.5 * (misfit + logarithms + 2.0 * n * log + precision * log * log)
    };
    if n < 1.0 || scale == Scale::Stated {
        return (0.0, value(0.0, 0.0));
    }
    let free = 0.5 * (fit.squares / n).max(f64::MIN_POSITIVE).ln();
    if scale == Scale::Free {
        return (free, value(free, 0.0));
    }
    // Newton's method; the posterior is concave, and its maximum is between that of the likelihood and 0
    let precision = FACTOR_SIGMA.powi(-2);
    let mut log = free.clamp(-5.0, 5.0);
    for _ in 0..50 {
        let misfit = fit.squares * (-2.0 * log).exp();
        let step = (misfit - n - precision * log) / (2.0 * misfit + precision);
        log += step.clamp(-1.0, 1.0);
        if step.abs() < 1e-12 {
            break;
        }
    }
    if scale == Scale::Larger {
        log = log.max(0.0);
    }
    let (stated, other) = (value(0.0, precision), value(log, precision) - FACTOR_GAIN);
    if other > stated { (log, other) } else { (0.0, stated) }
}
