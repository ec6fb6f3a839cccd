//! Estimates the density of false plots (clutter) from the plots of tracks that are not confirmed.

mod extent;
mod fixed_echoes;
mod map;
mod tally;
pub(super) mod weighed;

use super::filter::prospects::There;
use super::noise::duplicates::Seconds;
use super::plot::Measured;
use super::plot::level::Heights;
use super::settings::Settings;
use super::settings::association::Association;
use crate::base::batch::for_each_part;
use crate::sensors::Radar;
use extent::Extent;
use fixed_echoes::Fixed;
use map::Patches;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;
use tally::{Places, Tally, estimated, gain_by_way};
use weighed::Weighed;

/// Memory, in scans, of the mean density and of the share of false plots along routes.
const MEMORY: f64 = 10.0;
const ON_ROUTES: f64 = 30.0;
/// Number of scans whose plots must have been counted before they determine the density.
const ENOUGH: f64 = 0.5;
/// Prior number of false plots on routes, and elsewhere.
const BEFOREHAND: f64 = 1.0;
/// Ratio of the density to its mean above which a plot is attributed to a fixed echo.
const FIXED: f64 = 100.0;
/// Ratio of the density to its mean above which false plots count as denser than elsewhere.
const DENSER: f64 = 1.5;
/// Assumed maximum range of a radar without a limit, until it has plots farther away, m.
const NEAREST_LIMIT: f64 = 1e4;

/// The density of false plots of one sensor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Clutter {
    known: Option<f64>,
    /// Plots of tracks that have ended without being confirmed.
    lately: Tally,
    /// The part of `lately` from the first scan, in which all targets are new; `opened` is the end of that
    /// scan, s.
    opening: Tally,
    opened: f64,
    /// What flight plans say about the places of the first plots of tracks that have ended without being
    /// confirmed; the weights of these plots fade more slowly.
    places: Places,
    /// Plots of tentative tracks.
    held: Held,
    /// Time up to which plots are counted, s.
    until: f64,
    farthest: f64,
    /// Area of a position sensor.
    extent: Option<Extent>,
    /// Places where false plots are dense; only for radars whose density is estimated.
    patches: Option<Patches>,
    /// Fixed echoes; only if targets are in the air.
    fixed: Option<Fixed>,
}

/// Plots of tentative tracks, each weighted with the probability that its track consists of false plots.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Held {
    all: Tally,
    /// The plots since the end of the first scan.
    since: Tally,
    places: Places,
}

impl Held {
    /// Returns the sum of both.
    pub fn with(&self, other: &Self) -> Self {
        let [all, since] = [self.all.with(&other.all), self.since.with(&other.since)];
        Self { all, since, places: self.places.with(&other.places) }
    }
}

impl Clutter {
    /// The clutter of a sensor before its first plot; the density is estimated if that in the settings is
    /// nan.
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

    /// Whether the density of false plots of a radar is estimated.
    fn is_estimated(settings: &Settings, sensor: usize) -> bool {
        let is_paper = matches!(settings.association, Association::Paper(_));
        let is_position = settings.geometry(sensor).is_position();
        settings.clutter_density.is_nan() && !is_paper && !is_position
    }

    /// Whether fixed echoes of a sensor are looked for: only if targets are in the air and the density is
    /// estimated.
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

    /// False plots per square metre and scan; first plots of new targets are included.
    pub fn density(&self, radar: &Radar) -> f64 {
        self.known.unwrap_or_else(|| estimated(&self.all(), radar) / self.area(radar))
    }

    /// Plots of ended tracks and of tentative tracks.
    fn all(&self) -> Tally {
        self.lately.with(&self.held.all)
    }

    /// Density of false plots at the place of a plot, as it is known now. Plots of the first scan are not
    /// counted if later ones are known, nor is the number of plots that the track has in the same place
    /// (`own`). If the track `stays` where it is, its early plots may come from a fixed echo. None if the
    /// density is not estimated, or not yet.
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

    /// Whether false plots are known to be denser here than elsewhere.
    pub fn is_denser(&self, radar: &Radar, position: [f64; 2]) -> bool {
        let mean = self.density(radar);
        self.patches.as_ref().is_some_and(|patches| patches.ratio(position, mean, 1.0) > DENSER)
    }

    /// Whether two positions are in the same square of the map of dense places.
    pub fn is_same_patch(&self, one: [f64; 2], other: [f64; 2]) -> bool {
        self.patches.as_ref().is_some_and(|patches| patches.is_same(one, other))
    }

    /// What is known of it at present, for many plots.
    pub fn now<'a>(&'a self, radar: &'a Radar) -> Now<'a> {
        Now { clutter: self, radar, all: self.all(), mean: self.density(radar) }
    }

    /// Ratio of the density at the place of a plot to the mean density, by fixed echoes.
    fn again(&self, radar: &Radar, plot: &Measured, mean: f64) -> f64 {
        let fixed = self.fixed.as_ref().filter(|_| plot.is_bare());
        fixed.map_or(1.0, |fixed| fixed.ratio(radar, plot.position, mean))
    }

    /// Whether a plot is at the place of a fixed echo.
    pub fn is_fixed(&self, radar: &Radar, plot: &Measured) -> bool {
        self.again(radar, plot, self.density(radar)) > FIXED
    }

    /// Whether there is more likely than not a fixed echo at this place.
    pub fn has_source(&self, radar: &Radar, position: [f64; 2]) -> bool {
        let mean = self.density(radar);
        self.fixed.as_ref().is_some_and(|fixed| fixed.is_source(radar, position, mean))
    }

