//! Hypotheses about a record: it is clean, or contaminated in one of several ways.

use super::acceleration::converge;
use super::independent;
use super::information::variance_of_centre;
use super::modes::{Modes, Shape, Totals};
use super::slow::{self, Levels};
use super::start::{Start, one_sided, start, two_sided, wide};
use super::sticky::{self, Passes};
use crate::base::autoregression::Autoregression;
use crate::base::moments::Moments;
use crate::base::slow_noise::SlowNoise;

/// Penalty per parameter, relative to that of Schwarz (1978), `½ ln N`, with which one-sided outliers of
/// three sigmas would be found too late.
const PENALTY: f64 = 0.8;
/// The same for the weights in sigma: outliers that are too doubtful to be left out may still be bad.
const PENALTY_OF_SIGMA: f64 = 0.4;
const PERSISTENCE: f64 = 0.5;
/// Smallest width of the good mode, in units of the scale at the start, and of any mode, in rounding steps.
const LEAST_WIDTH: f64 = 0.3;
const LEAST_STEPS: f64 = 0.5;
/// Number of EM steps for each side before one side is chosen.
const STEPS_OF_SIDE: usize = 6;
/// Scores are limited to this size: values farther away are bad, whatever their distance.
pub(super) const MAX_SCORE: f64 = 1e3;
/// Lag-one correlation of the modes, in its standard errors, from which on they may persist.
const LEAST_PERSISTENCE: f64 = 1.5;
/// Share of bad measurements above which the bad ones may just as well be the good ones.
const LEAST_OF_MIRROR: f64 = 0.45;
/// Weight below which hypotheses are left out.
const LEAST_WEIGHT: f64 = 1e-5;
/// Slow noise is considered if a correlation increases the likelihood, and for mixtures whose log weight is at
/// most this far below the highest.
const FAR_BEHIND: f64 = 7.0;
/// Larger exponents are limited to this: they are practically infinite.
const LARGEST_EXPONENT: f64 = 500.0;
/// Number of rounds in which levels and the errors about them are found in turn.
const ROUNDS: usize = 2;
/// Penalty for the block length, and the variance and correlation of the levels; the same in sigma.
const PENALTY_OF_LEVELS: f64 = 3.0 * PENALTY;
/// Smallest number of levels from which their variation can be seen.
const FEWEST_LEVELS: f64 = 4.0;
/// Smallest number of good measurements assumed in the degrees of freedom of a hypothesis.
const LEAST_GOOD: f64 = 2.5;

/// One hypothesis: a mixture, or noise of any distribution (`modes` is `None`).
#[derive(Clone, Debug, Default)]
pub(super) struct Hypothesis {
    pub modes: Option<Modes>,
    /// Probabilities of the bad modes for each measurement: as many numbers as there are bad modes.
    pub bad: Vec<f64>,
    /// Probability that a measurement is good, and its weight in the estimate; the weights sum to one.
    good_probability: Vec<f64>,
    pub influence: Vec<f64>,
    log_likelihood: f64,
    parameters: f64,
    /// Increase of the log likelihood by the correlation.
    gain: f64,
    /// Increase of the log weight in sigma by the possibility of slow noise.
    gain_of_sigma: f64,
    /// Whether the hypothesis counts in the variance only.
    doubt: bool,
    /// Weights in the estimate and in its variance.
    pub weight: f64,
    pub weight_of_variance: f64,
    /// Estimate in scores, and its variance for white noise.
    pub value: f64,
    pub variance: f64,
    /// Standard deviation of good measurements.
    pub width: f64,
    /// Expected number of good measurements.
    pub good: f64,
    /// Variance of the mean of the good measurements relative to white noise, and their correlation.
    pub inflation: f64,
    pub correlation: f64,
    /// Levels of a record whose level changes; `None` if it is constant.
    levels: Option<Levels>,
}

/// The hypotheses about the last record, and buffers.
#[derive(Clone, Debug, Default)]
pub(super) struct Hypotheses {
    pub score: Vec<f64>,
    pub list: Vec<Hypothesis>,
    evidence: Vec<f64>,
    passes: Passes,
    autoregression: Autoregression,
}

impl Hypothesis {
    fn log_weight(&self, penalty: f64, n: f64) -> f64 {
        let of_levels = if self.levels.is_some() { PENALTY_OF_LEVELS } else { 0.0 };
        self.log_likelihood - 0.5 * (penalty * self.parameters + of_levels) * n.ln()
    }

