//! What a record may be: clean, or contaminated in one of several ways.

use super::acceleration::converge;
use super::independent;
use super::information::variance_of_centre;
use super::modes::{MOST_BAD, Mode, Modes, Shape, Totals};
use super::start::Start;
use super::sticky::{self, Passes};
use crate::base::autoregression::Autoregression;
use crate::base::moments::Moments;

/// Penalty per parameter over that of Schwarz (1978), `½ ln N`: his finds one-sided outliers of three
/// sigmas too late.
const PENALTY: f64 = 0.8;
/// The same for sigma: what is too doubtful to be left out may still be bad.
const PENALTY_OF_SIGMA: f64 = 0.4;
/// Beyond these distances values are taken for bad at the start: one kind, two kinds.
const FAR: f64 = 2.5;
const FAR_OF_TWO: f64 = 2.2;
/// Offset and widths of a bad mode at the start.
const OFFSET: f64 = 4.0;
const WIDTH: f64 = 1.5;
const WIDTH_OF_TWO: f64 = 1.2;
const LARGEST_START: f64 = 0.45;
const LARGEST_START_OF_TWO: f64 = 0.4;
const PERSISTENCE: f64 = 0.5;
/// Least width of the good mode, in units of the scale at the start, and of any mode in those of the
/// rounding step.
const LEAST_WIDTH: f64 = 0.3;
const LEAST_STEPS: f64 = 0.5;
/// Steps of EM for each side before one is chosen.
const STEPS_OF_SIDE: usize = 6;
/// Scores are cut here: farther values are bad whatever their distance.
pub(super) const MAX_SCORE: f64 = 1e3;
/// Lag-one correlation of the modes from which they may persist, in its standard errors.
const LEAST_PERSISTENCE: f64 = 1.5;
/// Share of bad measurements from which they may as well be the good ones.
const LEAST_OF_MIRROR: f64 = 0.45;
/// Hypotheses of less weight do not count.
const LEAST_WEIGHT: f64 = 1e-5;
/// Fewest good measurements in the degrees of freedom of a hypothesis.
const LEAST_GOOD: f64 = 2.5;

/// One hypothesis: a mixture, or none (clean).
#[derive(Clone, Debug, Default)]
pub(super) struct Hypothesis {
    pub modes: Option<Modes>,
    /// Probabilities of the bad modes of each measurement, as many as there are modes.
    pub bad: Vec<f64>,
    log_likelihood: f64,
    parameters: f64,
    /// Counts in the variance only.
    doubt: bool,
    /// Weight in the estimate, and in its variance.
    pub weight: f64,
    pub weight_of_variance: f64,
    /// Estimate, in scores, and its variance with white noise.
    pub value: f64,
    pub variance: f64,
    /// Standard deviation of good measurements.
    pub width: f64,
    /// Expected number of good measurements.
    pub good: f64,
    /// Variance of the mean of the good ones over that with white noise, and their correlation.
    pub inflation: f64,
    pub correlation: f64,
}

/// Buffers, and the hypotheses of the last record.
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
        self.log_likelihood - 0.5 * penalty * self.parameters * n.ln()
    }

    fn kinds(&self) -> usize {
        self.modes.map_or(0, |modes| modes.kinds())
    }

    /// Probability that a measurement is good.
    pub fn is_good(&self, i: usize) -> f64 {
        let kinds = self.kinds();
        1.0 - self.bad[i * kinds..(i + 1) * kinds].iter().sum::<f64>()
    }

    /// What a measurement counts in the centre, before division by their sum.
    pub fn information(&self, i: usize) -> f64 {
        match self.modes {
            Some(Modes { shape: Shape::Wide, width, bad, .. }) => {
                self.is_good(i) + self.bad[i] * (width / bad[0].width).powi(2)
            }
            Some(_) => self.is_good(i),
            None => 1.0,
        }
    }
}

impl Hypotheses {
    /// Takes the scores of a record.
    pub fn read(&mut self, y: &[f64], start: &Start) {
        let score = |v: &f64| ((v - start.centre) / start.scale).clamp(-MAX_SCORE, MAX_SCORE);
        self.score.clear();
        self.score.extend(y.iter().map(score));
    }

    /// `Σ w_m f_m` over the hypotheses.
    pub fn mean(&self, f: impl Fn(&Hypothesis) -> f64) -> f64 {
        self.list.iter().map(|h| h.weight * f(h)).sum()
    }

    /// The same with the weights for the variance.
    pub fn mean_of_variance(&self, f: impl Fn(&Hypothesis) -> f64) -> f64 {
        self.list.iter().map(|h| h.weight_of_variance * f(h)).sum()
    }

    /// Fits every hypothesis to the scores and weighs them; `step` is the rounding step in scores,
    /// `correlation` that of the noise (none: unknown). O(N) for each step of EM.
    pub fn fit(&mut self, step: f64, correlation: Option<f64>) {
        self.list.clear();
        let floor = [LEAST_WIDTH.max(LEAST_STEPS * step), LEAST_STEPS * step];
        self.add_clean(floor[0]);
        let cut = std::mem::take(&mut self.score);
        let totals = Totals {
            count: cut.len() as f64,
            first: cut.iter().sum(),
            second: cut.iter().map(|v| v * v).sum(),
        };
        for shape in [Shape::OneSided, Shape::Wide, Shape::TwoSided] {
            let modes = self.independent(shape, &cut, &totals, floor);
            let last = self.add(modes, &cut);
            if self.persist(last) {
                let modes = self.sticky(modes, &cut, &totals, floor);
                let last = self.add(modes, &cut);
                self.add_mirror(last, &cut);
            }
            self.add_mirror(last, &cut);
        }
        self.score = cut;
        self.weigh(step, correlation);
    }

