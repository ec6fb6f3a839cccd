//! The tracker: all tracks, and the plots that update them.

use super::clutter::Clutter;
use super::plot::{Measured, Plot, PlotStatus};
use super::row::{Row, Rows};
use super::scan::{Scan, Sky};
use super::settings::Settings;
use super::track::Track;
use crate::base::error::{Error, Result, require};
use serde::{Deserialize, Serialize};
use std::num::NonZero;

/// Share of the shortest scan for which plots wait for others that compete with them.
const WAITING: f64 = 0.125;

/// Plots of a scan that are worth a thread: they take a millisecond.
const PLOTS_PER_THREAD: usize = 1000;

/// All tracks, and the state of the clutter estimate.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Tracker {
    settings: Settings,
    tracks: Vec<Track>,
    clutter: Vec<Clutter>,
    /// Time until which everything is processed.
    time: f64,
    next_number: u64,
    /// Plots given so far.
    plots: usize,
    /// Time of a plot long after the others, perhaps from a wrong clock.
    stray: f64,
}

impl Tracker {
    /// A tracker without tracks.
    ///
    /// # Errors
    /// Settings outside their domain.
    pub fn try_new(settings: Settings) -> Result<Self> {
        settings.check()?;
        let clutter = vec![Clutter::new(settings.clutter_density); settings.radars.len()];
        let (time, stray) = (f64::NEG_INFINITY, f64::NEG_INFINITY);
        Ok(Self { settings, tracks: Vec::new(), clutter, time, next_number: 1, plots: 0, stray })
    }

    /// All that the tracker knows, to the last bit.
    ///
    /// # Panics
    /// Never: what it knows can be written.
    pub fn to_bytes(&self) -> Vec<u8> {
        postcard::to_stdvec(self).expect("vectors grow")
    }

    /// The tracker that was written; none where these are not such bytes.
    pub fn from_bytes(bytes: &[u8]) -> Option<Self> {
        postcard::from_bytes(bytes).ok()
    }

    /// Numbers of the confirmed tracks, and their positions so many seconds after `time`: along their
    /// plans where these are believed, straight on otherwise.
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

    /// Suspends the plan of a confirmed track, also one that it finds later, or resumes it. Returns
    /// whether there is such a track.
    pub fn suspend_plan(&mut self, number: u64, suspended: bool) -> bool {
        let mut tracks = self.tracks.iter_mut();
        let found = tracks.find(|track| track.number == number && track.is_confirmed());
        found.map(|track| track.suspend_plan(suspended)).is_some()
    }

    /// Numbers of the confirmed tracks whose plans are suspended.
    pub fn suspended_plans(&self) -> Vec<u64> {
        let suspended =
            self.tracks.iter().filter(|track| track.is_confirmed() && track.is_suspended());
        suspended.map(|track| track.number).collect()
    }

    /// Number of plots given so far.
    pub fn plots(&self) -> usize {
        self.plots
    }

    /// Number of radars.
    pub fn radars(&self) -> usize {
        self.settings.radars.len()
    }

    /// Time until which everything is processed, s; negative infinity at first.
    pub fn time(&self) -> f64 {
        self.time
    }

    /// Processes plots, in any order among themselves, but after those that came before; by `end` all
    /// plots have arrived (none: the time of the last one). The status of each plot goes to
    /// `statuses`, the rows of tracks to `rows`; the same for any number of threads.
    /// Cost O(P log P + tracks).
    ///
    /// # Errors
    /// The index of a radar that does not exist, or an end that is not finite.
    pub fn track<R: Rows>(
        &mut self,
        plots: &[Plot],
        end: Option<f64>,
        statuses: &mut Vec<PlotStatus>,
        rows: &mut R,
        n_threads: Option<NonZero<usize>>,
    ) -> Result<()> {
        self.check(plots, end)?;
        statuses.clear();
        let mut measured = self.measured(plots, statuses);
        self.refuse_strays(&mut measured, statuses);
        let first = self.plots;
        self.plots += plots.len();
        let last = measured.last().map_or(self.time, |plot| plot.time);
        let end = end.unwrap_or(last).max(last).max(self.time);
        let period =
            self.settings.radars.iter().map(|r| r.scan_period).fold(f64::INFINITY, f64::min);
        let mut scan = Scan::default();
        let mut waiting: Vec<Measured> = Vec::new();
        let mut rest = &measured[..];
        let mut until = f64::NEG_INFINITY;
        while let Some(next) = rest.first().or(waiting.first()) {
            // with the plots that wait no more than a scan: no target is in it twice
            until = f64::max(until, next.time) + (1.0 - 2.0 * WAITING) * period;
            let (now, later) = rest.split_at(rest.partition_point(|plot| plot.time < until));
            self.finish(next.time.min(end), rows);
            self.bury();
            waiting.extend_from_slice(now);
            rest = later;
            let hold = if rest.is_empty() { f64::INFINITY } else { until - WAITING * period };
            let mut sky = Sky {
                settings: &self.settings,
                tracks: &mut self.tracks,
                clutter: &mut self.clutter,
                next_number: &mut self.next_number,
                rows,
                threads: threads(n_threads, waiting.len()),
            };
            let oldest = hold - WAITING * period;
            let report = |plot: usize, status| statuses[plot - first] = status;
            scan.process(&mut sky, &mut waiting, [oldest, hold], report);
            self.finish(hold.min(end), rows);
        }
        self.finish(end, rows);
        self.bury();
        Ok(())
    }

