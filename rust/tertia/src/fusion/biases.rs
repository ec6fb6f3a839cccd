//! Constant errors of the radars of a series, estimated from the contradictions between their plots.
//!
//! `z_k(t) = θ(t) + b_k + noise`. One filter processes all plots; the initial state of the motion and
//! the errors are unknown coefficients (de Jong 1991, *Annals of Statistics* 19). The derivatives of
//! its innovations by these coefficients are the rows of a regression, which is exact for the motion
//! model.

use crate::kalman::{PerStep, Singer, Transition};
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

/// Errors of K radars.
#[derive(Clone, Debug, PartialEq)]
pub struct SeriesBiases {
    /// Estimated errors (K); zero if a radar is trusted or nothing is known about its error.
    pub value: Vec<f64>,
    /// Standard deviations of the errors (K).
    pub sigma: Vec<f64>,
    /// Covariance that the errors add to angle, rate and acceleration at each step.
    pub covariance: Vec<[f64; 6]>,
}

/// The regression. The first column is that of the plots; the others are those of the initial state and of
/// the radars.
struct Regression {
    /// Derivatives of the state by the coefficients; the first column is the state if all of them are zero.
    columns: Vec<Vector3<f64>>,
    covariance: [f64; 6],
    information: DMatrix<f64>,
    vector: DVector<f64>,
    row: Vec<f64>,
}

/// Number of coefficients of the initial state: angle, rate and acceleration.
const START: usize = 3;

impl Regression {
    fn new(radars: usize, acceleration_variance: f64) -> Self {
        let n = START + radars;
        let mut columns = vec![Vector3::zeros(); n + 1];
        for (i, column) in columns[1..=START].iter_mut().enumerate() {
            column[i] = 1.0;
        }
        let mut information = DMatrix::zeros(n, n);
        if acceleration_variance > 0.0 {
            information[(2, 2)] = acceleration_variance.recip();
        } else {
            columns[START] = Vector3::zeros();
            information[(2, 2)] = 1.0;
        }
        Self {
            columns,
            covariance: [0.0; 6],
            information,
            vector: DVector::zeros(n),
            row: vec![0.0; n],
        }
    }

    fn predict(&mut self, transition: &Transition) {
        for column in &mut self.columns {
            *column = transition.mean((*column).into()).into();
        }
        self.covariance = transition.covariance(&self.covariance);
    }

    fn update(&mut self, radar: usize, plot: f64, noise: f64) {
        let [p00, p01, p02, p11, p12, p22] = self.covariance;
        let variance = p00 + noise;
        let gain = Vector3::new(p00, p01, p02) / variance;
        for (i, derivative) in self.row.iter_mut().enumerate() {
            *derivative = self.columns[i + 1][0] + f64::from(i == START + radar);
        }
        let innovation = plot - self.columns[0][0];
        for (i, (&own, at)) in self.row.iter().zip(0..).enumerate() {
            self.vector[i] += own * innovation / variance;
            for (j, other) in self.row.iter().enumerate() {
                self.information[(at, j)] += own * other / variance;
            }
        }
        self.columns[0] += gain * innovation;
        for (column, derivative) in self.columns[1..].iter_mut().zip(&self.row) {
            *column -= gain * *derivative;
        }
        let [g0, g1, g2] = gain.into();
        self.covariance = [
            p00 - g0 * p00,
            p01 - g0 * p01,
            p02 - g0 * p02,
            p11 - g1 * p01,
            p12 - g1 * p02,
            p22 - g2 * p02,
        ];
    }

    /// Covariance of the initial state from the information so far; `None` before two plots.
    fn start(&self) -> Option<Matrix3<f64>> {
        let start: Matrix3<f64> = self.information.fixed_view::<START, START>(0, 0).into();
        let scale = start.diagonal().map(|d| if d > 0.0 { d.sqrt().recip() } else { 0.0 });
        let scaled = start.component_mul(&(scale * scale.transpose()));
        let inverse = scaled.cholesky()?.inverse();
        Some(inverse.component_mul(&(scale * scale.transpose())))
    }

    /// Derivatives of the state by the errors of the radars, if the plots also determine the initial state.
    fn sensitivity(&self, out: &mut Vec<Vector3<f64>>) {
        out.clear();
        let own = &self.columns[1 + START..];
        let Some(inverse) = self.start() else {
            // one plot determines the angle alone
            let total = self.information[(0, 0)];
            out.extend((0..own.len()).map(|k| {
                let share = self.information[(0, START + k)] / total;
                Vector3::new(if total > 0.0 { share } else { 0.0 }, 0.0, 0.0)
            }));
            return;
        };
        let starts = Matrix3::from_columns(&self.columns[1..=START]) * inverse;
        out.extend(own.iter().enumerate().map(|(k, column)| {
            let mixed: Vector3<f64> = self.information.fixed_view::<START, 1>(0, START + k).into();
            column - starts * mixed
        }));
    }

