//! The robust rule: one filter for all plots, which estimates their noise.
//!
//! The noise variance of a plot is the stated one times an unknown level, which rarely changes for a
//! radar. The variance of the prediction is that of the filter times an unknown level. All plots of
//! a step and the prediction measure one error e of the predicted angle: every combination of levels
//! is a hypothesis under which e is normal, weighted by the likelihood of the plots. Plots that agree
//! outweigh those that do not, be it that a radar is noisy or that the target manoeuvres.
//!
//! Hypotheses that disagree on e are followed apart, each with a state of its own: of two radars
//! whose plots contradict each other, a track that follows the worse one is soon contradicted by its
//! own predictions. One common track would not be, because its covariance includes both.

use super::levels::{MANOEUVRES, NOISE};
use super::mixture::{Component, reduce, united};
use crate::kalman::{Filter, Transition, residual};

/// Their probabilities where nothing is known of a radar: mostly as stated.
const AT_FIRST: [f64; NOISE.len()] = [0.125, 0.5, 0.125, 0.125, 0.125];
/// Those of a plot: its radar's, and a single outlier's.
const EXCESSES: [f64; NOISE.len() + 1] = [0.25, 1.0, 4.0, 16.0, 64.0, 256.0];
/// Their probabilities where nothing is known.
const MOSTLY_NONE: [f64; MANOEUVRES.len()] = [0.999, 0.001];
/// Chance that a manoeuvre is over by the next step.
const MANOEUVRE_ENDS: f64 = 0.1;
/// So many hypotheses are followed from one plot of a step to the next, at most.
const FOLLOWED: usize = 12;
/// Those with this share of the most probable one's probability, or less, are not.
const NEGLIGIBLE: f64 = 1e-5;
/// The variance of e after the step is below that of the prediction by more than this share.
const LEAST_GAIN: f64 = 1e-3;
/// Hypotheses disagree if the square of their distance is above so many sums of their variances.
const DISAGREEMENT: f64 = 1.0;
/// Only hypotheses with this share of the most probable one's probability begin a cluster.
const LEAST_SHARE: f64 = 0.02;
/// So many clusters are made in a step.
const CLUSTERS: usize = 5;
/// So many components are followed from one step to the next.
const COMPONENTS: usize = 3;
/// Components are united if that loses so little of their information, in nats.
const AGREEMENT: f64 = 0.01;

/// The probabilities of the radars' noise levels and of the motion.
#[derive(Clone, Debug)]
pub(super) struct Robust {
    /// The most probable one first.
    components: Vec<Component>,
    change: f64,
    plots: Vec<Plot>,
    hypotheses: Vec<Hypothesis>,
    clusters: Vec<Cluster>,
    /// Probabilities of each plot's levels, cluster by cluster.
    of_levels: Vec<[f64; EXCESSES.len()]>,
}

/// The judgement of a radar's plot.
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
    /// Of each level: the variance of e under it, times its probability.
    effects: [f64; EXCESSES.len()],
    /// Probability that it is one.
    outlier: f64,
}

impl Plot {
    /// What a unit of its innovation moves e by.
    fn pull(&self) -> f64 {
        self.effects.iter().zip(EXCESSES).map(|(effect, excess)| effect / (self.r * excess)).sum()
    }
}

/// A component, and levels of its prediction and of the plots so far.
#[derive(Clone, Copy, Debug)]
struct Hypothesis {
    component: usize,
    /// The hypothesis of the plots before.
    parent: usize,
    /// Of the last plot.
    level: usize,
    /// Probability of levels and plots, over that of the most probable one.
    weight: f64,
    /// Square of the last plot's distance, over its variance.
    square: f64,
    /// Of e.
    mean: f64,
    variance: f64,
    /// After the last plot.
    cluster: Option<usize>,
}

impl Hypothesis {
    /// With one more plot, whose noise has the variance r and this probability. How well the plot
    /// fits is in `square` alone.
    fn with(&self, parent: usize, level: usize, chance: f64, innovation: f64, r: f64) -> Self {
        let s = self.variance + r;
        let away = innovation - self.mean;
        let share = self.variance / s;
        Self {
            parent,
            level,
            weight: self.weight * chance / s.sqrt(),
            square: away * away / s,
            mean: self.mean + share * away,
            variance: share * r,
            ..*self
        }
    }

