//! A spatial index that finds the points near a position.
//!
//! Square cells cover the plane. Cells whose indices agree in their last bits share a bucket, as if
//! the plane were wrapped around a torus. Neither memory nor time depends on the distances between points,
//! so distant outliers cost nothing. A row of neighbouring cells is contiguous in memory.

use crate::base::error::{Result, require, require_elements};
use std::ops::Range;

/// Smallest number of buckets per point: then a bucket contains on average less than one point of other
/// cells.
const BUCKETS_PER_POINT: usize = 2;
pub(super) const FINITE: &str = "every coordinate must be a finite number";

/// A point and its index in the caller's list.
#[derive(Clone, Copy, Debug, Default)]
pub struct Entry {
    /// Coordinates of the point.
    pub point: [f64; 2],
    /// Index of the point.
    pub index: u32,
    /// A number set by the caller, by which points can be excluded without reading further data.
    pub tag: u32,
}

/// Indices of points, in ascending order.
pub(crate) trait Indices:
    ExactSizeIterator<Item = usize> + DoubleEndedIterator + Clone
{
}

impl<I: ExactSizeIterator<Item = usize> + DoubleEndedIterator + Clone> Indices for I {}

/// An index of points in the plane.
#[derive(Clone, Debug, Default)]
pub struct Grid {
    entries: Vec<Entry>,
    /// Start of the entries of each bucket, and the end of the last ones.
    start: Vec<u32>,
    /// Number of buckets along an axis, a power of two, minus one.
    mask: usize,
    /// Cells per metre.
    density: f64,
}

impl Grid {
    /// Creates the index of `points` with cells of this width; about twice the usual half width of a
    /// query is best. Cost O(N).
    ///
    /// # Errors
    /// A coordinate that is not finite, a width that is not positive, or 2³² points or more.
    pub fn new(points: &[[f64; 2]], cell: f64) -> Result<Self> {
        let mut grid = Self::default();
        grid.fill(points, cell)?;
        Ok(grid)
    }

    /// Replaces the points and reuses the memory. After an error the grid is empty.
    ///
    /// # Errors
    /// As [`Grid::new`].
    pub fn fill(&mut self, points: &[[f64; 2]], cell: f64) -> Result<()> {
        self.fill_tagged(points, |_| 0, cell)
    }

    /// [`Grid::fill`] with a tag for each point, from its index.
    ///
    /// # Errors
    /// As [`Grid::new`].
    pub fn fill_tagged(
        &mut self,
        points: &[[f64; 2]],
        tag: impl Fn(usize) -> u32,
        cell: f64,
    ) -> Result<()> {
        self.fill_some((points, 0..points.len()), tag, cell)
    }

    /// [`Grid::fill_tagged`] with some of the points only, in the order of their indices.
    ///
    /// # Errors
    /// As [`Grid::new`].
    pub(crate) fn fill_some(
        &mut self,
        (points, some): (&[[f64; 2]], impl Indices),
        tag: impl Fn(usize) -> u32,
        cell: f64,
    ) -> Result<()> {
        *self = Self {
            entries: std::mem::take(&mut self.entries),
            start: std::mem::take(&mut self.start),
            ..Self::default()
        };
        self.entries.clear();
        self.start.clear();
        let holds = cell.is_finite() && (1.0 / cell).is_finite() && cell > 0.0;
        require("cell", cell, holds, "a positive number")?;
        let few = u32::try_from(points.len()).is_ok();
        require("points", points.len() as f64, few, "fewer than 2³²")?;
        require_elements("points", points.as_flattened(), 2, f64::is_finite, FINITE)?;
        let side = side(some.len());
        (self.mask, self.density) = (side - 1, 1.0 / cell);
        self.sort((points, some), tag, side * side);
        Ok(())
    }

    /// Sorts the points into buckets by counting.
    fn sort(
        &mut self,
        (points, some): (&[[f64; 2]], impl Indices),
        tag: impl Fn(usize) -> u32,
        buckets: usize,
    ) {
        self.start.resize(buckets + 1, 0);
        for i in some.clone() {
            let bucket = self.bucket(points[i]);
            self.start[bucket] += 1;
        }
        accumulate(&mut self.start);
        self.entries.resize(some.len(), Entry::default());
        for i in some.rev() {
            let point = points[i];
            let bucket = self.bucket(point);
            self.start[bucket] -= 1;
            self.entries[self.start[bucket] as usize] =
                Entry { point, index: i as u32, tag: tag(i) };
        }
    }

