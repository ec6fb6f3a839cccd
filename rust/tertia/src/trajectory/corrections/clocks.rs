//! Clocks of the stations: a measurement at the time t of a clock that is fast by τ is that of the time
//! t − τ.
//!
//! Measurements are taken to the instants nearest to their times, or to further instants. The rest of the
//! difference of times is at most half an interval. A target that is at x(s) looks from a station as one at
//! x(t) looks from the same station moved by x(t) − x(s): the stations move with the path, and all else
//! remains as it is.
//!
//! A further error of a clock changes a measurement by minus its rate along the path. It is estimated like a
//! constant error, whose effect varies over time, from contradictions between stations. An error that all
//! clocks have in common moves the path along itself and causes no contradictions, so it is known as well as
//! before. Path and clocks are estimated in turns, as by Gauss and Newton. O(N K log N) for each turn, besides
//! the cost of the path and of the lasting errors.

use crate::base::small::Vector;
use crate::sensors::{KINDS, Kind};
use crate::trajectory::instants::fixes::Fixes;
use crate::trajectory::measured::{Measured, Place, Record};
use crate::trajectory::methods::result::Trajectory;
use crate::trajectory::path::Path;
use crate::trajectory::path::failure::Failure;
use crate::trajectory::search::fit::{Found, Setting};
use crate::trajectory::systematic::lasting;
use crate::trajectory::systematic::prior::Systematic;
use std::rc::Rc;

/// Largest number of turns, and the change of a position in its standard deviations that ends them.
const TURNS: usize = 15;
const SETTLED: f64 = 0.1;
/// Number of turns in which measurements are doubted by what the last change of the clocks changes, and least
/// change for that, relative to the prior.
const DOUBTED: usize = 5;
const SMALL: f64 = 0.02;

/// Whether all measurements belong to the times of their instants.
pub(in crate::trajectory) fn are_right(record: &Record<'_>, systematic: &Systematic) -> bool {
    let known = record.clocks.is_none_or(|clocks| clocks.iter().all(|error| *error == 0.0));
    match systematic {
        Systematic::Flat(_) => known,
        Systematic::Lasting(prior) => known && prior.clocks(record).next().is_none(),
    }
}

/// Estimates the errors of the clocks. Returns the measurements at their times, and the path that fits them.
pub(in crate::trajectory) fn settled<const D: usize, const N: usize>(
    setting: &mut Setting<'_, D, N>,
    mut found: Found<D, N>,
    systematic: &Systematic,
) -> Result<(Timed, Found<D, N>), Failure> {
    let record = setting.record;
    let estimated = |own: &Record<'_>, found: &Found<D, N>| match systematic {
        Systematic::Flat(_) => vec![0.0; record.width() / KINDS],
        Systematic::Lasting(prior) => lasting::clocks(own, found, prior),
    };
    let prior = match systematic {
        Systematic::Flat(_) => 0.0,
        Systematic::Lasting(prior) => {
            prior.sigma[record.width()..].iter().copied().fold(0.0, f64::max)
        }
    };
    let mut clocks = vec![0.0; record.width() / KINDS];
    let mut timed = Timed::new::<D, N>(record, (record.time, &found.path), &clocks);
    timed.widen::<D, N>(record, (record.time, &found.path), prior);
    let (mut before, mut doubt): (Vec<usize>, f64) = ((0..record.len()).collect(), prior);
    for turn in 1.. {
        let own = timed.record(record);
        let mut new = again(setting, &own, &found)?;
        new.clocks.clone_from(&clocks);
        if turn == TURNS || (doubt == 0.0 && is_near(&new, &timed.own, &found, &before)) {
            return Ok((timed, new));
        }
        let old = std::mem::replace(&mut clocks, estimated(&own, &new));
        let step = clocks.iter().zip(&old).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        doubt = if turn < DOUBTED && step > SMALL * prior { step } else { 0.0 };
        let path = (&timed.time[..], &new.path);
        let mut next = Timed::new::<D, N>(record, path, &clocks);
        next.widen::<D, N>(record, path, doubt);
        found = new;
        before = std::mem::replace(&mut timed, next).own;
    }
    unreachable!("the turns are limited")
}

