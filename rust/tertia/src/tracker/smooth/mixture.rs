//! Several models of one target, each with a mean and a covariance, mixed by their probabilities.

use super::root::Root;
use crate::base::exponential::exp;
use crate::base::small::{Matrix, Vector};

/// Mean and covariance of N states, the last of which is specific to a model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State<const N: usize> {
    /// Mean.
    pub mean: Vector<N>,
    /// Covariance.
    pub covariance: Matrix<N>,
}

/// A measurement of the first D states, and its covariance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Fix<const D: usize> {
    pub value: Vector<D>,
    pub covariance: Matrix<D>,
    /// Measurement of their rates, which are the next D states, and its covariance.
    pub rate: Option<(Vector<D>, Matrix<D>)>,
}

impl<const D: usize> Fix<D> {
    /// A fix without rates.
    pub fn new(value: Vector<D>, covariance: Matrix<D>) -> Self {
        Self { value, covariance, rate: None }
    }

    /// The rates as a fix of their own.
    fn of_rates(&self) -> Option<Self> {
        self.rate.map(|(value, covariance)| Self::new(value, covariance))
    }

    /// The fix when time runs backwards.
    pub fn reversed(&self) -> Self {
        let rate = self.rate.map(|(rate, covariance)| (rate.map(|r| -r), covariance));
        Self { rate, ..*self }
    }
}

/// M models of N states, and their probabilities, which sum to one. A model of probability zero is
/// absent. All states but the last one are the same quantities in all models.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mixture<const N: usize, const M: usize> {
    /// The state of each model.
    pub states: [State<N>; M],
    /// The probability of each model.
    pub probability: [f64; M],
}

impl<const N: usize> State<N> {
    /// A state with independent components.
    pub fn new(mean: Vector<N>, variance: Vector<N>) -> Self {
        let mut covariance = [[0.0; N]; N];
        (0..N).for_each(|i| covariance[i][i] = variance[i]);
        Self { mean, covariance }
    }

    /// Replaces the covariance P by `F P F'`, symmetric to the last bit.
    #[inline]
    pub fn transform(&mut self, f: &Matrix<N>) {
        let (p, mut g, mut after) = (self.covariance, [[0.0; N]; N], [[0.0; N]; N]);
        for i in 0..N {
            for k in 0..N {
                for j in 0..N {
                    g[i][j] += f[i][k] * p[k][j];
                }
            }
        }
        for i in 0..N {
            for j in i..N {
                let mut sum = 0.0;
                for k in 0..N {
                    sum += g[i][k] * f[j][k];
                }
                after[i][j] = sum;
                after[j][i] = sum;
            }
        }
        self.covariance = after;
    }

    /// Forgets the model's own state, which then has mean 0 and this variance.
    #[inline]
    pub fn redraw(&mut self, variance: f64) {
        let own = N - 1;
        self.mean[own] = 0.0;
        for i in 0..own {
            self.covariance[own][i] = 0.0;
            self.covariance[i][own] = 0.0;
        }
        self.covariance[own][own] = variance;
    }

    /// The state when time runs backwards: `signs` is −1 for components that change their sign.
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

    /// Corrects by the values of a fix of the states from index `from` on. Returns the squared
    /// normalised distance, and the factor before the exponential of the density, without a
    /// constant; none if the covariance is singular.
    #[inline(always)]
    fn correct<const D: usize>(&mut self, fix: &Fix<D>, from: usize) -> Option<(f64, f64)> {
        let root = Root::new(&self.spread_at(fix, from))?;
        let mut difference = [[0.0; 1]; D];
        let mut rows = [[0.0; N]; D];
        for d in 0..D {
            difference[d][0] = fix.value[d] - self.mean[from + d];
            rows[d] = self.covariance[from + d];
        }
        root.whiten(&mut difference);
        root.whiten(&mut rows);
        let mut distance = 0.0;
        for (row, [difference]) in rows.iter().zip(difference) {
            distance += difference * difference;
            self.explain(row, difference);
        }
        Some((distance, root.density()))
    }

    /// Applies a whitened difference y with the whitened covariances w: `m + w y` and `P − w w'`.
    #[inline]
    pub fn explain(&mut self, w: &Vector<N>, y: f64) {
        for i in 0..N {
            self.mean[i] += w[i] * y;
            for j in 0..N {
                self.covariance[i][j] -= w[i] * w[j];
            }
        }
    }

    /// Covariance of the difference between fix and state.
    #[inline]
    pub fn spread<const D: usize>(&self, fix: &Fix<D>) -> Matrix<D> {
        self.spread_at(fix, 0)
    }

    #[inline(always)]
    fn spread_at<const D: usize>(&self, fix: &Fix<D>, from: usize) -> Matrix<D> {
        std::array::from_fn(|i| {
            std::array::from_fn(|j| self.covariance[from + i][from + j] + fix.covariance[i][j])
        })
    }

    /// Squared normalised distance of a fix; none if its covariance is singular.
    pub fn distance<const D: usize>(&self, fix: &Fix<D>) -> Option<f64> {
        self.distance_at(fix, 0)
    }

    /// Squared normalised distance of the rates of a fix; none if there are none.
    pub fn distance_of_rate<const D: usize>(&self, fix: &Fix<D>) -> Option<f64> {
        self.distance_at(&fix.of_rates()?, D)
    }

