//! Location of every instant on its own.

use super::tukey::TUKEY;
use crate::base::angle::{nearest, upper_median};
use crate::batch::for_each_row;
use crate::location::{BLOCK, Fix, Instant, Locator, Method, Output, Status, Workspace};
use crate::sensors::{KINDS, Kind};
use crate::trajectory::measured::{Measured, REDUNDANCY, Record};
use crate::trajectory::mirror::Mirror;
use crate::trajectory::path::failure::Failure;
use std::f64::consts::TAU;

/// Number of measurements in a running median.
const RUNNING: usize = 5;
/// Standard deviation of an unknown height, in metres: the azimuths hardly depend on the height, even if each
/// station has its own vertical.
const ANYWHERE: f64 = 1e4;
/// Largest contribution of a squared residual to the cost by which positions are chosen.
const MOST: f64 = 9.0;
/// Factors of the stated noise with which instants are located for the beginning of a path. The factors are
/// tried in turn as long as at most one in `HARDLY_ANY` instants has a position.
const LARGER: [f64; 4] = [3.0, 10.0, 30.0, 100.0];
pub(in crate::trajectory) const HARDLY_ANY: usize = 10;
/// Cost (ns) per number of an instant, for the choice of threads.
const LOCATE_NS: f64 = 500.0;

/// Positions of the single instants.
#[derive(Clone, Debug)]
pub struct Fixes {
    /// (N, D); nan where unknown.
    pub position: Vec<f64>,
    /// (N, D, D)
    pub covariance: Vec<f64>,
    /// Whitened residuals (N, 5, K).
    pub residual: Vec<f64>,
    /// Measurements that were given no weight (N, 5, K).
    pub outlier: Vec<bool>,
    /// Further results of each instant.
    pub fixes: Vec<Fix>,
}

impl Fixes {
    /// Locates all instants on their own from these values (N, 5, K).
    pub(in crate::trajectory) fn of<const D: usize>(record: &Record<'_>, values: &[f64]) -> Self {
        let all: Vec<usize> = (0..record.len()).collect();
        let mut own = Self::empty(all.len(), record.width(), D);
        own.relocate::<D>(record, &all, values);
        own
    }

    /// Locates all instants on their own, robustly from this number of degrees of freedom on.
    pub(in crate::trajectory) fn robust_from<const D: usize>(
        record: &Record<'_>,
        redundancy: usize,
    ) -> Self {
        let all: Vec<usize> = (0..record.len()).collect();
        let sigmas: Vec<f64> = all.iter().flat_map(|t| record.sigmas_at(*t)).copied().collect();
        let mut own = Self::empty(all.len(), record.width(), D);
        own.fill::<D>(record, &all, record.values, &sigmas, None, redundancy);
        own
    }

    /// Locates all instants. Returns these fixes, and fixes on the side of the mirror's normal from which a
    /// path can begin: there, instants with little redundancy are located from running medians of the
    /// measurements.
    pub(in crate::trajectory) fn first<const D: usize>(
        record: &Record<'_>,
        measured: &Measured<D>,
        mirror: Option<&Mirror<D>>,
    ) -> Result<(Self, Self), Failure> {
        let mut own = Self::of::<D>(record, &measured.values);
        if record.robust && mirror.is_none() {
            own.move_isolated::<D>(record, &measured.values);
        }
        let beside = own.clone().beside(record, &measured.values, mirror);
        let is_sure = |t: usize| {
            beside.is_located(t) && beside.fixes[t].degrees_of_freedom >= REDUNDANCY as i64
        };
        let open: Vec<usize> = (0..record.len()).filter(|&t| !is_sure(t)).collect();
        let mut start = beside.clone();
        let mut medians = Vec::new();
        if record.robust && !open.is_empty() {
            medians = running_medians(record, &measured.values, &open);
            start.relocate::<D>(record, &open, &medians);
            start.move_beside(record, &open, &medians, mirror);
            for &t in &open {
                if !start.is_located(t) && beside.is_located(t) {
                    start.take::<D>(t, &beside, t, record.width());
                }
            }
        }
        if record.robust && mirror.is_none() {
            start.relocate_contradictory::<D>(record, &measured.values);
            start.relocate_roughly::<D>(record, &open, &medians);
        }
        Ok((own, start.located()?))
    }

