//! Instants side by side, one in each lane of a vector, that measured the same kinds at the same
//! stations: the descent from a start that is trusted.
//!
//! The steps are those of [`super::descent`], without its safeguards. A lane where a step goes
//! uphill or takes too long has no minimum here. Lanes do not know of each other, so an instant has
//! the same result alone and in any company.

use super::descent::{FAR, HUBER, Loss, ROUNDING};
use crate::base::small::{self, Matrix, REGULAR};
use crate::base::vector::Vector;
use crate::sensors::{Kind, Measurement, Row, SMALL_TANGENT, TERMS};
use pulp::{Arch, Simd, WithSimd};

/// Instants side by side: two vectors of AVX2, so that one works while the other waits.
pub(super) const LANES: usize = 8;
/// Steps after which a lane is left to others.
const STEPS: usize = 16;

type Lane = [f64; LANES];

/// One measurement of all lanes.
#[derive(Clone, Debug)]
struct Measured<const D: usize> {
    kind: Kind,
    station: [Lane; D],
    value: Lane,
    precision: Lane,
    sine: Lane,
    cosine: Lane,
    axes: Option<[[Lane; D]; D]>,
}

/// Where a lane arrived, the normal matrix and the cost there.
#[derive(Clone, Copy, Debug)]
pub(super) struct Arrival<const D: usize> {
    pub position: small::Vector<D>,
    pub matrix: Matrix<D>,
    pub cost: f64,
}

/// Instants and where they are on their way.
#[derive(Debug)]
pub(super) struct Block<const D: usize> {
    measured: Vec<Measured<D>>,
    /// Residuals and their derivatives at the positions.
    rows: Vec<(Lane, [Lane; D])>,
    position: [Lane; D],
    matrix: [[Lane; D]; D],
    cost: Lane,
    /// Positive at a minimum.
    found: Lane,
}

impl<const D: usize> Default for Block<D> {
    fn default() -> Self {
        let zeros = [0.0; LANES];
        Self {
            measured: Vec::new(),
            rows: Vec::new(),
            position: [zeros; D],
            matrix: [[zeros; D]; D],
            cost: zeros,
            found: zeros,
        }
    }
}

impl<const D: usize> Block<D> {
    /// Begins with an instant, in all lanes.
    pub fn begin(&mut self, measurements: &[Measurement<D>], start: &small::Vector<D>) {
        self.measured.clear();
        for m in measurements {
            self.measured.push(Measured {
                kind: m.kind,
                station: m.station.map(|v| [v; LANES]),
                value: [m.value; LANES],
                precision: [m.precision; LANES],
                sine: [m.sine; LANES],
                cosine: [m.cosine; LANES],
                axes: m.axes.map(|axes| axes.map(|axis| axis.map(|v| [v; LANES]))),
            });
        }
        self.position = start.map(|v| [v; LANES]);
    }

    /// Whether an instant measured the same kinds.
    pub fn fits(&self, measurements: &[Measurement<D>]) -> bool {
        let alike = |(own, m): (&Measured<D>, &Measurement<D>)| {
            own.kind == m.kind && own.axes.is_some() == m.axes.is_some()
        };
        self.measured.len() == measurements.len()
            && self.measured.iter().zip(measurements).all(alike)
    }

    /// Puts an instant that fits into a lane.
    pub fn set(&mut self, lane: usize, measurements: &[Measurement<D>], start: &small::Vector<D>) {
        for (own, m) in self.measured.iter_mut().zip(measurements) {
            for i in 0..D {
                own.station[i][lane] = m.station[i];
            }
            own.value[lane] = m.value;
            own.precision[lane] = m.precision;
            own.sine[lane] = m.sine;
            own.cosine[lane] = m.cosine;
            if let (Some(own), Some(axes)) = (&mut own.axes, &m.axes) {
                for i in 0..D {
                    for j in 0..D {
                        own[i][j][lane] = axes[i][j];
                    }
                }
            }
        }
        for i in 0..D {
            self.position[i][lane] = start[i];
        }
    }

    /// Goes downhill in all lanes, until steps are shorter than `tolerance` standard deviations; to
    /// Tukey's minimum by way of so many Huber steps, until they are shorter than `near`.
    pub fn descend(&mut self, loss: Loss, huber: (usize, f64), tolerance: f64) {
        Arch::new().dispatch(Descent { block: self, loss, huber, tolerance });
    }

