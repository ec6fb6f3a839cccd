//! Where the linear covariance fails: how far along its longest axis the measurements allow.
//!
//! The covariance is that of the tangent plane at the minimum. Where an error is not small compared
//! with the distances, the cost along the ridge grows by less than the parabola says, and not at
//! all beyond some distance if the target may as well be at infinity (the profile likelihood of
//! Bates, Watts 1988). The ellipse of 95 % is to reach to where the cost has grown by what it grows
//! by at the ellipse of a parabola, half the quantile of χ², on both sides of each axis.

use super::descent::Loss;
use super::growth::LIMIT;
use super::search::{Minimum, Search, position};
use crate::base::small::{Factor, Matrix, Vector, add, dot, longest, norm};

/// A standard deviation of this share of the distance to the nearest station is not small: the
/// linear covariance is 3 % too small at .14, and right at .06.
const SMALL: f64 = 0.08;
/// What is so many extents of the problem away is at infinity.
const INFINITY: f64 = 1e3;
/// Steps back to the ridge, and halvings of the distance.
const RELAXATIONS: usize = 3;
const HALVINGS: usize = 12;
/// Weight of the axis in steps that must not follow it.
const STIFF: f64 = 1e4;

impl<const D: usize, const N: usize> Search<'_, D, N> {
    /// The covariance of a minimum where it is curved, none where it is nearly not; an error where
    /// the ellipse of 95 % has no end; costs are in `unit`. O(M) where it is not curved.
    pub fn curved(
        &self,
        minimum: &Minimum<N>,
        covariance: &Matrix<D>,
        unit: f64,
    ) -> Result<Option<Matrix<D>>, Unbounded> {
        let p: Vector<D> = position(&minimum.state);
        let distance = |station: &Vector<D>| norm::<D>(&std::array::from_fn(|i| p[i] - station[i]));
        let stations = self.problem.measurements.iter().map(|m| distance(&m.station));
        let nearest = stations.fold(f64::INFINITY, f64::min);
        let mut rest = *covariance;
        let mut found = *covariance;
        let mut curved = false;
        for _ in 0..D {
            let (axis, variance) = longest(&rest);
            let sigma = variance.sqrt();
            // false for nan and infinity, too
            if !(sigma > SMALL * nearest && sigma < f64::INFINITY) {
                break;
            }
            let mut reach = 0.0_f64;
            for sign in [1.0, -1.0] {
                let axis = axis.map(|v| sign * v);
                reach = reach.max(self.reach(minimum, &axis, sigma, unit).ok_or(Unbounded)?);
            }
            let more = (reach * reach / LIMIT[D - 2] - variance).max(0.0);
            let outer = |by: f64| -> Matrix<D> {
                std::array::from_fn(|i| std::array::from_fn(|j| by * axis[i] * axis[j]))
            };
            add(&mut found, &outer(more));
            add(&mut rest, &outer(-variance));
            curved = true;
        }
        Ok(curved.then_some(found))
    }

    /// The distance along an axis to the end of the region of 95 %, if it has one.
    fn reach(&self, minimum: &Minimum<N>, axis: &Vector<D>, sigma: f64, unit: f64) -> Option<f64> {
        let goal = minimum.normal.cost + 0.5 * LIMIT[D - 2] * unit;
        let limit = INFINITY * (self.problem.extent + norm(&position::<D, N>(&minimum.state)));
        let (mut near, mut far) = (0.0, LIMIT[D - 2].sqrt() * sigma);
        let mut ridge = minimum.state;
        // the emission is where it fits
        let axis: Vector<N> = std::array::from_fn(|i| if i < D { axis[i] } else { 0.0 });
        loop {
            let from = std::array::from_fn(|i| ridge[i] + (far - near) * axis[i]);
            let (point, cost) = self.relaxed(from, &axis, minimum.scale);
            if cost.is_nan() || cost >= goal {
                break;
            }
            if far > limit {
                return None;
            }
            (near, ridge) = (far, point);
            far *= 2.0;
        }
        let (mut low, mut high) = (near, far);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            let from = std::array::from_fn(|i| ridge[i] + (middle - near) * axis[i]);
            let (_, cost) = self.relaxed(from, &axis, minimum.scale);
            if cost < goal { low = middle } else { high = middle }
        }
        Some(high)
    }

    /// The lowest point near another one, across an axis, and its cost.
    fn relaxed(&self, from: Vector<N>, axis: &Vector<N>, scale: f64) -> (Vector<N>, f64) {
        let loss: Loss = self.loss;
        let mut p = from;
        let mut normal = self.problem.normal(&p, loss, scale);
        for _ in 0..RELAXATIONS {
            let trace: f64 = (0..N).map(|i| normal.matrix[i][i]).sum();
            let mut matrix = normal.matrix;
            for i in 0..N {
                for j in 0..N {
                    matrix[i][j] += STIFF * trace * axis[i] * axis[j];
                }
            }
            let along = dot(&normal.vector, axis);
            let across = std::array::from_fn(|i| normal.vector[i] - along * axis[i]);
            let Some(factor) = Factor::try_new(&matrix, 0.0) else { break };
            let step = factor.solve(&across);
            let trial = std::array::from_fn(|i| p[i] + step[i]);
            let next = self.problem.normal(&trial, loss, scale);
            if next.cost >= normal.cost {
                break;
            }
            (p, normal) = (trial, next);
        }
        (p, normal.cost)
    }
}

/// The measurements do not bound the position in some direction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Unbounded;