/// Fits a path to the measurements at their times, on the same side of the stations.
fn again<const D: usize, const N: usize>(
    setting: &mut Setting<'_, D, N>,
    record: &Record<'_>,
    found: &Found<D, N>,
) -> Result<Found<D, N>, Failure> {
    let smoother = std::mem::take(&mut setting.smoother);
    let mut own = Setting { record, motion: setting.motion, smoother };
    let measured = Rc::new(Measured::new(record, record.values.to_vec()));
    let mirror = found.sides.as_ref().map(|sides| sides.mirror.clone());
    let (found, _) = Found::sought(&mut own, &measured, mirror, true)?;
    setting.smoother = own.smoother;
    Ok(found)
}

/// Whether two paths are practically the same at these instants of each.
fn is_near<const D: usize, const N: usize>(
    new: &Found<D, N>,
    at: &[usize],
    old: &Found<D, N>,
    at_old: &[usize],
) -> bool {
    at.iter().zip(at_old).all(|(&t, &before)| {
        let (p, q) = (new.path.position::<D>(t), old.path.position::<D>(before));
        let spread = &new.path.covariance[t * D * D..][..D * D];
        let far = |i: usize| (p[i] - q[i]).powi(2) > SETTLED * SETTLED * spread[i * (D + 1)];
        !(0..D).any(far)
    })
}

/// Measurements at the instants nearest to their times, and further instants, as in a record.
pub(in crate::trajectory) struct Timed {
    time: Vec<f64>,
    values: Vec<f64>,
    own_sigmas: Option<Vec<f64>>,
    stations: Vec<f64>,
    axes: Option<Vec<f64>>,
    /// The instants of the record (N), and those at which its measurements are now (N K); none if a station
    /// has not measured.
    own: Vec<usize>,
    moved: Vec<Option<usize>>,
}

impl Timed {
    /// Moves the measurements of clocks with the given errors and these along a path.
    fn new<const D: usize, const N: usize>(
        record: &Record<'_>,
        path: (&[f64], &Path),
        error: &[f64],
    ) -> Self {
        let late: Vec<f64> = (0..error.len())
            .map(|station| error[station] + record.clocks.map_or(0.0, |clocks| clocks[station]))
            .collect();
        let (time, base, own, moved) = rows(record, &late);
        let (width, k) = (record.width(), late.len());
        let each = |size: usize, of: &dyn Fn(usize) -> Vec<f64>| -> Vec<f64> {
            let mut all = Vec::with_capacity(base.len() * size);
            base.iter().for_each(|&t| all.extend(of(t)));
            all
        };
        let mut timed = Self {
            values: vec![f64::NAN; base.len() * width],
            own_sigmas: record.own_sigmas.map(|_| each(width, &|t| record.sigmas_at(t).to_vec())),
            stations: each(k * D, &|t| record.stations_at(t, D).to_vec()),
            axes: record
                .axes
                .map(|_| each(k * D * D, &|t| record.axes_at(t, D).unwrap_or_default().to_vec())),
            time,
            own,
            moved,
        };
        for t in 0..record.len() {
            for station in 0..k {
                if let Some(row) = timed.moved[t * k + station] {
                    let seen = record.time[t] - late[station];
                    timed.take::<D, N>(record, (t, station, row), path, seen);
                }
            }
        }
        if let Some(at) = record.heights() {
            for (t, row) in timed.own.iter().enumerate() {
                timed.values[row * width + at] = record.values[t * width + at];
            }
        }
        timed
    }

