//! Starting points: positions on which as many measurements as coordinates agree.
//!
//! An azimuth, or an azimuth and an elevation of one station, define planes. In combination with the range
//! of one station, other ranges and range differences define planes too, because the squares of the
//! coordinates cancel. A point is therefore the intersection of planes, or of a line of planes with one
//! sphere.

use crate::base::angle::median;
use crate::base::small::{Matrix, Vector, dot, norm, roots, rotated_back, solve_line};
use crate::sensors::{Kind, Measurement};

/// Largest number of subsets tried for each kind of point. If there are more, this many are drawn at
/// random, always in the same sequence.
const MOST: usize = 64;
/// Largest number of ranges whose spheres are intersected with lines.
const SPHERES: usize = 8;
/// Number of stations whose measurements are combined. If there are at least twice as many, several groups
/// of this size are combined.
const GROUP: usize = 8;
const GROUPS: usize = 3;
/// Constants of Knuth's MMIX generator.
const MULTIPLIER: u64 = 6_364_136_223_846_793_005;
const INCREMENT: u64 = 1_442_695_040_888_963_407;

/// `normal · p = offset + slope · r0`, with r0 the range of the first station.
#[derive(Clone, Copy, Debug)]
struct Plane<const D: usize> {
    normal: Vector<D>,
    offset: f64,
    slope: f64,
}

impl<const D: usize> Plane<D> {
    /// Returns a plane scaled to a normal of length 1; `None` if the normal has no length.
    fn new(normal: Vector<D>, offset: f64, slope: f64) -> Option<Self> {
        let length = norm(&normal);
        let valid = length > 0.0 && length.is_finite();
        let scaled = |v: f64| v / length;
        valid.then(|| Self {
            normal: normal.map(scaled),
            offset: offset / length,
            slope: slope / length,
        })
    }

    /// Returns the plane through a point.
    fn through(normal: Vector<D>, point: &Vector<D>) -> Option<Self> {
        Self::new(normal, dot(&normal, point), 0.0)
    }
}

/// Measurements of one station, or a height.
#[derive(Clone, Copy, Debug)]
struct Sight<const D: usize> {
    index: usize,
    station: Vector<D>,
    /// Axes to which the angles refer; `None` for those of the frame.
    axes: Option<Matrix<D>>,
    range: Option<f64>,
    /// Sine and cosine of the azimuth.
    azimuth: Option<(f64, f64)>,
    elevation: Option<(f64, f64)>,
    difference: Option<f64>,
    arrival: Option<f64>,
    height: Option<f64>,
}

/// Buffers, and the points found.
#[derive(Debug, Default)]
pub(in crate::location) struct Candidates<const D: usize> {
    sights: Vec<Sight<D>>,
    all: Vec<Sight<D>>,
    planes: Vec<Plane<D>>,
    coordinates: Vec<f64>,
    pub points: Vec<Vector<D>>,
}

impl<const D: usize> Candidates<D> {
    /// Finds points of all kinds, for measurements sorted by station. The measurements of all stations are
    /// combined, or, if there are many, those of [`GROUP`] stations in each of up to [`GROUPS`] groups.
    /// O(K).
    pub fn find(&mut self, measurements: &[Measurement<D>], extent: f64) {
        self.points.clear();
        self.all.clear();
        self.all.extend(measurements.chunk_by(|a, b| a.index == b.index).map(Sight::of));
        let count = self.all.len();
        let groups = (count / GROUP).clamp(1, GROUPS);
        for group in 0..groups {
            let Self { all, sights, .. } = self;
            sights.clear();
            if groups == 1 {
                sights.extend_from_slice(all);
            } else {
                // evenly spread over all stations
                let members = (0..GROUP).map(|i| (i * groups + group) * count / (GROUP * groups));
                sights.extend(members.map(|at| all[at]));
                let height = all.last().filter(|last| last.height.is_some());
                let is_new = |own: &&Sight<D>| sights.last().is_none_or(|s| s.index != own.index);
                let height = height.filter(is_new).copied();
                sights.extend(height);
            }
            self.combine(MOST / groups);
        }
        if self.points.is_empty() && groups > 1 {
            // a few stations among many may determine a point that no group contains
            self.sights.clone_from(&self.all);
            self.combine(MOST);
        }
        if self.points.is_empty() {
            self.around(extent);
        }
    }

