//! Systematic errors of radars, scan by scan, and their effect on the covariances of tracks.
//!
//! One Gaussian of the errors of all radars is updated by the blocks of plots that end in a scan. The cost is
//! that of a factorisation of 4 K unknowns per scan; only the number of blocks grows with the number of
//! targets.

use super::alarm::Alarm;
use super::block::Unknowns;
use super::change::Scan;
use super::clusters::Clusters;
use super::effect::{Blocks, units};
use super::exchange::{Update, Updates};
use super::followed::Followed;
use super::gaussian::Gaussian;
use super::recording::{STATED, believed};
use super::sighting::{CLOCK, ERRORS, Errors, KINDS, Report, Sighting, azimuth_sigma};
use super::targets::{TargetPlot, for_each, numbered, scans};
use super::tracks::Roster;
use super::vote::{suspects, vote};
use super::watch::Watch;
use crate::base::state::{restored, saved};
use crate::sensors::Radar;
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

mod deviation;
mod learn;
mod step;

/// Largest change at once of the clock error by which plots of a radar are corrected, in scans: larger ones
/// would put plots before those that were already tracked.
const CLOCK_STEP: f64 = 0.25;
/// Largest number of redundant measurements by which the noise is known.
const MEMORY: f64 = 150.0;
/// Time within which a sudden change is searched, s, and its size in standard deviations of the prior.
const CHANGE_TIME: f64 = 30.0;
const CHANGE: f64 = 3.0;
/// Variance that a vote adds to the errors of a radar, in units of that of the prior.
const VOTED: f64 = 0.5;
/// Range at which an unknown gain counts as noise of the range, m, and speed at which an unknown clock error
/// does, m/s: at most, and at least.
const FAR: [f64; 2] = [80e3, 200.0];
const NEAR: [f64; 2] = [10.0, 1.0];
/// Share of the variance of errors of radars that moves targets as if their delays differed; most of it moves
/// neighbours alike.
const APART: f64 = 0.25;
/// Largest number of blocks that are open at once: this number of targets suffices.
const OPEN: usize = 32;
/// Number of redundant measurements that noise is worth after it has grown suddenly.
const GROWN: f64 = 20.0;
/// Probability of a turn above which innovations are not used for the noise.
const TURNING: f64 = 0.3;
/// Scans of the slowest radar after which a track without rows is dropped.
const FORGOTTEN: f64 = 10.0;

/// Estimates the errors of radars during tracking.
#[derive(Clone, Debug, Serialize, Deserialize, PartialEq)]
pub struct Registrar {
    radars: Vec<Radar>,
    /// Whether ranges of each radar are slant if no height is known; true for all as soon as any height is
    /// reported.
    slant: Vec<bool>,
    sigma: Vec<Errors>,
    /// Prior means of the errors, in their units.
    start: Vec<Errors>,
    /// Estimate of the differences from these means, in units of the prior.
    known: Gaussian,
    clusters: Clusters,
    /// Variances by which errors still differ between targets, in units of the prior; empty if they do not.
    apart: DVector<f64>,
    /// Factor by which blocks overstate what is known of the errors.
    excess: f64,
    /// Clock errors by which plots are corrected, s.
    clocks: Vec<f64>,
    factor: Vec<[f64; 2]>,
    squares: Vec<[f64; 2]>,
    redundancy: Vec<[f64; 2]>,
    watches: Vec<[Watch; 2]>,
    alarms: Vec<Alarm>,
    /// Standard deviations of the differences between the delays of targets, s; 0 where there are none.
    delays: Vec<f64>,
    time: f64,
    /// Time at which targets are next searched for deviations of azimuths.
    looked: f64,
    /// Whether `clusters` contains only blocks for which the noise was known.
    knows_noise: bool,
    open: BTreeMap<i64, Vec<TargetPlot>>,
    tracks: Roster,
    /// Plots of the last scans that no confirmed track has taken.
    loose: Vec<Report>,
    recent: Vec<Scan>,
    changes: Vec<(f64, usize)>,
}

