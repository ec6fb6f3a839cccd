//! The estimators of Lenth (1981) for azimuths in the plane.
//!
//! Errors have a von Mises distribution with concentration κ. With `θ` anticlockwise from east,
//! `s = sin θ`, `c = cos θ`, distances d and `s* = (y − y_i)/d³`, `c* = (x − x_i)/d³`, the fix solves
//!
//! ```text
//! | Σ w s s*  −Σ w c s* | |x|   |  Σ w s* z |
//! |−Σ w s c*   Σ w c c* | |y| = | −Σ w c* z |,   z = s x_i − c y_i,
//! ```
//!
//! with weights `w = ψ(t)/t`, `t = √(2κ(1 − cos(θ − μ)))`; for maximum likelihood all weights are 1.

use crate::base::small::{Factor, Matrix, Vector, norm};
use crate::sensors::Measurement;
use std::f64::consts::PI;

/// Tuning constant of both robust forms.
const CONSTANT: f64 = 1.5;
/// Residual t from which on Andrews' weight is zero.
pub(in crate::location) const ZERO: f64 = CONSTANT * PI;
/// Smallest determinant of a regular matrix, relative to its rows.
const SINGULAR: f64 = 1e-12;
const STEPS: usize = 500;
const TOLERANCE: f64 = 1e-10;
/// Rounding error of a residual, in radians. It limits the accuracy of κ.
const ROUNDING: f64 = 1e-14;
/// Largest κ. Residuals that would give a larger κ are mere rounding errors and contain no information.
const LARGEST_KAPPA: f64 = 1e24;

/// How the weight of an azimuth decreases with its residual.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::location) enum Weight {
    One,
    Huber,
    Andrews,
}

impl Weight {
    fn of(self, t: f64) -> f64 {
        match self {
            Self::One => 1.0,
            Self::Huber => {
                if t <= CONSTANT {
                    1.0
                } else {
                    CONSTANT / t
                }
            }
            Self::Andrews if t == 0.0 => 1.0,
            Self::Andrews if t >= ZERO => 0.0,
            Self::Andrews => CONSTANT / t * (t / CONSTANT).sin(),
        }
    }
}

/// The fix, with its covariance and the concentration of the errors.
pub(in crate::location) struct Estimate<const D: usize> {
    pub position: Vector<D>,
    pub covariance: Option<Matrix<D>>,
    pub kappa: f64,
    pub converged: bool,
}

/// Estimates the fix from a start. `kappa` is estimated if `known_kappa` is `None`.
pub(in crate::location) fn estimate<const D: usize>(
    measurements: &[Measurement<D>],
    start: Vector<D>,
    known_kappa: Option<f64>,
    weight: Weight,
) -> Estimate<D> {
    let mut p = start;
    let mut kappa = known_kappa.unwrap_or_else(|| concentration(measurements, &p, |_| 1.0));
    let mut converged = false;
    for step in 0..STEPS {
        // the first steps are unweighted: κ at the start is not yet that of the errors
        let rule = if step < 5 { Weight::One } else { weight };
        let of = |turn: f64| rule.of((2.0 * kappa * turn).max(0.0).sqrt());
        let Some(next) = solve(measurements, &p, of) else { break };
        let moved: Vector<D> = std::array::from_fn(|i| next[i] - p[i]);
        let size = norm(&next);
        p = next;
        let last = kappa;
        if known_kappa.is_none() {
            kappa = concentration(measurements, &p, of);
        }
        let steady = (kappa - last).abs() <= (TOLERANCE + ROUNDING * kappa.sqrt()) * kappa;
        if step >= 5 && steady && norm(&moved) <= TOLERANCE * size {
            converged = true;
            break;
        }
    }
    let of = |turn: f64| weight.of((2.0 * kappa * turn).max(0.0).sqrt());
    let covariance = covariance(measurements, &p, of, kappa);
    Estimate { position: p, covariance, kappa, converged }
}

/// Returns the terms of one azimuth: 1 minus the cosine of its residual, computed without cancellation;
/// (s, c); and (s*, c*).
fn terms<const D: usize>(m: &Measurement<D>, p: &Vector<D>) -> (f64, [f64; 2], [f64; 2]) {
    // θ is anticlockwise from east, the azimuth clockwise from north
    let (s, c) = (m.cosine, m.sine);
    let (x, y) = (p[0] - m.station[0], p[1] - m.station[1]);
    let d = (x * x + y * y).sqrt();
    let (sine, cosine) = ((s * x - c * y) / d, (c * x + s * y) / d);
    let turn = if cosine > 0.0 { sine * sine / (1.0 + cosine) } else { 1.0 - cosine };
    (turn, [s, c], [y / d.powi(3), x / d.powi(3)])
}