    /// Locates ambiguous instants with a larger noise as long as hardly any instant has a position: with the
    /// stated noise, a few measurements that agree by chance contradict the others.
    fn relocate_contradictory<const D: usize>(&mut self, record: &Record<'_>, values: &[f64]) {
        let width = record.width();
        for factor in LARGER {
            if !self.are_hardly_located() {
                return;
            }
            let is_open = |t: &usize| self.fixes[*t].status == Status::Ambiguous;
            let open: Vec<usize> = (0..record.len()).filter(is_open).collect();
            self.relocate_as::<D>(record, &open, &rows(values, &open, width), factor);
        }
    }

    /// Locates instants from running medians with a larger noise as long as hardly any instant has a position:
    /// medians of stations that measure in turn are of different times, between which the target has moved.
    fn relocate_roughly<const D: usize>(
        &mut self,
        record: &Record<'_>,
        open: &[usize],
        medians: &[f64],
    ) {
        let width = record.width();
        for factor in LARGER {
            if !self.are_hardly_located() {
                return;
            }
            let still: Vec<usize> =
                (0..open.len()).filter(|&at| !self.is_located(open[at])).collect();
            let instants: Vec<usize> = still.iter().map(|&at| open[at]).collect();
            self.relocate_as::<D>(record, &instants, &rows(medians, &still, width), factor);
        }
    }

    /// Whether hardly any instant has a position.
    pub(in crate::trajectory) fn are_hardly_located(&self) -> bool {
        let located = (0..self.fixes.len()).filter(|&t| self.is_located(t)).count();
        HARDLY_ANY * located <= self.fixes.len()
    }

    /// Locates all instants on the side of the mirror's normal from values (N, 5, K).
    pub(in crate::trajectory) fn beside<const D: usize>(
        mut self,
        record: &Record<'_>,
        values: &[f64],
        mirror: Option<&Mirror<D>>,
    ) -> Self {
        let all: Vec<usize> = (0..record.len()).collect();
        self.move_beside(record, &all, values, mirror);
        self
    }

    /// Locates instants on the side of the mirror's normal. The searches start from the mirror image of
    /// positions on the other side and from positions farther and farther away. Instants that are not found
    /// there have no position.
    fn move_beside<const D: usize>(
        &mut self,
        record: &Record<'_>,
        open: &[usize],
        values: &[f64],
        mirror: Option<&Mirror<D>>,
    ) {
        let Some(mirror) = mirror else { return };
        let (width, count) = (record.width(), open.len());
        let sigmas: Vec<f64> = open.iter().flat_map(|&t| record.sigmas_at(t)).copied().collect();
        let from = mirror.starts();
        let images: Vec<f64> = open
            .iter()
            .flat_map(|&t| match self.is_located(t) {
                true => mirror.beside(&self.position[t * D..]),
                false => from[0],
            })
            .collect();
        let starts = from.iter().map(|start| start.repeat(count));
        let mut costs = vec![f64::INFINITY; count];
        let mut best = Self::empty(count, width, D);
        for initial in std::iter::once(images).chain(starts) {
            let mut new = Self::empty(count, width, D);
            new.fill::<D>(record, open, values, &sigmas, Some(&initial), REDUNDANCY);
            for at in 0..count {
                let cost = new.cost(at, width);
                let is_beside = mirror.distance(&new.position[at * D..]) > 0.0;
                if is_beside && cost < costs[at] {
                    costs[at] = cost;
                    best.take::<D>(at, &new, at, width);
                }
            }
        }
        self.take_all::<D>(open, &best, width);
    }

    /// Cost of the residuals of an instant; infinite if it has no position.
    fn cost(&self, t: usize, width: usize) -> f64 {
        if !self.is_located(t) {
            return f64::INFINITY;
        }
        let residuals = self.residual[t * width..][..width].iter().filter(|r| !r.is_nan());
        residuals.map(|r| (r * r).min(MOST)).sum()
    }

