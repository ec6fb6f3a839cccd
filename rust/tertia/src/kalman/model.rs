//! The motion model with exponentially correlated acceleration (Singer 1970), and its discretisations.

use crate::base::error::{Result, require};
use serde::{Deserialize, Serialize};
use std::ops::{Add, Mul};

/// αT below which the series are used; from there on, the closed forms.
const SERIES_BELOW: f64 = 1.0;
/// Shortest interval: squares of the reciprocals of shorter ones overflow.
const SHORTEST: f64 = 1e-60;
/// Largest parameter: larger ones overflow in Q.
const LARGEST: f64 = 1e30;
const REQUIREMENT: &str = "a number from 0 to 1e30";
/// Largest number of terms that a series needs.
const TERMS: usize = 28;
/// A term smaller than this, relative to the sum, does not change the sum in double precision.
const NEGLIGIBLE: f64 = 1e-17;

/// `x' = F x + w` over one interval. F is upper triangular; its diagonal elements are 1, except for the
/// last one. w has the covariance Q.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transition {
    /// Elements (0, 1), (0, 2), (1, 2) and (2, 2) of F.
    pub f: [f64; 4],
    /// Elements (0, 0), (0, 1), (0, 2), (1, 1), (1, 2) and (2, 2) of Q.
    pub q: [f64; 6],
}

impl Transition {
    /// Transition over no time.
    pub const NONE: Self = Self { f: [0.0, 0.0, 0.0, 1.0], q: [0.0; 6] };

    /// Returns this transition followed by `next`.
    pub fn then(&self, next: &Self) -> Self {
        let ([a01, a02, a12, a22], [b01, b02, b12, b22]) = (self.f, next.f);
        Self {
            f: [a01 + b01, a02 + b01 * a12 + b02 * a22, a12 + b12 * a22, b22 * a22],
            q: next.covariance(&self.q),
        }
    }

    /// Returns `F x`.
    #[inline(always)]
    pub(crate) fn mean(&self, x: [f64; 3]) -> [f64; 3] {
        predicted_mean(&self.f, &x)
    }

    /// Returns `F P F^T + Q`, as upper triangles.
    #[inline(always)]
    pub(crate) fn covariance(&self, p: &[f64; 6]) -> [f64; 6] {
        predicted_covariance(&self.f, &self.q, p)
    }
}

/// A number, or a vector of numbers.
pub(super) trait Number: Copy + Add<Output = Self> + Mul<Output = Self> {}

impl<T: Copy + Add<Output = T> + Mul<Output = T>> Number for T {}

/// Returns `F x`.
#[inline(always)]
pub(super) fn predicted_mean<T: Number>(f: &[T; 4], x: &[T; 3]) -> [T; 3] {
    let ([f01, f02, f12, f22], [x0, x1, x2]) = (*f, *x);
    [x0 + f01 * x1 + f02 * x2, x1 + f12 * x2, f22 * x2]
}

/// Returns `F P F^T + Q`, as upper triangles.
#[inline(always)]
pub(super) fn predicted_covariance<T: Number>(f: &[T; 4], q: &[T; 6], p: &[T; 6]) -> [T; 6] {
    let ([f01, f02, f12, f22], [p00, p01, p02, p11, p12, p22]) = (*f, *p);
    // A = F P
    let a00 = p00 + f01 * p01 + f02 * p02;
    let a01 = p01 + f01 * p11 + f02 * p12;
    let a02 = p02 + f01 * p12 + f02 * p22;
    let a11 = p11 + f12 * p12;
    let a12 = p12 + f12 * p22;
    [
        a00 + f01 * a01 + f02 * a02 + q[0],
        a01 + f12 * a02 + q[1],
        f22 * a02 + q[2],
        a11 + f12 * a12 + q[3],
        f22 * a12 + q[4],
        f22 * f22 * p22 + q[5],
    ]
}

/// Acceleration with the correlation `exp(−α |t|)` and the standard deviation σ_a.
///
/// With α = 0 the acceleration is constant; with σ_a = 0 the rate is constant.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Singer {
    alpha: f64,
    variance: f64,
    exact: bool,
}

