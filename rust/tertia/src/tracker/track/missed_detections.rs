//! When radars should see a target, and missed detections: scans in which they should have and did not.

use super::{SOONEST, Stage, Track};
use crate::sensors::Radar;
use crate::tracker::plot::Measured;
use crate::tracker::settings::{MAX_DELAY, Settings};
use crate::tracker::track::expected_times::Expected;

impl Track {
    /// When this radar should see the target next; none if it has not seen the target yet.
    pub fn expected_by(&self, radar: usize) -> Option<&Expected> {
        self.beams.all().iter().find(|expected| expected.radar == radar)
    }

    /// Whether this radar can have made a plot of this target at the time of the plot.
    pub fn is_due(&self, plot: &Measured, radar: &Radar) -> bool {
        self.is_due_at(plot.time, plot.radar, radar.scan_period)
    }

    /// The same for a plot at a time, from the index and the scan period of its radar.
    #[inline]
    pub fn is_due_at(&self, time: f64, radar: usize, period: f64) -> bool {
        self.expected_by(radar).is_none_or(|e| time - e.seen > SOONEST * period)
    }

    pub(super) fn set_due(&mut self, settings: &Settings) {
        let due = |e: &Expected| e.time + MAX_DELAY * settings.radars[e.radar].scan_period;
        self.due = self.beams.all().iter().map(due).fold(f64::INFINITY, f64::min);
    }

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
        while self.is_alive(settings) {
            // in order of time, regardless of which radar saw the target first
            let is_past =
                |e: &&mut Expected| e.time + MAX_DELAY * settings.radars[e.radar].scan_period < end;
            let past = self.beams.all_mut().iter_mut().filter(is_past);
            let Some(next) = past.min_by(|a, b| a.time.total_cmp(&b.time)) else { break };
            let Expected { radar, time, .. } = *next;
            let station = &settings.radars[radar];
            next.time += station.scan_period;
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

    /// Whether a scan without a plot counts: if the target is within the range of this radar, or if
    /// the track is tentative and has left the ranges of all its radars.
    fn is_missed(&self, station: &Radar, settings: &Settings) -> bool {
        let place = self.estimate.position();
        let is_seen = |e: &Expected| settings.radars[e.radar].covers(place);
        station.covers(place) || !self.is_confirmed() && !self.beams.all().iter().any(is_seen)
    }
}
