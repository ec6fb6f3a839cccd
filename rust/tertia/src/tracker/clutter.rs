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
pub(super) use super::tally::Counts;
use super::tally::{Tally, estimated, gain_by_way};
use super::weighed::Weighed;
use crate::sensors::{Detection, Radar};
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
    lately: Tally,
    /// Those of the first scan, when all targets are new, and until when it was, s.
    opening: Tally,
    opened: f64,
    /// Sums of what plans say of where these plots are, and their number, with weights that fade later.
    there: There,
    placed: f64,
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
            there: There::default(),
            placed: 0.0,
            until,
            farthest,
            extent: None,
            patches: None,
            fixed: None,
        }
    }

    /// Such plots per square metre and scan, new targets included.
    pub fn density(&self, radar: &Radar) -> f64 {
        self.known.unwrap_or_else(|| estimated(&self.lately, radar) / self.area(radar))
    }

    /// The density where a plot is, as it is known now, where those are not counted that came in the first
    /// scan or are among so many of the `own` plots of a track. The early ones of a track that `stays` may be
    /// of a fixed echo. None where it is not estimated, or not yet.
    pub fn known_since(
        &self,
        radar: &Radar,
        plot: &Weighed,
        (own, stays): (f64, bool),
    ) -> Option<f64> {
        let patches = self.patches.as_ref()?;
        let since = self.lately.less(&self.opening);
        if since.scans < ENOUGH {
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
        let by_way = gain_by_way(&self.lately, radar, plot.detection);
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

    /// Whether a plot is where plots come again and again, more likely than not.
    pub fn is_fixed(&self, radar: &Radar, plot: &Measured) -> bool {
        self.again(radar, plot, self.density(radar)) > FIXED
    }

    /// Notes where a plot is that may be of a fixed echo.
    pub fn stays(&mut self, radar: &Radar, plot: &Measured) {
        if let Some(fixed) = self.fixed.as_mut().filter(|_| plot.is_bare()) {
            fixed.add(radar, plot.position);
        }
    }

    /// Takes over how dense plots are, and where they come again and again.
    pub fn learn(&mut self, other: &Self) {
        self.clone_from(other);
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
        self.fixed.as_ref().is_some_and(|fixed| fixed.has_sources(radar, mean, area))
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
        let mean = self.there.due / self.placed.max(f64::MIN_POSITIVE);
        (self.lately.scans > 0.0).then(|| mean.max(1.0))
    }

    /// Share of such plots that are along routes, beyond those that are everywhere.
    pub fn on_routes(&self) -> f64 {
        (self.there.routed + BEFOREHAND) / (self.placed + 2.0 * BEFOREHAND)
    }

    pub fn saw(&mut self, radar: &Radar, position: [f64; 2]) {
        match &mut self.extent {
            Some(extent) => extent.saw(position),
            None => self.farthest = self.farthest.max(radar.about(position)),
        }
    }

    /// Counts plots that belong to no track, from `begin` to `end`, and the scan before where nothing
    /// has been counted yet.
    pub fn count(&mut self, counts: &Counts, [begin, end]: [f64; 2], radar: &Radar) {
        let period = radar.scan_period;
        let scans = (end - self.until.max(begin - period)).max(0.0) / period;
        self.until = self.until.max(end);
        if self.lately.scans == 0.0 {
            self.opened = begin + period;
        }
        let kept = (-scans / MEMORY).exp();
        self.lately.fade(kept);
        self.lately.add(counts, scans);
        self.opening.fade(kept);
        if 0.5 * (begin + end) < self.opened {
            self.opening.add(counts, scans);
        }
        let kept_places = (-scans / ON_ROUTES).exp();
        self.there.fade(kept_places);
        self.there.add(counts.there, 1.0);
        self.placed = kept_places * self.placed + counts.all as f64;
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

    /// Counts a plot of a track that has never been confirmed, unless it is of a fixed echo.
    pub fn restore(&mut self, radar: &Radar, plot: &Weighed) {
        let mean = self.density(radar);
        if self.fixed.as_ref().is_some_and(|fixed| fixed.is_source(radar, plot.position, mean)) {
            return;
        }
        let weight = (-(self.until - plot.time).max(0.0) / radar.scan_period / MEMORY).exp();
        self.lately.restore(plot.detection, weight);
        if plot.time < self.opened {
            self.opening.restore(plot.detection, weight);
        }
    }

    /// Removes a plot of this time, detection and place that was counted but belongs to a target.
    pub fn discount(
        &mut self,
        time: f64,
        radar: &Radar,
        (detection, there): (Option<Detection>, There),
    ) {
        let age = (self.until - time).max(0.0) / radar.scan_period;
        let weight = (-age / MEMORY).exp();
        self.lately.remove(detection, weight);
        if time < self.opened {
            self.opening.remove(detection, weight);
        }
        let weight_of_place = (-age / ON_ROUTES).exp();
        self.placed = (self.placed - weight_of_place).max(0.0);
        self.there.add(there, -weight_of_place);
    }
}

/// Counts the plots before `hold` that confirmed tracks have left where they are, unless second plots of
/// targets are as dense there as false ones.
pub(super) fn note(
    (plots, hold): (&[Measured], f64),
    (taken, deferred): (&[bool], &[bool]),
    seconds: &Seconds,
    (clutter, radars): (&mut [Clutter], &[Radar]),
) {
    for i in (0..plots.len()).filter(|&i| !taken[i] && !deferred[i] && plots[i].time < hold) {
        let (plot, radar) = (&plots[i], &radars[plots[i].radar]);
        let own = &mut clutter[plot.radar];
        let Some(range) = own.patches.as_ref().map(|_| own.range(radar)) else { continue };
        if seconds.density(i) > own.density(radar) {
            continue;
        }
        if !own.is_fixed(radar, plot)
            && let Some(patches) = &mut own.patches
        {
            patches.add(plot.position, range);
        }
        own.stays(radar, plot);
    }
}

#[cfg(test)]
mod tests {
    use super::super::tally::FEWEST;
    use super::*;
    use crate::base::checks::assert_within;
    use crate::sensors::{Channel, Identities, radar_of};
    use crate::tracker::{ImmModel, Motion, Plot, Row, Tracker};

    /// A plot without height and identity.
    fn bare(time: f64, [range, azimuth]: [f64; 2], radar: usize) -> Plot {
        let (height, identities) = (f64::NAN, Identities::NONE);
        let (report, detection) = (None, None);
        Plot { time, range, azimuth, radar, height, identities, detection, report }
    }

    #[test]
    fn first_plots_of_targets_that_are_confirmed_are_no_false_plots() {
        let radar = Radar { max_range: 1e5, ..radar_of([50.0, 1e-3]) };
        let settings = Settings::new(vec![radar.clone()], Motion::Imm(ImmModel::default()));
        let mut tracker = Tracker::try_new(settings).unwrap();
        let (mut statuses, mut rows) = (Vec::new(), Vec::<Row>::new());
        for scan in 0..8 {
            // thirty aircraft on a circle, outwards
            let plots: Vec<Plot> = (0..30)
                .map(|k| {
                    let azimuth = 0.2 * f64::from(k);
                    let time = 4.0 * (f64::from(scan) + azimuth / std::f64::consts::TAU);
                    bare(time, [4e4 + 200.0 * time, azimuth], 0)
                })
                .collect();
            tracker.track(&plots[..], None, &mut statuses, &mut rows, None).unwrap();
        }
        assert_within(1e-12, tracker.clutter[0].plots(&radar), FEWEST);
    }

    #[test]
    fn false_plots_that_tentative_tracks_take_are_false_all_the_same() {
        let radars = [[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]].map(|[x, y]| Radar {
            position: [x * 1e4, y * 1e4, 0.0],
            max_range: 1e5,
            ..radar_of([50.0, 1e-3])
        });
        let settings = Settings::new(radars.to_vec(), Motion::Imm(ImmModel::default()));
        let mut tracker = Tracker::try_new(settings).unwrap();
        let (mut statuses, mut rows) = (Vec::new(), Vec::<Row>::new());
        for scan in 0..20 {
            let plots: Vec<Plot> = (0..4 * 300)
                .map(|k| {
                    // fractions of squares are as good as random
                    let square = f64::from(1200 * scan + k).powi(2);
                    let [a, b] = [0.618_033_988_75, 0.414_213_562_37].map(|u| (square * u).fract());
                    let (range, azimuth) = (1e5 * a.sqrt(), std::f64::consts::TAU * b);
                    let time = 4.0 * (f64::from(scan) + b);
                    bare(time, [range, azimuth], k as usize % 4)
                })
                .collect();
            tracker.track(&plots[..], None, &mut statuses, &mut rows, None).unwrap();
        }
        for (clutter, radar) in tracker.clutter.iter().zip(&radars) {
            assert_within(0.1, clutter.plots(radar) / 300.0, 1.0);
        }
    }

    /// A radar of echoes with .85, of which so many false ones are known, and replies with .95.
    fn with_channels(clutter_per_scan: f64) -> Radar {
        let channel = |detection_probability, clutter_per_scan| {
            Some(Channel { detection_probability, sigmas: [50.0, 1e-3], clutter_per_scan })
        };
        let radar = Radar { max_range: 1e5, ..radar_of([50.0, 1e-3]) };
        let channels = [channel(0.85, clutter_per_scan), channel(0.95, f64::NAN), None];
        radar.with_channels(channels).unwrap()
    }

    #[test]
    fn plots_weigh_what_their_way_of_detection_says() {
        let radar = with_channels(f64::NAN);
        let settings = Settings::new(vec![radar.clone()], Motion::Cv(1.0));
        let mut clutter = Clutter::of(&settings, 0);
        let gain = |clutter: &Clutter, d| gain_by_way(&clutter.lately, &radar, Some(d));
        // without false plots there are new targets alone, which are detected as others are
        for detection in [Detection::Psr, Detection::Ssr, Detection::PsrSsr] {
            assert!(gain(&clutter, detection).abs() < 1e-14);
        }
        assert_eq!(gain_by_way(&clutter.lately, &radar, None), 0.0);
        let mut counts = Counts::default();
        (0..100).for_each(|_| counts.add(Some(Detection::Psr), There::default()));
        clutter.count(&counts, [0.0, 4.0], &radar);
        // 100 echoes in two scans
        let (seen, share) = (0.9925, 0.0425 / 0.9925);
        let all = 50.0 + (0.1425 + 0.8075) / seen;
        assert_within(1e-12, clutter.plots(&radar), all);
        assert_within(1e-12, gain(&clutter, Detection::Psr), (share * all / 50.0).ln());
        assert_within(1e-12, gain(&clutter, Detection::PsrSsr), all.ln());
        // those that belong to targets were none
        for _ in 0..100 {
            clutter.discount(4.0, &radar, (Some(Detection::Psr), There::default()));
        }
        assert!(gain(&clutter, Detection::Psr).abs() < 1e-12);
    }

    #[test]
    fn false_plots_that_are_known_are_not_counted() {
        let radar = with_channels(40.0);
        let settings = Settings::new(vec![radar.clone()], Motion::Cv(1.0));
        let clutter = Clutter::of(&settings, 0);
        assert_within(1e-12, clutter.plots(&radar), 40.0 + 0.95 / 0.9925);
        // the shares of a density that is known are the same
        let dense = Clutter::of(&Settings { clutter_density: 1e-9, ..settings }, 0);
        assert_within(1e-12, dense.density(&radar), 1e-9);
        let gains =
            [clutter, dense].map(|own| gain_by_way(&own.lately, &radar, Some(Detection::Psr)));
        assert_within(1e-14, gains[0], gains[1]);
    }

    #[test]
    fn what_is_known_since_leaves_out_the_first_scan() {
        let radar = Radar { max_range: 1e5, ..radar_of([50.0, 1e-3]) };
        let settings = Settings::new(vec![radar.clone()], Motion::Cv(1.0));
        let mut clutter = Clutter::of(&settings, 0);
        let plot = Weighed::new(&Measured { position: [3e4, 4e4], ..Measured::default() }, 1e-9);
        let since = |clutter: &Clutter| clutter.known_since(&radar, &plot, (0.0, false));
        for (scan, all) in [300, 20, 20].into_iter().enumerate() {
            assert_eq!(since(&clutter).is_some(), scan > 1);
            let times = [0.0, 4.0].map(|end| 4.0 * scan as f64 + end);
            clutter.count(&Counts { all, ..Counts::default() }, times, &radar);
        }
        let plots = |clutter: &Clutter| since(clutter).unwrap() * clutter.area(&radar);
        assert_within(1e-12, plots(&clutter), 20.0);
        clutter.discount(2.0, &radar, (None, There::default()));
        assert_within(1e-12, plots(&clutter), 20.0);
    }

    #[test]
    fn a_plot_of_a_target_counts_as_if_it_had_never_been_counted() {
        let radar = Radar { max_range: 1e5, ..radar_of([50.0, 1e-3]) };
        let counted = |plots: usize| {
            let mut clutter = Clutter::new(f64::NAN);
            let counts = |all| Counts { all, ..Counts::default() };
            clutter.count(&counts(plots), [0.0, 4.0], &radar);
            clutter.count(&counts(7), [4.0, 24.0], &radar);
            clutter
        };
        let mut clutter = counted(90);
        for _ in 0..30 {
            clutter.discount(4.0, &radar, (None, There::default()));
        }
        assert_within(1e-13, clutter.plots(&radar), counted(60).plots(&radar));
        // the first plots were made in two scans, and have faded for five
        let fade = (-0.5_f64).exp();
        let expected = (60.0 * fade + 7.0) / (2.0 * fade + 5.0);
        assert_within(1e-13, clutter.plots(&radar), expected);
        // no plots less than none
        for _ in 0..1000 {
            clutter.discount(24.0, &radar, (None, There::default()));
        }
        assert_within(1e-13, clutter.plots(&radar), FEWEST);
    }
}