    /// Information on the errors of the radars and its vector, with the initial state eliminated.
    fn of_radars(&self) -> Option<(DMatrix<f64>, DVector<f64>)> {
        let inverse = self.start()?;
        let k = self.vector.len() - START;
        let mixed = self.information.view((0, START), (START, k));
        let reduced = mixed.transpose() * inverse;
        let information = self.information.view((START, START), (k, k)) - &reduced * mixed;
        let vector = self.vector.rows(START, k) - reduced * self.vector.rows(0, START);
        Some((information, vector))
    }
}

/// Estimates the errors of the radars, with their variances, from their plots (K, steps), which are
/// unwrapped and in rows of one radar each. `prior` contains the standard deviations of the errors (K):
/// zero for a trusted radar, infinity if nothing is known about the error. At least one must be finite.
///
/// Cost O(K² steps) for the regression, O(K²) per step for the covariance.
pub fn series_biases(
    plots: &[f64],
    variance: &[f64],
    prior: &[f64],
    transition: PerStep<'_, Transition>,
    model: &Singer,
) -> SeriesBiases {
    let (radars, steps) = (prior.len(), plots.len() / prior.len());
    let mut regression = Regression::new(radars, model.acceleration_variance());
    let mut sensitivities = Vec::with_capacity(steps * radars);
    let mut sensitivity = Vec::with_capacity(radars);
    for step in 0..steps {
        if step > 0 {
            regression.predict(&transition.at(step - 1));
        }
        for radar in 0..radars {
            let at = radar * steps + step;
            if !plots[at].is_nan() && variance[at].is_finite() {
                regression.update(radar, plots[at], variance[at]);
            }
        }
        regression.sensitivity(&mut sensitivity);
        sensitivities.extend_from_slice(&sensitivity);
    }
    let (value, covariance) = posterior(regression.of_radars(), prior);
    let added = sensitivities.chunks_exact(radars).map(|each| spread(each, &covariance)).collect();
    let sigma = (0..radars)
        .map(|k| if value[k].is_nan() { f64::INFINITY } else { covariance[(k, k)].sqrt() })
        .collect();
    let value = value.into_iter().map(|v| if v.is_nan() { 0.0 } else { v }).collect();
    SeriesBiases { value, sigma, covariance: added }
}

/// Errors and their covariance; errors about which nothing is known are nan and have zeros in the covariance.
fn posterior(
    found: Option<(DMatrix<f64>, DVector<f64>)>,
    prior: &[f64],
) -> (Vec<f64>, DMatrix<f64>) {
    let k = prior.len();
    let (information, vector) = found.unwrap_or_else(|| (DMatrix::zeros(k, k), DVector::zeros(k)));
    let mut value: Vec<f64> =
        prior.iter().map(|s| if s.is_finite() { 0.0 } else { f64::NAN }).collect();
    let mut covariance = DMatrix::zeros(k, k);
    // in units of the prior sigma or, for a flat prior, of the sigma from the measurements alone
    let unit: Vec<f64> = (0..k)
        .map(|i| match prior[i] {
            s if s.is_finite() => s,
            _ if information[(i, i)] > 0.0 => information[(i, i)].sqrt().recip(),
            _ => 0.0,
        })
        .collect();
    let free: Vec<usize> = (0..k).filter(|&i| unit[i] > 0.0).collect();
    let n = free.len();
    let normal = DMatrix::from_fn(n, n, |a, b| {
        let (i, j) = (free[a], free[b]);
        let own = f64::from(a == b && prior[i].is_finite());
        unit[i] * information[(i, j)] * unit[j] + own
    });
    let Some(root) = normal.cholesky() else {
        // errors with flat priors that no plot relates to the others: the priors remain unchanged
        (0..k)
            .filter(|&i| prior[i].is_finite())
            .for_each(|i| covariance[(i, i)] = prior[i].powi(2));
        return (value, covariance);
    };
    let inverse = root.inverse();
    let solved = root.solve(&DVector::from_fn(n, |a, _| unit[free[a]] * vector[free[a]]));
    for (a, &i) in free.iter().enumerate() {
        value[i] = unit[i] * solved[a];
        for (b, &j) in free.iter().enumerate() {
            covariance[(i, j)] = unit[i] * inverse[(a, b)] * unit[j];
        }
    }
    (value, covariance)
}

