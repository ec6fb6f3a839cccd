//! Fits a quadratic, that is constant acceleration, to the last plots of a target that manoeuvres.

use super::estimate::Estimate;
use crate::base::plane::Plane;
use crate::base::small::Factor;
use nalgebra::{Matrix2, SMatrix, SVector, Vector2};
use serde::{Deserialize, Serialize};

/// Smallest number of plots: with fewer, the acceleration is mostly noise.
const FEWEST: usize = 5;

/// Position, velocity and acceleration by least squares.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Curve(Estimate<6>);

impl Curve {
    /// Fits the curve to plots with their age, position and covariance, the youngest last; none if they do
    /// not determine it. At the age τ the target was at `p − τ v + τ²/2 a`. Cost O(plots).
    pub fn through(
        plots: impl DoubleEndedIterator<Item = (f64, [f64; 2], Plane)> + ExactSizeIterator + Clone,
    ) -> Option<Self> {
        if plots.len() < FEWEST {
            return None;
        }
        let (_, origin, _) = plots.clone().next_back()?;
        let mut normal = SMatrix::<f64, 6, 6>::zeros();
        let mut right = SVector::<f64, 6>::zeros();
        for (age, position, noise) in plots {
            let weight = noise.inverse();
            let weight = Matrix2::new(weight.xx, weight.xy, weight.xy, weight.yy);
            let seen = weight * Vector2::new(position[0] - origin[0], position[1] - origin[1]);
            let powers = [1.0, -age, 0.5 * age * age];
            for (i, row) in powers.into_iter().enumerate() {
                let mut view = right.fixed_rows_mut::<2>(2 * i);
                view += row * seen;
                for (j, column) in powers.into_iter().enumerate() {
                    let mut view = normal.fixed_view_mut::<2, 2>(2 * i, 2 * j);
                    view += row * column * weight;
                }
            }
        }
        let covariance = SMatrix::from(Factor::try_new(&normal.data.0, 0.0)?.inverse());
        let mut mean = covariance * right;
        mean[0] += origin[0];
        mean[1] += origin[1];
        Some(Self(Estimate { mean, covariance }))
    }

    /// Predicts the state over the time t, with the same acceleration.
    pub fn advance(&mut self, t: f64) {
        let mut f = SMatrix::<f64, 6, 6>::identity();
        for axis in 0..2 {
            f[(axis, axis + 2)] = t;
            f[(axis, axis + 4)] = 0.5 * t * t;
            f[(axis + 2, axis + 4)] = t;
        }
        let Estimate { mean, covariance } = &mut self.0;
        *mean = f * *mean;
        let moved = f * *covariance * f.transpose();
        *covariance = 0.5 * (moved + moved.transpose());
    }

    /// Position and velocity.
    pub fn line(&self) -> Estimate<4> {
        Estimate {
            mean: self.0.mean.fixed_rows::<4>(0).into_owned(),
            covariance: self.0.covariance.fixed_view::<4, 4>(0, 0).into_owned(),
        }
    }

    /// Normalised square of the acceleration, by its covariance.
    pub fn significance(&self) -> f64 {
        let Estimate { mean, covariance: p } = &self.0;
        let p = Plane { xx: p[(4, 4)], xy: p[(4, 5)], yy: p[(5, 5)] };
        p.inverse().form([mean[4], mean[5]])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_parabola_is_found_and_goes_on() {
        let at = |t: f64| [100.0 - 20.0 * t + 0.7 * t * t, 40.0 * t - 0.2 * t * t];
        let noise = Plane { xx: 900.0, xy: 300.0, yy: 400.0 };
        let plots = |n: usize| {
            (0..n).rev().map(move |k| 4.0 * k as f64).map(move |age| (age, at(-age), noise))
        };
        let collected: Vec<_> = plots(7).collect();
        assert!(Curve::through(collected[3..].iter().copied()).is_none());
        let mut curve = Curve::through(collected.iter().copied()).unwrap();
        for (found, expected) in curve.0.mean.iter().zip([100.0, 0.0, -20.0, 40.0, 1.4, -0.4]) {
            assert!((found - expected).abs() < 1e-9, "{found} {expected}");
        }
        let by_hand = Plane { xx: 900.0, xy: 300.0, yy: 400.0 }.inverse().form([1.4, -0.4]);
        // with equal noise of all plots, the covariance of the acceleration is that of a plot times one
        // factor
        let factor = curve.0.covariance[(4, 4)] / 900.0;
        assert!((curve.significance() - by_hand / factor).abs() < 1e-9 * by_hand / factor);
        curve.advance(3.0);
        let line = curve.line();
        let [x, y] = at(3.0);
        for (found, expected) in line.mean.iter().zip([x, y, -20.0 + 1.4 * 3.0, 40.0 - 0.4 * 3.0]) {
            assert!((found - expected).abs() < 1e-9, "{found} {expected}");
        }
    }
}
