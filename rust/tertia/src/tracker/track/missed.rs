//! Scans in which radars should have seen a target and did not.

use super::{Stage, Track};
use crate::sensors::Radar;
use crate::tracker::beams::Expected;
use crate::tracker::settings::{MAX_DELAY, Settings};

impl Track {
    /// Counts the scans before `end` in which radars should have seen the target and did not; calls
    /// `missed` for each.
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
                if self.is_missed(station, settings) {
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

    /// Whether a scan without a plot counts: if the target is within the range of this radar, or if
    /// the track is tentative and has left the ranges of all its radars.
    fn is_missed(&self, station: &Radar, settings: &Settings) -> bool {
        let place = self.estimate.position();
        let is_seen = |e: &Expected| settings.radars[e.radar].covers(place);
        station.covers(place) || !self.is_confirmed() && !self.beams.all().iter().any(is_seen)
    }
}