    /// The minimum of a lane, and the rows there, if it reached one.
    pub fn arrival(&self, lane: usize, extent: f64, rows: &mut Vec<Row<D>>) -> Option<Arrival<D>> {
        let position = std::array::from_fn(|i| self.position[i][lane]);
        if self.found[lane] <= 0.0 || small::norm(&position) > FAR * extent {
            return None;
        }
        let mut matrix = [[0.0; D]; D];
        for i in 0..D {
            for j in 0..=i {
                matrix[i][j] = self.matrix[i][j][lane];
                matrix[j][i] = matrix[i][j];
            }
        }
        rows.clear();
        rows.extend(self.rows.iter().map(|(residual, gradient)| Row {
            residual: residual[lane],
            gradient: std::array::from_fn(|i| gradient[i][lane]),
        }));
        Some(Arrival { position, matrix, cost: self.cost[lane] })
    }
}

struct Descent<'a, const D: usize> {
    block: &'a mut Block<D>,
    loss: Loss,
    huber: (usize, f64),
    tolerance: f64,
}

impl<const D: usize> WithSimd for Descent<'_, D> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { block, loss, huber, tolerance } = self;
        block.rows.resize(block.measured.len(), ([0.0; LANES], [[0.0; LANES]; D]));
        for at in 0..LANES / S::F64_LANES {
            let lanes = Lanes { simd, at };
            let mut p = Vector::load_all(simd, &block.position, at);
            if loss != Loss::Square {
                lanes.approach(&block.measured, &mut p, huber);
            }
            let (normal, found) = lanes.descend(&block.measured, &mut p, loss, tolerance);
            Vector::store_all(&p, &mut block.position, at);
            for i in 0..D {
                Vector::store_all(&normal.matrix[i], &mut block.matrix[i], at);
            }
            normal.cost.store(&mut block.cost, at);
            found.store(&mut block.found, at);
            for (m, (residual, gradient)) in block.measured.iter().zip(&mut block.rows) {
                let (u, slope) = lanes.row(m, &p);
                u.store(residual, at);
                Vector::store_all(&slope, gradient, at);
            }
        }
    }
}

/// `J^T W J`, the same with ψ' in place of the weights, `J^T W r` and the cost; of the matrices the
/// lower triangles.
#[derive(Clone, Copy)]
struct Normal<S: Simd, const D: usize> {
    matrix: [[Vector<S>; D]; D],
    curvature: [[Vector<S>; D]; D],
    vector: [Vector<S>; D],
    cost: Vector<S>,
}

/// The lanes that are computed together.
#[derive(Clone, Copy)]
struct Lanes<S: Simd> {
    simd: S,
    at: usize,
}

impl<S: Simd> Lanes<S> {
    #[inline(always)]
    fn splat(self, value: f64) -> Vector<S> {
        Vector::splat(self.simd, value)
    }

    #[inline(always)]
    fn load(self, lane: &Lane) -> Vector<S> {
        Vector::load(self.simd, lane, self.at)
    }

    /// Huber's steps, which never go uphill for long.
    #[inline(always)]
    fn approach<const D: usize>(
        self,
        measured: &[Measured<D>],
        p: &mut [Vector<S>; D],
        (steps, tolerance): (usize, f64),
    ) {
        let one = self.splat(1.0);
        let limit = self.splat(tolerance * tolerance);
        let mut done = self.splat(0.0);
        for _ in 0..steps {
            let normal = self.normal(measured, p, Loss::Huber(HUBER));
            let (step, _) = self.solve(&normal.matrix, &normal.vector);
            let size = self.quadratic(&normal.matrix, &step);
            let still = done.at_most(self.splat(0.0));
            for i in 0..D {
                p[i] = (p[i] + step[i]).or(still, p[i]);
            }
            done = one.or(size.at_most(limit), done);
            if done.all_positive() {
                return;
            }
        }
    }

