//! Gauss–Newton and Newton steps on weighted, whitened residuals, with Levenberg damping.

pub(super) mod block;
mod costs;
pub(super) mod doubt;
pub(super) mod lane;
mod lanes;
pub(super) mod minimum;
pub(super) mod starts;

use crate::base::small::{Factor, Matrix, Vector, add_multiple, norm, quadratic};
use crate::sensors::{Kind, Measurement, Row};
use doubt::EVIDENCE;

/// Least squares end when a step is shorter than this, in standard deviations.
pub(super) const TOLERANCE: f64 = 1e-9;
/// Number of robust steps with Huber's loss, which only lead to the vicinity of Tukey's minimum.
pub(super) const HUBER_STEPS: usize = 8;
pub(super) const TUKEY_TOLERANCE: f64 = 1e-7;
/// Share of the extent within which a point counts as being at a station.
pub(super) const NEAR: f64 = 1e-9;
/// Huber's and Tukey's constants for an efficiency of 95 % with normal noise.
pub(super) const HUBER: f64 = 1.345;
pub(super) const TUKEY: f64 = 4.685;
/// Faults are evenly spread over this many σ if they are on one side, and over twice as many if they
/// may be late or early.
pub(super) const FLAT: f64 = 50.0;
/// `ε √(2π)/((1 − ε) s)` for a share ε = 1 % of faults, spread over s = 50 σ.
const ONE_SIDE: f64 = 5.063_9e-4;
/// With multipath, early faults are rarer than late ones by this factor.
const RARELY_EARLY: f64 = 20.0;
/// Damping after the first failure of a step.
const FIRST_DAMPING: f64 = 1e-3;
/// Factor by which the damping grows.
const GROWTH: f64 = 10.0;
const LARGEST_DAMPING: f64 = 1e12;
/// Shares of the weighted matrix that are added to the matrix of Newton's steps, tried in this order.
/// If the cost hardly curves, or curves downward, steps with the weighted matrix alone are so short
/// that it takes a hundred to cross a saddle.
const NEWTON: [f64; 3] = [0.0, 0.1, 0.4];
/// Relative increase of the cost that may be due to rounding.
pub(super) const ROUNDING: f64 = 1e-12;
/// Rounding error of a distance, relative to the size of the geometry.
const ROUNDING_OF_DISTANCES: f64 = 16.0 * f64::EPSILON;
/// Distance, in extents of the problem, beyond which a descent counts as diverged.
pub(super) const FAR: f64 = 1e6;

/// Frequency of outliers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Outliers {
    /// Density of outliers in units of the default, which is one outlier in a hundred measurements with
    /// sizes spread over [`FLAT`].
    pub odds: f64,
    /// Share of too long ranges among the ranges that are outliers.
    pub late: f64,
}

impl Outliers {
    /// Default, if nothing is known about the outliers.
    pub const FEW: Self = Self { odds: 1.0, late: 0.5 };
}

/// Loss of the residuals of an instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Loss {
    /// The same cost for all kinds.
    Alike(Cost),
    /// A mixture of noise and faults, with odds of faults for arrivals, ranges and other kinds.
    Mixture { arrivals: Faults, ranges: Faults, others: Faults },
}

/// Cost of a residual.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Cost {
    /// `u²/2`.
    Square,
    /// `u²/2` up to c, linear beyond.
    Huber(f64),
    /// `c²/6 (1 − (1 − (u/c)²)³)` up to c, constant beyond.
    Tukey(f64),
    /// `−ln (e^(−u²/2) + κ)/(1 + κ)`: the likelihood of normal noise and faults of any size.
    Mixture(Faults),
}

/// κ of measurements that are late (too long) and early (too short).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Faults {
    pub late: f64,
    pub early: f64,
}

