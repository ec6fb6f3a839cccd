//! The robust rule: one filter for all plots, which also estimates their noise.
//!
//! The noise variance of a plot is the stated one times an unknown level, which rarely changes for a
//! radar. The variance of the prediction is that of the filter times an unknown level. The prediction
//! and all plots of a step measure the same quantity e, the error of the predicted angle. Each
//! combination of levels is a hypothesis under which e is normal, weighted by the likelihood of the
//! plots. Plots that agree outweigh plots that do not, whether a radar is noisy or the target
//! manoeuvres.
//!
//! Hypotheses that disagree on e are followed separately, each with its own state. If the plots of two
//! radars contradict each other, a track that follows the worse radar is soon contradicted by its own
//! predictions. A single common track would not be contradicted, because its covariance includes both.

use super::clusters::Clusters;
use super::hypotheses::{Followed, Row, Spread, trace};
use super::levels::{EXCESSES, MANOEUVRES, NOISE, OUTLIERS};
use super::mixture::{Component, reduce, united};
use crate::base::scratch::refill;
use crate::kalman::{Filter, Transition, residual};
use pulp::{Arch, Simd, WithSimd};

/// Prior probabilities of the noise levels of a radar: mostly as stated.
const AT_FIRST: [f64; NOISE.len()] = [0.125, 0.5, 0.125, 0.125, 0.125];
/// Prior probabilities of the levels of the prediction: mostly no manoeuvre.
const MOSTLY_NONE: [f64; MANOEUVRES.len()] = [0.999, 0.001];
/// Probability that a manoeuvre has ended by the next step.
const MANOEUVRE_ENDS: f64 = 0.1;
/// The variance of e after a step is smaller than that of the prediction by at least this share.
const LEAST_GAIN: f64 = 1e-3;
/// Largest number of components that are followed from one step to the next.
const COMPONENTS: usize = 3;
/// Largest difference of plots that agree, in standard deviations.
const ALIKE: f64 = 5.0;
/// Components are merged if this loses no more than this much information, in nats.
const AGREEMENT: f64 = 0.01;

/// The robust rule: the components, with the probabilities of noise levels and motion.
#[derive(Clone, Debug)]
pub(super) struct Robust {
    /// The components, the most probable one first.
    components: Vec<Component>,
    change: f64,
    plots: Vec<Plot>,
    /// The hypotheses before each plot.
    followed: Vec<Followed>,
    /// The hypotheses after the last plot.
    last: Box<Spread>,
    clusters: Clusters,
    /// Variances of e under the hypotheses after the last plot, times the probabilities of these.
    effects: Vec<Row>,
    /// Sums over the hypotheses for the levels of each plot.
    of_levels: Vec<[f64; EXCESSES.len()]>,
}

/// The assessment of a radar's plot.
#[derive(Clone, Copy, Debug)]
pub(super) struct Judgement {
    pub outlier: bool,
    /// Share of the plot in the correction of this step.
    pub share: f64,
}

#[derive(Clone, Copy, Debug)]
struct Plot {
    radar: usize,
    innovation: f64,
    r: f64,
    /// Probability that the plot is an outlier.
    outlier: f64,
    /// Change of e per unit of the plot's innovation.
    pull: f64,
}

/// Runs [`Robust::judge`] with the widest vectors of the processor.
struct Judge<'a>(&'a mut Robust);

impl WithSimd for Judge<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        self.0.judge();
    }
}

/// Prior probabilities of a step, if this is the chance of a reset to the initial probabilities.
fn renewed<const N: usize>(now: &[f64; N], at_first: &[f64; N], chance: f64) -> [f64; N] {
    std::array::from_fn(|i| now[i] + chance * (at_first[i] - now[i]))
}