    fn check(&self, plots: &[Plot], end: Option<f64>) -> Result<()> {
        let radars = self.settings.radars.len();
        if let Some(at) = plots.iter().position(|plot| plot.radar >= radars) {
            let (argument, requirement) = ("radar", "the index of one of the radars");
            let (index, value) = (vec![at], plots[at].radar as f64);
            return Err(Error::InvalidElement { argument, index, value, requirement });
        }
        let end = end.unwrap_or(0.0);
        require("end", end, end.is_finite(), "a finite number")
    }

    /// The plots that can be used, by time.
    fn measured(&self, plots: &[Plot], statuses: &mut Vec<PlotStatus>) -> Vec<Measured> {
        let mut measured = Vec::with_capacity(plots.len());
        for (i, plot) in plots.iter().enumerate() {
            let radar = &self.settings.radars[plot.radar];
            let found = Measured::new(self.plots + i, plot, radar);
            let late = plot.time < self.time - radar.scan_period;
            statuses.push(match found {
                Ok(_) if late => PlotStatus::Late,
                Ok(found) => {
                    measured.push(found);
                    PlotStatus::Invalid
                }
                Err(status) => status,
            });
        }
        measured.sort_by(|a, b| a.time.total_cmp(&b.time).then(a.index.cmp(&b.index)));
        measured.dedup_by(|next, plot| {
            let same = next.is_same(plot);
            if same {
                statuses[next.index - self.plots] = PlotStatus::Duplicate;
            }
            same
        });
        measured
    }

    /// Refuses single plots long after the others: with a wrong clock they would end all tracks. A
    /// second plot at about that time shows that there was a gap.
    fn refuse_strays(&mut self, measured: &mut Vec<Measured>, statuses: &mut [PlotStatus]) {
        let period = self.settings.radars.iter().map(|radar| radar.scan_period).fold(0.0, f64::max);
        let silence = (self.settings.coasting as f64 + 0.5) * period;
        let mut before = self.time;
        let mut kept = Vec::with_capacity(measured.len());
        for (i, plot) in measured.iter().enumerate() {
            let follows = plot.time - before <= silence || before == f64::NEG_INFINITY;
            let is_followed = measured.get(i + 1).is_some_and(|p| p.time - plot.time <= silence);
            let is_second = (plot.time - self.stray).abs() <= silence;
            if follows || is_followed || is_second {
                before = plot.time;
                kept.push(*plot);
            } else {
                self.stray = plot.time;
                statuses[plot.index - self.plots] = PlotStatus::ClockError;
            }
        }
        *measured = kept;
    }

    /// Counts missed detections until `end`.
    fn finish<R: Rows>(&mut self, end: f64, rows: &mut R) {
        for track in &mut self.tracks {
            track.miss(end, &self.settings, |track, radar| {
                if track.is_confirmed() {
                    rows.push(&Row::of(track, radar, None));
                }
            });
        }
        self.time = self.time.max(end);
    }

    /// Removes the tracks that have ended.
    fn bury(&mut self) {
        self.tracks.retain(|track| track.is_alive(&self.settings));
    }
}

/// Threads for a scan of so many plots: as many as requested, or all cores; one for few plots.
fn threads(n_threads: Option<NonZero<usize>>, plots: usize) -> usize {
    let most = plots / PLOTS_PER_THREAD;
    if most < 2 {
        return 1;
    }
    // asking the system takes longer than a small scan
    let available = || std::thread::available_parallelism().map_or(1, NonZero::get);
    n_threads.map_or_else(available, NonZero::get).min(most)
}
