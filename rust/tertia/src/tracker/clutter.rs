//! The density of plots that belong to no track.

use super::association::Association;
use super::doubles::Seconds;
use super::extent::Extent;
use super::fixed::Fixed;
use super::level::Heights;
use super::patches::Patches;
use super::plot::Measured;
use super::prospects::There;
use super::settings::Settings;
use super::share::run;
use super::tally::{Places, Tally, estimated, gain_by_way};
use super::weighed::Weighed;
use crate::sensors::Radar;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Scans over which the mean is taken, and over which it is found whether plots are along routes.
const MEMORY: f64 = 10.0;
const ON_ROUTES: f64 = 30.0;
/// Scans in which plots have been counted before these tell their density.
const ENOUGH: f64 = 0.5;
/// Plots on routes, and elsewhere, before any was seen.
const BEFOREHAND: f64 = 1.0;
/// Density over the mean above which plots come again and again.
const FIXED: f64 = 100.0;
/// Range of a radar without limit that has no plots yet, m.
const NEAREST_LIMIT: f64 = 1e4;

/// The density of false plots of one radar.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Clutter {
    known: Option<f64>,
    /// Plots of tracks that have ended without being confirmed.
    lately: Tally,
    /// Those of the first scan, when all targets are new, and until when it was, s.
    opening: Tally,
    opened: f64,
    /// Where the first ones are, with weights that fade later.
    places: Places,
    /// Plots of tracks that may still be confirmed.
    held: Held,
    /// Until when they are counted, s.
    until: f64,
    farthest: f64,
    /// Of a sensor of positions.
    extent: Option<Extent>,
    /// Where they are dense; of radars, if the density is estimated.
    patches: Option<Patches>,
    /// Where they come again and again, if targets are in the air.
    fixed: Option<Fixed>,
}

/// Plots of tentative tracks, which count as far as these are likely to be of false plots.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Held {
    all: Tally,
    /// Without those of the first scan.
    since: Tally,
    places: Places,
}

impl Held {
    /// Both together.
    pub fn with(&self, other: &Self) -> Self {
        let [all, since] = [self.all.with(&other.all), self.since.with(&other.since)];
        Self { all, since, places: self.places.with(&other.places) }
    }
}

impl Clutter {
    /// That of a sensor before any plot; a density that is not a number is estimated.
    pub fn of(settings: &Settings, sensor: usize) -> Self {
        let extent = settings
            .geometry(sensor)
            .is_position()
            .then(|| Extent::new(settings.max_speed, settings.radars[sensor].scan_period));
        let is_estimated = Self::is_estimated(settings, sensor);
        let patches = is_estimated.then(Patches::default);
        let fixed = Self::knows_fixed(settings, sensor).then(Fixed::default);
        Self { extent, patches, fixed, ..Self::new(settings.clutter_density) }
    }

    /// Whether the density of a radar's plots is estimated.
    fn is_estimated(settings: &Settings, sensor: usize) -> bool {
        let is_paper = matches!(settings.association, Association::Paper(_));
        let is_position = settings.geometry(sensor).is_position();
        settings.clutter_density.is_nan() && !is_paper && !is_position
    }

    /// Whether it is looked where plots of a sensor come again and again: if targets are in the air.
    pub fn knows_fixed(settings: &Settings, sensor: usize) -> bool {
        settings.heights == Heights::Air && Self::is_estimated(settings, sensor)
    }

    fn new(density: f64) -> Self {
        let known = (!density.is_nan()).then_some(density);
        let until = f64::NEG_INFINITY;
        let farthest = NEAREST_LIMIT;
        Self {
            known,
            lately: Tally::default(),
            opening: Tally::default(),
            opened: until,
            places: Places::default(),
            held: Held::default(),
            until,
            farthest,
            extent: None,
            patches: None,
            fixed: None,
        }
    }

    /// Such plots per square metre and scan, new targets included.
    pub fn density(&self, radar: &Radar) -> f64 {
        self.known.unwrap_or_else(|| estimated(&self.all(), radar) / self.area(radar))
    }

    /// Those of tracks that have ended, and of tentative ones.
    fn all(&self) -> Tally {
        self.lately.with(&self.held.all)
    }

