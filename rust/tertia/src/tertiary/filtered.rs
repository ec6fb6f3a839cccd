//! A filter of Tertia's tracker, applied to the plots behind a track that another filter made.

use super::lasting::Scatter;
use super::row::{Row, carried};
use crate::base::plane::Plane;
use crate::sensors::Radar;
use crate::tracker::{Estimate, Follower, ImmModel};
use serde::{Deserialize, Serialize};

/// Weight of the newest plot in the running mean of innovations, and the largest value that is used of one.
const MEMORY: f64 = 0.3;
const SURPRISE: f64 = 20.0;

/// A filter with models of straight flight, turns and changes of speed, applied along a track. The state of a
/// filter without models of turns lags in turns, by more than its covariance states. Compared with tracks of
/// other sensors, it would seem to belong to another target.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Filtered {
    follower: Follower,
    /// Running mean of the normalised innovation squared, relative to its expected value.
    surprise: f64,
    scatter: Scatter,
    /// Covariance of the last position.
    noise: Plane,
}

impl Filtered {
    /// Starts the filter with the state of a row.
    pub fn new(row: &Row, radar: &Radar) -> Self {
        let model = ImmModel::default();
        let follower = Follower::new(&model, row.estimate(radar), row.turning(), row.time);
        let noise = radar.noise_at([row.state[0], row.state[1]], row.above(radar));
        Self { follower, surprise: 1.0, scatter: Scatter::default(), noise }
    }

    /// Updates the filter with a position of this covariance.
    pub fn follow(&mut self, time: f64, place: [f64; 2], noise: Plane, radar: &Radar) {
        let model = ImmModel::default();
        self.follower.predict(&model, time, radar.scan_period);
        let Estimate { mean, covariance: p } = self.follower.estimate();
        let both = Plane { xx: p[(0, 0)], xy: p[(0, 1)], yy: p[(1, 1)] }.plus(noise);
        let off = [place[0] - mean[0], place[1] - mean[1]];
        let square = (0.5 * both.inverse().form(off)).min(SURPRISE);
        self.surprise += MEMORY * (square - self.surprise);
        self.scatter.see(square);
        self.noise = noise;
        self.follower.correct(&model, place, noise);
    }

    /// Share of the variance of the positions that lasts.
    pub fn lasting(&self) -> f64 {
        self.scatter.lasting()
    }

    /// Returns position and velocity at a time.
    pub fn at(&self, time: f64) -> Estimate<4> {
        let mut estimate = self.follower.estimate();
        estimate.covariance *= self.surprise.max(1.0);
        let Plane { xx, xy, yy } = self.noise.scaled(self.lasting());
        estimate.covariance[(0, 0)] += xx;
        estimate.covariance[(0, 1)] += xy;
        estimate.covariance[(1, 0)] += xy;
        estimate.covariance[(1, 1)] += yy;
        carried(estimate, self.follower.turn_probability(), time - self.follower.time)
    }
}
