//! Information of some plots about the state, as rows `R x = z + noise of unit variance`, where x is the
//! difference from a reference near the plots: nothing large is extrapolated.
//!
//! There are as many rows as the plots determine: no information means no rows, rather than a large variance.
//! The state is [positions, velocities, accelerations]. A step in time is `x' = F x + G w` with w of unit
//! variance. Forwards `[R F^-1 G, R F^-1; I, 0]`, backwards `[R G, R F; I, 0]` is triangularised, and w is
//! eliminated (Bierman 1977, chapter 6).

use super::motion::{ProcessNoise, turn_row};
use super::rows::{reduce, reflect, triangularise};
use super::seen::{Quantity, Seen};
use super::track::Track;
use crate::base::scratch::refill;
use std::ops::Range;

/// Sum of logarithms, computed from products as far as possible.
#[derive(Clone, Copy, Debug)]
pub(super) struct Logarithms {
    sum: f64,
    product: f64,
}

impl Logarithms {
    pub const NONE: Self = Self { sum: 0.0, product: 1.0 };

    #[inline(always)]
    pub fn add(&mut self, value: f64) {
        self.product *= value.abs();
        if !(1e-150..1e150).contains(&self.product) {
            self.sum += self.product.ln();
            self.product = 1.0;
        }
    }

    pub fn total(&self) -> f64 {
        self.sum + self.product.ln()
    }
}

/// Direction in time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Direction {
    Forwards,
    Backwards,
}

/// Rows of information, with z as their last column.
#[derive(Clone, Debug, Default)]
pub(super) struct Information {
    pub rows: Vec<f64>,
    pub seen: Vec<Seen>,
    spare: Vec<f64>,
    sums: Vec<f64>,
}

impl Information {
    /// Starts without information, or with that of a prior.
    pub fn start(&mut self, dimension: usize, prior: &[f64]) {
        let n = 3 * dimension;
        self.rows.clear();
        self.rows.extend_from_slice(prior);
        self.seen.clear();
        let seen = if prior.is_empty() { Seen::NONE } else { Seen::ALL };
        self.seen.resize(dimension, seen);
        refill(&mut self.sums, 2 * n + 1, 0.0);
    }

    pub fn rank(&self) -> usize {
        self.seen.iter().map(|seen| seen.count).sum()
    }

    /// Moves the information between instants `k` and `k + 1`; adds the logarithms of the pivots of the
    /// eliminated noise to `logarithms`.
    #[inline(always)]
    pub fn advance(
        &mut self,
        n: usize,
        track: &Track<'_>,
        k: usize,
        motion: ProcessNoise,
        direction: Direction,
        logarithms: &mut Logarithms,
    ) {
        let (d, width) = (n / 3, n + 1);
        let sign = if direction == Direction::Forwards { -1.0 } else { 1.0 };
        let (from, to) = (track.reference(k), track.reference(k + 1));
        for row in self.rows.chunks_exact_mut(width) {
            for axis in 0..d {
                row[n] += sign * row[axis] * (to[axis] - from[axis]);
            }
        }
        let t = track.times[k + 1] - track.times[k];
        if t == 0.0 {
            return;
        }
        let back = sign * t;
        let half = 0.5 * t * t;
        let moved = |row: &mut [f64]| turn_row(d, row, back, half);
        if motion.is_certain() {
            self.rows.chunks_exact_mut(width).for_each(moved);
            return;
        }
        let (g, axes) = (motion.noise_root(t), (d, motion.last_axis.sqrt()));
        let wide = n + width;
        let count = self.rows.len() / width;
        refill(&mut self.spare, (count + n) * wide, 0.0);
        let (known, unit) = self.spare.split_at_mut(count * wide);
        for (out, row) in known.chunks_exact_mut(wide).zip(self.rows.chunks_exact_mut(width)) {
            let (noise, state) = out.split_at_mut(n);
            if direction == Direction::Forwards {
                moved(row);
                times_root(row, axes, &g, noise);
            } else {
                times_root(row, axes, &g, noise);
                moved(row);
            }
            state.copy_from_slice(row);
        }
        for (i, row) in unit.chunks_exact_mut(wide).enumerate() {
            row[i] = 1.0;
        }
        for j in 0..n {
            logarithms.add(reflect(&mut self.spare, wide, j, j, j + 1, &mut self.sums));
        }
        for (row, out) in
            self.rows.chunks_exact_mut(width).zip(self.spare.chunks_exact(wide).skip(n))
        {
            row.copy_from_slice(&out[n..]);
        }
    }

