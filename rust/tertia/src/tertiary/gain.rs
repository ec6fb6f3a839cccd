//! The gain of a sensor's filter, found from how plots move its tracks.
//!
//! A plot moves position and velocity of a track by `α y` and `β y / T`, whatever the filter states about its
//! accuracy. Their ratio is seen in the rows; and in the steady state of a filter of nearly constant velocity
//! `β = 2 (2 − α) − 4 √(1 − α)` (Kalata 1984), so that with `r = β / α`
//!
//! `√(1 − α) = (2 − r) / (2 + r)`.

use serde::{Deserialize, Serialize};

/// Share of earlier rows that is left after each one, and the largest step that counts as it is.
const MEMORY: f64 = 0.9;
const LARGE: f64 = 2.0;
/// α that is expected before rows show it, and its weight in squares of the noise of a plot.
const USUAL: f64 = 0.5;
const EXPECTED: f64 = 0.1;
/// Least and largest gain.
const LEAST: f64 = 0.05;
const LARGEST: f64 = 0.98;
/// Logarithm of the ratio of the factors along and across below which they are one.
const ALIKE: f64 = 0.3;
/// Share of the changes of velocity that those of position explain, below which the two are of different
/// origin.
const EXPLAINED: f64 = 0.5;

/// Sums of squares and products of what plots moved along an axis, in units of the noise of a plot; and of
/// the squares times the stated gain.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Sums {
    position: f64,
    both: f64,
    velocity: f64,
    stated: f64,
}

/// What is known of the gain along and across the line of sight.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Gain([Sums; 2]);

/// What a plot has moved along and across, in standard deviations of a plot.
#[derive(Clone, Copy, Debug)]
pub(super) struct Step {
    /// Of the position.
    pub position: [f64; 2],
    /// Of the velocity, times the time since the plot before.
    pub velocity: [f64; 2],
    /// The gain by the stated covariance, `P⁺ R⁻¹`.
    pub stated: [f64; 2],
}

impl Gain {
    /// A plot has moved the track.
    pub fn see(&mut self, step: &Step) {
        let [a, b] = step.position;
        // in turns steps are large, and say no more than others
        let scale = (LARGE / a.hypot(b)).min(1.0);
        for (axis, sums) in self.0.iter_mut().enumerate() {
            let (position, velocity) = (scale * step.position[axis], scale * step.velocity[axis]);
            let square = position * position;
            sums.position = MEMORY * sums.position + square;
            sums.both = MEMORY * sums.both + position * velocity;
            sums.velocity = MEMORY * sums.velocity + velocity * velocity;
            sums.stated = MEMORY * sums.stated + square * step.stated[axis];
        }
    }

    /// α along each axis: as stated, but for a factor; or, where rows come at other times than plots and
    /// their covariances are not those of the states after plots, by the ratio of each axis. None where
    /// velocities change for other reasons than positions.
    pub fn along(&self, stated: [f64; 2], is_periodic: bool) -> Option<[f64; 2]> {
        let explained: f64 = self.0.iter().map(Sums::explained).sum();
        if explained < EXPLAINED * self.0.iter().map(|sums| sums.velocity).sum::<f64>() {
            return None;
        }
        let own = self.0.map(|sums| sums.alpha());
        if is_periodic {
            return Some(own);
        }
        let parts = [0, 1].map(|axis| {
            let sums = self.0[axis];
            (sums.position * own[axis] + EXPECTED * USUAL, sums.stated + EXPECTED * USUAL)
        });
        let [(a, b), (c, d)] = parts;
        // else not even the shape of what is stated is right
        let is_common = (a * d / (b * c)).ln().abs() < ALIKE;
        let factor = (a + c) / (b + d);
        Some(if is_common { stated.map(|gain| limited(gain * factor)) } else { own })
    }
}

impl Sums {
    /// α by the ratio of the changes of velocity and position.
    fn alpha(&self) -> f64 {
        let ratio = (self.both + EXPECTED * ratio(USUAL)) / (self.position + EXPECTED);
        let root = ((2.0 - ratio) / (2.0 + ratio)).max(0.0);
        limited(1.0 - root * root)
    }

    fn explained(&self) -> f64 {
        if self.position > 0.0 { self.both * self.both / self.position } else { 0.0 }
    }
}

fn limited(gain: f64) -> f64 {
    gain.clamp(LEAST, LARGEST)
}

/// β / α of a filter of this α.
fn ratio(gain: f64) -> f64 {
    let root = (1.0 - gain).sqrt();
    2.0 * (1.0 - root) / (1.0 + root)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;

    /// Of a filter whose gains are these, where these are stated.
    fn found(gain: [f64; 2], stated: [f64; 2], is_periodic: bool) -> [f64; 2] {
        let (mut random, mut filter) = (Random::new(7), Gain::default());
        for _ in 0..60 {
            let position = gain.map(|gain| gain * (4.0 * random.uniform() - 2.0));
            let velocity = [0, 1].map(|axis| ratio(gain[axis]) * position[axis]);
            filter.see(&Step { position, velocity, stated });
        }
        filter.along(stated, is_periodic).unwrap()
    }

    #[test]
    fn a_gain_from_its_rows_whatever_is_stated() {
        let gain = [0.4, 0.7];
        for stated in [gain, [0.2, 0.35], [0.8, 1.4], [1.0, 1.0], [0.9, 0.2]] {
            for is_periodic in [false, true] {
                for (found, gain) in found(gain, stated, is_periodic).iter().zip(gain) {
                    assert!((found - gain).abs() < 0.03, "{stated:?}: {found} {gain}");
                }
            }
        }
    }

    #[test]
    fn velocities_that_have_nothing_to_do_with_positions() {
        let (mut random, mut other) = (Random::new(7), Gain::default());
        for _ in 0..60 {
            let [a, b, c, d] = [0; 4].map(|_| 4.0 * random.uniform() - 2.0);
            other.see(&Step { position: [a, b], velocity: [c, d], stated: [0.5; 2] });
        }
        assert_eq!(other.along([0.5; 2], false), None);
        assert!(Gain::default().along([0.5; 2], false).is_some());
    }
}
