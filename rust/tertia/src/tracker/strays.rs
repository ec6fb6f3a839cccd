//! Plots far from targets that radars have missed: where a radar makes many, a few of them in a row look like
//! another target.

use super::clutter::Clutter;
use super::doubles::Near;
use super::noise::Noise;
use super::outliers::{FARTHEST, Stray};
use super::plot::Measured;
use super::settings::Settings;
use super::track::{SOONEST, Track};
use crate::association::Grid;
use crate::sensors::Radar;
use std::f64::consts::TAU;

/// Scans for which a target may be missed.
const LATELY: f64 = 2.5;
/// Share of them with which plots are looked at that may be outliers.
const NOT_RARE: f64 = 0.02;
/// Side of a cell over the farthest at which tracks are looked for: far plots are looked for farther.
const CELL: f64 = 0.5;

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
    let reach = |plot: usize| {
        let radar = settings.radars[plots[plot].radar].at_worst();
        let r = radar.noise_at(plots[plot].position, f64::NAN);
        (FARTHEST * r.xx.max(r.yy)).sqrt() + settings.max_speed * radar.scan_period
    };
    let free = |i: &usize| often[plots[*i].radar] && !taken[*i] && !deferred[*i];
    let farthest = (0..plots.len()).filter(free).map(reach).fold(0.0, f64::max);
    if farthest == 0.0 {
        return;
    }
    let missed = |(radar, often): (usize, &bool)| {
        often.then(|| Missed::by(radar, plots, (&*tracks, settings), CELL * farthest))
    };
    let missed: Vec<_> = often.iter().enumerate().map(missed).collect();
    for i in (0..plots.len()).filter(free) {
        let (plot, half) = (&plots[i], reach(i));
        let (radar, Some(missed)) = (&settings.radars[plot.radar], &missed[plot.radar]) else {
            continue;
        };
        let known = noise[plot.radar].outliers;
        let [x, y] = plot.position;
        let (mut sum, mut nearest) = (0.0, (f64::INFINITY, 0));
        missed.grid.between([x - half, y - half], [x + half, y + half], &mut |at| {
            let (k, seen) = missed.tracks[at];
            // most have had a plot
            if !is_due(plot.time, seen, radar) || !is_lately(&tracks[k], plot.time) {
                return;
            }
            let (place, p) = tracks[k].position_at(plot.time);
            let s = p.plus(radar.detecting(plot.detection).noise_at(place, f64::NAN));
            let d = s.inverse().form([x - place[0], y - place[1]]);
            if d < FARTHEST {
                nearest = if d < nearest.0 { (d, k) } else { nearest };
                let likeness = tracks[k].named(plot, settings);
                sum += likeness * known.spread(d, s.determinant()) / TAU;
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

/// The confirmed tracks that a radar may have missed in a scan.
struct Missed {
    grid: Grid,
    /// Their indices among all tracks, and when the radar has seen each last.
    tracks: Vec<(usize, f64)>,
}

impl Missed {
    fn by(
        radar: usize,
        plots: &[Measured],
        (tracks, settings): (&[Track], &Settings),
        cell: f64,
    ) -> Self {
        let station = &settings.radars[radar];
        let [begin, end] = [plots.first(), plots.last()].map(|p| p.map_or(0.0, |plot| plot.time));
        let (mut found, mut points) = (Vec::new(), Vec::new());
        for (k, track) in tracks.iter().enumerate().filter(|(_, track)| track.is_confirmed()) {
            let seen = track.expected_by(radar).map_or(f64::NEG_INFINITY, |own| own.seen);
            let place = track.estimate.position();
            if is_due(end, seen, station) && is_lately(track, begin) && station.covers(place) {
                found.push((k, seen));
                points.push(place);
            }
        }
        Self { grid: Grid::new(&points, cell).unwrap_or_default(), tracks: found }
    }
}

/// Whether a radar that has `seen` a target then may see it again at this time.
fn is_due(time: f64, seen: f64, radar: &Radar) -> bool {
    time - seen > SOONEST * radar.scan_period
}

/// Whether a target is still seen: one that is not has flown elsewhere.
fn is_lately(track: &Track, time: f64) -> bool {
    time - track.seen < LATELY * track.period
}