    /// The same for sigma, for which part of the noise may be slow.
    fn log_weight_of_sigma(&self, n: f64) -> f64 {
        self.log_weight(PENALTY_OF_SIGMA, n) + self.gain_of_sigma
    }

    /// Allows for slow noise beside white noise, given by its prior probability and its effect; it counts in
    /// sigma only.
    fn take(&mut self, slow: &[(f64, SlowNoise)]) {
        let rest = 1.0 - slow.iter().map(|(prior, _)| prior).sum::<f64>();
        let gain = self.gain;
        let odds = |(prior, found): &(f64, SlowNoise)| {
            prior / rest * (found.gain - gain).min(LARGEST_EXPONENT).exp()
        };
        let total = 1.0 + slow.iter().map(odds).sum::<f64>();
        let mean = |own: f64, of: fn(&SlowNoise) -> f64| {
            (own + slow.iter().map(|s| odds(s) * of(&s.1)).sum::<f64>()) / total
        };
        self.inflation = mean(self.inflation, |found| found.inflation);
        self.correlation = mean(self.correlation, |found| found.correlation);
        self.gain_of_sigma = (rest * total).ln();
    }

    /// Returns the probability that a measurement is good.
    pub fn is_good(&self, i: usize) -> f64 {
        self.good_probability[i]
    }

    /// Returns the measurements that are more probably good than bad, with their indices.
    fn kept<'a>(&self, y: &'a [f64]) -> impl Iterator<Item = (usize, f64)> + use<'a, '_> {
        y.iter().copied().enumerate().filter(|&(i, _)| self.is_good(i) > 0.5)
    }

    /// Whether the measurements that are more probably good than bad are those of another hypothesis.
    fn keeps_as(&self, other: &Self) -> bool {
        let mut pairs = self.good_probability.iter().zip(&other.good_probability);
        pairs.all(|(own, its)| (*own > 0.5) == (*its > 0.5))
    }

    /// Adds what changing `levels` contribute to likelihood and variance. The hypothesis was fitted to the
    /// residuals from these levels in units of `unit`; `step` is the rounding step in this unit.
    fn move_along(
        &mut self,
        levels: Levels,
        residual: &[f64],
        unit: f64,
        step: f64,
        errors: &mut Autoregression,
    ) {
        let white = unit * unit * self.white_variance(residual, step);
        let noise = (unit * self.width).powi(2);
        let of_levels = noise * slow::inflation(self.correlation, levels.good);
        let (count, gain) = levels.read(of_levels, errors);
        self.log_likelihood += gain - residual.len() as f64 * unit.ln();
        if count < FEWEST_LEVELS {
            self.log_likelihood = f64::NEG_INFINITY;
        }
        let moved = (errors.variance() - of_levels / levels.good).max(0.0);
        self.correlation = (moved + self.correlation * noise) / (moved + noise);
        self.width = (moved + noise).sqrt();
        self.variance = white + slow::variance_of_mean(errors, count);
        self.inflation = 1.0;
        self.levels = Some(levels);
    }

    fn expected_good(&self) -> f64 {
        self.good_probability.iter().sum::<f64>().max(LEAST_GOOD)
    }

    /// Returns the variance of the centre for white noise.
    fn white_variance(&self, y: &[f64], step: f64) -> f64 {
        let good = self.expected_good();
        let white = match self.modes {
            Some(modes) => variance_of_centre(&modes, y, &self.bad, step),
            None => self.width * self.width / good,
        };
        white * good / (good - 1.0)
    }

    /// Returns the weight of a measurement in the centre, before the weights are normalised.
    fn information(&self, i: usize) -> f64 {
        let factor = self.levels.as_ref().map_or(1.0, |levels| levels.factor[levels.block(i)]);
        factor * self.information_of_mode(i)
    }

    fn information_of_mode(&self, i: usize) -> f64 {
        match self.modes {
            Some(Modes { shape: Shape::Wide, width, bad, .. }) => {
                self.is_good(i) + self.bad[i] * (width / bad[0].width).powi(2)
            }
            _ => self.is_good(i),
        }
    }
}

impl Hypotheses {
    /// Computes the scores of a record.
    pub fn read(&mut self, y: &[f64], start: &Start) {
        let score = |v: &f64| ((v - start.centre) / start.scale).clamp(-MAX_SCORE, MAX_SCORE);
        self.score.clear();
        self.score.extend(y.iter().map(score));
    }

    /// Returns the mean `Σ w_m f_m` over the hypotheses.
    pub fn mean(&self, f: impl Fn(&Hypothesis) -> f64) -> f64 {
        self.list.iter().map(|h| h.weight * f(h)).sum()
    }