impl Registrar {
    /// Sets up a registrar of radars whose ranges may be `slant` if no height is known. `start` and `sigma`
    /// are the prior means and standard deviations of the errors, where a sigma of 0 means no error. Errors
    /// drift back to the means at the rates `drift`, 1/s; 0: constant. Deviations of azimuths are estimated once
    /// targets show that there are any.
    ///
    /// # Panics
    /// If the lengths differ.
    pub fn new(
        radars: Vec<Radar>,
        slant: Vec<bool>,
        start: Vec<Errors>,
        sigma: Vec<Errors>,
        drift: &[Errors],
    ) -> Self {
        let k = radars.len();
        assert_eq!([slant.len(), start.len(), sigma.len(), drift.len()], [k; 4]);
        let unknown = sigma.iter().flatten().zip(drift.iter().flatten());
        let rates = unknown.filter(|(sigma, _)| **sigma > 0.0).map(|(_, rate)| *rate).collect();
        Self {
            clocks: start.iter().map(|errors| errors[CLOCK]).collect(),
            radars,
            slant,
            sigma,
            start,
            known: Gaussian::new(rates),
            clusters: Clusters::default(),
            apart: DVector::zeros(0),
            excess: 1.0,
            factor: vec![[1.0; 2]; k],
            squares: vec![[0.0; 2]; k],
            redundancy: vec![[0.0; 2]; k],
            watches: vec![<[Watch; 2]>::default(); k],
            alarms: vec![Alarm::default(); k],
            delays: vec![0.0; k],
            time: f64::NEG_INFINITY,
            looked: f64::NEG_INFINITY,
            knows_noise: false,
            open: BTreeMap::new(),
            tracks: Roster::default(),
            loose: Vec::new(),
            recent: Vec::new(),
            changes: Vec::new(),
        }
    }

    /// Sets by how much the delays of the reports of each sensor differ between targets: standard deviations,
    /// s; 0 if they do not differ.
    ///
    /// # Panics
    /// If the length differs.
    pub fn set_delays(&mut self, sigmas: &[f64]) {
        self.delays.copy_from_slice(sigmas);
    }

    /// Returns the errors of each radar.
    pub fn errors(&self) -> Vec<Errors> {
        let mut errors = self.start.clone();
        for_each(&self.unknowns(), |k, j, column, sigma| {
            errors[k][j] += self.known.mean[column] * sigma;
        });
        errors
    }

    /// Returns the errors by which plots are corrected: a clock error changes by at most a quarter of a scan
    /// at once.
    pub fn taken_out(&self) -> Vec<Errors> {
        let mut errors = self.errors();
        for (own, clock) in errors.iter_mut().zip(&self.clocks) {
            own[CLOCK] = *clock;
        }
        errors
    }

    /// Returns the standard deviations of the errors, larger for kinds of errors that clearly exceed their
    /// prior.
    pub fn sigmas(&self) -> Vec<Errors> {
        self.roots(&self.exceeded())
    }

    /// Returns the standard deviations in a covariance in units of the prior.
    fn roots(&self, covariance: &DMatrix<f64>) -> Vec<Errors> {
        let mut found = vec![[0.0; ERRORS]; self.radars.len()];
        for_each(&self.unknowns(), |k, j, column, sigma| {
            found[k][j] = covariance[(column, column)].max(0.0).sqrt() * sigma;
        });
        found
    }

    /// Returns the covariance of the errors that are the same in all directions, radar after radar, allowing for
    /// errors that are larger than their prior says.
    pub(crate) fn covariance(&self) -> DMatrix<f64> {
        let order = KINDS * self.radars.len();
        let (relaxed, mut all) = (self.relaxed(), DMatrix::zeros(order, order));
        let unknowns = self.unknowns();
        for_each(&unknowns, |k, j, row, sigma| {
            for_each(&unknowns, |l, i, column, other| {
                if j < KINDS && i < KINDS {
                    let place = (KINDS * k + j, KINDS * l + i);
                    all[place] = relaxed[(row, column)] * sigma * other;
                }
            });
        });
        all
    }

    /// Returns this covariance in units of the prior, if all errors of a kind may be larger than the prior
    /// says.
    fn relaxed(&self) -> DMatrix<f64> {
        self.known.relaxed(&self.kinds())
    }

