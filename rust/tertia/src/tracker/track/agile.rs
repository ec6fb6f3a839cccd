//! What the plots of a track say about the agility of its target.

use super::Track;
use crate::base::plane::Plane;
use crate::tracker::plot::Measured;
use crate::tracker::settings::Settings;

/// Squared normalised distance from its first plot beyond which a target has moved.
const MOVED: f64 = 16.0;

impl Track {
    /// Corrects by a plot.
    pub fn correct(&mut self, plot: &Measured, settings: &Settings) {
        self.correct_widened(plot, self.estimate.position_covariance(), settings);
    }

    /// Corrects by a plot for which the estimate was widened; `own` is the covariance of the position
    /// before it was widened.
    pub(super) fn correct_widened(&mut self, plot: &Measured, own: Plane, settings: &Settings) {
        let wide = self.estimate.position_covariance();
        // the plot that confirms a track says nothing about the models that begin with it
        let was_confirmed = self.is_confirmed();
        self.correct_by(plot, settings);
        if was_confirmed {
            let (y, s) = self.innovation;
            let (xx, xy, yy) = (own.xx - wide.xx, own.xy - wide.xy, own.yy - wide.yy);
            let now = self.estimate.position_covariance();
            let left = (now.xx + now.yy) / (wide.xx + wide.yy);
            self.filter.saw(y, s.plus(Plane { xx, xy, yy }), left.min(1.0));
        }
        self.set_swerve(settings);
        self.moved = self.moved || !plot.is_bare() || self.has_moved(settings);
    }

    /// Whether noise does not explain the distance of the track from its first plot.
    fn has_moved(&self, settings: &Settings) -> bool {
        let (place, noise) = (self.estimate.position(), self.estimate.position_covariance());
        self.is_away((place, noise), settings)
    }

    /// Whether noise does not explain the distance of a place of this covariance from the first
    /// plot.
    pub(super) fn is_away(&self, (place, noise): ([f64; 2], Plane), settings: &Settings) -> bool {
        let way = [0, 1].map(|i| place[i] - self.first.position[i]);
        noise.plus(self.first_noise(settings)).inverse().form(way) > MOVED
    }

    /// The covariance of its first plot.
    pub(super) fn first_noise(&self, settings: &Settings) -> Plane {
        let first = &self.first;
        first.source.placed().unwrap_or_else(|| {
            settings.radars[first.radar].at_worst().noise_at(first.position, f64::NAN)
        })
    }

    /// Updates how far from straight flight its models lead.
    pub(super) fn set_swerve(&mut self, settings: &Settings) {
        let period = self.pace(settings);
        self.swerve = self.filter.swerve(self.motion(settings), period);
    }
}
