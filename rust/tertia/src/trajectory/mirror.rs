//! Stations in a plane, whose measurements of a target and of its mirror image are the same.
//!
//! Ranges, range differences and arrivals do not change if the target is reflected in the plane of the
//! stations (in two dimensions, in their line); neither do azimuths, if the plane is horizontal. Therefore
//! two paths explain the measurements. A path stays on one side, which is the upper one if the plane is
//! level.
//!
//! Near the plane, the measurements determine the distance h from it by `h²/2 = c ± s`: derivatives at h
//! vanish there, and with them the information about h. Averaged over a normal distribution of h with the
//! variance V, derivatives are those at the distance `√(h² + V)`: with the information `(h² + V)/s²` about h,
//! the variance is `V = s` at h = 0, where that of the density `exp(−h⁴/8s²)` is .96 s.

use super::measured::{Place, Record};
use super::path::failure::Failure;
use super::path::{Path, Plots};
use crate::base::small::{Matrix, Vector, add_multiple, add_outer, dot, quadratic};
use crate::sensors::{KINDS, Kind};
use nalgebra::DMatrix;

/// Largest distances of stations from their plane, relative to their extent in it, with which they are near
/// the plane, and with which they are in it.
const NEAR: f64 = 0.2;
const EXACT: f64 = 1e-6;
/// Least vertical component of the normal of a plane that has an upper side.
const LEVEL: f64 = 0.3;
/// Distances from the plane at which searches start, relative to the extent of the stations in it.
const STARTS: [f64; 4] = [0.1, 0.3, 1.0, 3.0];
/// Likelihood of a target in the plane, relative to that of the path, below which the path and its image are
/// distinct.
const APART: f64 = 0.01;
/// Number of instants of a record over those on either side of an instant that is the nearest to the plane.
const AROUND: usize = 20;
/// Standard deviation of a distance, relative to the distance, up to which the distance is well known.
const NEARBY: f64 = 0.1;
/// Axis of the height.
const UP: usize = 2;
/// Paths whose likelihoods differ by less than a factor of 20 cannot be told apart: ln 20.
pub(super) const AMBIGUOUS: f64 = 2.995_732_273_553_991;
/// ln of the prior odds of a target above the stations: a thousand to one.
pub(super) const ABOVE: f64 = 6.907_755_278_982_137;

/// The plane of the stations; a path is on the side to which the normal points.
#[derive(Clone, Debug)]
pub(super) struct Mirror<const D: usize> {
    normal: Vector<D>,
    centre: Vector<D>,
    size: f64,
    /// Whether all stations are in the plane.
    pub is_exact: bool,
    /// Whether one of the sides is the upper one.
    pub is_level: bool,
}

impl<const D: usize> Mirror<D> {
    /// Returns the plane in or near which all stations with measurements are, if their measurements do not
    /// distinguish its sides. The normal points upward if one side is the upper one, else to the north.
    pub fn of(record: &Record<'_>) -> Option<Self> {
        let has = |kind: Kind| heard(record, kind).next().is_some();
        let turns = has(Kind::Azimuth);
        let ranges = has(Kind::Range) || has(Kind::RangeDifference) || has(Kind::Arrival);
        if !ranges || has(Kind::Elevation) || turns && D == 2 {
            return None;
        }
        if record.heights().is_some() {
            // azimuths distinguish the sides of a vertical plane, heights those of any other
            return if turns { None } else { Self::upright(&places::<D>(record)) };
        }
        Self::near(&places::<D>(record), turns)
    }

