//! The density of plots that belong to no track.

use super::extent::Extent;
use super::settings::Settings;
use crate::sensors::Radar;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Scans over which the mean is taken.
const MEMORY: f64 = 10.0;
/// False plots and new targets in a scan, at least.
const FEWEST: f64 = 1.0;
/// Range of a radar without limit that has no plots yet, m.
const NEAREST_LIMIT: f64 = 1e4;

/// The density of false plots of one radar.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Clutter {
    known: Option<f64>,
    /// Plots that belong to no track, and the scans in which they came, with fading weights.
    plots: f64,
    scans: f64,
    /// Until when they are counted, s.
    until: f64,
    farthest: f64,
    /// Of a sensor of positions.
    extent: Option<Extent>,
}

impl Clutter {
    /// That of a sensor before any plot; a density that is not a number is estimated.
    pub fn of(settings: &Settings, sensor: usize) -> Self {
        let extent = settings
            .geometry(sensor)
            .is_position()
            .then(|| Extent::new(settings.max_speed, settings.radars[sensor].scan_period));
        Self { extent, ..Self::new(settings.clutter_density) }
    }

    fn new(density: f64) -> Self {
        let known = (!density.is_nan()).then_some(density);
        let until = f64::NEG_INFINITY;
        let farthest = NEAREST_LIMIT;
        Self { known, plots: 0.0, scans: 0.0, until, farthest, extent: None }
    }

    /// Such plots per square metre and scan, new targets included.
    pub fn density(&self, radar: &Radar) -> f64 {
        let count = self.plots / self.scans.max(f64::MIN_POSITIVE);
        self.known.unwrap_or_else(|| count.max(FEWEST) / self.area(radar))
    }

    /// Such plots per scan.
    pub fn plots(&self, radar: &Radar) -> f64 {
        self.density(radar) * self.area(radar)
    }

    fn area(&self, radar: &Radar) -> f64 {
        if let Some(extent) = &self.extent {
            return extent.area();
        }
        let radius = radar.max_range.min(self.farthest);
        PI * radius * radius
    }

    pub fn saw(&mut self, radar: &Radar, position: [f64; 2]) {
        match &mut self.extent {
            Some(extent) => extent.saw(position),
            None => self.farthest = self.farthest.max(radar.about(position)),
        }
    }

    /// Counts plots that belong to no track, from `begin` to `end`, and the scan before where nothing
    /// has been counted yet.
    pub fn count(&mut self, plots: usize, [begin, end]: [f64; 2], period: f64) {
        let scans = (end - self.until.max(begin - period)).max(0.0) / period;
        self.until = self.until.max(end);
        let kept = (-scans / MEMORY).exp();
        self.plots = kept * self.plots + plots as f64;
        self.scans = kept * self.scans + scans;
        if let Some(extent) = &mut self.extent {
            extent.fade(kept);
        }
    }

    /// Removes a plot of this time that was counted but belongs to a target.
    pub fn discount(&mut self, time: f64, period: f64) {
        let age = (self.until - time).max(0.0) / period;
        self.plots = (self.plots - (-age / MEMORY).exp()).max(0.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_within;
    use crate::sensors::radar_of;
    use crate::tracker::{ImmModel, Motion, Plot, Row, Tracker};

    #[test]
    fn first_plots_of_targets_that_are_confirmed_are_no_false_plots() {
        let radar = Radar { max_range: 1e5, ..radar_of([50.0, 1e-3]) };
        let settings = Settings::new(vec![radar], Motion::Imm(ImmModel::default()));
        let mut tracker = Tracker::try_new(settings).unwrap();
        let (mut statuses, mut rows) = (Vec::new(), Vec::<Row>::new());
        for scan in 0..8 {
            // thirty aircraft on a circle, outwards
            let plots: Vec<Plot> = (0..30)
                .map(|k| {
                    let azimuth = 0.2 * f64::from(k);
                    let time = 4.0 * (f64::from(scan) + azimuth / std::f64::consts::TAU);
                    let range = 4e4 + 200.0 * time;
                    let (height, identity) = (f64::NAN, -1);
                    Plot { time, range, azimuth, radar: 0, height, identity, report: None }
                })
                .collect();
            tracker.track(&plots[..], None, &mut statuses, &mut rows, None).unwrap();
        }
        assert_within(1e-12, tracker.clutter[0].plots(&radar), FEWEST);
    }

    #[test]
    fn a_plot_of_a_target_counts_as_if_it_had_never_been_counted() {
        let radar = Radar { max_range: 1e5, ..radar_of([50.0, 1e-3]) };
        let counted = |plots: usize| {
            let mut clutter = Clutter::new(f64::NAN);
            clutter.count(plots, [0.0, 4.0], 4.0);
            clutter.count(7, [4.0, 24.0], 4.0);
            clutter
        };
        let mut clutter = counted(90);
        for _ in 0..30 {
            clutter.discount(4.0, 4.0);
        }
        assert_within(1e-13, clutter.plots(&radar), counted(60).plots(&radar));
        // the first plots were made in two scans, and have faded for five
        let fade = (-0.5_f64).exp();
        let expected = (60.0 * fade + 7.0) / (2.0 * fade + 5.0);
        assert_within(1e-13, clutter.plots(&radar), expected);
        // no plots less than none
        for _ in 0..1000 {
            clutter.discount(24.0, 4.0);
        }
        assert_within(1e-13, clutter.plots(&radar), FEWEST);
    }
}