    /// Newton's steps with ψ', or those with weights where the cost curves down. Returns 1 where a
    /// minimum is reached, 0 elsewhere.
    #[inline(always)]
    fn descend<const D: usize>(
        self,
        measured: &[Measured<D>],
        p: &mut [Vector<S>; D],
        loss: Loss,
        tolerance: f64,
    ) -> (Normal<S, D>, Vector<S>) {
        let (zero, one) = (self.splat(0.0), self.splat(1.0));
        let limit = self.splat(tolerance * tolerance);
        let slack = self.splat(1.0 + ROUNDING);
        let tiny = self.splat(f64::MIN_POSITIVE);
        let (mut done, mut found) = (zero, zero);
        let mut normal = self.normal(measured, p, loss);
        for _ in 0..STEPS {
            let (mut step, regular) = self.solve(&normal.curvature, &normal.vector);
            if !regular.all_positive() {
                let (other, _) = self.solve(&normal.matrix, &normal.vector);
                let singular = regular.at_most(zero);
                for i in 0..D {
                    step[i] = other[i].or(singular, step[i]);
                }
            }
            let size = self.quadratic(&normal.matrix, &step);
            let mut trial = *p;
            for i in 0..D {
                trial[i] += step[i];
            }
            let next = self.normal(measured, &trial, loss);
            let down = next.cost.at_most(normal.cost * slack + tiny);
            // 1 where the lane goes on
            let moves = one.or(down, zero) - done;
            let still = moves.at_most(zero);
            for i in 0..D {
                p[i] = p[i].or(still, trial[i]);
                normal.vector[i] = normal.vector[i].or(still, next.vector[i]);
                for j in 0..=i {
                    let (a, b) = (normal.matrix[i][j], normal.curvature[i][j]);
                    normal.matrix[i][j] = a.or(still, next.matrix[i][j]);
                    normal.curvature[i][j] = b.or(still, next.curvature[i][j]);
                }
            }
            normal.cost = normal.cost.or(still, next.cost);
            // where a short step leads uphill, what is left is rounding
            let arrived = (one - done).or(size.at_most(limit), zero);
            found += arrived;
            // not downhill, or done before, or arrived now
            done = one.or(still, arrived);
            if done.all_positive() {
                break;
            }
        }
        (normal, found)
    }

    /// The normal equations. O(M).
    #[inline(always)]
    fn normal<const D: usize>(
        self,
        measured: &[Measured<D>],
        p: &[Vector<S>; D],
        loss: Loss,
    ) -> Normal<S, D> {
        let zero = self.splat(0.0);
        let zeros = [[zero; D]; D];
        // elsewhere the weights are ψ', or stand for it
        let curved = matches!(loss, Loss::Tukey(_));
        let mut normal = Normal { matrix: zeros, curvature: zeros, vector: [zero; D], cost: zero };
        for m in measured {
            let (u, gradient) = self.row(m, p);
            let (weight, cost, curvature) = self.loss(u, loss);
            normal.cost += cost;
            let weighted = weight * u;
            for i in 0..D {
                normal.vector[i] += weighted * gradient[i];
                let a = weight * gradient[i];
                for j in 0..=i {
                    normal.matrix[i][j] += a * gradient[j];
                }
                if curved {
                    let b = curvature * gradient[i];
                    for j in 0..=i {
                        normal.curvature[i][j] += b * gradient[j];
                    }
                }
            }
        }
        if !curved {
            normal.curvature = normal.matrix;
        }
        normal
    }

    /// Weight, cost and ψ' of a residual.
    #[inline(always)]
    fn loss(self, u: Vector<S>, loss: Loss) -> (Vector<S>, Vector<S>, Vector<S>) {
        let one = self.splat(1.0);
        match loss {
            Loss::Square => (one, self.splat(0.5) * u * u, one),
            // the cost is not asked for
            Loss::Huber(c) => {
                let c = self.splat(c);
                let weight = one.or(u.abs().at_most(c), c / u.abs());
                (weight, weight, weight)
            }
            Loss::Tukey(c) => {
                let zero = self.splat(0.0);
                let q = u * u * self.splat(1.0 / (c * c));
                let rest = (one - q).or(q.at_most(one), zero);
                let weight = rest * rest;
                let cost = self.splat(c * c / 6.0) * (one - weight * rest);
                (weight, cost, rest * (one - self.splat(5.0) * q))
            }
        }
    }

    /// The whitened residual and its gradient: [`Measurement::row`].
    #[inline(always)]
    fn row<const D: usize>(
        self,
        m: &Measured<D>,
        p: &[Vector<S>; D],
    ) -> (Vector<S>, [Vector<S>; D]) {
        let mut d = *p;
        for i in 0..D {
            d[i] -= self.load(&m.station[i]);
        }
        let Some(axes) = &m.axes else { return self.row_of(m, p, d) };
        let mut own = [self.splat(0.0); D];
        for i in 0..D {
            for j in 0..D {
                own[i] += self.load(&axes[i][j]) * d[j];
            }
        }
        let (residual, slope) = self.row_of(m, p, own);
        let mut gradient = [self.splat(0.0); D];
        for i in 0..D {
            for j in 0..D {
                gradient[j] += self.load(&axes[i][j]) * slope[i];
            }
        }
        (residual, gradient)
    }

