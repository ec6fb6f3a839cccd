//! Estimate of the errors of all radars as one Gaussian, in units of the prior.

use crate::base::matrix::inverse;
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

/// Number of observed errors that the prior is worth as an estimate of the size of errors.
const STATED: f64 = 2.0;
/// Errors exceed their prior distribution if the sum of their squares, in units of the prior, is larger than
/// these multiples of 1 and of its expectation: this happens by chance in one case in a thousand.
const CONTRADICTED: [f64; 2] = [9.0, 2.2];
/// Largest excess of a variance over that of the prior that is rounding.
const ROUNDING: f64 = 1e-9;

/// Errors, each of which is Gauss–Markov with the variance of the prior, or constant.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Gaussian {
    pub mean: DVector<f64>,
    pub covariance: DMatrix<f64>,
    /// Rate at which each error forgets its value, 1/s; 0: constant.
    rates: Vec<f64>,
}

impl Gaussian {
    /// The prior of errors that drift at these rates.
    pub fn new(rates: Vec<f64>) -> Self {
        let order = rates.len();
        Self { mean: DVector::zeros(order), covariance: DMatrix::identity(order, order), rates }
    }

    /// Rearranges the errors: each has the place before that is given, or none if it is new.
    pub fn rearrange(&mut self, before: &[Option<usize>], rates: Vec<f64>) {
        let order = before.len();
        let value = |i: usize| before[i].map_or(0.0, |place| self.mean[place]);
        let mean = DVector::from_fn(order, |i, _| value(i));
        let covariance = DMatrix::from_fn(order, order, |i, j| match (before[i], before[j]) {
            (Some(row), Some(column)) => self.covariance[(row, column)],
            _ if i == j => 1.0,
            _ => 0.0,
        });
        *self = Self { mean, covariance, rates };
    }

    /// Rate at which an error forgets its value, 1/s.
    pub fn rate(&self, column: usize) -> f64 {
        self.rates[column]
    }

    /// Lets the errors drift for some seconds. An error of which nothing is known remains as uncertain as the
    /// prior.
    pub fn drift(&mut self, seconds: f64) {
        let rest: Vec<f64> = self.rates.iter().map(|rate| (-rate * seconds).exp()).collect();
        for (i, a) in rest.iter().enumerate() {
            self.mean[i] *= a;
            for (j, b) in rest.iter().enumerate() {
                self.covariance[(i, j)] *= a * b;
            }
            self.covariance[(i, i)] += 1.0 - a * a;
        }
    }

    /// Returns the covariance for errors that are larger than their prior says, those of a `kind` by the same
    /// factor. The factor follows from `m² / (1 − P)`, which is one on average for an error that is observed;
    /// it matters for errors that are not. Cost O(q³).
    pub fn relaxed(&self, kind: &[usize]) -> DMatrix<f64> {
        self.enlarged(kind, |squares, expected| (STATED + squares) / (STATED + expected))
    }

    /// As [`Self::relaxed`], but only for errors that are clearly larger than their prior says.
    pub fn exceeded(&self, kind: &[usize]) -> DMatrix<f64> {
        self.enlarged(kind, excess)
    }

    /// Returns the covariance if the variance of the prior of each `kind` is larger by a `factor` of the sum of
    /// squares of the errors and of its expectation.
    fn enlarged(&self, kind: &[usize], factor: impl Fn(f64, f64) -> f64) -> DMatrix<f64> {
        let order = self.mean.len();
        let kinds = kind.iter().copied().max().map_or(0, |most| most + 1);
        let mut sums = vec![[0.0; 2]; kinds];
        for (i, &kind) in kind.iter().enumerate() {
            sums[kind][0] += self.mean[i] * self.mean[i];
            sums[kind][1] += 1.0 - self.covariance[(i, i)];
        }
        let less = |[squares, expected]: [f64; 2]| (1.0 - 1.0 / factor(squares, expected)).max(0.0);
        let less: Vec<f64> = sums.into_iter().map(less).collect();
        if less.iter().all(|less| *less == 0.0) {
            return self.covariance.clone();
        }
        // after a sudden change some combination of errors is less certain than the prior says anyway
        let certain = DMatrix::from_diagonal_element(order, order, 1.0 + ROUNDING);
        if (certain - &self.covariance).cholesky().is_none() {
            return self.covariance.clone();
        }
        // (P⁻¹ − D)⁻¹, where D is the decrease of the information of the prior
        let mut sum = DMatrix::identity(order, order);
        for (j, &kind) in kind.iter().enumerate() {
            for i in 0..order {
                sum[(i, j)] -= self.covariance[(i, j)] * less[kind];
            }
        }
        let Some(inverse) = inverse(&sum) else { return self.covariance.clone() };
        let covariance = inverse * &self.covariance;
        0.5 * (&covariance + covariance.transpose())
    }

    /// Multiplies the information beyond that of the prior by a factor. Cost O(q³).
    pub fn scale(&mut self, factor: f64) {
        if let Some(covariance) = scaled(&self.covariance, factor) {
            self.covariance = covariance;
        }
    }

    /// Updates the estimate by normal equations about errors of zero. Cost O(q³).
    pub fn update(&mut self, information: &DMatrix<f64>, score: &DVector<f64>) {
        let order = self.mean.len();
        let sum = DMatrix::identity(order, order) + &self.covariance * information;
        let Some(inverse) = inverse(&sum) else { return };
        let covariance = inverse * &self.covariance;
        self.covariance = 0.5 * (&covariance + covariance.transpose());
        self.mean += &self.covariance * (score - information * &self.mean);
    }
}