    /// Counts a plot that may come from a fixed echo.
    pub fn stays(&mut self, radar: &Radar, plot: &Measured) {
        if let Some(fixed) = self.fixed.as_mut().filter(|_| plot.is_bare()) {
            fixed.add(radar, plot.position);
        }
    }

    /// Counts the place of a plot that no confirmed track has taken, unless second plots of targets, with the
    /// density `second`, are denser there than false plots, which have a `mean` density.
    fn note(&mut self, plot: &Measured, second: f64, (radar, mean): (&Radar, f64)) {
        if self.patches.is_none() || second > mean {
            return;
        }
        let (range, is_fixed) = (self.range(radar), self.again(radar, plot, mean) > FIXED);
        if !is_fixed && let Some(patches) = &mut self.patches {
            patches.add(plot.position, range);
        }
        self.stays(radar, plot);
    }

    /// Takes over from another estimate how dense false plots are, and where they occur again and again.
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

    /// Whether there are fixed echoes.
    pub fn has_fixed(&self, radar: &Radar) -> bool {
        let (mean, area) = (self.density(radar), self.area(radar));
        self.fixed.as_ref().is_some_and(|fixed| fixed.has_sources(mean, area))
    }

    /// Takes the first plot of a track as evidence for or against an even density.
    pub fn weigh(&mut self, radar: &Radar, position: [f64; 2]) {
        let mean = self.density(radar);
        if let Some(patches) = &mut self.patches {
            patches.weigh(position, mean);
        }
    }

    /// False plots per scan.
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

    /// Ratio of the density of false plots where flights are due to the mean density, at least 1; none before
    /// the first scan.
    pub fn crowding(&self) -> Option<f64> {
        let all = self.places.with(&self.held.places);
        let mean = all.there.due / all.plots.max(f64::MIN_POSITIVE);
        (self.lately.scans > 0.0).then(|| mean.max(1.0))
    }

    /// Share of false plots that lie along routes, in excess of those that occur everywhere.
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

    /// Notes that plots have been assigned from `begin` to `end`. The first plots of a radar are those of a
    /// whole scan if they all have the same time.
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

    /// Replaces the plots of tentative tracks by the present ones.
    pub fn hold(&mut self, held: Held) {
        self.held = held;
    }

    /// Adds to `held` a plot of a tentative track that consists of false plots with this probability.
    pub fn add(&self, held: &mut Held, radar: &Radar, plot: &Weighed, probability: f64) {
        let weight = probability * self.weight(radar, plot.time, MEMORY);
        held.all.add(plot.detection, weight);
        if plot.time >= self.opened {
            held.since.add(plot.detection, weight);
        }
    }

    /// Adds to `held` the place of the first plot of a tentative track.
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

    /// Counts the place of the first plot of a track that was never confirmed.
    pub fn count_place(&mut self, radar: &Radar, (time, there): (f64, There)) {
        let weight = self.weight(radar, time, ON_ROUTES);
        self.places.add(there, weight);
    }

    /// Present weight of a plot of this time; `memory` is a number of scans.
    fn weight(&self, radar: &Radar, time: f64, memory: f64) -> f64 {
        (-(self.until - time).max(0.0) / radar.scan_period / memory).exp()
    }
}

/// The density of false plots of one sensor at present.
pub(super) struct Now<'a> {
    clutter: &'a Clutter,
    radar: &'a Radar,
    all: Tally,
    mean: f64,
}

impl Now<'_> {
    /// Log-likelihood ratio, target against false plot, of the channels that detected a plot and of its
    /// place, relative to all plots of the radar.
    pub fn gain(&self, plot: &Measured) -> f64 {
        let by_way = gain_by_way(&self.all, self.radar, plot.detection);
        let Some(patches) = &self.clutter.patches else { return by_way };
        let ratio = patches.ratio(plot.position, self.mean, 0.0);
        let ratio = ratio.max(self.clutter.again(self.radar, plot, self.mean));
        // often the case, and faster
        if ratio == 1.0 { by_way } else { by_way - ratio.ln() }
    }
}

/// Tells the clutter estimates over which interval of time plots, sorted by time, have been assigned.
pub(super) fn pass(
    (plots, deferred): (&[Measured], &[bool]),
    clutter: &mut [Clutter],
    radars: &[Radar],
) {
    let settled = || plots.iter().zip(deferred).filter(|(_, d)| !**d).map(|(plot, _)| plot);
    let (Some(first), Some(last)) = (settled().next(), settled().next_back()) else { return };
    for (sensor, own) in clutter.iter_mut().enumerate() {
        let mine = || settled().filter(|plot| plot.radar == sensor).map(|plot| plot.time);
        let have_one_time = || mine().is_sorted_by(|a, b| a == b);
        own.pass([first.time, last.time], have_one_time, &radars[sensor]);
    }
}

/// Counts the places of the plots before `hold` that no confirmed track has taken, unless second plots of
/// targets are denser there than false plots. The radars are independent of one another and are divided among
/// the threads.
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
    for_each_part(threads, parts, |((own, radar), left): ((&mut Clutter, &Radar), Vec<usize>)| {
        let mean = own.density(radar);
        for (i, plot) in left.into_iter().map(|i| (i, &plots[i])) {
            own.note(plot, seconds.density(i), (radar, mean));
        }
    });
}

#[cfg(test)]
mod tests;
