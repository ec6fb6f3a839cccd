//! Mean and variance of the heights of the traffic, as a prior for plots that have no height.

use serde::{Deserialize, Serialize};

/// Aircraft are anywhere between 0 and this height, m.
const HIGHEST: f64 = 12_000.0;
/// Sine of the steepest elevation at which radars usually see targets.
const STEEP: f64 = 0.7;

/// Prior of the heights of targets, before any height is known.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub enum Heights {
    /// Anywhere between the ground and the highest aircraft.
    #[default]
    Air,
    /// At this mean height above the sensor, with this standard deviation, m.
    Above(f64, f64),
}

/// Number, mean and squared deviations of the heights so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Level {
    expected: Heights,
    count: f64,
    mean: f64,
    squares: f64,
}

impl Level {
    /// The level before any height is known.
    pub fn of(expected: Heights) -> Self {
        Self { expected, ..Self::default() }
    }

    /// Whether any height is known.
    pub fn is_known(&self) -> bool {
        self.count > 0.0
    }

    pub fn add(&mut self, height: f64) {
        self.count += 1.0;
        let d = height - self.mean;
        self.mean += d / self.count;
        self.squares += d * (height - self.mean);
    }

    /// Mean and variance of the height of a target at this range from a sensor of height `site`.
    pub fn prior(&self, site: f64, range: f64) -> [f64; 2] {
        let (mean, variance) = match self.expected {
            Heights::Air => (0.5 * HIGHEST, HIGHEST * HIGHEST / 12.0),
            Heights::Above(height, sigma) => (site + height, sigma * sigma),
        };
        let mean = if self.is_known() { self.mean } else { mean };
        let variance = (variance + self.squares) / (1.0 + self.count);
        let top = STEEP * range;
        if mean - site < top {
            return [mean, variance];
        }
        // so near that the target must be lower: anywhere up to the steepest elevation
        [site + 0.5 * top, top * top / 12.0]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_within;

    #[test]
    fn targets_near_the_ground_are_expected_there() {
        let level = Level::of(Heights::Above(100.0, 60.0));
        assert_eq!(level.prior(420.0, 2e3), [520.0, 3600.0]);
        assert_eq!(level.prior(420.0, 100.0), [455.0, 4900.0 / 12.0]);
    }

    #[test]
    fn the_level_is_the_mean_with_the_spread_of_the_heights() {
        let mut level = Level::default();
        assert_eq!(level.prior(300.0, 1e5), [6000.0, 1.2e7]);
        for height in [1000.0, 4000.0, 10_000.0] {
            level.add(height);
        }
        let [mean, variance] = level.prior(300.0, 1e5);
        assert_within(1e-13, mean, 5000.0);
        assert_within(1e-13, variance, (1.2e7 + 16e6 + 1e6 + 25e6) / 4.0);
        // 5 km away nothing is seen higher than 3.5 km above the radar
        let [mean, variance] = level.prior(300.0, 5e3);
        assert_within(1e-13, mean, 300.0 + 1750.0);
        assert_within(1e-13, variance, 3500.0_f64.powi(2) / 12.0);
    }
}