    /// Adds some components of the plot of instant `k`; returns the sum of squares that they add.
    #[inline(always)]
    pub fn observe(&mut self, n: usize, track: &Track<'_>, k: usize, numbers: Range<usize>) -> f64 {
        let (d, width) = (n / 3, n + 1);
        let reference = track.reference(k);
        let (plot, whitener) = (track.plot(k), track.whitener(k));
        let before = self.rows.len() / width;
        for i in numbers {
            if plot[i].is_nan() {
                continue;
            }
            let row = &whitener[i * track.numbers..][..track.numbers];
            self.seen[i % d].add(Quantity::of(i, d), track.times[k]);
            let start = self.rows.len();
            self.rows.resize(start + width, 0.0);
            let out = &mut self.rows[start..];
            for j in 0..=i {
                // missing components have the weight 0
                if row[j] != 0.0 {
                    out[j] = row[j];
                    let near = if j < d { reference[j] } else { 0.0 };
                    out[n] += row[j] * (plot[j] - near);
                }
            }
        }
        let (rank, count) = (self.rank(), self.rows.len() / width);
        if count == before {
            return 0.0;
        }
        if rank == n {
            triangularise(&mut self.rows, width, n, &mut self.sums);
        } else if rank < count {
            reduce(&mut self.rows, width, n, rank, &mut self.sums);
        }
        let left = self.rows[rank.min(count) * width..].chunks_exact(width);
        let squares = left.map(|row| row[n] * row[n]).sum();
        self.rows.truncate(rank * width);
        squares
    }

    /// Writes the rows as an upper triangle to `out`. Components that are not `seen` are fixed, which changes
    /// nothing that is determined.
    #[inline(always)]
    pub fn complete(&mut self, n: usize, track: &Track<'_>, out: &mut Vec<f64>) {
        out.clear();
        out.extend_from_slice(&self.rows);
        complete(n, track, &self.seen, out, &mut self.sums);
    }
}

/// Adds rows for what is not determined, and triangularises all rows.
#[inline(always)]
pub(super) fn complete(
    n: usize,
    track: &Track<'_>,
    seen: &[Seen],
    rows: &mut Vec<f64>,
    sums: &mut [f64],
) {
    let (d, width, span) = (n / 3, n + 1, track.span());
    for (axis, seen) in seen.iter().enumerate() {
        for (derivative, _) in seen.open().iter().enumerate().filter(|(_, open)| **open) {
            let start = rows.len();
            rows.resize(start + width, 0.0);
            // as precise as a plot at the end of the track
            rows[start + derivative * d + axis] = track.scale[axis] * span.powi(derivative as i32);
        }
    }
    triangularise(rows, width, n, sums);
}

/// Multiplies a row by G for all axes.
#[inline(always)]
fn times_root(row: &[f64], (d, last): (usize, f64), g: &[f64; 6], out: &mut [f64]) {
    for axis in 0..d {
        let own = if axis > 0 && axis + 1 == d { last } else { 1.0 };
        let (p, v, a) = (own * row[axis], own * row[d + axis], own * row[2 * d + axis]);
        out[axis] = p * g[0] + v * g[1] + a * g[3];
        out[d + axis] = v * g[2] + a * g[4];
        out[2 * d + axis] = a * g[5];
    }
}