    /// Returns the plane in or near which these places are. Azimuths (`turns`) distinguish the sides of any
    /// plane that is not horizontal.
    pub fn near(places: &[Vector<D>], turns: bool) -> Option<Self> {
        let count = places.len() as f64;
        let centre: Vector<D> =
            std::array::from_fn(|i| places.iter().map(|p| p[i]).sum::<f64>() / count);
        let product = |i: usize, j: usize| {
            let sum = places.iter().map(|p| (p[i] - centre[i]) * (p[j] - centre[j])).sum::<f64>();
            sum / count
        };
        let eigen = DMatrix::from_fn(D, D, product).symmetric_eigen();
        let mut order: Vec<usize> = (0..D).collect();
        order.sort_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]));
        let mut normal: Vector<D> = std::array::from_fn(|i| eigen.eigenvectors[(i, order[0])]);
        let [mut off, mut size] = [0, 1].map(|at| eigen.eigenvalues[order[at]].max(0.0).sqrt());
        if turns {
            // azimuths distinguish the sides of any other plane
            normal = std::array::from_fn(|i| if i == UP { 1.0 } else { 0.0 });
            off = product(UP, UP).sqrt();
            size = (product(0, 0) + product(1, 1)).sqrt();
        }
        if off > NEAR * size || size == 0.0 {
            return None;
        }
        let is_level = D > UP && normal[UP].abs() >= LEVEL;
        let north = if is_level { UP } else { usize::from(normal[1].abs() > EXACT) };
        if normal[north] < 0.0 {
            normal = normal.map(|v| -v);
        }
        Some(Self { normal, centre, size, is_exact: off <= EXACT * size, is_level })
    }

    /// Returns the vertical plane in or near which these places are.
    fn upright(places: &[Vector<D>]) -> Option<Self> {
        let level: Vec<Vector<2>> = places.iter().map(|p| [p[0], p[1]]).collect();
        let Mirror { normal, centre, size, is_exact, .. } = Mirror::<2>::near(&level, false)?;
        let up = places.iter().map(|p| p[UP]).sum::<f64>() / places.len() as f64;
        let raised =
            |v: Vector<2>, up: f64| std::array::from_fn(|i| if i < UP { v[i] } else { up });
        let (normal, centre) = (raised(normal, 0.0), raised(centre, up));
        Some(Self { normal, centre, size, is_exact, is_level: false })
    }

    /// As [`Self::of`], but the normal points to the side of the position near the first instant, if it is
    /// given.
    pub fn chosen(record: &Record<'_>) -> Option<Self> {
        let mirror = Self::of(record)?;
        let is_behind = record.initial.is_some_and(|initial| mirror.distance(initial) < 0.0);
        Some(if is_behind { mirror.flipped() } else { mirror })
    }

    /// Returns the mirror images (N, D) of states (N, M). If neither side is the upper one, there is no
    /// reason to prefer one of the two, and the result is an error.
    pub fn image_of(&self, mean: &[f64], size: usize) -> Result<Vec<f64>, Failure> {
        if !self.is_level {
            return Err(Failure::Mirrored);
        }
        Ok(mean.chunks_exact(size).flat_map(|state| self.reflected(&state[..D])).collect())
    }

    /// Returns the same plane with the opposite normal.
    pub fn flipped(&self) -> Self {
        Self { normal: self.normal.map(|v| -v), ..self.clone() }
    }

    /// Distance from the plane, negative behind it.
    pub fn distance(&self, position: &[f64]) -> f64 {
        (0..D).map(|i| self.normal[i] * (position[i] - self.centre[i])).sum()
    }

    /// Returns a position moved along the normal.
    fn moved(&self, position: &[f64], by: f64) -> Vector<D> {
        std::array::from_fn(|i| position[i] + by * self.normal[i])
    }

    /// Returns the mirror image of a position.
    pub fn reflected(&self, position: &[f64]) -> Vector<D> {
        self.moved(position, -2.0 * self.distance(position))
    }

    /// Returns the mirror image of a position with its derivatives.
    pub fn turned(&self, motion: &[Vector<D>; 3]) -> [Vector<D>; 3] {
        let across = |v: &Vector<D>| -2.0 * dot(&self.normal, v);
        let turned = |v: &Vector<D>| std::array::from_fn(|i| v[i] + across(v) * self.normal[i]);
        [self.reflected(&motion[0]), turned(&motion[1]), turned(&motion[2])]
    }

    /// Returns the position or its mirror image, whichever is on the side of the normal.
    pub fn beside(&self, position: &[f64]) -> Vector<D> {
        let distance = self.distance(position);
        self.moved(position, distance.abs() - distance)
    }

    /// Positions at which searches start.
    pub fn starts(&self) -> [Vector<D>; 4] {
        STARTS.map(|share| self.moved(&self.centre, share * self.size))
    }

    /// Variance of the distance from the plane.
    pub fn variance(&self, covariance: &[f64], stride: usize) -> f64 {
        let row = |i: usize| std::array::from_fn(|j| covariance[i * stride + j]);
        (0..D).map(|i| self.normal[i] * dot(&self.normal, &row(i))).sum()
    }

    /// Raises the information about the distance from the plane to that of another matrix.
    pub fn raise(&self, information: &mut Matrix<D>, other: &Matrix<D>) {
        let more = quadratic(other, &self.normal) - quadratic(information, &self.normal);
        add_outer(information, more.max(0.0), &self.normal);
    }

    /// Reduces the component of a direction along the normal to this share.
    fn shortened(&self, direction: &mut Vector<D>, share: f64) {
        let along = dot(&self.normal, direction) * (1.0 - share);
        add_multiple(direction, -along, &self.normal);
    }
}