    /// The density where a plot is, as it is known now, where those are not counted that came in the first
    /// scan, if others are known, or are among so many of the `own` plots of a track. The early ones of a track
    /// that `stays` may be of a fixed echo. None where it is not estimated, or not yet.
    pub fn known_since(
        &self,
        radar: &Radar,
        plot: &Weighed,
        (own, stays): (f64, bool),
    ) -> Option<f64> {
        let patches = self.patches.as_ref()?;
        let since = self.lately.less(&self.opening).with(&self.held.since);
        let since = Some(since).filter(|since| since.scans >= ENOUGH);
        let since = since.unwrap_or_else(|| self.all());
        if since.scans == 0.0 {
            return None;
        }
        let mean = estimated(&since, radar) / self.area(radar);
        let is_early = plot.time < self.opened + MEMORY * radar.scan_period;
        let fixed = self.fixed.as_ref().filter(|_| stays && is_early);
        let again = fixed.map_or(1.0, |fixed| fixed.ratio(radar, plot.position, mean));
        let ratio = patches.ratio(plot.position, mean, own).max(again);
        Some(mean * ratio * (-gain_by_way(&since, radar, plot.detection)).exp())
    }

    /// Whether two places are alike.
    pub fn is_same_patch(&self, one: [f64; 2], other: [f64; 2]) -> bool {
        self.patches.as_ref().is_some_and(|patches| patches.is_same(one, other))
    }

    /// Logarithm of how much likelier targets are detected so, and here, than false plots are, by
    /// comparison with all plots of the radar.
    pub fn gain(&self, radar: &Radar, plot: &Measured) -> f64 {
        let by_way = gain_by_way(&self.all(), radar, plot.detection);
        let Some(patches) = &self.patches else { return by_way };
        let mean = self.density(radar);
        let ratio = patches.ratio(plot.position, mean, 0.0);
        by_way - ratio.max(self.again(radar, plot, mean)).ln()
    }

    /// Density at the place of a plot where plots come again and again, over the mean.
    fn again(&self, radar: &Radar, plot: &Measured, mean: f64) -> f64 {
        let fixed = self.fixed.as_ref().filter(|_| plot.is_bare());
        fixed.map_or(1.0, |fixed| fixed.ratio(radar, plot.position, mean))
    }

    /// Whether a plot is where plots come again and again.
    pub fn is_fixed(&self, radar: &Radar, plot: &Measured) -> bool {
        self.again(radar, plot, self.density(radar)) > FIXED
    }

    /// Whether a place is one where plots come again and again, more likely than not.
    pub fn has_source(&self, radar: &Radar, position: [f64; 2]) -> bool {
        let mean = self.density(radar);
        self.fixed.as_ref().is_some_and(|fixed| fixed.is_source(radar, position, mean))
    }

    /// Notes where a plot is that may be of a fixed echo.
    pub fn stays(&mut self, radar: &Radar, plot: &Measured) {
        if let Some(fixed) = self.fixed.as_mut().filter(|_| plot.is_bare()) {
            fixed.add(radar, plot.position);
        }
    }

    /// Counts where a plot is that no confirmed track has, unless second plots of targets are as dense there.
    fn note(&mut self, plot: &Measured, second: f64, radar: &Radar) {
        if self.patches.is_none() || second > self.density(radar) {
            return;
        }
        let range = self.range(radar);
        if !self.is_fixed(radar, plot)
            && let Some(patches) = &mut self.patches
        {
            patches.add(plot.position, range);
        }
        self.stays(radar, plot);
    }

    /// Takes over how dense plots are, and where they come again and again.
    pub fn learn(&mut self, other: &Self) {
        self.clone_from(other);
        let Held { all, places, .. } = std::mem::take(&mut self.held);
        (self.lately, self.places) = (self.lately.with(&all), self.places.with(&places));
        self.until = f64::NEG_INFINITY;
        (self.opening, self.opened) = (Tally::default(), f64::NEG_INFINITY);
    }

    /// Whether false plots were denser in some places than in others.
    pub fn is_uneven(&self, radar: &Radar) -> bool {
        self.patches.as_ref().is_some_and(|patches| patches.is_uneven(self.area(radar)))
    }

    /// Notes the first plot of a track that was never confirmed.
    pub fn drop(&mut self, radar: &Radar, position: [f64; 2]) {
        let range = self.range(radar);
        if let Some(patches) = &mut self.patches {
            patches.drop(position, range);
        }
    }

    /// Whether there are such places.
    pub fn has_fixed(&self, radar: &Radar) -> bool {
        let (mean, area) = (self.density(radar), self.area(radar));
        self.fixed.as_ref().is_some_and(|fixed| fixed.has_sources(mean, area))
    }

    /// Finds by a first plot whether the density is even.
    pub fn weigh(&mut self, radar: &Radar, position: [f64; 2]) {
        let mean = self.density(radar);
        if let Some(patches) = &mut self.patches {
            patches.weigh(position, mean);
        }
    }

    /// Such plots per scan.
    pub fn plots(&self, radar: &Radar) -> f64 {
        self.density(radar) * self.area(radar)
    }

    pub fn area(&self, radar: &Radar) -> f64 {
        if let Some(extent) = &self.extent {
            return extent.area();
        }
        PI * self.range(radar).powi(2)
    }

