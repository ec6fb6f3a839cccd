//! Filters a few steps of several series side by side, which are read from their rows.

use super::carried::Carried;
use super::kept::{self, Kept, TILE};
use super::model::Transition;
use super::series::{PerStep, Series};
use super::shared::Gains;
use super::steps::Steps;
use crate::base::vector::Vector;
use pulp::Simd;
use std::ops::Range;

/// Number of series that are filtered together: enough vectors to hide the time that each waits for its
/// previous step.
pub(super) const LANES: usize = 64;

/// Number of vectors whose steps alternate, so that none waits for its own division to finish.
const GROUP: usize = 4;

/// A tile of steps of all series: rows with the first four steps, then rows with the next four.
#[repr(align(64))]
struct Rows([[[f64; 4]; LANES]; 2]);

impl Rows {
    /// Copies steps of all series, at most as many as there are in a tile.
    #[inline(always)]
    fn take(&mut self, series: &[&[f64]], steps: Range<usize>) {
        let [low, high] = &mut self.0;
        if steps.len() == TILE {
            for ((low, high), values) in low.iter_mut().zip(high).zip(series) {
                let (values, _) = values[steps.clone()].as_chunks::<4>();
                (*low, *high) = (values[0], values[1]);
            }
            return;
        }
        for (l, values) in series.iter().enumerate() {
            for (rows, values) in self.0.iter_mut().zip(values[steps.clone()].chunks(4)) {
                rows[l][..values.len()].copy_from_slice(values);
            }
        }
    }

    /// Returns the steps of the series in the lanes of one vector.
    #[inline(always)]
    fn lanes<S: Simd>(&self, simd: S, at: usize) -> [Vector<S>; TILE] {
        let [a, b, c, d] = Vector::from_rows(simd, &self.0[0], at);
        let [e, f, g, h] = Vector::from_rows(simd, &self.0[1], at);
        [a, b, c, d, e, f, g, h]
    }
}

/// Values of the vectors of a group: plots of a tile, variances of plots and of innovations, and states
/// to be kept.
#[repr(align(64))]
pub(super) struct Group<S: Simd> {
    z: [[Vector<S>; TILE]; GROUP],
    r: [[Vector<S>; TILE]; GROUP],
    variances: [[Vector<S>; TILE]; GROUP],
    kept: [Kept<S>; GROUP],
    rows: kept::Rows,
}

impl<S: Simd> Group<S> {
    /// Allocates memory that each group reuses.
    #[inline(always)]
    pub fn new(simd: S) -> Self {
        let one = [[Vector::splat(simd, 1.0); TILE]; GROUP];
        let kept = [Kept::new(simd); GROUP];
        Self { z: one, r: one, variances: one, kept, rows: kept::Rows::new() }
    }
}

/// A few steps of all series.
pub(super) struct Tile<'a> {
    plots: Vec<&'a [f64]>,
    variances: Vec<&'a [f64]>,
    z: Rows,
    r: Rows,
    transition: PerStep<'a, Transition>,
    period: Option<f64>,
    /// Steps of the tile; number of earlier steps that were read with them; first of the steps that are
    /// kept together.
    steps: Range<usize>,
    skipped: usize,
    first: usize,
}