    /// Whether there are no points.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// Calls `visit` with the index of every point whose distance from `centre` along each axis is at most
    /// `half_width`, in the order of the cells, not of the indices. No point is near a centre that is
    /// nan.
    #[inline]
    pub fn within(&self, centre: [f64; 2], half_width: [f64; 2], visit: &mut impl FnMut(usize)) {
        let low = [centre[0] - half_width[0], centre[1] - half_width[1]];
        let high = [centre[0] + half_width[0], centre[1] + half_width[1]];
        self.between(low, high, visit);
    }

    /// [`Grid::within`] for a rectangle between two corners.
    #[inline]
    pub fn between(&self, low: [f64; 2], high: [f64; 2], visit: &mut impl FnMut(usize)) {
        self.entries(low, high, &mut |entry| visit(entry.index as usize));
    }

    /// [`Grid::between`] with the points and their tags.
    #[inline]
    pub fn entries(&self, low: [f64; 2], high: [f64; 2], visit: &mut impl FnMut(&Entry)) {
        self.ranges(low, high, &mut |range| {
            for entry in &self.entries[range] {
                if is_inside(entry.point, low, high) {
                    visit(entry);
                }
            }
        });
    }

    /// Returns all points with their tags, cell by cell.
    #[must_use]
    pub fn all(&self) -> &[Entry] {
        &self.entries
    }

    /// Visits the ranges, in [`Grid::all`], of the points between two corners and of others in the same
    /// cells, each once. For callers that test many points at once.
    #[inline]
    pub fn ranges(&self, low: [f64; 2], high: [f64; 2], visit: &mut impl FnMut(Range<usize>)) {
        if self.is_empty() {
            return;
        }
        let (columns, rows) = (self.stretch(low[0], high[0]), self.stretch(low[1], high[1]));
        let side = self.mask + 1;
        let seam = (columns.first + columns.count).min(side);
        let beyond = columns.first + columns.count - seam;
        for row in rows.first..rows.first + rows.count {
            let of_row = (row & self.mask) * side;
            for (first, end) in [(columns.first, seam), (0, beyond)] {
                let from = self.start[of_row + first] as usize;
                let to = self.start[of_row + end] as usize;
                visit(from..to);
                if beyond == 0 {
                    break;
                }
            }
        }
    }

    /// Cell index of a coordinate. It never decreases with the coordinate, despite rounding: casts saturate.
    /// (`floor` would be a function call on the oldest machines that wheels are built for.)
    #[inline]
    fn cell(&self, coordinate: f64) -> i64 {
        let number = coordinate * self.density;
        let towards_zero = number as i64;
        towards_zero.saturating_sub(i64::from(towards_zero as f64 > number))
    }

    #[inline]
    fn bucket(&self, [x, y]: [f64; 2]) -> usize {
        let [column, row] = [x, y].map(|v| self.cell(v) as usize & self.mask);
        row * (self.mask + 1) + column
    }

    /// Returns the cells from one coordinate to another, with each bucket once.
    #[inline]
    fn stretch(&self, low: f64, high: f64) -> Stretch {
        let (first, last) = (self.cell(low), self.cell(high));
        let count = last.saturating_sub(first).saturating_add(1);
        let all = self.mask + 1;
        let count = usize::try_from(count).map_or(0, |count| count.min(all));
        Stretch { first: first as usize & self.mask, count }
    }
}

/// Whether a point is between two corners, edges included. All comparisons are made without branches,
/// because each outcome is almost random and processors cannot predict it.
#[inline]
pub(crate) fn is_inside([x, y]: [f64; 2], low: [f64; 2], high: [f64; 2]) -> bool {
    (x >= low[0]) & (x <= high[0]) & (y >= low[1]) & (y <= high[1])
}

/// Neighbouring cells of a row or column, wrapped around the torus.
#[derive(Clone, Copy)]
struct Stretch {
    first: usize,
    count: usize,
}

/// Number of buckets along an axis for this number of points.
fn side(points: usize) -> usize {
    let buckets = points.saturating_mul(BUCKETS_PER_POINT).max(1);
    1 << buckets.ilog2().div_ceil(2)
}

