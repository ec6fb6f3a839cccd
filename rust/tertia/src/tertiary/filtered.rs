//! What a tracker would make of the plots behind a track of another filter.

use super::row::{Row, carried};
use crate::base::plane::Plane;
use crate::sensors::Radar;
use crate::tracker::{Estimate, Follower, ImmModel};
use serde::{Deserialize, Serialize};

/// Share of the newest plot in the running mean of innovations, and the most that one counts.
const MEMORY: f64 = 0.3;
const SURPRISE: f64 = 20.0;

/// A filter of straight flight, turns and changes of speed along a track. The state of a filter without turns
/// lags in turns, by more than it states: compared with those of other sensors, it would be of another
/// target.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Filtered {
    follower: Follower,
    /// Running mean of the normalised squares of innovations, over what is expected.
    surprise: f64,
}

impl Filtered {
    /// From the state of a row.
    pub fn new(row: &Row, radar: &Radar) -> Self {
        let model = ImmModel::default();
        let follower = Follower::new(&model, row.estimate(radar), row.turning(), row.time);
        Self { follower, surprise: 1.0 }
    }

    /// A position of this covariance.
    pub fn follow(&mut self, time: f64, place: [f64; 2], noise: Plane, radar: &Radar) {
        let model = ImmModel::default();
        self.follower.predict(&model, time, radar.scan_period);
        let Estimate { mean, covariance: p } = self.follower.estimate();
        let both = Plane { xx: p[(0, 0)], xy: p[(0, 1)], yy: p[(1, 1)] }.plus(noise);
        let off = [place[0] - mean[0], place[1] - mean[1]];
        let square = (0.5 * both.inverse().form(off)).min(SURPRISE);
        self.surprise += MEMORY * (square - self.surprise);
        self.follower.correct(&model, place, noise);
    }

    /// Position and velocity at a time.
    pub fn at(&self, time: f64) -> Estimate<4> {
        let mut estimate = self.follower.estimate();
        estimate.covariance *= self.surprise.max(1.0);
        carried(estimate, self.follower.turn_probability(), time - self.follower.time)
    }
}