/// Variances with which the plots of a step begin a state: before there is a prediction, the plots alone can tell
/// outliers. Plots that contradict a plot with which more than half of them agree are left out (∞); if there is
/// no such plot, any may be wrong, and all have the variance of their largest difference. Cost O(K²).
pub(super) fn first_variances(z: &[f64], r: &[f64], period: Option<f64>) -> Vec<f64> {
    let all = 0..z.len();
    let apart = |i: usize, j: usize| residual(z[j], z[i], period).powi(2);
    // the comparison fails for missing plots
    let agrees = |i: usize, j: usize| apart(i, j) <= ALIKE * ALIKE * (r[i] + r[j]);
    let support = |i: usize| all.clone().filter(|&j| agrees(i, j)).count();
    let best = all.clone().map(|i| (support(i), i)).max_by_key(|(count, i)| (*count, z.len() - i));
    let seen = z.iter().filter(|z| !z.is_nan()).count();
    match best.filter(|(count, _)| 2 * count > seen) {
        Some((_, centre)) => {
            all.map(|j| if agrees(centre, j) { r[j] } else { f64::INFINITY }).collect()
        }
        None => {
            let pairs = all.clone().flat_map(|i| all.clone().map(move |j| (i, j)));
            let largest = pairs.map(|(i, j)| apart(i, j)).fold(0.0, f64::max);
            r.iter().map(|r| r + 0.5 * largest).collect()
        }
    }
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
            followed: vec![Followed::NONE; radars],
            last: Box::new(Spread::NONE),
            clusters: Clusters::default(),
            effects: Vec::new(),
            of_levels: Vec::with_capacity(radars),
        }
    }

    /// Returns the complete state as lists of numbers.
    pub fn saved(&self) -> impl Iterator<Item = Vec<f64>> {
        let count = vec![self.components.len() as f64];
        std::iter::once(count).chain(self.components.iter().flat_map(Component::saved))
    }

    /// Restores the state from saved lists.
    pub fn restore<'a>(&mut self, lists: &mut impl Iterator<Item = &'a Vec<f64>>) -> Option<()> {
        let [count] = lists.next()?[..].try_into().ok()?;
        let count = (1..=COMPONENTS).find(|&possible| possible as f64 == count)?;
        let pattern = self.components[0].clone();
        self.components.resize(count, pattern);
        self.components.iter_mut().try_for_each(|component| component.restore(lists))
    }

    /// Geometric mean level of a radar: its noise variance relative to the stated one.
    pub fn excess(&self, radar: usize) -> f64 {
        let of_component = |component: &Component| component.weight * component.log_excess(radar);
        self.components.iter().map(of_component).sum::<f64>().exp()
    }

    /// Predicts the components to the next step. A single component has the filter of [`Robust::update`].
    pub fn predict(&mut self, transition: &Transition) {
        if self.components.len() > 1 {
            for component in &mut self.components {
                component.filter.predict(transition);
            }
        }
    }

    /// Updates the filter, whose state must be known, with the plots z (nan: no plot).
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
        Arch::new().dispatch(Judge(self));
        if self.clusters.all.is_empty() {
            return;
        }
        self.correct();
        reduce(&mut self.components, COMPONENTS, AGREEMENT, period);
        *filter = united(&self.components, period);
        let total: f64 = self.plots.iter().map(|plot| plot.pull).sum();
        for plot in &self.plots {
            let judgement = Judgement { outlier: plot.outlier > 0.5, share: plot.pull / total };
            tell(plot.radar, judgement);
        }
    }

    /// Computes the innovations and sorts them by size, so that the order of the radars does not matter.
    /// All others are unwrapped about the smallest one, so that plots on both sides of a distant prediction
    /// are not wrapped away from each other.
    fn line_up(&mut self, z: &[f64], r: &[f64], predicted: f64, period: Option<f64>) {
        self.plots.clear();
        for (radar, (&z, &r)) in z.iter().zip(r).enumerate().filter(|(_, (z, _))| !z.is_nan()) {
            let innovation = residual(z, predicted, period);
            self.plots.push(Plot { radar, innovation, r, outlier: 0.0, pull: 0.0 });
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

    /// Sets the hypotheses before the plots: each component with each level of its prediction.
    fn begin(&mut self, predicted: f64, period: Option<f64>) {
        let first = &mut self.followed[0];
        first.count = 0;
        for (index, component) in self.components.iter_mut().enumerate() {
            component.motion = renewed(&component.motion, &MOSTLY_NONE, MANOEUVRE_ENDS);
            for plot in &self.plots {
                let noise = &mut component.noise[plot.radar];
                *noise = renewed(noise, &AT_FIRST, self.change);
            }
            let state = component.filter.state();
            let away = residual(state.mean[0], predicted, period);
            for (level, (p, excess)) in component.motion.iter().zip(MANOEUVRES).enumerate() {
                first.begin(
                    index,
                    level,
                    component.weight * p,
                    (away, state.covariance[0] * excess),
                );
            }
        }
    }

    /// Updates the distribution of e and the probabilities of all levels with the plots.
    #[inline(always)]
    fn judge(&mut self) {
        self.follow();
        let whole = |index: usize| self.components[index].filter.plain().is_none();
        self.clusters.divide(&self.last, &self.followed[self.plots.len() - 1], whole);
        self.assign();
        self.learn();
    }

    /// Makes the hypotheses about all plots, as far as they are followed.
    #[inline(always)]
    fn follow(&mut self) {
        for (at, plot) in self.plots.iter().enumerate() {
            let mut chances: [Row; COMPONENTS] = [[0.0; _]; COMPONENTS];
            for (chances, component) in chances.iter_mut().zip(&self.components) {
                for (chance, p) in chances.iter_mut().zip(component.noise[plot.radar]) {
                    *chance = (1.0 - self.change) * p;
                }
                for (chance, share) in chances[NOISE.len()..].iter_mut().zip(OUTLIERS) {
                    *chance = self.change * share;
                }
            }
            let (before, after) = self.followed[..self.plots.len()].split_at_mut(at + 1);
            self.last.fill(&before[at], plot.innovation, plot.r, &chances);
            if let Some(after) = after.first_mut() {
                after.choose(&self.last, &before[at]);
            }
        }
    }

    /// Assigns a component to each cluster: its own, or a copy if another cluster has already taken it.
    fn assign(&mut self) {
        for component in &mut self.components {
            component.weight = 0.0;
        }
        for cluster in &mut self.clusters.all {
            // relative to the prediction of its component
            let (component, count) = (cluster.component, self.followed[0].count);
            let own = |i: &usize| usize::from(self.followed[0].component[*i]) == component;
            cluster.mean -= (0..count).find(own).map_or(0.0, |i| self.followed[0].mean[i]);
            if self.components[component].weight != 0.0 {
                let copy = self.components[component].clone();
                cluster.component = self.components.len();
                self.components.push(copy);
            }
            let component = &mut self.components[cluster.component];
            component.weight = cluster.weight;
            component.motion.fill(0.0);
        }
    }

    /// Updates the probabilities of the levels, of the clusters' components and of the plots. An outlier
    /// gives no information on the level of its radar.
    #[inline(always)]
    fn learn(&mut self) {
        let followed = &self.followed[..self.plots.len()];
        refill(&mut self.effects, self.last.weights().len(), Row::default());
        for (cluster, members) in self.clusters.members() {
            let component = &mut self.components[cluster.component];
            let mut motion = [0.0; MANOEUVRES.len()];
            refill(&mut self.of_levels, followed.len(), [0.0; EXCESSES.len()]);
            trace(followed, members, &mut self.of_levels, &mut motion);
            component.motion = motion.map(|p| p / cluster.weight);
            for (plot, of_levels) in self.plots.iter_mut().zip(&self.of_levels) {
                let of_levels = of_levels.map(|p| p / cluster.weight);
                let outlier: f64 = of_levels[NOISE.len()..].iter().sum();
                plot.outlier += outlier * cluster.weight;
                let noise = &mut component.noise[plot.radar];
                *noise = std::array::from_fn(|level| of_levels[level] + outlier * noise[level]);
            }
            let errors = self.last.errors();
            for (effects, (of, (_, variances))) in
                self.effects.iter_mut().zip(members.iter().zip(errors))
            {
                for l in 0..of.len() {
                    effects[l] += of[l] * variances[l];
                }
            }
        }
        self.of_levels.fill([0.0; EXCESSES.len()]);
        trace(followed, &self.effects, &mut self.of_levels, &mut [0.0; MANOEUVRES.len()]);
        for (plot, effects) in self.plots.iter_mut().zip(&self.of_levels) {
            let pull: f64 =
                effects.iter().zip(EXCESSES).map(|(effect, excess)| effect / excess).sum();
            plot.pull = pull / plot.r;
        }
    }

    /// Corrects the components with their clusters, and drops components without a cluster. An angle that
    /// is known exactly needs no correction.
    fn correct(&mut self) {
        for cluster in &self.clusters.all {
            let Component { filter, motion, .. } = &mut self.components[cluster.component];
            let prior = filter.state().covariance[0];
            if prior == 0.0 {
                continue;
            }
            let expected: f64 = motion.iter().zip(MANOEUVRES).map(|(p, level)| p * level).sum();
            // all plots together act as one plot z* = x + ν* of variance R*, after a prediction whose
            // variance is increased by this factor
            let inflation = expected.max(cluster.variance / prior / (1.0 - LEAST_GAIN));
            let gain = 1.0 - cluster.variance / (inflation * prior);
            filter.correct(cluster.mean / gain, cluster.variance / gain, inflation);
        }
        self.components.retain(|component| component.weight != 0.0);
    }
}
