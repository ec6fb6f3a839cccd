//! The robust rule: one filter for all plots, whose noise is found out.
//!
//! The noise variance of a plot is that stated times an unknown level; of a radar it changes
//! rarely. The variance of the prediction is that of the filter times an unknown level. All plots
//! of a step and the prediction bear witness of one error e of the predicted angle: every
//! combination of levels is a hypothesis under which e is normal, and is as probable as it makes
//! the plots. What several of them agree on is believed, be it that the others are noisy or that
//! the target manoeuvres.

use crate::kalman::{Filter, residual};

/// Noise variances of a radar over what it states.
const LEVELS: [f64; 5] = [0.25, 1.0, 4.0, 16.0, 64.0];
/// How probable they are where nothing is known of a radar: mostly as stated.
const AT_FIRST: [f64; 5] = [0.125, 0.5, 0.125, 0.125, 0.125];
/// That of a single outlier.
const OUTLIER: f64 = 256.0;
/// Variances of the prediction over what the filter says.
const MANOEUVRES: [f64; 2] = [1.0, 64.0];
/// How probable they are where nothing is known.
const MOSTLY_NONE: [f64; 2] = [0.999, 0.001];
/// Chance that a manoeuvre is over by the next step.
const MANOEUVRE_ENDS: f64 = 0.1;
/// So many hypotheses are followed from one plot of a step to the next: all of them for two radars.
const FOLLOWED: usize = 12;
/// The variance of e after the step is below that of the prediction by more than this share.
const LEAST_GAIN: f64 = 1e-3;

/// What is believed of the radars and of the motion.
#[derive(Clone, Debug)]
pub(super) struct Robust {
    /// Probabilities of each radar's levels.
    noise: Vec<[f64; LEVELS.len()]>,
    /// Probabilities of the prediction's.
    motion: [f64; MANOEUVRES.len()],
    change: f64,
    plots: Vec<Plot>,
    hypotheses: Vec<Hypothesis>,
}

/// What was found out about a radar's plot.
#[derive(Clone, Copy, Debug)]
pub(super) struct Judgement {
    pub outlier: bool,
    /// Share in the correction of this step.
    pub share: f64,
}

#[derive(Clone, Copy, Debug)]
struct Plot {
    radar: usize,
    innovation: f64,
    r: f64,
    /// Where the hypotheses of its levels begin.
    first: usize,
}

/// Levels of the prediction and of the plots so far.
#[derive(Clone, Copy, Debug)]
struct Hypothesis {
    /// The hypothesis of the plots before.
    parent: usize,
    /// Of the last plot; after [`LEVELS`] an outlier's.
    level: usize,
    /// Logarithm of the probability of levels and plots; then the probability of the levels.
    weight: f64,
    /// Of e.
    mean: f64,
    variance: f64,
    /// Weight times variance, of all its children.
    influence: f64,
}

impl Hypothesis {
    /// With one more plot, whose noise has the variance r and this probability.
    fn with(&self, parent: usize, level: usize, log_chance: f64, innovation: f64, r: f64) -> Self {
        let s = self.variance + r;
        let away = innovation - self.mean;
        Self {
            parent,
            level,
            weight: self.weight + log_chance - 0.5 * (away * away / s + s.ln()),
            mean: self.mean + self.variance / s * away,
            variance: self.variance * r / s,
            influence: 0.0,
        }
    }
}

/// The probabilities before a step, if with this chance everything is as at first.
fn renewed<const N: usize>(now: &[f64; N], at_first: &[f64; N], chance: f64) -> [f64; N] {
    std::array::from_fn(|i| now[i] + chance * (at_first[i] - now[i]))
}

impl Robust {
    pub fn new(radars: usize, change: f64) -> Self {
        Self {
            noise: vec![AT_FIRST; radars],
            motion: MOSTLY_NONE,
            change,
            plots: Vec::with_capacity(radars),
            hypotheses: Vec::new(),
        }
    }

    /// Everything that it believes, as lists of numbers.
    pub fn saved(&self) -> impl Iterator<Item = Vec<f64>> {
        std::iter::once(self.motion.to_vec()).chain(self.noise.iter().map(|noise| noise.to_vec()))
    }

