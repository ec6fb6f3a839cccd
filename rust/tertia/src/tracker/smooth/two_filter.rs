//! A filter forwards and one backwards in time, and what both know together (Fraser, Potter 1969;
//! for several models Helmick, Blair, Hoffman 1995).
//!
//! Pairs of models in the form of Rauch, Tung, Striebel are not used: chains of improbable models,
//! linearised far off, come back through small weights.

use super::mixture::{Fix, Mixture, State};
use crate::base::exponential::exp;
use crate::base::small::{Matrix, REGULAR, Vector, add, rotated};

/// How targets move by each of M models, with N states.
pub(super) trait Models<const N: usize, const M: usize> {
    /// −1 for states that change their sign where time runs backwards.
    const SIGNS: Vector<N>;

    /// Predicts the state of a model.
    fn predict(&self, model: usize, state: &mut State<N>, t: f64);

    /// Probabilities of the changes from a model (row) to another (column) in the time `t`.
    fn changes(&self, t: f64) -> Matrix<M>;

    /// Information of what is known of the states of all targets, without their measurements.
    fn common(&self) -> Vector<N>;

    /// Probabilities of the models where nothing is known.
    fn stationary(&self) -> [f64; M];

    /// What is known of a target near this state, but for what all targets have in common: nothing.
    fn unknown(&self, near: &Vector<N>) -> State<N>;
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
        let forward = self.forward(start);
        let filtered = self.corrected(&forward[last], last);
        each(Place::At(last), &forward[last], &filtered);
        let near = filtered.moments().reversed(&L::SIGNS).mean;
        // probabilities backwards are likelihoods: those of no measurement are equal
        let present = self.models.stationary().map(|p| if p > 0.0 { 1.0 } else { 0.0 });
        let mut backward = Mixture::new(self.models.unknown(&near), present);
        let mut waiting = between.len();
        for k in (0..last).rev() {
            backward = self.corrected(&backward, k + 1);
            let (time, next) = (self.instants[k].time, self.instants[k + 1].time);
            while waiting > 0 && between[waiting - 1] > time {
                waiting -= 1;
                let filtered = self.corrected(&forward[k], k);
                let before = self.predicted(&filtered, between[waiting] - time, false);
                let after = self.predicted(&backward, next - between[waiting], true);
                let both = self.combined(&before, &after);
                each(Place::Between(waiting), &both, &both);
            }
            backward = self.predicted(&backward, next - time, true);
            let without = self.combined(&forward[k], &backward);
            each(Place::At(k), &without, &self.corrected(&without, k));
        }
    }

    /// States before the measurements of each instant.
    fn forward<const N: usize, const M: usize>(&self, start: Mixture<N, M>) -> Vec<Mixture<N, M>>
    where
        L: Models<N, M>,
    {
        let mut forward = Vec::with_capacity(self.instants.len());
        forward.push(start);
        for k in 1..self.instants.len() {
            let filtered = self.corrected(&forward[k - 1], k - 1);
            let t = self.instants[k].time - self.instants[k - 1].time;
            forward.push(self.predicted(&filtered, t, false));
        }
        forward
    }

    fn corrected<const N: usize, const M: usize>(
        &self,
        state: &Mixture<N, M>,
        k: usize,
    ) -> Mixture<N, M> {
        let mut state = *state;
        let Instant { first, end, .. } = self.instants[k];
        self.fixes[first..end].iter().for_each(|fix| state.correct(fix));
        state
    }

    /// The mixture after the time `t`. Backwards, probabilities are the likelihoods of what comes
    /// later, to which changes lead: their matrix is transposed.
    fn predicted<const N: usize, const M: usize>(
        &self,
        state: &Mixture<N, M>,
        t: f64,
        backwards: bool,
    ) -> Mixture<N, M>
    where
        L: Models<N, M>,
    {
        let mut state = *state;
        let changes = self.models.changes(t);
        state.mix(&if backwards { transposed(&changes) } else { changes });
        for j in 0..M {
            if state.probability[j] > 0.0 {
                self.models.predict(j, &mut state.states[j], t);
            }
        }
        state
    }

    /// What a filter forwards and one backwards know together. With J of each, what both have in
    /// common left out once, and h = J x: J = J_f + J_b − J_0, x = J⁻¹ h, and the probability of a
    /// model is that of the two times ∫ N(x; x_f, P_f) N(x; x_b, P_b) / N(x; 0, J_0⁻¹) dx. Where a
    /// covariance is singular, it is what is known forwards.
    fn combined<const N: usize, const M: usize>(
        &self,
        forward: &Mixture<N, M>,
        backward: &Mixture<N, M>,
    ) -> Mixture<N, M>
    where
        L: Models<N, M>,
    {
        let common = self.models.common();
        let mut both = *forward;
        let mut logarithms = [f64::NEG_INFINITY; M];
        for (j, of_model) in logarithms.iter_mut().enumerate() {
            let weight = forward.probability[j] * backward.probability[j];
            if weight == 0.0 {
                continue;
            }
            let later = backward.states[j].reversed(&L::SIGNS);
            let Some((state, logarithm)) = product(&forward.states[j], &later, &common) else {
                return *forward;
            };
            both.states[j] = state;
            *of_model = forward.probability[j].ln() + backward.probability[j].ln() + logarithm;
        }
        if both.weigh(&logarithms) { both } else { *forward }
    }
}

