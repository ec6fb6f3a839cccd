//! The tracker: all tracks and estimates, and how they are updated by plots, scan by scan.

pub(super) mod control;
mod delays;
mod ending;
mod estimates;
mod extended_targets;
pub(super) mod snapshot;

use super::assignment::cluster::Clusters;
use super::clutter::Clutter;
use super::management::azimuths::Azimuths;
use super::management::ended_tracks::Ended;
use super::noise::duplicates::Doubles;
use super::noise::repeats::{ONCE, Repeats, WAITING, next_part};
use super::noise::{Noise, assume, use_found};
use super::plot::level::Level;
use super::plot::{Measured, PlotStatus, Plots};
use super::rows::row::Rows;
use super::scan::{Scan, Sky};
use super::settings::Settings;
use super::track::Track;
use crate::base::batch::{SHARES_PER_THREAD, for_each_part};
use crate::base::error::{Error, Result, require, require_positive};
use crate::base::interrupt::poll;
use crate::base::scratch::Scratch;
use crate::sensors::Radar;
use extended_targets::{Shapes, resolve};
use serde::{Deserialize, Serialize};
use std::num::NonZero;

/// A part of the plots. `now` contains times and indices of the plots to be processed, `levels` the heights
/// of the traffic at the time of each plot. `index` returns the index of a plot among all that were given so
/// far. `times` are the time of the first plot, the time before which plots are assigned, and the end.
pub(super) struct Part<'a, P: ?Sized, I> {
    pub plots: &'a P,
    pub now: &'a [(f64, usize)],
    pub levels: &'a [Level],
    pub index: I,
    pub times: [f64; 3],
}

/// Number of plots in a scan that is worth a thread: it takes about a millisecond to process them.
const PLOTS_PER_THREAD: usize = 1000;

/// A multi-target tracker: its settings, its tracks, and what it has estimated about the plots.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Tracker {
    pub(super) settings: Settings,
    pub(super) tracks: Vec<Track>,
    pub(super) clusters: Clusters,
    /// Ended tracks that may be resumed.
    pub(super) ended: Ended,
    pub(super) clutter: Vec<Clutter>,
    /// Mean and variance of the heights of all plots so far.
    pub(super) level: Level,
    pub(super) doubles: Vec<Doubles>,
    pub(super) noise: Vec<Noise>,
    /// Time up to which everything is processed, s.
    pub(super) time: f64,
    pub(super) next_number: u64,
    /// Number of plots given so far.
    pub(super) plots: usize,
    /// Time of the last single plot that came long after the others, perhaps from a wrong clock.
    pub(super) stray: f64,
    /// Plots that wait for later plots that compete with them.
    pub(super) waiting: Vec<Measured>,
    pub(super) azimuths: Azimuths,
    pub(super) repeats: Repeats,
    /// The shapes of targets that are larger than the resolution of a sensor.
    pub(super) shapes: Shapes,
    #[serde(skip)]
    scan: Scratch<Scan>,
}

impl Tracker {
    /// Creates a tracker without tracks.
    ///
    /// # Errors
    /// Settings outside their domain.
    pub fn try_new(settings: Settings) -> Result<Self> {
        settings.check()?;
        let sensors = 0..settings.radars.len();
        let clutter = sensors.map(|sensor| Clutter::of(&settings, sensor)).collect();
        let (time, stray) = (f64::NEG_INFINITY, f64::NEG_INFINITY);
        let (tracks, waiting, level) = (Vec::new(), Vec::new(), Level::of(settings.heights));
        let doubles = vec![Doubles::default(); settings.radars.len()];
        let noise = settings.radars.iter().map(Noise::new).collect();
        let (clusters, azimuths) = (Clusters::default(), Azimuths::new(&settings));
        Ok(Self {
            settings,
            tracks,
            clusters,
            ended: Ended::default(),
            doubles,
            noise,
            clutter,
            level,
            time,
            next_number: 1,
            plots: 0,
            stray,
            waiting,
            azimuths,
            repeats: Repeats::default(),
            shapes: Shapes::default(),
            scan: Scratch::default(),
        })
    }