    /// Locates again, without outliers, the instants that have outliers or whose measurements have changed.
    pub(in crate::trajectory) fn without<const D: usize>(
        mut self,
        record: &Record<'_>,
        measured: &Measured<D>,
        is_outlier: impl Fn(usize) -> bool,
    ) -> Self {
        let width = record.width();
        let is_other = |at: usize| {
            let (value, old) = (measured.values[at], record.values[at]);
            !old.is_nan() && (is_outlier(at) || value != old)
        };
        let open: Vec<usize> =
            (0..record.len()).filter(|t| (t * width..(t + 1) * width).any(is_other)).collect();
        let kept = |at: usize| if is_outlier(at) { f64::NAN } else { measured.values[at] };
        let values: Vec<f64> =
            open.iter().flat_map(|t| (t * width..(t + 1) * width).map(kept)).collect();
        self.relocate::<D>(record, &open, &values);
        self
    }

    /// Locates these instants from these values.
    fn relocate<const D: usize>(&mut self, record: &Record<'_>, open: &[usize], values: &[f64]) {
        self.relocate_as::<D>(record, open, values, 1.0);
    }

    /// Locates these instants from these values, with the stated noise multiplied by a factor.
    fn relocate_as<const D: usize>(
        &mut self,
        record: &Record<'_>,
        open: &[usize],
        values: &[f64],
        factor: f64,
    ) {
        let width = record.width();
        let mut new = Self::empty(open.len(), width, D);
        let sigmas: Vec<f64> =
            open.iter().flat_map(|&t| record.sigmas_at(t)).map(|sigma| factor * sigma).collect();
        new.fill::<D>(record, open, values, &sigmas, None, REDUNDANCY);
        self.take_all::<D>(open, &new, width);
    }

    /// Locates these instants with searches from these positions.
    pub(in crate::trajectory) fn relocate_from<const D: usize>(
        &mut self,
        record: &Record<'_>,
        open: &[usize],
        values: &[f64],
        initial: &[f64],
    ) {
        let width = record.width();
        let mut new = Self::empty(open.len(), width, D);
        let sigmas: Vec<f64> = open.iter().flat_map(|&t| record.sigmas_at(t)).copied().collect();
        let own = rows(values, open, width);
        new.fill::<D>(record, open, &own, &sigmas, Some(initial), REDUNDANCY);
        self.take_all::<D>(open, &new, width);
    }

    /// Copies the instants of `other` to these instants.
    fn take_all<const D: usize>(&mut self, open: &[usize], other: &Self, width: usize) {
        for (at, &t) in open.iter().enumerate() {
            self.take::<D>(t, other, at, width);
        }
    }

    /// Copies instant `at` of `other` to instant t.
    fn take<const D: usize>(&mut self, t: usize, other: &Self, at: usize, width: usize) {
        copy(&mut self.position, t, &other.position, at, D);
        copy(&mut self.covariance, t, &other.covariance, at, D * D);
        copy(&mut self.residual, t, &other.residual, at, width);
        copy(&mut self.outlier, t, &other.outlier, at, width);
        self.fixes[t] = other.fixes[at];
    }

    /// Returns the fixes, or the reasons if no instant is located.
    pub(in crate::trajectory) fn located(self) -> Result<Self, Failure> {
        if (0..self.fixes.len()).any(|t| self.is_located(t)) {
            return Ok(self);
        }
        let mut reasons: Vec<u8> = self.fixes.iter().map(|fix| fix.status as u8).collect();
        reasons.sort_unstable();
        reasons.dedup();
        Err(Failure::NotLocated(reasons))
    }

    fn empty(n: usize, width: usize, d: usize) -> Self {
        Self {
            position: vec![f64::NAN; n * d],
            covariance: vec![f64::NAN; n * d * d],
            residual: vec![f64::NAN; n * width],
            outlier: vec![false; n * width],
            fixes: vec![Fix::UNKNOWN; n],
        }
    }