    /// Returns the covariance in units of the prior, larger for kinds of errors that clearly exceed it.
    fn exceeded(&self) -> DMatrix<f64> {
        self.known.exceeded(&self.kinds())
    }

    /// Returns the kind of each unknown error.
    fn kinds(&self) -> Vec<usize> {
        let mut kinds = vec![0; self.known.mean.len()];
        for_each(&self.unknowns(), |_, j, column, _| kinds[column] = j);
        kinds
    }

    /// Returns the state of the registrar as bytes.
    pub fn to_bytes(&self) -> Vec<u8> {
        saved(self)
    }

    /// Returns the registrar from such bytes; none if they are damaged or something else.
    pub fn from_bytes(bytes: &[u8]) -> Option<Self> {
        restored(bytes)
    }

    /// Returns times and radars of sudden changes.
    pub fn changes(&self) -> &[(f64, usize)] {
        &self.changes
    }

    /// Whether the latest plots of each radar do not fit their tracks: its plots are then not to confirm
    /// other tracks.
    pub fn held(&self) -> Vec<bool> {
        self.alarms.iter().map(|alarm| alarm.holds(self.time)).collect()
    }

    /// Returns the standard deviations of range (m) and azimuth (rad) with which plots of each radar are to
    /// be tracked: the estimated noise, with the uncertainty of the errors.
    pub fn noise(&self) -> Vec<[f64; 2]> {
        let (sigmas, farthest) = (self.roots(&self.known.covariance), self.farthest());
        let one = |(k, sigmas): (usize, Errors)| {
            let ([offset, gain, _, clock, ..], azimuth) = (sigmas, azimuth_sigma(&sigmas));
            let [far, speed] = farthest[k];
            let late = 0.5 * (speed * clock).powi(2);
            let [range, angle] = self.own_noise(k);
            let unknown = offset.hypot(far * gain).powi(2) + late;
            [
                (range * range + unknown).sqrt(),
                (angle * angle + azimuth * azimuth + late / (far * far)).sqrt(),
            ]
        };
        sigmas.into_iter().enumerate().map(one).collect()
    }

    /// Returns the largest distance of a confirmed track from each radar that sees it, and the largest speed, within
    /// the limits; the upper limits where there is no track. Cost O(tracks).
    fn farthest(&self) -> Vec<[f64; 2]> {
        let mut squares = vec![[0.0_f64; 2]; self.radars.len()];
        for track in self.tracks.all().filter(|track| track.was_confirmed()) {
            let ([x, y], [u, v]) = (track.position, track.velocity);
            for own in &track.parts {
                let ([east, north, _], most) =
                    (self.radars[own.radar].position, &mut squares[own.radar]);
                most[0] = most[0].max((x - east).powi(2) + (y - north).powi(2));
                most[1] = most[1].max(u * u + v * v);
            }
        }
        let limited = |own: [f64; 2]| {
            if own == [0.0; 2] {
                return FAR;
            }
            std::array::from_fn(|i| own[i].sqrt().clamp(NEAR[i], FAR[i]))
        };
        squares.into_iter().map(limited).collect()
    }

    /// Returns the noise of each radar, of range and azimuth: the estimated one, or the stated one if it is larger.
    pub(crate) fn largest_noise(&self) -> Vec<[f64; 2]> {
        let largest = |(k, radar): (usize, &Radar)| {
            let [range, azimuth] = self.own_noise(k);
            [range.max(radar.range_sigma), azimuth.max(radar.azimuth_sigma)]
        };
        self.radars.iter().enumerate().map(largest).collect()
    }

    /// Returns the mean variance, s², of what the remaining errors of these radars change in the delay of a
    /// target.
    ///
    /// # Panics
    /// If the length differs.
    pub fn unsure(&self, radars: &[bool]) -> f64 {
        let sigmas = self.roots(&self.known.covariance);
        assert_eq!(radars.len(), sigmas.len());
        let own = sigmas.iter().zip(self.farthest()).zip(radars).filter(|(_, is_radar)| **is_radar);
        let (sum, count) = own.fold((0.0, 0.0), |(sum, count), ((sigmas, [far, speed]), _)| {
            let ([offset, gain, ..], azimuth) = (sigmas, azimuth_sigma(sigmas));
            let place = offset * offset + far * far * (gain * gain + azimuth * azimuth);
            (sum + 0.5 * APART * place / (speed * speed), count + 1.0)
        });
        sum / f64::max(count, 1.0)
    }

