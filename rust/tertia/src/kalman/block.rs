//! Filters several series side by side, one in each lane of a vector, so that they share the cost of
//! each step.

use super::carried::Carried;
use super::filter::Filter;
use super::kept::{RUN, TILE, rooms};
use super::series::{PerStep, Series, Summary};
use super::shared::Gains;
use super::steps::Steps;
use super::tile::{Group, LANES, Tile};
use pulp::{Arch, Simd, WithSimd};

/// Filters up to [`LANES`] series of the same length with the same intervals between their plots, and
/// writes the results for which `out` has room. `gains` are used if they are those of all series and no
/// plot is missing. Returns `None` if the series must be filtered one by one: because a prior must be
/// kept as factors, because the start takes all steps, or because plots or variances are refused.
pub(super) fn run_block(
    series: &[Series<'_>],
    filters: &[Filter],
    gains: Option<&Gains>,
    out: &mut [&mut Steps<'_>],
    buffer: &mut Vec<f64>,
) -> Option<Vec<Summary>> {
    let n = series.first()?.z.len();
    let start = series.iter().zip(filters).map(|(series, filter)| known_from(series, filter));
    let start = start.max().filter(|&start| start < n)?;
    Arch::new().dispatch(Run { series, filters, gains, start, out, buffer })
}

/// Returns the number of steps after which the state of a series is known.
fn known_from(series: &Series<'_>, filter: &Filter) -> usize {
    if filter.plain().is_some() {
        return 0;
    }
    let mut plots = series.z.iter().enumerate().filter(|(_, z)| !z.is_nan());
    plots.nth(1).map_or(series.z.len(), |(step, _)| step + 1)
}

struct Run<'a, 'b, 'c, 'd> {
    series: &'a [Series<'a>],
    filters: &'a [Filter],
    gains: Option<&'a Gains>,
    start: usize,
    out: &'b mut [&'c mut Steps<'d>],
    buffer: &'b mut Vec<f64>,
}

impl WithSimd for Run<'_, '_, '_, '_> {
    type Output = Option<Vec<Summary>>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        let Self { series, filters, gains, start, out, buffer } = self;
        let n = series[0].z.len();
        let mut complete = true;
        for series in series {
            // one row after the other, which also brings them into the cache
            complete &= series.plots()? == n;
        }
        let gains = gains.filter(|_| complete);
        let mut summaries = Vec::with_capacity(series.len());
        for ((series, filter), out) in series.iter().zip(filters).zip(&mut *out) {
            summaries.push(match start {
                0 => Summary { filter: *filter, log_likelihood: 0.0, count: 0 },
                _ => series.head(start).fill(*filter, out),
            });
        }
        let mut vectors = Vec::with_capacity(LANES / S::F64_LANES);
        for summaries in summaries.chunks(S::F64_LANES) {
            vectors.push(Carried::new(simd, summaries, gains.is_some())?);
        }
        let mut widths = out[0].widths();
        if gains.is_some() {
            // variances and covariances are the same for all series
            (widths[1], widths[3]) = (0, 0);
        }
        let mut rooms = rooms(buffer, out.len(), widths);
        let mut group = Group::new(simd);
        let mut tile = Tile::new(series, summaries[0].filter.period());
        for first in (start..n).step_by(RUN) {
            let end = n.min(first + RUN);
            for from in (first..end).step_by(TILE) {
                tile.read(from..end.min(from + TILE), first);
                match gains {
                    Some(gains) => tile.share(simd, gains, &mut vectors, &mut group, &mut rooms),
                    None => tile.run(simd, &mut vectors, &mut group, &mut rooms),
                }
            }
            for (out, room) in out.iter_mut().zip(&rooms) {
                out.take(first, end - first, room);
            }
        }
        if let Some(gains) = gains.filter(|_| !rooms.is_empty()) {
            out.iter_mut().for_each(|out| gains.put(start, out));
        }
        let groups = summaries.chunks_mut(S::F64_LANES).zip(series.chunks(S::F64_LANES));
        for (carried, (summaries, series)) in vectors.iter().zip(groups) {
            carried.finish(simd, summaries, series, gains.map(|gains| (gains, start)))?;
        }
        Some(summaries)
    }
}

impl Series<'_> {
    /// Returns the first `steps` steps of the series.
    fn head(&self, steps: usize) -> Self {
        let variance = match self.variance {
            PerStep::Constant(r) => PerStep::Constant(r),
            PerStep::Each(each) => PerStep::Each(&each[..steps]),
        };
        Self { z: &self.z[..steps], variance, ..*self }
    }
}

#[cfg(test)]
mod levels;
