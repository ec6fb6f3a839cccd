//! The step of the filter with factors `P = U D U^T` (Bierman 1977), for a prior that is very much
//! wider than the noise of a plot: differences of its covariance would have no correct digits left.

use super::model::Transition;
use super::state::{Innovation, State, residual};
use crate::base::error::{Error, Result};

/// Share of a variance that the other components must leave unexplained; with less, the factors are
/// kept.
const SMALLEST_SHARE: f64 = 1e-4;

/// Relative rounding error that a given covariance may have.
const ROUNDING: f64 = 1e-10;
/// Largest number: larger ones overflow when squared.
const LARGEST: f64 = 1e100;

/// The mean x and the factors of P.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Factored {
    mean: [f64; 3],
    /// Elements (0, 1), (0, 2) and (1, 2) of U.
    u: [f64; 3],
    d: [f64; 3],
}

impl Factored {
    pub fn new(state: &State) -> Self {
        let [p00, p01, p02, p11, p12, p22] = state.covariance;
        let ratio = |a: f64, b: f64| if b > 0.0 { a / b } else { 0.0 };
        let (u02, u12) = (ratio(p02, p22), ratio(p12, p22));
        let d1 = (p11 - u12 * p12).max(0.0);
        let u01 = ratio(p01 - u02 * p12, d1);
        let d0 = (p00 - u02 * p02 - u01 * u01 * d1).max(0.0);
        Self { mean: state.mean, u: [u01, u02, u12], d: [d0, d1, p22] }
    }

    /// Returns the factors of Q, with mean 0.
    pub fn of_noise(transition: &Transition) -> Self {
        Self::new(&State { mean: [0.0; 3], covariance: transition.q })
    }

    pub fn saved(&self) -> [f64; 9] {
        let ([x0, x1, x2], [u01, u02, u12], [d0, d1, d2]) = (self.mean, self.u, self.d);
        [x0, x1, x2, u01, u02, u12, d0, d1, d2]
    }

    pub fn restored(saved: &[f64; 9]) -> Self {
        let [x0, x1, x2, u01, u02, u12, d0, d1, d2] = *saved;
        Self { mean: [x0, x1, x2], u: [u01, u02, u12], d: [d0, d1, d2] }
    }

    pub fn mean(&self) -> [f64; 3] {
        self.mean
    }

    pub fn state(&self) -> State {
        let ([u01, u02, u12], [d0, d1, d2]) = (self.u, self.d);
        State {
            mean: self.mean,
            covariance: [
                d0 + u01 * u01 * d1 + u02 * u02 * d2,
                u01 * d1 + u02 * u12 * d2,
                u02 * d2,
                d1 + u12 * u12 * d2,
                u12 * d2,
                d2,
            ],
        }
    }

    /// Multiplies the covariance by a factor.
    pub fn inflate(&mut self, factor: f64) {
        self.d = self.d.map(|d| d * factor);
    }

    /// Returns U and D.
    pub fn factors(&self) -> ([[f64; 3]; 3], [f64; 3]) {
        let [u01, u02, u12] = self.u;
        ([[1.0, u01, u02], [0.0, 1.0, u12], [0.0, 0.0, 1.0]], self.d)
    }

    /// Whether the covariance need not be kept as factors: the other components leave a sufficient
    /// share of the variance of each component unexplained.
    pub fn is_moderate(&self) -> bool {
        let [p00, _, _, p11, ..] = self.state().covariance;
        self.d[0] > SMALLEST_SHARE * p00 && self.d[1] > SMALLEST_SHARE * p11
    }

    /// Returns the x with `P x = b`; components along which P has no variance are 0.
    pub fn solved(&self, b: &[f64; 3]) -> [f64; 3] {
        let [u01, u02, u12] = self.u;
        let y = [b[0] - u01 * (b[1] - u12 * b[2]) - u02 * b[2], b[1] - u12 * b[2], b[2]];
        let ratio = |i: usize| if self.d[i] > 0.0 { y[i] / self.d[i] } else { 0.0 };
        let (x0, w1, w2) = (ratio(0), ratio(1), ratio(2));
        let x1 = w1 - u01 * x0;
        [x0, x1, w2 - u02 * x0 - u12 * x1]
    }

