//! Data that a tracker and a registrar exchange.

use super::targets::TargetPlot;
use crate::association::gate::{self, GUARD};
use crate::base::plane::Plane;
use std::sync::LazyLock;

/// Squared normalised difference between a reported velocity and that of the track, above which a tracker has
/// not used the reported one.
static FARTHEST: LazyLock<f64> =
    LazyLock::new(|| gate::threshold(GUARD, 2).expect("a probability"));

/// A row of a track.
#[derive(Clone, Debug)]
pub struct Update {
    /// The plot as the radar reports it; its range is nan for a missed detection.
    pub plot: TargetPlot,
    /// Whether the track is confirmed.
    pub confirmed: bool,
    /// Position of the track, m.
    pub position: [f64; 2],
    /// Velocity, m/s.
    pub velocity: [f64; 2],
    /// Covariance of position and velocity, row by row.
    pub covariance: [f64; 16],
    /// Plot minus prediction; nan if unknown.
    pub innovation: [f64; 2],
    /// Covariance of the innovation, row by row; nan if unknown.
    pub innovation_covariance: [f64; 4],
    /// Further measurement that has updated the track and that the errors of radars do not affect.
    pub other: Option<Other>,
}

/// A measurement that the errors of radars do not affect.
#[derive(Clone, Copy, Debug)]
pub enum Other {
    /// Velocity that came with the plot, and its covariance.
    Velocity([f64; 2], Plane),
    /// Azimuth without a range, in place of a plot: position of the sensor, and standard deviation.
    Azimuth([f64; 2], f64),
}

impl Update {
    /// Returns the normalised innovation squared.
    pub(super) fn distance(&self) -> f64 {
        let ([a, b], [xx, xy, _, yy]) = (self.innovation, self.innovation_covariance);
        (a * a * yy - 2.0 * a * b * xy + b * b * xx) / (xx * yy - xy * xy)
    }

    /// Returns the noise of the velocity that came with the plot, if the track has used this velocity. That
    /// is assumed if it differs little enough from the velocity of the track.
    #[inline(always)]
    pub(super) fn used_velocity(&self) -> Option<Plane> {
        let Some(Other::Velocity(reported, noise)) = self.other else { return None };
        let off = [0, 1].map(|i| reported[i] - self.velocity[i]);
        (noise.inverse().form(off) <= *FARTHEST).then_some(noise)
    }

    /// Returns the derivatives of an azimuth, in sigmas, with respect to position and velocity; none if the
    /// row has no azimuth.
    pub(super) fn used_azimuth(&self) -> Option<[f64; 4]> {
        let Some(Other::Azimuth(place, sigma)) = self.other else { return None };
        let [x, y] = [0, 1].map(|i| self.position[i] - place[i]);
        let scale = sigma * (x * x + y * y);
        (scale > 0.0).then(|| [y / scale, -x / scale, 0.0, 0.0])
    }

    /// Returns the innovation along a direction, and its variance.
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