    fn distance_at<const D: usize>(&self, fix: &Fix<D>, from: usize) -> Option<f64> {
        let mut difference = std::array::from_fn(|d| [fix.value[d] - self.mean[from + d]]);
        Root::new(&self.spread_at(fix, from))?.whiten::<1>(&mut difference);
        Some(difference.iter().map(|[d]| d * d).sum())
    }
}

impl<const N: usize, const M: usize> Mixture<N, M> {
    /// Mixes the states for changes from one model (row) to another (column): Blom, Bar-Shalom
    /// 1988. The probabilities are scaled to sum to one, as backwards they are likelihoods. A model
    /// that begins draws its own state with its `variance`.
    #[inline]
    pub fn mix(&mut self, changes: &Matrix<M>, variance: &[f64; M]) {
        let before = *self;
        for (j, state) in self.states.iter_mut().enumerate() {
            let mut weights = before.probability;
            weights.iter_mut().zip(changes).for_each(|(weight, row)| *weight *= row[j]);
            let sum = weights.iter().fold(0.0, |sum, weight| sum + weight);
            self.probability[j] = sum;
            if sum > 0.0 {
                *state = before.mixed(weights.map(|w| w / sum), j, variance[j]);
            }
        }
        self.scale();
    }

    /// The state of a model, mixed from all models with these weights.
    #[inline]
    fn mixed(&self, weights: [f64; M], model: usize, variance: f64) -> State<N> {
        let (mut state, shift) = self.shared(weights, model);
        let (own, before, share) = (N - 1, &self.states[model], weights[model]);
        let mean = share * before.mean[own];
        state.mean[own] = mean;
        for (i, shift) in shift.into_iter().enumerate().take(own) {
            let covariance = share * before.covariance[i][own] - shift * mean;
            state.covariance[i][own] = covariance;
            state.covariance[own][i] = covariance;
        }
        let square = before.covariance[own][own] + before.mean[own] * before.mean[own];
        state.covariance[own][own] = share * square + (1.0 - share) * variance - mean * mean;
        state
    }

    /// Mean and covariance of all models together, without their own states.
    pub fn moments(&self) -> State<N> {
        let likely = (0..M)
            .fold(0, |best, j| if self.probability[j] > self.probability[best] { j } else { best });
        self.shared(self.probability, likely).0
    }

    /// Mean and covariance with these weights, computed from the differences to the mean of one
    /// model (`origin`), and the difference of both means.
    #[inline]
    fn shared(&self, weights: [f64; M], origin: usize) -> (State<N>, Vector<N>) {
        let mut shift = [0.0; N];
        let mut covariance = [[0.0; N]; N];
        let mut mean = self.states[origin].mean;
        for (weight, state) in weights.into_iter().zip(&self.states) {
            if weight == 0.0 {
                continue;
            }
            let mut d = [0.0; N];
            for i in 0..N - 1 {
                d[i] = state.mean[i] - mean[i];
                shift[i] += weight * d[i];
            }
            for i in 0..N - 1 {
                let scaled = weight * d[i];
                for j in 0..N - 1 {
                    covariance[i][j] += weight * state.covariance[i][j] + scaled * d[j];
                }
            }
        }
        for i in 0..N - 1 {
            mean[i] += shift[i];
            for j in 0..N - 1 {
                covariance[i][j] -= shift[i] * shift[j];
            }
        }
        mean[N - 1] = 0.0;
        (State { mean, covariance }, shift)
    }

    /// Mean of each model's own state, times the probability of the model.
    pub fn own(&self) -> [f64; M] {
        std::array::from_fn(|j| match self.probability[j] {
            0.0 => 0.0,
            share => share * self.states[j].mean[N - 1],
        })
    }

    /// Corrects all models by a fix, and their probabilities by the densities of the fix. A fix
    /// that gives a singular covariance changes nothing.
    #[inline]
    pub fn correct<const D: usize>(&mut self, fix: &Fix<D>) {
        self.correct_at(fix, 0);
        if let Some(rates) = fix.of_rates() {
            self.correct_at(&rates, D);
        }
    }

    #[inline(always)]
    fn correct_at<const D: usize>(&mut self, fix: &Fix<D>, from: usize) {
        let mut after = *self;
        let mut logarithms = [f64::NEG_INFINITY; M];
        for (j, logarithm) in logarithms.iter_mut().enumerate() {
            if self.probability[j] > 0.0 {
                let Some((distance, density)) = after.states[j].correct(fix, from) else {
                    return;
                };
                *logarithm = (self.probability[j] * density).ln() - 0.5 * distance;
            }
        }
        if after.weigh(&logarithms) {
            *self = after;
        }
    }

    /// Sets the probabilities by their logarithms, up to a constant; returns false if none is
    /// finite.
    pub fn weigh(&mut self, logarithms: &[f64; M]) -> bool {
        let largest = logarithms.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        if !largest.is_finite() {
            return false;
        }
        // a model whose logarithm is not finite is absent
        self.probability = logarithms.map(|l| if l.is_finite() { exp(l - largest) } else { 0.0 });
        self.scale();
        true
    }

    fn scale(&mut self) {
        let total: f64 = self.probability.iter().sum();
        self.probability.iter_mut().for_each(|p| *p /= total);
    }
}
