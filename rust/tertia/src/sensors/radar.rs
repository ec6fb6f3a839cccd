//! A radar: from range and azimuth to east and north, with their covariance.

use super::channel::Ways;
use crate::base::error::{Result, require, require_positive};
use crate::base::plane::Plane;
use serde::{Deserialize, Serialize};

/// Standard deviation of a reported height: hundreds of feet, rounded, and the encoder.
pub(crate) const HEIGHT_SIGMA: f64 = 15.0;
/// Share of the range below which the ground range counts as zero: straight above the radar.
const LEAST_GROUND_SHARE: f64 = 1e-3;

/// Where a radar is, and how it measures.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Radar {
    /// East, north and up, m.
    pub position: [f64; 3],
    /// Standard deviation of ranges, m.
    pub range_sigma: f64,
    /// That of azimuths, rad.
    pub azimuth_sigma: f64,
    /// Time of one rotation, s.
    pub scan_period: f64,
    /// Largest range, m; may be infinite.
    pub max_range: f64,
    /// Probability that a target is detected in a scan.
    pub detection_probability: f64,
    /// Differences of range, m, and azimuth, rad, at each of which two targets make one plot with a
    /// probability of a half; none: all targets are resolved.
    pub resolution: Option<[f64; 2]>,
    /// The ways in which it detects a target, where its channels are known.
    pub ways: Option<Box<Ways>>,
}

impl Radar {
    /// # Errors
    /// A number outside its domain.
    pub fn check(&self) -> Result<()> {
        for place in self.position {
            require("position", place, place.is_finite(), "a finite number")?;
        }
        require_positive("range_sigma", self.range_sigma)?;
        require_positive("azimuth_sigma", self.azimuth_sigma)?;
        require_positive("scan_period", self.scan_period)?;
        require("max_range", self.max_range, self.max_range > 0.0, "a positive number")?;
        if let Some([range, azimuth]) = self.resolution {
            require_positive("range_resolution", range)?;
            require_positive("azimuth_resolution", azimuth)?;
        }
        let p = self.detection_probability;
        require("detection_probability", p, p > 0.0 && p < 1.0, "between 0 and 1")
    }

    /// Covariance of the plot of a target at this position and height above the radar (nan: unknown).
    /// With a height, the slant range and the error of the height add to it.
    #[inline]
    pub fn noise_at(&self, position: [f64; 2], up: f64) -> Plane {
        let d = [position[0] - self.position[0], position[1] - self.position[1]];
        let squared = (d[0] * d[0] + d[1] * d[1]).max(f64::MIN_POSITIVE);
        let up = if up.is_finite() { up * up } else { 0.0 };
        let range = self.range_sigma * self.range_sigma;
        // nearer than this, no plot is used
        let ground = squared.max(LEAST_GROUND_SHARE * LEAST_GROUND_SHARE * (squared + up));
        let along = range + up * (range + HEIGHT_SIGMA * HEIGHT_SIGMA) / ground;
        let across = self.azimuth_sigma * self.azimuth_sigma * squared;
        let share = 1.0 / squared;
        let (ee, en, nn) = (d[0] * d[0] * share, d[0] * d[1] * share, d[1] * d[1] * share);
        Plane {
            xx: along * ee + across * nn,
            xy: (along - across) * en,
            yy: along * nn + across * ee,
        }
    }

    /// East and north of a plot, corrected for the noise of the azimuth, by which sine and cosine are
    /// smaller by exp(−σ²/2) on average. None where it is straight above the radar.
    pub fn position_of(&self, range: f64, azimuth: f64, height: f64) -> Option<[f64; 2]> {
        let ground = self.ground_squared(range, height)?;
        Some(self.position_at(ground, azimuth, self.stretch()))
    }

    /// Square of the ground range of a plot. None where it is straight above the radar.
    #[inline]
    pub(crate) fn ground_squared(&self, range: f64, height: f64) -> Option<f64> {
        let up = if height.is_finite() { height - self.position[2] } else { 0.0 };
        let squared = range * range - up * up;
        let least = LEAST_GROUND_SHARE * range;
        (squared > least * least).then_some(squared)
    }

    /// By how much the mean position of plots is nearer than the target.
    pub(crate) fn stretch(&self) -> f64 {
        (0.5 * self.azimuth_sigma * self.azimuth_sigma).exp()
    }

    /// East and north by the square of the ground range, and [`Radar::stretch`].
    #[inline]
    pub(crate) fn position_at(&self, ground_squared: f64, azimuth: f64, stretch: f64) -> [f64; 2] {
        let (sine, cosine) = azimuth.sin_cos();
        let ground = ground_squared.sqrt() * stretch;
        [self.position[0] + ground * sine, self.position[1] + ground * cosine]
    }

    /// Whether a target at this position is within range.
    pub fn covers(&self, position: [f64; 2]) -> bool {
        self.distance(position) <= self.max_range
    }

    /// The distance by a faster formula, for bounds only.
    #[inline]
    pub(crate) fn about(&self, position: [f64; 2]) -> f64 {
        let [x, y] = [position[0] - self.position[0], position[1] - self.position[1]];
        (x * x + y * y).sqrt()
    }

    pub(crate) fn distance(&self, position: [f64; 2]) -> f64 {
        (position[0] - self.position[0]).hypot(position[1] - self.position[1])
    }
}

/// A radar at the origin with these standard deviations of range and azimuth, for tests.
#[cfg(test)]
pub(crate) fn radar_of([range_sigma, azimuth_sigma]: [f64; 2]) -> Radar {
    Radar {
        position: [0.0; 3],
        range_sigma,
        azimuth_sigma,
        scan_period: 4.0,
        max_range: f64::INFINITY,
        detection_probability: 0.9,
        resolution: None,
        ways: None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_along_the_beam_grows_towards_the_zenith() {
        let radar = radar_of([50.0, 1e-3]);
        for (ground, up) in [(9e3, 2e3), (9e3, 9e3), (3e3, 9e3), (500.0, 9e3)] {
            let range = f64::hypot(ground, up);
            let slope =
                |dr: f64, dh: f64| ((range + dr).powi(2) - (up + dh).powi(2)).sqrt() - ground;
            let (by_range, by_height) = (slope(1e-3, 0.0) / 1e-3, slope(0.0, 1e-3) / 1e-3);
            let expected = (50.0 * by_range).powi(2) + (HEIGHT_SIGMA * by_height).powi(2);
            let found = radar.noise_at([0.0, ground], up).yy;
            assert!((found / expected - 1.0).abs() < 1e-4, "{ground} {up}: {found} {expected}");
        }
    }
}
