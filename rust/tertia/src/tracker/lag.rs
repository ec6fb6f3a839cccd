//! Takes late plots: everything after a late plot is processed again, so that final rows are the same as if
//! all plots had come in order.
//!
//! Time is divided into steps of half the shortest scan. The plots of a step are sorted by content, not by
//! arrival, and a step is final when it is older than the lag. Copies of the state are kept at four instants
//! within the lag; after a late plot, processing starts again from the last copy before it.

use super::live::control::Command;
use super::live::snapshot::Kept;
use super::live::{Part, Tracker};
use super::noise::repeats::{WAITING, next_part};
use super::plot::clock::Clock;
use super::plot::{Plot, PlotStatus, Plots, keep_followed};
use super::rows::row::{Resumed, Row, Rows};
use super::scan::Scan;
use crate::base::error::{Error, require};
use crate::base::interrupt::poll;
use crate::base::state::{restored, saved};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::num::NonZero;

mod commands;
mod judge;
mod sink;
#[cfg(test)]
mod tests;

use sink::{Claim, Sink};

/// Number of steps in the shortest scan: with more steps, less is processed again for plots that come in
/// order.
const STEPS: f64 = 2.0;
/// Number of copies of the state within the lag.
const COPIES: i64 = 4;
/// Number of the step before all others.
const BEFORE_ALL: i64 = i64::MIN;

/// A tracker that takes plots up to `lag` seconds late.
///
/// Rows that are older than the lag are final: they do not depend on the order in which plots came. Younger
/// rows may still be replaced.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct LagTracker {
    tracker: Tracker,
    /// Lag, s; 0: plots are processed as they come.
    lag: f64,
    /// Copies of the state at the beginnings of steps, the last of which is the step of `now`.
    kept: VecDeque<(i64, Kept)>,
    /// Plots of the steps from the first copy on, with their indices.
    journal: BTreeMap<i64, Vec<(Plot, usize)>>,
    /// Commands of a controller, each carried out at the end of its step.
    commands: Vec<(i64, Command)>,
    /// Rows of the steps that are not final, and the number of the next new track after each step.
    steps: VecDeque<Step>,
    /// The rows of these steps as they were last given out, in order of steps.
    shown: Vec<(i64, Row)>,
    /// First step whose rows have not been given out as final.
    open: i64,
    /// Track numbers below this one are final.
    numbered: u64,
    /// Latest time, and (`closed`) the time up to which everything was made final.
    now: f64,
    closed: f64,
    /// Time of the last single plot that came long after the others, perhaps from a wrong clock.
    stray: f64,
    clock: Clock,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
struct Step {
    number: i64,
    next_number: u64,
    rows: Vec<Row>,
    resumed: Vec<Resumed>,
}

/// Plots of a step with their indices.
struct Own<'a>(&'a [(Plot, usize)]);

impl Plots for Own<'_> {
    fn len(&self) -> usize {
        self.0.len()
    }

    fn get(&self, index: usize) -> Plot {
        self.0[index].0
    }
}

impl LagTracker {
    /// Creates a tracker for plots that are up to `lag` seconds late.
    ///
    /// # Errors
    /// A lag that is negative or not finite, or a positive lag with a tracker that has had plots.
    pub fn try_new(tracker: Tracker, lag: f64) -> Result<Self, Error> {
        require("lag", lag, lag >= 0.0 && lag.is_finite(), "0 or a positive number of seconds")?;
        let before = f64::NEG_INFINITY;
        let (plots, may) = (tracker.plots() as f64, lag == 0.0 || tracker.time() == before);
        require("tracker", plots, may, "one that has had no plots, where there is a lag")?;
        let kept = VecDeque::from([(BEFORE_ALL, tracker.keep())]);
        Ok(Self {
            tracker,
            lag,
            kept,
            journal: BTreeMap::new(),
            commands: Vec::new(),
            steps: VecDeque::new(),
            shown: Vec::new(),
            open: BEFORE_ALL,
            numbered: 1,
            now: before,
            closed: before,
            stray: before,
            clock: Clock::default(),
        })
    }

    /// The tracker with all plots so far.
    pub fn tracker(&self) -> &Tracker {
        &self.tracker
    }

    /// The tracker, to be changed; changes hold for plots that come later.
    pub fn tracker_mut(&mut self) -> &mut Tracker {
        &mut self.tracker
    }

    /// Returns the complete state of the tracker as bytes, exact to the last bit.
    ///
    /// # Panics
    /// Never: the state can always be written.
    pub fn to_bytes(&self) -> Vec<u8> {
        saved(self)
    }

