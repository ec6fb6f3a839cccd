//! Plots far from targets that a radar has missed: if a radar makes many of them, a few in
//! succession look like another target.

use crate::association::Grid;
use crate::sensors::Radar;
use crate::tracker::clutter::Clutter;
use crate::tracker::noise::Noise;
use crate::tracker::noise::duplicates::Near;
use crate::tracker::noise::outliers::{FARTHEST, Stray};
use crate::tracker::plot::Measured;
use crate::tracker::settings::Settings;
use crate::tracker::track::{SOONEST, Track};
use std::f64::consts::TAU;

/// Largest number of scans for which a target may have been missed.
const LATELY: f64 = 2.5;
/// Least share of outliers that is assumed when a plot is judged to be one.
const NOT_RARE: f64 = 0.02;
/// Side of a cell relative to the largest distance of the search for tracks.
const CELL: f64 = 0.5;

/// Adds, at each plot, the density of outliers of missed targets to the density of plots that are
/// not false. Cost O(tracks + plots); none for radars without outliers.
pub(in crate::tracker) fn find(
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
    let missed = Missed::by_each(&often, plots, (&*tracks, settings), CELL * farthest);
    for i in (0..plots.len()).filter(free) {
        let (plot, half) = (&plots[i], reach(i));
        let (radar, Some(missed)) = (&settings.radars[plot.radar], &missed[plot.radar]) else {
            continue;
        };
        let known = noise[plot.radar].outliers;
        let [x, y] = plot.position;
        let (mut sum, mut nearest) = (0.0, (f64::INFINITY, 0));
        let mut look = |(k, seen): (usize, f64)| {
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
        };
        // most tracks near the plot are among those that the radar has just seen
        for missed in missed.iter().filter(|missed| is_due(plot.time, missed.earliest, radar)) {
            let (low, high) = ([x - half, y - half], [x + half, y + half]);
            missed.grid.between(low, high, &mut |at| look(missed.tracks[at]));
        }
        found[i] += known.share() * sum;
        if nearest.0 < FARTHEST {
            let density = plot.rivals(clutter[plot.radar].density(radar));
            let odds = known.share().max(NOT_RARE) * sum / density;
            let weight = odds / (1.0 + odds);
            tracks[nearest.1].stray = Some(Stray { radar: plot.radar, square: nearest.0, weight });
        }
    }
}

/// Confirmed tracks that a radar may have missed in a scan.
struct Missed {
    grid: Grid,
    /// Their indices among all tracks, and the time at which the radar last saw each.
    tracks: Vec<(usize, f64)>,
    /// The earliest of these times.
    earliest: f64,
}

impl Missed {
    /// Such tracks of each radar for whose outliers it is worth looking.
    fn by_each(
        often: &[bool],
        plots: &[Measured],
        known: (&[Track], &Settings),
        cell: f64,
    ) -> Vec<Option<[Self; 2]>> {
        let times = || plots.iter().map(|plot| plot.time);
        let begin = times().fold(f64::INFINITY, f64::min);
        let end = times().fold(f64::NEG_INFINITY, f64::max);
        let by = |radar: usize| Self::by(radar, [begin, end], known, cell);
        often.iter().enumerate().map(|(radar, often)| often.then(|| by(radar))).collect()
    }

    /// Tracks that the radar last saw before its plots from `begin` to `end`, and those that it saw
    /// with one of these plots.
    fn by(
        radar: usize,
        [begin, end]: [f64; 2],
        (tracks, settings): (&[Track], &Settings),
        cell: f64,
    ) -> [Self; 2] {
        let station = &settings.radars[radar];
        let (mut found, mut points) = (<[Vec<_>; 2]>::default(), <[Vec<_>; 2]>::default());
        for (k, track) in tracks.iter().enumerate().filter(|(_, track)| track.is_confirmed()) {
            let seen = track.expected_by(radar).map_or(f64::NEG_INFINITY, |own| own.seen);
            let place = track.estimate.position();
            if is_due(end, seen, station) && is_lately(track, begin) && station.covers(place) {
                let now = usize::from(seen >= begin);
                found[now].push((k, seen));
                points[now].push(place);
            }
        }
        [0, 1].map(|now| {
            let tracks = std::mem::take(&mut found[now]);
            let earliest = tracks.iter().map(|(_, seen)| *seen).fold(f64::INFINITY, f64::min);
            let grid = Grid::new(&points[now], cell).unwrap_or_default();
            Self { grid, tracks, earliest }
        })
    }
}

/// Whether a radar that saw a target at the time `seen` may see it again at this time.
fn is_due(time: f64, seen: f64, radar: &Radar) -> bool {
    time - seen > SOONEST * radar.scan_period
}

/// Whether a target was seen recently; otherwise it may have flown elsewhere.
fn is_lately(track: &Track, time: f64) -> bool {
    time - track.seen < LATELY * track.period
}
