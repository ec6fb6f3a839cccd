//! Steps of several instants side by side, in the lanes of vectors.

use super::costs::Total;
use super::lane::{Lane, Lanes};
use super::{Cost, Faults, HUBER, Loss, ROUNDING};
use crate::base::small::REGULAR;
use crate::base::vector::Vector;
use crate::sensors::{Kind, Measurement};
use pulp::Simd;

/// One measurement of each lane.
#[derive(Clone, Debug)]
pub(in crate::location) struct Measured<const D: usize> {
    pub kind: Kind,
    pub station: [Lane; D],
    pub value: Lane,
    pub precision: Lane,
    pub sine: Lane,
    pub cosine: Lane,
    pub axes: Option<[[Lane; D]; D]>,
}

/// A measurement of each lane, loaded into vectors.
#[derive(Clone, Copy)]
pub(in crate::location) struct Terms<S: Simd, const D: usize> {
    kind: Kind,
    station: [Vector<S>; D],
    value: Vector<S>,
    precision: Vector<S>,
    sine: Vector<S>,
    cosine: Vector<S>,
    axes: Option<[[Vector<S>; D]; D]>,
}

/// Number of steps after which a lane counts as not converged.
const STEPS: usize = 16;
/// Largest x for which `e^−x` is computed.
const LARGEST_DECAY: f64 = 64.0;
/// Reciprocals of 10 to 1.
const RECIPROCALS: [f64; 10] =
    [1.0 / 10.0, 1.0 / 9.0, 1.0 / 8.0, 1.0 / 7.0, 1.0 / 6.0, 0.2, 0.25, 1.0 / 3.0, 0.5, 1.0];

/// `J^T W J`, the same with ψ' in place of the weights, `J^T W r`, and the cost. Only the lower
/// triangles of the matrices are used.
#[derive(Clone, Copy)]
pub(in crate::location) struct Normal<S: Simd, const D: usize> {
    pub matrix: [[Vector<S>; D]; D],
    pub curvature: [[Vector<S>; D]; D],
    pub vector: [Vector<S>; D],
    pub cost: Vector<S>,
}

impl<S: Simd> Lanes<S> {
    /// Takes Huber's steps, which need no safeguard, as they do not go uphill for long.
    #[inline(always)]
    pub fn approach<const D: usize, const N: usize>(
        self,
        measured: &[Measured<D>],
        p: &mut [Vector<S>; N],
        (steps, tolerance): (usize, f64),
    ) {
        let one = self.splat(1.0);
        let limit = self.splat(tolerance * tolerance);
        let mut done = self.splat(0.0);
        for _ in 0..steps {
            let normal = self.normal(measured, p, Loss::Alike(Cost::Huber(HUBER)));
            let (step, _) = self.solve(&normal.matrix, &normal.vector);
            let size = self.quadratic(&normal.matrix, &step);
            let still = done.at_most(self.splat(0.0));
            for i in 0..N {
                p[i] = (p[i] + step[i]).or(still, p[i]);
            }
            done = one.or(size.at_most(limit), done);
            if done.all_positive() {
                return;
            }
        }
    }

    /// Takes Newton steps with ψ', or weighted steps where the cost curves downward. Returns 1 in lanes
    /// that reached a minimum, 0 in the others.
    #[inline(always)]
    pub fn descend<const D: usize, const N: usize>(
        self,
        measured: &[Measured<D>],
        p: &mut [Vector<S>; N],
        loss: Loss,
        tolerance: f64,
    ) -> (Normal<S, N>, Vector<S>) {
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
                for i in 0..N {
                    step[i] = other[i].or(singular, step[i]);
                }
            }
            let size = self.quadratic(&normal.matrix, &step);
            let mut trial = *p;
            for i in 0..N {
                trial[i] += step[i];
            }
            let next = self.normal(measured, &trial, loss);
            let down = next.cost.at_most(normal.cost * slack + tiny);
            // 1 in lanes that are still moving
            let moves = one.or(down, zero) - done;
            let still = moves.at_most(zero);
            for i in 0..N {
                p[i] = p[i].or(still, trial[i]);
                normal.vector[i] = normal.vector[i].or(still, next.vector[i]);
                for j in 0..=i {
                    let (a, b) = (normal.matrix[i][j], normal.curvature[i][j]);
                    normal.matrix[i][j] = a.or(still, next.matrix[i][j]);
                    normal.curvature[i][j] = b.or(still, next.curvature[i][j]);
                }
            }
            normal.cost = normal.cost.or(still, next.cost);
            // if a short step leads uphill, the remaining difference is due to rounding
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

