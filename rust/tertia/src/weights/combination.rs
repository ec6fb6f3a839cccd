//! The fused estimate, and whether the estimates agree.

use super::group::{Group, Sum};
use crate::base::distribution::chi_square_upper;
use crate::base::error::{Error, Result};
use crate::base::matrix::{Square, symmetrise, zeros};
use nalgebra::allocator::Allocator;
use nalgebra::{DefaultAllocator, Dim, OVector};

/// Beyond this size squares of differences overflow.
const LARGEST: f64 = 1e150;

/// Whether estimates agree within their covariances.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Agreement {
    /// `Σ_k (x_k − x̂)^T C_k (x_k − x̂)`: chi-square with (K − 1) m degrees of freedom.
    pub statistic: f64,
    /// Probability of a larger one where the covariances are right.
    pub p_value: f64,
}

/// A measured scalar that depends linearly on the vector.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scalar<'a> {
    /// Its derivatives.
    pub h: &'a [f64],
    /// What was measured.
    pub value: f64,
    /// Standard deviation of the measurement.
    pub sigma: f64,
}

/// Buffers.
pub(crate) struct Combiner<D: Dim>
where
    DefaultAllocator: Allocator<D, D> + Allocator<D>,
{
    difference: OVector<f64, D>,
    fused: OVector<f64, D>,
    innovation: OVector<f64, D>,
    weighted: OVector<f64, D>,
    before: Square<D>,
    after: Square<D>,
    scratch: Square<D>,
    sum: Sum<D>,
}

impl<D: Dim> Combiner<D>
where
    DefaultAllocator: Allocator<D, D> + Allocator<D>,
{
    pub fn new(order: D) -> Self {
        let vector = || OVector::zeros_generic(order, nalgebra::U1);
        Self {
            difference: vector(),
            fused: vector(),
            innovation: vector(),
            weighted: vector(),
            before: zeros(order),
            after: zeros(order),
            scratch: zeros(order),
            sum: Sum::new(order),
        }
    }

    /// `x_1 + Σ_k W_k (x_k − x_1)`: a common offset costs no digits.
    pub fn fuse(&mut self, estimates: &[f64], weights: &Group<D>, out: &mut [f64]) {
        self.fused.fill(0.0);
        for (k, weight) in weights.weight.iter().enumerate().skip(1) {
            self.set_difference(estimates, k);
            weight.mul_to(&self.difference, &mut self.weighted);
            self.fused += &self.weighted;
        }
        for (i, value) in out.iter_mut().enumerate() {
            *value = estimates[i] + self.fused[i];
        }
    }

    /// The statistic as the sum of what each estimate adds to those before it,
    /// `d^T (F + S_k)^-1 d`: no covariance is inverted, and every term is positive.
    pub fn agreement(&mut self, estimates: &[f64], s: &[Square<D>]) -> Result<Agreement> {
        let mut statistic = 0.0;
        self.fused.fill(0.0);
        self.before.copy_from(&s[0]);
        for (k, covariance) in s.iter().enumerate().skip(1) {
            self.set_difference(estimates, k);
            self.innovation.copy_from(&self.difference);
            self.innovation -= &self.fused;
            self.sum.fuse(&self.before, covariance, k, &mut self.after)?;
            self.sum.invert(&self.before, covariance, k)?;
            self.sum.inverse.mul_to(&self.innovation, &mut self.weighted);
            statistic += self.weighted.dot(&self.innovation);
            self.before.mul_to(&self.weighted, &mut self.difference);
            self.fused += &self.difference;
            std::mem::swap(&mut self.before, &mut self.after);
        }
        // differences that are so large that the sum overflows
        let statistic = if statistic.is_nan() { f64::INFINITY } else { statistic };
        let degrees_of_freedom = (s.len() - 1) * self.fused.len();
        Ok(Agreement { statistic, p_value: chi_square_upper(statistic, degrees_of_freedom) })
    }

    /// Adds a scalar `z = h·x + noise`, as information of rank one: gain `g = S h / (h·S h + σ²)`,
    /// covariance `(I − g h^T) S (I − g h^T)^T + σ² g g^T`.
    pub fn add_scalar(
        &mut self,
        estimate: &[f64],
        covariance: &Square<D>,
        scalar: &Scalar<'_>,
        value: &mut [f64],
    ) -> Agreement {
        let variance = scalar.sigma * scalar.sigma;
        self.difference.copy_from_slice(scalar.h);
        covariance.mul_to(&self.difference, &mut self.weighted);
        let innovation_variance = self.difference.dot(&self.weighted) + variance;
        self.weighted /= innovation_variance;
        self.fused.copy_from_slice(estimate);
        let innovation = scalar.value - self.difference.dot(&self.fused);
        self.fused.axpy(innovation, &self.weighted, 1.0);
        value.copy_from_slice(self.fused.as_slice());
        self.before.fill_with_identity();
        self.before.ger(-1.0, &self.weighted, &self.difference, 1.0);
        self.before.transpose_to(&mut self.after);
        covariance.mul_to(&self.after, &mut self.scratch);
        self.before.mul_to(&self.scratch, &mut self.after);
        self.after.ger(variance, &self.weighted, &self.weighted, 1.0);
        symmetrise(&mut self.after);
        for i in 0..estimate.len() {
            // rounding leaves no variance below that of the scalar alone
            let least = variance * self.weighted[i] * self.weighted[i];
            self.after[(i, i)] = self.after[(i, i)].max(least);
        }
        let statistic = innovation * innovation / innovation_variance;
        Agreement { statistic, p_value: chi_square_upper(statistic, 1) }
    }

    /// The covariance with the scalar added, and its gain.
    pub fn with_scalar(&self) -> (&Square<D>, &[f64]) {
        (&self.after, self.weighted.as_slice())
    }

    fn set_difference(&mut self, estimates: &[f64], k: usize) {
        let m = self.difference.len();
        for i in 0..m {
            self.difference[i] = estimates[k * m + i] - estimates[i];
        }
    }
}

/// Fails with the first number among vectors of length m that is not finite, or too large.
pub(crate) fn require_estimates(
    argument: &'static str,
    estimates: &[f64],
    place: impl Fn(usize) -> Vec<usize>,
) -> Result<()> {
    match estimates.iter().position(|x| x.is_nan() || x.abs() > LARGEST) {
        None => Ok(()),
        Some(i) => Err(Error::InvalidElement {
            argument,
            index: place(i),
            value: estimates[i],
            requirement: "it must be a number of at most 1e150 in size",
        }),
    }
}