/// A mirror, and the uncertainty of the distance from it at each instant.
#[derive(Clone, Debug)]
pub(super) struct Sides<const D: usize> {
    pub mirror: Mirror<D>,
    /// Variances of the distances.
    variance: Vec<f64>,
    /// Parts of the variances that are due to systematic errors.
    systematic: Vec<f64>,
    /// Whether a path has been found with averaged derivatives; before that, steps with them would be too
    /// long.
    pub is_settled: bool,
    /// Whether a path that crosses a level plane would be much likelier than this one, which does not.
    pub may_cross: bool,
    /// Whether a path that crosses the plane at other instants is hardly less likely than this one.
    pub is_doubtful: bool,
    /// Side of each instant: 1 on the side of the normal, -1 behind the plane.
    side: Vec<f64>,
}

impl<const D: usize> Sides<D> {
    pub fn new(mirror: Mirror<D>, n: usize) -> Self {
        let [variance, systematic] = [(); 2].map(|()| vec![0.0; n]);
        let side = vec![1.0; n];
        let [is_settled, may_cross, is_doubtful] = [false; 3];
        Self { mirror, variance, systematic, is_settled, may_cross, is_doubtful, side }
    }

    /// Signed distance from the plane at which derivatives are taken.
    fn eye(&self, t: usize, distance: f64) -> f64 {
        distance.hypot(self.variance[t].sqrt()).copysign(distance)
    }

    /// Returns a position with the point at which derivatives are taken.
    pub fn place(&self, t: usize, position: &[f64]) -> Place<D> {
        let distance = self.mirror.distance(position);
        let eye = self.mirror.moved(position, self.eye(t, distance) - distance);
        Place { eye: Some(eye), ..Place::at(position) }
    }

    /// Converts the gradient of a cost, with derivatives taken at the point of `place`, into that at a
    /// position.
    pub fn lower(&self, t: usize, position: &[f64], gradient: &mut Vector<D>) {
        let distance = self.mirror.distance(position);
        let eye = self.eye(t, distance);
        if eye != 0.0 {
            self.mirror.shortened(gradient, distance / eye);
        }
    }

    /// Updates the variances of the distances from covariances (N, D, D). Near the plane, the new variance is
    /// inversely proportional to the old one; their geometric mean converges.
    pub fn learn(&mut self, covariance: &[f64]) {
        for (t, own) in covariance.chunks_exact(D * D).enumerate() {
            let new = self.mirror.variance(own, D) + self.systematic[t];
            let old = self.variance[t];
            if new.is_finite() && new >= 0.0 {
                self.variance[t] = if old > 0.0 { (old * new).sqrt() } else { new };
            }
        }
    }