impl Singer {
    /// Creates the model with manoeuvre frequency `alpha`, discretised exactly or as printed in the
    /// source: with 1 − αT for `exp(−αT)`, T and T²/2 for its integrals, and noise in the acceleration
    /// only.
    ///
    /// # Errors
    /// If a parameter is outside its domain.
    pub fn try_new(alpha: f64, acceleration_sigma: f64, exact: bool) -> Result<Self> {
        require("alpha", alpha, (0.0..=LARGEST).contains(&alpha), REQUIREMENT)?;
        let holds = (0.0..=LARGEST).contains(&acceleration_sigma);
        require("acceleration_sigma", acceleration_sigma, holds, REQUIREMENT)?;
        Ok(Self { alpha, variance: acceleration_sigma * acceleration_sigma, exact })
    }

    /// Returns the standard deviation of the acceleration.
    pub fn acceleration_sigma(&self) -> f64 {
        self.variance.sqrt()
    }

    /// Returns the variance of the acceleration before any measurement.
    pub fn acceleration_variance(&self) -> f64 {
        self.variance
    }

    /// Returns the transition over the time `dt`.
    ///
    /// # Errors
    /// If the time is negative, or αT ≥ 1 in the printed form.
    pub fn over(&self, dt: f64) -> Result<Transition> {
        let holds = dt == 0.0 || (SHORTEST..=LARGEST).contains(&dt);
        require("dt", dt, holds, "0, or a number from 1e-60 to 1e30")?;
        let x = self.alpha * dt;
        if self.exact {
            return Ok(self.exactly(dt, x));
        }
        let requirement = "less than 1/alpha: choose the exact model for longer intervals";
        require("dt", dt, x < 1.0, requirement)?;
        let noise = self.variance * x * (2.0 - x);
        Ok(Transition { f: [dt, 0.5 * dt * dt, dt, 1.0 - x], q: [0.0, 0.0, 0.0, 0.0, 0.0, noise] })
    }

    /// Returns Singer's F and Q in units of T: `F_02 = T² φ(x)`, `Q_00 = σ² T⁴ b(x)` and so on, where
    /// the functions of x = αT are finite at 0.
    fn exactly(&self, t: f64, x: f64) -> Transition {
        let sign = |k: i32| if k % 2 == 0 { 1.0 } else { -1.0 };
        let two = |k: i32| 2.0_f64.powi(k);
        let (decay, gone) = ((-x).exp(), -(-x).exp_m1());
        let twice_gone = -(-2.0 * x).exp_m1();
        let [f02, f12, b00, b02, b11] = if x < SERIES_BELOW {
            // Σ c_k x^k / k!, divided by the power of x that is in T
            [
                series(x, 2, 2, sign),
                series(x, 1, 1, |k| -sign(k)),
                series(x, 5, 4, |k| sign(k) * (4.0 * f64::from(k) - two(k))),
                series(x, 3, 2, |k| sign(k) * (2.0 * f64::from(k) - two(k))),
                series(x, 3, 2, |k| sign(k) * (4.0 - two(k))),
            ]
        } else {
            [
                (x - gone) / (x * x),
                gone / x,
                (twice_gone + 2.0 * x * (1.0 - x + x * x / 3.0 - 2.0 * decay)) / x.powi(4),
                (twice_gone - 2.0 * x * decay) / (x * x),
                (2.0 * x - 4.0 * gone + twice_gone) / (x * x),
            ]
        };
        let (s, t2) = (self.variance, t * t);
        let q = [
            s * t2 * t2 * b00,
            s * t2 * t * x * f02 * f02,
            s * t2 * b02,
            s * t2 * b11,
            s * t * x * f12 * f12,
            s * twice_gone,
        ];
        Transition { f: [t, t2 * f02, t * f12, decay], q }
    }
}

/// Returns `Σ_{k ≥ from} c(k) x^(k − less) / k!`, where |c(k)| is at most 2^k from k = 5 on.
#[inline(always)]
fn series(x: f64, from: i32, less: i32, c: impl Fn(i32) -> f64) -> f64 {
    let mut term = x.powi(from - less) / (1..=from).map(f64::from).product::<f64>();
    let mut sum = 0.0;
    for k in (from..).take(TERMS) {
        sum += c(k) * term;
        term *= x / f64::from(k + 1);
        // from there on, the terms decrease even with the factor 2^k
        if k >= 5 && term * 2.0_f64.powi(k + 1) < NEGLIGIBLE * sum.abs() {
            break;
        }
    }
    sum
}
