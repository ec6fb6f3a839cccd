//! The region around a position that contains the target with a given probability.
//!
//! Where the errors are small against the distances it is an ellipse: `d^T C^-1 d ≤ c`, with `c` of
//! the chi-square distribution, or of Fisher's where σ is estimated. Elsewhere it is the contour of
//! the likelihood, which stands still where the linear covariance does not know of a bend.

use super::contour::{Frame, Outline, Part, bearing, outline, principal};
use super::fix::Instant;
use super::radial::Radial;
use super::record::{NOWHERE, Record};
use crate::base::distribution::{chi_square_upper_quantile, fisher_upper_quantile};
use crate::base::small::{Factor, Matrix, Vector, quadratic};
use crate::sensors::{KINDS, Kind, Measurement, Row};
use std::f64::consts::TAU;

/// Corners of an ellipse.
const CORNERS: usize = 180;
/// Places on the ellipse where the likelihood is compared, and how much it may differ.
const PLACES: usize = 16;
const STRAIGHT: f64 = 0.1;
/// The frame is so much larger than the ellipse, and grows where it cuts the contour.
const MARGIN: f64 = 1.25;
const GROWTH: f64 = 1.6;
const GROWN: usize = 12;

/// A position, and what it was estimated from.
#[derive(Clone, Copy, Debug)]
pub struct Located<'a> {
    /// What was measured.
    pub instant: Instant<'a>,
    /// Correlation of range differences.
    pub correlation: f64,
    /// Measurements that were left out.
    pub outlier: &'a [bool],
    /// D numbers.
    pub position: &'a [f64],
}

impl Located<'_> {
    /// Whether the emission is an unknown, too.
    pub(super) fn is_timed(&self) -> bool {
        let count = self.instant.values.len() / KINDS;
        let any = |kind: Kind| {
            let at = kind as usize * count;
            self.instant.values[at..at + count].iter().any(|v| !v.is_nan())
        };
        any(Kind::Arrival)
            || any(Kind::RangeDifference) && self.instant.common(self.correlation).is_some()
    }

    /// The position, counted from the first station.
    pub(super) fn offset<const D: usize>(&self) -> Vector<D> {
        std::array::from_fn(|i| self.position[i] - self.instant.stations[i])
    }

    /// The measurements that were not left out, and the number of those that were.
    pub(super) fn kept<const D: usize, const N: usize>(&self) -> (Vec<Measurement<D>>, usize) {
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

/// How large the error of a position is.
#[derive(Clone, Copy, Debug)]
pub struct Spread<'a> {
    /// D² numbers.
    pub covariance: &'a [f64],
    /// The standard deviation of a measurement where it was estimated, 1 where it is known.
    pub sigma: f64,
    /// Degrees of freedom of that estimate, infinite where it is known.
    pub freedom: f64,
}

impl Spread<'_> {
    /// The region that contains the target with a probability, from above. O(CORNERS), and O(cells ·
    /// M) where it is not an ellipse.
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
        // as much area as the ellipse
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

    /// The radius about the position that contains the target with a probability, from above, of
    /// normal errors.
    pub fn radius(&self, probability: f64) -> f64 {
        let radial = Radial::try_new(self.horizontal(), self.freedom);
        radial.map_or(f64::NAN, |radial| radial.quantile(1.0 - probability))
    }

    fn horizontal(&self) -> [f64; 3] {
        let d = self.covariance.len().isqrt();
        [self.covariance[0], self.covariance[1], self.covariance[d + 1]]
    }

    /// c of the ellipse.
    fn level(&self, probability: f64) -> f64 {
        if self.freedom.is_finite() {
            2.0 * fisher_upper_quantile(1.0 - probability, 2.0, self.freedom)
        } else {
            chi_square_upper_quantile(1.0 - probability, 2)
        }
    }
}

/// The likelihood about a position in the plane, the highest over all emissions.
struct Likelihood {
    measurements: Vec<Measurement<2>>,
    p: Vector<2>,
    /// `2 J^T r`, `J^T J` and the sum of squares at the position.
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
            for i in 0..2 {
                own.slope[i] += 2.0 * residual * gradient[i];
                for j in 0..2 {
                    own.matrix[i][j] += gradient[i] * gradient[j];
                }
            }
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

    /// Minus twice the logarithm of the likelihood ratio, at an offset from the position.
    fn ratio(&self, d: [f64; 2]) -> f64 {
        let p: Vector<2> = std::array::from_fn(|i| self.p[i] + d[i]);
        let (mut cost, mut emission) = (0.0, Emission::default());
        for m in &self.measurements {
            let Row { residual, gradient } = m.row(&p);
            emission.add(m, residual, gradient);
            cost += residual * residual;
        }
        cost -= emission.share(emission.residual, emission.residual);
        // a robust position is not where the sum of squares has no slope
        cost - self.cost + self.slope[0] * d[0] + self.slope[1] * d[1]
    }

    /// By how much C is larger than `(J^T J)^-1`, in the direction where it is least so: what was
    /// added because sigmas contradict each other, but not what was added for the bend.
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

    /// The part of the contour that holds the position, in a frame about it.
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
            // it has no end
            (found.area, found.semi_major) = (f64::INFINITY, f64::INFINITY);
        }
        found.shift([located.position[0], located.position[1]]);
        found
    }
}

/// Sums over arrivals, with the derivative of the residual with the emission as second factor.
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

    /// What the best emission takes of a sum of products.
    fn share(&self, a: f64, b: f64) -> f64 {
        if self.information > 0.0 { a * b / self.information } else { 0.0 }
    }
}
