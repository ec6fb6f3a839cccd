//! Assigns azimuths without ranges to tracks.
//!
//! The azimuths of one sensor at one time are a frame, in which each track has one azimuth at most. Azimuths
//! correct confirmed tracks after the plots of the same time, and start no tracks. Tracks that a sensor
//! cannot tell apart take none of its azimuths: any assignment would be a guess, frame after frame.

use crate::association::{Assigner, Pair};
use crate::tracker::filter::azimuth::Sight;
use crate::tracker::plot::{PlotStatus, Plots};
use crate::tracker::rows::row::{Row, Rows};
use crate::tracker::settings::Settings;
use crate::tracker::track::Track;
use serde::{Deserialize, Serialize};
use std::f64::consts::{PI, TAU};

/// Smallest difference between the azimuths of two tracks, in sigmas of a residual, at which their assignment
/// is certain: one in 160 residuals exceeds half of it in the direction of the other track.
const APART: f64 = 5.0;
/// Forgetting factor per frame of the mean number of azimuths that belong to no track, and the smallest mean
/// number.
const FADING: f64 = 0.9;
const FEWEST: f64 = 1.0;

/// Azimuths that wait for the plots of their time, and how many azimuths belonged to no track.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Azimuths {
    waiting: Vec<Sight>,
    /// One entry for each sensor; empty if no sensor measures azimuths alone.
    unused: Vec<Unused>,
}

/// Number of azimuths that belonged to no track, and of frames, with fading weights.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Unused {
    count: f64,
    frames: f64,
}

impl Unused {
    fn add(&mut self, count: usize) {
        self.count = FADING * self.count + count as f64;
        self.frames = FADING * self.frames + 1.0;
    }

    /// Density of such azimuths in a frame, 1/rad.
    fn density(&self) -> f64 {
        (self.count / self.frames.max(1.0)).max(FEWEST) / TAU
    }
}

/// A track as a sensor should see it.
struct Expected {
    track: usize,
    azimuth: f64,
    /// Variance of the measured azimuth minus the expected one.
    variance: f64,
    /// Largest difference between the measured azimuth and the expected one.
    reach: f64,
    /// Whether the azimuth of no other track is near.
    alone: bool,
}

impl Azimuths {
    pub fn new(settings: &Settings) -> Self {
        let sensors = 0..settings.radars.len();
        let any = sensors.clone().any(|sensor| settings.geometry(sensor).is_azimuth());
        let unused = if any { sensors.map(|_| Unused::default()).collect() } else { Vec::new() };
        Self { waiting: Vec::new(), unused }
    }

    /// Whether a sensor measures azimuths alone.
    pub fn any(&self) -> bool {
        !self.unused.is_empty()
    }

    /// Time of the first waiting azimuth.
    pub fn waits(&self) -> Option<f64> {
        self.waiting.iter().map(|sight| sight.time).min_by(f64::total_cmp)
    }

    /// Forgets all azimuths so far.
    pub fn clear(&mut self) {
        self.waiting.clear();
        self.unused.fill(Unused::default());
    }

    /// Takes the azimuths out of the plots, and returns all other plots.
    pub fn take<P: Plots + ?Sized>(
        &mut self,
        plots: &P,
        now: &[(f64, usize)],
        index: impl Fn(usize) -> usize,
        settings: &Settings,
    ) -> Vec<(f64, usize)> {
        let mut others = now.to_vec();
        others.retain(|&(time, i)| {
            let plot = plots.get(i);
            let sigma = settings.geometry(plot.radar).azimuth_sigma();
            let Some((sigma, report)) = sigma.zip(plot.report) else { return true };
            let (place, azimuth) = (report.position, plot.azimuth);
            let sight = Sight { index: index(i), time, sensor: plot.radar, place, azimuth, sigma };
            self.waiting.push(sight);
            false
        });
        others
    }

