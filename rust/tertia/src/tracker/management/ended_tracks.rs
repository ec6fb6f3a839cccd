//! Remembers tracks that have ended and that new tracks may continue.

use crate::sensors::Identities;
use crate::tracker::plot::Source;
use crate::tracker::settings::Settings;
use crate::tracker::track::Track;
use serde::{Deserialize, Serialize};

/// Scans for which confirmed tracks without identity are remembered, and the plots of tracks that were never
/// confirmed.
const SCANS: f64 = 15.0;
const SCANS_OF_PLOTS: f64 = 8.0;
/// Time for which tracks with an identity are remembered, s.
pub(in crate::tracker) const REMEMBERED: f64 = 600.0;

/// Position of a plot or of the last estimate of a track.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Spot {
    pub time: f64,
    pub position: [f64; 2],
    /// Sum of the variances, m².
    pub variance: f64,
}

impl Spot {
    /// The first plot of a track.
    pub fn first(track: &Track, settings: &Settings) -> Self {
        let plot = &track.first;
        let r = match plot.source {
            Source::Placed(noise) | Source::Moving(noise, _)
                if settings.geometry(plot.radar).is_position() =>
            {
                noise
            }
            _ => {
                let radar = settings.radars[plot.radar].detecting(plot.detection);
                radar.noise_at(plot.position, f64::NAN)
            }
        };
        Self { time: plot.time, position: plot.position, variance: r.xx + r.yy }
    }

    /// The estimate of a track at the time of its last plot.
    pub fn last(track: &Track) -> Self {
        let (position, p) = track.position_at(track.seen);
        Self { time: track.seen, position, variance: p.xx + p.yy }
    }
}

/// Beginning and end of a sequence of a few plots that were not recognised as a target.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Stretch {
    pub first: Spot,
    pub last: Spot,
    pub identities: Identities,
    period: f64,
}

impl Stretch {
    pub fn of(track: &Track, settings: &Settings) -> Self {
        let (first, last) = (Spot::first(track, settings), Spot::last(track));
        // a single plot has no velocity
        let last = if last.time > first.time { last } else { first };
        Self { first, last, identities: track.identities(), period: track.period() }
    }
}

/// Tracks that have ended.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Ended {
    /// Confirmed tracks.
    pub tracks: Vec<Track>,
    /// Tracks that were never confirmed.
    pub stretches: Vec<Stretch>,
}

impl Ended {
    /// Remembers a track, unless another track has continued it.
    pub fn remember(&mut self, track: &Track, settings: &Settings) {
        if track.number == 0 {
            return;
        }
        if track.is_confirmed() {
            self.tracks.push(track.clone());
        } else {
            self.stretches.push(Stretch::of(track, settings));
        }
    }

    /// Whether the track of this number may still be resumed.
    pub fn may_resume(&self, number: u64, time: f64) -> bool {
        self.tracks.iter().any(|track| track.number == number && is_remembered(track, time))
    }

    /// Forgets tracks that ended too long before `time`.
    pub fn forget(&mut self, time: f64) {
        self.tracks.retain(|track| is_remembered(track, time));
        self.stretches.retain(|one| time - one.last.time <= SCANS_OF_PLOTS * one.period);
    }
}

/// Whether a track did not end too long before `time` to be resumed.
fn is_remembered(track: &Track, time: f64) -> bool {
    let scans = SCANS * track.period();
    time - track.seen <= if track.identities().is_some() { REMEMBERED } else { scans }
}