    fn range(&self, radar: &Radar) -> f64 {
        radar.max_range.min(self.farthest)
    }

    /// Density of such plots where flights are due over the mean, at least 1; none before a first scan.
    pub fn crowding(&self) -> Option<f64> {
        let all = self.places.with(&self.held.places);
        let mean = all.there.due / all.plots.max(f64::MIN_POSITIVE);
        (self.lately.scans > 0.0).then(|| mean.max(1.0))
    }

    /// Share of such plots that are along routes, beyond those that are everywhere.
    pub fn on_routes(&self) -> f64 {
        let all = self.places.with(&self.held.places);
        (all.there.routed + BEFOREHAND) / (all.plots + 2.0 * BEFOREHAND)
    }

    pub fn saw(&mut self, radar: &Radar, position: [f64; 2]) {
        match &mut self.extent {
            Some(extent) => extent.saw(position),
            None => self.farthest = self.farthest.max(radar.about(position)),
        }
    }

    /// Plots have been assigned from `begin` to `end`. The first ones of a radar are those of a whole scan if
    /// they all have one time.
    pub fn pass(
        &mut self,
        [begin, end]: [f64; 2],
        have_one_time: impl Fn() -> bool,
        radar: &Radar,
    ) {
        let period = radar.scan_period;
        let mut scans = (end - self.until.max(begin - period)).max(0.0) / period;
        if self.lately.scans == 0.0 {
            self.opened = begin + period;
            if !have_one_time() {
                scans = ((end - begin) / period).max(ENOUGH);
            }
        }
        self.until = self.until.max(end);
        let kept = (-scans / MEMORY).exp();
        self.lately.fade(kept);
        self.lately.scans += scans;
        self.opening.fade(kept);
        if 0.5 * (begin + end) < self.opened {
            self.opening.scans += scans;
        }
        self.places.fade((-scans / ON_ROUTES).exp());
        if let Some(extent) = &mut self.extent {
            extent.fade(kept);
        }
        if let Some(patches) = &mut self.patches {
            patches.fade(scans);
        }
        if let Some(fixed) = &mut self.fixed {
            fixed.fade(scans);
        }
    }

    /// Takes the plots of all tentative tracks in the place of those of before.
    pub fn hold(&mut self, held: Held) {
        self.held = held;
    }

    /// Adds a plot of a tentative track that is of false plots with this probability.
    pub fn add(&self, held: &mut Held, radar: &Radar, plot: &Weighed, probability: f64) {
        let weight = probability * self.weight(radar, plot.time, MEMORY);
        held.all.add(plot.detection, weight);
        if plot.time >= self.opened {
            held.since.add(plot.detection, weight);
        }
    }

    /// Adds where the first plot of such a track was.
    pub fn add_place(&self, held: &mut Held, radar: &Radar, (time, there): (f64, There)) {
        held.places.add(there, self.weight(radar, time, ON_ROUTES));
    }

    /// Counts a plot of a track that was never confirmed.
    pub fn count(&mut self, radar: &Radar, plot: &Weighed) {
        let weight = self.weight(radar, plot.time, MEMORY);
        self.lately.add(plot.detection, weight);
        if plot.time < self.opened {
            self.opening.add(plot.detection, weight);
        }
    }

    /// Counts where the first plot of such a track was.
    pub fn count_place(&mut self, radar: &Radar, (time, there): (f64, There)) {
        let weight = self.weight(radar, time, ON_ROUTES);
        self.places.add(there, weight);
    }

    /// Weight of a plot of this time now.
    fn weight(&self, radar: &Radar, time: f64, memory: f64) -> f64 {
        (-(self.until - time).max(0.0) / radar.scan_period / memory).exp()
    }
}

/// Counts the plots before `hold` that confirmed tracks have left where they are, unless second plots of
/// targets are as dense there as false ones; each radar for itself, on so many threads.
pub(super) fn note(
    (plots, hold): (&[Measured], f64),
    (taken, deferred): (&[bool], &[bool]),
    seconds: &Seconds,
    (clutter, radars): (&mut [Clutter], &[Radar]),
    threads: usize,
) {
    let mut left = vec![Vec::new(); radars.len()];
    for i in (0..plots.len()).filter(|&i| !taken[i] && !deferred[i] && plots[i].time < hold) {
        left[plots[i].radar].push(i);
    }
    let parts = clutter.iter_mut().zip(radars).zip(left).collect();
    run(threads, parts, |((own, radar), left): ((&mut Clutter, &Radar), Vec<usize>)| {
        for (i, plot) in left.into_iter().map(|i| (i, &plots[i])) {
            own.note(plot, seconds.density(i), radar);
        }
    });
}

#[cfg(test)]
mod tests;
