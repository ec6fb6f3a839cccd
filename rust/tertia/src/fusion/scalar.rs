//! A redundant scalar measurement, added to an estimate as information of rank one.

use crate::base::distribution::chi_square_upper;
use crate::base::matrix::{Square, symmetrise, zeros};
use nalgebra::allocator::Allocator;
use nalgebra::{DefaultAllocator, Dim, OVector};

/// An estimate (m), its covariance (m, m), and a measured scalar that depends linearly on the vector.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scalar<'a> {
    /// The estimate without the scalar.
    pub estimate: &'a [f64],
    /// Covariance of the estimate.
    pub covariance: &'a [f64],
    /// The derivatives of the scalar by the vector (m).
    pub h: &'a [f64],
    /// The measured value.
    pub value: f64,
    /// Standard deviation of the measurement.
    pub sigma: f64,
}

/// An estimate with an added scalar, with its buffers.
pub(super) struct Addition<D: Dim>
where
    DefaultAllocator: Allocator<D, D> + Allocator<D>,
{
    /// x̂.
    pub mean: OVector<f64, D>,
    pub covariance: Square<D>,
    /// Gain of the scalar.
    pub gain: OVector<f64, D>,
    h: OVector<f64, D>,
    kept: Square<D>,
    scratch: Square<D>,
}

impl<D: Dim> Addition<D>
where
    DefaultAllocator: Allocator<D, D> + Allocator<D>,
{
    pub fn new(order: D) -> Self {
        let vector = || OVector::zeros_generic(order, nalgebra::U1);
        Self {
            mean: vector(),
            covariance: zeros(order),
            gain: vector(),
            h: vector(),
            kept: zeros(order),
            scratch: zeros(order),
        }
    }

    /// Adds `z = h·x + noise` to an estimate with this covariance. Returns the normalised innovation
    /// squared and the probability of a larger one. The gain is `g = S h / (h·S h + σ²)`, the covariance
    /// `(I − g h^T) S (I − g h^T)^T + σ² g g^T`. Cost O(m³).
    pub fn add(&mut self, covariance: &Square<D>, scalar: &Scalar<'_>) -> (f64, f64) {
        let variance = scalar.sigma * scalar.sigma;
        self.h.copy_from_slice(scalar.h);
        covariance.mul_to(&self.h, &mut self.gain);
        let innovation_variance = self.h.dot(&self.gain) + variance;
        self.gain /= innovation_variance;
        self.mean.copy_from_slice(scalar.estimate);
        let innovation = scalar.value - self.h.dot(&self.mean);
        self.mean.axpy(innovation, &self.gain, 1.0);
        self.kept.fill_with_identity();
        self.kept.ger(-1.0, &self.gain, &self.h, 1.0);
        self.kept.transpose_to(&mut self.covariance);
        covariance.mul_to(&self.covariance, &mut self.scratch);
        self.kept.mul_to(&self.scratch, &mut self.covariance);
        self.covariance.ger(variance, &self.gain, &self.gain, 1.0);
        symmetrise(&mut self.covariance);
        for (i, gain) in self.gain.iter().enumerate() {
            // rounding must not make a variance smaller than what the scalar alone contributes
            self.covariance[(i, i)] = self.covariance[(i, i)].max(variance * gain * gain);
        }
        let statistic = innovation * innovation / innovation_variance;
        (statistic, chi_square_upper(statistic, 1))
    }
}