    /// Returns the factors of the covariance `A W A^T`, with W diagonal, by modified weighted
    /// Gram–Schmidt (Thornton): the rows of A are made orthogonal from the last one upward.
    pub fn orthogonalised<const N: usize>(
        mean: [f64; 3],
        mut rows: [[f64; N]; 3],
        weight: &[f64; N],
    ) -> Self {
        let product =
            |a: &[f64; N], b: &[f64; N]| -> f64 { (0..N).map(|i| weight[i] * a[i] * b[i]).sum() };
        let (mut u, mut d) = ([[0.0; 3]; 3], [0.0; 3]);
        for j in (0..3).rev() {
            let row = rows[j];
            d[j] = product(&row, &row);
            for i in 0..j {
                u[i][j] = if d[j] > 0.0 { product(&rows[i], &row) / d[j] } else { 0.0 };
                for (a, b) in rows[i].iter_mut().zip(&row) {
                    *a -= u[i][j] * b;
                }
            }
        }
        Self { mean, u: [u[0][1], u[0][2], u[1][2]], d }
    }

    /// Predicts the state: the rows are `[F U | V]` with the weights of both, where `Q = V E V^T`.
    pub fn predict(&mut self, transition: &Transition) {
        let [f01, f02, f12, f22] = transition.f;
        let [u01, u02, u12] = self.u;
        let noise = Self::of_noise(transition);
        let ([v01, v02, v12], [e0, e1, e2]) = (noise.u, noise.d);
        let weight = [self.d[0], self.d[1], self.d[2], e0, e1, e2];
        let rows = [
            [1.0, u01 + f01, u02 + f01 * u12 + f02, 1.0, v01, v02],
            [0.0, 1.0, u12 + f12, 0.0, 1.0, v12],
            [0.0, 0.0, f22, 0.0, 0.0, 1.0],
        ];
        *self = Self::orthogonalised(transition.mean(self.mean), rows, &weight);
    }

    /// Updates the state by Bierman's algorithm: no variance is subtracted from another.
    pub fn update(&mut self, z: f64, r: f64, period: Option<f64>) -> Innovation {
        let [u01, u02, u12] = self.u;
        let f = [1.0, u01, u02];
        let v = [self.d[0], self.d[1] * u01, self.d[2] * u02];
        let a0 = r + f[0] * v[0];
        let a1 = a0 + f[1] * v[1];
        let a2 = a1 + f[2] * v[2];
        self.d = [self.d[0] * (r / a0), self.d[1] * (a0 / a1), self.d[2] * (a1 / a2)];
        // `u01 − u01 d0 / a0` and `u02 − u02 (a1 − r) / a1`, without cancellation
        self.u = [u01 * (r / a0), u02 * (r / a1), u12 - f[2] / a1 * v[1]];
        let value = residual(z, self.mean[0], period);
        let step = value / a2;
        self.mean[0] += step * (v[0] + v[1] * u01 + v[2] * u02);
        self.mean[1] += step * (v[1] + v[2] * u12);
        self.mean[2] += step * v[2];
        Innovation { value, variance: a2 }
    }
}

impl State {
    /// Creates a state with this covariance, which may be singular.
    ///
    /// # Errors
    /// If a number is not finite, or the matrix is not a covariance.
    pub fn try_new(mean: [f64; 3], covariance: &[[f64; 3]; 3]) -> Result<Self> {
        let refuse = |argument, index: &[usize], value: f64, requirement| {
            Err(Error::InvalidElement { argument, index: index.to_vec(), value, requirement })
        };
        let finite = "it must be a number of at most 1e100 in size";
        for (i, (&x, row)) in mean.iter().zip(covariance).enumerate() {
            if x.is_nan() || x.abs() > LARGEST {
                return refuse("mean", &[i], x, finite);
            }
            for (j, &p) in row.iter().enumerate() {
                if p.is_nan() || p.abs() > LARGEST {
                    return refuse("covariance", &[i, j], p, finite);
                }
            }
            if row[i] < 0.0 {
                return refuse("covariance", &[i, i], row[i], "a variance must not be negative");
            }
        }
        let p = covariance;
        for (i, j) in [(0, 1), (0, 2), (1, 2)] {
            let scale = p[i][i].sqrt() * p[j][j].sqrt();
            let (upper, lower, index) = (p[i][j], p[j][i], vec![i, j]);
            if (upper - lower).abs() > ROUNDING * scale {
                return Err(Error::NotSymmetric { argument: "covariance", index, upper, lower });
            }
            if upper.abs() > (1.0 + ROUNDING) * scale {
                return Err(Error::Indefinite { argument: "covariance", index: Vec::new() });
            }
        }
        let packed = [p[0][0], p[0][1], p[0][2], p[1][1], p[1][2], p[2][2]];
        let state = Self { mean, covariance: packed };
        let back = Factored::new(&state).state();
        let kept =
            |k: usize, scale: f64| (back.covariance[k] - packed[k]).abs() <= ROUNDING * scale;
        if kept(0, p[0][0]) && kept(3, p[1][1]) && kept(1, (p[0][0] * p[1][1]).sqrt()) {
            Ok(state)
        } else {
            Err(Error::Indefinite { argument: "covariance", index: Vec::new() })
        }
    }
}
