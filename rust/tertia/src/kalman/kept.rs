//! States of series side by side, from the lanes of vectors into the rows of each series.

use super::shared::Gains;
use super::state::wrapped;
use super::steps::Steps;
use crate::base::vector::{Vector, WIDEST};
use pulp::Simd;

/// Steps whose plots are read and whose states are written at once.
pub(super) const TILE: usize = 4;

/// The states of a vector's lanes after each step of a tile, and their innovations.
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

    /// Writes N steps from `from` on, as far as there is room, with angles in [0, period).
    #[inline(always)]
    pub fn keep<const N: usize>(
        &self,
        simd: S,
        from: usize,
        period: Option<f64>,
        out: &mut [&mut Steps<'_>],
    ) {
        self.keep_means::<N>(simd, from, period, out);
        self.keep_innovations::<N>(simd, from, out);
        if !out[0].covariance.is_empty() {
            let rows = Rows::<6>::new(simd, self.covariance.as_flattened());
            for (l, out) in out.iter_mut().enumerate() {
                rows.write(l, &mut out.covariance[6 * from..][..6 * N]);
            }
        }
        if !out[0].variance.is_empty() {
            let rows = Rows::<1>::new(simd, &self.variance);
            for (l, out) in out.iter_mut().enumerate() {
                rows.write(l, &mut out.variance[from..][..N]);
            }
        }
    }

    /// Writes means and innovations, and what all series have in common.
    #[inline(always)]
    pub fn keep_shared<const N: usize>(
        &self,
        simd: S,
        from: usize,
        period: Option<f64>,
        gains: &Gains,
        out: &mut [&mut Steps<'_>],
    ) {
        self.keep_means::<N>(simd, from, period, out);
        self.keep_innovations::<N>(simd, from, out);
        let to = from + N;
        let covariance = gains.covariance[from..to].as_flattened();
        for out in out {
            if let Some(room) = out.variance.get_mut(from..to) {
                room.copy_from_slice(&gains.variance[from..to]);
            }
            if let Some(room) = out.covariance.get_mut(6 * from..6 * to) {
                room.copy_from_slice(covariance);
            }
        }
    }

    #[inline(always)]
    fn keep_innovations<const N: usize>(&self, simd: S, from: usize, out: &mut [&mut Steps<'_>]) {
        if out[0].innovation.is_empty() {
            return;
        }
        let rows = Rows::<1>::new(simd, &self.value);
        for (l, out) in out.iter_mut().enumerate() {
            rows.write(l, &mut out.innovation[from..][..N]);
        }
    }

    #[inline(always)]
    fn keep_means<const N: usize>(
        &self,
        simd: S,
        from: usize,
        period: Option<f64>,
        out: &mut [&mut Steps<'_>],
    ) {
        if out[0].mean.is_empty() {
            return;
        }
        let rows = Rows::<3>::new(simd, self.mean.as_flattened());
        for (l, out) in out.iter_mut().enumerate() {
            let room = &mut out.mean[3 * from..][..3 * N];
            rows.write(l, room);
            if let Some(period) = period {
                for mean in room.as_chunks_mut::<3>().0 {
                    mean[0] = wrapped(mean[0], period);
                }
            }
        }
    }
}

/// Numbers of each lane one after the other, in groups of four.
struct Rows<const GROUPS: usize>([[[f64; TILE]; WIDEST]; GROUPS]);

impl<const GROUPS: usize> Rows<GROUPS> {
    #[inline(always)]
    fn new<S: Simd>(simd: S, vectors: &[Vector<S>]) -> Self {
        let mut groups = [[[0.0; TILE]; WIDEST]; GROUPS];
        for (rows, group) in groups.iter_mut().zip(vectors.as_chunks::<TILE>().0) {
            Vector::to_rows(simd, *group, rows, 0);
        }
        Self(groups)
    }

    /// Writes lane l's numbers, as many as there is room for.
    #[inline(always)]
    fn write(&self, l: usize, room: &mut [f64]) {
        let (groups, rest) = room.as_chunks_mut::<TILE>();
        let count = groups.len();
        for (rows, room) in self.0.iter().zip(groups) {
            *room = rows[l % WIDEST];
        }
        if let Some(rows) = self.0.get(count) {
            rest.copy_from_slice(&rows[l % WIDEST][..rest.len()]);
        }
    }
}