    /// Takes the measurements of a station at an instant to a row.
    fn take<const D: usize, const N: usize>(
        &mut self,
        record: &Record<'_>,
        (t, station, row): (usize, usize, usize),
        path: (&[f64], &Path),
        seen: f64,
    ) {
        let (width, k) = (record.width(), record.width() / KINDS);
        for at in (station..KINDS * k).step_by(k) {
            self.values[row * width + at] = record.values[t * width + at];
            if let Some(sigmas) = &mut self.own_sigmas {
                sigmas[row * width + at] = record.sigmas_at(t)[at];
            }
        }
        let (one, size) = (row * k + station, D * D);
        if let (Some(to), Some(from)) = (&mut self.axes, record.axes_at(t, D)) {
            to[one * size..][..size].copy_from_slice(&from[station * size..][..size]);
        }
        let (here, there) =
            (position_at::<D, N>(path, self.time[row]), position_at::<D, N>(path, seen));
        for i in 0..D {
            let by = here[i] - there[i];
            let place = record.stations_at(t, D)[station * D + i];
            self.stations[one * D + i] = place + if by.is_finite() { by } else { 0.0 };
        }
    }

    /// Increases the standard deviations by what clocks that are wrong by this would change. Otherwise
    /// measurements of wrong clocks would be taken for outliers.
    fn widen<const D: usize, const N: usize>(
        &mut self,
        record: &Record<'_>,
        path: (&[f64], &Path),
        by: f64,
    ) {
        if by == 0.0 {
            return;
        }
        let own = self.record(record);
        let mut sigmas: Vec<f64> =
            (0..self.time.len()).flat_map(|t| own.sigmas_at(t)).copied().collect();
        let measured = Measured::<D>::new(&own, self.values.clone());
        for (t, time) in self.time.iter().enumerate() {
            let rows = |time: f64| measured.rows(t, Place::at(&position_at::<D, N>(path, time)));
            for ((m, now), (_, then)) in rows(*time).zip(rows(time - by)) {
                let change = now.residual - then.residual;
                let is_timed = measured.one(m).kind != Kind::Height;
                if is_timed && change.is_finite() {
                    sigmas[t * record.width() + measured.column[m]] *= change.hypot(1.0);
                }
            }
        }
        self.own_sigmas = Some(sigmas);
    }

    /// Returns the record of these measurements.
    pub fn record<'a>(&'a self, record: &Record<'a>) -> Record<'a> {
        Record {
            time: &self.time,
            values: &self.values,
            own_sigmas: self.own_sigmas.as_deref(),
            stations: &self.stations,
            axes: self.axes.as_deref(),
            ..*record
        }
    }

    /// Returns the results at the instants of the record.
    pub fn restored(&self, found: Trajectory) -> Trajectory {
        let smoothed = found.smoothed.map(|mut smoothed| {
            smoothed.covariance = self.at_instants(&smoothed.covariance);
            smoothed.innovation = self.at_instants(&smoothed.innovation);
            smoothed
        });
        let fixes = Fixes {
            position: self.at_instants(&found.fixes.position),
            covariance: self.at_instants(&found.fixes.covariance),
            residual: self.of_measurements(&found.fixes.residual, f64::NAN),
            outlier: self.of_measurements(&found.fixes.outlier, false),
            fixes: self.at_instants(&found.fixes.fixes),
        };
        Trajectory {
            mean: self.at_instants(&found.mean),
            covariance: self.at_instants(&found.covariance),
            smoothed,
            fixes,
            outlier: self.of_measurements(&found.outlier, false),
            residual: self.of_measurements(&found.residual, f64::NAN),
            image: found.image.map(|image| self.at_instants(&image)),
            ..found
        }
    }

    fn at_instants<T: Clone>(&self, all: &[T]) -> Vec<T> {
        let size = all.len() / self.time.len();
        self.own.iter().flat_map(|row| &all[row * size..][..size]).cloned().collect()
    }

