//! How many plots belong to nothing.

use super::plot::Radar;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Scans over which the mean is taken.
const MEMORY: f64 = 10.0;
/// False plots and new targets in a scan, at least.
const FEWEST: f64 = 1.0;
/// Where a radar's range is not limited and nothing was seen yet, m.
const NEAREST_LIMIT: f64 = 1e4;

/// The density of false plots of one radar.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Clutter {
    known: Option<f64>,
    /// Plots in a scan that belong to nothing: the mean of all scans, then of the last ones.
    count: f64,
    /// Scans in the mean.
    scans: f64,
    farthest: f64,
}

impl Clutter {
    /// A density that is not a number is estimated.
    pub fn new(density: f64) -> Self {
        let known = (!density.is_nan()).then_some(density);
        Self { known, count: FEWEST, scans: 0.0, farthest: NEAREST_LIMIT }
    }

    /// Such plots per square metre and scan, new targets included.
    pub fn density(&self, radar: &Radar) -> f64 {
        self.known.unwrap_or_else(|| self.count.max(FEWEST) / self.area(radar))
    }

    /// Such plots per scan.
    pub fn plots(&self, radar: &Radar) -> f64 {
        self.density(radar) * self.area(radar)
    }

    fn area(&self, radar: &Radar) -> f64 {
        let radius = radar.range_max.min(self.farthest);
        PI * radius * radius
    }

    pub fn saw(&mut self, distance: f64) {
        self.farthest = self.farthest.max(distance);
    }

    /// So many plots belonged to nothing in a time of so many scans.
    pub fn count(&mut self, plots: usize, scans: f64) {
        if scans > 0.0 {
            self.scans += scans;
            let share = (scans / self.scans).max(-(-scans / MEMORY).exp_m1());
            self.count += share * (plots as f64 / scans - self.count);
        }
    }
}