    fn add_clean(&mut self, floor: f64) {
        let n = self.score.len() as f64;
        let (mean, squares) = mean_and_squares(&self.score);
        let variance = (squares / n).max(floor * floor);
        let log_likelihood = -0.5 * (n * variance.ln() + squares / variance);
        self.list.push(Hypothesis {
            log_likelihood,
            parameters: 2.0,
            value: mean,
            width: variance.sqrt(),
            ..Hypothesis::default()
        });
    }

    /// Where about half of the record is bad, nothing tells which half: adds the mixture in which the
    /// good and the bad measurements of a fitted one change places, to count in sigma.
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

    /// Adds a fitted mixture; returns its place.
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
        self.list.push(Hypothesis {
            modes: Some(modes),
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

    /// Whether good and bad measurements of a mixture follow their like.
    fn persist(&self, which: usize) -> bool {
        let hypothesis = &self.list[which];
        let n = self.evidence.len();
        let share = (0..n).map(|i| hypothesis.is_good(i)).sum::<f64>() / n as f64;
        let deviation = |i: usize| hypothesis.is_good(i) - share;
        let square: f64 = (0..n).map(|i| deviation(i).powi(2)).sum();
        let product: f64 = (1..n).map(|i| deviation(i) * deviation(i - 1)).sum();
        square > 0.0 && product / square * (n as f64).sqrt() >= LEAST_PERSISTENCE
    }

    /// Weights, and estimate, variance and correlation of each hypothesis that counts.
    fn weigh(&mut self, step: f64, correlation: Option<f64>) {
        let Self { score, list, autoregression, .. } = self;
        for h in list.iter_mut() {
            (h.inflation, h.correlation) = (1.0, 0.0);
            if correlation != Some(0.0) {
                let kept = (0..score.len()).filter(|&i| h.is_good(i) > 0.5);
                autoregression.read(kept.map(|i| (i, score[i])), correlation);
                h.log_likelihood += autoregression.gain();
                h.inflation = autoregression.inflation();
                h.correlation = autoregression.correlation();
            }
        }
        let n = score.len() as f64;
        let weight = |h: &Hypothesis| match h.doubt {
            true => f64::NEG_INFINITY,
            false => h.log_weight(PENALTY, n),
        };
        let of_variance = |h: &Hypothesis| h.log_weight(PENALTY_OF_SIGMA, n);
        normalise(list, weight, |h| &mut h.weight);
        normalise(list, of_variance, |h| &mut h.weight_of_variance);
        list.retain(|h| h.weight.max(h.weight_of_variance) > LEAST_WEIGHT);
        normalise(list, weight, |h| &mut h.weight);
        normalise(list, of_variance, |h| &mut h.weight_of_variance);
        for h in list.iter_mut() {
            h.good = (0..score.len()).map(|i| h.is_good(i)).sum::<f64>().max(LEAST_GOOD);
            let information = |i: usize| h.information(i);
            let all: f64 = (0..score.len()).map(information).sum();
            let value = |i: usize| information(i) * score[i];
            h.value = (0..score.len()).map(value).sum::<f64>() / all;
            let white = match h.modes {
                Some(modes) => variance_of_centre(&modes, score, &h.bad, step),
                None => h.width * h.width / h.good,
            };
            h.variance = white * h.good / (h.good - 1.0);
        }
    }
}

/// Weights by their logarithms, so that they sum to one.
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
    // scores are finite, and their squares were checked with the measurements
    moments.unwrap_or((0.0, f64::INFINITY))
}

/// Number, sum and sum of squares of the values beyond a limit on one side (±1) or on both (0).
fn beyond(y: &[f64], limit: f64, side: f64) -> (f64, f64, f64) {
    let hit = |v: &&f64| if side == 0.0 { v.abs() > limit } else { *v * side > limit };
    let add = |(n, s, q): (f64, f64, f64), v: &f64| (n + 1.0, s + v, q + v * v);
    y.iter().filter(hit).fold((0.0, 0.0, 0.0), add)
}

fn modes(shape: Shape, bad: [Mode; MOST_BAD]) -> Modes {
    Modes { shape, centre: 0.0, width: 1.0, bad, persistence: 0.0 }
}

fn offset(count: f64, sum: f64, side: f64) -> f64 {
    if count > 0.0 { sum / count } else { side * OFFSET }
}

fn one_sided(y: &[f64], side: f64) -> Modes {
    let n = y.len() as f64;
    let (count, sum, _) = beyond(y, FAR, side);
    let share = (count / n).clamp(1.0 / n, LARGEST_START);
    let bad = Mode { offset: offset(count, sum, side), width: WIDTH, share };
    modes(Shape::OneSided, [bad, Mode::default()])
}

fn wide(y: &[f64]) -> Modes {
    let n = y.len() as f64;
    let (count, _, squares) = beyond(y, FAR, 0.0);
    let share = (count / n).clamp(1.0 / n, LARGEST_START);
    let width = (squares / count.max(1.0)).sqrt().max(OFFSET);
    modes(Shape::Wide, [Mode { offset: 0.0, width, share }, Mode::default()])
}

fn two_sided(y: &[f64]) -> Modes {
    let n = y.len() as f64;
    let bad = [1.0, -1.0].map(|side| {
        let (count, sum, _) = beyond(y, FAR_OF_TWO, side);
        let share = (count / n).clamp(0.5 / n, LARGEST_START_OF_TWO);
        Mode { offset: offset(count, sum, side), width: WIDTH_OF_TWO, share }
    });
    modes(Shape::TwoSided, bad)
}
