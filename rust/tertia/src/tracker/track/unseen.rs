//! Where a target may be that has accelerated since it was seen.

use super::Track;
use crate::tracker::settings::Settings;

impl Track {
    /// Acceleration that the target may have unnoticed, m/s², and for how long, where scans of the radar
    /// take so long.
    pub(super) fn unnoticed(&self, period: f64, settings: &Settings) -> (f64, f64) {
        let (sigma, longest) = self.unseen(settings);
        (sigma, unnoticed_for(self.time - self.seen, period, longest))
    }

    /// Acceleration that the target may have unnoticed, m/s², and how long without a plot at most, s.
    pub fn unseen(&self, settings: &Settings) -> (f64, f64) {
        (settings.unnoticed(self.period), 5.0 * self.period)
    }

    /// Variance of a position by the models, and by an unnoticed acceleration since the last plot; and how
    /// far from straight flight the models expect it.
    #[inline]
    pub fn reach(&self, time: f64, period: f64, (sigma, longest): (f64, f64)) -> (f64, f64) {
        let gap = unnoticed_for(time - self.seen, period, longest);
        let t = time - self.time;
        let wide = 0.5 * sigma * gap * gap;
        (wide * wide + self.swerve.variance(t), self.swerve.expected(t))
    }
}

/// Seconds for which an acceleration was not noticed, by those without a plot: a scan at least, as other radars
/// do not notice it sooner, and five scans at most.
#[inline]
fn unnoticed_for(gap: f64, period: f64, longest: f64) -> f64 {
    gap.max(period).min(longest)
}
