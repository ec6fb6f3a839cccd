//! Messages about the tracks of a sensor, and the extrapolation of a track to another time.

use crate::sensors::{Identities, Radar};
use crate::tracker::{Estimate, ImmModel};
use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};

/// Acceleration of a target between two messages in straight flight and in a turn, m/s².
const STRAIGHT: f64 = 0.1;
const TURNING: f64 = 3.0;

/// A message about a track of a sensor.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// Index of the sensor.
    pub sensor: usize,
    /// Number of the track; the sensor may use it again.
    pub track: i64,
    /// Time of the message, s.
    pub time: f64,
    /// East and north, and their rates, m and m/s.
    pub state: [f64; 4],
    /// Covariance of the state, row by row; nan if the sensor does not report it.
    pub covariance: [f64; 16],
    /// Height, m; nan if it is not known.
    pub height: f64,
    /// Identities from the replies of the transponder.
    pub identities: Identities,
    /// Probability that the target turns; nan if it is not known.
    pub turn_probability: f64,
}

impl Row {
    /// Position and velocity with their covariance. If the sensor reports none, the covariance of the
    /// position is that of a plot, and that of the velocity comes from a line through three plots.
    pub fn estimate(&self, radar: &Radar) -> Estimate<4> {
        let mean = SVector::from(self.state);
        if self.covariance.iter().all(|value| value.is_finite()) {
            return Estimate { mean, covariance: SMatrix::from_row_slice(&self.covariance) };
        }
        let noise = radar.noise_at([mean[0], mean[1]], self.height - radar.position[2]);
        let share = 2.0 / (3.0 * radar.scan_period.powi(2));
        let mut covariance = SMatrix::zeros();
        for (at, scale) in [(0, 1.0), (2, share)] {
            covariance[(at, at)] = scale * noise.xx;
            covariance[(at, at + 1)] = scale * noise.xy;
            covariance[(at + 1, at)] = scale * noise.xy;
            covariance[(at + 1, at + 1)] = scale * noise.yy;
        }
        Estimate { mean, covariance }
    }

    /// Height above the sensor; 0 if the height is not known.
    pub fn above(&self, radar: &Radar) -> f64 {
        if self.height.is_finite() { self.height - radar.position[2] } else { 0.0 }
    }

    /// Probability of a turn; the mean of all traffic if it is not known.
    pub fn turning(&self) -> f64 {
        if self.turn_probability.is_finite() {
            return self.turn_probability.clamp(0.0, 1.0);
        }
        let model = ImmModel::default();
        model.turn_time / (model.turn_time + model.straight_time)
    }

    /// Extrapolates the track to another time with constant velocity.
    pub fn at(&self, time: f64, radar: &Radar) -> Estimate<4> {
        carried(self.estimate(radar), self.turning(), time - self.time)
    }
}

/// Extrapolates a state by t seconds with constant velocity, for a target that turns with this probability:
/// `F P F' + σ² Γ Γ'`, Γ = (t²/2, t), where σ is an acceleration that may begin at any time.
pub(super) fn carried(estimate: Estimate<4>, turning: f64, t: f64) -> Estimate<4> {
    let Estimate { mut mean, mut covariance } = estimate;
    let square = (1.0 - turning) * STRAIGHT * STRAIGHT + turning * TURNING * TURNING;
    for i in 0..2 {
        mean[i] += t * mean[i + 2];
    }
    // F P, then F P F'
    for j in 0..4 {
        for i in 0..2 {
            covariance[(i, j)] += t * covariance[(i + 2, j)];
        }
    }
    for i in 0..2 {
        for j in 0..4 {
            covariance[(j, i)] += t * covariance[(j, i + 2)];
        }
    }
    for i in 0..2 {
        covariance[(i, i)] += 0.25 * square * t.powi(4);
        covariance[(i, i + 2)] += 0.5 * square * t.powi(3);
        covariance[(i + 2, i)] += 0.5 * square * t.powi(3);
        covariance[(i + 2, i + 2)] += square * t * t;
    }
    Estimate { mean, covariance }
}
