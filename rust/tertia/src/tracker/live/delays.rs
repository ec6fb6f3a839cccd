//! Delays of reported positions that differ between targets, as the tracker estimates them.

use super::Tracker;
use crate::tracker::errors::delay::spread;

impl Tracker {
    /// Sets the delay of all targets that was taken out of the times of the reports of each sensor, s; none
    /// where all targets have the same.
    pub fn set_delays(&mut self, common: &[Option<f64>]) {
        let before = std::mem::take(&mut self.settings.delays);
        let new = |(sensor, common): (usize, &Option<f64>)| {
            let mut own = before.get(sensor).copied().flatten().unwrap_or_default();
            let more = (*common)? - own.common;
            if more != 0.0 {
                let tracks = self.tracks.iter_mut();
                tracks.for_each(|track| track.change_delays(sensor, |own| own.refer(more)));
                own.common += more;
            }
            Some(own)
        };
        let delays: Vec<_> = common.iter().enumerate().map(new).collect();
        if delays.iter().any(Option::is_some) {
            self.settings.delays = delays;
        }
    }

    /// Returns the standard deviations of the differences between the delays of targets, s, by sensor; 0
    /// where none were found.
    pub fn delay_sigmas(&self) -> Vec<f64> {
        let sigma = |sensor| self.settings.delay_sigma(sensor).unwrap_or(0.0);
        (0..self.radars()).map(sigma).collect()
    }

    /// Estimates how much the delays of targets differ. Errors of other sensors cause delays of the variance
    /// `unsure`, s². Cost O(tracks).
    pub fn weigh_delays(&mut self, unsure: f64) {
        for (sensor, delays) in self.settings.delays.iter_mut().enumerate() {
            let Some(delays) = delays else { continue };
            let tracks = self.tracks.iter().filter(|track| track.is_confirmed());
            let own = tracks.filter_map(|track| track.delay(sensor));
            let sigma = spread(own, unsure, delays.sigma);
            if sigma != delays.sigma {
                delays.sigma = sigma;
                let tracks = self.tracks.iter_mut();
                tracks.for_each(|track| track.change_delays(sensor, |own| own.sigma = sigma));
            }
        }
    }
}