    /// Returns the median of the stations' own fixes, coordinate by coordinate, if there are three or more
    /// stations and each of them has one. The measurements must be sorted by station. O(K).
    pub fn middle(&mut self, measurements: &[Measurement<D>]) -> Option<Vector<D>> {
        let Self { points, coordinates, .. } = self;
        points.clear();
        for station in measurements.chunk_by(|a, b| a.index == b.index) {
            points.push(Sight::of(station).polar()?);
        }
        if points.len() < 3 {
            return None;
        }
        Some(std::array::from_fn(|i| {
            coordinates.clear();
            coordinates.extend(points.iter().map(|point| point[i]));
            median(coordinates)
        }))
    }

    /// Adds the points of the stations that are combined, from at most `most` subsets for each kind of
    /// point.
    fn combine(&mut self, most: usize) {
        self.points.extend(self.sights.iter().filter_map(Sight::polar));
        self.planes.clear();
        for sight in &self.sights {
            self.planes.extend(sight.planes().into_iter().flatten());
        }
        let angles = self.planes.len();
        self.meet(D, most, |planes, points| {
            if let Some((point, _)) = meeting(planes) {
                points.push(point);
            }
        });
        self.spheres(angles, most);
        self.hyperbolas(angles, most);
        self.arrivals(angles, most);
    }

    /// Calls `make` with subsets of the planes.
    fn meet(
        &mut self,
        size: usize,
        most: usize,
        mut make: impl FnMut(&[Plane<D>], &mut Vec<Vector<D>>),
    ) {
        let Self { planes, points, .. } = self;
        for_each_subset(planes.len(), size, most, |indices| {
            let mut subset = [Plane { normal: [0.0; D], offset: 0.0, slope: 0.0 }; D];
            for (plane, &i) in subset.iter_mut().zip(indices) {
                *plane = planes[i];
            }
            make(&subset[..size], points);
        });
    }

    /// Intersects lines of planes with the sphere of each range.
    fn spheres(&mut self, angles: usize, most: usize) {
        let ranges = self.sights.iter().filter(|sight| sight.range.is_some()).count();
        // a few spheres are sufficient
        let every = ranges.div_ceil(SPHERES).max(1);
        let most = most / ranges.clamp(1, SPHERES);
        let mut number = 0;
        for at in 0..self.sights.len() {
            let sight = self.sights[at];
            let Some(range) = sight.range else { continue };
            number += 1;
            if number % every != 0 {
                continue;
            }
            self.planes.truncate(angles);
            for other in &self.sights {
                self.planes.extend(other.relative_to(&sight, range).into_iter().flatten());
            }
            self.meet(D - 1, most, |planes, points| {
                let Some((u, v)) = line(planes) else { return };
                let from: Vector<D> = std::array::from_fn(|i| u[i] - sight.station[i]);
                let c = dot(&from, &from) - range * range;
                for t in roots(dot(&v, &v), dot(&from, &v), c) {
                    points.push(std::array::from_fn(|i| u[i] + v[i] * t));
                }
            });
        }
        self.planes.truncate(angles);
    }

    /// Adds points from planes that depend on the range of the first station, which is the origin.
    fn hyperbolas(&mut self, angles: usize, most: usize) {
        for sight in &self.sights {
            let Some(d) = sight.difference else { continue };
            let s = &sight.station;
            self.planes.extend(Plane::new(*s, 0.5 * (dot(s, s) - d * d), -d));
        }
        if self.planes.len() == angles {
            return;
        }
        self.meet(D, most, |planes, points| hyperbolas(planes, &[0.0; D], points));
        self.planes.truncate(angles);
    }

    /// The same for arrivals: every pair of two arrivals once; if there are many arrivals, a few of them
    /// with all others.
    fn arrivals(&mut self, angles: usize, most: usize) {
        let count = self.sights.iter().filter(|sight| sight.arrival.is_some()).count();
        let every = count.div_ceil(SPHERES).max(1);
        let most = most / count.clamp(1, SPHERES);
        let mut number = 0;
        for at in 0..self.sights.len() {
            let sight = self.sights[at];
            let Some(first) = sight.arrival else { continue };
            number += 1;
            if number % every != 0 {
                continue;
            }
            let origin = sight.station;
            self.planes.truncate(angles);
            // relative to this station
            self.planes.iter_mut().for_each(|plane| plane.offset -= dot(&plane.normal, &origin));
            for (index, other) in self.sights.iter().enumerate() {
                let Some(arrival) = other.arrival.filter(|_| index > at || every > 1) else {
                    continue;
                };
                let s = std::array::from_fn(|i| other.station[i] - origin[i]);
                let d = arrival - first;
                self.planes.extend(Plane::new(s, 0.5 * (dot(&s, &s) - d * d), -d));
            }
            self.meet(D, most, |planes, points| hyperbolas(planes, &origin, points));
            let back = |plane: &mut Plane<D>| plane.offset += dot(&plane.normal, &origin);
            self.planes[..angles].iter_mut().for_each(back);
        }
        self.planes.truncate(angles);
    }

