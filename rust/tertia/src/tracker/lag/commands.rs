//! Commands of a controller, and what the tracker shows besides rows.

use super::super::live::control::{Command, Refusal};
use super::super::plot::PlotStatus;
use super::{BEFORE_ALL, LagTracker};
use std::collections::VecDeque;

impl LagTracker {
    /// Changes a plan, or the plan of a track, from now on; returns the number of a plan that was added.
    ///
    /// # Errors
    /// As the methods of [`Tracker`](crate::tracker::Tracker); also for a track whose number is not final.
    pub fn command(&mut self, command: Command) -> Result<Option<usize>, Refusal> {
        if let Some(number) =
            command.track().filter(|number| *number >= self.next_number_for_good())
        {
            return Err(Refusal::NoTrack(number));
        }
        let done = command.apply(&mut self.tracker)?;
        if self.now == f64::NEG_INFINITY {
            self.kept = VecDeque::from([(BEFORE_ALL, self.tracker.keep())]);
        } else if self.lag > 0.0 {
            self.commands.push((self.step_of(self.now), command));
        }
        Ok(done)
    }

    /// Numbers of the confirmed tracks whose plans are suspended, as far as the numbers are final.
    pub fn suspended_plans(&self) -> Vec<u64> {
        let mut suspended = self.tracker.suspended_plans();
        suspended.retain(|number| *number < self.next_number_for_good());
        suspended
    }

    /// Numbers and positions of the confirmed tracks, as
    /// [`Tracker::extrapolate`](crate::tracker::Tracker::extrapolate); numbers of 2^40 and more
    /// are not final.
    pub fn extrapolate(&self, seconds: f64) -> Vec<(i64, [f64; 2])> {
        let first = self.tracker.first_plots();
        let found = self.tracker.extrapolate(seconds).into_iter().zip(first);
        found
            .map(|((number, position), first)| (self.shown_number(number, first), position))
            .collect()
    }

    pub(super) fn shown_number(&self, number: u64, first_plot: usize) -> i64 {
        if number < self.next_number_for_good() {
            number as i64
        } else {
            PlotStatus::Provisional(first_plot).code()
        }
    }

    pub(super) fn next_number_for_good(&self) -> u64 {
        if self.lag > 0.0 { self.numbered } else { u64::MAX }
    }
}