/// The normalised product of two densities, over that of what they have in common; with the
/// logarithm of its integral, less a constant.
fn product<const N: usize>(
    forward: &State<N>,
    backward: &State<N>,
    common: &Vector<N>,
) -> Option<(State<N>, f64)> {
    // relative to the state forwards, but for what is known of all targets
    let origin: Vector<N> =
        std::array::from_fn(|i| if common[i] == 0.0 { forward.mean[i] } else { 0.0 });
    let of = |state: &State<N>| {
        let (information, determinant) = inverse(&state.covariance)?;
        let x: Vector<N> = std::array::from_fn(|i| state.mean[i] - origin[i]);
        let h = rotated(&information, &x);
        let form: f64 = (0..N).map(|i| x[i] * h[i]).sum();
        Some((information, h, form + determinant))
    };
    let ((mut information, h_f, form_f), (other, h_b, form_b)) = (of(forward)?, of(backward)?);
    for i in 0..N {
        for j in 0..N {
            information[i][j] += other[i][j];
        }
        information[i][i] -= common[i];
    }
    let (covariance, determinant) = inverse(&information)?;
    let h: Vector<N> = std::array::from_fn(|i| h_f[i] + h_b[i]);
    let x = rotated(&covariance, &h);
    let form: f64 = (0..N).map(|i| x[i] * h[i]).sum();
    let logarithm = -0.5 * (form_f + form_b - form + determinant);
    let mean = std::array::from_fn(|i| origin[i] + x[i]);
    Some((State { mean, covariance }, logarithm))
}

/// The inverse of a symmetric matrix, and the logarithm of its determinant, by its Cholesky factor:
/// `A⁻¹ = L⁻ᵀ L⁻¹`, a third of the cost of N systems. None where it is singular.
fn inverse<const N: usize>(a: &Matrix<N>) -> Option<(Matrix<N>, f64)> {
    let (mut lower, mut inverse) = ([[0.0; N]; N], [[0.0; N]; N]);
    let mut scale = 1.0;
    for i in 0..N {
        for j in 0..i {
            let mut sum = a[i][j];
            for (x, y) in lower[i][..j].iter().zip(&lower[j]) {
                sum -= x * y;
            }
            // the diagonal of `inverse` is 1 over that of `lower`
            lower[i][j] = sum * inverse[j][j];
        }
        let mut pivot = a[i][i];
        for value in &lower[i][..i] {
            pivot -= value * value;
        }
        if pivot.is_nan() || pivot <= REGULAR * a[i][i] {
            return None;
        }
        inverse[i][i] = pivot.sqrt().recip();
        scale *= inverse[i][i];
        for j in 0..i {
            let mut sum = 0.0;
            for k in j..i {
                sum -= lower[i][k] * inverse[k][j];
            }
            inverse[i][j] = sum * inverse[i][i];
        }
    }
    let mut product = [[0.0; N]; N];
    for i in 0..N {
        for j in 0..=i {
            let mut sum = 0.0;
            for row in &inverse[i..] {
                sum += row[i] * row[j];
            }
            product[i][j] = sum;
            product[j][i] = sum;
        }
    }
    Some((product, -2.0 * scale.ln()))
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
