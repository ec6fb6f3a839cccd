//! Measurements that the errors of radars do not affect: a velocity that comes with a plot, or an azimuth of
//! another sensor. Each of them reduces the influence of the errors on the track.

use crate::base::plane::Plane;

/// Change of position and velocity by a unit error of a plot along east and along north.
pub(crate) type Gain = [[f64; 4]; 2];

/// The factor `1 − K H` by which a measurement `H v` with the gain K multiplies an error v of a state.
pub(super) struct Settled {
    rows: [[f64; 4]; 2],
    gain: Gain,
}

impl Settled {
    /// Returns the factor of a velocity with this noise R, from the covariance P after the velocity was used
    /// (row by row): `K = P H' R⁻¹`.
    pub fn by_velocity(covariance: &[f64; 16], noise: Plane) -> Self {
        let mut gain = times(covariance, noise.inverse());
        restrain(&mut gain, 2, 1.0);
        Self { rows: [[0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]], gain }
    }

    /// Returns the factor of a measurement of variance 1 with the derivatives `row`, from the covariance
    /// after the measurement was used.
    pub fn by_azimuth(covariance: &[f64; 16], row: [f64; 4]) -> Self {
        let gain: [f64; 4] =
            std::array::from_fn(|i| (0..4).map(|j| covariance[4 * i + j] * row[j]).sum());
        let most = dot(&row, &gain).max(1.0);
        Self { rows: [row, [0.0; 4]], gain: [gain.map(|k| k / most), [0.0; 4]] }
    }

    /// Returns `(1 − K H) v`.
    pub fn left(&self, v: [f64; 4]) -> [f64; 4] {
        let [a, b] = [0, 1].map(|axis| dot(&self.rows[axis], &v));
        std::array::from_fn(|i| v[i] - self.gain[0][i] * a - self.gain[1][i] * b)
    }
}

/// Returns the covariance before a velocity was used: `P + P H' (R − H P H')⁻¹ H P`. A filter with several
/// models has no single gain, so `H P H'` may exceed the noise R; P is then returned unchanged.
pub(super) fn before(covariance: &[f64; 16], noise: Plane) -> [f64; 16] {
    let [own, both, other] = [10, 11, 15].map(|at| covariance[at]);
    let left = Plane { xx: noise.xx - own, xy: noise.xy - both, yy: noise.yy - other };
    if left.xx <= 0.0 || left.determinant() <= 0.0 {
        return *covariance;
    }
    let [east, north] = times(covariance, left.inverse());
    std::array::from_fn(|n| {
        let (i, j) = (n / 4, n % 4);
        covariance[n] + east[i] * covariance[8 + j] + north[i] * covariance[12 + j]
    })
}

/// Returns the columns of `P H' M`, where H selects the velocity.
fn times(covariance: &[f64; 16], by: Plane) -> Gain {
    let column =
        |a: f64, b: f64| std::array::from_fn(|i| covariance[8 + i] * a + covariance[12 + i] * b);
    [column(by.xx, by.xy), column(by.xy, by.yy)]
}

/// Limits a gain so that the measured components of the state, `at` and the next one, move no farther than to
/// `largest` times the measured values: a filter with several models has no single gain, so the gain may be
/// overestimated.
#[inline(always)]
pub(crate) fn restrain(gain: &mut Gain, at: usize, largest: f64) {
    let [east, north] = *gain;
    let middle = 0.5 * (east[at] + north[at + 1]);
    let determinant = east[at] * north[at + 1] - east[at + 1] * north[at];
    let most = middle + (middle * middle - determinant).max(0.0).sqrt();
    if most > largest {
        gain.as_flattened_mut().iter_mut().for_each(|value| *value /= most / largest);
    }
}

fn dot(a: &[f64; 4], b: &[f64; 4]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix2, Matrix2x4, Matrix4};

    fn wide() -> Matrix4<f64> {
        let root = Matrix4::new(
            30.0, 2.0, 5.0, 0.0, 1.0, 40.0, 0.0, 6.0, 2.0, 0.0, 9.0, 1.0, 0.0, 3.0, 1.0, 8.0,
        );
        root * root.transpose()
    }

    fn numbers(p: &Matrix4<f64>) -> [f64; 16] {
        std::array::from_fn(|n| p[(n / 4, n % 4)])
    }

    /// Returns the covariance after a measurement, and `1 − K H`.
    fn after(
        p: &Matrix4<f64>,
        h: &Matrix2x4<f64>,
        r: &Matrix2<f64>,
    ) -> (Matrix4<f64>, Matrix4<f64>) {
        let gain = p * h.transpose() * (h * p * h.transpose() + r).try_inverse().unwrap();
        let left = Matrix4::identity() - gain * h;
        (left * p, left)
    }

    #[test]
    fn a_velocity_is_that_of_a_kalman_filter() {
        let mut h = Matrix2x4::zeros();
        (h[(0, 2)], h[(1, 3)]) = (1.0, 1.0);
        let noise = Plane { xx: 4.0, xy: 1.0, yy: 3.0 };
        let (p, left) = after(&wide(), &h, &Matrix2::new(4.0, 1.0, 1.0, 3.0));
        let back = before(&numbers(&p), noise);
        let own = Settled::by_velocity(&numbers(&p), noise);
        for i in 0..4 {
            for j in 0..4 {
                assert!((back[4 * i + j] - wide()[(i, j)]).abs() < 1e-6, "{i} {j}");
            }
            let column = own.left(std::array::from_fn(|j| f64::from(u8::from(i == j))));
            (0..4).for_each(|j| assert!((column[j] - left[(j, i)]).abs() < 1e-9, "{i} {j}"));
        }
    }

    #[test]
    fn an_azimuth_is_that_of_a_kalman_filter() {
        let row = [0.02, -0.05, 0.0, 0.0];
        let h = Matrix2x4::new(row[0], row[1], 0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
        let (p, left) = after(&wide(), &h, &Matrix2::identity());
        let own = Settled::by_azimuth(&numbers(&p), row);
        for i in 0..4 {
            let column = own.left(std::array::from_fn(|j| f64::from(u8::from(i == j))));
            (0..4).for_each(|j| assert!((column[j] - left[(j, i)]).abs() < 1e-9, "{i} {j}"));
        }
    }
}