impl Cost {
    /// Returns weight `ψ(u)/u`, cost `ρ(u)` and `ψ'(u)`.
    #[inline]
    pub fn at(self, u: f64) -> (f64, f64, f64) {
        match self {
            Self::Square => (1.0, 0.5 * u * u, 1.0),
            Self::Huber(c) if u.abs() <= c => (1.0, 0.5 * u * u, 1.0),
            // ψ' is 0; with the weight in its place, steps are shorter and never fail
            Self::Huber(c) => (c / u.abs(), c * (u.abs() - 0.5 * c), c / u.abs()),
            Self::Tukey(c) => {
                let q = (u / c).powi(2);
                let rest = if q < 1.0 { 1.0 - q } else { 0.0 };
                let cost = c * c / 6.0 * (1.0 - rest * rest * rest);
                (rest * rest, cost, rest * (1.0 - 5.0 * q))
            }
            Self::Mixture(faults) => {
                let faults = faults.of(u);
                let normal = (-0.5 * u * u).exp();
                let total = normal + faults;
                let weight = normal / total;
                let cost = -(total / (1.0 + faults)).ln();
                (weight, cost, weight * (1.0 - (1.0 - weight) * u * u))
            }
        }
    }

    /// Returns `−ln` of the odds of a fault for a residual of this sign close to zero.
    pub fn evidence(self, u: f64) -> f64 {
        match self {
            Self::Mixture(faults) => -faults.of(u).ln(),
            _ => EVIDENCE,
        }
    }

    /// Whether a residual is that of a fault.
    pub fn is_fault(self, u: f64) -> bool {
        match self {
            Self::Mixture(_) => 0.5 * u * u >= self.evidence(u),
            Self::Tukey(c) => u.abs() >= c,
            _ => false,
        }
    }

    /// Returns the size from which on a residual of this sign is that of a fault.
    pub fn limit(self, u: f64) -> f64 {
        match self {
            Self::Mixture(_) => (2.0 * self.evidence(u)).sqrt(),
            Self::Tukey(c) => c,
            _ => f64::INFINITY,
        }
    }
}

impl Faults {
    /// Faults with `odds` times the default density, of which the share `late` is late.
    fn new(odds: f64, late: f64) -> Self {
        Self { late: odds * late * ONE_SIDE, early: odds * (1.0 - late) * ONE_SIDE }
    }

    fn of(self, u: f64) -> f64 {
        if u > 0.0 { self.late } else { self.early }
    }
}

impl Loss {
    pub const SQUARE: Self = Self::Alike(Cost::Square);

    /// Returns the loss for arrivals, whose outliers are mostly late with `multipath`.
    pub fn of_arrivals(multipath: bool, odds: f64) -> Self {
        let arrivals = match multipath {
            true => Faults { late: odds * ONE_SIDE, early: odds * ONE_SIDE / RARELY_EARLY },
            false => Faults::new(odds, 0.5),
        };
        let others = Faults::new(1.0, 0.5);
        Self::Mixture { arrivals, ranges: others, others }
    }

    /// Returns the loss for other measurements with `odds` times the default density of faults; the
    /// share `late` of the faulty ranges is too long.
    pub fn of_many(odds: f64, late: f64) -> Self {
        let others = Faults::new(odds, 0.5);
        Self::Mixture { arrivals: others, ranges: Faults::new(odds, late), others }
    }

    /// Whether more outliers are expected than by default.
    pub fn expects_many(self) -> bool {
        const FEW: f64 = ONE_SIDE * (1.0 + 1.0 / RARELY_EARLY);
        matches!(self, Self::Mixture { arrivals, .. } if arrivals.late + arrivals.early > FEW)
    }

    /// Returns the smallest cost of a fault.
    pub fn of_fault(self) -> f64 {
        match self {
            Self::Mixture { ranges, others, .. } => -ranges.late.max(others.late).ln(),
            Self::Alike(_) => TUKEY * TUKEY / 6.0,
        }
    }

    /// Whether ψ' differs from the weights.
    pub fn is_curved(self) -> bool {
        matches!(self, Self::Mixture { .. } | Self::Alike(Cost::Tukey(_)))
    }

