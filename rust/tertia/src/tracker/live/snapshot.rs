//! Copies of the state of a tracker, as far as plots change it.

use super::Tracker;
use super::extended_targets::Shapes;
use crate::tracker::assignment::cluster::Clusters;
use crate::tracker::clutter::Clutter;
use crate::tracker::management::azimuths::Azimuths;
use crate::tracker::management::ended_tracks::Ended;
use crate::tracker::noise::Noise;
use crate::tracker::noise::duplicates::Doubles;
use crate::tracker::noise::repeats::Repeats;
use crate::tracker::plot::Measured;
use crate::tracker::plot::level::Level;
use crate::tracker::settings::plans::Plans;
use crate::tracker::track::Track;
use serde::{Deserialize, Serialize};

/// The state of a tracker, as far as plots change it.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(in crate::tracker) struct Kept {
    tracks: Vec<Track>,
    clusters: Clusters,
    ended: Ended,
    plans: Plans,
    clutter: Vec<Clutter>,
    level: Level,
    doubles: Vec<Doubles>,
    noise: Vec<Noise>,
    time: f64,
    next_number: u64,
    stray: f64,
    waiting: Vec<Measured>,
    azimuths: Azimuths,
    repeats: Repeats,
    shapes: Shapes,
}

impl Tracker {
    /// Returns a copy of the state.
    pub(in crate::tracker) fn keep(&self) -> Kept {
        Kept {
            tracks: self.tracks.clone(),
            clusters: self.clusters.clone(),
            ended: self.ended.clone(),
            plans: self.settings.plans.clone(),
            clutter: self.clutter.clone(),
            level: self.level,
            doubles: self.doubles.clone(),
            noise: self.noise.clone(),
            time: self.time,
            next_number: self.next_number,
            stray: self.stray,
            waiting: self.waiting.clone(),
            azimuths: self.azimuths.clone(),
            repeats: self.repeats.clone(),
            shapes: self.shapes.clone(),
        }
    }

    /// Restores the state from a copy.
    pub(in crate::tracker) fn restore(&mut self, kept: Kept) {
        let Kept { tracks, clusters, ended, plans, clutter, level, doubles, waiting, .. } = kept;
        let Kept { time, next_number, stray, noise, azimuths, repeats, shapes, .. } = kept;
        (self.tracks, self.ended, self.waiting) = (tracks, ended, waiting);
        (self.clutter, self.level, self.doubles) = (clutter, level, doubles);
        self.noise = noise;
        (self.clusters, self.settings.plans) = (clusters, plans);
        (self.time, self.next_number, self.stray) = (time, next_number, stray);
        (self.azimuths, self.repeats, self.shapes) = (azimuths, repeats, shapes);
    }
}
