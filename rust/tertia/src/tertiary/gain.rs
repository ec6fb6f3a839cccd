//! Estimate of the gain of a sensor's filter from the corrections that plots apply to its tracks.
//!
//! A plot corrects the position and velocity of a track by `α y` and `β y / T`, whatever accuracy the filter
//! states. The ratio of these corrections is visible in the rows. In the steady state of a filter of nearly
//! constant velocity, `β = 2 (2 − α) − 4 √(1 − α)` (Kalata 1984), and therefore with `r = β / α`
//!
//! `√(1 − α) = (2 − r) / (2 + r)`. In other filters, another damping takes the place of the 2.

use crate::base::plane::Plane;
use serde::{Deserialize, Serialize};

/// Forgetting factor of the sums per row, and the largest step that is used in full, in sigmas of a plot.
const MEMORY: f64 = 0.9;
const LARGE: f64 = 2.0;
/// Expected α before rows are observed, and its weight as squares in sigmas of a plot.
const USUAL: f64 = 0.5;
const EXPECTED: f64 = 0.1;
/// Smallest and largest gain.
const LEAST: f64 = 0.05;
const LARGEST: f64 = 0.98;
/// Largest correlation of a gain along and across: beyond, its inverse is lost to rounding.
const CORRELATED: f64 = 0.999;
/// If the logarithm of the ratio of the factors along and across is smaller than this, they count as equal.
const ALIKE: f64 = 0.3;
/// If the corrections of position explain less than this share of those of velocity, the two do not come
/// from the same plots.
const EXPLAINED: f64 = 0.5;

/// Sums of squares and products of the corrections along one axis, in sigmas of a plot; `stated` sums the
/// squares times the stated gain.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Sums {
    position: f64,
    both: f64,
    velocity: f64,
    stated: f64,
}

/// Sums from which the gain along and across the line of sight is estimated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Gain([Sums; 2]);

/// Correction by a plot, along and across the line of sight, in standard deviations of a plot.
#[derive(Clone, Copy, Debug)]
pub(super) struct Step {
    /// Correction of the position.
    pub position: [f64; 2],
    /// Correction of the velocity, times the time since the previous plot.
    pub velocity: [f64; 2],
    /// Gain according to the stated covariance, `P⁺ R⁻¹`, which is symmetric in these units.
    pub stated: Plane,
}

impl Gain {
    /// Adds the correction by a plot.
    pub fn see(&mut self, step: &Step) {
        let [a, b] = step.position;
        // in turns the steps are large, but they contain no more information than others
        let scale = (LARGE / a.hypot(b)).min(1.0);
        let stated = [step.stated.xx, step.stated.yy];
        for (axis, sums) in self.0.iter_mut().enumerate() {
            let (position, velocity) = (scale * step.position[axis], scale * step.velocity[axis]);
            let square = position * position;
            sums.position = MEMORY * sums.position + square;
            sums.both = MEMORY * sums.both + position * velocity;
            sums.velocity = MEMORY * sums.velocity + velocity * velocity;
            sums.stated = MEMORY * sums.stated + square * stated[axis];
        }
    }

    /// Estimates the gain along and across: the stated gain times a common factor or, if the rows come at other
    /// times than the plots and their covariances are therefore not those after a plot, the α from the ratio of
    /// corrections on each axis. Returns `None` if velocities change for other reasons than positions.
    pub fn along(&self, stated: Plane, damping: f64, is_periodic: bool) -> Option<Plane> {
        let explained: f64 = self.0.iter().map(Sums::explained).sum();
        if explained < EXPLAINED * self.0.iter().map(|sums| sums.velocity).sum::<f64>() {
            return None;
        }
        let own = self.0.map(|sums| sums.alpha(damping));
        let [xx, yy] = own;
        let own_gain = Plane { xx, xy: 0.0, yy };
        if is_periodic {
            return Some(own_gain);
        }
        let parts = [0, 1].map(|axis| {
            let sums = self.0[axis];
            (sums.position * own[axis] + EXPECTED * USUAL, sums.stated + EXPECTED * USUAL)
        });
        let [(a, b), (c, d)] = parts;
        // otherwise not even the shape of the stated covariance is right
        let is_common = (a * d / (b * c)).ln().abs() < ALIKE;
        let factor = (a + c) / (b + d);
        Some(if is_common { limited(stated.scaled(factor)) } else { own_gain })
    }
}

impl Sums {
    /// α from the ratio of the corrections of velocity and position.
    fn alpha(&self, damping: f64) -> f64 {
        let usual = 0.5 * damping * ratio(USUAL);
        let ratio = (self.both + EXPECTED * usual) / (self.position + EXPECTED);
        let root = ((damping - ratio) / (damping + ratio)).max(0.0);
        clamped(1.0 - root * root)
    }

    fn explained(&self) -> f64 {
        if self.position > 0.0 { self.both * self.both / self.position } else { 0.0 }
    }
}

fn clamped(gain: f64) -> f64 {
    gain.clamp(LEAST, LARGEST)
}

/// Limits the gain along and across, and their correlation.
fn limited(gain: Plane) -> Plane {
    let [xx, yy] = [gain.xx, gain.yy].map(clamped);
    let correlation = gain.xy / (gain.xx * gain.yy).sqrt();
    Plane { xx, xy: correlation.clamp(-CORRELATED, CORRELATED) * (xx * yy).sqrt(), yy }
}

/// β / α of a filter with this α.
fn ratio(gain: f64) -> f64 {
    let root = (1.0 - gain).sqrt();
    2.0 * (1.0 - root) / (1.0 + root)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;

    /// Estimated gains for a filter with these actual and stated gains.
    fn found(gain: [f64; 2], [xx, yy]: [f64; 2], is_periodic: bool) -> [f64; 2] {
        let stated = Plane { xx, xy: 0.0, yy };
        let (mut random, mut filter) = (Random::new(7), Gain::default());
        for _ in 0..60 {
            let position = gain.map(|gain| gain * (4.0 * random.uniform() - 2.0));
            let velocity = [0, 1].map(|axis| ratio(gain[axis]) * position[axis]);
            filter.see(&Step { position, velocity, stated });
        }
        let found = filter.along(stated, 2.0, is_periodic).unwrap();
        [found.xx, found.yy]
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
    fn a_gain_that_is_almost_singular_has_an_inverse() {
        let stated = Plane { xx: 0.5, xy: 0.3, yy: 0.18 };
        let inverse = limited(stated).inverse();
        assert!([inverse.xx, inverse.yy].iter().all(|x| x.is_finite() && *x > 0.0));
        let usual = Plane { xy: 0.1, ..stated };
        assert!((limited(usual).xy - 0.1).abs() < 1e-15);
    }

    #[test]
    fn velocities_that_have_nothing_to_do_with_positions() {
        let stated = Plane { xx: 0.5, xy: 0.0, yy: 0.5 };
        let (mut random, mut other) = (Random::new(7), Gain::default());
        for _ in 0..60 {
            let [a, b, c, d] = [0; 4].map(|_| 4.0 * random.uniform() - 2.0);
            other.see(&Step { position: [a, b], velocity: [c, d], stated });
        }
        assert_eq!(other.along(stated, 2.0, false), None);
        assert!(Gain::default().along(stated, 2.0, false).is_some());
    }
}