    /// Square of the distance from another one, over the sum of the variances.
    fn distance(&self, other: &Self) -> f64 {
        (self.mean - other.mean).powi(2) / (self.variance + other.variance)
    }

    /// Whether their e differ significantly.
    fn disagrees(&self, other: &Self) -> bool {
        self.distance(other) > DISAGREEMENT
    }
}

/// Hypotheses of one component that agree on e.
#[derive(Clone, Copy, Debug)]
struct Cluster {
    /// The most probable one.
    centre: Hypothesis,
    /// The component that it becomes.
    component: usize,
    /// Probability, and what it says of e.
    weight: f64,
    mean: f64,
    variance: f64,
}

/// The probabilities before a step, if with this chance everything is as at first.
fn renewed<const N: usize>(now: &[f64; N], at_first: &[f64; N], chance: f64) -> [f64; N] {
    std::array::from_fn(|i| now[i] + chance * (at_first[i] - now[i]))
}

impl Robust {
    pub fn new(radars: usize, change: f64) -> Self {
        let component = Component {
            weight: 1.0,
            filter: Filter::new(0.0, None),
            noise: vec![AT_FIRST; radars],
            motion: MOSTLY_NONE,
        };
        Self {
            components: vec![component],
            change,
            plots: Vec::with_capacity(radars),
            hypotheses: Vec::new(),
            clusters: Vec::with_capacity(CLUSTERS),
            of_levels: Vec::with_capacity(radars),
        }
    }

    /// Its whole state, as lists of numbers.
    pub fn saved(&self) -> impl Iterator<Item = Vec<f64>> {
        let count = vec![self.components.len() as f64];
        std::iter::once(count).chain(self.components.iter().flat_map(Component::saved))
    }

