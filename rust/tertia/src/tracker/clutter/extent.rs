//! Estimates the area from which a position sensor reports, which has no place of its own.

use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Smallest radius of the area, in distances that the fastest target covers in an update interval.
const INTERVALS: f64 = 5.0;

/// Mean and variance of the positions that were reported recently.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Extent {
    /// Smallest radius, m.
    least: f64,
    weight: f64,
    mean: [f64; 2],
    /// Weighted sums of squares about the mean.
    square: [f64; 2],
}

impl Extent {
    /// The extent before any report: the distance that a target can cover in a few update intervals.
    pub fn new(max_speed: f64, interval: f64) -> Self {
        let least = INTERVALS * max_speed * interval;
        Self { least, weight: 0.0, mean: [0.0; 2], square: [0.0; 2] }
    }

    pub fn saw(&mut self, position: [f64; 2]) {
        self.weight += 1.0;
        let axes = self.mean.iter_mut().zip(&mut self.square);
        for (place, (mean, square)) in position.into_iter().zip(axes) {
            let before = place - *mean;
            *mean += before / self.weight;
            *square += before * (place - *mean);
        }
    }

    /// Multiplies the weights of all positions so far by `kept`.
    pub fn fade(&mut self, kept: f64) {
        self.weight *= kept;
        self.square = self.square.map(|square| kept * square);
    }

    /// Area of a disc over which positions are spread as widely as the reported ones: its radius is two
    /// standard deviations along the wider axis.
    pub fn area(&self) -> f64 {
        let variance = self.square[0].max(self.square[1]) / self.weight.max(1.0);
        PI * (4.0 * variance).max(self.least * self.least)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_within;

    #[test]
    fn the_area_is_that_of_a_disc_wherever_it_is_and_follows_the_sensor() {
        let disc = |extent: &mut Extent, centre: f64, radius: f64| {
            for k in 1..4000 {
                let u = (f64::from(k) * 0.618_033_988_749_894_9).fract();
                let angle =
                    std::f64::consts::TAU * (f64::from(k) * 0.414_213_562_373_095_1).fract();
                let (sine, cosine) = angle.sin_cos();
                let r = radius * u.sqrt();
                extent.saw([centre + r * sine, r * cosine - centre]);
                if k % 100 == 0 {
                    extent.fade(0.9);
                }
            }
        };
        let mut extent = Extent::new(10.0, 1.0);
        assert_within(1e-12, extent.area(), PI * 2500.0);
        disc(&mut extent, 0.0, 500.0);
        assert_within(0.1, extent.area(), PI * 250_000.0);
        // each of these lets the first disc, which was far away, fade to 1.5 %
        (0..5).for_each(|_| disc(&mut extent, 1e5, 100.0));
        assert_within(0.1, extent.area(), PI * 1e4);
    }
}