    /// Returns the cost of a kind of measurement.
    #[inline(always)]
    pub fn of(self, kind: Kind) -> Cost {
        match self {
            Self::Alike(cost) => cost,
            Self::Mixture { arrivals, .. } if kind == Kind::Arrival => Cost::Mixture(arrivals),
            Self::Mixture { ranges, .. } if kind == Kind::Range => Cost::Mixture(ranges),
            Self::Mixture { others, .. } => Cost::Mixture(others),
        }
    }
}

/// `J^T W J`, `J^T W r` and the cost at a position.
#[derive(Clone, Copy, Debug)]
pub(super) struct Normal<const D: usize> {
    pub matrix: Matrix<D>,
    /// `J^T W J` with ψ' in place of the weights.
    curvature: Matrix<D>,
    pub vector: Vector<D>,
    pub cost: f64,
}

impl<const D: usize> Normal<D> {
    /// Returns the normal equations at a minimum, from which no further step is taken.
    pub fn at_minimum(matrix: Matrix<D>, cost: f64) -> Self {
        Self { matrix, curvature: matrix, vector: [0.0; D], cost }
    }

    /// Returns the curvature matrix plus this share of the weighted matrix.
    fn mixed(&self, share: f64) -> Matrix<D> {
        let mut mixed = self.curvature;
        mixed.iter_mut().zip(&self.matrix).for_each(|(own, row)| add_multiple(own, share, row));
        mixed
    }
}

/// End of a descent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum End {
    /// The descent reached a minimum.
    Converged,
    /// The descent was still moving after the last step.
    Moving,
    /// The measurements do not determine the direction of a step.
    Singular,
    /// The descent went too far away.
    Diverged,
}

/// The measurements of an instant and the size of their geometry. A state is a position and, if there
/// are arrivals, their emission.
pub(super) struct Problem<'a, const D: usize, const N: usize> {
    pub measurements: &'a [Measurement<D>],
    pub extent: f64,
}

