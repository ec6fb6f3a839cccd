//! Judges the times of plots that come live, and starts anew if time goes on from earlier ones.

use super::super::management::ended_tracks::Ended;
use super::super::plot::clock::{Clock, ClockDoubt, Limits, Verdict};
use super::super::plot::{Plot, Plots};
use super::super::rows::row::Rows;
use super::{BEFORE_ALL, LagTracker};
use std::collections::VecDeque;
use std::num::NonZero;

impl LagTracker {
    /// Returns the sensors whose clocks came into doubt since the last call of this function.
    pub fn take_clock_doubts(&mut self) -> Vec<ClockDoubt> {
        self.clock.take_doubts()
    }

    /// As [`super::super::Tracker::restart`].
    pub fn restart(&mut self, plots: usize) {
        self.clock = Clock::default();
        self.tracker.restart(plots);
    }

    /// Returns the indices of plots that are refused because they are ahead, and the end as far as it is believed.
    pub(super) fn judge<P: Plots + ?Sized, R: Rows>(
        &mut self,
        plots: &P,
        end: Option<f64>,
        rows: &mut R,
        n_threads: Option<NonZero<usize>>,
    ) -> (Vec<usize>, Option<f64>) {
        let mut verdict = self.verdict(plots, end);
        if verdict == Verdict::Restart {
            self.begin_anew(rows, n_threads);
            verdict = self.verdict(plots, end);
        }
        let Verdict::Refused(mut refused) = verdict else { return (Vec::new(), end) };
        refused.sort_unstable();
        let most = self.now() + self.tracker.silence();
        let end = end.filter(|end| refused.is_empty() || *end <= most);
        (refused, end)
    }

    fn now(&self) -> f64 {
        if self.lag > 0.0 { self.now } else { self.tracker.time() }
    }

    fn verdict<P: Plots + ?Sized>(&mut self, plots: &P, end: Option<f64>) -> Verdict {
        let (now, settings) = (self.now(), &self.tracker.settings);
        let periods = || settings.radars.iter().map(|radar| radar.scan_period);
        let late = |period: f64| if self.lag > 0.0 { self.lag } else { period };
        let oldest: Vec<f64> = periods().map(|own| (now - late(own)).max(self.closed)).collect();
        let (silence, period) = (self.tracker.silence(), periods().fold(0.0, f64::max));
        let is_valid = |plot: &Plot| {
            plot.fault(&settings.radars[plot.radar], settings.geometry(plot.radar)).is_none()
        };
        let limits = Limits { now, oldest: &oldest, silence, period, end };
        self.clock.judge(plots, &limits, &is_valid)
    }

    /// Makes all rows final and starts without tracks, as before the first plot.
    fn begin_anew<R: Rows>(&mut self, rows: &mut R, n_threads: Option<NonZero<usize>>) {
        self.finish(rows, n_threads);
        self.tracker.restart(0);
        self.tracker.ended = Ended::default();
        self.kept = VecDeque::from([(BEFORE_ALL, self.tracker.keep())]);
        self.steps.clear();
        self.shown.clear();
        let before = f64::NEG_INFINITY;
        (self.now, self.closed, self.stray, self.open) = (before, before, before, BEFORE_ALL);
    }
}
