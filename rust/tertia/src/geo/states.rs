//! Conversion between polar states of a radar and states of east and north.
//!
//! With `e = (sin θ, cos θ)` and `f = (cos θ, −sin θ)`, for which `de/dθ = f` and `df/dθ = −e`:
//!
//! `p = ρ e`, `v = ρ' e + ρ θ' f`, `a = (ρ'' − ρ θ'²) e + (ρ θ'' + 2 ρ' θ') f`.
//!
//! An azimuth alone cannot be converted to another site, because the range is required.

use crate::base::angle::principal;
use std::f64::consts::TAU;

/// Largest size of a state: two coordinates, each with its rate and acceleration.
pub const SIZE: usize = 6;
/// Derivative of a state by another; shorter states use the upper left parts.
pub type Jacobian = [[f64; SIZE]; SIZE];

/// Converts `[ρ, ρ', ρ'', θ, θ', θ'']` to `[p, v, a]` relative to the radar, with the derivatives.
pub fn to_cartesian(polar: &[f64; SIZE]) -> ([f64; SIZE], Jacobian) {
    let &[r, r1, r2, angle, w, w1] = polar;
    let (sine, cosine) = angle.sin_cos();
    let (along, across) = (r2 - r * w * w, r * w1 + 2.0 * r1 * w);
    // derivatives by ρ, ρ', ρ'', θ, θ', θ'': components along e and f of p, v and a
    let of = [
        [[1.0, 0.0], [0.0, 0.0], [0.0, 0.0], [0.0, r], [0.0, 0.0], [0.0, 0.0]],
        [[0.0, w], [1.0, 0.0], [0.0, 0.0], [-r * w, r1], [0.0, r], [0.0, 0.0]],
        [
            [-w * w, w1],
            [0.0, 2.0 * w],
            [1.0, 0.0],
            [-across, along],
            [-2.0 * r * w, 2.0 * r1],
            [0.0, r],
        ],
    ];
    let turned = |[e, f]: [f64; 2]| [e * sine + f * cosine, e * cosine - f * sine];
    let mut jacobian = [[0.0; SIZE]; SIZE];
    for (k, row) in of.iter().enumerate() {
        for (j, &components) in row.iter().enumerate() {
            let [east, north] = turned(components);
            jacobian[2 * k][j] = east;
            jacobian[2 * k + 1][j] = north;
        }
    }
    let [[pe, pn], [ve, vn], [ae, an]] = [[r, 0.0], [r1, r * w], [along, across]].map(turned);
    ([pe, pn, ve, vn, ae, an], jacobian)
}

/// Converts `[p, v, a]` relative to the radar to `[ρ, ρ', ρ'', θ, θ', θ'']`, θ in [0, 2π); `None` at
/// the radar.
pub fn to_polar(state: &[f64; SIZE]) -> Option<[f64; SIZE]> {
    let &[x, y, vx, vy, ax, ay] = state;
    let r = (x * x + y * y).sqrt();
    if r == 0.0 {
        return None;
    }
    let (sine, cosine) = (x / r, y / r);
    // ρ' = v e, θ' = v f / ρ, ρ'' = a e + ρ θ'², θ'' = (a f − 2 ρ' θ') / ρ
    let (r1, w) = (vx * sine + vy * cosine, (vx * cosine - vy * sine) / r);
    let (along, across) = (ax * sine + ay * cosine, ax * cosine - ay * sine);
    let angle = principal(sine.atan2(cosine), TAU);
    Some([r, r1, along + r * w * w, angle, w, (across - 2.0 * r1 * w) / r])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_within;

    const STATE: [f64; SIZE] = [80e3, -150.0, 1.2, 40.0, 0.12, 0.003];

    fn radians(mut state: [f64; SIZE]) -> [f64; SIZE] {
        for angle in &mut state[3..] {
            *angle = angle.to_radians();
        }
        state
    }

    /// Values of the prototype.
    #[test]
    fn there_and_back() {
        let (found, jacobian) = to_cartesian(&radians(STATE));
        for (found, expected) in found.into_iter().zip([
            51_423.008_774_92,
            61_283.555_449_52,
            31.933_836_937_73,
            -222.606_764_196_4,
            3.273_258_115_217,
            -1.638_193_499_912,
        ]) {
            assert_within(1e-12, found, expected);
        }
        let sigmas = radians([60.0, 3.0, 0.5, 0.08, 0.01, 0.002]);
        let covariance = |i: usize, j: usize| -> f64 {
            (0..SIZE).map(|k| jacobian[i][k] * jacobian[j][k] * sigmas[k] * sigmas[k]).sum()
        };
        for (at, expected) in [
            ((0, 0), 8_809.313_438_782),
            ((1, 1), 7_267.816_075_682),
            ((2, 2), 118.228_835_061_8),
            ((3, 3), 85.840_700_691_62),
            ((4, 4), 4.685_609_959_291),
            ((5, 5), 3.368_952_192_359),
            ((0, 1), -4_371.132_985_169),
            ((2, 3), -91.558_953_035_05),
            ((4, 5), -3.715_971_969_312),
            ((0, 4), -0.109_432_568_477_3),
        ] {
            assert_within(1e-11, covariance(at.0, at.1), expected);
        }
        let back = to_polar(&found).unwrap();
        for (found, expected) in back.into_iter().zip(radians(STATE)) {
            assert_within(1e-11, found, expected);
        }
        assert!(to_polar(&[0.0; SIZE]).is_none());
    }

    #[test]
    fn seen_from_elsewhere() {
        let (mut state, _) = to_cartesian(&radians(STATE));
        (state[0], state[1]) = (state[0] - 60e3, state[1] - 20e3);
        let expected = radians([
            42_165.112_700_29,
            -224.448_467_613_6,
            -2.265_112_682_319,
            348.263_304_568_5,
            -0.019_044_506_816_36,
            0.003_699_291_162_471,
        ]);
        for (found, expected) in to_polar(&state).unwrap().into_iter().zip(expected) {
            assert_within(1e-11, found, expected);
        }
    }
}
