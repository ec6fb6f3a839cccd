//! Finds second plots that radars make of one target in a scan: duplicates and split plots.

use crate::association::Grid;
use crate::base::plane::Plane;
use crate::tracker::plot::Measured;
use crate::tracker::replies::height::SPAN;
use crate::tracker::replies::identity::IDENTITIES;
use crate::tracker::settings::Settings;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// Number of plots of targets over which the share of second plots is averaged.
const MEMORY: f64 = 1000.0;
/// Prior number of plots of targets, and of second plots among them: without this prior, every second plot in
/// the first scans would start a track.
const BEFORE: f64 = 50.0;
const SECONDS_BEFORE: f64 = 10.0;
/// Share of second plots above which they are left out before tracks search for plots, and number of second
/// plots from which the share is known: targets close together seem to make a few until all of them have
/// tracks.
const OFTEN: f64 = 0.05;
const ENOUGH: f64 = 15.0;
/// Normalised distance squared within which two plots of one target are in 99 % of all cases.
const NEAR: f64 = 9.21;
/// Largest difference between the heights of two plots of one target, m, and the likelihood ratio, one target
/// against two, of heights that differ by less.
const ROUNDED: f64 = 100.0;
const ONE_HEIGHT: f64 = 0.5 * SPAN / ROUNDED;
/// Longest time between two plots of one target in a scan, as a share of the scan.
const SOON: f64 = 0.1;

/// How often a radar makes a second plot of a target.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Doubles {
    seconds: f64,
    targets: f64,
}

impl Doubles {
    /// Share of the plots of targets that have a second plot.
    fn share(&self) -> f64 {
        (self.seconds + SECONDS_BEFORE) / (self.targets + BEFORE)
    }

    /// Whether the radar makes many second plots.
    pub fn is_often(&self) -> bool {
        self.seconds > ENOUGH && self.seconds > OFTEN * (self.targets + BEFORE)
    }

    fn count(&mut self, targets: f64, seconds: f64) {
        let kept = (-targets / MEMORY).exp();
        self.targets = kept * self.targets + targets;
        self.seconds = kept * self.seconds + seconds;
    }
}

/// The plots of a scan, and which of them are left out as second plots.
#[derive(Clone, Copy)]
pub(in crate::tracker) struct Near<'a> {
    pub grid: &'a Grid,
    pub plots: &'a [Measured],
    pub left_out: &'a [bool],
}

/// Finds the second plots of those radars that make many. Cost O(plots).
pub(in crate::tracker) fn leave_out(
    (grid, plots): (&Grid, &[Measured]),
    doubles: &[Doubles],
    settings: &Settings,
    left_out: &mut Vec<bool>,
) {
    left_out.clear();
    left_out.resize(plots.len(), false);
    let often: Vec<bool> = doubles.iter().map(Doubles::is_often).collect();
    for (i, plot) in plots.iter().enumerate().filter(|(_, plot)| often[plot.radar]) {
        let mut is_second = false;
        Pairs::of(plot, settings).each(grid, plots, |k, distance| {
            is_second |=
                k < i && !left_out[k] && distance < NEAR && likeness(plot, &plots[k]) > 0.0;
        });
        left_out[i] = is_second;
    }
}

/// Likelihood ratio, one target against two, of the identities and heights of two plots; 0 if these can only
/// be of two targets.
fn likeness(a: &Measured, b: &Measured) -> f64 {
    let apart = (a.height - b.height).abs();
    let height = match () {
        () if apart.is_nan() => 1.0,
        () if apart <= ROUNDED => ONE_HEIGHT,
        () => 0.0,
    };
    height
        * match a.identities.same(&b.identities) {
            None => 1.0,
            Some(true) => IDENTITIES,
            Some(false) => 0.0,
        }
}

/// A search for plots that the radar of a plot may have made of the same target at the same time.
struct Pairs<'a> {
    plot: &'a Measured,
    soon: f64,
    r: Plane,
}

impl<'a> Pairs<'a> {
    fn of(plot: &'a Measured, settings: &Settings) -> Self {
        let radar = &settings.radars[plot.radar];
        let seen = radar.detecting(plot.detection);
        let r = seen.noise_at(plot.position, plot.height - radar.position[2]);
        Self { plot, soon: SOON * radar.scan_period, r: r.plus(r) }
    }