    /// Whether there are neither tracks nor plots that wait.
    pub(super) fn is_empty(&self) -> bool {
        self.tracks.is_empty() && self.waits().is_none()
    }

    /// Indices of the first plots of the confirmed tracks.
    pub(super) fn first_plots(&self) -> impl Iterator<Item = usize> {
        self.tracks.iter().filter(|track| track.is_confirmed()).map(|track| track.first.index)
    }

    /// Numbers of all tracks, in ascending order.
    pub fn numbers(&self) -> Vec<u64> {
        let mut numbers: Vec<u64> = self.tracks.iter().map(|track| track.number).collect();
        numbers.sort_unstable();
        numbers
    }

    /// Number that the next new track will get.
    pub(super) fn next_number(&self) -> u64 {
        self.next_number
    }

    /// Adds to the number of plots given so far.
    pub(super) fn count(&mut self, plots: usize) {
        self.plots += plots;
    }

    /// Returns the numbers of the confirmed tracks and their positions `seconds` after `time`: along the
    /// flight plan if the target is believed to follow it, otherwise straight on.
    pub fn extrapolate(&self, seconds: f64) -> Vec<(u64, [f64; 2])> {
        let confirmed = self.tracks.iter().filter(|track| track.is_confirmed());
        confirmed
            .map(|track| {
                let t = self.time - track.time + seconds;
                let guide = track.filter.guide();
                let planned = guide.and_then(|g| g.extrapolate(&track.estimate, &self.settings, t));
                (track.number, planned.unwrap_or_else(|| track.position_at(track.time + t).0))
            })
            .collect()
    }

    /// Number of plots given so far.
    pub fn plots(&self) -> usize {
        self.plots
    }

    /// Number of radars.
    pub fn radars(&self) -> usize {
        self.settings.radars.len()
    }

    /// Sets the standard deviations of range (m) and azimuth (rad) of each radar.
    ///
    /// # Errors
    /// A number that is not positive.
    pub fn set_noise(&mut self, noise: &[[f64; 2]]) -> Result<()> {
        for (radar, [range_sigma, azimuth_sigma]) in self.settings.radars.iter_mut().zip(noise) {
            require_positive("range_sigma", *range_sigma)?;
            require_positive("azimuth_sigma", *azimuth_sigma)?;
            [radar.range_sigma, radar.azimuth_sigma] = [*range_sigma, *azimuth_sigma];
        }
        Ok(())
    }

    /// Sets the radars that confirm no tracks for now.
    pub fn hold(&mut self, radars: Vec<bool>) {
        self.settings.held = radars;
    }

    /// Shifts tracks: `moved` contains the number of a track, a time, and the shift of position and velocity
    /// at that time, in ascending order of the numbers.
    pub fn shift(&mut self, moved: &[(u64, f64, [f64; 4])]) {
        // tracks are in this order, too, except those that continue under an older number
        let mut next: usize = 0;
        for track in &mut self.tracks {
            let before = next.checked_sub(1).map_or(0, |at| moved[at].0);
            let later = moved.get(next).map_or(u64::MAX, |own| own.0);
            if track.number <= before || track.number > later {
                next = moved.partition_point(|own| own.0 < track.number);
            }
            if let Some(&(_, time, by)) = moved.get(next).filter(|own| own.0 == track.number) {
                track.shift(time, by);
                next += 1;
            }
        }
    }

