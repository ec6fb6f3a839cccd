//! A track and the velocities that come with plots.

use super::Track;
use crate::tracker::estimate::Estimate;
use crate::tracker::filter::Filter;
use crate::tracker::moving::Velocities;
use crate::tracker::plot::{Measured, Moving, Source};
use crate::tracker::prospects::{Expected, Prospects};
use crate::tracker::settings::Settings;

impl Settings {
    fn velocities(&self) -> Velocities {
        Velocities { guard: self.guard, max_speed: self.max_speed }
    }
}

impl Track {
    /// Begins where flights are due, or with a velocity.
    pub(super) fn begin(&mut self, expected: Option<Expected>, settings: &Settings) {
        let mut prospects = Prospects::new(expected, self.estimate);
        if let Source::Moving(_, seen) = &self.first.source {
            prospects.begin_moving(seen, settings.velocities());
        }
        if prospects.are_any() {
            self.filter = Filter::Planned(Box::new(prospects));
        }
    }

    /// Likelihood ratio of the velocity of a plot, of this target against any other.
    #[cold]
    pub(super) fn velocity_ratio(&self, plot: &Measured, seen: Moving, settings: &Settings) -> f64 {
        let here = self.brought_here(plot, settings);
        let mut after = self.estimate;
        after.correct(here.position, here.covariance());
        let seen = self.moving_here(plot, seen, settings);
        let [_, density] = after.expects(&seen);
        settings.velocities().ratio(density)
    }

    /// Corrects by the velocity of a plot, after its position, unless no model expects it.
    #[cold]
    pub(super) fn take_velocity(
        &mut self,
        plot: &Measured,
        seen: Moving,
        settings: &Settings,
    ) {
        let velocities = settings.velocities();
        let seen = self.moving_here(plot, seen, settings);
        let leaning = self.lean.as_ref().zip(self.vertical).map(|(lean, vertical)| {
            lean.of_velocity(vertical.at(self.time).height_variance())
        });
        if !self.filter.expects(&seen.wider(leaning.unwrap_or_default()), velocities) {
            return;
        }
        let motion = self.motion(settings);
        self.filter.take_velocity(motion, &seen, velocities);
        self.estimate = self.filter.estimate();
        if let Some(lean) = &mut self.lean {
            lean.take_velocity(&self.estimate, seen.noise);
        }
    }

    /// A velocity as of the time of the estimate.
    fn moving_here(&self, plot: &Measured, seen: Moving, settings: &Settings) -> Moving {
        let late = (self.time - plot.time).max(0.0);
        seen.since(late, self.motion(settings), settings.pace(plot.radar))
    }

    /// The estimate that is shown: before it is confirmed, of all that it may be.
    pub(super) fn shown(&self) -> Estimate<4> {
        match &self.filter {
            Filter::Planned(prospects) => prospects.shown(),
            _ => self.estimate,
        }
    }
}