/// Replaces each number by the sum of those up to it; returns the last sum.
pub(super) fn accumulate(counts: &mut [u32]) -> u32 {
    let mut sum = 0;
    for count in counts {
        sum += *count;
        *count = sum;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;

    fn found(grid: &Grid, centre: [f64; 2], half_width: [f64; 2]) -> Vec<usize> {
        let mut found = Vec::new();
        grid.within(centre, half_width, &mut |i| found.push(i));
        found.sort_unstable();
        found
    }

    fn expected(points: &[[f64; 2]], centre: [f64; 2], half_width: [f64; 2]) -> Vec<usize> {
        let near = |p: &[f64; 2]| {
            (0..2).all(|i| p[i] >= centre[i] - half_width[i] && p[i] <= centre[i] + half_width[i])
        };
        (0..points.len()).filter(|&i| near(&points[i])).collect()
    }

    #[test]
    fn every_point_within_once() {
        let mut random = Random::new(1);
        for n in [0, 1, 2, 7, 100, 1000] {
            for extent in [1e-3, 1.0, 5e3, 1e9] {
                let mut points: Vec<_> =
                    (0..n).map(|_| [random.symmetric(extent), random.symmetric(extent)]).collect();
                if n > 5 {
                    (points[3], points[4], points[5]) = ([1e9, -1e9], [1e300, 0.0], [0.0, -1e300]);
                }
                for cell in [1e-2, 1.0, 1e3] {
                    let grid = Grid::new(&points, cell).unwrap();
                    assert_eq!(grid.entries.len(), n);
                    for _ in 0..20 {
                        let centre = [random.symmetric(extent), random.symmetric(extent)];
                        for width in [0.0, 0.01 * extent, extent, 3e9, 1e300, f64::INFINITY] {
                            let half = [width, random.uniform() * width];
                            let half = half.map(|v| if v.is_nan() { 0.0 } else { v });
                            let found = found(&grid, centre, half);
                            assert_eq!(found, expected(&points, centre, half));
                        }
                    }
                    for (i, point) in points.iter().enumerate() {
                        assert!(found(&grid, *point, [0.0; 2]).contains(&i));
                    }
                }
            }
        }
    }

    #[test]
    fn entries_have_their_points_and_tags() {
        let points = [[0.0, 0.0], [900.0, 0.0], [20.0, -30.0], [25.0, 10.0]];
        let mut grid = Grid::default();
        grid.fill_tagged(&points, |i| 7 * i as u32, 50.0).unwrap();
        let mut found = Vec::new();
        grid.entries([-1.0, -40.0], [30.0, 5.0], &mut |entry| {
            found.push((entry.index, entry.tag, entry.point));
        });
        found.sort_by_key(|entry| entry.0);
        assert_eq!(found, [(0, 0, points[0]), (2, 14, points[2])]);
        // tags are zero if none are given
        grid.fill(&points, 50.0).unwrap();
        grid.entries([-1e3; 2], [1e3; 2], &mut |entry| assert_eq!(entry.tag, 0));
    }

    #[test]
    fn some_of_the_points_keep_their_indices() {
        let mut random = Random::new(2);
        let mut point = || [random.symmetric(3e3), random.symmetric(3e3)];
        let points: Vec<_> = (0..300).map(|_| point()).collect();
        let third = (0..points.len()).step_by(3);
        let mut grid = Grid::default();
        grid.fill_some((&points, third.clone()), |i| i as u32 + 1, 400.0).unwrap();
        assert_eq!(grid.all().len(), 100);
        let own = |entry: &&Entry| {
            entry.tag == entry.index + 1 && entry.point == points[entry.index as usize]
        };
        assert_eq!(grid.all().iter().filter(own).count(), 100);
        let (low, high) = ([-900.0, -200.0], [700.0, 1500.0]);
        let mut near = Vec::new();
        grid.ranges(low, high, &mut |range| near.extend(&grid.all()[range]));
        near.retain(|entry: &Entry| is_inside(entry.point, low, high));
        let mut near: Vec<_> = near.iter().map(|entry| entry.index as usize).collect();
        near.sort_unstable();
        let expected: Vec<_> = third.filter(|&i| is_inside(points[i], low, high)).collect();
        assert!(expected.len() > 5 && near == expected);
    }

    #[test]
    fn nothing_is_near_nothing() {
        let grid = Grid::new(&[[0.0, 0.0], [1.0, 1.0]], 1.0).unwrap();
        for (centre, half) in [
            ([f64::NAN, 0.0], [1.0; 2]),
            ([0.0; 2], [f64::NAN, 1.0]),
            ([0.0; 2], [-1.0, 1.0]),
            ([f64::INFINITY, 0.0], [1.0; 2]),
        ] {
            assert!(found(&grid, centre, half).is_empty());
        }
        assert!(found(&Grid::default(), [0.0; 2], [1.0; 2]).is_empty());
    }

    #[test]
    fn what_is_refused_leaves_it_empty() {
        let mut grid = Grid::new(&[[0.0, 0.0]], 1.0).unwrap();
        let error = grid.fill(&[[0.0, 1.0], [2.0, f64::NAN]], 1.0).unwrap_err();
        assert!(error.to_string().starts_with("points[1, 1] is nan"));
        assert!(grid.is_empty() && found(&grid, [0.0; 2], [1.0; 2]).is_empty());
        for cell in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e-320] {
            assert!(Grid::new(&[], cell).is_err());
        }
        grid.fill(&[[3.0, 4.0]], 2.0).unwrap();
        assert_eq!(found(&grid, [3.0, 4.0], [0.0; 2]), [0]);
    }
}
