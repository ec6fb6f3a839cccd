//! Plots that radars make twice of one target in a scan: duplicates and split plots.

use super::plot::Measured;
use super::settings::Settings;
use crate::association::Grid;
use crate::base::plane::Plane;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// Scans of a target over which the share is averaged.
const MEMORY: f64 = 1000.0;
/// Plots of targets, as if so many had been seen before, and the second plots among them: without these
/// every second plot of the first scans would begin a track.
const BEFORE: f64 = 50.0;
const SECONDS_BEFORE: f64 = 10.0;
/// Share from which second plots are left out before tracks look for plots, and how many it takes to
/// know it: targets close together make a few until all have a track.
const OFTEN: f64 = 0.05;
const ENOUGH: f64 = 15.0;
/// Distance squared of two plots of one target, in 99 % of all cases.
const NEAR: f64 = 9.21;
/// Difference of the heights of two plots of one target, m.
const ROUNDED: f64 = 100.0;
/// Seconds between two plots of one target, as a share of a scan.
const SOON: f64 = 0.1;

/// How often a radar makes a second plot of a target.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Doubles {
    seconds: f64,
    targets: f64,
}

impl Doubles {
    /// Share of the plots of targets that have a second one.
    fn share(&self) -> f64 {
        (self.seconds + SECONDS_BEFORE) / (self.targets + BEFORE)
    }

    /// Whether there are many.
    pub fn is_often(&self) -> bool {
        self.seconds > ENOUGH && self.seconds > OFTEN * (self.targets + BEFORE)
    }

    fn count(&mut self, targets: f64, seconds: f64) {
        let kept = (-targets / MEMORY).exp();
        self.targets = kept * self.targets + targets;
        self.seconds = kept * self.seconds + seconds;
    }
}

/// The plots of a scan, and which of them are left out as second ones.
#[derive(Clone, Copy)]
pub(super) struct Near<'a> {
    pub grid: &'a Grid,
    pub plots: &'a [Measured],
    pub left_out: &'a [bool],
}

/// Finds second plots of radars that make many. Cost O(plots).
pub(super) fn leave_out(
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
            is_second |= k < i && !left_out[k] && distance < NEAR && is_alike(plot, &plots[k]);
        });
        left_out[i] = is_second;
    }
}

/// Whether two plots may be of one target, by its identities and its height.
fn is_alike(a: &Measured, b: &Measured) -> bool {
    let one_code = a.identities.same(&b.identities) != Some(false);
    let apart = (a.height - b.height).abs();
    one_code && (apart.is_nan() || apart <= ROUNDED)
}

/// The plots that its radar may have made of the target of one plot at the same time.
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

    /// Calls `look` with the index of each, and its normalised distance squared.
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

/// For each plot that confirmed tracks have left, the density of second plots there, per square metre and
/// scan: of the plots of those tracks, and of earlier ones that have none. Cost O(plots).
pub(super) fn find(
    Near { grid, plots, left_out }: Near<'_>,
    (taken, deferred): (&[bool], &[bool]),
    doubles: &mut [Doubles],
    settings: &Settings,
    found: &mut Vec<f64>,
) {
    found.clear();
    found.resize(plots.len(), 0.0);
    let mut counts = vec![(0.0, 0.0); doubles.len()];
    let is_taken = |i: usize| taken[i] && !left_out[i];
    // a target may report its position as often as it likes
    let polar = |plot: &Measured| !settings.geometry(plot.radar).is_position();
    for (i, plot) in plots.iter().enumerate().filter(|(_, plot)| polar(plot)) {
        let count = &mut counts[plot.radar];
        if is_taken(i) {
            count.0 += 1.0;
            continue;
        }
        if deferred[i] {
            continue;
        }
        let pairs = Pairs::of(plot, settings);
        let scale = TAU * pairs.r.determinant().sqrt();
        let (mut density, mut nearest) = (0.0, f64::INFINITY);
        pairs.each(grid, plots, |k, d| {
            if is_taken(k) {
                nearest = f64::min(nearest, d);
            }
            if d < NEAR && (is_taken(k) || k < i && !taken[k] && !deferred[k]) {
                density += (-0.5 * d).exp() / scale;
            }
        });
        count.1 += f64::from(u8::from(nearest < NEAR));
        found[i] = density;
    }
    for (doubles, (targets, seconds)) in doubles.iter_mut().zip(counts) {
        doubles.count(targets, seconds);
    }
    for (found, plot) in found.iter_mut().zip(plots) {
        *found *= doubles[plot.radar].share();
    }
}
