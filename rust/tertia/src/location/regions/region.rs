//! The region around a position that contains the target with a given probability.
//!
//! If the errors are small compared with the distances, the region is an ellipse: `d^T C^-1 d ≤ c`,
//! with `c` from the chi-square distribution, or from Fisher's distribution if σ is estimated.
//! Otherwise it is bounded by a contour of the likelihood, which also follows a curved region, whereas
//! the linear covariance does not.

use super::contour::{Frame, Outline, Part, bearing, outline, principal};
use super::radial::Radial;
use crate::base::distribution::{chi_square_upper_quantile, fisher_upper_quantile};
use crate::base::small::{Factor, Matrix, Vector, add_multiple, add_outer, quadratic};
use crate::location::search::fix::Instant;
use crate::location::solver::record::{NOWHERE, Record};
use crate::sensors::{KINDS, Kind, Measurement, Row};
use std::f64::consts::TAU;

/// Number of corners of the polygon that represents an ellipse.
const CORNERS: usize = 180;
/// Number of points on the ellipse at which the likelihood is compared with a normal one.
const PLACES: usize = 16;
/// Largest relative difference at these points up to which the region counts as an ellipse.
const STRAIGHT: f64 = 0.1;
/// The frame of a contour is larger than the ellipse by this factor; where it cuts the contour, it
/// grows by [`GROWTH`], at most [`GROWN`] times.
const MARGIN: f64 = 1.25;
const GROWTH: f64 = 1.6;
const GROWN: usize = 12;

/// A position and the measurements from which it was estimated.
#[derive(Clone, Copy, Debug)]
pub struct Located<'a> {
    /// The measurements.
    pub instant: Instant<'a>,
    /// Correlation of the errors of range differences.
    pub correlation: f64,
    /// Marks of measurements that were left out.
    pub outlier: &'a [bool],
    /// The position, D numbers.
    pub position: &'a [f64],
}

impl Located<'_> {
    /// Whether the emission is an additional unknown.
    pub(in crate::location) fn is_timed(&self) -> bool {
        let count = self.instant.values.len() / KINDS;
        let any = |kind: Kind| {
            let at = kind as usize * count;
            self.instant.values[at..at + count].iter().any(|v| !v.is_nan())
        };
        any(Kind::Arrival)
            || any(Kind::RangeDifference) && self.instant.common(self.correlation).is_some()
    }

    /// Returns the position relative to the first station.
    pub(in crate::location) fn offset<const D: usize>(&self) -> Vector<D> {
        std::array::from_fn(|i| self.position[i] - self.instant.stations[i])
    }

    /// Returns the measurements that were not left out, and the number of those that were.
    pub(in crate::location) fn kept<const D: usize, const N: usize>(
        &self,
    ) -> (Vec<Measurement<D>>, usize) {
        let mut record = Record::<D, N>::default();
        record.read(&self.instant, self.correlation);
        if record.is_blurred(&self.instant) {
            record.blur(&self.instant, &self.offset());
        }
        let all = record.measurements.len();
        let marked = record.measurements.into_iter().zip(record.places);
        let kept: Vec<_> = marked
            .filter(|&(_, place)| place == NOWHERE || !self.outlier[place])
            .map(|(m, _)| m)
            .collect();
        let excluded = all - kept.len();
        (kept, excluded)
    }
}

/// Size of the error of a position.
#[derive(Clone, Copy, Debug)]
pub struct Spread<'a> {
    /// Covariance of the position, D² numbers.
    pub covariance: &'a [f64],
    /// Standard deviation of a measurement if it was estimated, 1 if it is known.
    pub sigma: f64,
    /// Degrees of freedom of this estimate; infinite if σ is known.
    pub freedom: f64,
}

impl Spread<'_> {
    /// Returns the region, seen from above, that contains the target with this probability. O(CORNERS)
    /// for an ellipse, otherwise O(cells · M).
    pub fn region(&self, located: &Located<'_>, probability: f64) -> Outline {
        let nothing = Outline::empty();
        let matrix = self.horizontal();
        if !matrix.iter().all(|v| v.is_finite()) || !located.position[0].is_finite() {
            return nothing;
        }
        let [a, b, c] = matrix;
        let (large, small, angle) = principal(matrix);
        if small.is_nan() || small <= 0.0 {
            return nothing;
        }
        let level = self.level(probability);
        let (sine, cosine) = angle.sin_cos();
        let half = [large, small].map(|v| (level * v).sqrt());
        let on_ellipse = |t: f64| {
            let (s, c) = t.sin_cos();
            let [x, y] = [half[0] * c, half[1] * s];
            [x * cosine - y * sine, x * sine + y * cosine]
        };
        if located.position.len() == 2
            && level.is_finite()
            && let Some(likelihood) = Likelihood::new(located, self.sigma, [[a, b], [b, c]])
            && !likelihood.is_straight(on_ellipse)
        {
            let frame = Frame { centre: [0.0; 2], cosine, sine, half };
            return likelihood.outline(level, frame, located);
        }
        // the polygon has the area of the ellipse
        let corner = TAU / CORNERS as f64;
        let scale = (corner / corner.sin()).sqrt();
        let ring = (0..CORNERS).map(|i| {
            let (s, c) = (i as f64 * corner).sin_cos();
            let [x, y] = [half[0] * c * scale, half[1] * s * scale];
            [
                located.position[0] + x * cosine - y * sine,
                located.position[1] + x * sine + y * cosine,
            ]
        });
        Outline {
            rings: vec![ring.collect()],
            area: 0.5 * TAU * half[0] * half[1],
            semi_major: half[0],
            semi_minor: half[1],
            orientation: bearing(angle),
        }
    }

    /// Returns the radius of the circle about the position that contains the target, seen from above,
    /// with this probability, for normal errors.
    pub fn radius(&self, probability: f64) -> f64 {
        let radial = Radial::try_new(self.horizontal(), self.freedom);
        radial.map_or(f64::NAN, |radial| radial.quantile(1.0 - probability))
    }

    fn horizontal(&self) -> [f64; 3] {
        let d = self.covariance.len().isqrt();
        [self.covariance[0], self.covariance[1], self.covariance[d + 1]]
    }

    /// Returns the limit c of the ellipse.
    fn level(&self, probability: f64) -> f64 {
        if self.freedom.is_finite() {
            2.0 * fisher_upper_quantile(1.0 - probability, 2.0, self.freedom)
        } else {
            chi_square_upper_quantile(1.0 - probability, 2)
        }
    }
}

