//! Some steps of series side by side, read from their rows.

use super::carried::Carried;
use super::kept::{Kept, TILE};
use super::model::Transition;
use super::series::{PerStep, Series};
use super::shared::Gains;
use super::steps::Steps;
use crate::base::vector::Vector;
use pulp::Simd;
use std::ops::Range;

/// Series that are filtered together: vectors enough to hide that each waits for its last step.
pub(super) const LANES: usize = 64;

/// Vectors whose steps alternate, so that none waits for the division of its last one.
pub(super) const GROUP: usize = 4;

/// Steps of all series: rows of four, then of the next four.
#[repr(align(64))]
struct Rows([[[f64; 4]; LANES]; 2]);

impl Rows {
    /// Takes up to as many steps as are in a tile.
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

    /// The steps of the series in a vector's lanes.
    #[inline(always)]
    fn lanes<S: Simd>(&self, simd: S, at: usize) -> [Vector<S>; TILE] {
        let [a, b, c, d] = Vector::from_rows(simd, &self.0[0], at);
        let [e, f, g, h] = Vector::from_rows(simd, &self.0[1], at);
        [a, b, c, d, e, f, g, h]
    }
}

/// The steps of a tile in the lanes of a vector.
#[derive(Clone, Copy)]
#[repr(align(64))]
struct Plots<S: Simd> {
    z: [Vector<S>; TILE],
    r: [Vector<S>; TILE],
}

/// Some steps of all series.
pub(super) struct Tile<'a> {
    plots: Vec<&'a [f64]>,
    variances: Vec<&'a [f64]>,
    z: Rows,
    r: Rows,
    transition: PerStep<'a, Transition>,
    period: Option<f64>,
    /// Its steps; those that were read with them, before; the first of those that are kept together.
    steps: Range<usize>,
    skipped: usize,
    first: usize,
}

impl<'a> Tile<'a> {
    /// Of series that have one variance each, or all of them one of each plot.
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

    /// Reads plots, and the variances of their noise.
    #[inline(always)]
    pub fn read(&mut self, steps: Range<usize>, first: usize) {
        // a whole tile where there are so many steps
        let begin = steps.end.saturating_sub(TILE).min(steps.start);
        self.z.take(&self.plots, begin..steps.end);
        self.r.take(&self.variances, begin..steps.end);
        (self.skipped, self.first, self.steps) = (steps.start - begin, first, steps);
    }

    /// Filters the steps in all lanes; keeps the states where there is room.
    #[inline(always)]
    pub fn run<S: Simd>(
        &self,
        simd: S,
        vectors: &mut [Carried<S>],
        kept: &mut [Kept<S>; GROUP],
        out: &mut [Steps<'_>],
    ) {
        let (one, nan) = (Vector::splat(simd, 1.0), Vector::splat(simd, f64::NAN));
        let mut variances = [[one; TILE]; GROUP];
        for (group, vectors) in vectors.chunks_mut(GROUP).enumerate() {
            let mut plots = [Plots { z: [nan; TILE], r: [one; TILE] }; GROUP];
            for (at, Plots { z, r }) in plots[..vectors.len()].iter_mut().enumerate() {
                *z = self.z.lanes(simd, group * GROUP + at);
                *r = self.r.lanes(simd, group * GROUP + at);
            }
            for i in 0..self.steps.len() {
                let Transition { f, q } = self.transition(i);
                let transition = (Vector::splat_all(simd, f), Vector::splat_all(simd, q));
                for (at, c) in vectors.iter_mut().enumerate() {
                    let plots = &plots[at];
                    let (z, r) = (plots.z[i + self.skipped], plots.r[i + self.skipped]);
                    let (value, variance) = c.step(simd, &transition, z, r, self.period);
                    variances[at][i] = variance;
                    if !out.is_empty() {
                        let kept = &mut kept[at];
                        kept.mean[i] = c.mean;
                        kept.covariance[i] = c.covariance;
                        kept.value[i] = value;
                        kept.variance[i] = variance.or(z.is_number(), nan);
                    }
                }
            }
            for (at, c) in vectors.iter_mut().enumerate() {
                c.multiply(simd, &variances[at]);
            }
            if !out.is_empty() {
                self.keep(simd, &kept[..vectors.len()], group, out);
            }
        }
    }

    /// Writes the states of a group's vectors.
    #[inline(always)]
    fn keep<S: Simd>(&self, simd: S, kept: &[Kept<S>], group: usize, out: &mut [Steps<'_>]) {
        for (at, kept) in kept.iter().enumerate() {
            let at = group * GROUP + at;
            let lanes = at * S::F64_LANES..out.len().min((at + 1) * S::F64_LANES);
            kept.keep(
                simd,
                self.steps.start - self.first,
                self.steps.len(),
                self.period,
                &mut out[lanes],
            );
        }
    }

    /// The step before a plot; none before the first.
    fn transition(&self, i: usize) -> &Transition {
        match (self.steps.start + i).checked_sub(1) {
            Some(step) => self.transition.get(step),
            None => &Transition::NONE,
        }
    }

    /// The means alone, likewise.
    #[inline(always)]
    pub fn share<S: Simd>(
        &self,
        simd: S,
        gains: &Gains,
        vectors: &mut [Carried<S>],
        kept: &mut [Kept<S>; GROUP],
        out: &mut [Steps<'_>],
    ) {
        let nan = Vector::splat(simd, f64::NAN);
        for (group, vectors) in vectors.chunks_mut(GROUP).enumerate() {
            let mut plots = [[nan; TILE]; GROUP];
            for (at, z) in plots[..vectors.len()].iter_mut().enumerate() {
                *z = self.z.lanes(simd, group * GROUP + at);
            }
            for i in 0..self.steps.len() {
                let f = Vector::splat_all(simd, &self.transition(i).f);
                let [k0, k1, k2] = gains.gain[self.steps.start + i];
                let gain = [k0, k1, k2, 1.0 / gains.variance[self.steps.start + i]];
                let gain = Vector::splat_all(simd, &gain);
                for (at, c) in vectors.iter_mut().enumerate() {
                    let value = c.share(simd, &f, &gain, plots[at][i + self.skipped], self.period);
                    if !out.is_empty() {
                        kept[at].mean[i] = c.mean;
                        kept[at].value[i] = value;
                    }
                }
            }
            if !out.is_empty() {
                self.keep(simd, &kept[..vectors.len()], group, out);
            }
        }
    }
}
