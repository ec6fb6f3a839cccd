//! Plots far from targets that radars have missed: where a radar makes many, a few of them in a row look like
//! another target.

use super::clutter::Clutter;
use super::doubles::Near;
use super::noise::Noise;
use super::outliers::{FARTHEST, Stray};
use super::settings::Settings;
use super::track::Track;
use crate::association::Grid;
use std::f64::consts::TAU;

/// Scans for which a target may be missed.
const LATELY: f64 = 2.5;
/// Share of them with which plots are looked at that may be outliers.
const NOT_RARE: f64 = 0.02;

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
        let radar = settings.radars[plots[plot].radar].at_worst();
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
                let s = p.plus(radar.detecting(plot.detection).noise_at(place, f64::NAN));
                let d = s.inverse().form([x - place[0], y - place[1]]);
                if d < FARTHEST {
                    nearest = if d < nearest.0 { (d, confirmed[k]) } else { nearest };
                    let likeness = track.named(plot, settings);
                    sum += likeness * known.spread(d, s.determinant()) / TAU;
                }
            }
        });
        found[i] += known.share() * sum;
        if nearest.0 < FARTHEST {
            let density = plot.rivals(clutter[plot.radar].density(radar));
            let odds = known.share().max(NOT_RARE) * sum / density;
            let weight = odds / (1.0 + odds);
            tracks[nearest.1].stray = Some(Stray { radar: plot.radar, square: nearest.0, weight });
        }
    }
}