    /// Starts again as if the last `plots` plots had not been given: without tracks, but with numbers of
    /// tracks that were not used before. The estimates of clutter and noise are kept.
    pub fn restart(&mut self, plots: usize) {
        self.tracks.clear();
        self.settings.plans.free(|_| true);
        for (sensor, clutter) in self.clutter.iter_mut().enumerate() {
            let before = std::mem::replace(clutter, Clutter::of(&self.settings, sensor));
            clutter.learn(&before);
        }
        self.noise.iter_mut().for_each(Noise::restart);
        self.settings.delays.iter_mut().flatten().for_each(|own| own.sigma = 0.0);
        self.waiting.clear();
        self.azimuths.clear();
        self.repeats = Repeats::default();
        self.shapes = Shapes::default();
        self.level = Level::of(self.settings.heights);
        (self.time, self.stray) = (f64::NEG_INFINITY, f64::NEG_INFINITY);
        self.plots = self.plots.saturating_sub(plots);
    }

    /// Time up to which everything is processed, s; negative infinity at first.
    pub fn time(&self) -> f64 {
        self.time
    }

    /// Processes plots, which may be in any order among themselves, but come after those of earlier calls.
    /// All plots up to `end` have arrived; the default is the time of the last plot. The status of each plot
    /// is written to `statuses`, the rows of the tracks to `rows`. The results do not depend on the number of
    /// threads. Cost O(P log P + tracks).
    ///
    /// # Errors
    /// The index of a radar that does not exist, or an end that is not finite.
    pub fn track<P: Plots + Sync + ?Sized, R: Rows>(
        &mut self,
        plots: &P,
        end: Option<f64>,
        statuses: &mut Vec<PlotStatus>,
        rows: &mut R,
        n_threads: Option<NonZero<usize>>,
    ) -> Result<()> {
        self.take(plots, (end, None), statuses, rows, n_threads)
    }

    /// As `track`; for plots that come live, with the indices of those whose times were `refused`.
    pub(super) fn take<P: Plots + Sync + ?Sized, R: Rows>(
        &mut self,
        plots: &P,
        (end, refused): (Option<f64>, Option<&[usize]>),
        statuses: &mut Vec<PlotStatus>,
        rows: &mut R,
        n_threads: Option<NonZero<usize>>,
    ) -> Result<()> {
        self.check(plots, end)?;
        statuses.clear();
        let first = self.plots;
        let order = self.order(plots, (refused, |i| first + i), statuses);
        let levels = self.levels(plots, &order);
        self.plots += plots.len();
        let last = order.last().map_or(self.time, |(time, _)| *time);
        let end = end.unwrap_or(last).max(last).max(self.time);
        let period = self.period();
        let mut scan = std::mem::take(&mut self.scan.0);
        let mut rest = &order[..];
        let mut until = f64::NEG_INFINITY;
        while let Some(next) = self.waits().or(rest.first().map(|p| p.0)) {
            poll();
            // together with the waiting plots no more than a scan, so that no target is in it twice
            let from = f64::max(until, next);
            until = from + ONCE * period;
            let (now, later, end_of_part) = next_part((plots, rest), [from, until], self.known());
            let wait = if end_of_part.is_some() { 0.0 } else { WAITING * period };
            until = end_of_part.unwrap_or(until);
            rest = later;
            let hold = if rest.is_empty() { f64::INFINITY } else { until - wait };
            let (index, times) = (|index| first + index, [next, hold, end]);
            let part = Part { plots, now, levels: &levels, index, times };
            // plots that wait since a call that was interrupted have no status in this one
            let report = |plot: usize, status| {
                if let Some(own) = plot.checked_sub(first) {
                    statuses[own] = status;
                }
            };
            self.stretch(&mut scan, &part, report, rows, n_threads);
        }
        self.scan.0 = scan;
        self.resolve(statuses);
        let threads = threads(n_threads, self.tracks.len());
        self.finish(end, rows, threads);
        self.bury(threads);
        Ok(())
    }

