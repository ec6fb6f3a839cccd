//! Several models of one target, each with a mean and a covariance, mixed by their probabilities.

use crate::base::exponential::exp;
use crate::base::small::{Factor, Matrix, Vector};

/// Mean and covariance of N states.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State<const N: usize> {
    /// Mean.
    pub mean: Vector<N>,
    /// Covariance.
    pub covariance: Matrix<N>,
}

/// What was measured of the first D states, and its covariance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Fix<const D: usize> {
    pub value: Vector<D>,
    pub covariance: Matrix<D>,
}

/// M models of N states, and their probabilities, which sum to one. A model of probability zero is
/// not there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mixture<const N: usize, const M: usize> {
    /// The state by each model.
    pub states: [State<N>; M],
    /// The probability of each model.
    pub probability: [f64; M],
}

impl<const N: usize> State<N> {
    /// Independent states.
    pub fn new(mean: Vector<N>, variance: Vector<N>) -> Self {
        let mut covariance = [[0.0; N]; N];
        (0..N).for_each(|i| covariance[i][i] = variance[i]);
        Self { mean, covariance }
    }

    /// `F P F'`, symmetric to the last bit.
    #[inline]
    pub fn transform(&mut self, f: &Matrix<N>) {
        let mut g = [[0.0; N]; N];
        for (row, of) in g.iter_mut().zip(f) {
            for (factor, p) in of.iter().zip(&self.covariance) {
                for (sum, value) in row.iter_mut().zip(p) {
                    *sum += factor * value;
                }
            }
        }
        for (i, row) in g.iter().enumerate() {
            for (j, of) in f.iter().enumerate().skip(i) {
                let sum = row.iter().zip(of).fold(0.0, |sum, (a, b)| sum + a * b);
                self.covariance[i][j] = sum;
                self.covariance[j][i] = sum;
            }
        }
    }

    /// Forgets a state: nothing but this variance is known of it.
    #[inline]
    pub fn redraw(&mut self, state: usize, variance: f64) {
        self.mean[state] = 0.0;
        for i in 0..N {
            self.covariance[state][i] = 0.0;
            self.covariance[i][state] = 0.0;
        }
        self.covariance[state][state] = variance;
    }

    /// The same seen backwards in time: `signs` is −1 for states that change their sign.
    #[inline]
    pub fn reversed(&self, signs: &Vector<N>) -> Self {
        let mut reversed = *self;
        for i in 0..N {
            reversed.mean[i] *= signs[i];
            for j in 0..N {
                reversed.covariance[i][j] *= signs[i] * signs[j];
            }
        }
        reversed
    }

    /// Updates with a fix; returns twice the negative logarithm of its density, less a constant.
    #[inline]
    pub fn correct<const D: usize>(&mut self, fix: &Fix<D>) -> Option<f64> {
        let (difference, factor) = self.innovation(fix)?;
        let weighted = factor.solve(&difference);
        let mut distance = 0.0;
        for d in 0..D {
            distance += difference[d] * weighted[d];
        }
        // K = P H' S⁻¹, row by row
        let before = self.covariance;
        for i in 0..N {
            let own: Vector<D> = std::array::from_fn(|d| before[i][d]);
            let gain = factor.solve(&own);
            for d in 0..D {
                self.mean[i] += gain[d] * difference[d];
            }
            for (j, &value) in before[i].iter().enumerate().skip(i) {
                let mut sum = value;
                for d in 0..D {
                    sum -= gain[d] * before[d][j];
                }
                self.covariance[i][j] = sum;
                self.covariance[j][i] = sum;
            }
        }
        Some(distance + factor.ln_determinant())
    }

    /// Fix less state, and the factor of its covariance.
    #[inline]
    fn innovation<const D: usize>(&self, fix: &Fix<D>) -> Option<(Vector<D>, Factor<D>)> {
        let difference = std::array::from_fn(|d| fix.value[d] - self.mean[d]);
        Some((difference, Factor::try_new(&self.spread(fix), 0.0)?))
    }