    fn fill<const D: usize>(
        &mut self,
        record: &Record<'_>,
        instants: &[usize],
        values: &[f64],
        sigmas: &[f64],
        initial: Option<&[f64]>,
        redundancy: usize,
    ) {
        let width = record.width();
        let method = if record.robust { Method::Robust(redundancy) } else { Method::LeastSquares };
        let locator = Locator::new(method).with_correlation(record.correlation);
        let cost = LOCATE_NS * values.len() as f64;
        let (heights, last) = (record.heights(), KINDS * record.receivers());
        let outputs = self
            .position
            .chunks_mut(D * BLOCK)
            .zip(self.covariance.chunks_mut(D * D * BLOCK))
            .zip(self.residual.chunks_mut(width * BLOCK))
            .zip(self.outlier.chunks_mut(width * BLOCK))
            .zip(self.fixes.chunks_mut(BLOCK));
        let blocks = instants.chunks(BLOCK).zip(outputs).enumerate();
        // the closure never fails
        let _ = for_each_row(
            blocks,
            cost,
            record.n_threads,
            Workspace::default,
            |workspace: &mut Workspace<D>, (block, (own, out))| {
                let ((((position, covariance), residual), outlier), fixes) = out;
                let at = |i: usize| (block * BLOCK + i) * width;
                let height = |i: usize| {
                    let known =
                        heights.map(|column| (values[at(i) + column], sigmas[at(i) + column]));
                    known.filter(|known| !known.0.is_nan())
                };
                let given: Vec<_> = own
                    .iter()
                    .enumerate()
                    .map(|(i, &t)| Instant {
                        stations: record.stations_at(t, D),
                        axes: record.axes_at(t, D),
                        values: &values[at(i)..][..last],
                        sigmas: &sigmas[at(i)..][..last],
                        position_sigmas: None,
                        height: height(i).or_else(|| {
                            anywhere::<D>(record.stations_at(t, D), &values[at(i)..][..last])
                        }),
                        initial: initial.map(|own| &own[(block * BLOCK + i) * D..][..D]),
                    })
                    .collect();
                let mut out = Output::rows((position, covariance), (residual, outlier), (D, width));
                for own in &mut out {
                    // heights are judged below
                    own.residual = &mut std::mem::take(&mut own.residual)[..last];
                    own.outlier = &mut std::mem::take(&mut own.outlier)[..last];
                }
                locator.locate_all(&given, &mut out, fixes, workspace);
                Ok(())
            },
        );
        self.judge_heights::<D>(record, values, sigmas);
    }

    /// Compares the heights, which no station has measured, with the positions.
    fn judge_heights<const D: usize>(
        &mut self,
        record: &Record<'_>,
        values: &[f64],
        sigmas: &[f64],
    ) {
        let Some(column) = record.heights() else { return };
        for t in (0..self.fixes.len()).filter(|&t| self.fixes[t].status == Status::None) {
            let at = t * record.width() + column;
            let residual = (values[at] - self.position[t * D + D - 1]) / sigmas[at];
            let is_redundant = self.fixes[t].degrees_of_freedom >= REDUNDANCY as i64;
            self.residual[at] = residual;
            self.outlier[at] = record.robust && is_redundant && residual.abs() >= TUKEY;
        }
    }

    pub(in crate::trajectory) fn is_located(&self, t: usize) -> bool {
        self.fixes[t].status == Status::None
    }
}

/// Height near those of the stations, with a very large standard deviation, for instants with azimuths only,
/// which determine no height.
fn anywhere<const D: usize>(stations: &[f64], values: &[f64]) -> Option<(f64, f64)> {
    let k = values.len() / KINDS;
    let is_known = |kind: usize| values[kind * k..][..k].iter().any(|value| !value.is_nan());
    let azimuth = Kind::Azimuth as usize;
    let alone = (0..KINDS).all(|kind| is_known(kind) == (kind == azimuth));
    let mean = || stations.chunks_exact(D).map(|p| p[D - 1]).sum::<f64>() / k as f64;
    (D > 2 && alone).then(|| (mean(), ANYWHERE))
}

/// Returns some rows of a table of this width.
fn rows(table: &[f64], some: &[usize], width: usize) -> Vec<f64> {
    some.iter().flat_map(|row| &table[row * width..][..width]).copied().collect()
}