    /// Processes the waiting plots and then a part of the new ones.
    pub(super) fn stretch<P: Plots + Sync + ?Sized, R: Rows>(
        &mut self,
        scan: &mut Scan,
        part: &Part<'_, P, impl Fn(usize) -> usize + Sync>,
        mut report: impl FnMut(usize, PlotStatus),
        rows: &mut R,
        n_threads: Option<NonZero<usize>>,
    ) {
        let &Part { plots, now, levels, ref index, times: [next, hold, end] } = part;
        let threads = threads(n_threads, self.waiting.len() + now.len());
        self.finish(next.min(end), rows, threads);
        self.bury(threads);
        self.see_values(plots, now);
        let assumed = use_found(&mut self.settings.radars, &mut self.noise);
        let shares = self.noise.iter().map(|noise| noise.unidentified.share());
        self.settings.unidentified = shares.collect();
        self.settings.qualities = self.noise.iter().map(Noise::quality).collect();
        let stretches: Vec<f64> = self.settings.radars.iter().map(Radar::stretch).collect();
        let of_each = self.clutter.iter().zip(&self.settings.radars);
        let clutter: Vec<_> = of_each.map(|(own, radar)| own.now(radar)).collect();
        let convert = |&(_, i): &(f64, usize)| {
            let plot = plots.get(i);
            let (radar, stretch) = (&self.settings.radars[plot.radar], stretches[plot.radar]);
            let geometry = self.settings.geometry(plot.radar);
            let level = levels.get(i).unwrap_or(&self.level);
            let mut measured = Measured::new(index(i), &plot, (radar, geometry), stretch, level);
            let (noise, quality) = (&self.noise[plot.radar], self.settings.quality(plot.radar));
            if geometry.is_position() {
                measured.widen((noise.values.variances(), quality.ratio), &noise.individual);
            }
            measured.gain = clutter[plot.radar].gain(&measured);
            measured
        };
        let mut waiting = std::mem::take(&mut self.waiting);
        let first = waiting.len();
        if self.azimuths.any() {
            let others = self.azimuths.take(plots, now, index, &self.settings);
            extend(&mut waiting, &others, threads, convert);
        } else {
            extend(&mut waiting, now, threads, convert);
        }
        for plot in &waiting[first..] {
            self.noise[plot.radar].saw_identity(plot, &self.settings);
        }
        self.shapes.show(&mut self.tracks, &self.settings);
        let groups = self.shapes.combine(&mut waiting, &self.tracks, &self.settings);
        groups.late.iter().for_each(|plot| report(*plot, PlotStatus::Duplicate));
        let oldest = hold - WAITING * self.period();
        let mut sky = Sky {
            settings: &self.settings,
            tracks: &mut self.tracks,
            clusters: &mut self.clusters,
            ended: &mut self.ended,
            clutter: &mut self.clutter,
            doubles: &mut self.doubles,
            noise: &mut self.noise,
            next_number: &mut self.next_number,
            rows,
            threads,
        };
        let shapes = &mut self.shapes;
        scan.process(&mut sky, &mut waiting, [oldest, hold], |plot, status| {
            report(plot, status);
            groups.pass_on(plot, status, shapes, &mut report);
        });
        groups.divide(&mut waiting);
        self.waiting = waiting;
        self.shapes.forget(&self.tracks);
        if self.azimuths.any() {
            let tracks = (&mut self.tracks[..], &self.settings);
            self.azimuths.process(hold, tracks, rows, report);
        }
        self.finish(hold.min(end), rows, threads);
        assume(&mut self.settings.radars, &assumed);
    }

    /// Learns from new plots whether the values of their sensors are rounded.
    fn see_values<P: Plots + ?Sized>(&mut self, plots: &P, now: &[(f64, usize)]) {
        if self.noise.iter().any(|noise| noise.values.may_be_rounded()) {
            for &(_, i) in now {
                let (plot, measured) = (plots.get(i), plots.measured(i));
                self.noise[plot.radar].saw_values(&plot, measured, &self.settings);
            }
        }
    }

