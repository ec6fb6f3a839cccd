//! One step of the filter: (14) to (20) of the source, with the misprints corrected.

use super::model::Transition;
use crate::base::angle::principal;

/// Angle, rate and acceleration, with the elements (0, 0), (0, 1), (0, 2), (1, 1), (1, 2) and
/// (2, 2) of their covariance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State {
    /// Mean x.
    pub mean: [f64; 3],
    /// Covariance P.
    pub covariance: [f64; 6],
}

/// Innovation of an update with its variance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Innovation {
    /// `ν = z − x⁻`.
    pub value: f64,
    /// `S = P⁻ + R`.
    pub variance: f64,
}

impl Innovation {
    /// Result if there was no plot, or no prediction to compare it with.
    pub const NONE: Self = Self { value: f64::NAN, variance: f64::NAN };
}

/// Ratio of prior variance to noise above which the covariance is kept as factors.
pub(super) const FACTORS_ABOVE: f64 = 1e4;

/// Returns the angle in [0, period).
#[inline(always)]
pub fn wrapped(angle: f64, period: f64) -> f64 {
    if angle.is_nan() || (0.0..period).contains(&angle) { angle } else { principal(angle, period) }
}

/// Returns `z − x`, shifted by whole periods to within half a period.
#[inline(always)]
pub(crate) fn residual(z: f64, x: f64, period: Option<f64>) -> f64 {
    let difference = z - x;
    match period {
        Some(period) if difference.abs() > 0.5 * period => {
            difference - period * (difference / period).round()
        }
        _ => difference,
    }
}

impl State {
    /// The state if nothing is known.
    pub const UNKNOWN: Self = Self {
        mean: [f64::NAN; 3],
        covariance: [f64::INFINITY, 0.0, 0.0, f64::INFINITY, 0.0, f64::INFINITY],
    };

    /// Returns the predicted state: `x⁻ = F x`, `P⁻ = F P F^T + Q`.
    #[inline(always)]
    pub fn predicted(&self, transition: &Transition) -> Self {
        Self {
            mean: transition.mean(self.mean),
            covariance: transition.covariance(&self.covariance),
        }
    }

    /// Returns `F P F^T + Q`, where P is the covariance after an update of this prior with a plot of
    /// variance r.
    ///
    /// P is linear in 1/S, so nearly everything can be computed while the division is in progress.
    #[inline(always)]
    pub(super) fn covariance_after(&self, r: f64, transition: &Transition) -> [f64; 6] {
        let ([f01, f02, f12, f22], q) = (transition.f, &transition.q);
        let [p00, p01, p02, p11, p12, p22] = self.covariance;
        let s = 1.0 / (p00 + r);
        // F A F^T + Q, where A is P⁻ without its first row and column
        let (a01, a02) = (f01 * p11 + f02 * p12, f01 * p12 + f02 * p22);
        let (a11, a12) = (p11 + f12 * p12, p12 + f12 * p22);
        // F (P − A) F^T S, with g = F [0, P⁻_01, P⁻_02]
        let [g0, g1, g2] = [f01 * p01 + f02 * p02, p01 + f12 * p02, f22 * p02];
        let rest = r - g0;
        [
            f01 * a01 + f02 * a02 + q[0] + (r * (p00 + g0) + g0 * rest) * s,
            a01 + f12 * a02 + q[1] + g1 * rest * s,
            f22 * a02 + q[2] + g2 * rest * s,
            a11 + f12 * a12 + q[3] - g1 * g1 * s,
            f22 * a12 + q[4] - g1 * g2 * s,
            f22 * f22 * p22 + q[5] - g2 * g2 * s,
        ]
    }

    /// Whether an update with a plot of variance r would leave the covariance with few correct digits.
    #[inline(always)]
    pub(crate) fn needs_factors(&self, r: f64) -> bool {
        self.covariance[0] > FACTORS_ABOVE * r
    }

    /// Returns `x + K ν` and `(I − K h^T) P⁻` for a plot z of variance r.
    ///
    /// The first row is computed as `P⁻_0j R / S`: with 1 − K_0 in place of R/S, the result for a
    /// precise plot would lose digits.
    #[inline(always)]
    pub fn updated(&self, z: f64, r: f64, period: Option<f64>) -> (Self, Innovation) {
        let [p00, p01, p02, p11, p12, p22] = self.covariance;
        let variance = p00 + r;
        let s = 1.0 / variance;
        let (k0, k1, k2) = (p00 * s, p01 * s, p02 * s);
        let kept = r * s;
        let value = residual(z, self.mean[0], period);
        let state = Self {
            mean: [self.mean[0] + k0 * value, self.mean[1] + k1 * value, self.mean[2] + k2 * value],
            covariance: [
                p00 * kept,
                p01 * kept,
                p02 * kept,
                p11 - p01 * k1,
                p12 - p01 * k2,
                p22 - p02 * k2,
            ],
        };
        (state, Innovation { value, variance })
    }
}
