//! Predicts means and covariances between two plots: straight on, or in a turn.

use super::estimate::{Estimate, mirror};
use crate::base::plane::Plane;
use nalgebra::SMatrix;

/// Angle below which the functions of a turn are computed by their series, rad.
const SMALL_ANGLE: f64 = 1e-3;
/// Speed below which the course of a target counts less, m/s.
const SLOWEST: f64 = 1.0;
/// Speed in standard deviations below which a target may stand: an acceleration along the error of its velocity
/// would only damp this error.
const MOVES: f64 = 3.0;

/// East and north of the course, a unit vector; zero if the target may stand.
#[inline(always)]
pub fn course(Estimate { mean, covariance: p }: &Estimate<4>) -> [f64; 2] {
    let square = mean[2] * mean[2] + mean[3] * mean[3];
    let moves = square > 0.5 * MOVES * MOVES * (p[(2, 2)] + p[(3, 3)]);
    let speed = if moves { square.sqrt().max(SLOWEST) } else { f64::INFINITY };
    [mean[2] / speed, mean[3] / speed]
}

/// Predicts straight and uniform motion with white acceleration of the spectral density `q`, m²/s³.
#[inline(always)]
pub fn straight(estimate: &mut Estimate<4>, t: f64, q: f64) {
    coast(estimate, t);
    estimate.accelerate(Plane { xx: q, xy: 0.0, yy: q }, t);
}

/// Predicts straight and uniform motion without noise.
#[inline(always)]
pub fn coast(estimate: &mut Estimate<4>, t: f64) {
    let x = &mut estimate.mean.data.0[0];
    x[0] += t * x[2];
    x[1] += t * x[3];
    // by columns: p[j][i] is row i, column j
    let p = &mut estimate.covariance.data.0;
    for i in 0..2 {
        for j in i..2 {
            let velocity = p[j + 2][i + 2];
            p[j][i] += t * (p[j + 2][i] + p[i + 2][j] + t * velocity);
            p[i][j] = p[j][i];
        }
    }
    for i in 0..2 {
        for j in 0..2 {
            p[j + 2][i] += t * p[j + 2][i + 2];
            p[i][j + 2] = p[j + 2][i];
        }
    }
}

/// Predicts a turn at the rate of the fifth state, linearised; `walk` is the intensity of the random walk of
/// the rate.
#[inline(always)]
pub fn turn(estimate: &mut Estimate<5>, t: f64, q: f64, walk: f64) {
    let [vx, vy, w] = [estimate.mean[2], estimate.mean[3], estimate.mean[4]];
    let arc = Arc::new(w, t);
    let Arc { sine, cosine, along, across, .. } = arc;
    let velocity = [cosine * vx - sine * vy, sine * vx + cosine * vy];
    estimate.mean[0] += along * vx - across * vy;
    estimate.mean[1] += across * vx + along * vy;
    estimate.mean[2] = velocity[0];
    estimate.mean[3] = velocity[1];
    let [east, north] = arc.by_rate([vx, vy]);
    let by_rate = [east, north, -t * velocity[1], t * velocity[0]];
    // G = F P by rows (the rows of P equal its columns), then G F' on and above the diagonal
    let p = &mut estimate.covariance.data.0;
    let [a, b, c, d, e] = *p;
    let mut g = [[0.0; 5]; 4];
    for j in 0..5 {
        g[0][j] = a[j] + along * c[j] - across * d[j] + by_rate[0] * e[j];
        g[1][j] = b[j] + across * c[j] + along * d[j] + by_rate[1] * e[j];
        g[2][j] = cosine * c[j] - sine * d[j] + by_rate[2] * e[j];
        g[3][j] = sine * c[j] + cosine * d[j] + by_rate[3] * e[j];
    }
    for (i, [a, b, c, d, e]) in g.into_iter().enumerate() {
        p[0][i] = a + along * c - across * d + by_rate[0] * e;
        p[1][i] = b + across * c + along * d + by_rate[1] * e;
        p[2][i] = cosine * c - sine * d + by_rate[2] * e;
        p[3][i] = sine * c + cosine * d + by_rate[3] * e;
        p[4][i] = e;
    }
    mirror(p);
    p[4][4] += walk * walk * t;
    estimate.accelerate(Plane { xx: q, xy: 0.0, yy: q }, t);
}