    /// Takes back what was saved.
    pub fn restore<'a>(&mut self, lists: &mut impl Iterator<Item = &'a Vec<f64>>) -> Option<()> {
        let [count] = lists.next()?[..].try_into().ok()?;
        let count = (1..=COMPONENTS).find(|&possible| possible as f64 == count)?;
        let pattern = self.components[0].clone();
        self.components.resize(count, pattern);
        self.components.iter_mut().try_for_each(|component| component.restore(lists))
    }

    /// A radar's noise variance over what it states: the mean level, of logarithms.
    pub fn excess(&self, radar: usize) -> f64 {
        let of_component = |component: &Component| component.weight * component.log_excess(radar);
        self.components.iter().map(of_component).sum::<f64>().exp()
    }

    /// Goes on in time. The filter of a single component is that given to [`Robust::update`].
    pub fn predict(&mut self, transition: &Transition) {
        if self.components.len() > 1 {
            for component in &mut self.components {
                component.filter.predict(transition);
            }
        }
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
        if let [single] = &mut self.components[..] {
            single.filter = *filter;
        }
        let predicted = self.components[0].filter.state().mean[0];
        self.line_up(z, r, predicted, period);
        if self.plots.is_empty() {
            return;
        }
        self.begin(predicted, period);
        self.follow();
        self.divide();
        self.sum_up();
        self.assign();
        self.learn();
        self.correct();
        reduce(&mut self.components, COMPONENTS, AGREEMENT, period);
        *filter = united(&self.components, period);
        let total: f64 = self.plots.iter().map(Plot::pull).sum();
        for plot in &self.plots {
            let judgement = Judgement { outlier: plot.outlier > 0.5, share: plot.pull() / total };
            tell(plot.radar, judgement);
        }
    }

    /// The innovations, from the smallest one on, so that the order of the radars does not matter.
    /// The others are measured from the smallest, lest plots on both sides of a far prediction be
    /// turned away from each other.
    fn line_up(&mut self, z: &[f64], r: &[f64], predicted: f64, period: Option<f64>) {
        self.plots.clear();
        for (radar, (&z, &r)) in z.iter().zip(r).enumerate().filter(|(_, (z, _))| !z.is_nan()) {
            let innovation = residual(z, predicted, period);
            let effects = [0.0; EXCESSES.len()];
            self.plots.push(Plot { radar, innovation, r, first: 0, effects, outlier: 0.0 });
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

    /// The hypotheses before the plots: each component with each level of its prediction.
    fn begin(&mut self, predicted: f64, period: Option<f64>) {
        self.hypotheses.clear();
        for (index, component) in self.components.iter_mut().enumerate() {
            component.motion = renewed(&component.motion, &MOSTLY_NONE, MANOEUVRE_ENDS);
            for plot in &self.plots {
                let noise = &mut component.noise[plot.radar];
                *noise = renewed(noise, &AT_FIRST, self.change);
            }
            let state = component.filter.state();
            for (level, (p, excess)) in component.motion.iter().zip(MANOEUVRES).enumerate() {
                self.hypotheses.push(Hypothesis {
                    component: index,
                    parent: 0,
                    level,
                    weight: component.weight * p,
                    square: 0.0,
                    mean: residual(state.mean[0], predicted, period),
                    variance: state.covariance[0] * excess,
                    cluster: None,
                });
            }
        }
    }

    /// All hypotheses about the plots, those that are followed.
    fn follow(&mut self) {
        let mut start = 0;
        for plot in &mut self.plots {
            if self.hypotheses.len() - start > FOLLOWED {
                let last = &mut self.hypotheses[start..];
                last.select_nth_unstable_by(FOLLOWED - 1, |a, b| b.weight.total_cmp(&a.weight));
                self.hypotheses.truncate(start + FOLLOWED);
            }
            plot.first = self.hypotheses.len();
            let mut chances = [[self.change; NOISE.len() + 1]; COMPONENTS];
            for (chances, component) in chances.iter_mut().zip(&self.components) {
                for (chance, p) in chances.iter_mut().zip(component.noise[plot.radar]) {
                    *chance = (1.0 - self.change) * p;
                }
            }
            let noise = EXCESSES.map(|excess| plot.r * excess);
            for parent in start..plot.first {
                let before = self.hypotheses[parent];
                let all = chances[before.component].into_iter().zip(noise).enumerate();
                self.hypotheses.extend(all.map(|(level, (chance, r))| {
                    before.with(parent, level, chance, plot.innovation, r)
                }));
            }
            weigh(&mut self.hypotheses[plot.first..]);
            self.hypotheses.extract_if(plot.first.., |h| h.weight <= NEGLIGIBLE).for_each(drop);
            start = plot.first;
        }
    }

    /// Where the hypotheses of all plots begin.
    fn last(&self) -> usize {
        self.plots.last().map_or(0, |plot| plot.first)
    }

    /// Makes clusters of the hypotheses of each component: around the most probable one, and around
    /// the most probable of those that disagree with it. Those that are left belong to the nearest;
    /// components that begin none are given up. A covariance that is kept as factors is not divided.
    fn divide(&mut self) {
        self.clusters.clear();
        let start = self.last();
        let last = &mut self.hypotheses[start..];
        while self.clusters.len() < CLUSTERS {
            let least = self.clusters.first().map(|first| LEAST_SHARE * first.centre.weight);
            let left = last
                .iter()
                .filter(|h| h.cluster.is_none() && least.is_none_or(|least| h.weight > least));
            let most_probable = left.max_by(|a, b| a.weight.total_cmp(&b.weight));
            let Some(&centre) = most_probable else { break };
            let component = centre.component;
            let whole = self.components[component].filter.plain().is_none();
            for h in last.iter_mut().filter(|h| h.component == component && h.cluster.is_none()) {
                if whole || !h.disagrees(&centre) {
                    h.cluster = Some(self.clusters.len());
                }
            }
            self.clusters.push(Cluster {
                centre,
                component,
                weight: 0.0,
                mean: 0.0,
                variance: 0.0,
            });
        }
        for h in last.iter_mut().filter(|h| h.cluster.is_none()) {
            let own = |(_, cluster): &(usize, &Cluster)| cluster.component == h.component;
            let distance = |cluster: &Cluster| h.distance(&cluster.centre);
            let of_component = self.clusters.iter().enumerate().filter(own);
            let nearest = of_component.min_by(|a, b| distance(a.1).total_cmp(&distance(b.1)));
            h.cluster = nearest.map(|(index, _)| index);
        }
    }

    /// Turns weights into probabilities; probability, mean and variance of the clusters.
    fn sum_up(&mut self) {
        let start = self.last();
        let kept = || self.hypotheses[start..].iter().filter(|h| h.cluster.is_some());
        let total: f64 = kept().map(|h| h.weight).sum();
        for h in &mut self.hypotheses[start..] {
            let Some(index) = h.cluster else { continue };
            h.weight /= total;
            let cluster = &mut self.clusters[index];
            let away = h.mean - cluster.centre.mean;
            cluster.weight += h.weight;
            cluster.mean += h.weight * away;
            cluster.variance += h.weight * (h.variance + away * away);
        }
        for cluster in &mut self.clusters {
            let away = cluster.mean / cluster.weight;
            let predicted = self.hypotheses[MANOEUVRES.len() * cluster.component].mean;
            cluster.mean = cluster.centre.mean - predicted + away;
            cluster.variance = cluster.variance / cluster.weight - away * away;
        }
    }

    /// Gives each cluster a component: its own, or a copy if that is another cluster's.
    fn assign(&mut self) {
        for component in &mut self.components {
            component.weight = 0.0;
        }
        for cluster in &mut self.clusters {
            if self.components[cluster.component].weight != 0.0 {
                let copy = self.components[cluster.component].clone();
                cluster.component = self.components.len();
                self.components.push(copy);
            }
            let component = &mut self.components[cluster.component];
            component.weight = cluster.weight;
            component.motion.fill(0.0);
        }
    }

    /// Updates the probabilities of levels, of the clusters' components and of the plots. An outlier
    /// says nothing about its radar's level.
    fn learn(&mut self) {
        let (start, width) = (self.last(), self.plots.len());
        self.of_levels.clear();
        self.of_levels.resize(width * self.clusters.len(), [0.0; EXCESSES.len()]);
        for h in &self.hypotheses[start..] {
            let Some(index) = h.cluster else { continue };
            let cluster = &self.clusters[index];
            let (share, effect) = (h.weight / cluster.weight, h.weight * h.variance);
            let of_levels = &mut self.of_levels[width * index..][..width];
            let mut at = h;
            for (plot, of_levels) in self.plots.iter_mut().zip(of_levels).rev() {
                of_levels[at.level] += share;
                plot.effects[at.level] += effect;
                at = &self.hypotheses[at.parent];
            }
            self.components[cluster.component].motion[at.level] += share;
        }
        for (cluster, of_levels) in self.clusters.iter().zip(self.of_levels.chunks(width)) {
            let component = &mut self.components[cluster.component];
            for (plot, [of_levels @ .., outlier]) in self.plots.iter_mut().zip(of_levels) {
                plot.outlier += outlier * cluster.weight;
                let noise = &mut component.noise[plot.radar];
                *noise = std::array::from_fn(|level| of_levels[level] + outlier * noise[level]);
            }
        }
    }

    /// Corrects the components by their clusters; without one they are given up. An angle that is
    /// known exactly needs no correction.
    fn correct(&mut self) {
        for cluster in &self.clusters {
            let Component { filter, motion, .. } = &mut self.components[cluster.component];
            let prior = filter.state().covariance[0];
            if prior == 0.0 {
                continue;
            }
            let expected: f64 = motion.iter().zip(MANOEUVRES).map(|(p, level)| p * level).sum();
            // all plots together are one, z* = x + ν* with the variance R*, after a prediction of
            // so much more variance
            let inflation = expected.max(cluster.variance / prior / (1.0 - LEAST_GAIN));
            let gain = 1.0 - cluster.variance / (inflation * prior);
            filter.correct(cluster.mean / gain, cluster.variance / gain, inflation);
        }
        self.components.retain(|component| component.weight != 0.0);
    }
}

/// Multiplies the weights by how well the last plot fits, and divides them by the largest.
fn weigh(hypotheses: &mut [Hypothesis]) {
    let possible = hypotheses.iter().filter(|h| h.weight > 0.0);
    let least = possible.map(|h| h.square).fold(f64::INFINITY, f64::min);
    let mut largest = 0.0;
    for h in &mut *hypotheses {
        h.weight *= (0.5 * (least - h.square)).exp();
        largest = h.weight.max(largest);
    }
    for h in hypotheses {
        h.weight /= largest;
    }
}