/// Returns the factor of the variance of a prior that errors clearly exceed, given the sum of their squares in
/// units of the prior and its expectation; 1 if they do not exceed it.
pub(super) fn excess(squares: f64, expected: f64) -> f64 {
    let is_clear = squares > CONTRADICTED[0] + CONTRADICTED[1] * expected;
    if is_clear { squares / expected.max(0.5) } else { 1.0 }
}

/// Returns the covariance, in units of the prior, with the information beyond that of the prior times a factor.
/// None if some error is less certain than the prior says, and there is no such information.
pub(super) fn scaled(covariance: &DMatrix<f64>, factor: f64) -> Option<DMatrix<f64>> {
    let order = covariance.nrows();
    // (1 + f (P⁻¹ − 1))⁻¹ = (f + (1 − f) P)⁻¹ P
    let sum = DMatrix::from_diagonal_element(order, order, factor) + (1.0 - factor) * covariance;
    let product = sum.cholesky()?.inverse() * covariance;
    Some(0.5 * (&product + product.transpose()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen() -> Gaussian {
        let mut errors = Gaussian::new(vec![0.0, 1e-3]);
        errors.update(
            &DMatrix::from_row_slice(2, 2, &[3.0, 1.0, 1.0, 3.0]),
            &DVector::from_row_slice(&[2.0, -1.0]),
        );
        errors
    }

    #[test]
    fn an_error_drifts_back_to_its_prior() {
        let (before, mut after) = (seen(), seen());
        after.drift(500.0);
        let rest = (-0.5_f64).exp();
        assert_eq!(after.mean[0], before.mean[0]);
        assert_eq!(after.covariance[(0, 0)], before.covariance[(0, 0)]);
        assert!((after.mean[1] - rest * before.mean[1]).abs() < 1e-15);
        let variance = rest * rest * (before.covariance[(1, 1)] - 1.0) + 1.0;
        assert!((after.covariance[(1, 1)] - variance).abs() < 1e-15);
        assert!((after.covariance[(0, 1)] - rest * before.covariance[(0, 1)]).abs() < 1e-15);
        after.drift(1e6);
        assert!((after.covariance[(1, 1)] - 1.0).abs() < 1e-12);
        assert!(after.mean[1].abs() < 1e-12);
    }

    #[test]
    fn errors_larger_than_their_prior_relax_it() {
        let small = seen();
        assert_eq!(small.relaxed(&[0, 1]), small.covariance);
        assert_eq!(small.exceeded(&[0, 1]), small.covariance);
        // twice and four times the prior: (2 + 4 + 16) / (2 + 2 (1 − 4/15)) of the variance
        let large = Gaussian { mean: DVector::from_row_slice(&[2.0, -4.0]), ..seen() };
        let factor: f64 = 22.0 / (2.0 + 22.0 / 15.0);
        let precision = large.covariance.clone().try_inverse().unwrap();
        let less = DMatrix::identity(2, 2) * (1.0 - 1.0 / factor);
        let expected = (precision - less).try_inverse().unwrap();
        let found = large.relaxed(&[0, 0]);
        for (found, expected) in found.iter().zip(expected.iter()) {
            assert!((found - expected).abs() < 1e-12, "{found} {expected}");
        }
        assert!(found[(0, 0)] > large.covariance[(0, 0)]);
        // (4 + 16) / (22 / 15) of the variance, if that is clearly more than expected
        assert!(large.exceeded(&[0, 0])[(0, 0)] > found[(0, 0)]);
        let less_large = Gaussian { mean: DVector::from_row_slice(&[2.0, -2.0]), ..seen() };
        assert_eq!(less_large.exceeded(&[0, 0]), less_large.covariance);
    }

    #[test]
    fn a_sum_of_errors_less_certain_than_the_prior_is_not_relaxed() {
        let errors = Gaussian {
            mean: DVector::from_row_slice(&[3.0, 3.0]),
            covariance: DMatrix::from_row_slice(2, 2, &[0.9, 0.8, 0.8, 0.9]),
            ..Gaussian::new(vec![0.0; 2])
        };
        assert_eq!(errors.relaxed(&[0, 0]), errors.covariance);
    }

    #[test]
    fn information_is_scaled() {
        let (before, mut after) = (seen(), seen());
        after.scale(0.25);
        let data = |own: &Gaussian| {
            own.covariance.clone().try_inverse().unwrap() - DMatrix::identity(2, 2)
        };
        for (found, before) in data(&after).iter().zip(data(&before).iter()) {
            assert!((found - 0.25 * before).abs() < 1e-12);
        }
        after.scale(4.0);
        assert!((&after.covariance - &before.covariance).amax() < 1e-12);
        assert_eq!(after.mean, before.mean);
    }

    #[test]
    fn normal_equations_are_solved() {
        // (I + Y)⁻¹ of Y = [3 1; 1 3]: [4 −1; −1 4] / 15
        let errors = seen();
        let expected = [4.0 / 15.0, -1.0 / 15.0, -1.0 / 15.0, 4.0 / 15.0];
        for (found, expected) in errors.covariance.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-15);
        }
        assert!((errors.mean[0] - 9.0 / 15.0).abs() < 1e-15);
        assert!((errors.mean[1] + 6.0 / 15.0).abs() < 1e-15);
    }
}