    /// Takes back what was saved.
    pub fn restore<'a>(&mut self, lists: &mut impl Iterator<Item = &'a Vec<f64>>) -> Option<()> {
        self.motion = lists.next()?[..].try_into().ok()?;
        for noise in &mut self.noise {
            *noise = lists.next()?[..].try_into().ok()?;
        }
        Some(())
    }

    /// A radar's noise variance over what it states: the mean level, of logarithms.
    pub fn excess(&self, radar: usize) -> f64 {
        let log: f64 = self.noise[radar].iter().zip(LEVELS).map(|(p, level)| p * level.ln()).sum();
        log.exp()
    }

    /// Takes the plots z (nan: none) into the filter, which knows its state.
    pub fn update(
        &mut self,
        filter: &mut Filter,
        z: &[f64],
        r: &[f64],
        period: Option<f64>,
        mut tell: impl FnMut(usize, Judgement),
    ) {
        let state = filter.state();
        self.line_up(z, r, state.mean[0], period);
        if self.plots.is_empty() {
            return;
        }
        let prior = state.covariance[0];
        self.follow(prior);
        let (mean, variance) = self.weigh();
        self.learn(&mut tell);
        let expected: f64 = self.motion.iter().zip(MANOEUVRES).map(|(p, level)| p * level).sum();
        // all plots together are one, z* = x + ν* with the variance R*, after a prediction of so
        // much more variance
        let inflation = expected.max(variance / prior / (1.0 - LEAST_GAIN));
        let gain = 1.0 - variance / (inflation * prior);
        filter.correct(mean / gain, variance / gain, inflation);
    }

    /// The innovations, from the smallest one on, so that the order of the radars does not matter.
    /// The others are measured from the smallest, lest plots on both sides of a far prediction be
    /// turned away from each other.
    fn line_up(&mut self, z: &[f64], r: &[f64], predicted: f64, period: Option<f64>) {
        self.plots.clear();
        for (radar, (&z, &r)) in z.iter().zip(r).enumerate().filter(|(_, (z, _))| !z.is_nan()) {
            let innovation = residual(z, predicted, period);
            self.plots.push(Plot { radar, innovation, r, first: 0 });
        }
        let size = |plot: &Plot| plot.innovation.abs();
        self.plots.sort_by(|a, b| size(a).total_cmp(&size(b)));
        if let Some((first, others)) = self.plots.split_first_mut() {
            for plot in others {
                let away = residual(z[plot.radar], z[first.radar], period);
                plot.innovation = first.innovation + away;
            }
        }
    }

    /// All hypotheses about the plots, those that are followed: of the prediction's levels first,
    /// then of each plot's.
    fn follow(&mut self, prior: f64) {
        self.motion = renewed(&self.motion, &MOSTLY_NONE, MANOEUVRE_ENDS);
        self.hypotheses.clear();
        for (level, (&p, &excess)) in self.motion.iter().zip(&MANOEUVRES).enumerate() {
            let (weight, variance) = (p.ln(), prior * excess);
            let (parent, mean, influence) = (0, 0.0, 0.0);
            let new = Hypothesis { parent, level, weight, mean, variance, influence };
            self.hypotheses.push(new);
        }
        let mut start = 0;
        for plot in &mut self.plots {
            let noise = &mut self.noise[plot.radar];
            *noise = renewed(noise, &AT_FIRST, self.change);
            if self.hypotheses.len() - start > FOLLOWED {
                let last = &mut self.hypotheses[start..];
                last.select_nth_unstable_by(FOLLOWED - 1, |a, b| b.weight.total_cmp(&a.weight));
                self.hypotheses.truncate(start + FOLLOWED);
            }
            plot.first = self.hypotheses.len();
            let usual = (1.0 - self.change).ln();
            let chances = noise.map(|p| p.ln() + usual);
            for parent in start..plot.first {
                let before = self.hypotheses[parent];
                let with = |(level, (chance, excess)): (usize, (f64, f64))| {
                    before.with(parent, level, chance, plot.innovation, plot.r * excess)
                };
                let levels = chances.into_iter().zip(LEVELS);
                let outlier = (self.change.ln(), OUTLIER);
                let all = levels.chain(std::iter::once(outlier));
                self.hypotheses.extend(all.enumerate().map(with));
            }
            start = plot.first;
        }
    }

    /// Turns the weights into probabilities, those of the parents too; mean and variance of e.
    fn weigh(&mut self) -> (f64, f64) {
        let start = self.plots.last().map_or(0, |plot| plot.first);
        let (before, last) = self.hypotheses.split_at_mut(start);
        let largest = last.iter().map(|new| new.weight).fold(f64::NEG_INFINITY, f64::max);
        let mut sum = 0.0;
        for new in &mut *last {
            new.weight = (new.weight - largest).exp();
            sum += new.weight;
        }
        let mut mean = 0.0;
        for new in &mut *last {
            new.weight /= sum;
            new.influence = new.weight * new.variance;
            mean += new.weight * new.mean;
        }
        let spread = |new: &Hypothesis| new.influence + new.weight * (new.mean - mean).powi(2);
        let variance = last.iter().map(spread).sum();
        for old in before {
            (old.weight, old.influence) = (0.0, 0.0);
        }
        for at in (MANOEUVRES.len()..self.hypotheses.len()).rev() {
            let Hypothesis { parent, weight, influence, .. } = self.hypotheses[at];
            self.hypotheses[parent].weight += weight;
            self.hypotheses[parent].influence += influence;
        }
        (mean, variance)
    }

    /// Takes over the probabilities of levels, and tells of each plot. An outlier says nothing of
    /// its radar's level.
    fn learn(&mut self, tell: &mut impl FnMut(usize, Judgement)) {
        for (p, hypothesis) in self.motion.iter_mut().zip(&self.hypotheses) {
            *p = hypothesis.weight;
        }
        let ends = self.plots.iter().skip(1).map(|plot| plot.first);
        let ends: Vec<usize> = ends.chain(std::iter::once(self.hypotheses.len())).collect();
        // what a unit of each innovation moves e by
        let pull = |hypothesis: &Hypothesis, r: f64| {
            hypothesis.influence / (r * LEVELS.get(hypothesis.level).unwrap_or(&OUTLIER))
        };
        let of_plot = |plot: &Plot, end: usize| &self.hypotheses[plot.first..end];
        let pulls: Vec<f64> = self
            .plots
            .iter()
            .zip(&ends)
            .map(|(plot, &end)| of_plot(plot, end).iter().map(|h| pull(h, plot.r)).sum())
            .collect();
        let total: f64 = pulls.iter().sum();
        for ((plot, end), pull) in self.plots.iter().zip(ends).zip(pulls) {
            let mut of_levels = [0.0; LEVELS.len()];
            let mut outlier = 0.0;
            for hypothesis in of_plot(plot, end) {
                *of_levels.get_mut(hypothesis.level).unwrap_or(&mut outlier) += hypothesis.weight;
            }
            let noise = &mut self.noise[plot.radar];
            *noise = std::array::from_fn(|level| of_levels[level] + outlier * noise[level]);
            tell(plot.radar, Judgement { outlier: outlier > 0.5, share: pull / total });
        }
    }
}
