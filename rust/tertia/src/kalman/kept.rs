//! Writes states of several series from the lanes of vectors into the rows of each series.

use super::state::wrapped;
use super::steps::Steps;
use crate::base::vector::{Vector, WIDEST};
use pulp::Simd;

/// Number of steps whose plots are read and whose states are written together.
pub(super) const TILE: usize = 8;

/// Number of steps that are collected in the cache before they are written to the rows of each series:
/// memory is slow if a few numbers at a time go to many places in turn. With 11 numbers per step, a run
/// fills an odd number of cache lines.
pub(super) const RUN: usize = 56;

/// Returns room in `buffer` for [`RUN`] steps of `count` series, with these numbers of values per step
/// for means, covariances, innovations and their variances.
pub(super) fn rooms(buffer: &mut Vec<f64>, count: usize, widths: [usize; 4]) -> Vec<Steps<'_>> {
    let sizes = widths.map(|width| width * RUN);
    let size = sizes.iter().sum::<usize>();
    if size == 0 {
        return Vec::new();
    }
    if buffer.len() < count * size {
        buffer.resize(count * size, 0.0);
    }
    let split = |room| {
        let (mean, room) = <[f64]>::split_at_mut(room, sizes[0]);
        let (covariance, room) = room.split_at_mut(sizes[1]);
        let (innovation, variance) = room.split_at_mut(sizes[2]);
        Steps { mean, covariance, innovation, variance }
    };
    buffer.chunks_exact_mut(size).take(count).map(split).collect()
}

/// States of the lanes of a vector after each step of a tile, and their innovations.
#[derive(Clone, Copy)]
#[repr(align(64))]
pub(super) struct Kept<S: Simd> {
    pub mean: [[Vector<S>; 3]; TILE],
    pub covariance: [[Vector<S>; 6]; TILE],
    pub value: [Vector<S>; TILE],
    pub variance: [Vector<S>; TILE],
}

impl<S: Simd> Kept<S> {
    #[inline(always)]
    pub fn new(simd: S) -> Self {
        let nan = Vector::splat(simd, f64::NAN);
        Self {
            mean: [[nan; 3]; TILE],
            covariance: [[nan; 6]; TILE],
            value: [nan; TILE],
            variance: [nan; TILE],
        }
    }

    /// Writes `steps` steps from step `from` on for which there is room, with angles in [0, period).
    #[inline(always)]
    pub fn keep(
        &self,
        simd: S,
        (from, steps): (usize, usize),
        period: Option<f64>,
        rows: &mut Rows,
        out: &mut [Steps<'_>],
    ) {
        if !out[0].mean.is_empty() {
            rows.fill(simd, self.mean.as_flattened());
            for (l, out) in out.iter_mut().enumerate() {
                let room = &mut out.mean[3 * from..][..3 * steps];
                rows.write(l, room);
                if let Some(period) = period {
                    for mean in room.as_chunks_mut::<3>().0 {
                        mean[0] = wrapped(mean[0], period);
                    }
                }
            }
        }
        if !out[0].innovation.is_empty() {
            rows.fill(simd, &self.value);
            for (l, out) in out.iter_mut().enumerate() {
                rows.write(l, &mut out.innovation[from..][..steps]);
            }
        }
        if !out[0].covariance.is_empty() {
            rows.fill(simd, self.covariance.as_flattened());
            for (l, out) in out.iter_mut().enumerate() {
                rows.write(l, &mut out.covariance[6 * from..][..6 * steps]);
            }
        }
        if !out[0].variance.is_empty() {
            rows.fill(simd, &self.variance);
            for (l, out) in out.iter_mut().enumerate() {
                rows.write(l, &mut out.variance[from..][..steps]);
            }
        }
    }
}

/// Numbers of each lane one after the other, in groups of four; there is room for the covariances of a
/// tile.
#[repr(align(64))]
pub(super) struct Rows([[[f64; 4]; WIDEST]; 6 * TILE / 4]);

impl Rows {
    pub fn new() -> Self {
        Self([[[0.0; 4]; WIDEST]; 6 * TILE / 4])
    }

    #[inline(always)]
    fn fill<S: Simd>(&mut self, simd: S, vectors: &[Vector<S>]) {
        for (rows, group) in self.0.iter_mut().zip(vectors.as_chunks::<4>().0) {
            Vector::to_rows(simd, *group, rows, 0);
        }
    }

    /// Writes the numbers of lane l, as many as there is room for.
    #[inline(always)]
    fn write(&self, l: usize, room: &mut [f64]) {
        let (groups, rest) = room.as_chunks_mut::<4>();
        let count = groups.len();
        for (rows, room) in self.0.iter().zip(groups) {
            *room = rows[l % WIDEST];
        }
        if !rest.is_empty() {
            rest.copy_from_slice(&self.0[count][l % WIDEST][..rest.len()]);
        }
    }
}
