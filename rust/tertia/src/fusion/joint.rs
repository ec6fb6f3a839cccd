//! The best linear combination of estimates whose errors are correlated.
//!
//! The estimates are fused into x̂ one by one. With `F = cov(x̂)`, `P = cov(x_k)`,
//! `C = cov(x̂, x_k)` and the difference `ν = x_k − x̂`:
//! ```text
//! A = F − C,  B = P − C^T,  S = A + B = cov(ν)
//! x̂ ← B S^-1 x̂ + A S^-1 x_k,  F ← C + A S^-1 B^T
//! ```
//!
//! The part of later estimates that is correlated with ν is subtracted from them,
//! `x_j ← x_j − cov(x_j, ν) S^-1 ν`; after that, nothing that remains is correlated with ν.
//! Only covariances of differences are inverted. Without correlation, the formulas reduce to those of
//! [`crate::weights`].

use crate::base::error::{Error, Result};
use crate::base::matrix::{
    Square, factorise_sum, half_solve, invert, is_regular, is_semidefinite, symmetrise, zeros,
};
use nalgebra::allocator::Allocator;
use nalgebra::{DefaultAllocator, Dim, OVector, U1};

/// Largest relative error of a fused variance that is accepted after rounding.
const ERROR_ALLOWED: f64 = 1e-3;

/// A combination, with its intermediate results.
pub(super) struct Joint<D: Dim>
where
    DefaultAllocator: Allocator<D, D>,
{
    order: D,
    /// W_k.
    pub weight: Vec<Square<D>>,
    /// F.
    pub fused: Square<D>,
    /// cov(x_j, x_l), row by row, of the estimates that are not fused yet.
    blocks: Vec<Square<D>>,
    /// cov(x̂, x_j).
    with_fused: Vec<Square<D>>,
    /// x_j as linear combinations of the given estimates, row by row.
    parts: Vec<Square<D>>,
    /// Whether the new estimate has the smaller variance in a component than the fused one before it.
    is_better: Vec<bool>,
    factor: Square<D>,
    inverse: Square<D>,
}

impl<D: Dim> Joint<D>
where
    DefaultAllocator: Allocator<D, D> + Allocator<D>,
{
    pub fn new(order: D) -> Self {
        Self {
            order,
            weight: Vec::new(),
            fused: zeros(order),
            blocks: Vec::new(),
            with_fused: Vec::new(),
            parts: Vec::new(),
            is_better: Vec::new(),
            factor: zeros(order),
            inverse: zeros(order),
        }
    }

    /// Combines estimates (which are modified) with the covariance `blocks`, row by row. Returns
    /// `Σ ν^T S^-1 ν`. Cost O(K³ m³).
    pub fn combine(&mut self, x: &mut [OVector<f64, D>], blocks: &[Square<D>]) -> Result<f64> {
        let count = x.len();
        self.start(count, blocks);
        let mut value = x[0].clone_owned();
        let mut statistic = 0.0;
        for k in 1..count {
            let (a, b) = self.add(k, &blocks[k * count + k])?;
            let difference = &x[k] - &value;
            let normalised = &self.inverse * &difference;
            statistic += normalised.dot(&difference);
            value += &a * &normalised;
            let (kept, gain) = (&b * &self.inverse, &a * &self.inverse);
            self.take_from_later(k, &kept, &gain, |j, shared| x[j] -= shared * &normalised);
            for n in 0..=k {
                let part = &self.parts[k * count + n];
                self.weight[n] = &kept * &self.weight[n] + &gain * part;
            }
        }
        if is_semidefinite(&self.fused, &mut self.factor) {
            // differences so large that their squares overflow
            Ok(if statistic.is_nan() { f64::INFINITY } else { statistic })
        } else {
            Err(Error::SingularJoint)
        }
    }

    fn start(&mut self, count: usize, blocks: &[Square<D>]) {
        let none = || zeros(self.order);
        self.weight = vec![none(); count];
        self.parts = vec![none(); count * count];
        self.weight[0].fill_with_identity();
        for k in 0..count {
            self.parts[k * count + k].fill_with_identity();
        }
        self.fused.copy_from(&blocks[0]);
        self.blocks = blocks.to_vec();
        self.with_fused = blocks[..count].to_vec();
    }

    /// Sets S^-1 and the fused covariance; returns A and B. `own` is the covariance of the estimate as
    /// it was given; what the earlier steps have left of it may be rounding error.
    fn add(&mut self, k: usize, own: &Square<D>) -> Result<(Square<D>, Square<D>)> {
        let (count, m) = (self.weight.len(), own.nrows());
        self.is_better.clear();
        self.is_better.extend((0..m).map(|i| own[(i, i)] < self.fused[(i, i)]));
        let cross = &self.with_fused[k];
        let a = &self.fused - cross;
        let b = &self.blocks[k * count + k] - cross.transpose();
        if !factorise_sum(&a, &b, &mut self.factor) {
            return Err(Error::SingularJoint);
        }
        // as a product of two halves, as for the fused covariance of independent estimates
        let (mut u, mut v) = (a.transpose(), b.transpose());
        half_solve(&self.factor, &mut u);
        half_solve(&self.factor, &mut v);
        invert(&mut self.factor, &mut self.inverse);
        if !is_regular(&self.fused, own, &self.inverse) {
            return Err(Error::SingularJoint);
        }
        let mut fused = cross + u.tr_mul(&v);
        symmetrise(&mut fused);
        let rounding = f64::EPSILON * m as f64 / ERROR_ALLOWED;
        let terms = |i: usize| (0..m).map(|p| (u[(p, i)] * v[(p, i)]).abs()).sum::<f64>();
        if !(0..m).all(|i| fused[(i, i)] > rounding * (cross[(i, i)].abs() + terms(i))) {
            return Err(Error::SingularJoint);
        }
        self.fused.copy_from(&fused);
        Ok((a, b))
    }

    /// Subtracts the part that is correlated with the difference ν from the estimates after k.
    fn take_from_later(
        &mut self,
        k: usize,
        kept: &Square<D>,
        gain: &Square<D>,
        mut change: impl FnMut(usize, &Square<D>),
    ) {
        let (count, later) = (self.weight.len(), k + 1);
        // cov(x_j, ν)
        let shared: Vec<_> = (later..count)
            .map(|j| &self.blocks[j * count + k] - self.with_fused[j].transpose())
            .collect();
        for (j, shared_j) in (later..count).zip(&shared) {
            change(j, shared_j);
            let taken = shared_j * &self.inverse;
            for n in 0..=k {
                let difference = &self.parts[k * count + n] - &self.weight[n];
                self.parts[j * count + n] -= &taken * difference;
            }
            for (l, shared_l) in (later..count).zip(&shared) {
                self.blocks[j * count + l] -= &taken * shared_l.transpose();
            }
            // computed from the estimate with the smaller variance, so that the common part is exact
            let (of_new, of_old) = (gain * shared_j.transpose(), kept * shared_j.transpose());
            let (own, with_fused) = (&self.blocks[k * count + j], &mut self.with_fused[j]);
            for (i, &is_better) in self.is_better.iter().enumerate() {
                for l in 0..of_new.ncols() {
                    with_fused[(i, l)] = if is_better {
                        own[(i, l)] - of_old[(i, l)]
                    } else {
                        with_fused[(i, l)] + of_new[(i, l)]
                    };
                }
            }
        }
    }
}

/// Returns a vector of zeros.
pub(super) fn vector<D: Dim>(order: D) -> OVector<f64, D>
where
    DefaultAllocator: Allocator<D>,
{
    OVector::zeros_generic(order, U1)
}