    /// Updates the parts of the variances that are due to systematic errors, from covariances (N, M, M) with
    /// and without these.
    pub fn learn_systematic(&mut self, with: &[f64], without: &[f64], size: usize) {
        let pairs = with.chunks_exact(size * size).zip(without.chunks_exact(size * size));
        for (own, (with, without)) in self.systematic.iter_mut().zip(pairs) {
            let added = self.mirror.variance(with, size) - self.mirror.variance(without, size);
            *own = if added.is_finite() { added.max(0.0) } else { 0.0 };
        }
    }

    /// Whether a path, (N, M) numbers, is anywhere so near the plane that its distance is not well known.
    pub fn is_near(&self, mean: &[f64], size: usize) -> bool {
        let near = |(own, variance): (&[f64], &f64)| {
            *variance > (NEARBY * self.mirror.distance(&own[..D])).powi(2)
        };
        mean.chunks_exact(size).zip(&self.variance).any(near)
    }

    /// Whether a path, (N, M) numbers, is anywhere so far from the plane that it and its image are distinct.
    pub fn is_apart(&self, mean: &[f64], size: usize) -> bool {
        let far = |(own, variance): (&[f64], &f64)| {
            likelihood_of_none(self.mirror.distance(&own[..D]), *variance) < APART
        };
        mean.chunks_exact(size).zip(&self.variance).any(far)
    }

    /// Adds to covariances (N, M, M) the possibility that the target is in the plane, as boats are. Two standard
    /// deviations reach the mirror image if it is possible, too (`is_open`).
    pub fn add_doubt(&self, mean: &[f64], covariance: &mut [f64], size: usize, is_open: bool) {
        let states = mean.chunks_exact(size).zip(covariance.chunks_exact_mut(size * size));
        for ((state, own), variance) in states.zip(&self.variance) {
            let distance = self.mirror.distance(&state[..D]);
            let share = if is_open { 1.0 } else { likelihood_of_none(distance, *variance) };
            let added = distance * distance * share;
            if !added.is_finite() {
                continue;
            }
            for i in 0..D {
                for j in 0..D {
                    own[i * size + j] += added * self.mirror.normal[i] * self.mirror.normal[j];
                }
            }
        }
    }

    /// Returns the position or its mirror image, whichever is on the side of the path at this instant.
    pub fn beside(&self, t: usize, position: &[f64]) -> Vector<D> {
        let distance = self.mirror.distance(position);
        self.mirror.moved(position, self.side[t] * distance.abs() - distance)
    }

    /// Returns the sides of a path that is on the other side from an instant on.
    pub fn flipped_from(&self, start: usize) -> Self {
        let mut flipped = self.clone();
        flipped.side[start..].iter_mut().for_each(|side| *side = -*side);
        flipped
    }

    /// Returns positions of which those from an instant on are reflected.
    pub fn reflected_from(&self, start: usize, plots: &Plots) -> Plots {
        let mut reflected = plots.clone();
        for t in start..self.side.len() {
            let position = self.mirror.reflected(&plots.position[t * D..][..D]);
            reflected.position[t * D..][..D].copy_from_slice(&position);
            let own = &mut reflected.covariance[t * D * D..][..D * D];
            let n = &self.mirror.normal;
            let along: Vector<D> =
                std::array::from_fn(|i| (0..D).map(|j| own[i * D + j] * n[j]).sum());
            let whole = dot(n, &along);
            for i in 0..D {
                for j in 0..D {
                    own[i * D + j] +=
                        4.0 * n[i] * n[j] * whole - 2.0 * (n[i] * along[j] + along[i] * n[j]);
                }
            }
        }
        reflected
    }

    /// Whether a path, which was smoothed without regard to the sides, is on the sides of some instants before
    /// and after a crossing.
    pub fn crosses_at(&self, start: usize, path: &Path) -> bool {
        let is_right = |t: usize| self.side[t] * self.mirror.distance(path.position::<D>(t)) > 0.0;
        (0..start).any(is_right) && (start..self.side.len()).any(is_right)
    }

