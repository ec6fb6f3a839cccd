//! Where a target may be if it has accelerated since it was seen.

use super::Track;
use crate::tracker::settings::Settings;

impl Track {
    /// Standard deviation of an acceleration that a sensor may not have noticed, m/s², and its
    /// longest duration, s.
    pub(super) fn unnoticed(&self, sensor: usize, settings: &Settings) -> (f64, f64) {
        let (sigma, longest) = self.unseen(settings);
        (sigma, self.unnoticed_for(self.time - self.seen, (sensor, longest), settings))
    }

    /// Time for which the target may have accelerated unnoticed by a sensor, s: the time without a
    /// plot, one scan at least (not for sensors of positions) and `longest` at most. In less than a
    /// scan other radars do not notice an acceleration either.
    #[inline]
    fn unnoticed_for(&self, gap: f64, (sensor, longest): (usize, f64), settings: &Settings) -> f64 {
        let is_position = settings.geometry(sensor).is_position();
        let scan = settings.radars[sensor].scan_period.min(self.quickest);
        gap.max(if is_position { 0.0 } else { scan }).min(longest)
    }

    /// Standard deviation of accelerations that may remain unnoticed, m/s², and the longest time
    /// without a plot for which they count, s.
    pub fn unseen(&self, settings: &Settings) -> (f64, f64) {
        (settings.unnoticed(self.period), 5.0 * self.period)
    }

    /// Variance of the position by the models and by an unnoticed acceleration since the last plot,
    /// m², and the distance from straight flight that the models expect, m.
    #[inline]
    pub fn reach(
        &self,
        time: f64,
        sensor: usize,
        (sigma, longest): (f64, f64),
        settings: &Settings,
    ) -> (f64, f64) {
        let gap = self.unnoticed_for(time - self.seen, (sensor, longest), settings);
        let t = time - self.time;
        let wide = 0.5 * sigma * gap * gap;
        (wide * wide + self.swerve.variance(t), self.swerve.expected(t))
    }
}
