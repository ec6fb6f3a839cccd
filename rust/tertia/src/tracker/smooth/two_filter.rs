//! A filter forwards and one backwards in time, and what both know together (Fraser, Potter 1969;
//! for several models Helmick, Blair, Hoffman 1995).
//!
//! Pairs of models in the form of Rauch, Tung, Striebel are not used: chains of improbable models,
//! linearised far off, come back through small weights.

use super::mixture::{Fix, Mixture, State};
use super::root::Root;
use crate::base::exponential::exp;
use crate::base::small::{Matrix, Vector, add};

/// How targets move by each of M models, with N states.
pub(super) trait Models<const N: usize, const M: usize> {
    /// −1 for states that change their sign where time runs backwards.
    const SIGNS: Vector<N>;

    /// Predicts the state of a model.
    fn predict(&self, model: usize, state: &mut State<N>, t: f64);

    /// Probabilities of the changes from a model (row) to another (column) in the time `t`.
    fn changes(&self, t: f64) -> Matrix<M>;

    /// Variances of the own states of the models, without measurements.
    fn variances(&self) -> [f64; M];

    /// Probabilities of the models where nothing is known.
    fn stationary(&self) -> [f64; M];

    /// What is known of a target near this state, but for what all targets have in common: nothing.
    fn unknown(&self, near: &Vector<N>) -> State<N>;

    /// Models with these probabilities, which know nothing.
    fn begin(&self, near: &Vector<N>, probability: [f64; M]) -> Mixture<N, M> {
        self.start(self.unknown(near), probability)
    }

    /// Models that all begin with this state, but for their own.
    fn start(&self, state: State<N>, probability: [f64; M]) -> Mixture<N, M> {
        let states = self.variances().map(|variance| {
            let mut state = state;
            state.redraw(variance);
            state
        });
        Mixture { states, probability }
    }
}

/// Measurements of one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Instant {
    pub time: f64,
    /// Range of the measurements.
    pub first: usize,
    pub end: usize,
}

/// What is smoothed.
pub(super) enum Place {
    /// The instant of this index.
    At(usize),
    /// The time of this index, of those that lie between.
    Between(usize),
}

/// Both directions over measurements of one target.
pub(super) struct TwoFilter<'a, L, const D: usize> {
    pub models: &'a L,
    pub instants: &'a [Instant],
    pub fixes: &'a [Fix<D>],
}

impl<L, const D: usize> TwoFilter<'_, L, D> {
    /// Calls `each` with every place, backwards in time, and with the states there without the
    /// measurements of the instant and with them. `between` are times in order, within the first
    /// and the last instant and at none. They change nothing at the instants.
    ///
    /// Cost O(instants + times), memory one mixture an instant.
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
        let near = filtered.moments().reversed(&L::SIGNS).mean;
        // probabilities backwards are likelihoods: those of no measurement are equal
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
                let after = self.predicted(&backward, until, &after);
                let both = self.combined(&before, &after);
                each(Place::Between(waiting), &both, &both);
            }
            backward = self.predicted(&backward, next - time, &transposed(&changes[k]));
            let without = self.combined(&forward[k], &backward);
            each(Place::At(k), &without, &self.corrected(&without, k));
        }
    }

    /// States before the measurements of each instant, and changes from each to the next.
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

    /// The mixture after the time `t`. Backwards, probabilities are the likelihoods of what comes
    /// later, to which changes lead: their matrix is transposed.
    fn predicted<const N: usize, const M: usize>(
        &self,
        state: &Mixture<N, M>,
        t: f64,
        changes: &Matrix<M>,
    ) -> Mixture<N, M>
    where
        L: Models<N, M>,
    {
        let mut state = *state;
        state.mix(changes, &self.models.variances());
        for j in 0..M {
            if state.probability[j] > 0.0 {
                self.models.predict(j, &mut state.states[j], t);
            }
        }
        state
    }

    /// What a filter forwards and one backwards know together: the product of their densities, over
    /// that of what both know of a model's own state. The probability of a model is that of the two
    /// times `∫ N(x; x_f, P_f) N(x; x_b, P_b) / N(own; 0, variance) dx`. Where a covariance is
    /// singular, it is what is known forwards.
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

/// The normalised product of two densities, over that of their last state without measurements; with
/// its integral, less a constant: the square in its exponent, and the factor before.
#[inline]
fn product<const N: usize>(
    one: &State<N>,
    other: &State<N>,
    variance: f64,
) -> Option<(State<N>, f64, f64)> {
    // from the narrower one on, so that no digits are lost
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
    // both knew the own state so well
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

/// `exp(G t)`, of rates of changes per second, row by row: sums of products that are not negative,
/// so that nothing cancels (uniformisation), of a part of the time, squared.
pub(super) fn exponential<const M: usize>(rates: &Matrix<M>, t: f64) -> Matrix<M> {
    let fastest = (0..M).map(|i| -rates[i][i]).fold(0.0, f64::max) * t;
    let mut squarings = 0;
    while fastest > f64::from(1 << squarings) && squarings < MOST_SQUARINGS {
        squarings += 1;
    }
    let part = fastest / f64::from(1 << squarings);
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

/// `1/k!` of the first that is left out is less than a rounding error.
const TERMS: u32 = 18;
/// A million mean durations and more are forever.
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
