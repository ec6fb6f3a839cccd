//! Normal equations from which the emissions are eliminated one by one.

use super::linear::{Group, Row};
use super::problem::{Model, NU, Problem};
use crate::base::skyline::Skyline;

/// Bounds of the estimated information of an arrival, relative to that of Student's distribution of this
/// scale.
const INFORMATION: [f64; 2] = [0.3, 1.5];

/// Largest sizes of residuals, in standard deviations, that count for their correlation; one-sided 99 %
/// quantile of the standard normal distribution; largest correlation.
const CLIPPED: f64 = 3.0;
const SURELY: f64 = 2.326;
const MOST: f64 = 0.95;

/// Weights of the arrivals: for the right-hand side, and for the information.
pub(super) struct Weights {
    pub pull: Vec<f64>,
    pub information: Vec<f64>,
    /// Standard deviation of an arrival with the same information, in units of the given ones.
    pub sigma: f64,
}

/// An eliminated emission: its weight, the derivatives of its rows, and its right-hand side.
struct Eliminated {
    weight: f64,
    columns: Vec<(usize, f64)>,
    pull: f64,
}

pub(super) struct Normal {
    pub matrix: Skyline,
    pull: Vec<f64>,
    emissions: Vec<Eliminated>,
}

impl Weights {
    /// Returns the weights for errors with Student's distribution. The information is Huber's,
    /// mean(psi')^2 / mean(psi^2), so that it holds for errors of any distribution.
    pub fn new<const D: usize>(
        problem: &Problem<'_, D>,
        rows: &[Row],
        scale: f64,
        free: f64,
    ) -> Self {
        let n = rows.len() as f64;
        let (mut slope, mut square, mut mean) = (0.0, 0.0, 0.0);
        let mut pull = Vec::with_capacity(rows.len());
        for (row, arrival) in rows.iter().zip(&problem.scene.rows) {
            let sigma = problem.scene.sigma[arrival.sensor];
            let (error, s) = ((row.residual / sigma).powi(2), NU * scale * scale);
            let weight = (NU + 1.0) / (s + error);
            slope += weight * (s - error) / (s + error);
            square += weight * weight * error;
            mean += weight;
            pull.push(weight / (sigma * sigma));
        }
        let student = (NU + 1.0) / (NU + 3.0) / (scale * scale);
        let found = slope.max(0.0).powi(2) / (n * square.max(f64::MIN_POSITIVE)) * free;
        let found = found.clamp(INFORMATION[0] * student, INFORMATION[1] * student);
        let factor = found * n / mean;
        let information = pull.iter().map(|weight| factor * weight).collect();
        Self { pull, information, sigma: found.sqrt().recip() }
    }

    /// Reduces the information for errors that last from one emission of a moving identity to the next: with
    /// the correlation ρ, an arrival is worth `(1 − ρ) / (1 + ρ)` independent ones. Lasting errors of beacons
    /// are path errors, which are unknowns.
    pub fn thin<const D: usize>(&mut self, problem: &Problem<'_, D>, rows: &[Row]) {
        let scene = problem.scene;
        let (k, identities) = (scene.is_base.len(), scene.beacon.len());
        let mut last: Vec<Option<f64>> = vec![None; identities * k];
        let (mut products, mut squares) = (vec![0.0; identities], vec![0.0; identities]);
        let (mut pairs, mut count) = (vec![0.0; identities], vec![0.0; identities]);
        for (row, arrival) in rows.iter().zip(&scene.rows) {
            let (who, sigma) = (arrival.identity, self.sigma * scene.sigma[arrival.sensor]);
            let size = (row.residual / sigma).clamp(-CLIPPED, CLIPPED);
            if let Some(before) = last[who * k + arrival.sensor].replace(size) {
                products[who] += before * size;
                pairs[who] += 1.0;
            }
            squares[who] += size * size;
            count[who] += 1.0;
        }
        let worth = |who: usize| {
            let correlation = products[who] / pairs[who] / (squares[who] / count[who]);
            let is_sure = scene.beacon[who].is_none() && correlation * pairs[who].sqrt() > SURELY;
            let lasting = if is_sure { correlation.min(MOST) } else { 0.0 };
            (1.0 - lasting) / (1.0 + lasting)
        };
        let worth: Vec<f64> = (0..identities).map(worth).collect();
        for (information, arrival) in self.information.iter_mut().zip(&scene.rows) {
            *information *= worth[arrival.identity];
        }
    }
}