impl<const D: usize, const N: usize> Problem<'_, D, N> {
    /// Computes the normal equations. O(M).
    pub fn normal(&self, p: &Vector<N>, loss: Loss, scale: f64) -> Normal<N> {
        let zero = [[0.0; N]; N];
        let mut normal = Normal { matrix: zero, curvature: zero, vector: [0.0; N], cost: 0.0 };
        let reciprocal = 1.0 / scale;
        for measurement in self.measurements {
            let Row { residual: u, gradient } = measurement.row_at(p).scaled(reciprocal);
            let (weight, cost, curvature) = loss.of(measurement.kind).at(u);
            normal.cost += cost;
            if weight == 0.0 {
                continue;
            }
            for i in 0..N {
                normal.vector[i] += weight * u * gradient[i];
                for j in 0..=i {
                    let product = gradient[i] * gradient[j];
                    normal.matrix[i][j] += weight * product;
                    normal.curvature[i][j] += curvature * product;
                }
            }
        }
        for i in 0..N {
            for j in 0..i {
                normal.matrix[j][i] = normal.matrix[i][j];
                normal.curvature[j][i] = normal.curvature[i][j];
            }
        }
        normal
    }

    /// Computes the cost only. O(M).
    pub fn cost(&self, p: &Vector<N>, loss: Loss, scale: f64) -> f64 {
        let reciprocal = 1.0 / scale;
        let cost = |m: &Measurement<D>| loss.of(m.kind).at(m.row_at(p).residual * reciprocal).1;
        self.measurements.iter().map(cost).sum()
    }

    /// Descends until a step is shorter than `tolerance` standard deviations, or than the rounding errors of
    /// distances.
    ///
    /// The first choice is a Newton step with ψ'. If the cost curves downward or would increase, steps
    /// between this and the weighted (Gauss–Newton) step are tried, then the weighted step, then ever
    /// shorter ones with increasing damping.
    pub fn descend(
        &self,
        p: &mut Vector<N>,
        loss: Loss,
        scale: f64,
        steps: usize,
        tolerance: f64,
    ) -> (End, Normal<N>) {
        let mut normal = self.normal(p, loss, scale);
        let newton: &[f64] = if loss.is_curved() { &NEWTON } else { &[] };
        let mut damping = 0.0;
        for _ in 0..steps {
            let taken = newton.iter().find_map(|&share| {
                let factor = Factor::try_new(&normal.mixed(share), 0.0)?;
                self.step(p, &factor, &normal, loss, scale).ok()
            });
            let (trial, next, size) = match taken {
                Some(taken) => taken,
                None => loop {
                    if let Some(factor) = Factor::try_new(&normal.matrix, damping) {
                        match self.step(p, &factor, &normal, loss, scale) {
                            Ok(taken) => break taken,
                            // the remaining differences are due to rounding
                            Err(size) if size <= tolerance * tolerance => {
                                return (End::Converged, normal);
                            }
                            Err(_) => {}
                        }
                    }
                    damping = if damping == 0.0 { FIRST_DAMPING } else { damping * GROWTH };
                    if damping > LARGEST_DAMPING {
                        let regular = Factor::try_new(&normal.matrix, 0.0).is_some();
                        return (if regular { End::Converged } else { End::Singular }, normal);
                    }
                },
            };
            let is_rounding = self.is_rounding(p, &trial);
            (*p, normal) = (trial, next);
            damping = if damping <= FIRST_DAMPING { 0.0 } else { damping / GROWTH };
            if norm(p) > FAR * self.extent {
                return (End::Diverged, normal);
            }
            if is_rounding || size <= tolerance * tolerance {
                return (End::Converged, normal);
            }
        }
        (End::Moving, normal)
    }

    /// Whether a step from one position to another is due to rounding errors of distances: such a step may be
    /// many standard deviations long if the geometry is large compared with the sigmas.
    fn is_rounding(&self, from: &Vector<N>, to: &Vector<N>) -> bool {
        let step: Vector<N> = std::array::from_fn(|i| to[i] - from[i]);
        norm(&step) <= ROUNDING_OF_DISTANCES * (self.extent + norm(to))
    }

    /// Takes a step that does not increase the cost: returns the new state, the normal equations there,
    /// and the squared length of the step in standard deviations. Otherwise returns this squared length
    /// as an error.
    fn step(
        &self,
        p: &Vector<N>,
        factor: &Factor<N>,
        normal: &Normal<N>,
        loss: Loss,
        scale: f64,
    ) -> Result<(Vector<N>, Normal<N>, f64), f64> {
        let step = factor.solve(&normal.vector);
        let size = quadratic(&normal.matrix, &step);
        let trial = std::array::from_fn(|i| p[i] + step[i]);
        let next = self.normal(&trial, loss, scale);
        let down = next.cost <= normal.cost * (1.0 + ROUNDING) + f64::MIN_POSITIVE;
        if down { Ok((trial, next, size)) } else { Err(size) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;

    /// Satellites: the rounding errors of distances of 50,000 km are more than a billionth of these sigmas.
    #[test]
    fn rounding_does_not_keep_a_descent_moving() {
        let mut random = Random::new(1);
        let mut place = || -> Vector<3> { std::array::from_fn(|_| random.symmetric(2.6e7)) };
        for (sigma, loss) in [1.0, 1e-2, 1e-4].into_iter().flat_map(|sigma| {
            [Loss::SQUARE, Loss::Alike(Cost::Tukey(TUKEY))].map(|loss| (sigma, loss))
        }) {
            let target = place();
            let measurements: Vec<_> = (0..8)
                .map(|k| {
                    let station = if k == 0 { [0.0; 3] } else { place() };
                    let way: Vector<3> = std::array::from_fn(|i| target[i] - station[i]);
                    let error = sigma * f64::from(k % 3 - 1);
                    Measurement::new(Kind::Range, k as usize, station, norm(&way) + error, sigma)
                })
                .collect();
            let problem = Problem::<3, 3> { measurements: &measurements, extent: 5e7 };
            let mut p = target.map(|v| v + sigma);
            let (end, _) = problem.descend(&mut p, loss, 1.0, 50, TOLERANCE);
            assert_eq!(end, End::Converged, "{sigma} {loss:?}");
        }
    }
}
