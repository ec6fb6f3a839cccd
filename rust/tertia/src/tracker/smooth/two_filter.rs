//! A filter forwards and one backwards in time, and the combination of both (Fraser, Potter 1969;
//! for several models Helmick, Blair, Hoffman 1995).
//!
//! Pairs of models in the form of Rauch, Tung, Striebel are not used: sequences of improbable
//! models, linearised far from the truth, return through small weights.

use super::mixture::{Fix, Mixture, State};
use super::root::Root;
use crate::base::exponential::exp;
use crate::base::small::{Matrix, Vector, add};

/// Longest time over which states are predicted, s. After it, hardly anything is known about the target; after
/// longer ones, the variances would be so large that the next measurements would lose their digits.
const LONGEST: f64 = 3e4;

/// Motion of targets by each of M models with N states.
pub(super) trait Models<const N: usize, const M: usize> {
    /// −1 for states that change their sign when time runs backwards.
    const SIGNS: Vector<N>;

    /// Predicts the state of a model.
    fn predict(&self, model: usize, state: &mut State<N>, t: f64);

    /// Probabilities of the changes from a model (row) to another (column) in the time `t`.
    fn changes(&self, t: f64) -> Matrix<M>;

    /// Variances of the models' own states before any measurement.
    fn variances(&self) -> [f64; M];

    /// Probabilities of the models when nothing is known.
    fn stationary(&self) -> [f64; M];

    /// The motion when time runs backwards.
    fn backwards(&self) -> Self
    where
        Self: Sized;

    /// A state about `near` that contains no information but what all targets have in common.
    fn unknown(&self, near: &State<N>) -> State<N>;

    /// Models with these probabilities, about whose states nothing is known.
    fn begin(&self, near: &State<N>, probability: [f64; M]) -> Mixture<N, M> {
        self.start(self.unknown(near), probability)
    }

    /// Models that all begin with this state, except for their own states.
    fn start(&self, state: State<N>, probability: [f64; M]) -> Mixture<N, M> {
        let states = self.variances().map(|variance| {
            let mut state = state;
            state.redraw(variance);
            state
        });
        Mixture { states, probability }
    }
}

/// Measurements at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Instant {
    pub time: f64,
    /// The measurements are those from `first` to `end`, exclusive.
    pub first: usize,
    pub end: usize,
}

/// A time at which the state is smoothed.
pub(super) enum Place {
    /// The instant of this index.
    At(usize),
    /// The additional time with this index.
    Between(usize),
}

/// Both directions over the measurements of one target.
pub(super) struct TwoFilter<'a, L, const D: usize> {
    pub models: &'a L,
    pub instants: &'a [Instant],
    pub fixes: &'a [Fix<D>],
}

