//! The best linear combination of independent estimates, based on [`crate::weights`].

use crate::base::error::Result;
use crate::base::matrix::{Square, zeros};
use crate::weights::{Group, Sum};
use nalgebra::allocator::Allocator;
use nalgebra::{DefaultAllocator, Dim, OVector};

/// A combination, with its buffers.
pub(super) struct Independent<D: Dim>
where
    DefaultAllocator: Allocator<D, D> + Allocator<D>,
{
    /// Contains the weights W_k and the fused covariance.
    pub group: Group<D>,
    sum: Sum<D>,
    before: Square<D>,
    after: Square<D>,
    mean: OVector<f64, D>,
    innovation: OVector<f64, D>,
    scratch: OVector<f64, D>,
}

impl<D: Dim> Independent<D>
where
    DefaultAllocator: Allocator<D, D> + Allocator<D>,
{
    pub fn new(sensors: usize, order: D) -> Self {
        let vector = || OVector::zeros_generic(order, nalgebra::U1);
        Self {
            group: Group::new(sensors, order),
            sum: Sum::new(order),
            before: zeros(order),
            after: zeros(order),
            mean: vector(),
            innovation: vector(),
            scratch: vector(),
        }
    }

    /// Combines estimates (K, m); returns `Σ_k (x_k − x̂)^T C_k (x_k − x̂)`. Cost O(K m³).
    ///
    /// The statistic is the sum of the contributions `d^T (F + S_k)^-1 d` of each estimate to those before
    /// it. No covariance is inverted, and every term is positive.
    pub fn combine(&mut self, x: &[f64], s: &[Square<D>]) -> Result<f64> {
        self.group.weigh(s, None)?;
        self.group.fuse(s, None)?;
        self.group.require_known()?;
        let mut statistic = 0.0;
        // relative to the first estimate, so that a common offset costs no digits
        self.mean.fill(0.0);
        self.before.copy_from(&s[0]);
        let m = self.mean.len();
        for (k, covariance) in s.iter().enumerate().skip(1) {
            for i in 0..m {
                self.innovation[i] = x[k * m + i] - x[i];
            }
            self.innovation -= &self.mean;
            self.sum.fuse(&self.before, covariance, k, &mut self.after)?;
            self.sum.invert(&self.before, covariance, k)?;
            self.sum.inverse.mul_to(&self.innovation, &mut self.scratch);
            statistic += self.scratch.dot(&self.innovation);
            self.before.mul_to(&self.scratch, &mut self.innovation);
            self.mean += &self.innovation;
            std::mem::swap(&mut self.before, &mut self.after);
        }
        // differences so large that the sum overflows
        Ok(if statistic.is_nan() { f64::INFINITY } else { statistic })
    }
}
