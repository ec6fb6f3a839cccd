//! Covariance, standard deviation and dilution of precision at a minimum.

use crate::base::small::{Factor, Matrix, Vector, add, add_multiple, add_outer, undetermined};
use crate::location::descent::doubt::doubt;
use crate::location::descent::minimum::Minimum;
use crate::location::descent::{Cost, Loss, TUKEY};
use crate::location::search::lenth::{self, Weight};
use crate::location::search::{Search, position};
use crate::sensors::{KINDS, Measurement, Row};

/// Number of steps of the iteration for the σ whose expected weighted residuals are as large as the
/// observed ones.
const SPREAD_STEPS: usize = 20;
/// Smallest sum of the weights minus the number of unknowns with which σ is estimated.
const LEAST_REST: f64 = 1e-9;

impl<const D: usize, const N: usize> Search<'_, D, N> {
    /// Returns covariance, σ and dilution of precision from residuals and their derivatives.
    pub fn summary(
        &self,
        minimum: &Minimum<N>,
        lenth: Option<Weight>,
        rows: &[Row<N>],
    ) -> Summary<N> {
        let robust = self.loss != Loss::SQUARE;
        let reciprocal = 1.0 / minimum.scale;
        let mut spread = Spread::<N>::of(self.problem.measurements);
        let (mut sum, mut total) = (0.0, 0.0);
        for (m, row) in self.problem.measurements.iter().zip(rows) {
            let u = row.residual * reciprocal;
            let (weight, ..) = self.loss.of(m.kind).at(u);
            sum += weight * u * u;
            total += weight;
            spread.add(m, row, !self.is_fault(m, u, lenth));
        }
        let dop = spread.dop(D);
        let unit = match self.loss {
            Loss::Alike(Cost::Tukey(_)) => Expected::of_tukey(1.0).spread,
            _ => 1.0,
        };
        let kept = (sum / unit, total - N as f64);
        if lenth.is_some() {
            let covariance = minimum.normal.matrix;
            return Summary { covariance, sigma: minimum.scale, dop, kept };
        }
        let inverse = Factor::try_new(&minimum.normal.matrix, 0.0)
            .map_or_else(undetermined, |factor| factor.inverse());
        let of = |sigma: f64| match self.loss {
            Loss::Alike(Cost::Tukey(_)) => Expected::of_tukey(sigma),
            _ => Expected::of_square(),
        };
        let mut sigma = 1.0;
        if self.unknown {
            let rest = total - N as f64;
            if rest < LEAST_REST {
                let covariance = undetermined();
                return Summary { covariance, sigma: f64::NAN, dop, kept };
            }
            sigma = (sum / rest).sqrt();
            for _ in 0..SPREAD_STEPS {
                sigma = (sum / rest / of(sigma).spread).sqrt();
            }
        }
        let factor = of(sigma).variance * sigma * sigma;
        let mut covariance = inverse.map(|row| row.map(|v| v * factor));
        if robust {
            let rows = self.problem.measurements.iter().zip(rows).map(|(m, row)| {
                let (row, loss) = (row.scaled(reciprocal), self.loss.of(m.kind));
                let u = row.residual;
                (row, loss.at(u).0, loss.evidence(u))
            });
            add(&mut covariance, &doubt(rows, &inverse));
            add(&mut covariance, &minimum.others);
        }
        Summary { covariance, sigma: minimum.scale * sigma, dop, kept }
    }

    /// Returns the covariance due to errors that all measurements of a kind have in common, for these
    /// shares s of the variances: `Σ s r r'` with `r = (J' W J)^-1 J' W 1`. O(M).
    pub fn shared(
        &self,
        minimum: &Minimum<N>,
        rows: &[Row<N>],
        shares: &[f64; KINDS],
    ) -> Matrix<D> {
        let mut sum = [[0.0; D]; D];
        let Some(factor) = Factor::try_new(&minimum.normal.matrix, 0.0) else { return sum };
        // heights are the last kind, without a share
        let mut pulls = [[0.0; N]; KINDS + 1];
        for (m, row) in self.problem.measurements.iter().zip(rows) {
            let (weight, ..) = self.loss.of(m.kind).at(row.residual / minimum.scale);
            add_multiple(&mut pulls[m.kind as usize], weight, &row.gradient);
        }
        for (pull, share) in pulls.iter().zip(shares).filter(|(_, share)| **share > 0.0) {
            add_outer(&mut sum, *share, &position::<D, N>(&factor.solve(pull)));
        }
        sum
    }

    /// Returns the covariance due to additional errors of each measurement, for these shares s of the variances
    /// of its kind: `Σ s r r'` with `r = (J' W J)^-1 w j`. O(M).
    pub fn separate(
        &self,
        minimum: &Minimum<N>,
        rows: &[Row<N>],
        shares: &[f64; KINDS],
    ) -> Matrix<D> {
        let mut sum = [[0.0; D]; D];
        let Some(factor) = Factor::try_new(&minimum.normal.matrix, 0.0) else { return sum };
        for (m, row) in self.problem.measurements.iter().zip(rows) {
            // heights are the last kind, without a share
            let share = shares.get(m.kind as usize).copied().unwrap_or(0.0);
            if share > 0.0 {
                let (weight, ..) = self.loss.of(m.kind).at(row.residual / minimum.scale);
                let response = factor.solve(&row.gradient.map(|g| weight * g));
                add_outer(&mut sum, share, &position::<D, N>(&response));
            }
        }
        sum
    }

    /// Returns the change of the state if the signals are faster by a relative difference `share`:
    /// `(J' W J)^-1 J' W r` times the share, with the distances r that the signals travel. O(M).
    pub fn stretched(&self, minimum: &Minimum<N>, rows: &[Row<N>], share: f64) -> Vector<N> {
        let mut pull = [0.0; N];
        if share == 0.0 {
            return pull;
        }
        let Some(factor) = Factor::try_new(&minimum.normal.matrix, 0.0) else { return pull };
        let p = position::<D, N>(&minimum.state);
        for (m, row) in self.problem.measurements.iter().zip(rows).filter(|(m, _)| m.kind.travels())
        {
            let (weight, ..) = self.loss.of(m.kind).at(row.residual / minimum.scale);
            let error = weight * share * m.path(&p) * m.precision;
            add_multiple(&mut pull, error, &row.gradient);
        }
        factor.solve(&pull)
    }

    /// Whether a whitened residual is that of a fault.
    pub fn is_fault(&self, m: &Measurement<D>, u: f64, lenth: Option<Weight>) -> bool {
        match lenth {
            Some(Weight::Andrews) => u.abs() >= lenth::ZERO,
            Some(_) => false,
            None => self.loss.of(m.kind).is_fault(u),
        }
    }
}

