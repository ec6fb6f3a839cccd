//! One step: (14) to (20) of the source, misprints mended.

use super::factored::Factored;
use super::model::Transition;
use crate::base::error::{Error, Result};

/// Angle, rate and acceleration, with the elements (0, 0), (0, 1), (0, 2), (1, 1), (1, 2) and
/// (2, 2) of their covariance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State {
    /// x.
    pub mean: [f64; 3],
    /// P.
    pub covariance: [f64; 6],
}

/// What an update did.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Innovation {
    /// ν = z − x⁻.
    pub value: f64,
    /// S = P⁻ + R.
    pub variance: f64,
}

impl Innovation {
    /// There was no plot, or nothing to compare it with.
    pub const NONE: Self = Self { value: f64::NAN, variance: f64::NAN };
}

/// Above this ratio of prior variance to noise the covariance is kept as factors.
pub(super) const FACTORS_ABOVE: f64 = 1e4;

/// `z − x`, turned by whole periods to within half of one.
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

/// Rounding that a covariance may show.
const ROUNDING: f64 = 1e-10;
/// Larger numbers overflow when squared.
const LARGEST: f64 = 1e100;

impl State {
    /// A state with this covariance, which may be singular.
    ///
    /// # Errors
    /// A number that is not finite, or a matrix that is not a covariance.
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

    /// Nothing is known.
    pub const UNKNOWN: Self = Self {
        mean: [f64::NAN; 3],
        covariance: [f64::INFINITY, 0.0, 0.0, f64::INFINITY, 0.0, f64::INFINITY],
    };

    /// `x⁻ = F x`, `P⁻ = F P F^T + Q`.
    #[inline(always)]
    pub fn predicted(&self, transition: &Transition) -> Self {
        let [f01, f02, f12, f22] = transition.f;
        let [x0, x1, x2] = self.mean;
        let [p00, p01, p02, p11, p12, p22] = self.covariance;
        let q = &transition.q;
        // A = F P
        let a00 = p00 + f01 * p01 + f02 * p02;
        let a01 = p01 + f01 * p11 + f02 * p12;
        let a02 = p02 + f01 * p12 + f02 * p22;
        let a11 = p11 + f12 * p12;
        let a12 = p12 + f12 * p22;
        Self {
            mean: [x0 + f01 * x1 + f02 * x2, x1 + f12 * x2, f22 * x2],
            covariance: [
                a00 + f01 * a01 + f02 * a02 + q[0],
                a01 + f12 * a02 + q[1],
                f22 * a02 + q[2],
                a11 + f12 * a12 + q[3],
                f22 * a12 + q[4],
                f22 * f22 * p22 + q[5],
            ],
        }
    }

    /// Whether an update with a plot of variance r would leave few digits of the covariance.
    #[inline(always)]
    pub(crate) fn needs_factors(&self, r: f64) -> bool {
        self.covariance[0] > FACTORS_ABOVE * r
    }

    /// `x + K ν` and `(I − K h^T) P⁻` for a plot z with the variance r.
    ///
    /// The first row is `P⁻_0j R / S`: with 1 − K_0 in place of R/S, a precise plot would lose its
    /// digits.
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
