//! Scans in which radars should have seen a target and did not.

use super::{Stage, Track};
use crate::tracker::beams::Expected;
use crate::tracker::settings::{MAX_DELAY, Settings};

impl Track {
    /// Counts the scans in which radars should have seen the target before `end`; calls `missed`
    /// for each.
    #[inline]
    pub fn miss(&mut self, end: f64, settings: &Settings, missed: impl FnMut(&Self, usize)) {
        if self.due < end {
            self.miss_due(end, settings, missed);
            self.set_due(settings);
        }
    }

    fn miss_due(&mut self, end: f64, settings: &Settings, mut missed: impl FnMut(&Self, usize)) {
        for i in 0..self.beams.all().len() {
            loop {
                let Expected { radar, time, .. } = self.beams.all()[i];
                let station = &settings.radars[radar];
                if time + MAX_DELAY * station.scan_period >= end || !self.is_alive(settings) {
                    break;
                }
                self.beams.all_mut()[i].time += station.scan_period;
                self.predict(time, settings.pace(radar), settings);
                if station.covers(self.estimate.position()) {
                    self.existence.miss(radar, settings);
                    if let Stage::Tentative { misses, evidence, .. } = &mut self.stage {
                        *misses += 1;
                        *evidence += (1.0 - station.detection_probability).ln();
                    }
                    self.follow(station.scan_period, settings);
                    missed(self, radar);
                }
            }
        }
    }
}