/// Moments of normal errors under Tukey's weights, for errors of some σ in units of the scale.
pub(in crate::location) struct Expected {
    /// `E w E ψ² / (E ψ')² / σ²`: the variance of an estimate divided by `σ² / Σ w`.
    variance: f64,
    /// `E w r² / E w / σ²`
    pub spread: f64,
}

impl Expected {
    fn of_square() -> Self {
        Self { variance: 1.0, spread: 1.0 }
    }

    /// Returns the moments of the normal distribution; less than 1e-5 of it lies beyond c up to σ = 1,
    /// and is neglected.
    pub fn of_tukey(sigma: f64) -> Self {
        let q = (sigma.min(1.0) / TUKEY).powi(2);
        let weight = 1.0 - 2.0 * q + 3.0 * q * q;
        // E w r² and E ψ' are equal
        let slope = 1.0 - 6.0 * q + 15.0 * q * q;
        let square = 1.0 - 12.0 * q + 90.0 * q * q - 420.0 * q.powi(3) + 945.0 * q.powi(4);
        Self { variance: weight * square / (slope * slope), spread: slope / weight }
    }
}

/// Results computed at a minimum.
pub(in crate::location) struct Summary<const D: usize> {
    pub covariance: Matrix<D>,
    pub sigma: f64,
    pub dop: f64,
    /// Sum of the weighted squares of the residuals, and its degrees of freedom.
    pub kept: (f64, f64),
}

/// Information matrix for errors of size 1, if all measurements have the same unit.
pub(in crate::location) struct Spread<const D: usize> {
    matrix: Matrix<D>,
    mixed: bool,
}

impl<const D: usize> Spread<D> {
    pub fn of<const P: usize>(measurements: &[Measurement<P>]) -> Self {
        let angles = measurements.iter().filter(|m| m.kind.is_angle()).count();
        let mixed = angles != 0 && angles != measurements.len();
        Self { matrix: [[0.0; D]; D], mixed }
    }

    pub fn add<const P: usize>(&mut self, m: &Measurement<P>, row: &Row<D>, counts: bool) {
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

    /// Returns the square root of the trace of the covariance of the first `coordinates` components;
    /// nan if units are mixed.
    pub fn dop(&self, coordinates: usize) -> f64 {
        if self.mixed {
            return f64::NAN;
        }
        let Some(factor) = Factor::try_new(&self.matrix, 0.0) else { return f64::INFINITY };
        let inverse = factor.inverse();
        (0..coordinates).map(|i| inverse[i][i]).sum::<f64>().sqrt()
    }
}