    /// Adds points all around the stations, if nothing better is known.
    fn around(&mut self, extent: f64) {
        const FEW: usize = 8;
        for sight in self.sights.iter().take(FEW) {
            for distance in [0.3, 1.0, 3.0] {
                let distance = sight.range.unwrap_or(distance * extent);
                for code in 0..3_usize.pow(D as u32) {
                    let mut direction = [0.0; D];
                    let mut rest = code;
                    for v in &mut direction {
                        *v = (rest % 3) as f64 - 1.0;
                        rest /= 3;
                    }
                    let length = norm(&direction);
                    if length > 0.0 {
                        let step = distance / length;
                        let point = std::array::from_fn(|i| sight.station[i] + step * direction[i]);
                        self.points.push(point);
                    }
                }
            }
        }
    }
}

impl<const D: usize> Sight<D> {
    /// Collects the measurements of a station.
    fn of(measurements: &[Measurement<D>]) -> Self {
        let mut sight = Self {
            index: measurements[0].index,
            station: measurements[0].station,
            axes: None,
            range: None,
            azimuth: None,
            elevation: None,
            difference: None,
            arrival: None,
            height: None,
        };
        for m in measurements {
            sight.axes = sight.axes.or(m.axes);
            match m.kind {
                Kind::Range => sight.range = Some(m.value),
                Kind::Azimuth => sight.azimuth = Some((m.sine, m.cosine)),
                Kind::Elevation => sight.elevation = Some((m.sine, m.cosine)),
                Kind::RangeDifference => sight.difference = Some(m.value),
                Kind::Arrival => sight.arrival = Some(m.value),
                Kind::Height => sight.height = Some(m.value),
            }
        }
        sight
    }

    /// Returns the point given by a station's range, azimuth and (in space) elevation.
    fn polar(&self) -> Option<Vector<D>> {
        let (range, (sine, cosine)) = (self.range?, self.azimuth?);
        let mut offset = [0.0; D];
        let (up, level) = if D == 3 { self.elevation? } else { (0.0, 1.0) };
        offset[0] = range * level * sine;
        offset[1] = range * level * cosine;
        if D == 3 {
            offset[2] = range * up;
        }
        let offset = self.in_frame(offset);
        Some(std::array::from_fn(|i| self.station[i] + offset[i]))
    }

    /// Converts a vector from the axes of the station to those of the frame.
    fn in_frame(&self, v: Vector<D>) -> Vector<D> {
        self.axes.map_or(v, |axes| rotated_back(&axes, &v))
    }

    /// Returns the planes of the height, of the azimuth, and of the elevation with the azimuth or the
    /// range.
    fn planes(&self) -> [Option<Plane<D>>; 2] {
        if let Some(height) = self.height {
            let normal = std::array::from_fn(|i| if i + 1 == D { 1.0 } else { 0.0 });
            return [Plane::new(normal, height, 0.0), None];
        }
        let azimuth = self.azimuth.and_then(|(sine, cosine)| {
            let mut normal = [0.0; D];
            normal[0] = cosine;
            normal[1] = -sine;
            Plane::through(self.in_frame(normal), &self.station)
        });
        let Some((up, level)) = self.elevation.filter(|_| D == 3) else { return [azimuth, None] };
        let mut normal = [0.0; D];
        let elevation = match (self.azimuth, self.range) {
            (Some((sine, cosine)), _) => {
                normal[0] = up * sine;
                normal[1] = up * cosine;
                normal[D - 1] = -level;
                Plane::through(self.in_frame(normal), &self.station)
            }
            (None, Some(range)) => {
                normal[D - 1] = 1.0;
                let normal = self.in_frame(normal);
                Plane::new(normal, dot(&normal, &self.station) + range * up, 0.0)
            }
            (None, None) => None,
        };
        [azimuth, elevation]
    }