    /// Restores a tracker from the result of `to_bytes`; none if these bytes are something else, or are
    /// damaged.
    pub fn from_bytes(bytes: &[u8]) -> Option<Self> {
        restored(bytes)
    }

    /// Processes new plots, as [`Tracker::track`]. First, rows that became final are given out; then, for
    /// each track, the rows that are not final, from the first one that is new or has changed. Cost: that of
    /// all plots since the oldest late plot, or since the last step.
    ///
    /// # Errors
    /// As [`Tracker::track`].
    pub fn track<P: Plots + Sync + ?Sized, R: Rows>(
        &mut self,
        plots: &P,
        end: Option<f64>,
        statuses: &mut Vec<PlotStatus>,
        rows: &mut R,
        n_threads: Option<NonZero<usize>>,
    ) -> Result<(), Error> {
        self.tracker.check(plots, end)?;
        let (refused, end) = self.judge(plots, end, rows, n_threads);
        if self.lag == 0.0 {
            return self.tracker.take(plots, (end, Some(&refused)), statuses, rows, n_threads);
        }
        let first = self.tracker.plots();
        let mut claims = self.file(plots, Some(&refused), end);
        self.run((&mut claims, first), self.step_of(self.now - self.lag), rows, n_threads);
        self.tell(&claims, statuses);
        Ok(())
    }

    /// Returns this tracker with the properties of the plots that a later one has estimated; none if all of
    /// them are as stated or usual.
    #[must_use]
    pub fn knowing(mut self, later: &Self) -> Option<Self> {
        let differs = self.tracker.learn_plots(&later.tracker);
        self.kept = VecDeque::from([(BEFORE_ALL, self.tracker.keep())]);
        differs.then_some(self)
    }

    /// Processes a whole recording: all rows are final.
    ///
    /// # Errors
    /// As [`Tracker::track`].
    pub fn record<P: Plots + Sync + ?Sized, R: Rows>(
        &mut self,
        plots: &P,
        statuses: &mut Vec<PlotStatus>,
        rows: &mut R,
        n_threads: Option<NonZero<usize>>,
    ) -> Result<(), Error> {
        if self.lag == 0.0 {
            return self.tracker.track(plots, None, statuses, rows, n_threads);
        }
        self.tracker.check(plots, None)?;
        let first = self.tracker.plots();
        let mut claims = self.file(plots, None, None);
        self.close((&mut claims, first), rows, n_threads);
        self.tell(&claims, statuses);
        Ok(())
    }

    fn tell(&self, claims: &[Claim], statuses: &mut Vec<PlotStatus>) {
        *statuses = Vec::from_iter(claims.iter().map(|claim| match *claim {
            Ok((number, first)) if number >= self.numbered => PlotStatus::Provisional(first),
            Ok((number, _)) => PlotStatus::Track(number),
            Err(status) => status,
        }));
        self.tracker.resolve(statuses);
    }

    /// Makes all rows final.
    pub fn finish<R: Rows>(&mut self, rows: &mut R, n_threads: Option<NonZero<usize>>) {
        if self.lag > 0.0 {
            self.close((&mut [], usize::MAX), rows, n_threads);
        }
    }

    fn close<R: Rows>(
        &mut self,
        claims: (&mut [Claim], usize),
        rows: &mut R,
        n_threads: Option<NonZero<usize>>,
    ) {
        if self.now == f64::NEG_INFINITY {
            return;
        }
        let last = self.step_of(self.now);
        self.run(claims, last.saturating_add(1), rows, n_threads);
        (self.closed, self.open) = (self.now, last);
        self.journal.clear();
        self.commands.clear();
        self.kept = VecDeque::from([(last, self.tracker.keep())]);
    }

    fn step(&self) -> f64 {
        self.tracker.period() / STEPS
    }

    fn step_of(&self, time: f64) -> i64 {
        (time / self.step()).floor() as i64
    }