    /// Returns the estimated noise of a radar.
    fn own_noise(&self, k: usize) -> [f64; 2] {
        let (radar, [range, azimuth]) = (&self.radars[k], self.believed(k));
        [radar.range_sigma * range, radar.azimuth_sigma * azimuth]
    }

    /// Returns estimated over stated noise of a radar as far as it is believed.
    fn believed(&self, k: usize) -> [f64; 2] {
        believed(self.factor[k], self.excess)
    }

    fn unknowns(&self) -> Unknowns {
        numbered(&self.sigma)
    }

    /// Moves the tracks for a change of the errors; returns their numbers, the times of their last rows, and
    /// their changes.
    fn shift(&mut self, by: &[Errors]) -> Vec<(i64, f64, [f64; 4])> {
        let shift = |number: i64, track: &mut Followed| {
            let by = track.moved(by);
            for i in 0..2 {
                track.position[i] += by[i];
                track.velocity[i] += by[2 + i];
            }
            (number, track.row_time, by)
        };
        self.tracks.change(shift)
    }

    /// Learns from blocks that end by a time. Returns the noise that was applied before, with and without the
    /// uncertainty of the errors, and the changes of the errors in units of the prior; of deviations, in those of
    /// the azimuth.
    fn begin<U: Updates>(&mut self, updates: &U, time: f64) -> (Vec<[[f64; 2]; 2]>, Vec<Errors>) {
        let own = (0..self.radars.len()).map(|k| self.own_noise(k));
        let applied = self.noise().into_iter().zip(own).map(|(wide, own)| [wide, own]).collect();
        let has_height = |row: usize| updates.get(row).plot.report.height.is_finite();
        if !self.slant.iter().all(|slant| *slant) && (0..updates.count()).any(has_height) {
            self.slant.fill(true);
        }
        let blocks = self.closed(updates, time, scans(&self.radars));
        let (before, changes) = (self.known.mean.clone(), self.changes.len());
        if self.time.is_finite() && time > self.time {
            self.known.drift(time - self.time);
        }
        self.time = self.time.max(time);
        self.step(&blocks, time);
        let (mut moved, unknowns) = (vec![[0.0; ERRORS]; self.radars.len()], self.unknowns());
        let units: Vec<Errors> = unknowns.iter().map(units).collect();
        // after a sudden change, the new errors are not those of the plots before
        if self.changes.len() == changes {
            for_each(&unknowns, |k, j, column, _| {
                // tracks follow a clock whose delays differ between targets by themselves
                if j != CLOCK || self.delays[k] == 0.0 {
                    moved[k][j] = units[k][j] * (self.known.mean[column] - before[column]);
                }
            });
        }
        (applied, moved)
    }

    /// Drops old plots, and searches for radars whose errors have changed.
    fn end(&mut self, loose: &[Report], time: f64) {
        for (alarm, radar) in self.alarms.iter_mut().zip(&self.radars) {
            alarm.look(time, radar.scan_period);
        }
        let longest = scans(&self.radars);
        let errors = self.errors();
        self.loose.retain(|plot| time - plot.time <= longest);
        self.loose.extend(loose.iter().map(|plot| plot.corrected(&errors[plot.radar])));
        self.vote(time);
        let errors = self.errors();
        for ((clock, radar), known) in self.clocks.iter_mut().zip(&self.radars).zip(errors) {
            let most = CLOCK_STEP * radar.scan_period;
            *clock += (known[CLOCK] - *clock).clamp(-most, most);
        }
    }

