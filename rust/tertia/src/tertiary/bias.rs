//! Effect of the systematic errors of a radar on the states of its tracks.

use crate::registration::{Errors, KINDS};
use crate::sensors::Radar;
use nalgebra::{Matrix4, Vector4};

/// Derivatives of a state by the offset and gain of the range, the azimuth and the clock.
///
/// Let e be the unit vector away from the radar, f the one across (clockwise), and `e' = θ' f`. The
/// derivatives of the position are `s e, s ρ e, r f, −v`, where s is the slant range divided by the ground
/// range; those of the velocity are the rates of these.
pub(super) fn sensitivity(state: &Vector4<f64>, height: f64, radar: &Radar) -> Matrix4<f64> {
    let [x, y] = [state[0] - radar.position[0], state[1] - radar.position[1]];
    let [vx, vy] = [state[2], state[3]];
    let ground = x.hypot(y).max(1.0);
    let up = if height.is_finite() { height - radar.position[2] } else { 0.0 };
    let slant = ground.hypot(up);
    let slope = slant / ground;
    let (ex, ey) = (x / ground, y / ground);
    let rate = (vx * ey - vy * ex) / ground;
    let gain = slope * slope;
    Matrix4::new(
        slope * ex,
        gain * x,
        y,
        -vx, //
        slope * ey,
        gain * y,
        -x,
        -vy, //
        slope * rate * ey,
        gain * vx,
        vy,
        0.0, //
        -slope * rate * ex,
        gain * vy,
        -vx,
        0.0,
    )
}

/// Covariance `J Σ K'` of two states from errors whose covariance between the two sensors is `block`. Written
/// in plain loops, which compilers unroll, and with the order of summation of a general product.
#[inline(always)]
pub(super) fn propagated(j: &Matrix4<f64>, block: &Matrix4<f64>, k: &Matrix4<f64>) -> Matrix4<f64> {
    product(&product(j, block), &k.transpose())
}

#[inline(always)]
fn product(a: &Matrix4<f64>, b: &Matrix4<f64>) -> Matrix4<f64> {
    let (a, mut product) = (&a.data.0, *b);
    for b in &mut product.data.0 {
        let [p, q, r, s] = *b;
        for i in 0..4 {
            b[i] = a[0][i] * p + a[1][i] * q + a[2][i] * r + a[3][i] * s;
        }
    }
    product
}

/// Returns the state corrected for these errors.
pub(super) fn corrected(
    state: &Vector4<f64>,
    sensitivity: &Matrix4<f64>,
    errors: &Errors,
) -> Vector4<f64> {
    state - sensitivity * Vector4::from_column_slice(&errors[..KINDS])
}

const _: () = assert!(KINDS == 4);
