//! Plots far from targets that radars have missed: where a radar makes many, a few of them in a row look like
//! another target.

use super::clutter::Clutter;
use super::doubles::Near;
use super::noise::Noise;
use super::settings::Settings;
use super::track::Track;
use crate::association::Grid;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// Least distance squared of an outlier, and the largest.
const NEAREST: f64 = 9.0;
const FARTHEST: f64 = 3600.0;
/// Logarithm of the ratio of these distances: where nothing is known, as many are in each ring as wide as its
/// radius.
const RINGS: f64 = 3.0;
/// Plots over which means are taken, and those as if they had been seen before, with the outliers among them.
const MEMORY: f64 = 4000.0;
const BEFORE: f64 = 1000.0;
const OUTLIERS_BEFORE: f64 = 1.0;
const FEW: f64 = 100.0;
/// Plots until which outliers are looked for in any case, and later the share of those that tracks have taken,
/// and the number.
const FIRST: f64 = 200.0;
const OFTEN: f64 = 4e-4;
const SOME: f64 = 0.9;
/// Scans for which a target may be missed.
const LATELY: f64 = 2.5;
/// Share of them with which plots are looked at that may be outliers.
const NOT_RARE: f64 = 0.02;
/// Share from which it takes one more plot to confirm a track.
const MANY: f64 = 0.03;

/// A plot far from where one of a target was missed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Stray {
    radar: usize,
    /// Square of the distance.
    square: f64,
    /// Probability that it is of the target, if outliers are not rare.
    weight: f64,
}

impl Stray {
    pub fn radar(&self) -> usize {
        self.radar
    }
}

/// How many plots of a radar are far from their targets, and how far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Outliers {
    /// Plots of tracks, and outliers among them.
    plots: f64,
    taken: f64,
    /// Plots of tracks while others were looked for, plots far from targets that were missed, and the sum of
    /// the squares of their distances.
    watched: f64,
    far: f64,
    squares: f64,
}

impl Outliers {
    /// Counts a plot of a track.
    pub fn saw(&mut self) {
        let is_watched = f64::from(u8::from(self.are_sought()));
        let kept = 1.0 - 1.0 / MEMORY;
        let Self { plots, taken, watched, far, squares } = self;
        for count in [plots, taken, watched, far, squares] {
            *count *= kept;
        }
        self.plots += 1.0;
        self.watched += is_watched;
    }

    /// A plot that a track has taken was an outlier.
    pub fn took(&mut self) {
        self.taken += 1.0;
    }

    /// The target of a plot that was far has gone on as before.
    pub fn strayed(&mut self, stray: &Stray) {
        self.far += stray.weight;
        self.squares += stray.weight * stray.square;
    }

    /// Whether it is worth looking for them.
    fn are_sought(&self) -> bool {
        self.plots < FIRST || self.taken > SOME.max(OFTEN * self.plots)
    }

    /// Whether there are so many that one in three plots may well be one.
    pub fn are_many(&self) -> bool {
        self.far > MANY * (self.watched + self.far + FEW)
    }

    /// 2π times the density of outliers at this distance squared from where a plot was expected with a
    /// covariance of this determinant, per square metre and scan.
    pub fn density(&self, square: f64, determinant: f64) -> f64 {
        self.share() * self.spread(square, determinant)
    }

    fn share(&self) -> f64 {
        let taken = (self.taken + OUTLIERS_BEFORE) / (self.plots + BEFORE);
        taken.max(self.far / (self.watched + self.far + FEW))
    }

    /// The density of one outlier.
    fn spread(&self, square: f64, determinant: f64) -> f64 {
        let size = (0.5 * self.squares / self.far.max(1.0)).max(NEAREST);
        let normal = (-0.5 * square / size).exp() / size;
        normal.max(1.0 / (RINGS * square.max(NEAREST))) / determinant.sqrt()
    }
}

/// Adds to the densities of plots that are no false plots what outliers of the targets that were missed make
/// there. Cost O(tracks + plots), nothing for radars without outliers.
pub(super) fn find(
    Near { plots, .. }: Near<'_>,
    (taken, deferred): (&[bool], &[bool]),
    (tracks, settings): (&mut [Track], &Settings),
    (noise, clutter): (&[Noise], &[Clutter]),
    found: &mut [f64],
) {
    let is_often = |(radar, noise): (usize, &Noise)| {
        noise.outliers.are_sought() && !settings.geometry(radar).is_position()
    };
    let often: Vec<bool> = noise.iter().enumerate().map(is_often).collect();
    if !often.contains(&true) {
        return;
    }
    let confirmed: Vec<usize> = (0..tracks.len()).filter(|&k| tracks[k].is_confirmed()).collect();
    let points: Vec<[f64; 2]> = confirmed.iter().map(|&k| tracks[k].estimate.position()).collect();
    let mut grid = Grid::default();
    let reach = |plot: usize| {
        let radar = &settings.radars[plots[plot].radar];
        let r = radar.noise_at(plots[plot].position, f64::NAN);
        (FARTHEST * r.xx.max(r.yy)).sqrt() + settings.max_speed * radar.scan_period
    };
    let free = |i: &usize| often[plots[*i].radar] && !taken[*i] && !deferred[*i];
    let cell = (0..plots.len()).filter(free).map(reach).fold(0.0, f64::max);
    if cell == 0.0 || grid.fill(&points, 2.0 * cell).is_err() {
        return;
    }
    for i in (0..plots.len()).filter(free) {
        let (plot, half) = (&plots[i], reach(i));
        let radar = &settings.radars[plot.radar];
        let known = noise[plot.radar].outliers;
        let [x, y] = plot.position;
        let (mut sum, mut nearest) = (0.0, (f64::INFINITY, 0));
        grid.between([x - half, y - half], [x + half, y + half], &mut |k| {
            let track = &tracks[confirmed[k]];
            // one that is not seen any more has flown elsewhere
            let is_missed =
                track.is_due(plot, radar) && plot.time - track.seen < LATELY * track.period;
            if is_missed && radar.covers(track.estimate.position()) {
                let (place, p) = track.position_at(plot.time);
                let s = p.plus(radar.noise_at(place, f64::NAN));
                let d = s.inverse().form([x - place[0], y - place[1]]);
                if d < FARTHEST {
                    nearest = if d < nearest.0 { (d, confirmed[k]) } else { nearest };
                    sum += known.spread(d, s.determinant()) / TAU;
                }
            }
        });
        found[i] += known.share() * sum;
        if nearest.0 < FARTHEST {
            let odds = known.share().max(NOT_RARE) * sum / clutter[plot.radar].density(radar);
            let weight = odds / (1.0 + odds);
            tracks[nearest.1].stray = Some(Stray { radar: plot.radar, square: nearest.0, weight });
        }
    }
}
