//! Errors of reported positions that last: successive reports of a target do not show them, and no average of
//! reports is free of them.
//!
//! If the differences between successive reports are smaller than their stated errors, either the sensor is better
//! than stated, or its errors last. Nothing shows which, so that tracks have the part that is missing in full.

use crate::base::plane::Plane;
use crate::tracker::plot::Measured;
use crate::tracker::settings::Settings;
use serde::{Deserialize, Serialize};

/// Errors that a track has in common with the reports from which it was made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Common {
    /// Sums of the weights of the reports with such errors in the track, of their squares, and of the covariances of
    /// the errors by their weights, m².
    weight: f64,
    square: f64,
    sum: Plane,
}

impl Common {
    /// Adds errors with this covariance, which count by a share, to those so far, which count by the rest.
    pub fn add(&mut self, own: Plane, share: f64) {
        let (is_one, left) = (f64::from(u8::from(own.xx > 0.0)), 1.0 - share);
        self.weight = left * self.weight + share * is_one;
        self.square = left * left * self.square + share * share * is_one;
        self.sum = self.sum.scaled(left).plus(own.scaled(share));
    }

    /// Adds those of a plot that moved the track; `noise` is its covariance, and `all` that of its innovation.
    pub fn moved(&mut self, plot: &Measured, [noise, all]: [Plane; 2], settings: &Settings) {
        let common = settings.quality(plot.radar).common;
        if common > 0.0 || self.is_some() {
            let own = plot.source.placed().unwrap_or_default().scaled(common);
            let share = 1.0 - (noise.xx + noise.yy) / (all.xx + all.yy);
            self.add(own, share.clamp(0.0, 1.0));
        }
    }

    pub fn is_some(&self) -> bool {
        self.weight > 0.0
    }

    /// By how much the covariance of the track is larger than if the errors were independent, m². Those of several
    /// sensors may be alike.
    pub fn covariance(&self) -> Plane {
        let excess = self.weight - self.square / self.weight.max(f64::MIN_POSITIVE);
        self.sum.scaled(excess)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_within;

    const OWN: Plane = Plane { xx: 100.0, xy: 20.0, yy: 50.0 };

    #[test]
    fn a_track_of_one_sensor_has_its_errors() {
        let mut found = Common::default();
        found.add(OWN, 1.0);
        assert_eq!(found.covariance(), Plane::default());
        (0..200).for_each(|_| found.add(OWN, 0.02));
        let Plane { xx, xy, yy } = found.covariance();
        // the mean of about a hundred reports
        assert_within(1e-3, xx, 99.0);
        assert_within(1e-3, xy, 19.8);
        assert_within(1e-3, yy, 49.5);
    }

    #[test]
    fn errors_count_as_much_as_their_sensor() {
        let mut found = Common::default();
        for _ in 0..2000 {
            found.add(OWN, 0.002);
            found.add(Plane::default(), 0.006);
        }
        assert_within(0.05, found.covariance().xx, 100.0 / 16.0);
    }
}