    /// Whether a path, (N, M) numbers, is farther from the plane than a standard deviation, at any instant that
    /// `others` have on the other side: two standard deviations do not reach the image then.
    pub fn differ(&self, others: &Self, mean: &[f64], size: usize) -> bool {
        (0..self.side.len()).any(|t| {
            let distance = self.mirror.distance(&mean[t * size..][..D]);
            let square = distance * distance;
            let doubt = square * likelihood_of_none(distance, self.variance[t]);
            self.side[t] != others.side[t] && square > self.variance[t] + doubt
        })
    }

    /// Number of instants on either side of an instant that is the nearest to the plane.
    pub fn reach(&self) -> usize {
        (self.side.len() / AROUND).max(1)
    }

    /// Returns the instants, except the last one, at which a path is nearer to the plane than at all around
    /// them: a limited number, because of equal distances only the first counts.
    pub fn nearest(&self, path: &Path) -> Vec<usize> {
        let distance: Vec<f64> =
            path.mean.chunks_exact(3 * D).map(|s| self.mirror.distance(&s[..D]).abs()).collect();
        let reach = self.reach();
        let is_nearest = |t: &usize| {
            let own = distance[*t];
            (1..=reach).all(|by| {
                t.checked_sub(by).is_none_or(|at| distance[at] > own)
                    && distance.get(t + by).is_none_or(|other| *other >= own)
            })
        };
        (0..distance.len().saturating_sub(1)).filter(is_nearest).collect()
    }
}

/// Likelihood that the target is in the plane, relative to that of the estimated distance, which was found as
/// the root of its square and has this variance.
fn likelihood_of_none(distance: f64, variance: f64) -> f64 {
    let square = distance * distance;
    // variance of half the square
    let error = variance * (square + variance);
    if error > 0.0 { (-square * square / (8.0 * error)).exp() } else { 0.0 }
}

/// Returns the numbers of the stations that measured this kind.
fn heard<'a>(record: &'a Record<'_>, kind: Kind) -> impl Iterator<Item = usize> + 'a {
    let (width, k) = (record.width(), record.width() / KINDS);
    let seen = move |station: &usize| {
        let column = kind as usize * k + station;
        record.values.iter().skip(column).step_by(width).any(|v| !v.is_nan())
    };
    (0..k).filter(seen)
}

/// Returns all positions of the stations that have measurements.
fn places<const D: usize>(record: &Record<'_>) -> Vec<Vector<D>> {
    let k = record.width() / KINDS;
    let mut is_heard = vec![false; k];
    for kind in [Kind::Range, Kind::Azimuth, Kind::RangeDifference, Kind::Arrival] {
        heard(record, kind).for_each(|station| is_heard[station] = true);
    }
    if heard(record, Kind::RangeDifference).next().is_some() {
        is_heard[0] = true;
    }
    let stations = record.stations.chunks_exact(D).enumerate();
    let own = stations.filter(|(at, _)| is_heard[at % k]);
    own.map(|(_, place)| std::array::from_fn(|i| place[i])).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::smoothing::{ProcessNoise, ProcessNoiseFit, Summary};

    /// Each of the instants costs a path.
    #[test]
    fn of_equal_distances_few_are_nearest() {
        let (normal, n) = ([0.0, 0.0, 1.0], 1000);
        let mirror = Mirror { normal, centre: [0.0; 3], size: 1.0, is_exact: true, is_level: true };
        let motion = ProcessNoise::with_jerk(0.0);
        let path = |height: &dyn Fn(usize) -> f64| Path {
            mean: (0..n)
                .flat_map(|t| [[0.0, 0.0, height(t)], [0.0; 3], [0.0; 3]])
                .flatten()
                .collect(),
            covariance: Vec::new(),
            fit: ProcessNoiseFit { motion, relative_error: 0.0 },
            summary: Summary { log_likelihood: 0.0, count: 0 },
        };
        let nearest =
            |height: &dyn Fn(usize) -> f64| Sides::new(mirror.clone(), n).nearest(&path(height));
        assert_eq!(nearest(&|_| 30.0), [0]);
        assert!(nearest(&|t| 30.0 + (t % 7) as f64).len() <= AROUND);
        assert_eq!(nearest(&|t| t.abs_diff(400) as f64), [400]);
    }
}