impl<'a> Tile<'a> {
    /// Creates a tile for series that either all have one constant variance each, or all have one per
    /// plot.
    pub fn new(series: &[Series<'a>], period: Option<f64>) -> Self {
        let (mut variances, mut r) = (Vec::new(), [[[1.0; 4]; LANES]; 2]);
        for (l, series) in series.iter().enumerate() {
            match series.variance {
                PerStep::Constant(r0) => (r[0][l], r[1][l]) = ([r0; 4], [r0; 4]),
                PerStep::Each(each) => variances.push(each),
            }
        }
        Self {
            plots: series.iter().map(|series| series.z).collect(),
            variances,
            z: Rows([[[f64::NAN; 4]; LANES]; 2]),
            r: Rows(r),
            transition: series[0].transition,
            period,
            steps: 0..0,
            skipped: 0,
            first: 0,
        }
    }

    /// Reads plots and the variances of their noise.
    #[inline(always)]
    pub fn read(&mut self, steps: Range<usize>, first: usize) {
        // a whole tile, if there are as many steps
        let begin = steps.end.saturating_sub(TILE).min(steps.start);
        self.z.take(&self.plots, begin..steps.end);
        self.r.take(&self.variances, begin..steps.end);
        (self.skipped, self.first, self.steps) = (steps.start - begin, first, steps);
    }

    /// Filters the steps in all lanes; keeps the states for which there is room.
    #[inline(always)]
    pub fn run<S: Simd>(
        &self,
        simd: S,
        vectors: &mut [Carried<S>],
        group: &mut Group<S>,
        out: &mut [Steps<'_>],
    ) {
        let (one, nan) = (Vector::splat(simd, 1.0), Vector::splat(simd, f64::NAN));
        if self.steps.len() < TILE {
            group.variances = [[one; TILE]; GROUP];
        }
        for (first, vectors) in (0..).step_by(GROUP).zip(vectors.chunks_mut(GROUP)) {
            for at in 0..vectors.len() {
                group.z[at] = self.z.lanes(simd, first + at);
                group.r[at] = self.r.lanes(simd, first + at);
            }
            for i in 0..self.steps.len() {
                let Transition { f, q } = self.transition(i);
                let transition = (Vector::splat_all(simd, f), Vector::splat_all(simd, q));
                for (at, c) in vectors.iter_mut().enumerate() {
                    let (z, r) = (group.z[at][i + self.skipped], group.r[at][i + self.skipped]);
                    let (value, variance) = c.step(simd, &transition, z, r, self.period);
                    group.variances[at][i] = variance;
                    if !out.is_empty() {
                        let kept = &mut group.kept[at];
                        kept.mean[i] = c.mean;
                        kept.covariance[i] = c.covariance;
                        kept.value[i] = value;
                        kept.variance[i] = variance.or(z.is_number(), nan);
                    }
                }
            }
            for (at, c) in vectors.iter_mut().enumerate() {
                c.multiply(simd, &group.variances[at]);
            }
            self.keep(simd, first, vectors.len(), group, out);
        }
    }

    /// Writes the states of `count` vectors for which there is room.
    #[inline(always)]
    fn keep<S: Simd>(
        &self,
        simd: S,
        first: usize,
        count: usize,
        group: &mut Group<S>,
        out: &mut [Steps<'_>],
    ) {
        let steps = (self.steps.start - self.first, self.steps.len());
        let out = out.chunks_mut(S::F64_LANES).skip(first);
        for (kept, out) in group.kept[..count].iter().zip(out) {
            kept.keep(simd, steps, self.period, &mut group.rows, out);
        }
    }

    /// Returns the transition before a plot; before the first plot, that over no time.
    fn transition(&self, i: usize) -> &Transition {
        match (self.steps.start + i).checked_sub(1) {
            Some(step) => self.transition.get(step),
            None => &Transition::NONE,
        }
    }

    /// Like [`Tile::run`], for the means only, with gains that are known.
    #[inline(always)]
    pub fn share<S: Simd>(
        &self,
        simd: S,
        gains: &Gains,
        vectors: &mut [Carried<S>],
        group: &mut Group<S>,
        out: &mut [Steps<'_>],
    ) {
        for (first, vectors) in (0..).step_by(GROUP).zip(vectors.chunks_mut(GROUP)) {
            for at in 0..vectors.len() {
                group.z[at] = self.z.lanes(simd, first + at);
            }
            for i in 0..self.steps.len() {
                let f = Vector::splat_all(simd, &self.transition(i).f);
                let [k0, k1, k2] = gains.gain[self.steps.start + i];
                let gain = [k0, k1, k2, 1.0 / gains.variance[self.steps.start + i]];
                let gain = Vector::splat_all(simd, &gain);
                for (at, c) in vectors.iter_mut().enumerate() {
                    let z = group.z[at][i + self.skipped];
                    let value = c.share(simd, &f, &gain, z, self.period);
                    if !out.is_empty() {
                        group.kept[at].mean[i] = c.mean;
                        group.kept[at].value[i] = value;
                    }
                }
            }
            self.keep(simd, first, vectors.len(), group, out);
        }
    }
}