    /// Sorts plots into blocks, and returns the blocks that end by a time.
    fn closed<U: Updates>(&mut self, updates: &U, time: f64, longest: f64) -> Vec<Vec<TargetPlot>> {
        let mut closed = Vec::new();
        for row in 0..updates.count() {
            if self.open.len() == OPEN && !self.open.contains_key(&updates.target(row)) {
                continue;
            }
            let Update { mut plot, confirmed, velocity, .. } = updates.get(row);
            if !confirmed || !plot.report.is_seen() {
                continue;
            }
            self.blur(&mut plot.report, velocity);
            let block = self.open.entry(plot.target).or_default();
            if block.first().is_some_and(|first| plot.report.time - first.report.time > longest) {
                closed.push(std::mem::take(block));
            }
            block.push(plot);
        }
        self.open.retain(|_, block| {
            let ends = block.first().is_none_or(|first| time - first.report.time > longest);
            if ends {
                closed.push(std::mem::take(block));
            }
            !ends
        });
        closed
    }

    /// Adds, to the covariance of a reported position, that of the delay of its target.
    fn blur(&self, report: &mut Report, [u, v]: [f64; 2]) {
        let (sigma, stated) = (self.delays[report.radar], self.radars[report.radar].range_sigma);
        if let Some(place) = report.place.as_mut().filter(|_| sigma > 0.0) {
            if place.covariance[0].is_nan() {
                place.covariance = [stated * stated, 0.0, stated * stated];
            }
            let variance = sigma * sigma;
            let late = [variance * u * u, variance * u * v, variance * v * v];
            (0..3).for_each(|i| place.covariance[i] += late[i]);
        }
    }

    /// Arranges this covariance of the errors, in units of the prior, by radars.
    fn blocks(&self, covariance: DMatrix<f64>) -> Blocks {
        Blocks::new(&self.of_target(covariance), &self.unknowns())
    }

    /// Raises noise that has suddenly grown beyond the noise `used`, and counts plots that are far off.
    fn watch(&mut self, update: &Update, seen: &Sighting, used: [f64; 2]) {
        let turns = update.plot.turn_probability > TURNING;
        if !update.confirmed || seen.is_placed || turns || update.innovation[0].is_nan() {
            return;
        }
        let k = seen.radar;
        let scans = update.plot.report.time / self.radars[k].scan_period;
        self.alarms[k].see(update.distance());
        let (used, noise) = (seen.noise(used), seen.noise(self.own_noise(k)));
        for axis in 0..2 {
            let (found, sigmas) = (update.along(seen.axes[axis].into()), [used[axis], noise[axis]]);
            if let Some(growth) = self.watches[k][axis].see(scans, found, sigmas) {
                let square = growth * self.factor[k][axis].powi(2);
                self.factor[k][axis] = square.sqrt();
                self.redundancy[k][axis] = GROWN;
                self.squares[k][axis] = square * (GROWN + STATED) - STATED;
            }
        }
    }

    /// Moves the clock error of a radar that has jumped by this time, with this standard deviation, s.
    pub(crate) fn move_clock(&mut self, radar: usize, [by, sigma]: [f64; 2], time: f64) {
        if let Some((column, unit)) = self.unknowns()[radar][CLOCK] {
            self.known.mean[column] += by / unit;
            self.known.covariance[(column, column)] += (sigma / unit).powi(2);
            self.restart(radar, time);
        }
    }

    /// Changes the errors of a radar if most of its tracks miss their plots in the same way.
    fn vote(&mut self, time: f64) {
        let unknowns = self.unknowns();
        let suspects = suspects(self.tracks.all(), &self.radars, time);
        for (k, own) in unknowns.iter().enumerate().filter(|(k, _)| suspects[*k]) {
            let found = vote(self.tracks.all(), &self.loose, (k, &self.radars[k]), time);
            let (Some(moved), [Some(range), _, Some(azimuth), ..]) = (found, *own) else {
                continue;
            };
            for ((column, sigma), moved) in [range, azimuth].into_iter().zip(moved) {
                self.known.mean[column] += moved / sigma;
            }
            for (column, _) in own.iter().flatten() {
                self.known.covariance[(*column, *column)] += VOTED;
            }
            self.loose.retain(|plot| plot.radar != k);
            self.restart(k, time);
        }
    }

    /// Starts anew after a change of the errors of a radar; the open blocks may contain plots of other targets.
    fn restart(&mut self, radar: usize, time: f64) {
        self.open.clear();
        self.recent.clear();
        self.clusters.clear();
        self.changes.push((time, radar));
    }
}

#[cfg(test)]
mod tests;
