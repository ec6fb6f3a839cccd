//! Covariance where the linear one fails: how far along its longest axis the measurements allow the
//! position to be.
//!
//! The linear covariance is that of the tangent plane at the minimum. If an error is not small compared
//! with the distances, the cost along the ridge grows less than the parabola predicts, and beyond some
//! distance not at all if the target may be at infinity (profile likelihood: Bates, Watts 1988). The
//! 95 % ellipse is to extend to the points where the cost has grown as much as it does at the 95 %
//! ellipse of a parabola, by half the quantile of χ², on both sides of each axis.

use super::growth::LIMIT;
use crate::base::small::{Factor, Matrix, Vector, add_outer, dot, longest, norm};
use crate::location::descent::Loss;
use crate::location::descent::minimum::Minimum;
use crate::location::search::{Search, position};

/// Standard deviations above this fraction of the distance to the nearest station are not small: the
/// linear covariance is 3 % too small at 0.14, and right at 0.06.
const SMALL: f64 = 0.08;
/// Points beyond this multiple of the extent of the problem count as infinitely distant.
const INFINITY: f64 = 1e3;
/// Number of steps back to the ridge.
const RELAXATIONS: usize = 3;
/// Number of halvings of the interval that contains the distance.
const HALVINGS: usize = 12;
/// Weight of the axis in the normal matrix, which keeps steps perpendicular to the axis.
const STIFF: f64 = 1e4;

impl<const D: usize, const N: usize> Search<'_, D, N> {
    /// Returns the covariance of a minimum with curvature taken into account, or `None` if the
    /// curvature is negligible. Costs are in units of `unit`. O(M) without curvature.
    ///
    /// # Errors
    /// If the 95 % ellipse is unbounded.
    pub fn curved(
        &self,
        minimum: &Minimum<N>,
        covariance: &Matrix<D>,
        unit: f64,
    ) -> Result<Option<Matrix<D>>, Unbounded> {
        let p: Vector<D> = position(&minimum.state);
        let square = |station: &Vector<D>| (0..D).map(|i| (p[i] - station[i]).powi(2)).sum::<f64>();
        let stations = self.problem.measurements.iter().map(|m| square(&m.station));
        let nearest = stations.fold(f64::INFINITY, f64::min).sqrt();
        let mut rest = *covariance;
        let mut found = *covariance;
        let mut curved = false;
        for _ in 0..D {
            let trace: f64 = (0..D).map(|i| rest[i][i]).sum();
            if trace.sqrt() <= SMALL * nearest {
                break;
            }
            let (axis, variance) = longest(&rest);
            let sigma = variance.sqrt();
            // also stops for nan and infinity
            if !(sigma > SMALL * nearest && sigma < f64::INFINITY) {
                break;
            }
            let mut reach = 0.0_f64;
            for sign in [1.0, -1.0] {
                let axis = axis.map(|v| sign * v);
                reach = reach.max(self.reach(minimum, &axis, sigma, unit).ok_or(Unbounded)?);
            }
            let more = (reach * reach / LIMIT[D - 2] - variance).max(0.0);
            add_outer(&mut found, more, &axis);
            add_outer(&mut rest, -variance, &axis);
            curved = true;
        }
        Ok(curved.then_some(found))
    }

    /// Returns the distance along an axis to the end of the 95 % region; `None` if it has no end.
    fn reach(&self, minimum: &Minimum<N>, axis: &Vector<D>, sigma: f64, unit: f64) -> Option<f64> {
        let goal = minimum.normal.cost + 0.5 * LIMIT[D - 2] * unit;
        let limit = INFINITY * (self.problem.extent + norm(&position::<D, N>(&minimum.state)));
        let (mut near, mut far) = (0.0, LIMIT[D - 2].sqrt() * sigma);
        let mut ridge = minimum.state;
        // the emission is free: it follows the position
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

    /// Returns the point of lowest cost near `from`, on steps perpendicular to an axis, and its cost.
    fn relaxed(&self, from: Vector<N>, axis: &Vector<N>, scale: f64) -> (Vector<N>, f64) {
        let loss: Loss = self.loss;
        let mut p = from;
        let mut normal = self.problem.normal(&p, loss, scale);
        for _ in 0..RELAXATIONS {
            let trace: f64 = (0..N).map(|i| normal.matrix[i][i]).sum();
            let mut matrix = normal.matrix;
            add_outer(&mut matrix, STIFF * trace, axis);
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

/// Error: the measurements do not bound the position in some direction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::location) struct Unbounded;
