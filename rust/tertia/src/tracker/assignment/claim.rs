//! Finds the plots that a track may claim: those near its predicted position at the time when a radar's beam
//! passes.

use crate::association::Grid;
use crate::base::plane::Plane;
use crate::tracker::plot::{Measured, Source};
use crate::tracker::settings::{MAX_DELAY, Settings};
use crate::tracker::track::Track;
use std::f64::consts::PI;

/// Time by which a plot may come earlier or later than the beam is expected, as a share of a scan.
const BEAM: f64 = 0.1;
/// Number of sigmas of the error of a time within which reports are searched for.
const CLOCKS: f64 = 4.5;

/// A track that a radar may have seen, and the plots of this radar that may belong to it.
#[derive(Clone, Copy, Debug)]
pub(in crate::tracker) struct Claim {
    /// Index of the track: at first among all tracks, then among those of its share.
    pub track: u32,
    /// Place of the claim in the order of groups.
    pub rank: u32,
    /// Lowest plot of its group.
    pub root: u32,
    /// Number of the component of competing tracks and plots of all radars.
    pub component: u32,
    pub start: u32,
    pub end: u32,
}

/// The plots of a scan, among which tracks look for their own.
#[derive(Clone, Copy)]
pub(in crate::tracker) struct Around<'a> {
    pub grid: &'a Grid,
    pub plots: &'a [Measured],
    /// Times of the plots: a separate copy, because they are read more often than the other data.
    pub times: &'a [f64],
}

/// How far the plots of a scan may be from their expected positions, for reasons other than the noise of
/// radars.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::tracker) struct Spread {
    /// Lowest and highest height that is assumed for plots without a height.
    placed: Option<[f64; 2]>,
    /// Largest variance of a reported position along an axis, m².
    pub variance: f64,
}

impl Spread {
    pub fn of(plots: &[Measured]) -> Self {
        let mut spread = Self::default();
        for plot in plots {
            match plot.source {
                Source::Polar => {}
                Source::Placed(Plane { xx, yy, .. }) | Source::Moving(Plane { xx, yy, .. }, _) => {
                    spread.variance = spread.variance.max(xx).max(yy);
                }
                Source::Slant { prior: [height, _], .. } => {
                    let [low, high] = spread.placed.unwrap_or([height; 2]);
                    spread.placed = Some([low.min(height), high.max(height)]);
                }
            }
        }
        spread
    }
}

impl Claim {
    /// Creates a claim of the track with this index to the claimed plots from `start` to `end`.
    pub fn new(track: usize, start: usize, end: usize) -> Self {
        let [track, start, end] = [track, start, end].map(|i| i as u32);
        Self { track, rank: 0, root: 0, component: 0, start, end }
    }

    /// Returns the plots of this claim, given the plots of all claims.
    #[inline]
    pub fn plots<'a>(&self, claimed: &'a [u32]) -> std::slice::Iter<'a, u32> {
        claimed[self.start as usize..self.end as usize].iter()
    }
}

/// Returns the centre and the half widths of the box in which plots of a track by this radar may be between
/// `begin` and `end`; none if the radar does not see the track in that time. `height` and `unseen` are those of
/// the track, the same for all radars.
#[inline]
pub(in crate::tracker) fn reach(
    track: &Track,
    radar: usize,
    (begin, end): (f64, f64),
    (height, unseen): (f64, (f64, f64)),
    settings: &Settings,
    spread: &Spread,
) -> Option<([f64; 2], [f64; 2])> {
    let station = &settings.radars[radar];
    let geometry = settings.geometry(radar);
    if geometry.is_azimuth() {
        return None;
    }
    let (time, slack) = match track.expected_by(radar) {
        Some(expected) if !geometry.is_position() => {
            // near the radar the azimuth changes fast, so the beam comes much earlier or later
            let moved = settings.max_speed * (begin - expected.seen).max(station.scan_period);
            let swing = (moved / (PI * station.about(track.estimate.position()))).min(0.5);
            let late = (MAX_DELAY + swing) * station.scan_period;
            // the scan in which the beam passes between begin and end
            let behind = begin - late - expected.time;
            let mut time = expected.time;
            if behind > 0.0 {
                time += (behind / station.scan_period).ceil() * station.scan_period;
            }
            if time > end + late {
                return None;
            }
            (time.clamp(begin, end), (BEAM + swing) * station.scan_period)
        }
        _ => (0.5 * (begin + end), 0.5 * (end - begin)),
    };
    let (centre, covariance) = track.position_at(time);
    let noise = if geometry.is_position() {
        Plane { xx: spread.variance, xy: 0.0, yy: spread.variance }
    } else {
        station.at_worst().noise_at(centre, height - station.position[2])
    };
    let speed = track.estimate.mean[2].abs() + track.estimate.mean[3].abs();
    let (wide, margin) = track.reach(time, radar, unseen, settings);
    let distance = station.about(centre);
    let sway = track.sway((geometry.site(station), distance), time, spread.placed);
    let delayed = if settings.delays_differ() { track.delayed_by(radar, settings) } else { 0.0 };
    let sway = sway + delayed + CLOCKS * speed * settings.quality(radar).clock.sqrt();
    let more = margin + speed * slack + sway;
    // no target is farther away than it can have flown
    let scans = (time - track.seen).abs().max(station.scan_period);
    let flown = 2.0 * settings.max_speed * scans + sway;
    // a merged plot of two targets is between them
    let merged = station.resolution.map_or(0.0, |[range, azimuth]| range.max(azimuth * distance));
    let half = |variance: f64, noise: f64| {
        let most = flown + (settings.guard * noise).sqrt();
        ((settings.guard * (variance + noise + wide)).sqrt() + more).min(most)
            + merged
            + station.extent
    };
    let half = [half(covariance.xx, noise.xx), half(covariance.yy, noise.yy)];
    let nearest = distance - half[0] - half[1];
    (nearest <= station.max_range).then_some((centre, half))
}

/// Whether a plot may be of the same target as a plot that has just started a track (`begun`) and that comes
/// from another sensor or from the same position sensor.
pub(in crate::tracker) fn is_near(
    plot: &Measured,
    (grid, plots): (&Grid, &[Measured]),
    begun: impl Fn(usize) -> bool,
    spread: &Spread,
    settings: &Settings,
) -> bool {
    let is_position = |radar: usize| settings.geometry(radar).is_position();
    let repeats = is_position(plot.radar);
    if !repeats && settings.radars.len() == 1 {
        return false;
    }
    let noise = |plot: &Measured| {
        let radar = settings.radars[plot.radar].detecting(plot.detection);
        let r = radar.noise_at(plot.position, f64::NAN);
        let variance = if is_position(plot.radar) { spread.variance } else { r.xx.max(r.yy) };
        (settings.guard * variance).sqrt()
    };
    let longest = plots.last().map_or(0.0, |last| last.time - plots[0].time);
    let own = noise(plot);
    let half = settings.max_speed * longest + 2.0 * own;
    let [x, y] = plot.position;
    let mut near = false;
    grid.between([x - half, y - half], [x + half, y + half], &mut |i| {
        let other = &plots[i];
        if begun(i) && (repeats || other.radar != plot.radar) {
            let apart = f64::hypot(x - other.position[0], y - other.position[1]);
            let flown = settings.max_speed * (plot.time - other.time).abs();
            near |= apart <= flown + own + noise(other);
        }
    });
    near
}