    /// Corrects tracks by the azimuths before `hold`.
    pub fn process<R: Rows>(
        &mut self,
        hold: f64,
        (tracks, settings): (&mut [Track], &Settings),
        rows: &mut R,
        mut report: impl FnMut(usize, PlotStatus),
    ) {
        self.waiting.sort_by(|a, b| a.time.total_cmp(&b.time).then(a.sensor.cmp(&b.sensor)));
        let count = self.waiting.partition_point(|sight| sight.time < hold);
        let now: Vec<Sight> = self.waiting.drain(..count).collect();
        let source = |sight: &Sight| (sight.time, sight.sensor, sight.place);
        for frame in now.chunk_by(|a, b| source(a) == source(b)) {
            let unused = &mut self.unused[frame[0].sensor];
            for (sight, track) in assigned(frame, tracks, settings, unused) {
                let track = &mut tracks[track];
                for leaf in track.alternatives_mut() {
                    leaf.track.predict_between(sight.time, settings);
                    if leaf.track.sighted(sight).0 <= settings.guard {
                        leaf.track.see(sight, settings);
                    }
                }
                track.see(sight, settings);
                report(sight.index, PlotStatus::Track(track.number));
                if rows.wants(true) {
                    rows.push(&Row::of(track, sight.sensor, Some(sight.index)));
                }
            }
        }
    }
}

/// Returns the azimuths of a frame that belong to tracks, with the indices of these tracks. Cost
/// O(T log T + B log B) for T tracks and B azimuths.
fn assigned<'a>(
    frame: &'a [Sight],
    tracks: &mut [Track],
    settings: &Settings,
    unused: &mut Unused,
) -> Vec<(&'a Sight, usize)> {
    let expected = expected(&frame[0], tracks, settings);
    let mut order: Vec<u32> = (0..frame.len() as u32).collect();
    let azimuth = |i: u32| wrapped(frame[i as usize].azimuth);
    order.sort_by(|&a, &b| azimuth(a).total_cmp(&azimuth(b)));
    let radar = &settings.radars[frame[0].sensor];
    let p = radar.detection_probability;
    let odds = (p / ((1.0 - p) * unused.density() * frame[0].sigma)).ln();
    let (mut pairs, mut near) = (Vec::new(), vec![false; frame.len()]);
    for (row, one) in expected.iter().enumerate() {
        // also beyond the cut at ±π
        for middle in [one.azimuth - TAU, one.azimuth, one.azimuth + TAU] {
            let first = order.partition_point(|&i| azimuth(i) < middle - one.reach);
            for &column in order[first..].iter().take_while(|i| azimuth(**i) <= middle + one.reach)
            {
                near[column as usize] = true;
                if !one.alone {
                    continue;
                }
                let track = &mut tracks[one.track];
                track.predict_between(frame[0].time, settings);
                let (distance, s) = track.sighted(&frame[column as usize]);
                if distance <= settings.guard {
                    let gain = odds - 0.5 * (distance + (TAU * s).ln());
                    pairs.push(Pair { row: row as u32, column, gain });
                }
            }
        }
    }
    unused.add(near.iter().filter(|near| !**near).count());
    let mut assigner = Assigner::default();
    let found = assigner.assign(&pairs, expected.len(), frame.len());
    let each = expected.iter().zip(found);
    each.filter_map(|(one, column)| Some((&frame[(*column)? as usize], one.track))).collect()
}

/// Returns the confirmed tracks in the order of their expected azimuths.
fn expected(sight: &Sight, tracks: &[Track], settings: &Settings) -> Vec<Expected> {
    let noise = sight.sigma * sight.sigma;
    let confirmed = tracks.iter().enumerate().filter(|(_, track)| track.is_confirmed());
    let alive = confirmed.filter(|(_, track)| track.is_alive(settings));
    let seen = alive.filter_map(|(index, track)| {
        let direction = track.direction(sight.place, sight.time)?;
        let variance = direction.variance + noise;
        let reach = ((settings.guard * variance).sqrt() + direction.margin).min(PI);
        Some(Expected { track: index, azimuth: direction.azimuth, variance, reach, alone: true })
    });
    let mut expected: Vec<Expected> = seen.collect();
    expected.sort_by(|a, b| a.azimuth.total_cmp(&b.azimuth));
    let count = expected.len();
    for i in 0..count {
        let width = (APART * expected[i].variance.sqrt()).min(PI);
        for step in 1..count {
            let next = (i + step) % count;
            if (expected[next].azimuth - expected[i].azimuth).rem_euclid(TAU) > width {
                break;
            }
            (expected[i].alone, expected[next].alone) = (false, false);
        }
        for step in 1..count {
            let before = (i + count - step) % count;
            if (expected[i].azimuth - expected[before].azimuth).rem_euclid(TAU) > width {
                break;
            }
            (expected[i].alone, expected[before].alone) = (false, false);
        }
    }
    expected
}

/// The azimuth between −π and π.
fn wrapped(azimuth: f64) -> f64 {
    (azimuth + PI).rem_euclid(TAU) - PI
}