    /// Covariance of fix less state.
    #[inline]
    pub fn spread<const D: usize>(&self, fix: &Fix<D>) -> Matrix<D> {
        std::array::from_fn(|i| {
            std::array::from_fn(|j| self.covariance[i][j] + fix.covariance[i][j])
        })
    }

    /// Distance squared of a fix, in its covariance; none where that is singular.
    pub fn distance<const D: usize>(&self, fix: &Fix<D>) -> Option<f64> {
        let (difference, factor) = self.innovation(fix)?;
        let weighted = factor.solve(&difference);
        Some((0..D).map(|d| difference[d] * weighted[d]).sum())
    }
}

impl<const N: usize, const M: usize> Mixture<N, M> {
    /// The same state by all models.
    pub fn new(state: State<N>, probability: [f64; M]) -> Self {
        Self { states: [state; M], probability }
    }

    /// Mixes the states for changes of the model (row) to another (column): Blom, Bar-Shalom 1988.
    /// What remains of the probabilities is scaled to one, because backwards they are likelihoods.
    #[inline]
    pub fn mix(&mut self, changes: &Matrix<M>) {
        let before = *self;
        for (j, state) in self.states.iter_mut().enumerate() {
            let mut weights = before.probability;
            weights.iter_mut().zip(changes).for_each(|(weight, row)| *weight *= row[j]);
            let sum = weights.iter().fold(0.0, |sum, weight| sum + weight);
            self.probability[j] = sum;
            if sum > 0.0 {
                *state = before.moments_about(weights.map(|w| w / sum), j);
            }
        }
        self.scale();
    }

    /// Mean and covariance of all models together.
    pub fn moments(&self) -> State<N> {
        let likely = (0..M)
            .fold(0, |best, j| if self.probability[j] > self.probability[best] { j } else { best });
        self.moments_about(self.probability, likely)
    }

    /// The same with these weights, computed from the differences to the mean of one model.
    #[inline]
    fn moments_about(&self, weights: [f64; M], origin: usize) -> State<N> {
        let mut sum = [0.0; N];
        let mut covariance = [[0.0; N]; N];
        let origin = &self.states[origin].mean;
        for (weight, state) in weights.into_iter().zip(&self.states) {
            if weight == 0.0 {
                continue;
            }
            let mut d = [0.0; N];
            for i in 0..N {
                d[i] = state.mean[i] - origin[i];
                sum[i] += weight * d[i];
            }
            for i in 0..N {
                let scaled = weight * d[i];
                for j in 0..N {
                    covariance[i][j] += weight * state.covariance[i][j] + scaled * d[j];
                }
            }
        }
        let mut mean = *origin;
        for i in 0..N {
            mean[i] += sum[i];
            for j in 0..N {
                covariance[i][j] -= sum[i] * sum[j];
            }
        }
        State { mean, covariance }
    }

    /// Corrects all models by a fix, and their probabilities by its densities. A fix by which a
    /// covariance is singular changes nothing.
    pub fn correct<const D: usize>(&mut self, fix: &Fix<D>) {
        let mut after = *self;
        let mut logarithms = [f64::NEG_INFINITY; M];
        for (j, logarithm) in logarithms.iter_mut().enumerate() {
            if self.probability[j] > 0.0 {
                let Some(surprise) = after.states[j].correct(fix) else {
                    return;
                };
                *logarithm = self.probability[j].ln() - 0.5 * surprise;
            }
        }
        if after.weigh(&logarithms) {
            *self = after;
        }
    }

    /// Sets the probabilities by their logarithms, less a constant; false where none is a number.
    pub fn weigh(&mut self, logarithms: &[f64; M]) -> bool {
        let largest = logarithms.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        if !largest.is_finite() {
            return false;
        }
        // what would not be in the sum is not there at all
        self.probability = logarithms.map(|l| if l.is_finite() { exp(l - largest) } else { 0.0 });
        self.scale();
        true
    }

    fn scale(&mut self) {
        let total: f64 = self.probability.iter().sum();
        self.probability.iter_mut().for_each(|p| *p /= total);
    }
}