    /// Returns the mean with the weights for the variance.
    pub fn mean_of_variance(&self, f: impl Fn(&Hypothesis) -> f64) -> f64 {
        self.list.iter().map(|h| h.weight_of_variance * f(h)).sum()
    }

    /// Fits every hypothesis to the scores and weights it. `step` is the rounding step in scores,
    /// `correlation` that of the noise (`None`: unknown), and `moving` allows the level to change. O(N) for
    /// each EM step.
    pub fn fit(&mut self, step: f64, correlation: Option<f64>, moving: bool) {
        self.list.clear();
        let cut = std::mem::take(&mut self.score);
        self.add_all(&cut, step, true);
        self.correlate(0, &cut, correlation);
        if correlation.is_none() && moving && self.list.iter().any(|h| h.gain > 0.0) {
            let n = cut.len() as f64;
            let penalty = 0.5 * PENALTY_OF_LEVELS * n.ln();
            let correlated = self.best(n).is_some_and(|h| h.gain > 0.0);
            let errors = &mut self.autoregression;
            for size in slow::block_sizes(&cut, step, penalty, correlated, errors) {
                self.add_slow(&cut, step, size);
            }
            self.add_slow_noise(&cut);
        }
        self.score = cut;
        self.weigh(step);
    }

    /// Adds the clean hypothesis and the mixtures, the latter also with bursts if `bursts` is set.
    fn add_all(&mut self, y: &[f64], step: f64, bursts: bool) {
        let floor = [LEAST_WIDTH.max(LEAST_STEPS * step), LEAST_STEPS * step];
        self.add_clean(y, floor[0]);
        let totals = Totals {
            count: y.len() as f64,
            first: y.iter().sum(),
            second: y.iter().map(|v| v * v).sum(),
        };
        for shape in [Shape::OneSided, Shape::Wide, Shape::TwoSided] {
            let modes = self.independent(shape, y, &totals, floor);
            let last = self.add(modes, y);
            self.add_skewed(last, y);
            if bursts && self.persist(last) {
                let modes = self.sticky(modes, y, &totals, floor);
                let last = self.add(modes, y);
                self.add_mirror(last, y);
            }
            self.add_mirror(last, y);
        }
    }

    /// Estimates the correlation of the good measurements for each hypothesis from index `first` on.
    fn correlate(&mut self, first: usize, y: &[f64], correlation: Option<f64>) {
        for k in first..self.list.len() {
            let (before, rest) = self.list.split_at_mut(k);
            let h = &mut rest[0];
            (h.inflation, h.correlation) = (1.0, 0.0);
            if correlation == Some(0.0) {
                continue;
            }
            if let Some(same) = before[first..].iter().find(|other| other.keeps_as(h)) {
                (h.gain, h.inflation, h.correlation) =
                    (same.gain, same.inflation, same.correlation);
            } else {
                self.autoregression.read(h.kept(y), correlation);
                h.gain = self.autoregression.gain();
                h.inflation = self.autoregression.inflation();
                h.correlation = self.autoregression.correlation();
            }
            h.log_likelihood += h.gain;
        }
    }

    fn best(&self, n: f64) -> Option<&Hypothesis> {
        let weight = |h: &Hypothesis| h.log_weight(PENALTY, n);
        self.list.iter().max_by(|a, b| weight(a).total_cmp(&weight(b)))
    }

    /// Allows for slow noise about a constant level.
    fn add_slow_noise(&mut self, y: &[f64]) {
        let n = y.len() as f64;
        let mut known: Vec<(usize, Vec<(f64, SlowNoise)>)> = Vec::new();
        for k in 0..self.list.len() {
            let weight = |h: &Hypothesis| h.log_weight_of_sigma(n);
            let highest = self.list.iter().map(weight).fold(f64::NEG_INFINITY, f64::max);
            let h = &self.list[k];
            let counts = h.modes.is_none() || weight(h) > highest - FAR_BEHIND;
            if h.levels.is_none() && h.gain > 0.0 && counts {
                let same = known.iter().position(|(other, _)| self.list[*other].keeps_as(h));
                let at = same.unwrap_or_else(|| {
                    let values: Vec<(usize, f64)> = h.kept(y).collect();
                    known.push((k, SlowNoise::possible(&values)));
                    known.len() - 1
                });
                self.list[k].take(&known[at].1);
            }
        }
    }