    /// Files plots in the journal, and drops the copies of the state after the oldest of these plots. Returns
    /// the reasons why plots are not used, as far as they are known. Plots that are `refused`, because they are
    /// ahead, wait until time has come to them.
    fn file<P: Plots + ?Sized>(
        &mut self,
        plots: &P,
        refused: Option<&[usize]>,
        end: Option<f64>,
    ) -> Vec<Claim> {
        let first = self.tracker.plots();
        let oldest = self.step_of(self.now - self.lag);
        let mut order = Vec::with_capacity(plots.len());
        let mut claims = Vec::with_capacity(plots.len());
        let mut filed = BTreeSet::new();
        for i in 0..plots.len() {
            let plot = plots.get(i);
            let step = self.step_of(plot.time);
            let late = step < oldest || plot.time <= self.closed;
            let settings = &self.tracker.settings;
            let fault = plot.fault(&settings.radars[plot.radar], settings.geometry(plot.radar));
            let fault = fault.or(late.then_some(PlotStatus::Late));
            claims.push(Err(fault.unwrap_or(PlotStatus::ClockError)));
            if fault.is_some() {
                continue;
            }
            if refused.is_none_or(|refused| refused.binary_search(&i).is_err()) {
                order.push((plot.time, i));
            }
            self.journal.entry(step).or_default().push((plot, first + i));
            filed.insert(step);
            while self.kept.len() > 1 && self.kept.back().is_some_and(|(next, _)| *next > step) {
                self.kept.pop_back();
            }
        }
        for step in filed {
            let own = self.journal.entry(step).or_default();
            own.sort_by(|(one, _), (other, _)| one.by_content(other));
        }
        self.tracker.count(plots.len());
        order.sort_by(|a, b| a.0.total_cmp(&b.0));
        let newest = if refused.is_some() {
            order.last().map_or(self.now, |(time, _)| *time)
        } else {
            let silence = self.tracker.silence();
            keep_followed(&mut order, self.now, &mut self.stray, silence, |_| ())
        };
        self.now = end.map_or(newest, |end| end.max(newest)).max(self.now);
        claims
    }

    /// Processes the journal from the last copy up to `now`. Steps before `final_steps` become final.
    fn run<R: Rows>(
        &mut self,
        (claims, first): (&mut [Claim], usize),
        final_steps: i64,
        rows: &mut R,
        n_threads: Option<NonZero<usize>>,
    ) {
        if self.now == f64::NEG_INFINITY {
            return;
        }
        let spacing = ((self.lag / self.step()) as i64 / COPIES).max(1);
        let (mut next, kept) = self.last_kept(spacing);
        let changed = next;
        self.tracker.restore(kept);
        while self.steps.back().is_some_and(|step| step.number >= next) {
            self.steps.pop_back();
        }
        let head = self.step_of(self.now);
        let oldest = head.saturating_sub((COPIES + 1) * spacing);
        let mut scan = Scan::default();
        let tentative = rows.wants(false);
        let mut sink = Sink { rows: Vec::new(), resumed: Vec::new(), claims, first, tentative };
        while let Some(step) = self.next_step(next).filter(|step| *step < head) {
            // an interruption does no harm: a later call needs only the journal and the last copy
            poll();
            let until = (step + 1) as f64 * self.step();
            let hold = until - WAITING * self.tracker.period();
            self.process(&mut scan, step, [until, hold], &mut sink, n_threads);
            self.log(step, &mut sink);
            next = step + 1;
            let last = self.kept.back().map_or(BEFORE_ALL, |(last, _)| *last);
            if next >= oldest && next.saturating_sub(last) >= spacing && next < head {
                self.kept.push_back((next, self.tracker.keep()));
            }
        }
        if self.kept.back().is_none_or(|(last, _)| *last < head) {
            self.kept.push_back((head, self.tracker.keep()));
        }
        self.process(&mut scan, head, [self.now, f64::INFINITY], &mut sink, n_threads);
        self.log(head, &mut sink);
        let renumbered = self.settle(final_steps, rows);
        self.show(final_steps, if renumbered { BEFORE_ALL } else { changed }, rows);
        self.forget(final_steps);
    }

    /// Returns the next step that changes anything.
    fn next_step(&self, next: i64) -> Option<i64> {
        if !self.tracker.is_empty() {
            return Some(next);
        }
        let commands = self.commands.iter().map(|(step, _)| *step).filter(|step| *step >= next);
        let plots = self.journal.range(next..).next().map(|(step, _)| *step);
        commands.chain(plots).min()
    }

    /// Processes the waiting plots and those of a step up to `until`, and assigns those before `hold`.
    fn process(
        &mut self,
        scan: &mut Scan,
        step: i64,
        [until, hold]: [f64; 2],
        sink: &mut Sink<'_>,
        n_threads: Option<NonZero<usize>>,
    ) {
        let filed = self.journal.get(&step).map_or(&[][..], Vec::as_slice);
        let own = Own(&filed[..filed.partition_point(|(plot, _)| plot.time <= until)]);
        let mut statuses = Vec::new();
        let index = |i: usize| own.0[i].1;
        let order = self.tracker.order(&own, (None, index), &mut statuses);
        for ((_, index), status) in own.0.iter().zip(statuses) {
            sink.refuse(*index, status);
        }
        let levels = self.tracker.levels(&own, &order);
        let mut refused = Vec::new();
        let mut report = |plot: usize, status| match status {
            // the sink takes the tracks of plots from the rows
            PlotStatus::Track(_) => {}
            _ => refused.push((plot, status)),
        };
        let (mut rest, mut last) = (&order[..], hold);
        loop {
            let from = self.tracker.waits().or(rest.first().map(|own| own.0)).unwrap_or(hold);
            let known = self.tracker.known();
            let (now, later, end) = next_part((&own, rest), [from, f64::INFINITY], known);
            last = if end.is_some() { hold.max(until) } else { last };
            let hold = end.unwrap_or(last);
            let times = [from, hold, until];
            let part = Part { plots: &own, now, levels: &levels, index, times };
            self.tracker.stretch(scan, &part, &mut report, sink, n_threads);
            rest = later;
            if rest.is_empty() {
                break;
            }
        }
        refused.into_iter().for_each(|(plot, status)| sink.refuse(plot, status));
        if hold > until {
            self.tracker.finish(until, sink, 1);
        }
        self.tracker.bury(1);
    }

