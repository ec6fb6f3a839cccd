//! The steady state of the filter, by the doubling algorithm.
//!
//! If plots are precise and the process noise has a lower rank than the state, errors of the covariance
//! alternate from step to step with hardly any damping, so that rounding would be amplified by as much
//! as P0/R. Therefore numbers with twice the digits are used.

use super::model::{Singer, Transition};
use crate::base::error::{Error, Result, require};
use nalgebra::{Matrix3, RowVector3, Vector3};
use twofloat::TwoFloat;

type Matrix = Matrix3<TwoFloat>;

/// Largest number of doublings: 2^60 steps.
const MAX_DOUBLINGS: usize = 60;
/// Change of the covariance in a doubling, in standard deviations, below which it counts as steady.
const STEADY: f64 = 1e-13;
/// Change of the covariance in an ordinary step up to which it is steady, which is the rounding with
/// twice the digits: a slowly decaying error exceeds its change in a step by up to six orders of
/// magnitude (measured).
const ROUNDING: f64 = 1e-18;

/// Returns the gain and the covariance after a plot to which the filter converges with a plot of
/// variance r every `dt`.
///
/// The doubling algorithm (Anderson 1978) computes 2^k steps in k rounds.
///
/// # Errors
/// If there is no steady state because there is no process noise, or if the plots are too precise for
/// double precision.
pub fn steady_state(model: &Singer, dt: f64, r: f64) -> Result<([f64; 3], [f64; 6])> {
    let transition = model.over(dt)?;
    let (sigma, noise) = (model.acceleration_sigma(), transition.q[5]);
    let requirement = "such that the model has process noise and time passes: there is no steady \
                       state otherwise";
    require("acceleration_sigma", sigma, noise > 0.0 && dt > 0.0, requirement)?;
    let refuse = || Error::InvalidParameter {
        argument: "measurement_variance",
        value: r,
        requirement: "nearer to the noise of the motion: the gain does not settle",
    };
    let covariance = settled(&transition, dt, r).ok_or_else(refuse)?;
    let [p00, p01, p02, p11, p12, p22] = covariance;
    // back from units of dt and of the standard deviation of the plots
    let gain = [p00, p01 / dt, p02 / (dt * dt)];
    let rest = [p11 / (dt * dt), p12 / dt.powi(3), p22 / dt.powi(4)];
    let [k0, k1, k2] = gain;
    Ok((gain, [k0, k1, k2, rest[0], rest[1], rest[2]].map(|p| p * r)))
}

/// Returns the upper triangle of the steady covariance after a plot, in units of `dt` and of the
/// standard deviation of the plots; `None` if it does not converge.
fn settled(transition: &Transition, dt: f64, r: f64) -> Option<[f64; 6]> {
    let (f, q) = scaled(transition, dt, r);
    // as for a regulator: A is transposed
    let (mut a, mut information, mut prior) = (f.transpose(), Matrix::zeros(), q);
    information[(0, 0)] = TwoFloat::from(1.0);
    let mut before = Matrix::zeros();
    for _ in 0..MAX_DOUBLINGS {
        let inverse = inverse(&(Matrix::identity() + information * prior));
        let (later, gained) = (inverse * a, inverse * information);
        prior += a.transpose() * prior * later;
        information += a * gained * a.transpose();
        a *= later;
        let posterior = updated(&prior);
        if change(&posterior, &before) <= STEADY {
            let next = updated(&(f * posterior * f.transpose() + q));
            let upper = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];
            let steady = change(&posterior, &next) <= ROUNDING;
            return steady.then(|| upper.map(|place| posterior[place].into()));
        }
        before = posterior;
    }
    None
}

/// Returns F and Q in units of `dt` and of the standard deviation of the plots.
fn scaled(transition: &Transition, dt: f64, r: f64) -> (Matrix, Matrix) {
    let ([f01, f02, f12, f22], [q00, q01, q02, q11, q12, q22]) = (transition.f, transition.q);
    let f = Matrix3::new(1.0, f01, f02, 0.0, 1.0, f12, 0.0, 0.0, f22).map(TwoFloat::from);
    let q = Matrix3::new(q00, q01, q02, q01, q11, q12, q02, q12, q22).map(TwoFloat::from);
    let unit = |i: usize, value: TwoFloat| (0..i).fold(value, |value, _| value * dt);
    let less = |i: usize, value: TwoFloat| (0..i).fold(value, |value, _| value / dt);
    (
        Matrix::from_fn(|i, j| less(j, unit(i, f[(i, j)]))),
        Matrix::from_fn(|i, j| unit(i + j, q[(i, j)]) / r),
    )
}

/// Returns the covariance after a plot of variance 1; its first row is the gain.
fn updated(prior: &Matrix) -> Matrix {
    let s = prior[(0, 0)] + 1.0;
    let gain = prior.column(0).map(|p| quotient(p, s));
    Matrix::from_fn(|i, j| match (i, j) {
        (0, _) => gain[j],
        (_, 0) => gain[i],
        _ => prior[(i, j)] - prior[(i, 0)] * gain[j],
    })
}

/// Returns the sum of the differences, in standard deviations; nan if one of them is nan.
fn change(p: &Matrix, before: &Matrix) -> f64 {
    let sigma = p.diagonal().map(|p| f64::from(p).sqrt());
    let difference = (p - before).map(f64::from);
    difference.abs().component_div(&(sigma * sigma.transpose())).sum()
}

/// Returns the inverse, whose rows are the cross products of the columns divided by the determinant.
fn inverse(m: &Matrix) -> Matrix {
    let [a, b, c]: [Vector3<TwoFloat>; 3] = [0, 1, 2].map(|j| m.column(j).into_owned());
    let rows: [RowVector3<TwoFloat>; 3] =
        [b.cross(&c), c.cross(&a), a.cross(&b)].map(|row| row.transpose());
    let determinant = (rows[0] * a)[0];
    Matrix::from_rows(&rows).map(|value| quotient(value, determinant))
}

/// Returns `a / b`. The division of `twofloat` by a number with twice the digits is only accurate to
/// double precision.
fn quotient(a: TwoFloat, b: TwoFloat) -> TwoFloat {
    let first = a.hi() / b.hi();
    let rest = a - b * first;
    TwoFloat::from(first) + (rest.hi() / b.hi())
}
