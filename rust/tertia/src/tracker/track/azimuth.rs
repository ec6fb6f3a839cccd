//! A track and azimuths without ranges.

use super::Track;
use crate::base::plane::Plane;
use crate::tracker::filter::azimuth::{Equation, Sight, When};
use crate::tracker::settings::Settings;

/// Largest error of a position, as a share of its distance, at which the azimuth is linear in the
/// position.
const NEAR: f64 = 0.3;

/// Direction in which a sensor expects a target.
#[derive(Clone, Copy, Debug)]
pub(in crate::tracker) struct Direction {
    pub azimuth: f64,
    pub variance: f64,
    /// Change of the azimuth that an acceleration may have caused.
    pub margin: f64,
}

impl Track {
    /// Direction of the target from a sensor at this place and time; none if the target is too
    /// near.
    pub fn direction(&self, place: [f64; 2], time: f64) -> Option<Direction> {
        let t = time - self.time;
        let m = &self.estimate.mean;
        let [x, y] = [m[0] + t * m[2] - place[0], m[1] + t * m[3] - place[1]];
        let squared = x * x + y * y;
        let Plane { xx, yy, .. } = self.estimate.position_covariance();
        if xx + yy > NEAR * NEAR * squared {
            return None;
        }
        let (x, y) = (x / squared, y / squared);
        let row = [y, -x, t * y, -t * x];
        let swerve = self.swerve.variance(t) / squared;
        let variance = self.estimate.along(&row).1 + self.leaning(&row) + swerve;
        let margin = self.swerve.expected(t) / squared.sqrt();
        Some(Direction { azimuth: x.atan2(y), variance, margin })
    }

    /// Predicts to a time at which no radar has seen the target.
    pub fn predict_between(&mut self, time: f64, settings: &Settings) {
        self.predict(time, self.pace(settings), settings);
    }

    /// Squared normalised residual, and the variance of the residual in units of sigma².
    pub fn sighted(&self, sight: &Sight) -> (f64, f64) {
        let Equation { residual, row } = self.equation(sight);
        let s = 1.0 + self.estimate.along(&row).1 + self.leaning(&row);
        (residual * residual / s, s)
    }

    /// Corrects by an azimuth, which counts neither as a plot nor as a missed detection.
    pub fn see(&mut self, sight: &Sight, settings: &Settings) {
        self.predict_between(sight.time, settings);
        let Equation { row, .. } = self.equation(sight);
        let when = When { t: sight.time - self.time, pace: self.pace(settings) };
        let motion = self.motion(settings);
        self.filter.see(motion, sight, when);
        self.estimate = self.filter.estimate();
        for lean in self
            .lean
            .as_deref_mut()
            .into_iter()
            .chain(self.delays.iter_mut().map(|own| &mut own.lean))
        {
            lean.see(&self.estimate, &row);
        }
        let none = f64::NAN;
        self.innovation = ([none; 2], Plane { xx: none, xy: none, yy: none });
        self.merged = false;
    }

    fn equation(&self, sight: &Sight) -> Equation {
        sight.equation(self.estimate.mean.data.0[0], sight.time - self.time)
    }

    /// Variance, due to the height, of a quantity with these derivatives with respect to the state.
    fn leaning(&self, row: &[f64; 4]) -> f64 {
        let height = self.lean.as_ref().zip(self.vertical).map_or(0.0, |(lean, vertical)| {
            lean.along(row).powi(2) * vertical.at(self.time).height_variance()
        });
        height + self.delay_along(row)
    }

    /// Scan period of its slowest sensor for the noise of the models, s.
    pub(super) fn pace(&self, settings: &Settings) -> f64 {
        let each = self.beams.all().iter().map(|expected| settings.pace(expected.radar));
        each.fold(0.0, f64::max)
    }
}
