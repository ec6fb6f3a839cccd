//! Mean and covariance of a state, which motion models predict and plots correct.

use crate::base::exponential::exp;
use crate::base::plane::Plane;
use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};

/// Mean and covariance of N states, of which the first two are the position.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Estimate<const N: usize> {
    /// Mean.
    pub mean: SVector<f64, N>,
    /// Covariance.
    pub covariance: SMatrix<f64, N, N>,
}

/// Indices of the position and of the velocity in the state.
pub(in crate::tracker) const POSITION: usize = 0;
pub(in crate::tracker) const VELOCITY: usize = 2;

impl<const N: usize> Estimate<N> {
    pub(in crate::tracker) fn position(&self) -> [f64; 2] {
        [self.mean[0], self.mean[1]]
    }

    pub(in crate::tracker) fn position_covariance(&self) -> Plane {
        self.block::<POSITION>()
    }

    pub(in crate::tracker) fn velocity_covariance(&self) -> Plane {
        self.block::<VELOCITY>()
    }

    /// Covariance of two successive states, the first of which has the index `AT`.
    #[inline(always)]
    pub(in crate::tracker) fn block<const AT: usize>(&self) -> Plane {
        let p = &self.covariance;
        Plane { xx: p[(AT, AT)], xy: p[(AT, AT + 1)], yy: p[(AT + 1, AT + 1)] }
    }

    /// Columns of the covariance, which equal its rows.
    #[inline(always)]
    fn columns(&self) -> &[[f64; N]; N] {
        &self.covariance.data.0
    }

    /// Updates with a position of covariance `r`; returns the probability density of the plot.
    #[inline]
    pub(in crate::tracker) fn correct(&mut self, z: [f64; 2], r: Plane) -> f64 {
        self.correct_at::<POSITION>(z, r)
    }

    /// Updates with a position or a velocity of covariance `r`; returns its probability density.
    #[inline(always)]
    pub(in crate::tracker) fn correct_at<const AT: usize>(&mut self, z: [f64; 2], r: Plane) -> f64 {
        let own = self.block::<AT>();
        let s = own.plus(r);
        let inverse = s.inverse();
        let y = [z[0] - self.mean[AT], z[1] - self.mean[AT + 1]];
        let [first, second] = [self.columns()[AT], self.columns()[AT + 1]];
        let mut gain = [[0.0; N]; 2];
        for i in 0..N {
            let (a, b) = (first[i], second[i]);
            gain[0][i] = a * inverse.xx + b * inverse.xy;
            gain[1][i] = a * inverse.xy + b * inverse.yy;
        }
        let mean = &mut self.mean.data.0[0];
        for i in 0..N {
            mean[i] += gain[0][i] * y[0] + gain[1][i] * y[1];
        }
        let columns = &mut self.covariance.data.0;
        for j in 0..N {
            for i in 0..N {
                columns[j][i] -= gain[0][i] * first[j] + gain[1][i] * second[j];
            }
        }
        if r.xx + r.yy < own.xx + own.yy {
            // P − K P cancels if R is far smaller than P; with what was measured it equals K R
            for i in 0..N {
                let (a, b) = (gain[0][i], gain[1][i]);
                let with = [a * r.xx + b * r.xy, a * r.xy + b * r.yy];
                for k in 0..2 {
                    columns[AT + k][i] = with[k];
                    columns[i][AT + k] = with[k];
                }
            }
        }
        mirror(columns);
        exp(-0.5 * inverse.form(y)) / (std::f64::consts::TAU * s.determinant().sqrt())
    }

    /// Moments of the mixture of this estimate and another one, which has this weight and of which the first
    /// N states count: `(1 − w) P + w P₂ + w (1 − w) d d'`.
    #[inline(always)]
    pub(in crate::tracker) fn blended<const M: usize>(
        &self,
        weight: f64,
        other: &Estimate<M>,
    ) -> Self {
        let mut blended = *self;
        let (mean, second) = (&mut blended.mean.data.0[0], &other.mean.data.0[0]);
        let (own, spread) = (1.0 - weight, weight * (1.0 - weight));
        let mut d = [0.0; N];
        for i in 0..N {
            d[i] = second[i] - mean[i];
            mean[i] += weight * d[i];
        }
        let (columns, others) = (&mut blended.covariance.data.0, other.columns());
        for j in 0..N {
            let of_column = spread * d[j];
            for i in 0..N {
                columns[j][i] = own * columns[j][i] + weight * others[j][i] + of_column * d[i];
            }
        }
        blended
    }

