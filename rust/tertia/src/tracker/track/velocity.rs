//! A track and the velocities that come with plots.

use super::Track;
use crate::base::exponential::exp;
use crate::tracker::filter::Filter;
use crate::tracker::filter::prospects::{Expected, Prospects};
use crate::tracker::motion::estimate::Estimate;
use crate::tracker::motion::kinematics;
use crate::tracker::motion::velocities::Velocities;
use crate::tracker::plot::{Measured, Moving, Source};
use crate::tracker::settings::Settings;

impl Settings {
    fn velocities(&self) -> Velocities {
        Velocities { guard: self.guard, max_speed: self.max_speed }
    }
}

impl Track {
    /// Begins with the flights that are due, or with the velocity of the first plot.
    pub(super) fn begin(&mut self, expected: Option<Expected>, settings: &Settings) {
        let mut prospects = Prospects::new(expected, self.estimate);
        if let Source::Moving(_, seen) = &self.first.source {
            prospects.begin_moving(seen, settings.velocities());
        }
        if prospects.are_any() {
            self.filter = Filter::Planned(Box::new(prospects));
        }
    }

    /// Likelihood ratio of height, identity and detection.
    #[inline]
    pub fn also(&self, plot: &Measured, settings: &Settings) -> f64 {
        // channels that detected the plot
        let detection = if plot.gain == 0.0 { 1.0 } else { exp(plot.gain) };
        self.named(plot, settings) * detection
    }

    /// Likelihood ratio of height and identity.
    #[inline]
    pub fn named(&self, plot: &Measured, settings: &Settings) -> f64 {
        let height = self.height_ratio(plot);
        let identity = match plot.identities.is_some() {
            true => self.known.ratio(&settings.identities(plot).0, settings),
            false => self.unidentified_ratio(plot, settings),
        };
        height * identity
    }

    /// Likelihood ratio of a plot without an identity: nearly all false plots have none, and few of
    /// those of a target that replies. What channels detected the plot says the same.
    #[inline]
    fn unidentified_ratio(&self, plot: &Measured, settings: &Settings) -> f64 {
        if plot.detection.is_some() || !self.identities().is_some() {
            return 1.0;
        }
        settings.unidentified.get(plot.radar).copied().unwrap_or(1.0)
    }

    /// Likelihood ratio of all quantities of a plot except its position: this target against any
    /// other.
    #[inline]
    pub(super) fn also_moving(&self, plot: &Measured, settings: &Settings) -> f64 {
        let also = self.also(plot, settings);
        match plot.source {
            Source::Moving(_, seen) => also * self.ratio_of(plot, seen, settings),
            _ => also,
        }
    }

    #[cold]
    fn ratio_of(&self, plot: &Measured, seen: Moving, settings: &Settings) -> f64 {
        let here = self.brought_here(plot, settings);
        let seen = self.moving_here(plot, seen, settings);
        let (mut total, mut density) = (0.0, 0.0);
        self.filter.each_estimate(|probability, estimate| {
            let mut after = *estimate;
            let weight = probability * after.correct(here.position, here.covariance());
            total += weight;
            density += weight * after.expects(&seen)[1];
        });
        settings.velocities().ratio(if total > 0.0 { density / total } else { 0.0 })
    }

    /// Likelihood ratios of the velocity of a plot far from where it was expected: of a target that
    /// goes on as before, and of one that has had an acceleration of standard deviation `sigma` for
    /// the time `gap`.
    pub(super) fn velocity_ratios(
        &self,
        plot: &Measured,
        (sigma, gap): (f64, f64),
        settings: &Settings,
    ) -> [f64; 2] {
        let Source::Moving(_, seen) = plot.source else { return [1.0; 2] };
        let here = self.brought_here(plot, settings);
        let seen = self.moving_here(plot, seen, settings);
        let mut accelerated = self.estimate;
        accelerated.covariance += kinematics::unnoticed(sigma, gap);
        accelerated.correct(here.position, here.covariance());
        [self.estimate, accelerated].map(|own| settings.velocities().ratio(own.expects(&seen)[1]))
    }

    /// Corrects by the velocity of a plot, after its position, unless no model expects this
    /// velocity.
    #[cold]
    pub(super) fn take_velocity(&mut self, plot: &Measured, seen: Moving, settings: &Settings) {
        let velocities = settings.velocities();
        let seen = self.moving_here(plot, seen, settings);
        let leaning = self
            .lean
            .as_ref()
            .zip(self.vertical)
            .map(|(lean, vertical)| lean.of_velocity(vertical.at(self.time).height_variance()));
        if !self.filter.expects(&seen.wider(leaning.unwrap_or_default()), velocities) {
            return;
        }
        let motion = self.motion(settings);
        self.filter.take_velocity(motion, &seen, velocities);
        self.estimate = self.filter.estimate();
        for lean in self
            .lean
            .as_deref_mut()
            .into_iter()
            .chain(self.delays.iter_mut().map(|own| &mut own.lean))
        {
            lean.take_velocity(&self.estimate, seen.noise);
        }
    }

    /// The velocity of a plot, with the noise of the motion until the time of the estimate.
    fn moving_here(&self, plot: &Measured, seen: Moving, settings: &Settings) -> Moving {
        let late = (self.time - plot.time).max(0.0);
        seen.since(late, self.motion(settings), settings.pace(plot.radar))
    }

    /// The estimate that is shown; before confirmation, that of a target without a plan.
    pub(super) fn shown(&self) -> Estimate<4> {
        match &self.filter {
            Filter::Planned(prospects) => prospects.shown(),
            _ => self.estimate,
        }
    }
}
