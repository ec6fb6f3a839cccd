//! Evidence for the damping of a sensor's filter.
//!
//! The rows show the ratio `r = β / α` of a filter. Its α follows with the damping m from
//! `√(1 − α) = (m − r) / (m + r)`: m = 2 is a filter of nearly constant velocity in its steady state (Kalata
//! 1984), m = 1 a critically damped one. The plots that are reconstructed with the right damping are those
//! whose errors are independent of each other: from them, the next correction is predicted best.

use super::row::Row;
use super::stated::Agreement;
use crate::base::plane::Plane;
use crate::sensors::Radar;
use crate::tracker::{Estimate, Follower, ImmModel};
use serde::{Deserialize, Serialize};

/// Dampings that are compared, the usual one first.
pub(super) const DAMPING: [f64; COUNT] = [2.0, 1.0, 1.4, 4.0, 6.0];
const COUNT: usize = 5;
/// Acceleration of straight flight, m/s²: a filter with a long memory predicts the noise best.
const STRAIGHT: f64 = 0.03;
/// Probability of a turn from which on a row is no evidence: every filter lags.
const TURNING: f64 = 0.3;
/// Largest square of an innovation that is used, relative to its expected value.
const LARGEST: f64 = 10.0;
/// Rows of a track before its rows are evidence: the gain of a new track differs from that of an old one.
const WARM: u32 = 8;
/// Number of rows from which a damping is chosen, and from which on no more rows are needed.
const FEWEST: f64 = 30.0;
const MEMORY: f64 = 500.0;
/// Number of rows for which the evidence counts at most, because the models of motion are never exact, and
/// logarithm of the ratio of likelihoods from which another damping than the usual one is chosen.
const WORTH: f64 = 200.0;
const CLEAR: f64 = 17.0;
/// Relative standard deviations of gains, before the damping is known and later: a filter is only similar to one
/// of these, and rows may be left out.
const UNKNOWN: f64 = 0.1;
const SIMILAR: f64 = 0.05;

/// Sums over the rows of a sensor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Evidence {
    count: f64,
    /// Squares of normalised innovations, by damping, relative to their expected value.
    square: [f64; COUNT],
    /// Logarithms of the area of a standard deviation of the correction.
    area: [f64; COUNT],
    pub covariances: Agreement,
}

impl Evidence {
    /// Adds other rows.
    pub fn add(&mut self, other: &Self) {
        self.count += other.count;
        for k in 0..COUNT {
            self.square[k] += other.square[k];
            self.area[k] += other.area[k];
        }
        self.covariances.add(&other.covariances);
    }

    /// Whether there are enough rows.
    pub fn is_complete(&self) -> bool {
        self.count >= MEMORY
    }

    /// Returns the damping that explains the rows.
    pub fn damping(&self) -> f64 {
        if self.count < FEWEST {
            return DAMPING[0];
        }
        // the size of the noise is not known, only that it is the same in all rows
        let worth = self.count.min(WORTH);
        let score =
            |k: usize| -worth * ((self.square[k] / self.count).ln() + self.area[k] / self.count);
        let best = (1..COUNT).fold(0, |a, b| if score(b) > score(a) { b } else { a });
        if score(best) > score(0) + CLEAR { DAMPING[best] } else { DAMPING[0] }
    }

    /// Returns the relative standard deviation of gains with this damping.
    pub fn unsure(&self) -> f64 {
        if self.count < WORTH { UNKNOWN } else { SIMILAR }
    }
}

/// Filters over the plots of a track that are reconstructed with each damping.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Families {
    followers: [Follower; COUNT],
    rows: u32,
    /// What was found since it was last taken.
    pub found: Evidence,
}

impl Families {
    /// Starts with a row.
    pub fn new(row: &Row, radar: &Radar) -> Self {
        let follower = Follower::new(&model(), row.estimate(radar), row.turning(), row.time);
        Self { followers: [follower; COUNT], rows: 0, found: Evidence::default() }
    }

    /// Updates the filters with the plots behind a row, and their gains. The noise of `radar` is that of plots
    /// that are reconstructed with the gains `used`.
    pub fn follow(
        &mut self,
        row: &Row,
        plots: &[([f64; 2], Plane); COUNT],
        used: Plane,
        radar: &Radar,
    ) {
        let noise = radar.noise_at([row.state[0], row.state[1]], row.above(radar));
        let mut found = Evidence { count: 1.0, ..Evidence::default() };
        let mut is_turning = false;
        for (k, (follower, (plot, gain))) in self.followers.iter_mut().zip(plots).enumerate() {
            // a smaller gain puts the plots farther away
            let noise = noise.scaled(used.determinant() / gain.determinant());
            follower.predict(&model(), row.time, radar.scan_period);
            let Estimate { mean, covariance: p } = follower.estimate();
            let both = Plane { xx: p[(0, 0)], xy: p[(0, 1)], yy: p[(1, 1)] }.plus(noise);
            let off = [plot[0] - mean[0], plot[1] - mean[1]];
            found.square[k] = (0.5 * both.inverse().form(off)).min(LARGEST);
            found.area[k] = 0.5 * both.determinant().ln() + gain.determinant().ln();
            follower.correct(&model(), *plot, noise);
            is_turning |= follower.turn_probability() > TURNING;
        }
        self.rows += 1;
        if !is_turning && self.rows > WARM {
            self.found.add(&found);
        }
    }
}

fn model() -> ImmModel {
    ImmModel { straight_sigma: STRAIGHT, ..ImmModel::default() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;
    use crate::sensors::{Identities, radar_of};

    /// Damping that is found for eight tracks of an α-β filter, of targets that fly straight.
    fn found(alpha: f64, beta: f64) -> f64 {
        let (mut random, mut evidence) = (Random::new(5), Evidence::default());
        let radar = radar_of([50.0, 1e-3]);
        let ratio = beta / alpha;
        for track in 0..8 {
            let (mut state, mut families) = ([5e4, 0.0, 200.0, 0.0], None);
            for scan in 0..60 {
                let t = radar.scan_period;
                let time = t * f64::from(scan);
                let before = [state[0] + t * state[2], state[1] + t * state[3]];
                let y = [0, 1].map(|k| {
                    let place = [5e4 + 200.0 * time, 0.0][k];
                    place + random.symmetric(87.0) - before[k]
                });
                for k in 0..2 {
                    state[k] = before[k] + alpha * y[k];
                    state[k + 2] += beta / t * y[k];
                }
                let row = Row {
                    sensor: 0,
                    track,
                    time,
                    state,
                    covariance: [f64::NAN; 16],
                    height: f64::NAN,
                    identities: Identities::NONE,
                    turn_probability: f64::NAN,
                };
                let plots = DAMPING.map(|damping| {
                    let gain = 1.0 - ((damping - ratio) / (damping + ratio)).powi(2);
                    let both = Plane { xx: gain, xy: 0.0, yy: gain };
                    ([0, 1].map(|k| before[k] + alpha / gain * y[k]), both)
                });
                let families = families.get_or_insert_with(|| Families::new(&row, &radar));
                families.follow(&row, &plots, plots[0].1, &radar);
            }
            evidence.add(&families.unwrap().found);
        }
        evidence.damping()
    }

    #[test]
    fn the_damping_of_filters() {
        assert_eq!([found(0.5, 0.1716), found(0.3, 0.0534)], [2.0; 2]);
        // neighbours differ little
        assert!(found(0.51, 0.09) < 2.0 && found(0.75, 0.25) < 2.0);
        assert!(found(0.5, 0.5) > 2.0);
    }
}