    /// The same of an offset from the station, in its axes.
    #[inline(always)]
    fn row_of<const D: usize>(
        self,
        m: &Measured<D>,
        p: &[Vector<S>; D],
        d: [Vector<S>; D],
    ) -> (Vector<S>, [Vector<S>; D]) {
        let (value, precision) = (self.load(&m.value), self.load(&m.precision));
        let mut gradient = [self.splat(0.0); D];
        match m.kind {
            Kind::Range => {
                let range = self.dot(&d, &d).sqrt();
                let scale = precision / range;
                for i in 0..D {
                    gradient[i] = d[i] * scale;
                }
                ((value - range) * precision, gradient)
            }
            Kind::RangeDifference => {
                let (range, first) = (self.dot(&d, &d).sqrt(), self.dot(p, p).sqrt());
                let station = Vector::load_all(self.simd, &m.station, self.at);
                let twice = self.dot(&station, p);
                let difference = (self.dot(&station, &station) - (twice + twice)) / (range + first);
                for i in 0..D {
                    gradient[i] = (d[i] / range - p[i] / first) * precision;
                }
                ((value - difference) * precision, gradient)
            }
            Kind::Azimuth => {
                let (sine, cosine) = (self.load(&m.sine), self.load(&m.cosine));
                let scale = precision / (d[0] * d[0] + d[1] * d[1]);
                gradient[0] = d[1] * scale;
                gradient[1] = -d[0] * scale;
                let angle = self.angle(d[0] * cosine - d[1] * sine, d[0] * sine + d[1] * cosine);
                (-angle * precision, gradient)
            }
            Kind::Elevation => {
                let (sine, cosine) = (self.load(&m.sine), self.load(&m.cosine));
                let up = d[D - 1];
                let horizontal = (d[0] * d[0] + d[1] * d[1]).sqrt();
                let scale = precision / (horizontal * horizontal + up * up);
                let tilt = -up / horizontal * scale;
                gradient[0] = d[0] * tilt;
                gradient[1] = d[1] * tilt;
                gradient[D - 1] = horizontal * scale;
                let angle =
                    self.angle(up * cosine - horizontal * sine, up * sine + horizontal * cosine);
                (-angle * precision, gradient)
            }
        }
    }

    /// The angle of a direction, by its series or, in lanes where it is not small, by the library.
    #[inline(always)]
    fn angle(self, sine: Vector<S>, cosine: Vector<S>) -> Vector<S> {
        let t = sine / cosine;
        let s = t * t;
        let mut sum = self.splat(0.0);
        for term in TERMS {
            sum = s * (self.splat(term) - sum);
        }
        let angle = t - t * sum;
        let small = sine.abs().at_most(self.splat(SMALL_TANGENT) * cosine);
        let is_small = self.splat(1.0).or(small, self.splat(0.0));
        if is_small.all_positive() {
            return angle;
        }
        let zeros = [0.0; LANES];
        let (mut angles, mut sines, mut cosines, mut marks) = (zeros, zeros, zeros, zeros);
        angle.store(&mut angles, 0);
        sine.store(&mut sines, 0);
        cosine.store(&mut cosines, 0);
        is_small.store(&mut marks, 0);
        for lane in 0..S::F64_LANES {
            if marks[lane] == 0.0 {
                angles[lane] = sines[lane].atan2(cosines[lane]);
            }
        }
        Vector::load(self.simd, &angles, 0)
    }

    #[inline(always)]
    fn dot<const D: usize>(self, a: &[Vector<S>; D], b: &[Vector<S>; D]) -> Vector<S> {
        let mut sum = a[0] * b[0];
        for i in 1..D {
            sum += a[i] * b[i];
        }
        sum
    }

    /// `x^T A x` of a lower triangle.
    #[inline(always)]
    fn quadratic<const D: usize>(self, a: &[[Vector<S>; D]; D], x: &[Vector<S>; D]) -> Vector<S> {
        let mut sum = self.splat(0.0);
        for i in 0..D {
            let mut mixed = self.splat(0.0);
            for j in 0..i {
                mixed += a[i][j] * x[j];
            }
            sum += x[i] * (mixed + mixed + a[i][i] * x[i]);
        }
        sum
    }