/// The likelihood around a position in the plane, maximised over the emission.
struct Likelihood {
    measurements: Vec<Measurement<2>>,
    p: Vector<2>,
    /// `J^T r`, `J^T J` and the sum of squares at the position; `slope` is twice `J^T r`.
    slope: Vector<2>,
    matrix: Matrix<2>,
    cost: f64,
    covariance: Matrix<2>,
}

impl Likelihood {
    fn new(located: &Located<'_>, sigma: f64, covariance: Matrix<2>) -> Option<Self> {
        let (mut measurements, _) =
            if located.is_timed() { located.kept::<2, 3>() } else { located.kept::<2, 2>() };
        measurements.iter_mut().for_each(|m| m.precision /= sigma);
        let (p, zero) = (located.offset(), [[0.0; 2]; 2]);
        let mut own =
            Self { measurements, p, slope: [0.0; 2], matrix: zero, cost: 0.0, covariance };
        let mut emission = Emission::default();
        for m in &own.measurements {
            let Row { residual, gradient } = m.row(&p);
            emission.add(m, residual, gradient);
            own.cost += residual * residual;
            add_multiple(&mut own.slope, 2.0 * residual, &gradient);
            add_outer(&mut own.matrix, 1.0, &gradient);
        }
        own.cost -= emission.share(emission.residual, emission.residual);
        for i in 0..2 {
            own.slope[i] -= 2.0 * emission.share(emission.residual, emission.gradient[i]);
            for j in 0..2 {
                own.matrix[i][j] -= emission.share(emission.gradient[i], emission.gradient[j]);
            }
        }
        Factor::try_new(&own.matrix, 0.0).is_some().then_some(own)
    }

    /// Returns minus twice the logarithm of the likelihood ratio at an offset from the position.
    fn ratio(&self, d: [f64; 2]) -> f64 {
        let p: Vector<2> = std::array::from_fn(|i| self.p[i] + d[i]);
        let (mut cost, mut emission) = (0.0, Emission::default());
        for m in &self.measurements {
            let Row { residual, gradient } = m.row(&p);
            emission.add(m, residual, gradient);
            cost += residual * residual;
        }
        cost -= emission.share(emission.residual, emission.residual);
        // the sum of squares has a slope at a robust position, which is removed here
        cost - self.cost + self.slope[0] * d[0] + self.slope[1] * d[1]
    }

    /// Returns the factor by which C is larger than `(J^T J)^-1` in the direction where it is smallest.
    /// It contains what was added to C because sigmas contradict each other, but not what was added
    /// because of the curvature.
    fn growth(&self) -> f64 {
        let product = |i: usize, j: usize| {
            (0..2).map(|k| self.covariance[i][k] * self.matrix[k][j]).sum::<f64>()
        };
        let mean = 0.5 * (product(0, 0) + product(1, 1));
        let determinant = product(0, 0) * product(1, 1) - product(0, 1) * product(1, 0);
        mean - (mean * mean - determinant).max(0.0).sqrt()
    }

    fn is_straight(&self, ellipse: impl Fn(f64) -> [f64; 2]) -> bool {
        (0..PLACES).all(|i| {
            let d = ellipse(i as f64 * TAU / PLACES as f64);
            let straight = quadratic(&self.matrix, &d);
            (self.ratio(d) - straight).abs() <= STRAIGHT * straight
        })
    }

    /// Returns the part of the contour around the position, in a frame that grows until it contains it.
    fn outline(&self, level: f64, mut frame: Frame, located: &Located<'_>) -> Outline {
        frame.half = frame.half.map(|v| MARGIN * v);
        let level = level * self.growth();
        let trace = |frame: &Frame| outline(frame, Part::Centre, -level, |d| -self.ratio(d));
        let (mut found, mut cut) = trace(&frame);
        for _ in 0..GROWN {
            if cut == [false; 2] {
                break;
            }
            for axis in 0..2 {
                frame.half[axis] *= if cut[axis] { GROWTH } else { 1.0 };
            }
            (found, cut) = trace(&frame);
        }
        if cut != [false; 2] {
            // the region is unbounded
            (found.area, found.semi_major) = (f64::INFINITY, f64::INFINITY);
        }
        found.shift([located.position[0], located.position[1]]);
        found
    }
}

/// Sums over arrivals. One factor of each product is the derivative of the residual with respect to the
/// emission.
#[derive(Default)]
struct Emission {
    information: f64,
    residual: f64,
    gradient: Vector<2>,
}

impl Emission {
    fn add(&mut self, m: &Measurement<2>, residual: f64, gradient: Vector<2>) {
        if m.kind == Kind::Arrival {
            self.information += m.precision * m.precision;
            self.residual += m.precision * residual;
            for i in 0..2 {
                self.gradient[i] += m.precision * gradient[i];
            }
        }
    }

    /// Returns what is subtracted from a sum of products when the emission is eliminated.
    fn share(&self, a: f64, b: f64) -> f64 {
        if self.information > 0.0 { a * b / self.information } else { 0.0 }
    }
}
