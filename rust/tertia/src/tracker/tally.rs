//! How many plots of a radar belong to no track.

use super::prospects::There;
use crate::sensors::{Detection, Radar, Way};
use serde::{Deserialize, Serialize};

/// False plots and new targets in a scan, at least.
pub(super) const FEWEST: f64 = 1.0;

/// First plots, and what plans say of their places, summed, with fading weights.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Places {
    pub plots: f64,
    pub there: There,
}

impl Places {
    /// Lets them fade.
    pub fn fade(&mut self, kept: f64) {
        self.plots *= kept;
        self.there.fade(kept);
    }

    /// Adds one that counts with this weight.
    pub fn add(&mut self, there: There, weight: f64) {
        self.plots += weight;
        self.there.add(there, weight);
    }

    /// Both together.
    pub fn with(&self, other: &Self) -> Self {
        let mut all = *self;
        all.plots += other.plots;
        all.there.add(other.there, 1.0);
        all
    }
}

/// Plots that belong to no track, how many of them were detected in each way, and the scans in which
/// they came, with fading weights.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Tally {
    pub plots: f64,
    by: [f64; Detection::ALL.len()],
    pub scans: f64,
}

impl Tally {
    /// Lets them fade.
    pub fn fade(&mut self, kept: f64) {
        self.plots *= kept;
        self.by.iter_mut().for_each(|plots| *plots *= kept);
        self.scans *= kept;
    }

    /// Adds a plot that counts with this weight.
    pub fn add(&mut self, detection: Option<Detection>, weight: f64) {
        self.plots += weight;
        if let Some(detection) = detection {
            self.by[detection as usize] += weight;
        }
    }

    /// Both together.
    pub fn with(&self, other: &Self) -> Self {
        let by = std::array::from_fn(|way| self.by[way] + other.by[way]);
        Self { plots: self.plots + other.plots, by, scans: self.scans + other.scans }
    }

    /// Those that are not among others.
    pub fn less(&self, others: &Self) -> Self {
        let by = std::array::from_fn(|way| (self.by[way] - others.by[way]).max(0.0));
        let plots = (self.plots - others.plots).max(0.0);
        Self { plots, by, scans: self.scans - others.scans }
    }
}

/// Plots per scan that belong to no track.
pub(super) fn estimated(tally: &Tally, radar: &Radar) -> f64 {
    if radar.ways.is_some() {
        return each(tally, radar).map(|(.., count)| count).sum();
    }
    (tally.plots / tally.scans.max(f64::MIN_POSITIVE)).max(FEWEST)
}

/// The ways of a radar, the shares of the plots of targets that they have, and their plots per scan that
/// belong to no track.
fn each<'a>(tally: &Tally, radar: &'a Radar) -> impl Iterator<Item = (&'a Way, f64, f64)> {
    let ways = radar.ways.as_ref().map_or(&[][..], |ways| ways.all());
    ways.iter().map(|way| {
        let share = way.probability / radar.detection_probability;
        let count = tally.by[way.detection as usize] / tally.scans.max(f64::MIN_POSITIVE);
        let known = way.clutter_per_scan;
        let count = if known.is_nan() { count } else { known };
        (way, share, count.max(FEWEST * share))
    })
}

/// Logarithm of how much likelier targets are detected so than false plots are, wherever they are; 0
/// where the way is not known.
pub(super) fn gain_by_way(tally: &Tally, radar: &Radar, detection: Option<Detection>) -> f64 {
    let Some(detection) = detection else { return 0.0 };
    let own = each(tally, radar).find(|(way, ..)| way.detection == detection);
    own.map_or(0.0, |(_, share, count)| (share * estimated(tally, radar) / count).ln())
}