    /// Calls `look` with the index of each such plot, and its normalised distance squared.
    fn each(&self, grid: &Grid, plots: &[Measured], mut look: impl FnMut(usize, f64)) {
        let Self { plot, soon, r } = self;
        let inverse = r.inverse();
        let half = [r.xx, r.yy].map(|variance| (NEAR * variance).sqrt());
        let low = [plot.position[0] - half[0], plot.position[1] - half[1]];
        let high = [plot.position[0] + half[0], plot.position[1] + half[1]];
        grid.entries(low, high, &mut |other| {
            let k = other.index as usize;
            if other.tag as usize == plot.radar && (plots[k].time - plot.time).abs() < *soon {
                let y = [0, 1].map(|axis| plot.position[axis] - other.point[axis]);
                look(k, inverse.form(y));
            }
        });
    }
}

/// Where second plots of the targets of a scan may be, and how dense.
#[derive(Default)]
pub(in crate::tracker) struct Seconds {
    /// Density, at each plot, of second plots of the plots of confirmed tracks, per square metre and scan. It
    /// is multiplied by the likelihood ratio of heights and identities, so that it can be compared with the
    /// density of false plots.
    of_confirmed: Vec<f64>,
    /// Pairs of plots that no confirmed track has, in ascending order: a plot, another plot near it, and the
    /// density of second plots of the other one at the first.
    pairs: Vec<(usize, usize, f64)>,
}

impl Seconds {
    /// Density, at each plot, of second plots of the plots of confirmed tracks.
    pub fn of_confirmed(&self) -> &[f64] {
        &self.of_confirmed
    }

    /// Density, at a plot, of second plots of other plots that no confirmed track has, as far as these are
    /// the first plots of their targets. Cost O(log pairs).
    pub fn of_others(&self, plot: usize, mut is_first: impl FnMut(usize) -> bool) -> f64 {
        let near = &self.pairs[self.pairs.partition_point(|pair| pair.0 < plot)..];
        let own = near.iter().take_while(|pair| pair.0 == plot);
        own.filter(|pair| is_first(pair.1)).map(|pair| pair.2).sum()
    }

    /// Density of second plots at a plot, if the plot with the lower index of any two is the first one of its
    /// target.
    pub fn density(&self, plot: usize) -> f64 {
        self.of_confirmed[plot] + self.of_others(plot, |other| other < plot)
    }

    /// Finds where second plots may be in a scan, some of whose plots confirmed tracks have taken, and counts
    /// second plots of these tracks. Cost O(plots).
    pub fn find(
        &mut self,
        Near { grid, plots, left_out }: Near<'_>,
        (taken, deferred): (&[bool], &[bool]),
        doubles: &mut [Doubles],
        settings: &Settings,
    ) {
        self.pairs.clear();
        self.of_confirmed.clear();
        self.of_confirmed.resize(plots.len(), 0.0);
        let mut counts = vec![(0.0, 0.0); doubles.len()];
        let is_taken = |i: usize| taken[i] && !left_out[i];
        let is_free = |i: usize| !taken[i] && !deferred[i];
        // a target may report its position to a position sensor any number of times
        let polar = |plot: &Measured| !settings.geometry(plot.radar).is_position();
        for (i, plot) in plots.iter().enumerate().filter(|(_, plot)| polar(plot)) {
            let count = &mut counts[plot.radar];
            if is_taken(i) {
                count.0 += 1.0;
            }
            if is_taken(i) || deferred[i] {
                continue;
            }
            let near = Pairs::of(plot, settings);
            let scale = TAU * near.r.determinant().sqrt();
            let (mut is_second, first) = (false, self.pairs.len());
            near.each(grid, plots, |k, d| {
                let density = likeness(plot, &plots[k]) * (-0.5 * d).exp() / scale;
                if d > NEAR || density == 0.0 {
                    return;
                }
                if is_taken(k) {
                    is_second = true;
                    self.of_confirmed[i] += density;
                } else if k != i && is_free(i) && is_free(k) {
                    self.pairs.push((i, k, density));
                }
            });
            // in an order that does not depend on the grid
            self.pairs[first..].sort_unstable_by_key(|pair| pair.1);
            count.1 += f64::from(u8::from(is_second));
        }
        for (doubles, (targets, seconds)) in doubles.iter_mut().zip(counts) {
            doubles.count(targets, seconds);
        }
        for (density, plot) in self.of_confirmed.iter_mut().zip(plots) {
            *density *= doubles[plot.radar].share();
        }
        for (i, _, density) in &mut self.pairs {
            *density *= doubles[plots[*i].radar].share();
        }
    }
}