impl<L, const D: usize> TwoFilter<'_, L, D> {
    /// Calls `each` for every place, backwards in time, with the state there without the
    /// measurements of the instant and with them. `between` are additional times, in order, between
    /// the first and the last instant and at no instant. They change nothing at the instants.
    ///
    /// Cost O(instants + times), memory one mixture per instant.
    pub fn run<const N: usize, const M: usize>(
        &self,
        start: Mixture<N, M>,
        between: &[f64],
        mut each: impl FnMut(Place, &Mixture<N, M>, &Mixture<N, M>),
    ) where
        L: Models<N, M>,
    {
        let Some(last) = self.instants.len().checked_sub(1) else {
            return;
        };
        let (forward, changes) = self.forward(start);
        let filtered = self.corrected(&forward[last], last);
        each(Place::At(last), &forward[last], &filtered);
        let near = filtered.moments().reversed(&L::SIGNS);
        // backwards, probabilities are likelihoods, which are equal without measurements
        let backwards = self.models.backwards();
        let against = TwoFilter { models: &backwards, instants: self.instants, fixes: self.fixes };
        let present = self.models.stationary().map(|p| if p > 0.0 { 1.0 } else { 0.0 });
        let mut backward = self.models.begin(&near, present);
        let mut waiting = between.len();
        for k in (0..last).rev() {
            self.fixes_of(k + 1).for_each(|fix| backward.correct(&fix.reversed()));
            let (time, next) = (self.instants[k].time, self.instants[k + 1].time);
            while waiting > 0 && between[waiting - 1] > time {
                waiting -= 1;
                let filtered = self.corrected(&forward[k], k);
                let (since, until) = (between[waiting] - time, next - between[waiting]);
                let before = self.predicted(&filtered, since, &self.models.changes(since));
                let after = transposed(&self.models.changes(until));
                let after = against.predicted(&backward, until, &after);
                let both = self.combined(&before, &after);
                each(Place::Between(waiting), &both, &both);
            }
            backward = against.predicted(&backward, next - time, &transposed(&changes[k]));
            let without = self.combined(&forward[k], &backward);
            each(Place::At(k), &without, &self.corrected(&without, k));
        }
    }

    /// States before the measurements of each instant, and the probabilities of changes from each
    /// instant to the next.
    fn forward<const N: usize, const M: usize>(
        &self,
        start: Mixture<N, M>,
    ) -> (Vec<Mixture<N, M>>, Vec<Matrix<M>>)
    where
        L: Models<N, M>,
    {
        let mut forward = Vec::with_capacity(self.instants.len());
        let mut changes: Vec<Matrix<M>> = Vec::with_capacity(self.instants.len());
        forward.push(start);
        let mut last = f64::NAN;
        for k in 1..self.instants.len() {
            let filtered = self.corrected(&forward[k - 1], k - 1);
            let t = self.instants[k].time - self.instants[k - 1].time;
            let own = if t == last { changes[k - 2] } else { self.models.changes(t) };
            forward.push(self.predicted(&filtered, t, &own));
            changes.push(own);
            last = t;
        }
        (forward, changes)
    }

    fn corrected<const N: usize, const M: usize>(
        &self,
        state: &Mixture<N, M>,
        k: usize,
    ) -> Mixture<N, M> {
        let mut state = *state;
        self.fixes_of(k).for_each(|fix| state.correct(fix));
        state
    }

    fn fixes_of(&self, k: usize) -> std::slice::Iter<'_, Fix<D>> {
        let Instant { first, end, .. } = self.instants[k];
        self.fixes[first..end].iter()
    }

    /// The mixture after the time `t`. Backwards, probabilities are the likelihoods of later
    /// measurements given the model, and the matrix of changes is transposed.
    fn predicted<const N: usize, const M: usize>(
        &self,
        state: &Mixture<N, M>,
        t: f64,
        changes: &Matrix<M>,
    ) -> Mixture<N, M>
    where
        L: Models<N, M>,
    {
        let (mut state, t) = (*state, t.min(LONGEST));
        state.mix(changes, &self.models.variances());
        for j in 0..M {
            if state.probability[j] > 0.0 {
                self.models.predict(j, &mut state.states[j], t);
            }
        }
        state
    }

    /// Combines a forward and a backward filter: the product of their densities, divided by the
    /// prior density of a model's own state, which both contain. The probability of a model is the
    /// product of both probabilities and of
    /// `∫ N(x; x_f, P_f) N(x; x_b, P_b) / N(own; 0, variance) dx`.
    /// If a covariance is singular, the result is the forward filter.
    fn combined<const N: usize, const M: usize>(
        &self,
        forward: &Mixture<N, M>,
        backward: &Mixture<N, M>,
    ) -> Mixture<N, M>
    where
        L: Models<N, M>,
    {
        let variances = self.models.variances();
        let mut both = *forward;
        let mut logarithms = [f64::NEG_INFINITY; M];
        for (j, of_model) in logarithms.iter_mut().enumerate() {
            let weight = forward.probability[j] * backward.probability[j];
            if weight == 0.0 {
                continue;
            }
            let later = backward.states[j].reversed(&L::SIGNS);
            let found = product(&forward.states[j], &later, variances[j]);
            let Some((state, distance, density)) = found else {
                return *forward;
            };
            both.states[j] = state;
            *of_model = (weight * density).ln() - 0.5 * distance;
        }
        if both.weigh(&logarithms) { both } else { *forward }
    }
}