fn copy<T: Copy>(to: &mut [T], t: usize, from: &[T], at: usize, size: usize) {
    to[t * size..][..size].copy_from_slice(&from[at * size..][..size]);
}

/// Returns the column with whose arrivals those of each column are compared, and the columns in an order in
/// which each comes after the one it is compared with. That is the column with the most arrivals or, if the two
/// have fewer than two instants in common, as where pairs of stations measure in turn, one that is compared
/// itself.
fn references(record: &Record<'_>, values: &[f64]) -> (Vec<Option<usize>>, Vec<usize>) {
    let (width, k) = (record.width(), record.width() / KINDS);
    let arrivals = Kind::Arrival as usize * k..(Kind::Arrival as usize + 1) * k;
    let mut common = vec![0_usize; k * k];
    for own in values.chunks_exact(width).map(|own| &own[arrivals.clone()]) {
        let heard: Vec<usize> = (0..k).filter(|&i| !own[i].is_nan()).collect();
        for &i in &heard {
            heard.iter().for_each(|&j| common[i * k + j] += 1);
        }
    }
    let first = (0..k).rev().max_by_key(|i| common[i * k + i]).unwrap_or(0);
    let mut reference = vec![None; width];
    let (mut known, mut open): (Vec<usize>, Vec<usize>) = (0..k).partition(|&i| i == first);
    reference[arrivals.start + first] = Some(arrivals.start + first);
    let by = |i: usize, j: usize| common[i * k + j];
    while let Some((i, j)) = open
        .iter()
        .flat_map(|&i| known.iter().map(move |&j| (i, j)))
        .filter(|&(i, j)| by(i, j) > 1)
        .max_by_key(|&(i, j)| (j == first, by(i, j)))
    {
        reference[arrivals.start + i] = Some(arrivals.start + j);
        known.push(i);
        open.retain(|&other| other != i);
    }
    let others = (0..width).filter(|column| !arrivals.contains(column));
    let order = others.chain(known.into_iter().map(|i| arrivals.start + i)).collect();
    (reference, order)
}

/// Returns running medians of the measurements of each column around these instants, of arrivals relative to
/// those of the station with the most arrivals; nan where the nearest measurement is farther away than the
/// median interval between measurements.
fn running_medians(record: &Record<'_>, values: &[f64], open: &[usize]) -> Vec<f64> {
    let (width, time) = (record.width(), record.time);
    let mut medians = vec![f64::NAN; open.len() * width];
    let (references, order) = references(record, values);
    for column in order {
        let turns = record.kind_of(column) == Kind::Azimuth as usize;
        // each instant has its own emission time, so arrivals are taken relative to another station
        let reference = references[column];
        let value = |t: usize| {
            let of = |column: usize| values[t * width + column];
            of(column) - reference.map_or(0.0, of)
        };
        let known: Vec<usize> = (0..record.len()).filter(|&t| !value(t).is_nan()).collect();
        let mut gaps: Vec<f64> = known.windows(2).map(|at| time[at[1]] - time[at[0]]).collect();
        if gaps.is_empty() {
            continue;
        }
        let longest = upper_median(&mut gaps);
        for (own, &t) in medians.iter_mut().skip(column).step_by(width).zip(open) {
            let after = known.partition_point(|&at| at < t);
            let around = after.saturating_sub(1)..(after + 1).min(known.len());
            let far = |at: &usize| (time[known[*at]] - time[t]).abs();
            let closest = around.min_by(|a, b| far(a).total_cmp(&far(b)));
            let Some(at) = closest.filter(|at| far(at) <= longest) else { continue };
            let first = at.saturating_sub(RUNNING / 2).min(known.len().saturating_sub(RUNNING));
            let last = (first + RUNNING).min(known.len());
            let centre = value(known[at]);
            let of = |t: &usize| if turns { nearest(value(*t), centre, TAU) } else { value(*t) };
            let mut near: Vec<f64> = known[first..last].iter().map(of).collect();
            *own = upper_median(&mut near);
        }
        // the first station is at 0
        let Some(other) = reference.filter(|&other| references[other] != Some(other)) else {
            continue;
        };
        for own in medians.chunks_exact_mut(width) {
            own[column] += own[other];
        }
    }
    medians
}
