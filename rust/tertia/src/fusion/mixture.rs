//! The mixture of normal distributions that represents the state in the robust rule.

use super::levels::{MANOEUVRES, NOISE};
use crate::kalman::{Filter, State, residual};

/// A normal distribution of the state, with the probabilities of the noise levels if it is the correct one.
#[derive(Clone, Debug)]
pub(super) struct Component {
    /// Probability of the component.
    pub weight: f64,
    pub filter: Filter,
    /// Probabilities of the noise levels of each radar.
    pub noise: Vec<[f64; NOISE.len()]>,
    /// Probabilities of the levels of the prediction.
    pub motion: [f64; MANOEUVRES.len()],
}

impl Component {
    /// Returns the complete state as lists of numbers.
    pub fn saved(&self) -> impl Iterator<Item = Vec<f64>> {
        let own = [vec![self.weight], self.filter.saved(), self.motion.to_vec()];
        own.into_iter().chain(self.noise.iter().map(|noise| noise.to_vec()))
    }

    /// Restores the state from saved lists.
    pub fn restore<'a>(&mut self, lists: &mut impl Iterator<Item = &'a Vec<f64>>) -> Option<()> {
        [self.weight] = lists.next()?[..].try_into().ok()?;
        self.filter = self.filter.restored(lists.next()?)?;
        self.motion = lists.next()?[..].try_into().ok()?;
        for noise in &mut self.noise {
            *noise = lists.next()?[..].try_into().ok()?;
        }
        Some(())
    }

    /// Mean logarithm of a radar's noise variance relative to the stated one.
    pub fn log_excess(&self, radar: usize) -> f64 {
        self.noise[radar].iter().zip(NOISE).map(|(p, level)| p * level.ln()).sum()
    }

    /// Merges another component into this one, with the mean, covariance and probabilities of both together.
    fn take_in(&mut self, other: &Self, period: Option<f64>) {
        let weight = self.weight + other.weight;
        let share = other.weight / weight;
        let state = mixed(&self.filter.state(), &other.filter.state(), share, period);
        self.filter.set(state, self.filter.noise());
        let mix = |(own, other): (&mut f64, &f64)| *own += share * (other - *own);
        self.motion.iter_mut().zip(&other.motion).for_each(mix);
        self.noise.iter_mut().flatten().zip(other.noise.iter().flatten()).for_each(mix);
        self.weight = weight;
    }
}

/// Merges the most similar components until there are no more than `most` and merging any pair would
/// lose more than `agreement` nats of information (Runnalls 2007). The most probable one comes first.
pub(super) fn reduce(
    components: &mut Vec<Component>,
    most: usize,
    agreement: f64,
    period: Option<f64>,
) {
    while components.len() > 1 {
        let (loss, i, j) = most_alike(components, period);
        if loss > agreement && components.len() <= most {
            break;
        }
        let other = components.swap_remove(j);
        components[i].take_in(&other, period);
    }
    components.sort_by(|a, b| b.weight.total_cmp(&a.weight));
}

/// Returns all components merged into one filter.
pub(super) fn united(components: &[Component], period: Option<f64>) -> Filter {
    let mut filter = components[0].filter;
    if let [first, others @ ..] = components
        && !others.is_empty()
    {
        let (mut state, mut weight) = (filter.state(), first.weight);
        for other in others {
            weight += other.weight;
            state = mixed(&state, &other.filter.state(), other.weight / weight, period);
        }
        filter.set(state, filter.noise());
    }
    filter
}

/// Returns the two components i < j whose merger loses the least, and a bound of that loss.
fn most_alike(components: &[Component], period: Option<f64>) -> (f64, usize, usize) {
    let mut least = (f64::INFINITY, 0, 1);
    for (j, b) in components.iter().enumerate() {
        for (i, a) in components[..j].iter().enumerate() {
            let weight = a.weight + b.weight;
            let [one, other] = [a, b].map(|component| component.filter.state());
            let both = log_determinant(&mixed(&one, &other, b.weight / weight, period));
            let apart = a.weight * log_determinant(&one) + b.weight * log_determinant(&other);
            let loss = 0.5 * (weight * both - apart);
            if loss < least.0 {
                least = (loss, i, j);
            }
        }
    }
    least
}

/// Row and column of each element of a packed covariance.
const PLACES: [(usize, usize); 6] = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];

/// Mean and covariance of the mixture of two states; `share` is the weight of the second.
fn mixed(one: &State, other: &State, share: f64, period: Option<f64>) -> State {
    let [x0, x1, x2] = one.mean;
    let [y0, y1, y2] = other.mean;
    let away = [residual(y0, x0, period), y1 - x1, y2 - x2];
    State {
        mean: std::array::from_fn(|c| one.mean[c] + share * away[c]),
        covariance: std::array::from_fn(|k| {
            let (i, j) = PLACES[k];
            let (a, b) = (one.covariance[k], other.covariance[k]);
            a + share * (b - a) + share * (1.0 - share) * away[i] * away[j]
        }),
    }
}

/// Smallest share of a variance that the preceding components are assumed to leave unexplained.
const SMALLEST_SHARE: f64 = 1e-12;

/// Logarithm of the determinant of the covariance, without components that are known exactly.
fn log_determinant(state: &State) -> f64 {
    let [p00, p01, p02, p11, p12, p22] = state.covariance;
    let ratio = |a: f64, b: f64| if b > 0.0 { a / b } else { 0.0 };
    let left = |variance: f64, pivot: f64| pivot.max(SMALLEST_SHARE * variance);
    let d1 = left(p11, p11 - ratio(p01 * p01, p00));
    let c12 = p12 - ratio(p01 * p02, p00);
    let d2 = left(p22, p22 - ratio(p02 * p02, p00) - ratio(c12 * c12, d1));
    [p00, d1, d2].iter().filter(|d| **d > 0.0).map(|d| d.ln()).sum()
}
