//! Change of a weight with the covariances, to first order, and the covariances of weights that result
//! from it.
//!
//! `dW_k = Σ_j B_j dS_j A_j` with `B_j = W_j` and `A_j = C_j (W_k − δ_jk I)`. The blocks of the Jacobian
//! are therefore `P_kj = A_j^T ⊗ B_j` (vec by columns), and everything else follows from A_j and B_j.

use super::group::{Problem, Sum};
use crate::base::error::Result;
use crate::base::matrix::{Square, symmetrise, zeros};
use nalgebra::allocator::Allocator;
use nalgebra::{DefaultAllocator, Dim};

/// The factors of the blocks of the Jacobian, with buffers.
pub(crate) struct Propagation<D: Dim>
where
    DefaultAllocator: Allocator<D, D>,
{
    /// B_j.
    pub left: Vec<Square<D>>,
    /// A_j.
    pub right: Vec<Square<D>>,
    sum: Sum<D>,
    terms: Terms<D>,
}

/// `c cov(vec BXA)` for a covariance X with `E dX_ij dX_ql = s_iq s_jl + s_il s_jq`.
struct Terms<D: Dim>
where
    DefaultAllocator: Allocator<D, D>,
{
    /// `A^T S A`.
    u: Square<D>,
    /// `B S B^T`.
    r: Square<D>,
    /// `B S A`.
    q: Square<D>,
    scratch: Square<D>,
}

impl<D: Dim> Propagation<D>
where
    DefaultAllocator: Allocator<D, D>,
{
    pub fn new(sensors: usize, order: D) -> Self {
        let list = || vec![zeros(order); sensors];
        Self { left: list(), right: list(), sum: Sum::new(order), terms: Terms::new(order) }
    }

    /// Computes the factors for the weight of sensor k.
    ///
    /// With the weights V_j and the fused covariance A of the others and `G = (A + S_k)^-1`:
    /// `W_k = A G`, `W_j = (I − W_k) V_j`, `C_j W_k = V_j^T G`, `C_k (W_k − I) = −G`.
    pub fn factors(&mut self, problem: &mut Problem<D>, k: usize) -> Result<()> {
        let Problem { covariances, group: others, .. } = problem;
        others.weigh(covariances, Some(k))?;
        others.fuse(covariances, Some(k))?;
        let Self { left, right, sum, terms } = self;
        sum.invert(&others.fused, &covariances[k], k)?;
        let (g, complement) = (&sum.inverse, &mut terms.scratch);
        others.fused.mul_to(g, &mut left[k]);
        right[k].copy_from(g);
        right[k].neg_mut();
        covariances[k].mul_to(g, complement);
        for (member, j) in (0..covariances.len()).filter(|&j| j != k).enumerate() {
            if covariances.len() == 2 {
                left[j].copy_from(complement);
                right[j].copy_from(g);
            } else {
                complement.mul_to(&others.weight[member], &mut left[j]);
                others.weight[member].tr_mul_to(g, &mut right[j]);
            }
        }
        Ok(())
    }

    /// Writes the blocks `P_kj`, each m² by m², row by row.
    pub fn write_jacobian(&mut self, out: &mut [f64]) {
        let m = self.left[0].nrows();
        let blocks = out.chunks_exact_mut(m.pow(4));
        for ((left, right), block) in self.left.iter().zip(&self.right).zip(blocks) {
            left.transpose_to(&mut self.terms.r);
            for (b, rows) in block.chunks_exact_mut(m.pow(3)).enumerate() {
                for (a, row) in rows.chunks_exact_mut(m.pow(2)).enumerate() {
                    let of_a = &self.terms.r.as_slice()[a * m..][..m];
                    for (q, values) in row.chunks_exact_mut(m).enumerate() {
                        let factor = right[(q, b)];
                        for (value, of_a) in values.iter_mut().zip(of_a) {
                            *value = factor * of_a;
                        }
                    }
                }
            }
        }
    }

    /// Sums `c_j P_kj (S_j ⊗ S_j)(I + K) P_kj^T` over the sensors, m² by m², in O(K m⁴).
    pub fn write_covariance(&mut self, covariances: &[Square<D>], c: &[f64], out: &mut [f64]) {
        for j in 0..covariances.len() {
            self.terms.set(&covariances[j], &self.left[j], &self.right[j]);
            if j == 0 {
                self.terms.put::<false>(c[j], out);
            } else {
                self.terms.put::<true>(c[j], out);
            }
        }
    }
}

impl<D: Dim> Terms<D>
where
    DefaultAllocator: Allocator<D, D>,
{
    fn new(order: D) -> Self {
        let new = || zeros(order);
        Self { u: new(), r: new(), q: new(), scratch: new() }
    }

    fn set(&mut self, s: &Square<D>, left: &Square<D>, right: &Square<D>) {
        s.mul_to(right, &mut self.scratch);
        right.tr_mul_to(&self.scratch, &mut self.u);
        left.mul_to(&self.scratch, &mut self.q);
        left.transpose_to(&mut self.r);
        s.mul_to(&self.r, &mut self.scratch);
        left.mul_to(&self.scratch, &mut self.r);
        symmetrise(&mut self.u);
        symmetrise(&mut self.r);
    }

    /// Writes or adds `c (U_bq R_ap + Q_aq Q_pb)` at row (b, a) and column (q, p); exactly symmetric.
    fn put<const ADD: bool>(&mut self, c: f64, out: &mut [f64]) {
        self.u *= c;
        self.q *= c.sqrt();
        let m = self.u.nrows();
        for (b, rows) in out.chunks_exact_mut(m.pow(3)).enumerate() {
            let of_b = &self.q.as_slice()[b * m..][..m];
            for (a, row) in rows.chunks_exact_mut(m.pow(2)).enumerate() {
                let of_a = &self.r.as_slice()[a * m..][..m];
                for (q, values) in row.chunks_exact_mut(m).enumerate() {
                    let (u, f) = (self.u[(b, q)], self.q[(a, q)]);
                    for ((value, of_a), of_b) in values.iter_mut().zip(of_a).zip(of_b) {
                        let term = u * of_a + f * of_b;
                        *value = if ADD { *value + term } else { term };
                    }
                }
            }
        }
    }
}

/// Writes `c (S ⊗ S)(I + K)`, the covariance of vec S of a sample covariance. Cost O(m⁴).
pub(crate) fn write_covariance_of_covariance<D: Dim>(s: &Square<D>, c: f64, out: &mut [f64])
where
    DefaultAllocator: Allocator<D, D>,
{
    let (order, _) = s.shape_generic();
    let mut terms = Terms { u: s.clone(), r: s.clone(), q: s.clone(), scratch: zeros(order) };
    terms.put::<false>(c, out);
}