    /// Moments of the mixture of this estimate and another one, with these weights, which need not sum to
    /// one.
    pub(in crate::tracker) fn merged(&self, own: f64, other: &Self, weight: f64) -> Self {
        let mut moments = Moments::about(self.mean);
        moments.add(own / (own + weight), self);
        moments.add(weight / (own + weight), other);
        moments.estimate()
    }

    /// Adds to the covariance a white acceleration of this spectral density (m²/s³) over the time `t`.
    #[inline(always)]
    pub(in crate::tracker) fn accelerate(&mut self, noise: Plane, t: f64) {
        let p = &mut self.covariance.data.0;
        let (position, both) = (t * t * t / 3.0, t * t / 2.0);
        let entries = [(0, 0, noise.xx), (0, 1, noise.xy), (1, 0, noise.xy), (1, 1, noise.yy)];
        for (i, j, q) in entries {
            p[j][i] += q * position;
            p[j + 2][i] += q * both;
            p[j][i + 2] += q * both;
            p[j + 2][i + 2] += q * t;
        }
    }
}

/// Copies the elements above the diagonal to those below it; `columns[j][i]` is row i, column j.
#[inline(always)]
pub(in crate::tracker) fn mirror<const N: usize>(columns: &mut [[f64; N]; N]) {
    (0..N).for_each(|j| (0..j).for_each(|i| columns[i][j] = columns[j][i]));
}

/// Sums weighted estimates, to compute the moments of their mixture.
#[derive(Clone, Copy)]
pub(in crate::tracker) struct Moments<const N: usize> {
    mean: SVector<f64, N>,
    /// Σ w (P + x x'), relative to `origin` to avoid cancellation.
    square: SMatrix<f64, N, N>,
    origin: SVector<f64, N>,
}

impl<const N: usize> Moments<N> {
    pub fn about(origin: SVector<f64, N>) -> Self {
        Self { mean: SVector::zeros(), square: SMatrix::zeros(), origin }
    }

    /// Adds an estimate of M states, of which the first N count.
    #[inline(always)]
    pub fn add<const M: usize>(&mut self, weight: f64, estimate: &Estimate<M>) {
        let (mean, covariance) = (&estimate.mean.data.0[0], estimate.columns());
        let (sum, origin) = (&mut self.mean.data.0[0], &self.origin.data.0[0]);
        let square = &mut self.square.data.0;
        let mut d = [0.0; N];
        for i in 0..N {
            d[i] = mean[i] - origin[i];
            sum[i] += d[i] * weight;
        }
        for j in 0..N {
            for i in 0..N {
                square[j][i] += weight * (covariance[j][i] + d[i] * d[j]);
            }
        }
    }

    /// The estimate with these moments; the weights must sum to one.
    #[inline]
    pub fn estimate(&self) -> Estimate<N> {
        let mut covariance = self.square;
        let (columns, mean) = (&mut covariance.data.0, &self.mean.data.0[0]);
        for j in 0..N {
            for i in 0..N {
                columns[j][i] -= mean[i] * mean[j];
            }
        }
        Estimate { mean: self.origin + self.mean, covariance }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Matrix4;

    #[test]
    fn a_correction_is_that_of_kalman() {
        let root = Matrix4::new(
            3.0, 0.1, 0.2, -0.3, 0.0, 2.0, 0.5, 0.1, 0.4, 0.0, 1.0, 0.2, 0.1, 0.3, 0.0, 1.5,
        );
        let mut estimate = Estimate {
            mean: SVector::from([1.0, 2.0, 3.0, 4.0]),
            covariance: root * root.transpose(),
        };
        let before = estimate;
        let r = Plane { xx: 2.0, xy: 0.5, yy: 1.0 };
        let density = estimate.correct([1.5, 1.0], r);
        let information = before.covariance.try_inverse().unwrap();
        let mut expected = information;
        let inverse = r.inverse();
        for (i, j, value) in
            [(0, 0, inverse.xx), (0, 1, inverse.xy), (1, 0, inverse.xy), (1, 1, inverse.yy)]
        {
            expected[(i, j)] += value;
        }
        let covariance = expected.try_inverse().unwrap();
        assert!((estimate.covariance - covariance).amax() < 1e-12);
        assert!(density > 0.0 && density < 1.0);
    }

    #[test]
    fn moments_of_two() {
        let one = Estimate { mean: SVector::from([1e9]), covariance: SMatrix::from([[1.0]]) };
        let two = Estimate { mean: SVector::from([1e9 + 2.0]), covariance: SMatrix::from([[1.0]]) };
        let mut moments = Moments::about(one.mean);
        moments.add(0.5, &one);
        moments.add(0.5, &two);
        let found = moments.estimate();
        assert_eq!((found.mean[0], found.covariance[(0, 0)]), (1e9 + 1.0, 2.0));
    }
}