    /// Returns the planes of this station's range and range difference, if the range of `other` is known.
    fn relative_to(&self, other: &Self, range: f64) -> [Option<Plane<D>>; 2] {
        let (s, o) = (&self.station, &other.station);
        let spheres = self.range.filter(|_| self.index != other.index).and_then(|own| {
            let normal = std::array::from_fn(|i| 2.0 * (o[i] - s[i]));
            let squares = own * own - range * range + dot(o, o) - dot(s, s);
            Plane::new(normal, squares, 0.0)
        });
        let difference = self
            .difference
            .filter(|_| other.index == 0)
            .and_then(|d| Plane::new(*s, 0.5 * (dot(s, s) - d * d) - d * range, 0.0));
        [spheres, difference]
    }
}

/// Returns the point where D planes meet, as `u + v r0`.
fn meeting<const D: usize>(planes: &[Plane<D>]) -> Option<(Vector<D>, Vector<D>)> {
    let mut n: Matrix<D> = [[0.0; D]; D];
    let (mut a, mut b) = ([0.0; D], [0.0; D]);
    for (i, plane) in planes.iter().enumerate() {
        (n[i], a[i], b[i]) = (plane.normal, plane.offset, plane.slope);
    }
    solve_line(n, a, b)
}

/// Adds the points where planes meet whose slopes refer to the distance from `station`.
fn hyperbolas<const D: usize>(
    planes: &[Plane<D>],
    station: &Vector<D>,
    points: &mut Vec<Vector<D>>,
) {
    let Some((u, v)) = meeting(planes) else { return };
    if planes.iter().all(|plane| plane.slope == 0.0) {
        return;
    }
    for t in roots(dot(&v, &v) - 1.0, dot(&u, &v), dot(&u, &u)) {
        if t > 0.0 {
            points.push(std::array::from_fn(|i| station[i] + u[i] + v[i] * t));
        }
    }
}

/// Returns the line where D − 1 planes meet, as `u + v t`.
fn line<const D: usize>(planes: &[Plane<D>]) -> Option<(Vector<D>, Vector<D>)> {
    let mut all = [Plane { normal: [0.0; D], offset: 0.0, slope: 0.0 }; D];
    all[..D - 1].copy_from_slice(planes);
    let a = planes[0].normal;
    let mut along = [0.0; D];
    if D == 2 {
        along[0] = -a[1];
        along[1] = a[0];
    } else {
        let b = planes[D - 2].normal;
        for i in 0..D {
            let (j, k) = ((i + 1) % D, (i + 2) % D);
            along[i] = a[j] * b[k] - a[k] * b[j];
        }
    }
    all[D - 1] = Plane::new(along, 0.0, 0.0)?;
    all[D - 1].slope = 1.0;
    meeting(&all)
}

/// Visits all subsets of `size` of `n` indices, or `most` random ones if there are more.
fn for_each_subset(n: usize, size: usize, most: usize, mut visit: impl FnMut(&[usize])) {
    if n < size {
        return;
    }
    let count = (0..size).fold(1, |count: usize, i| count.saturating_mul(n - i) / (i + 1));
    let mut indices = [0, 1, 2];
    if count <= most {
        loop {
            visit(&indices[..size]);
            let Some(i) = (0..size).rev().find(|&i| indices[i] < n - size + i) else { return };
            indices[i] += 1;
            for k in i + 1..size {
                indices[k] = indices[k - 1] + 1;
            }
        }
    }
    let mut state = INCREMENT;
    let mut draw = || {
        state = state.wrapping_mul(MULTIPLIER).wrapping_add(INCREMENT);
        ((state >> 33) as usize) % n
    };
    let mut visited = 0;
    while visited < most {
        for index in &mut indices[..size] {
            *index = draw();
        }
        let distinct = (1..size).all(|i| !indices[..i].contains(&indices[i]));
        if distinct {
            visit(&indices[..size]);
            visited += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_subset_once() {
        for (n, size, count) in [(4, 2, 6), (5, 3, 10), (3, 3, 1), (6, 1, 6), (2, 3, 0)] {
            let mut seen = Vec::new();
            for_each_subset(n, size, MOST, |indices| seen.push(indices.to_vec()));
            assert_eq!(seen.len(), count);
            seen.dedup();
            assert_eq!(seen.len(), count);
            assert!(seen.iter().flatten().all(|&i| i < n));
        }
        let mut visited = 0;
        for_each_subset(100, 3, MOST, |indices| {
            visited += 1;
            assert!(indices[0] != indices[1] && indices[1] != indices[2]);
        });
        assert_eq!(visited, MOST);
    }
}