    /// Adds the same hypotheses about a level that changes, with blocks of this size.
    fn add_slow(&mut self, y: &[f64], step: f64, size: usize) {
        let (constant, n) = (self.list.len(), y.len() as f64);
        let medians = Levels::medians(y, size);
        let (mut levels, mut residual, mut unit) = (medians.clone(), Vec::new(), 1.0);
        for round in 1..=ROUNDS {
            self.list.truncate(constant);
            levels.residuals(y, &medians, &mut residual);
            let Some(found) = start(&residual, step, &mut Vec::new()) else {
                return;
            };
            unit = found.scale;
            let score = |r: &f64| ((r - found.centre) / unit).clamp(-MAX_SCORE, MAX_SCORE);
            residual = residual.iter().map(score).collect();
            self.add_all(&residual, step / unit, round == ROUNDS);
            let moving = &mut self.list[constant..];
            if round < ROUNDS {
                normalise(moving, |h| h.log_weight(PENALTY, n), |h| &mut h.weight);
                let good = |i: usize| moving.iter().map(|h| h.weight * h.is_good(i)).sum();
                levels = levels.means(y, good);
            }
        }
        self.correlate(constant, &residual, None);
        for h in &mut self.list[constant..] {
            let levels = levels.means(y, |i| h.is_good(i));
            h.move_along(levels, &residual, unit, step / unit, &mut self.autoregression);
        }
    }

    fn add_clean(&mut self, y: &[f64], floor: f64) {
        let n = y.len() as f64;
        let (mean, squares) = mean_and_squares(y);
        let variance = (squares / n).max(floor * floor);
        let log_likelihood = -0.5 * (n * variance.ln() + squares / variance);
        self.list.push(Hypothesis {
            good_probability: vec![1.0; y.len()],
            log_likelihood,
            parameters: 2.0,
            value: mean,
            width: variance.sqrt(),
            ..Hypothesis::default()
        });
    }

    /// If about half of the record is bad, the data do not show which half. Adds the mixture in which the
    /// good and the bad measurements of a fitted one change places; it counts in sigma only.
    fn add_mirror(&mut self, which: usize, y: &[f64]) {
        let Some(modes) = self.list[which].modes.filter(|m| m.shape == Shape::OneSided) else {
            return;
        };
        let bad: f64 = self.list[which].bad.iter().sum();
        if bad > LEAST_OF_MIRROR * y.len() as f64 {
            let mirror = self.add(modes.mirrored(), y);
            self.list[mirror].doubt = true;
        }
    }

    /// If a bad mode is not apart from the good one, the data do not show whether its measurements are bad, or good
    /// ones with skewed noise. Adds the latter as a hypothesis that counts in sigma only.
    fn add_skewed(&mut self, which: usize, y: &[f64]) {
        let fitted = &self.list[which];
        let Some(modes) = fitted.modes.filter(|m| m.shape != Shape::Wide) else { return };
        let is_apart: Vec<bool> = (0..modes.kinds()).map(|j| modes.is_apart(j)).collect();
        if is_apart.iter().all(|apart| *apart) {
            return;
        }
        let is_good = |bad: &[f64]| {
            let bad = bad.iter().zip(&is_apart).filter(|(_, apart)| **apart);
            1.0 - bad.map(|(share, _)| share).sum::<f64>()
        };
        let good_probability: Vec<f64> =
            fitted.bad.chunks_exact(modes.kinds()).map(is_good).collect();
        let good: f64 = good_probability.iter().sum();
        let all = || good_probability.iter().zip(y);
        let centre = all().map(|(share, y)| share * y).sum::<f64>() / good;
        let square: f64 = all().map(|(share, y)| share * (y - centre).powi(2)).sum();
        self.list.push(Hypothesis {
            width: (square / good).sqrt(),
            good_probability,
            log_likelihood: fitted.log_likelihood,
            parameters: fitted.parameters,
            doubt: true,
            ..Hypothesis::default()
        });
    }

    /// Adds a fitted mixture; returns its index.
    fn add(&mut self, modes: Modes, y: &[f64]) -> usize {
        let mut bad = vec![0.0; y.len() * modes.kinds()];
        self.evidence.resize(y.len(), 0.0);
        let (log_likelihood, parameters) = if modes.persistence > 0.0 {
            let (_, found) = sticky::expect(&modes, y, &mut self.passes, &mut bad);
            (found, modes.shape.parameters() + 1.0)
        } else {
            let found = independent::posterior(&modes, y, &mut bad, &mut self.evidence);
            (found, modes.shape.parameters())
        };
        let good = |bad: &[f64]| 1.0 - bad.iter().sum::<f64>();
        self.list.push(Hypothesis {
            modes: Some(modes),
            good_probability: bad.chunks_exact(modes.kinds()).map(good).collect(),
            bad,
            log_likelihood,
            parameters,
            width: modes.width,
            ..Hypothesis::default()
        });
        self.list.len() - 1
    }