/// `S P Sᵀ`, upper triangle.
fn spread(sensitivity: &[Vector3<f64>], covariance: &DMatrix<f64>) -> [f64; 6] {
    let mut total = Matrix3::zeros();
    for (i, own) in sensitivity.iter().enumerate() {
        let mean = sensitivity
            .iter()
            .enumerate()
            .fold(Vector3::zeros(), |sum, (j, other)| sum + other * covariance[(i, j)]);
        total += own * mean.transpose();
    }
    [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]
        .map(|(i, j)| 0.5 * (total[(i, j)] + total[(j, i)]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_within;

    const MODEL: (f64, f64) = (0.05, 0.02);

    fn found(plots: &[f64], prior: &[f64]) -> SeriesBiases {
        let model = Singer::try_new(MODEL.0, MODEL.1, true).unwrap();
        let transition = PerStep::Constant(model.over(4.0).unwrap());
        series_biases(plots, &vec![0.01; plots.len()], prior, transition, &model)
    }

    #[test]
    fn two_radars_at_the_same_times_differ_by_the_mean_of_their_differences() {
        let first: Vec<f64> = (0..40).map(|t| 0.3 * f64::from(t) + f64::from(t % 3)).collect();
        let second = first.iter().zip(0..).map(|(z, t)| z + 2.0 + 0.1 * f64::from(t % 2));
        let plots: Vec<f64> = first.iter().copied().chain(second).collect();
        let one = found(&plots, &[0.0, f64::INFINITY]);
        assert_within(1e-12, one.value[1], 2.05);
        assert_within(1e-12, one.sigma[1], (2.0_f64 * 0.01 / 40.0).sqrt());
        assert_within(0.0, one.sigma[0], 0.0);
    }

    #[test]
    fn what_all_share_stays_as_uncertain_as_it_was() {
        let plots = vec![1.0; 120];
        let one = found(&plots, &[0.3; 3]);
        assert_within(1e-3, one.covariance[39][0].sqrt(), 0.3 / 3.0_f64.sqrt());
        assert!(one.covariance[39][3] < 1e-9);
    }

    #[test]
    fn a_radar_without_plots_is_not_known() {
        let mut plots = vec![1.0; 80];
        plots[40..].fill(f64::NAN);
        let one = found(&plots, &[0.2, f64::INFINITY]);
        assert_eq!((one.value[1], one.sigma[1]), (0.0, f64::INFINITY));
        assert_within(1e-12, one.sigma[0], 0.2);
        assert_within(1e-12, one.covariance[39][0], 0.04);
    }
    /// Three radars, the third without a plot at the second instant, and constant acceleration.
    #[test]
    fn the_normal_equations_of_a_block() {
        let model = Singer::try_new(1e-13, 0.01, true).unwrap();
        let step = model.over(5.0).unwrap();
        let none = f64::NAN;
        let plots = [10.02, 10.9, 12.05, 10.21, 11.3, 12.2, 9.75, none, 11.6];
        let variance = [0.01, 0.01, 0.01, 0.01, 0.01, 0.01, 0.04, 0.04, 0.04];
        let mut regression = Regression::new(3, model.acceleration_variance());
        for t in 0..3 {
            if t > 0 {
                regression.predict(&step);
            }
            for radar in 0..3 {
                let at = 3 * radar + t;
                if !plots[at].is_nan() {
                    regression.update(radar, plots[at], variance[at]);
                }
            }
        }
        let (information, score) = regression.of_radars().unwrap();
        let own = [161.2462006079, -138.7537993921, -22.49240121581];
        let rows = [own, [own[1], own[0], own[2]], [own[2], own[2], 44.98480243161]];
        for (i, row) in rows.iter().enumerate() {
            for (j, value) in row.iter().enumerate() {
                assert_within(1e-7, information[(i, j)], *value);
            }
        }
        for (i, value) in [-27.03951367781, 46.96048632219, -19.92097264438].iter().enumerate() {
            assert_within(1e-7, score[i], *value);
        }
        let found = series_biases(&plots, &variance, &[0.2; 3], PerStep::Constant(step), &model);
        let value = [-0.006138676442703, 0.2215536312496, -0.2154149548069];
        let sigma = [0.129128001734, 0.129128001734, 0.1433259124282];
        for k in 0..3 {
            assert_within(1e-10, found.value[k], value[k]);
            assert_within(1e-10, found.sigma[k], sigma[k]);
        }
        let (_, covariance) = posterior(Some((information, score)), &[0.2; 3]);
        assert_within(1e-10, covariance.mean().sqrt(), 0.1154700538379);
    }
}
