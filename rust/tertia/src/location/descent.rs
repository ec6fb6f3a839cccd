//! Gauss–Newton on weighted, whitened residuals, with Levenberg's safeguard.

use super::doubt::EVIDENCE;
use crate::base::small::{Factor, Matrix, Vector, norm, quadratic};
use crate::sensors::{Kind, Measurement, Row};

/// Least squares end where a step is shorter than so many standard deviations.
pub(super) const TOLERANCE: f64 = 1e-9;
/// Robust steps: Huber's only lead to Tukey's.
pub(super) const HUBER_STEPS: usize = 8;
pub(super) const TUKEY_TOLERANCE: f64 = 1e-7;
/// A point is at a station below this share of the extent.
pub(super) const NEAR: f64 = 1e-9;
/// Huber's and Tukey's constants for an efficiency of 95 % with normal noise.
pub(super) const HUBER: f64 = 1.345;
pub(super) const TUKEY: f64 = 4.685;
/// Faults are spread evenly over so many σ, or where they are late or early over twice as many.
pub(super) const FLAT: f64 = 50.0;
/// `ε √(2π)/((1 − ε) s)`: a share ε = 1 % of faults, spread over s = 50 σ.
const ONE_SIDE: f64 = 5.063_9e-4;
/// Of twenty faults by multipath and other causes one is early.
const RARELY_EARLY: f64 = 20.0;
/// Damping where a step fails for the first time, what it grows by, and the largest.
const FIRST_DAMPING: f64 = 1e-3;
const GROWTH: f64 = 10.0;
const LARGEST_DAMPING: f64 = 1e12;
/// What of the matrix with weights is added to that of Newton's steps. Where the cost hardly
/// curves, or curves down, steps with weights alone creep: a hundred of them cross a saddle.
const NEWTON: [f64; 3] = [0.0, 0.1, 0.4];
/// An increase of the cost that may be rounding.
pub(super) const ROUNDING: f64 = 1e-12;
/// Farther than so many extents of the problem nothing converges any more.
pub(super) const FAR: f64 = 1e6;

/// How frequent outliers are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Outliers {
    /// Odds of one, in units of those of one in a hundred that are spread as far as where nothing
    /// tells.
    pub odds: f64,
    /// Share of those among ranges that are too long.
    pub late: f64,
}

impl Outliers {
    /// Where nothing tells.
    pub const FEW: Self = Self { odds: 1.0, late: 0.5 };
}

/// What the residuals of an instant cost.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Loss {
    /// Of all kinds alike.
    Alike(Cost),
    /// A mixture of noise and faults, with odds of faults for arrivals, ranges and other kinds.
    Mixture { arrivals: Faults, ranges: Faults, others: Faults },
}

/// What a residual costs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Cost {
    /// `u²/2`
    Square,
    /// `u²/2` up to c, linear beyond.
    Huber(f64),
    /// `c²/6 (1 − (1 − (u/c)²)³)` up to c, constant beyond.
    Tukey(f64),
    /// `−ln (e^(−u²/2) + κ)/(1 + κ)`: the likelihood of normal noise and faults of any size.
    Mixture(Faults),
}

/// κ of late measurements and of early ones.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Faults {
    pub late: f64,
    pub early: f64,
}

