//! Covariance, standard deviation and dilution of precision at a minimum.

use super::descent::{Loss, TUKEY};
use super::doubt::doubt;
use super::lenth::{self, Weight};
use super::search::{Minimum, Search};
use crate::base::small::{Factor, Matrix, add, undetermined};
use crate::sensors::{Measurement, Row};

/// Steps to the σ whose weighted residuals are as large as those found.
const SPREAD_STEPS: usize = 20;
/// Least sum of the weights beyond what the coordinates use up.
const LEAST_REST: f64 = 1e-9;

impl<const D: usize> Search<'_, D> {
    /// Covariance, σ and dilution, from residuals and their derivatives.
    pub fn summary(
        &self,
        minimum: &Minimum<D>,
        lenth: Option<Weight>,
        rows: &[Row<D>],
    ) -> Summary<D> {
        let robust = self.loss != Loss::Square;
        let fault = match lenth {
            Some(Weight::Andrews) => lenth::ZERO,
            None if robust => TUKEY,
            _ => f64::INFINITY,
        };
        let reciprocal = 1.0 / minimum.scale;
        let mut spread = Spread::of(self.problem.measurements);
        let (mut sum, mut total) = (0.0, 0.0);
        for (m, row) in self.problem.measurements.iter().zip(rows) {
            let u = row.residual * reciprocal;
            let (weight, ..) = self.loss.at(u);
            sum += weight * u * u;
            total += weight;
            spread.add(m, row, u.abs() < fault);
        }
        let dop = spread.dop();
        let unit = if robust { Expected::of_tukey(1.0).spread } else { 1.0 };
        let kept = (sum / unit, total - D as f64);
        if lenth.is_some() {
            let covariance = minimum.normal.matrix;
            return Summary { covariance, sigma: minimum.scale, fault, dop, kept };
        }
        let inverse = Factor::try_new(&minimum.normal.matrix, 0.0)
            .map_or_else(undetermined, |factor| factor.inverse());
        let of =
            |sigma: f64| if robust { Expected::of_tukey(sigma) } else { Expected::of_square() };
        let mut sigma = 1.0;
        if self.unknown {
            let rest = total - D as f64;
            if rest < LEAST_REST {
                let covariance = undetermined();
                return Summary { covariance, sigma: f64::NAN, fault, dop, kept };
            }
            sigma = (sum / rest).sqrt();
            for _ in 0..SPREAD_STEPS {
                sigma = (sum / rest / of(sigma).spread).sqrt();
            }
        }
        let factor = of(sigma).variance * sigma * sigma;
        let mut covariance = inverse.map(|row| row.map(|v| v * factor));
        if robust {
            let rows = rows.iter().map(|row| {
                let row = row.scaled(reciprocal);
                (row, self.loss.at(row.residual).0)
            });
            add(&mut covariance, &doubt(rows, &inverse));
        }
        Summary { covariance, sigma: minimum.scale * sigma, fault, dop, kept }
    }
}

/// What Tukey's weights do to normal errors of some σ, in units of the scale.
pub(super) struct Expected {
    /// `E w E ψ² / (E ψ')² / σ²`: the variance of an estimate over `σ² / Σ w`.
    variance: f64,
    /// `E w r² / E w / σ²`
    pub spread: f64,
}

impl Expected {
    fn of_square() -> Self {
        Self { variance: 1.0, spread: 1.0 }
    }

    /// Moments of the normal distribution; what is beyond c is left out, less than 1e-5 up to σ = 1.
    pub fn of_tukey(sigma: f64) -> Self {
        let q = (sigma.min(1.0) / TUKEY).powi(2);
        let weight = 1.0 - 2.0 * q + 3.0 * q * q;
        // E w r² and E ψ' are the same
        let slope = 1.0 - 6.0 * q + 15.0 * q * q;
        let square = 1.0 - 12.0 * q + 90.0 * q * q - 420.0 * q.powi(3) + 945.0 * q.powi(4);
        Self { variance: weight * square / (slope * slope), spread: slope / weight }
    }
}

/// What is made of a minimum.
pub(super) struct Summary<const D: usize> {
    pub covariance: Matrix<D>,
    pub sigma: f64,
    /// Residuals from here on have no weight.
    pub fault: f64,
    pub dop: f64,
    /// Sum of the weighted squares of the residuals, and its degrees of freedom.
    pub kept: (f64, f64),
}

/// The information of errors of size 1, where their unit is the same.
pub(super) struct Spread<const D: usize> {
    matrix: Matrix<D>,
    mixed: bool,
}

impl<const D: usize> Spread<D> {
    pub fn of(measurements: &[Measurement<D>]) -> Self {
        let angles = measurements.iter().filter(|m| m.kind.is_angle()).count();
        let mixed = angles != 0 && angles != measurements.len();
        Self { matrix: [[0.0; D]; D], mixed }
    }

    pub fn add(&mut self, m: &Measurement<D>, row: &Row<D>, counts: bool) {
        if self.mixed || !counts {
            return;
        }
        let square = 1.0 / (m.precision * m.precision);
        for i in 0..D {
            for j in 0..=i {
                self.matrix[i][j] += square * row.gradient[i] * row.gradient[j];
            }
        }
    }

    /// Root of the trace of the covariance; nan where units are mixed.
    pub fn dop(&self) -> f64 {
        if self.mixed {
            return f64::NAN;
        }
        let Some(factor) = Factor::try_new(&self.matrix, 0.0) else { return f64::INFINITY };
        let inverse = factor.inverse();
        (0..D).map(|i| inverse[i][i]).sum::<f64>().sqrt()
    }
}