impl<const D: usize> Problem<'_, D> {
    /// Returns an empty matrix with the envelope of all rows.
    pub fn envelope(&self, rows: &[Row], priors: &[(Row, Group)]) -> Skyline {
        let mut first: Vec<usize> = (0..self.layout.order).collect();
        let mut couple = |columns: &mut dyn Iterator<Item = usize>| {
            let columns: Vec<usize> = columns.collect();
            let low = columns.iter().copied().min().unwrap_or(0);
            for column in columns {
                first[column] = first[column].min(low);
            }
        };
        let of = |row: &Row| row.columns().iter().map(|c| c.0).collect::<Vec<_>>();
        for ends in self.first.windows(2) {
            couple(&mut rows[ends[0]..ends[1]].iter().flat_map(of));
        }
        for (row, _) in priors {
            couple(&mut of(row).into_iter());
        }
        // the covariances of these are needed
        for first in self.layout.motion.iter().flatten() {
            couple(&mut (*first..first + 3 * D));
        }
        Skyline::zeros(first)
    }

    /// Returns the normal equations; `matrix` has the envelope.
    pub fn normal(
        &self,
        mut matrix: Skyline,
        rows: &[Row],
        weights: &Weights,
        priors: &[(Row, Group)],
        model: &Model,
    ) -> Normal {
        matrix.clear();
        let mut pull = vec![0.0; self.layout.order];
        for (row, group) in priors {
            let weight = 1.0 / model.variance(*group);
            row.add_to(&mut matrix, weight);
            row.add_pull(&mut pull, weight);
        }
        let mut emissions = Vec::with_capacity(self.identity.len());
        let mut sums = vec![0.0; self.layout.order];
        let mut touched: Vec<usize> = Vec::new();
        for ends in self.first.windows(2) {
            touched.clear();
            let (mut weight, mut own) = (0.0, 0.0);
            for at in ends[0]..ends[1] {
                let (row, information) = (&rows[at], weights.information[at]);
                row.add_to(&mut matrix, information);
                row.add_pull(&mut pull, weights.pull[at]);
                weight += information;
                own += weights.pull[at] * row.residual;
                for &(column, value) in row.columns() {
                    sums[column] += information * value;
                    touched.push(column);
                }
            }
            touched.sort_unstable();
            touched.dedup();
            for (a, &i) in touched.iter().enumerate() {
                let share = sums[i] / weight;
                pull[i] -= share * own;
                for &j in &touched[..=a] {
                    matrix.add(i, j, -share * sums[j]);
                }
            }
            let columns = touched.iter().map(|&i| (i, std::mem::take(&mut sums[i]))).collect();
            emissions.push(Eliminated { weight, columns, pull: own });
        }
        Normal { matrix, pull, emissions }
    }
}

impl Normal {
    /// Factorises the matrix. Returns the steps of the unknowns and of the emissions, and the sum of the
    /// squares of the former in standard deviations; or the column that is not determined.
    pub fn step(&mut self) -> Result<(Vec<f64>, Vec<f64>, f64), usize> {
        self.matrix.factorise()?;
        let mut step = self.pull.clone();
        self.matrix.solve(&mut step);
        let emission = self.emissions.iter().map(|own| {
            let taken: f64 = own.columns.iter().map(|&(column, b)| b * step[column]).sum();
            (own.pull - taken) / own.weight
        });
        let emission = emission.collect();
        let decrement = step.iter().zip(&self.pull).map(|(step, pull)| step * pull).sum();
        Ok((step, emission, decrement))
    }

    /// Half the logarithm of the determinant of the information about the unknowns and the emissions, once the
    /// matrix is factorised.
    pub fn half_ln_determinant(&self) -> f64 {
        let unknowns = (0..self.matrix.order()).map(|i| self.matrix.get(i, i).ln());
        let emissions = self.emissions.iter().map(|own| 0.5 * own.weight.ln());
        unknowns.sum::<f64>() + emissions.sum::<f64>()
    }

    /// Variances of the emission times, from elements of the inverse.
    pub fn emission_variances(&self, inverse: &Skyline) -> Vec<f64> {
        let variance = |own: &Eliminated| {
            1.0 / own.weight + inverse.quadratic(&own.columns) / (own.weight * own.weight)
        };
        self.emissions.iter().map(variance).collect()
    }
}
