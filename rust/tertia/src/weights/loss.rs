//! Cost of estimated weights: their bias, and the excess of the mean squared error of the fused
//! estimate over the fused covariance.

use super::group::{Group, Problem};
use crate::base::error::Result;
use crate::base::matrix::{Square, symmetrise, zeros};
use nalgebra::allocator::Allocator;
use nalgebra::{DefaultAllocator, Dim};

/// Loss determined by simulation.
pub(super) struct Simulated {
    /// Trace of the mean excess divided by the trace of the fused covariance.
    pub loss: f64,
    /// Standard error of `loss`; infinite for a single draw.
    pub loss_sigma: f64,
}

/// Buffers for the loss.
pub(super) struct Loss<D: Dim>
where
    DefaultAllocator: Allocator<D, D>,
{
    /// `Σ_j c_j W_j [(I − W_j) + tr(I − W_j) I]`.
    expansion: Square<D>,
    term: Square<D>,
    out: Square<D>,
    drawn: Vec<Square<D>>,
    group: Group<D>,
}

impl<D: Dim> Loss<D>
where
    DefaultAllocator: Allocator<D, D>,
{
    pub fn new(sensors: usize, order: D) -> Self {
        let new = || zeros(order);
        Self {
            expansion: new(),
            term: new(),
            out: new(),
            drawn: vec![new(); sensors],
            group: Group::new(sensors, order),
        }
    }

    fn expand(&mut self, weights: &Group<D>, c: &[f64]) {
        self.expansion.fill(0.0);
        for (j, &c) in c.iter().enumerate() {
            self.set_term(weights, j);
            self.expansion.zip_apply(&self.term, |sum, term| *sum += c * term);
        }
    }

    fn set_term(&mut self, weights: &Group<D>, j: usize) {
        let (w, complement) = (&weights.weight[j], &weights.complement[j]);
        w.mul_to(complement, &mut self.term);
        let trace = complement.trace();
        self.term.zip_apply(w, |term, w| *term += trace * w);
    }

    /// `E Ŵ_k − W_k` to second order, if the mean of Ŝ_j is `μ_j S_j`:
    /// `Σ_j {(μ_j − 1) W_j − c_j W_j [(I − W_j) + tr(I − W_j) I]} (W_k − δ_jk I)`.
    pub fn bias(&mut self, weights: &Group<D>, c: &[f64], mean: &[f64], k: usize) -> &Square<D> {
        self.out.fill(0.0);
        for (j, (&c, mean)) in c.iter().zip(mean).enumerate() {
            self.set_term(weights, j);
            self.term.zip_apply(&weights.weight[j], |term, w| *term = (mean - 1.0) * w - c * *term);
            // W_k − δ_jk I, without cancellation
            let (change, sign) =
                if j == k { (&weights.complement[k], -1.0) } else { (&weights.weight[k], 1.0) };
            self.term.mul_to(change, &mut self.expansion);
            self.out.zip_apply(&self.expansion, |sum, x| *sum += sign * x);
        }
        &self.out
    }

    /// The excess to first order, `Σ_j c_j W_j [(I − W_j) + tr(I − W_j) I] S_p`.
    pub fn first_order(&mut self, weights: &Group<D>, c: &[f64]) -> &Square<D> {
        self.expand(weights, c);
        self.expansion.mul_to(&weights.fused, &mut self.out);
        symmetrise(&mut self.out);
        &self.out
    }

    /// Mean over draws of `Σ_j (Ŵ_j − W_j) S_j (Ŵ_j − W_j)^T`, which is exactly the excess.
    ///
    /// `factors` are the Cholesky factors L of the covariances; a draw contains one Wishart matrix B
    /// with mean I for every sensor, so that `Ŝ_j = L B L^T`.
    pub fn simulated<'a>(
        &mut self,
        problem: &Problem<D>,
        draws: impl ExactSizeIterator<Item = &'a [f64]>,
    ) -> Result<(&Square<D>, Simulated)> {
        let Problem { covariances, factors: roots, group: weights } = problem;
        let (n, m) = (draws.len() as f64, self.out.nrows());
        let scale = weights.fused.trace();
        let (mut sum, mut squares) = (0.0, 0.0);
        self.out.fill(0.0);
        for draw in draws {
            for (j, draw) in draw.chunks_exact(m * m).enumerate() {
                self.term.copy_from_slice(draw);
                roots[j].mul_to(&self.term, &mut self.expansion);
                roots[j].transpose_to(&mut self.term);
                self.expansion.mul_to(&self.term, &mut self.drawn[j]);
                symmetrise(&mut self.drawn[j]);
            }
            self.group.weigh(&self.drawn, None)?;
            let before = self.out.trace();
            for (j, s) in covariances.iter().enumerate() {
                self.add_excess(&weights.weight[j], j, s);
            }
            let loss = (self.out.trace() - before) / scale;
            sum += loss;
            squares += loss * loss;
        }
        self.out /= n;
        symmetrise(&mut self.out);
        let mean = sum / n;
        let variance = (squares / n - mean * mean).max(0.0) / (n - 1.0);
        let loss_sigma = if n > 1.0 { variance.sqrt() } else { f64::INFINITY };
        Ok((&self.out, Simulated { loss: mean, loss_sigma }))
    }

    fn add_excess(&mut self, weight: &Square<D>, j: usize, s: &Square<D>) {
        self.term.copy_from(&self.group.weight[j]);
        self.term -= weight;
        self.term.mul_to(s, &mut self.expansion);
        self.term.transpose_to(&mut self.drawn[j]);
        self.out.gemm(1.0, &self.expansion, &self.drawn[j], 1.0);
    }
}
