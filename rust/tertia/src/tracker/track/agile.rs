//! What the plots of a track say of how agile its target is.

use super::Track;
use crate::base::plane::Plane;
use crate::tracker::estimate::Estimate;
use crate::tracker::plot::Measured;
use crate::tracker::settings::Settings;

impl Track {
    /// Corrects by a plot.
    pub fn correct(&mut self, plot: &Measured, settings: &Settings) {
        let estimate = self.estimate;
        self.correct_widened(plot, &estimate, settings);
    }

    /// The same of a plot that was not expected so far off: what the estimate was before it was widened.
    pub(super) fn correct_widened(
        &mut self,
        plot: &Measured,
        before: &Estimate<4>,
        settings: &Settings,
    ) {
        let [wide, own] = [&self.estimate, before].map(Estimate::position_covariance);
        // the plot that confirms a track says nothing about the models that begin with it
        let was_confirmed = self.is_confirmed();
        self.correct_by(plot, settings);
        if was_confirmed {
            let (y, s) = self.innovation;
            let (xx, xy, yy) = (own.xx - wide.xx, own.xy - wide.xy, own.yy - wide.yy);
            self.filter.saw(y, s.plus(Plane { xx, xy, yy }));
        }
    }
}
