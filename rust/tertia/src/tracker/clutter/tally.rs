//! Number of plots of a radar that belong to no track.

use crate::sensors::{Detection, Radar, Way};
use crate::tracker::filter::prospects::There;
use serde::{Deserialize, Serialize};

/// Least number of false plots and new targets per scan.
pub(in crate::tracker) const FEWEST: f64 = 1.0;

/// Number of first plots, and the sum of what plans say about their places, with fading weights.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Places {
    pub plots: f64,
    pub there: There,
}

impl Places {
    /// Multiplies the weights by `kept`.
    pub fn fade(&mut self, kept: f64) {
        self.plots *= kept;
        self.there.fade(kept);
    }

    /// Adds a first plot with this weight.
    pub fn add(&mut self, there: There, weight: f64) {
        self.plots += weight;
        self.there.add(there, weight);
    }

    /// The sum of both.
    pub fn with(&self, other: &Self) -> Self {
        let mut all = *self;
        all.plots += other.plots;
        all.there.add(other.there, 1.0);
        all
    }
}

/// Number of plots that belong to no track, numbers of those detected in each way, and number of
/// scans, with fading weights.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Tally {
    pub plots: f64,
    by: [f64; Detection::ALL.len()],
    pub scans: f64,
}

impl Tally {
    /// Multiplies the weights by `kept`.
    pub fn fade(&mut self, kept: f64) {
        self.plots *= kept;
        self.by.iter_mut().for_each(|plots| *plots *= kept);
        self.scans *= kept;
    }

    /// Adds a plot with this weight.
    pub fn add(&mut self, detection: Option<Detection>, weight: f64) {
        self.plots += weight;
        if let Some(detection) = detection {
            self.by[detection as usize] += weight;
        }
    }

    /// The sum of both.
    pub fn with(&self, other: &Self) -> Self {
        let by = std::array::from_fn(|way| self.by[way] + other.by[way]);
        Self { plots: self.plots + other.plots, by, scans: self.scans + other.scans }
    }

    /// What is left without `others`, which are included.
    pub fn less(&self, others: &Self) -> Self {
        let by = std::array::from_fn(|way| (self.by[way] - others.by[way]).max(0.0));
        let plots = (self.plots - others.plots).max(0.0);
        Self { plots, by, scans: self.scans - others.scans }
    }
}

/// Plots per scan that belong to no track.
pub(in crate::tracker) fn estimated(tally: &Tally, radar: &Radar) -> f64 {
    if radar.ways.is_some() {
        return each(tally, radar).map(|(.., count)| count).sum();
    }
    (tally.plots / tally.scans.max(f64::MIN_POSITIVE)).max(FEWEST)
}

/// The ways in which a radar detects, the share of each in the plots of targets, and the number of
/// plots per scan in this way that belong to no track.
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

/// Logarithm of the factor by which targets are likelier than false plots to be detected in this
/// way, wherever they are; 0 if the way is not known.
pub(in crate::tracker) fn gain_by_way(
    tally: &Tally,
    radar: &Radar,
    detection: Option<Detection>,
) -> f64 {
    let Some(detection) = detection else { return 0.0 };
    let own = each(tally, radar).find(|(way, ..)| way.detection == detection);
    own.map_or(0.0, |(_, share, count)| (share * estimated(tally, radar) / count).ln())
}
