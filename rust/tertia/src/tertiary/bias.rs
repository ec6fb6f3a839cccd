//! What the systematic errors of a radar do to the states of its tracks.

use crate::registration::{ERRORS, Errors};
use crate::sensors::Radar;
use nalgebra::{Matrix4, Vector4};

/// Derivatives of a state by offset and gain of the range, azimuth and clock.
///
/// With e and f the unit vectors away from the radar and clockwise across, and `e' = θ' f`, they are
/// of the position `s e, s ρ e, r f, −v`, where s is slant over ground range, and of the velocity the
/// rates of these.
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

/// What errors of covariance `block` between two sensors do to two states: `J Σ K'`. In plain loops, which
/// compilers unroll; in the order of sums of a general product.
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

/// The state without these errors.
pub(super) fn corrected(
    state: &Vector4<f64>,
    sensitivity: &Matrix4<f64>,
    errors: &Errors,
) -> Vector4<f64> {
    state - sensitivity * Vector4::from(*errors)
}

const _: () = assert!(ERRORS == 4);
