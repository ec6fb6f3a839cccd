//! Test whether two tracks belong to the same target (Bar-Shalom, Fortmann 1988).

use nalgebra::{Cholesky, Matrix4, Vector4};

/// Distance between two tracks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Distance {
    /// `D² = d' T⁻¹ d`
    pub squared: f64,
    /// `ln |2π T|`
    pub ln_determinant: f64,
}

impl Distance {
    /// Distance of a difference d with the covariance T; `None` if T is not positive definite.
    #[inline(always)]
    pub fn new(difference: &Vector4<f64>, covariance: Matrix4<f64>) -> Option<Self> {
        // L D L' = T and L z = d in plain loops, which compilers unroll; columns take the place of rows
        let (mut t, mut z) = (covariance.data.0, difference.data.0[0]);
        let (mut squared, mut determinant) = (0.0, 1.0);
        for k in 0..4 {
            let own = t[k];
            let pivot = own[k];
            if pivot.is_nan() || pivot <= 0.0 {
                return None;
            }
            squared += z[k] * z[k] / pivot;
            determinant *= pivot;
            for i in k + 1..4 {
                let share = own[i] / pivot;
                z[i] -= share * z[k];
                for (column, other) in t.iter_mut().zip(own).take(i + 1).skip(k + 1) {
                    column[i] -= share * other;
                }
            }
        }
        let ln_determinant = 4.0 * std::f64::consts::TAU.ln() + determinant.ln();
        Some(Self { squared, ln_determinant })
    }

    /// Log-likelihood ratio of one target to two targets at this density, per m² and (m/s)².
    pub fn score(&self, density: f64) -> f64 {
        -0.5 * (self.squared + self.ln_determinant) - density.ln()
    }
}

/// Covariance between two tracks of one target that share its process noise, from the correlations of
/// positions and velocities: `C = L_a diag(r_p, r_p, r_v, r_v) L_b'` with the Cholesky factors L. With
/// |r| ≤ 1 the joint matrix is positive definite; correlations of the single elements would not ensure
/// this. Returns `None` if a covariance is not positive definite.
pub fn shared(a: &Matrix4<f64>, b: &Matrix4<f64>, correlation: [f64; 2]) -> Option<Matrix4<f64>> {
    let (a, b) = (Cholesky::new(*a)?.l(), Cholesky::new(*b)?.l());
    let [position, velocity] = correlation;
    let scale = Vector4::new(position, position, velocity, velocity);
    Some(a * Matrix4::from_diagonal(&scale) * b.transpose())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_within;

    fn assert_close(found: f64, expected: f64) {
        assert_within(1e-11, found, expected);
    }

    fn first() -> Matrix4<f64> {
        Matrix4::new(
            8100.0, 900.0, 220.0, 30.0, 900.0, 6400.0, 25.0, 180.0, 220.0, 25.0, 36.0, 4.0, 30.0,
            180.0, 4.0, 30.0,
        )
    }

    fn second() -> Matrix4<f64> {
        Matrix4::new(
            14400.0, -2000.0, 300.0, -60.0, -2000.0, 10000.0, -50.0, 260.0, 300.0, -50.0, 49.0,
            -6.0, -60.0, 260.0, -6.0, 40.0,
        )
    }

    const DENSITY: f64 = 2e-9 / (std::f64::consts::PI * 250.0 * 250.0);

    /// Expected values computed with NumPy.
    #[test]
    fn two_tracks() {
        let d = Vector4::new(140.0, -95.0, 6.0, 4.0);
        let (a, b) = (first(), second());
        let apart = Distance::new(&d, a + b).unwrap();
        assert_close(apart.squared, 2.200618765334);
        assert_close(apart.ln_determinant, 35.42813894752);
        assert_close(apart.score(DENSITY), 13.40339152153);
        let c = shared(&a, &b, [0.1, 0.3]).unwrap();
        let common = Distance::new(&d, a + b - c - c.transpose()).unwrap();
        assert_close(common.squared, 2.693737913819);
        assert_close(common.ln_determinant, 34.53940243274);
        assert_close(common.score(DENSITY), 13.60120020468);
        assert!(Distance::new(&d, -a).is_none() && shared(&a, &-b, [0.1; 2]).is_none());
    }

    /// Pairs among three tracks, computed with NumPy.
    #[test]
    fn three_tracks() {
        let c = Matrix4::from_diagonal(&Vector4::new(1e4, 1e4, 40.0, 40.0));
        let (d, e) = (Vector4::new(140.0, -95.0, 6.0, 4.0), Vector4::new(-60.0, 30.0, -2.0, 3.0));
        let score = |d: Vector4<f64>, t: Matrix4<f64>| Distance::new(&d, t).unwrap().score(DENSITY);
        let pairs =
            [score(d, first() + second()), score(-e, first() + c), score(-d - e, second() + c)];
        for (found, expected) in pairs.iter().zip([13.40339152153, 14.33105583167, 13.45304303473])
        {
            assert_close(*found, expected);
        }
        assert_close(pairs.iter().sum::<f64>() * 2.0 / 3.0, 27.45832692529);
    }
}