/// The normalised product of two densities, divided by the prior density of their last state, and
/// its integral without a constant: the square in its exponent, and the factor before the
/// exponential. None if a covariance is singular.
#[inline]
fn product<const N: usize>(
    one: &State<N>,
    other: &State<N>,
    variance: f64,
) -> Option<(State<N>, f64, f64)> {
    // starting from the narrower one, so that no digits are lost
    let (near, far) =
        if one.covariance[0][0] <= other.covariance[0][0] { (one, other) } else { (other, one) };
    let mut sum = near.covariance;
    add(&mut sum, &far.covariance);
    let root = Root::new(&sum)?;
    let mut difference: [[f64; 1]; N] = std::array::from_fn(|i| [far.mean[i] - near.mean[i]]);
    root.whiten(&mut difference);
    let mut rows = near.covariance;
    root.whiten(&mut rows);
    let (mut state, mut distance) = (*near, 0.0);
    for (row, [difference]) in rows.iter().zip(difference) {
        distance += difference * difference;
        state.explain(row, difference);
    }
    // both contain the prior of the own state, which counts only once
    let own = N - 1;
    let left = 1.0 - state.covariance[own][own] / variance;
    if left.is_nan() || left <= 0.0 {
        return None;
    }
    let (row, mean) = (state.covariance[own], state.mean[own]);
    let scale = (variance * left).recip();
    for i in 0..N {
        let scaled = scale * row[i];
        state.mean[i] += scaled * mean;
        state.covariance[i].iter_mut().zip(row).for_each(|(p, value)| *p += scaled * value);
    }
    distance -= mean * mean * scale;
    Some((state, distance, root.density() * (variance / left).sqrt()))
}

fn transposed<const M: usize>(matrix: &Matrix<M>) -> Matrix<M> {
    std::array::from_fn(|i| std::array::from_fn(|j| matrix[j][i]))
}

/// `exp(G t)`, with the rates G of changes per second: sums of non-negative products, in which
/// nothing cancels (uniformisation), for a fraction of the time, and repeated squaring.
pub(super) fn exponential<const M: usize>(rates: &Matrix<M>, t: f64) -> Matrix<M> {
    let fastest = (0..M).map(|i| -rates[i][i]).fold(0.0, f64::max) * t;
    let mut squarings = 0;
    while fastest > f64::from(1 << squarings) && squarings < MOST_SQUARINGS {
        squarings += 1;
    }
    let part = (fastest / f64::from(1 << squarings)).min(1.0);
    let scale = if fastest > 0.0 { t / fastest } else { 0.0 };
    let identity: Matrix<M> =
        std::array::from_fn(|i| std::array::from_fn(|j| f64::from(u8::from(i == j))));
    let step: Matrix<M> =
        std::array::from_fn(|i| std::array::from_fn(|j| identity[i][j] + scale * rates[i][j]));
    let (mut sum, mut term) = (identity, identity);
    let mut share = 1.0;
    for k in 1..=TERMS {
        let factor = part / f64::from(k);
        share *= factor;
        if share < f64::EPSILON * 1e-3 {
            break;
        }
        term = multiplied(&term, &step).map(|row| row.map(|x| x * factor));
        add(&mut sum, &term);
    }
    let weight = exp(-part);
    let mut changes = sum.map(|row| row.map(|x| x * weight));
    for _ in 0..squarings {
        changes = multiplied(&changes, &changes);
    }
    changes
}

/// Number of terms: `1/k!` of the first one that is left out is less than a rounding error.
const TERMS: u32 = 18;
/// Largest number of squarings: a million mean durations or more are infinite.
const MOST_SQUARINGS: u32 = 20;

fn multiplied<const M: usize>(a: &Matrix<M>, b: &Matrix<M>) -> Matrix<M> {
    std::array::from_fn(|i| {
        std::array::from_fn(|j| {
            let mut sum = 0.0;
            for k in 0..M {
                sum += a[i][k] * b[k][j];
            }
            sum
        })
    })
}