impl Cost {
    /// Weight `ψ(u)/u`, cost `ρ(u)` and `ψ'(u)`.
    #[inline]
    pub fn at(self, u: f64) -> (f64, f64, f64) {
        match self {
            Self::Square => (1.0, 0.5 * u * u, 1.0),
            Self::Huber(c) if u.abs() <= c => (1.0, 0.5 * u * u, 1.0),
            // as if it were its own weight: steps are shorter, and never fail
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

    /// `−ln` of the odds of a fault that has this sign and hardly any size.
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

    /// The size from which on a residual of this sign is that of a fault.
    pub fn limit(self, u: f64) -> f64 {
        match self {
            Self::Mixture(_) => (2.0 * self.evidence(u)).sqrt(),
            Self::Tukey(c) => c,
            _ => f64::INFINITY,
        }
    }
}

impl Faults {
    /// Of so many times the odds of one in a hundred, of which this share is late.
    fn new(odds: f64, late: f64) -> Self {
        Self { late: odds * late * ONE_SIDE, early: odds * (1.0 - late) * ONE_SIDE }
    }

    fn of(self, u: f64) -> f64 {
        if u > 0.0 { self.late } else { self.early }
    }
}

impl Loss {
    pub const SQUARE: Self = Self::Alike(Cost::Square);

    /// Of arrivals, outliers of which are late if they come by detours.
    pub fn of_arrivals(multipath: bool, odds: f64) -> Self {
        let arrivals = match multipath {
            true => Faults { late: odds * ONE_SIDE, early: odds * ONE_SIDE / RARELY_EARLY },
            false => Faults::new(odds, 0.5),
        };
        let others = Faults::new(1.0, 0.5);
        Self::Mixture { arrivals, ranges: others, others }
    }

    /// Of other measurements with so many times the odds of one fault in a hundred; this share of
    /// the faulty ranges is too long.
    pub fn of_many(odds: f64, late: f64) -> Self {
        let others = Faults::new(odds, 0.5);
        Self::Mixture { arrivals: others, ranges: Faults::new(odds, late), others }
    }

    /// Whether measurements are wrong more often than where nothing tells.
    pub fn expects_many(self) -> bool {
        const FEW: f64 = ONE_SIDE * (1.0 + 1.0 / RARELY_EARLY);
        matches!(self, Self::Mixture { arrivals, .. } if arrivals.late + arrivals.early > FEW)
    }

    /// What a fault costs at least.
    pub fn of_fault(self) -> f64 {
        match self {
            Self::Mixture { ranges, others, .. } => -ranges.late.max(others.late).ln(),
            Self::Alike(_) => TUKEY * TUKEY / 6.0,
        }
    }

    /// Whether weights are not ψ'.
    pub fn is_curved(self) -> bool {
        matches!(self, Self::Mixture { .. } | Self::Alike(Cost::Tukey(_)))
    }

    /// That of a kind.
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
    /// The same with ψ' in place of the weights.
    curvature: Matrix<D>,
    pub vector: Vector<D>,
    pub cost: f64,
}

impl<const D: usize> Normal<D> {
    /// At a minimum, from where nothing goes on.
    pub fn at_minimum(matrix: Matrix<D>, cost: f64) -> Self {
        Self { matrix, curvature: matrix, vector: [0.0; D], cost }
    }

    /// The curvature, with so much of the matrix of the weights.
    fn mixed(&self, share: f64) -> Matrix<D> {
        let mut mixed = self.curvature;
        for i in 0..D {
            for j in 0..D {
                mixed[i][j] += share * self.matrix[i][j];
            }
        }
        mixed
    }
}

/// How a descent ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum End {
    /// At a minimum.
    Converged,
    /// After all its steps.
    Moving,
    /// Where the measurements do not tell in which direction to go.
    Singular,
    /// Far away.
    Diverged,
}

/// The measurements of an instant and the size of their geometry; the state is a position, and of
/// arrivals also their emission.
pub(super) struct Problem<'a, const D: usize, const N: usize> {
    pub measurements: &'a [Measurement<D>],
    pub extent: f64,
}

impl<const D: usize, const N: usize> Problem<'_, D, N> {
    /// The normal equations. O(M).
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

    /// The cost alone. O(M).
    pub fn cost(&self, p: &Vector<N>, loss: Loss, scale: f64) -> f64 {
        let reciprocal = 1.0 / scale;
        let cost = |m: &Measurement<D>| loss.of(m.kind).at(m.row_at(p).residual * reciprocal).1;
        self.measurements.iter().map(cost).sum()
    }

    /// Goes downhill until a step is shorter than `tolerance` standard deviations.
    ///
    /// A step is Newton's with ψ', or one between it and that with weights where the cost curves
    /// down or would grow; then that with weights, then shorter ones of that.
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
                            // what is left is rounding
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
            (*p, normal) = (trial, next);
            damping = if damping <= FIRST_DAMPING { 0.0 } else { damping / GROWTH };
            if norm(p) > FAR * self.extent {
                return (End::Diverged, normal);
            }
            if size <= tolerance * tolerance {
                return (End::Converged, normal);
            }
        }
        (End::Moving, normal)
    }

    /// A step that does not go uphill: where it leads, the normal equations there, and its square
    /// in standard deviations. Otherwise that square alone.
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
