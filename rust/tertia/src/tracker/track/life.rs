//! Which plots are never a track's, and tracks that go on with the past of another.

use super::super::plot::Measured;
use super::super::settings::Settings;
use super::Track;
use crate::flightplan::Status;

impl Track {
    /// Whether the plot has another address than the target, which has answered with its own more than
    /// once.
    #[inline]
    pub fn refuses(&self, plot: &Measured, settings: &Settings) -> bool {
        plot.identity >= 0
            && settings.has_addresses()
            && self.identity.is_some_and(|own| own.is_sure && own.code != plot.identity)
            && !settings.emergency_codes.contains(&plot.identity)
    }

    /// Scans of the slowest radar that sees the target, s.
    pub fn period(&self) -> f64 {
        self.period
    }

    /// Whether its plan is suspended.
    pub fn is_suspended(&self) -> bool {
        self.suspended
    }

    /// Ends it: another track goes on with what is returned.
    pub fn retire(&mut self) -> Self {
        let past = self.clone();
        (self.number, self.seen) = (0, f64::NEG_INFINITY);
        past
    }

    /// Goes on with the number, the identity and the plan of a track of the same target.
    pub fn go_on(&mut self, past: &Self, settings: &Settings) {
        (self.number, self.first.index) = (past.number, past.first.index);
        self.identity = self.identity.or(past.identity);
        self.suspended |= past.suspended;
        if let Some(plan) = past.plan().filter(|plan| settings.plans.get(*plan).is_some()) {
            self.correlate(plan, settings, past.plan_status() == Status::Manual);
        }
    }
}
