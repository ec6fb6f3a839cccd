//! What the rows of a track tell about the filter that made it, and about the plots behind them.

use super::family::{Evidence, Families};
use super::filtered::Filtered;
use super::gain::Gain;
use super::row::Row;
use super::shadow::Shadow;
use super::stated::Covariances;
use super::target::Tracklet;
use super::tracklet::{Behind, Past, behind, coasts, is_doubtful};
use crate::base::plane::Plane;
use crate::sensors::Radar;
use crate::tracker::Estimate;
use serde::{Deserialize, Serialize};

/// `MEMORY` is the weight of the newest row in the running share of rows that Tertia's filter cannot have
/// made, `UNKNOWN` the initial share; from `FOREIGN` on, the track counts as made by another filter. A
/// single turn may seem to be made by one.
const MEMORY: f64 = 0.05;
const UNKNOWN: f64 = 0.6;
const FOREIGN: f64 = 0.7;

/// The last rows of a track, and what they tell about the filter that made it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Analysis {
    pub last: Row,
    is_doubtful: bool,
    before: [Option<Past>; 2],
    /// Tertia's filter, which may have made the track.
    shadow: Shadow,
    /// If another filter made it: its gain, and the track that Tertia's models make of the plots behind
    /// its rows.
    gain: Gain,
    filtered: Option<Filtered>,
    families: Option<Box<Families>>,
    covariances: Option<Box<Covariances>>,
    foreign: f64,
    /// Whether the sensor states the covariances of its filter.
    is_stated: bool,
    /// Whether there have been rows without a plot.
    is_periodic: bool,
    /// Time of the last plot.
    plotted: f64,
}

impl Analysis {
    /// Starts with a row. Returns the plot behind it, too.
    pub fn new(row: Row, radar: &Radar) -> (Self, Option<Tracklet>) {
        let shadow = Shadow::new(&row, radar);
        let mut analysis = Self {
            last: row,
            is_doubtful: is_doubtful(&row, radar),
            before: [None; 2],
            shadow,
            gain: Gain::default(),
            filtered: None,
            families: None,
            covariances: Some(Box::new(Covariances::new(&row))),
            foreign: UNKNOWN,
            is_stated: false,
            is_periodic: false,
            plotted: row.time,
        };
        let plot = analysis.look_behind(None, None, &Evidence::default(), (radar, radar));
        (analysis, plot)
    }

    /// Adds a row, and returns the plot behind it. `radar` has the stated noise of plots, `noisy` the largest known.
    pub fn add(
        &mut self,
        row: Row,
        evidence: &Evidence,
        (radar, noisy): (&Radar, &Radar),
    ) -> Option<Tracklet> {
        let past = Past::new(&self.last, self.is_doubtful, self.plotted);
        self.before = [Some(past), self.before[0]];
        self.last = row;
        self.is_doubtful = !self.is_foreign() && is_doubtful(&row, radar);
        if coasts(&row, &past, radar) {
            self.is_periodic = true;
            return None;
        }
        // in doubt the filter is not updated; nor is the sensor's filter if the plot did not belong to
        // the target
        let plot = if self.is_doubtful { None } else { self.shadow.follow(&row, radar) };
        let is_same = self.shadow.is_same && !self.is_doubtful;
        let is_unlike = if is_same { 0.0 } else { 1.0 };
        self.foreign += MEMORY * (is_unlike - self.foreign);
        let mut innovation = None;
        if self.foreign < UNKNOWN {
            self.covariances = None;
        } else if let Some(covariances) = &mut self.covariances {
            innovation = covariances.innovation(&row, past.correction(&row), radar);
        } else {
            self.covariances = Some(Box::new(Covariances::new(&row)));
        }
        self.is_stated =
            innovation.is_some() && evidence.covariances.is_sure() && !self.is_periodic;
        let innovation = innovation.filter(|_| self.is_stated);
        let plot = plot.filter(|_| !self.is_foreign());
        let plot = self.look_behind(plot, innovation, evidence, (radar, noisy));
        self.plotted = row.time;
        plot
    }

    /// Takes what the rows were found to tell about the tracker of the sensor.
    pub fn found(&mut self) -> Option<Box<Evidence>> {
        if self.families.is_none() && self.covariances.is_none() {
            return None;
        }
        let families = self.families.as_mut().map(|own| std::mem::take(&mut own.found));
        let mut found = families.unwrap_or_default();
        if let Some(covariances) = &mut self.covariances {
            found.covariances = std::mem::take(&mut covariances.found);
        }
        Some(Box::new(found))
    }

    /// Whether a filter other than Tertia's made the track.
    fn is_foreign(&self) -> bool {
        self.foreign > FOREIGN
    }

    /// Returns what is known of the plot behind the last row: `plot`, or an estimate without knowledge of
    /// the filter.
    fn look_behind(
        &mut self,
        plot: Option<[f64; 2]>,
        innovation: Option<[f64; 2]>,
        evidence: &Evidence,
        (radar, noisy): (&Radar, &Radar),
    ) -> Option<Tracklet> {
        let last = (&self.last, self.is_doubtful);
        if !self.is_foreign() || evidence.is_complete() {
            self.families = None;
        } else if self.families.is_none() {
            self.families = Some(Box::new(Families::new(&self.last, radar)));
        }
        let gain = (&mut self.gain, evidence, self.is_periodic);
        let families = self.families.as_deref_mut();
        let (place, own, added) =
            match behind(plot, innovation, last, &self.before, gain, families, (radar, noisy)) {
                Behind::Plot(place, added) => (place, None, added),
                Behind::State(place, covariance) => (place, Some(covariance), Plane::default()),
                Behind::Nothing => return None,
            };
        if plot.is_some() {
            self.filtered = None;
        } else if let Some(filtered) = &mut self.filtered {
            let noise = own.unwrap_or_else(|| noisy.noise_at(place, self.last.above(noisy)));
            filtered.follow(self.last.time, place, noise.plus(added), radar);
        } else {
            self.filtered = Some(Filtered::new(&self.last, radar));
        }
        Some(Tracklet::new(&self.last, place, (own, added), radar))
    }

    /// By how much the last row corrected the state; zero for the first row.
    pub fn correction(&self) -> [f64; 4] {
        self.before[0].map_or([0.0; 4], |past| past.correction(&self.last))
    }

    /// Returns position and velocity of the track at a time.
    pub fn at(&self, time: f64, radar: &Radar) -> Estimate<4> {
        self.foreign_filter().map_or_else(|| self.last.at(time, radar), |own| own.at(time))
    }

    /// Share of the variance of its positions that lasts.
    pub fn lasting(&self) -> f64 {
        self.foreign_filter().map_or(0.0, Filtered::lasting)
    }

    /// Returns Tertia's filter of the track if another filter made it.
    fn foreign_filter(&self) -> Option<&Filtered> {
        self.filtered.as_ref().filter(|_| self.is_stated || self.is_foreign())
    }
}