/// Covariance of position and velocity by an acceleration that was not noticed for `gap` seconds: Γ σ² Γ'
/// with Γ = (gap²/2, gap).
pub fn unnoticed(sigma: f64, gap: f64) -> SMatrix<f64, 4, 4> {
    let mut covariance = SMatrix::zeros();
    let square = (sigma * gap).powi(2);
    for i in 0..2 {
        covariance[(i, i)] = square * gap * gap / 4.0;
        covariance[(i, i + 2)] = square * gap / 2.0;
        covariance[(i + 2, i)] = square * gap / 2.0;
        covariance[(i + 2, i + 2)] = square;
    }
    covariance
}

/// `sin(wt)`, `cos(wt)`, their integrals over t, and the derivatives of the integrals by w.
pub struct Arc {
    pub sine: f64,
    pub cosine: f64,
    pub along: f64,
    pub across: f64,
    along_rate: f64,
    across_rate: f64,
}

impl Arc {
    #[inline(always)]
    pub fn new(w: f64, t: f64) -> Self {
        let a = w * t;
        let (sine, cosine) = a.sin_cos();
        if a.abs() < SMALL_ANGLE {
            let s = a * a;
            return Self {
                sine,
                cosine,
                along: t * (1.0 - s / 6.0),
                across: t * a * (0.5 - s / 24.0),
                along_rate: -t * t * a * (1.0 / 3.0 - s / 30.0),
                across_rate: t * t * (0.5 - s / 8.0),
            };
        }
        let (along, across) = (sine / w, (1.0 - cosine) / w);
        Self {
            sine,
            cosine,
            along,
            across,
            along_rate: (t * cosine - along) / w,
            across_rate: (t * sine - across) / w,
        }
    }

    /// Derivatives of the displacement with respect to the rate, for this initial velocity.
    #[inline(always)]
    pub fn by_rate(&self, [vx, vy]: [f64; 2]) -> [f64; 2] {
        let Self { along_rate, across_rate, .. } = self;
        [along_rate * vx - across_rate * vy, across_rate * vx + along_rate * vy]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{SMatrix, SVector};

    fn moved(mean: [f64; 5], t: f64) -> SVector<f64, 5> {
        let mut estimate = Estimate { mean: SVector::from(mean), covariance: SMatrix::zeros() };
        turn(&mut estimate, t, 0.0, 0.0);
        estimate.mean
    }

    #[test]
    fn the_covariance_of_a_turn_is_that_of_its_derivatives() {
        for w in [0.0, 1e-5, 2.4e-4, 2.6e-4, 0.05, -0.3] {
            let mean = [10.0, -20.0, 150.0, 80.0, w];
            let mut jacobian = SMatrix::<f64, 5, 5>::zeros();
            for j in 0..5 {
                let step = if j == 4 { 1e-6 } else { 1e-3 };
                let (mut up, mut down) = (mean, mean);
                up[j] += step;
                down[j] -= step;
                let column = (moved(up, 4.0) - moved(down, 4.0)) / (2.0 * step);
                jacobian.set_column(j, &column);
            }
            let root =
                SMatrix::<f64, 5, 5>::from_fn(|i, j| 1.0 / (1.0 + i as f64 + 2.0 * j as f64));
            let covariance = root * root.transpose();
            let mut estimate = Estimate { mean: SVector::from(mean), covariance };
            turn(&mut estimate, 4.0, 0.0, 0.0);
            let expected = jacobian * covariance * jacobian.transpose();
            assert!((estimate.covariance - expected).amax() < 1e-6 * expected.amax(), "{w}");
            assert_eq!(estimate.covariance, estimate.covariance.transpose());
        }
    }

    #[test]
    fn two_steps_are_one() {
        let whole = moved([0.0, 0.0, 200.0, 0.0, 0.03], 8.0);
        let half = moved([0.0, 0.0, 200.0, 0.0, 0.03], 4.0);
        let twice = moved(half.into(), 4.0);
        assert!((whole - twice).amax() < 1e-9);
        let mut estimate = Estimate {
            mean: SVector::from([0.0, 0.0, 200.0, 10.0]),
            covariance: SMatrix::identity(),
        };
        let mut other = estimate;
        straight(&mut estimate, 8.0, 0.3);
        straight(&mut other, 3.0, 0.3);
        straight(&mut other, 5.0, 0.3);
        assert!((estimate.covariance - other.covariance).amax() < 1e-12 * 100.0);
    }
}