    /// Computes the normal equations. O(M).
    #[inline(always)]
    pub fn normal<const D: usize, const N: usize>(
        self,
        measured: &[Measured<D>],
        p: &[Vector<S>; N],
        loss: Loss,
    ) -> Normal<S, N> {
        let zero = self.splat(0.0);
        let zeros = [[zero; N]; N];
        // for other losses ψ' equals the weights, or is replaced by them
        let curved = loss.is_curved();
        let mut normal = Normal { matrix: zeros, curvature: zeros, vector: [zero; N], cost: zero };
        let mut total = Total::new(self, loss);
        for m in measured {
            let (u, gradient) = self.row_at(&self.loaded(m), p);
            let (weight, cost, curvature) = self.loss(u, loss.of(m.kind));
            total.add(cost);
            let weighted = weight * u;
            for i in 0..N {
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
        normal.cost = total.finish();
        if !curved {
            normal.curvature = normal.matrix;
        }
        normal
    }

    /// Returns weight, cost and ψ' of a residual; for a mixture, the likelihood takes the place of the
    /// cost.
    #[inline(always)]
    pub fn loss(self, u: Vector<S>, cost: Cost) -> (Vector<S>, Vector<S>, Vector<S>) {
        let one = self.splat(1.0);
        match cost {
            Cost::Square => (one, self.splat(0.5) * u * u, one),
            // the cost is not used
            Cost::Huber(c) => {
                let c = self.splat(c);
                let weight = one.or(u.abs().at_most(c), c / u.abs());
                (weight, weight, weight)
            }
            Cost::Tukey(c) => {
                let zero = self.splat(0.0);
                let q = u * u * self.splat(1.0 / (c * c));
                let rest = (one - q).or(q.at_most(one), zero);
                let weight = rest * rest;
                let cost = self.splat(c * c / 6.0) * (one - weight * rest);
                (weight, cost, rest * (one - self.splat(5.0) * q))
            }
            Cost::Mixture(Faults { late, early }) => {
                let is_early = u.at_most(self.splat(0.0));
                let faults = self.splat(early).or(is_early, self.splat(late));
                let all = [early, late].map(|faults| self.splat(1.0 / (1.0 + faults)));
                let half = self.splat(0.5) * u * u;
                let normal = self.decay(half);
                let total = normal + faults;
                let weight = normal / total;
                let curvature = weight * (one - (one - weight) * (half + half));
                (weight, total * all[0].or(is_early, all[1]), curvature)
            }
        }
    }

    /// Returns `e^−x`: the series at `x/256`, squared eight times; for x > 64 the value at 64.
    #[inline(always)]
    fn decay(self, x: Vector<S>) -> Vector<S> {
        let most = self.splat(LARGEST_DECAY);
        let y = x.or(x.at_most(most), most) * self.splat(1.0 / 256.0);
        let one = self.splat(1.0);
        let mut sum = one;
        for term in RECIPROCALS {
            sum = one - y * self.splat(term) * sum;
        }
        for _ in 0..8 {
            sum = sum * sum;
        }
        sum
    }

    /// Loads one measurement of each lane.
    #[inline(always)]
    pub fn loaded<const D: usize>(self, m: &Measured<D>) -> Terms<S, D> {
        let (simd, at) = (self.simd, self.at);
        let mut axes = None;
        if let Some(own) = &m.axes {
            let mut all = [[self.splat(0.0); D]; D];
            for i in 0..D {
                all[i] = Vector::load_all(simd, &own[i], at);
            }
            axes = Some(all);
        }
        Terms {
            kind: m.kind,
            station: Vector::load_all(simd, &m.station, at),
            value: self.load(&m.value),
            precision: self.load(&m.precision),
            sine: self.load(&m.sine),
            cosine: self.load(&m.cosine),
            axes,
        }
    }

    /// Copies one measurement to all lanes.
    #[inline(always)]
    pub fn repeated<const D: usize>(self, m: &Measurement<D>) -> Terms<S, D> {
        let mut axes = None;
        if let Some(own) = &m.axes {
            let mut all = [[self.splat(0.0); D]; D];
            for i in 0..D {
                all[i] = Vector::splat_all(self.simd, &own[i]);
            }
            axes = Some(all);
        }
        Terms {
            kind: m.kind,
            station: Vector::splat_all(self.simd, &m.station),
            value: self.splat(m.value),
            precision: self.splat(m.precision),
            sine: self.splat(m.sine),
            cosine: self.splat(m.cosine),
            axes,
        }
    }

    /// Returns the whitened residual and its gradient at a state, as [`Measurement::row_at`] does.
    #[inline(always)]
    pub fn row_at<const D: usize, const N: usize>(
        self,
        m: &Terms<S, D>,
        x: &[Vector<S>; N],
    ) -> (Vector<S>, [Vector<S>; N]) {
        let mut p = [self.splat(0.0); D];
        p.copy_from_slice(&x[..D]);
        let (mut residual, slope) = self.row(m, &p);
        let mut gradient = [self.splat(0.0); N];
        gradient[..D].copy_from_slice(&slope);
        if N > D && m.kind == Kind::Arrival {
            residual -= x[D] * m.precision;
            gradient[D] = m.precision;
        }
        (residual, gradient)
    }

    /// Returns the whitened residual and its gradient at a position, as [`Measurement::row`] does.
    #[inline(always)]
    fn row<const D: usize>(
        self,
        m: &Terms<S, D>,
        p: &[Vector<S>; D],
    ) -> (Vector<S>, [Vector<S>; D]) {
        let mut d = *p;
        for i in 0..D {
            d[i] -= m.station[i];
        }
        let Some(axes) = &m.axes else { return self.row_of(m, p, d) };
        let mut own = [self.splat(0.0); D];
        for i in 0..D {
            for j in 0..D {
                own[i] += axes[i][j] * d[j];
            }
        }
        let (residual, slope) = self.row_of(m, p, own);
        let mut gradient = [self.splat(0.0); D];
        for i in 0..D {
            for j in 0..D {
                gradient[j] += axes[i][j] * slope[i];
            }
        }
        (residual, gradient)
    }

    /// Returns the residual and its gradient for an offset `d` from the station, in the axes of the
    /// station.
    #[inline(always)]
    fn row_of<const D: usize>(
        self,
        m: &Terms<S, D>,
        p: &[Vector<S>; D],
        d: [Vector<S>; D],
    ) -> (Vector<S>, [Vector<S>; D]) {
        let (value, precision) = (m.value, m.precision);
        let mut gradient = [self.splat(0.0); D];
        match m.kind {
            Kind::Range | Kind::Arrival => {
                let range = self.dot(&d, &d).sqrt();
                let scale = precision / range;
                for i in 0..D {
                    gradient[i] = d[i] * scale;
                }
                ((value - range) * precision, gradient)
            }
            Kind::Height => {
                gradient[D - 1] = precision;
                ((value - d[D - 1]) * precision, gradient)
            }
            Kind::RangeDifference => {
                let (range, first) = (self.dot(&d, &d).sqrt(), self.dot(p, p).sqrt());
                let twice = self.dot(&m.station, p);
                let square = self.dot(&m.station, &m.station);
                let difference = (square - (twice + twice)) / (range + first);
                for i in 0..D {
                    gradient[i] = (d[i] / range - p[i] / first) * precision;
                }
                ((value - difference) * precision, gradient)
            }
            Kind::Azimuth => {
                let (sine, cosine) = (m.sine, m.cosine);
                let scale = precision / (d[0] * d[0] + d[1] * d[1]);
                gradient[0] = d[1] * scale;
                gradient[1] = -d[0] * scale;
                let angle = self.angle(d[0] * cosine - d[1] * sine, d[0] * sine + d[1] * cosine);
                (-angle * precision, gradient)
            }
            Kind::Elevation => {
                let (sine, cosine) = (m.sine, m.cosine);
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

    #[inline(always)]
    fn dot<const D: usize>(self, a: &[Vector<S>; D], b: &[Vector<S>; D]) -> Vector<S> {
        let mut sum = a[0] * b[0];
        for i in 1..D {
            sum += a[i] * b[i];
        }
        sum
    }

    /// Returns `x^T A x`, with A given by its lower triangle.
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

    /// Solves `A x = b` by `A = L D L^T`, with A given by its lower triangle; the second result is 1
    /// where A is positive definite, else 0.
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
                // row holds L D
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