    /// Carries out the commands of a step that was processed, and logs its rows.
    fn log(&mut self, step: i64, sink: &mut Sink<'_>) {
        for (_, command) in self.commands.iter().filter(|(at, _)| *at == step) {
            // if late plots have removed the track or the plan, the command changes nothing
            let _ = command.apply(&mut self.tracker);
        }
        let (rows, resumed) = (std::mem::take(&mut sink.rows), std::mem::take(&mut sink.resumed));
        let next_number = self.tracker.next_number();
        if step >= self.open {
            self.steps.push_back(Step { number: step, next_number, rows, resumed });
        }
    }

    /// Returns the last copy, and removes it if the copy before it is less than `spacing` steps older.
    fn last_kept(&mut self, spacing: i64) -> (i64, Kept) {
        let mut from_last = self.kept.iter().rev().map(|(next, _)| *next);
        let (last, before) = (from_last.next(), from_last.next());
        let near = last.zip(before).is_some_and(|(a, b)| a.saturating_sub(b) < spacing);
        let last = if near { self.kept.pop_back() } else { self.kept.back().cloned() };
        last.expect("there is always one")
    }

    /// Gives out the rows of steps that became final. Returns whether numbers of tracks became final.
    fn settle<R: Rows>(&mut self, final_steps: i64, rows: &mut R) -> bool {
        let before = self.numbered;
        let count = self.steps.partition_point(|step| step.number < final_steps);
        for mut step in self.steps.drain(..count) {
            self.numbered = step.next_number;
            step.rows.sort_by(Row::by_time);
            step.rows.iter().for_each(|row| rows.push(row));
            step.resumed.iter().for_each(|one| rows.resume(*one));
        }
        self.open = self.open.max(final_steps);
        self.numbered > before
    }

    /// Gives out rows that are not final, as far as they differ from those last given out: for each track,
    /// all rows from the first that differs. Rows of steps before `changed` are the same as before.
    fn show<R: Rows>(&mut self, final_steps: i64, changed: i64, rows: &mut R) {
        let place = self.shown.partition_point(|(step, _)| *step < final_steps.max(changed));
        let mut old: Vec<Row> = self.shown.drain(place..).map(|(_, row)| row).collect();
        self.shown.retain(|(step, _)| *step >= final_steps);
        let mut new = Vec::new();
        for step in self.steps.iter().filter(|step| step.number >= changed) {
            for row in step.rows.iter().filter(|row| row.confirmed) {
                let track = self.shown_number(row.track as u64, row.first_plot);
                let row = Row { track, is_final: false, ..*row };
                self.shown.push((step.number, row));
                new.push(row);
            }
        }
        let by_track = |a: &Row, b: &Row| a.track.cmp(&b.track).then(a.by_time(b));
        old.sort_by(by_track);
        new.sort_by(by_track);
        let mut differing = Vec::new();
        for new in new.chunk_by(|a, b| a.track == b.track) {
            let from = old.partition_point(|row| row.track < new[0].track);
            let to = old.partition_point(|row| row.track <= new[0].track);
            let old = &old[from..to];
            let same = new.iter().zip(old).take_while(|(new, old)| new.is_same(old)).count();
            // if only the last rows were removed, the row before them is given out again to show this
            let gone = same == new.len() && old.len() > same;
            differing.extend_from_slice(&new[same - usize::from(gone)..]);
        }
        differing.sort_by(Row::by_time);
        differing.iter().for_each(|row| rows.push(row));
    }

    /// Forgets copies, plots and commands that only final steps need.
    fn forget(&mut self, final_steps: i64) {
        while self.kept.len() > 1 && self.kept[1].0 <= final_steps {
            self.kept.pop_front();
        }
        let first = self.kept[0].0;
        self.journal = self.journal.split_off(&first);
        self.commands.retain(|command| command.0 >= first);
    }
}