    /// Arranges numbers of measurements as in the record.
    fn of_measurements<T: Copy>(&self, all: &[T], missing: T) -> Vec<T> {
        let (n, k) = (self.own.len(), self.moved.len() / self.own.len());
        let width = all.len() / self.time.len();
        let of = |(t, column): (usize, usize)| {
            let is_height = column >= KINDS * k;
            let row = if is_height { Some(self.own[t]) } else { self.moved[t * k + column % k] };
            row.map_or(missing, |row| all[row * width + column])
        };
        (0..n).flat_map(|t| (0..width).map(move |column| (t, column))).map(of).collect()
    }
}

/// Returns the times of all rows, the instant whose stations each row has, the rows of the instants (N), and
/// the rows of the measurements of each station (N K). A measurement goes to the nearest instant, if it is
/// between instants or at most half an interval outside, and if the station has no other one there; otherwise
/// it gets a row of its own.
fn rows(
    record: &Record<'_>,
    late: &[f64],
) -> (Vec<f64>, Vec<usize>, Vec<usize>, Vec<Option<usize>>) {
    let (n, k, width) = (record.len(), late.len(), record.width());
    let mut taken = vec![false; n * k];
    // instants first, then further rows
    let (mut times, mut base) = (record.time.to_vec(), (0..n).collect::<Vec<usize>>());
    let mut moved = vec![None; n * k];
    for at in 0..n * k {
        let (t, station) = (at / k, at % k);
        let own = &record.values[t * width..][..KINDS * k];
        if own.iter().skip(station).step_by(k).all(|value| value.is_nan()) {
            continue;
        }
        let seen = record.time[t] - late[station];
        let near = if late[station] == 0.0 { Some(t) } else { nearest(record.time, seen) };
        moved[at] = Some(match near.filter(|near| !taken[near * k + station]) {
            Some(near) => {
                taken[near * k + station] = true;
                near
            }
            None => {
                times.push(seen);
                base.push(t);
                times.len() - 1
            }
        });
    }
    let mut order: Vec<usize> = (0..times.len()).collect();
    order.sort_by(|a, b| times[*a].total_cmp(&times[*b]));
    let mut place = vec![0; order.len()];
    order.iter().enumerate().for_each(|(row, at)| place[*at] = row);
    moved.iter_mut().flatten().for_each(|row| *row = place[*row]);
    let of = |values: &[f64]| order.iter().map(|at| values[*at]).collect();
    let base = order.iter().map(|at| base[*at]).collect();
    (of(&times), base, place[..n].to_vec(), moved)
}

/// Returns the instant nearest to a time; none if the time is outside by more than half an interval.
fn nearest(times: &[f64], time: f64) -> Option<usize> {
    let after = times.partition_point(|own| *own <= time);
    let last = times.len() - 1;
    let gap = |at: usize| 0.5 * (times[at + 1] - times[at]);
    match after {
        0 => (last > 0 && times[0] - time <= gap(0)).then_some(0),
        _ if after > last => (last > 0 && time - times[last] <= gap(last - 1)).then_some(last),
        _ if time - times[after - 1] <= times[after] - time => Some(after - 1),
        _ => Some(after),
    }
}

/// Returns the position of a path at any time: between instants by cubics with the positions and velocities of
/// both, outside with the acceleration of the end.
fn position_at<const D: usize, const N: usize>(
    (times, path): (&[f64], &Path),
    time: f64,
) -> Vector<D> {
    let after = times.partition_point(|own| *own <= time);
    if after == 0 || after == times.len() {
        let end = after.saturating_sub(1);
        let (own, later) = (&path.mean[end * N..][..N], time - times[end]);
        return std::array::from_fn(|i| {
            own[i] + later * (own[D + i] + 0.5 * later * own[2 * D + i])
        });
    }
    let (first, last) = (&path.mean[(after - 1) * N..][..N], &path.mean[after * N..][..N]);
    let step = times[after] - times[after - 1];
    let s = (time - times[after - 1]) / step;
    std::array::from_fn(|i| {
        let mean = (last[i] - first[i]) / step;
        let bend = (1.0 - s) * (first[D + i] - mean) - s * (last[D + i] - mean);
        first[i] + step * s * (mean + (1.0 - s) * bend)
    })
}