fn solve<const D: usize>(
    measurements: &[Measurement<D>],
    p: &Vector<D>,
    weight: impl Fn(f64) -> f64,
) -> Option<Vector<D>> {
    let mut a = [[0.0; 2]; 2];
    let mut b = [0.0; 2];
    for m in measurements {
        let (turn, [s, c], [ss, cs]) = terms(m, p);
        let w = weight(turn);
        let z = s * m.station[0] - c * m.station[1];
        a[0][0] += w * s * ss;
        a[0][1] -= w * c * ss;
        a[1][0] -= w * s * cs;
        a[1][1] += w * c * cs;
        b[0] += w * ss * z;
        b[1] -= w * cs * z;
    }
    let determinant = a[0][0] * a[1][1] - a[0][1] * a[1][0];
    let size = (a[0][0].abs() + a[0][1].abs()) * (a[1][0].abs() + a[1][1].abs());
    if determinant.is_nan() || determinant.abs() <= SINGULAR * size {
        return None;
    }
    let mut next = *p;
    next[0] = (b[0] * a[1][1] - b[1] * a[0][1]) / determinant;
    next[1] = (a[0][0] * b[1] - a[1][0] * b[0]) / determinant;
    Some(next)
}

/// Estimates κ from the weighted mean cosine, by Lenth's approximation.
fn concentration<const D: usize>(
    measurements: &[Measurement<D>],
    p: &Vector<D>,
    weight: impl Fn(f64) -> f64,
) -> f64 {
    let (mut sum, mut total) = (0.0, 0.0);
    for m in measurements {
        let turn = terms(m, p).0;
        let w = weight(turn);
        sum += w * turn;
        total += w;
    }
    let rest = sum / total;
    let mean = 1.0 - rest;
    let reciprocal =
        2.0 * rest + rest * rest * (0.48794 - 0.82905 * mean - 1.3915 * mean * mean) / mean;
    let kappa = 1.0 / reciprocal;
    // nan remains nan
    if kappa > LARGEST_KAPPA { LARGEST_KAPPA } else { kappa }
}

/// Returns `κ^-1 [Σ w s* s, −½ Σ w (s* c + c* s); ·, Σ w c* c]^-1`.
fn covariance<const D: usize>(
    measurements: &[Measurement<D>],
    p: &Vector<D>,
    weight: impl Fn(f64) -> f64,
    kappa: f64,
) -> Option<Matrix<D>> {
    let mut a = [[0.0; D]; D];
    for m in measurements {
        let (turn, [s, c], [ss, cs]) = terms(m, p);
        let w = weight(turn) * kappa;
        a[0][0] += w * ss * s;
        a[0][1] -= 0.5 * w * (ss * c + cs * s);
        a[1][1] += w * cs * c;
    }
    a[1][0] = a[0][1];
    Factor::try_new(&a, 0.0).map(|factor| factor.inverse())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;
    use crate::sensors::Kind;

    /// If errors are small, 1 minus the cosine of a residual loses most of its digits to cancellation.
    #[test]
    fn precise_bearings_converge() {
        let stations = [[0.0, 0.0], [1e4, 0.0], [0.0, 1e4], [1e4, 1.2e4], [-5e3, 3e3]];
        for sigma in [0.0, 1e-9, 1e-7, 1e-5, 1e-3] {
            let mut random = Random::new(3);
            for _ in 0..50 {
                let p = [3e3 + random.symmetric(2e3), 4.5e3 + random.symmetric(2e3)];
                let mut measured = |(k, station): (usize, &Vector<2>)| {
                    let azimuth = (p[0] - station[0]).atan2(p[1] - station[1]);
                    let value = azimuth + random.symmetric(1.7 * sigma);
                    Measurement::new(Kind::Azimuth, k, *station, value, 1.0)
                };
                let measurements: Vec<_> = stations.iter().enumerate().map(&mut measured).collect();
                for weight in [Weight::One, Weight::Huber, Weight::Andrews] {
                    let found = estimate(&measurements, p, None, weight);
                    assert!(found.converged && found.covariance.is_some(), "{sigma} {weight:?}");
                    assert!(1.0 / found.kappa.sqrt() < 2.0 * sigma + 2e-12);
                }
            }
        }
    }
}
