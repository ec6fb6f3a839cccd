//! Where a target may be that has accelerated since it was seen.

use super::Track;
use crate::tracker::settings::Settings;

impl Track {
    /// Acceleration that the target may have unnoticed by a sensor, m/s², and for how long.
    pub(super) fn unnoticed(&self, sensor: usize, settings: &Settings) -> (f64, f64) {
        let (sigma, longest) = self.unseen(settings);
        (sigma, self.unnoticed_for(self.time - self.seen, (sensor, longest), settings))
    }

    /// Seconds for which it may have accelerated unnoticed by a sensor, by those without a plot, five scans
    /// at most. In less than a scan other radars do not notice an acceleration either.
    #[inline]
    fn unnoticed_for(&self, gap: f64, (sensor, longest): (usize, f64), settings: &Settings) -> f64 {
        let is_position = settings.geometry(sensor).is_position();
        let scan = settings.radars[sensor].scan_period.min(self.quickest);
        gap.max(if is_position { 0.0 } else { scan }).min(longest)
    }

    /// Acceleration that the target may have unnoticed, m/s², and how long without a plot at most, s.
    pub fn unseen(&self, settings: &Settings) -> (f64, f64) {
        (settings.unnoticed(self.period), 5.0 * self.period)
    }

    /// Variance of a position by the models, and by an unnoticed acceleration since the last plot; and how
    /// far from straight flight the models expect it.
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
