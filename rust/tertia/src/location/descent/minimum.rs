//! A minimum of the cost, and the points that belong to it.

use super::block::Arrival;
use super::doubt::SAFETY;
use super::{End, Normal};
use crate::base::small::{Matrix, Vector, quadratic};

/// Points within this squared distance of a minimum, in squared sigmas, belong to it.
pub(in crate::location) const SAME_MINIMUM: f64 = 25.0;
/// A point on the slope of a minimum costs more than it by at least this share of its squared distance, in
/// sigmas. For a parabola the share would be a half.
pub(in crate::location) const SLOPE: f64 = 0.25;

/// A minimum of the cost.
#[derive(Clone, Copy, Debug)]
pub(in crate::location) struct Minimum<const N: usize> {
    pub state: Vector<N>,
    pub normal: Normal<N>,
    pub end: End,
    pub scale: f64,
    /// If outliers are frequent: covariance from other minima that are too unlikely to be ambiguous.
    pub others: Matrix<N>,
}

impl<const N: usize> Minimum<N> {
    pub fn of(arrival: Arrival<N>) -> Self {
        let Arrival { state, matrix, cost } = arrival;
        let normal = Normal::at_minimum(matrix, cost);
        Self { state, normal, end: End::Converged, scale: 1.0, others: [[0.0; N]; N] }
    }

    /// Adds the spread of other minima, given with their costs, as for doubtful measurements; `least` is
    /// the cost of this one.
    pub fn allow_for<'a>(
        &mut self,
        minima: impl Iterator<Item = &'a (Vector<N>, f64)>,
        least: f64,
    ) {
        for (state, cost) in minima {
            let spread = SAFETY * (least - cost).exp();
            for i in 0..N {
                for j in 0..N {
                    let product = (state[i] - self.state[i]) * (state[j] - self.state[j]);
                    self.others[i][j] += spread * product;
                }
            }
        }
    }

    /// Whether a point is within the error of this minimum.
    pub fn is_same(&self, point: &Vector<N>) -> bool {
        let difference = std::array::from_fn(|i| point[i] - self.state[i]);
        quadratic(&self.normal.matrix, &difference) <= SAME_MINIMUM
    }

    /// Whether a point with this cost is on the slope of this minimum.
    pub fn is_below(&self, point: &Vector<N>, cost: f64) -> bool {
        let difference = std::array::from_fn(|i| point[i] - self.state[i]);
        let square = quadratic(&self.normal.matrix, &difference);
        square <= SAME_MINIMUM.max((cost - self.normal.cost) / SLOPE)
    }
}