    fn independent(&mut self, shape: Shape, y: &[f64], totals: &Totals, floor: [f64; 2]) -> Modes {
        let step = |modes: &mut Modes| modes.update(&independent::expect(modes, y), totals, floor);
        let mut modes = match shape {
            Shape::Wide => wide(y),
            Shape::TwoSided => two_sided(y),
            Shape::OneSided => {
                let sides = [1.0, -1.0].map(|side| {
                    let mut modes = one_sided(y, side);
                    for _ in 0..STEPS_OF_SIDE {
                        step(&mut modes);
                    }
                    let mut bad = vec![0.0; y.len()];
                    self.evidence.resize(y.len(), 0.0);
                    (independent::posterior(&modes, y, &mut bad, &mut self.evidence), modes)
                });
                if sides[1].0 > sides[0].0 { sides[1].1 } else { sides[0].1 }
            }
        };
        converge(&mut modes, step);
        modes
    }

    fn sticky(&mut self, start: Modes, y: &[f64], totals: &Totals, floor: [f64; 2]) -> Modes {
        let mut modes = Modes { persistence: PERSISTENCE, ..start };
        converge(&mut modes, |modes| {
            let (sums, _) = sticky::expect(modes, y, &mut self.passes, &mut []);
            modes.update(&sums, totals, floor)
        });
        modes
    }

    /// Whether good measurements tend to follow good ones, and bad ones bad ones.
    fn persist(&self, which: usize) -> bool {
        let hypothesis = &self.list[which];
        let n = self.evidence.len();
        let share = hypothesis.good_probability.iter().sum::<f64>() / n as f64;
        let deviation = |i: usize| hypothesis.is_good(i) - share;
        let square: f64 = (0..n).map(|i| deviation(i).powi(2)).sum();
        let product: f64 = (1..n).map(|i| deviation(i) * deviation(i - 1)).sum();
        square > 0.0 && product / square * (n as f64).sqrt() >= LEAST_PERSISTENCE
    }

    /// Computes the weights, and the estimate and variance of each hypothesis that is kept.
    fn weigh(&mut self, step: f64) {
        let Self { score, list, .. } = self;
        let n = score.len() as f64;
        let weight = |h: &Hypothesis| match h.doubt {
            true => f64::NEG_INFINITY,
            false => h.log_weight(PENALTY, n),
        };
        let of_variance = |h: &Hypothesis| h.log_weight_of_sigma(n);
        normalise(list, weight, |h| &mut h.weight);
        normalise(list, of_variance, |h| &mut h.weight_of_variance);
        list.retain(|h| h.weight.max(h.weight_of_variance) > LEAST_WEIGHT);
        normalise(list, weight, |h| &mut h.weight);
        normalise(list, of_variance, |h| &mut h.weight_of_variance);
        for h in list.iter_mut() {
            h.good = h.expected_good();
            h.influence = (0..score.len()).map(|i| h.information(i)).collect();
            let all: f64 = h.influence.iter().sum();
            h.influence.iter_mut().for_each(|weight| *weight /= all);
            h.value = h.influence.iter().zip(&*score).map(|(weight, y)| weight * y).sum();
            if h.levels.is_none() {
                h.variance = h.white_variance(score, step);
            }
        }
    }
}

/// Computes weights from their logarithms, so that they sum to one.
fn normalise(
    list: &mut [Hypothesis],
    log_weight: impl Fn(&Hypothesis) -> f64,
    weight: impl Fn(&mut Hypothesis) -> &mut f64,
) {
    let highest = list.iter().map(&log_weight).fold(f64::NEG_INFINITY, f64::max);
    let total: f64 = list.iter().map(|h| (log_weight(h) - highest).exp()).sum();
    for h in list.iter_mut() {
        let found = (log_weight(h) - highest).exp() / total;
        *weight(h) = found;
    }
}

fn mean_and_squares(y: &[f64]) -> (f64, f64) {
    let moments = Moments::of("theta", y).map(|m| (m.mean(), m.sum_of_squares()));
    // scores are finite, and the squares of the measurements have been checked
    moments.unwrap_or((0.0, f64::INFINITY))
}
