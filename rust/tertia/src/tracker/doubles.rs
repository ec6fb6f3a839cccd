//! Plots that radars make twice of one target in a scan: duplicates and split plots.

use super::plot::Measured;
use super::settings::Settings;
use crate::association::Grid;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// Scans of a target over which the share is averaged.
const MEMORY: f64 = 1000.0;
/// Plots of targets, as if so many had been seen alone.
const ALONE: f64 = 50.0;
/// Distance squared of two plots of one target, in 99 % of all cases.
const NEAR: f64 = 9.21;
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
        self.seconds / (self.targets + ALONE)
    }

    fn count(&mut self, targets: f64, seconds: f64) {
        let kept = (-targets / MEMORY).exp();
        self.targets = kept * self.targets + targets;
        self.seconds = kept * self.seconds + seconds;
    }
}

/// For each plot that confirmed tracks have left, the density of second plots there, per square metre and
/// scan, and whether it is near a plot of a target. Cost O(plots).
pub(super) fn find(
    (grid, plots): (&Grid, &[Measured]),
    (taken, deferred): (&[bool], &[bool]),
    doubles: &mut [Doubles],
    settings: &Settings,
    found: &mut Vec<f64>,
) {
    found.clear();
    found.resize(plots.len(), 0.0);
    let mut counts = vec![(0.0, 0.0); doubles.len()];
    // a target may report its position as often as it likes
    let polar = |plot: &Measured| !settings.geometry(plot.radar).is_position();
    for (i, plot) in plots.iter().enumerate().filter(|(_, plot)| polar(plot)) {
        let count = &mut counts[plot.radar];
        if taken[i] {
            count.0 += 1.0;
            continue;
        }
        if deferred[i] {
            continue;
        }
        let radar = &settings.radars[plot.radar];
        let r = radar.noise_at(plot.position, plot.height - radar.position[2]);
        let r = r.plus(r);
        let (inverse, scale) = (r.inverse(), TAU * r.determinant().sqrt());
        let half = [r.xx, r.yy].map(|variance| (NEAR * variance).sqrt());
        let low = [plot.position[0] - half[0], plot.position[1] - half[1]];
        let high = [plot.position[0] + half[0], plot.position[1] + half[1]];
        let (mut density, mut nearest) = (0.0, f64::INFINITY);
        grid.between(low, high, &mut |k| {
            let other = &plots[k];
            let soon = (other.time - plot.time).abs() < SOON * radar.scan_period;
            if taken[k] && other.radar == plot.radar && soon {
                let y = [0, 1].map(|axis| plot.position[axis] - other.position[axis]);
                let d = inverse.form(y);
                nearest = f64::min(nearest, d);
                density += (-0.5 * d).exp() / scale;
            }
        });
        if nearest < NEAR {
            count.1 += 1.0;
            found[i] = density;
        }
    }
    for (doubles, (targets, seconds)) in doubles.iter_mut().zip(counts) {
        doubles.count(targets, seconds);
    }
    for (found, plot) in found.iter_mut().zip(plots) {
        *found *= doubles[plot.radar].share();
    }
}
