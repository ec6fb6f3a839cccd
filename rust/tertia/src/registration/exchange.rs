//! Data that a tracker and a registrar exchange.

use super::recording::TargetPlot;
use crate::association::gate::{self, GUARD};
use crate::base::plane::Plane;
use std::sync::LazyLock;

/// Square of the distance beyond which a tracker has not used a velocity.
static FARTHEST: LazyLock<f64> =
    LazyLock::new(|| gate::threshold(GUARD, 2).expect("a probability"));

/// A row of a track.
#[derive(Clone, Debug)]
pub struct Update {
    /// The plot as the radar reports it; its range is nan for a missed detection.
    pub plot: TargetPlot,
    /// Whether the track is confirmed.
    pub confirmed: bool,
    /// Position and velocity of the track.
    pub position: [f64; 2],
    /// Metres per second.
    pub velocity: [f64; 2],
    /// Covariance of position and velocity, row by row.
    pub covariance: [f64; 16],
    /// Plot less prediction, and its covariance, row by row; nan if unknown.
    pub innovation: [f64; 2],
    /// Row by row.
    pub innovation_covariance: [f64; 4],
    /// What else the track has seen, of which errors of radars are no part.
    pub other: Option<Other>,
}

/// A measurement on which the errors of radars have no influence.
#[derive(Clone, Copy, Debug)]
pub enum Other {
    /// Velocity that came with the plot, and its covariance.
    Velocity([f64; 2], Plane),
    /// Azimuth, instead of a plot, from this place, and its standard deviation.
    Azimuth([f64; 2], f64),
}

impl Update {
    /// Squared innovation over its covariance.
    pub(super) fn distance(&self) -> f64 {
        let ([a, b], [xx, xy, _, yy]) = (self.innovation, self.innovation_covariance);
        (a * a * yy - 2.0 * a * b * xy + b * b * xx) / (xx * yy - xy * xy)
    }

    /// Noise of the velocity that came with the plot, if the track has used it: it is then as near as that
    /// to the track.
    #[inline(always)]
    pub(super) fn used_velocity(&self) -> Option<Plane> {
        let Some(Other::Velocity(reported, noise)) = self.other else { return None };
        let off = [0, 1].map(|i| reported[i] - self.velocity[i]);
        (noise.inverse().form(off) <= *FARTHEST).then_some(noise)
    }

    /// The derivatives of an azimuth, in sigmas, by position and velocity.
    pub(super) fn used_azimuth(&self) -> Option<[f64; 4]> {
        let Some(Other::Azimuth(place, sigma)) = self.other else { return None };
        let [x, y] = [0, 1].map(|i| self.position[i] - place[i]);
        let scale = sigma * (x * x + y * y);
        (scale > 0.0).then(|| [y / scale, -x / scale, 0.0, 0.0])
    }

    /// Innovation along a direction, and its variance.
    pub(super) fn along(&self, [east, north]: [f64; 2]) -> (f64, f64) {
        let ([a, b], [xx, xy, _, yy]) = (self.innovation, self.innovation_covariance);
        let variance = east * (east * xx + 2.0 * north * xy) + north * north * yy;
        (east * a + north * b, variance)
    }
}

/// Rows of tracks, however they are stored.
pub trait Updates {
    /// Number of rows.
    fn count(&self) -> usize;
    /// Number of the track of a row.
    fn target(&self, row: usize) -> i64;
    /// Returns a row.
    fn get(&self, row: usize) -> Update;
}

/// Rows of tracks that can be changed in place.
pub trait Changed: Updates {
    /// Shifts the position and velocity of a row, and adds to its covariance, row by row.
    fn change(&mut self, row: usize, moved: &[f64; 4], added: &[f64; 16]);
}

impl Updates for [Update] {
    fn count(&self) -> usize {
        self.len()
    }

    fn target(&self, row: usize) -> i64 {
        self[row].plot.target
    }

    fn get(&self, row: usize) -> Update {
        self[row].clone()
    }
}

/// Rows, and their changes in the same order.
pub(super) struct Given<'a> {
    updates: &'a [Update],
    pub changes: Vec<([f64; 4], [f64; 16])>,
}

impl<'a> Given<'a> {
    pub fn new(updates: &'a [Update]) -> Self {
        Self { updates, changes: Vec::with_capacity(updates.len()) }
    }
}

impl Updates for Given<'_> {
    fn count(&self) -> usize {
        self.updates.count()
    }

    fn target(&self, row: usize) -> i64 {
        self.updates.target(row)
    }

    fn get(&self, row: usize) -> Update {
        self.updates[row].clone()
    }
}

impl Changed for Given<'_> {
    fn change(&mut self, _: usize, moved: &[f64; 4], added: &[f64; 16]) {
        self.changes.push((*moved, *added));
    }
}

/// Changes of tracks after a scan.
#[derive(Clone, Debug)]
pub struct Learnt {
    /// Changes of position and velocity of each row, and of its covariance, row by row.
    pub rows: Vec<([f64; 4], [f64; 16])>,
    /// Number of each track, time of its last row, and change of position and velocity at this time.
    pub tracks: Vec<(i64, f64, [f64; 4])>,
}