    /// `A^-1 b` by `A = L D L^T` of a lower triangle; and 1 where A is positive definite, else 0.
    #[inline(always)]
    fn solve<const D: usize>(
        self,
        a: &[[Vector<S>; D]; D],
        b: &[Vector<S>; D],
    ) -> ([Vector<S>; D], Vector<S>) {
        let (zero, one) = (self.splat(0.0), self.splat(1.0));
        let mut lower = [[zero; D]; D];
        let mut reciprocals = [zero; D];
        let mut regular = one;
        let mut x = *b;
        for j in 0..D {
            let mut row = a[j];
            let mut pivot = a[j][j];
            for k in 0..j {
                // what row holds is L D
                for l in 0..k {
                    row[k] -= row[l] * lower[k][l];
                }
                lower[j][k] = row[k] * reciprocals[k];
                pivot -= row[k] * lower[j][k];
                x[j] -= lower[j][k] * x[k];
            }
            let least = self.splat(REGULAR) * a[j][j];
            regular = regular.or(self.splat(f64::MIN_POSITIVE).at_most(a[j][j]), zero);
            regular = zero.or(pivot.at_most(least), regular);
            reciprocals[j] = pivot.reciprocal();
        }
        for i in 0..D {
            x[i] = x[i] * reciprocals[i];
        }
        for j in (0..D).rev() {
            for i in j + 1..D {
                x[j] -= lower[i][j] * x[i];
            }
        }
        (x, regular)
    }
}

#[cfg(test)]
mod tests {
    use super::super::descent::{self, TUKEY};
    use super::*;

    /// What three radars measure of a target, somewhat wrong.
    fn measurements(error: f64, tilted: bool) -> Vec<Measurement<3>> {
        let target = [1000.0, 1500.0, 500.0];
        let axes = [[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]];
        let mut all = Vec::new();
        for (k, station) in
            [[0.0; 3], [2000.0, 300.0, 5.0], [400.0, 2600.0, 0.0]].into_iter().enumerate()
        {
            for kind in Kind::ALL {
                let sigma = if kind.is_angle() { 0.005 } else { 10.0 };
                let zero = Measurement::new(kind, k, station, 0.0, sigma);
                let zero = if tilted { zero.about(&axes) } else { zero };
                // the residual of zero is minus the prediction, in standard deviations
                let value = -zero.row(&target).residual * sigma;
                let wrong = error * ((7 * k + kind as usize) as f64).sin();
                let m = Measurement::new(kind, k, station, value + wrong * sigma, sigma);
                all.push(if tilted { m.about(&axes) } else { m });
            }
        }
        all
    }

    #[test]
    fn lanes_arrive_where_single_steps_do() {
        let start = [980.0, 1520.0, 470.0];
        for tilted in [false, true] {
            let mut block = Block::default();
            let instants: Vec<_> =
                (0..LANES).map(|lane| measurements(0.2 * lane as f64, tilted)).collect();
            block.begin(&instants[0], &start);
            for (lane, instant) in instants.iter().enumerate() {
                assert!(block.fits(instant));
                block.set(lane, instant, &start);
            }
            for loss in [Loss::Square, Loss::Tukey(TUKEY)] {
                for i in 0..3 {
                    block.position[i] = [start[i]; LANES];
                }
                block.descend(loss, (8, 0.5), 1e-9);
                for (lane, instant) in instants.iter().enumerate() {
                    let problem = descent::Problem { measurements: instant, extent: 2000.0 };
                    let mut p = start;
                    let (_, normal) = problem.descend(&mut p, loss, 1.0, 50, 1e-9);
                    let mut rows = Vec::new();
                    let arrival = block.arrival(lane, 2000.0, &mut rows).unwrap();
                    for i in 0..3 {
                        assert!((arrival.position[i] - p[i]).abs() < 1e-6, "{loss:?} {lane}");
                    }
                    assert!((arrival.cost - normal.cost).abs() <= 1e-9 * (1.0 + normal.cost));
                    for (row, m) in rows.iter().zip(instant) {
                        assert!((row.residual - m.row(&p).residual).abs() < 1e-6);
                    }
                }
            }
        }
        let mut block = Block::default();
        block.begin(&measurements(0.0, false), &start);
        assert!(!block.fits(&measurements(0.0, true)));
        assert!(!block.fits(&measurements(0.0, false)[1..]));
    }
}