    /// Gives the last plots, if some were combined with others, the status of these.
    pub(super) fn resolve(&self, statuses: &mut [PlotStatus]) {
        if self.settings.has_extents() || self.settings.has_reports() {
            resolve(statuses, self.plots - statuses.len());
        }
    }

    /// Time of the first waiting plot.
    pub(super) fn waits(&self) -> Option<f64> {
        let plot = self.waiting.first().map(|plot| plot.time);
        plot.into_iter().chain(self.azimuths.waits()).min_by(f64::total_cmp)
    }

    /// Duration of the shortest scan, s.
    pub(super) fn period(&self) -> f64 {
        let periods = self.settings.radars.iter().map(|radar| radar.scan_period);
        periods.fold(f64::INFINITY, f64::min)
    }

    /// Time without plots after which a single plot is attributed to a wrong clock, s.
    pub(super) fn silence(&self) -> f64 {
        let periods = self.settings.radars.iter().map(|radar| radar.scan_period);
        (self.settings.coasting as f64 + 0.5) * periods.fold(0.0, f64::max)
    }

    pub(super) fn check<P: Plots + ?Sized>(&self, plots: &P, end: Option<f64>) -> Result<()> {
        let radars = self.settings.radars.len();
        if let Some(at) = (0..plots.len()).find(|&i| plots.radar(i) >= radars) {
            let (argument, requirement) = ("radar", "the index of one of the radars");
            let (index, value) = (vec![at], plots.radar(at) as f64);
            return Err(Error::InvalidElement { argument, index, value, requirement });
        }
        let end = end.unwrap_or(0.0);
        require("end", end, end.is_finite(), "a finite number")
    }

    /// Returns the heights of the traffic at the time of each plot, by the index of the plot; empty if all
    /// plots have heights.
    pub(super) fn levels<P: Plots + ?Sized>(
        &mut self,
        plots: &P,
        order: &[(f64, usize)],
    ) -> Vec<Level> {
        let any = order.iter().any(|&(_, index)| plots.height(index).is_nan());
        let mut levels = vec![self.level; if any { plots.len() } else { 0 }];
        for &(_, index) in order {
            let height = plots.height(index);
            if height.is_finite() {
                self.level.add(height);
            }
            if let Some(level) = levels.get_mut(index) {
                *level = self.level;
            }
        }
        levels
    }
}

/// Returns the number of items in a part: each of several threads takes several parts, a single thread takes
/// all.
fn part(items: usize, threads: usize) -> usize {
    let parts = if threads > 1 { threads * SHARES_PER_THREAD } else { 1 };
    items.div_ceil(parts).max(1)
}

/// Appends the result of `make` for each of the items, in the same order.
fn extend<T: Sync>(
    found: &mut Vec<Measured>,
    items: &[T],
    threads: usize,
    make: impl Fn(&T) -> Measured + Sync,
) {
    if threads == 1 {
        return found.extend(items.iter().map(make));
    }
    let start = found.len();
    found.resize(start + items.len(), Measured::default());
    let part = part(items.len(), threads);
    let parts = items.chunks(part).zip(found[start..].chunks_mut(part)).collect();
    for_each_part(threads, parts, |(items, room): (&[T], &mut [Measured])| {
        items.iter().zip(room).for_each(|(item, room)| *room = make(item));
    });
}

/// Returns the number of threads for a scan with this number of plots: as many as requested, or as there are
/// cores, but only one if there are few plots.
fn threads(n_threads: Option<NonZero<usize>>, plots: usize) -> usize {
    let most = plots / PLOTS_PER_THREAD;
    if most < 2 {
        return 1;
    }
    // asking the system takes longer than a small scan
    let available = || std::thread::available_parallelism().map_or(1, NonZero::get);
    n_threads.map_or_else(available, NonZero::get).min(most)
}

mod order;
#[cfg(test)]
mod tests;
