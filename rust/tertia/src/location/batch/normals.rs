//! Error ellipses of a mixture of normal distributions about several positions.

use crate::base::distribution::chi_square_upper_real;
use crate::base::small::{Factor, Matrix, Vector, quadratic};
use crate::location::solver::growth::{LIMIT, OUTSIDE};

/// Logarithms of the smallest and of the largest growth.
const RANGE: (f64, f64) = (-5.0, 12.0);
const STEPS: usize = 60;
const TOLERANCE: f64 = 1e-9;

/// A normal distribution about a position, with its probability in the mixture.
pub(in crate::location) struct Normal<const D: usize> {
    pub weight: f64,
    pub position: Vector<D>,
    pub covariance: Matrix<D>,
}

/// Returns the factor of a covariance for which its 95 % ellipse about a position contains 95 % of the
/// mixture. For each term, the distribution of the squared distance from the position is approximated by
/// that of a multiple of χ² with the same mean and variance (Satterthwaite 1946). O(terms).
pub(in crate::location) fn growth<'a, const D: usize>(
    mixture: impl Iterator<Item = &'a Normal<D>>,
    position: &Vector<D>,
    covariance: &Matrix<D>,
) -> f64 {
    let Some(factor) = Factor::try_new(covariance, 0.0) else { return 1.0 };
    let inverse = factor.inverse();
    let terms: Vec<_> = mixture.map(|own| (own.weight, moments(own, position, &inverse))).collect();
    let outside = |growth: f64| -> f64 {
        let of = |&(weight, (mean, variance)): &(f64, (f64, f64))| {
            let freedom = 2.0 * mean * mean / variance;
            weight * chi_square_upper_real(growth * LIMIT[D - 2] * freedom / mean, freedom)
        };
        terms.iter().map(of).sum()
    };
    zero(|growth| (outside(growth.exp()).max(f64::MIN_POSITIVE) / OUTSIDE).ln()).exp()
}

/// Returns the zero of a decreasing function, by the Illinois method (Dowell, Jarratt 1971).
fn zero(f: impl Fn(f64) -> f64) -> f64 {
    let (mut low, mut high) = RANGE;
    let (mut above, mut below) = (f(low), f(high));
    for _ in 0..STEPS {
        let middle = (low * below - high * above) / (below - above);
        if high - low < TOLERANCE || !middle.is_finite() {
            break;
        }
        let value = f(middle);
        if value > 0.0 {
            (low, above, below) = (middle, value, 0.5 * below);
        } else {
            (high, below, above) = (middle, value, 0.5 * above);
        }
        if value.abs() < TOLERANCE {
            return middle;
        }
    }
    0.5 * (low + high)
}

/// Returns the mean and variance of the squared distance between the target and a position, normalised with
/// this inverse covariance.
fn moments<const D: usize>(
    own: &Normal<D>,
    position: &Vector<D>,
    inverse: &Matrix<D>,
) -> (f64, f64) {
    let product: Matrix<D> = std::array::from_fn(|i| {
        std::array::from_fn(|j| (0..D).map(|k| inverse[i][k] * own.covariance[k][j]).sum())
    });
    let shift: Vector<D> = std::array::from_fn(|i| own.position[i] - position[i]);
    let pulled: Vector<D> = std::array::from_fn(|i| (0..D).map(|k| inverse[i][k] * shift[k]).sum());
    let trace: f64 = (0..D).map(|i| product[i][i]).sum();
    let square: f64 =
        (0..D).map(|i| (0..D).map(|j| product[i][j] * product[j][i]).sum::<f64>()).sum();
    let mean = trace + quadratic(inverse, &shift);
    (mean, 2.0 * square + 4.0 * quadratic(&own.covariance, &pulled))
}
