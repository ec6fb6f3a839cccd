//! What a tracker tells a registrar of its tracks, and what it is told.

use super::recording::TargetPlot;

/// A row of a track.
#[derive(Clone, Debug)]
pub struct Update {
    /// The plot, as the radar reports it; its range is nan where there was none.
    pub plot: TargetPlot,
    /// Whether the track is confirmed.
    pub confirmed: bool,
    /// Position and velocity of the track.
    pub position: [f64; 2],
    /// Metres per second.
    pub velocity: [f64; 2],
    /// Their covariance, row by row.
    pub covariance: [f64; 16],
    /// Plot less prediction, and its covariance, row by row; nan where it is not known.
    pub innovation: [f64; 2],
    /// Row by row.
    pub innovation_covariance: [f64; 4],
}

impl Update {
    /// The square of the innovation over its covariance.
    pub(super) fn distance(&self) -> f64 {
        let ([a, b], [xx, xy, _, yy]) = (self.innovation, self.innovation_covariance);
        (a * a * yy - 2.0 * a * b * xy + b * b * xx) / (xx * yy - xy * xy)
    }

    /// The innovation along a direction, and its variance.
    pub(super) fn along(&self, [east, north]: [f64; 2]) -> (f64, f64) {
        let ([a, b], [xx, xy, _, yy]) = (self.innovation, self.innovation_covariance);
        let variance = east * (east * xx + 2.0 * north * xy) + north * north * yy;
        (east * a + north * b, variance)
    }
}

/// What tracks are to be changed by after a scan.
#[derive(Clone, Debug)]
pub struct Learnt {
    /// Position and velocity of each row by so much, and its covariance, row by row.
    pub rows: Vec<([f64; 4], [f64; 16])>,
    /// The same of each track, at the time of its last row.
    pub tracks: Vec<(i64, f64, [f64; 4])>,
}
