//! Radars: conversion of range and azimuth to east and north, with their covariance.

use super::channel::{Channel, Detection, Way, ways};
use crate::base::error::{Result, require, require_positive};
use crate::base::exponential::exp;
use crate::base::plane::Plane;
use serde::{Deserialize, Serialize};

/// Standard deviation of a reported height, m: rounding to hundreds of feet, and the error of the encoder.
pub(crate) const HEIGHT_SIGMA: f64 = 15.0;
/// Share of the range below which the ground range counts as zero: the target is directly above the radar.
const LEAST_GROUND_SHARE: f64 = 1e-3;
/// Least variance across the beam, as a share of that along it: above the radar, where azimuths say nothing,
/// the covariance would be singular to rounding.
pub(crate) const LEAST_ACROSS: f64 = 1e-10;
/// Variance along each axis of a plot about the centre of a target of unknown shape, as a share of its squared
/// extent: plots are anywhere on a target of this length, in any direction.
pub(crate) const SPREAD: f64 = 1.0 / 24.0;
/// Largest extent of a target, m.
const LARGEST: f64 = 100e3;

/// Position of a radar, and the properties of its measurements.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Radar {
    /// East, north and up, m.
    pub position: [f64; 3],
    /// Standard deviation of ranges, m.
    pub range_sigma: f64,
    /// Standard deviation of azimuths, rad.
    pub azimuth_sigma: f64,
    /// Time of one rotation, s.
    pub scan_period: f64,
    /// Largest range, m; may be infinite.
    pub max_range: f64,
    /// Probability that a target is detected in a scan.
    pub detection_probability: f64,
    /// Differences of range, m, and azimuth, rad, at each of which two targets give one common plot with a
    /// probability of a half; `None` if all targets are resolved.
    pub resolution: Option<[f64; 2]>,
    /// Largest length of targets that give several plots in a scan, m; 0 if each target gives one.
    pub extent: f64,
    /// The ways of detecting a target, if the channels are known.
    pub ways: Option<Box<Ways>>,
}

impl Radar {
    /// Checks the properties of the radar.
    ///
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
        let e = self.extent;
        require("target_extent", e, (0.0..=LARGEST).contains(&e), "from 0 to 100 km")?;
        let p = self.detection_probability;
        require("detection_probability", p, p > 0.0 && p < 1.0, "between 0 and 1")
    }

    /// Covariance of the plot of a target at this position and height above the radar (nan: unknown).
    /// A known height adds the effect of the slant range and the error of the height.
    #[inline]
    pub fn noise_at(&self, position: [f64; 2], up: f64) -> Plane {
        let d = [position[0] - self.position[0], position[1] - self.position[1]];
        let squared = (d[0] * d[0] + d[1] * d[1]).max(f64::MIN_POSITIVE);
        let up = if up.is_finite() { up * up } else { 0.0 };
        let range = self.range_sigma * self.range_sigma;
        // closer targets have no usable plots
        let ground = squared.max(LEAST_GROUND_SHARE * LEAST_GROUND_SHARE * (squared + up));
        let along = range + up * (range + HEIGHT_SIGMA * HEIGHT_SIGMA) / ground;
        if squared <= f64::MIN_POSITIVE {
            // at the radar itself the direction is unknown
            return Plane { xx: along, xy: 0.0, yy: along };
        }
        let across = (self.azimuth_sigma * self.azimuth_sigma * squared).max(LEAST_ACROSS * along);
        let share = 1.0 / squared;
        let (ee, en, nn) = (d[0] * d[0] * share, d[0] * d[1] * share, d[1] * d[1] * share);
        Plane {
            xx: along * ee + across * nn,
            xy: (along - across) * en,
            yy: along * nn + across * ee,
        }
    }

    /// East and north of a plot, corrected for the noise of the azimuth, which reduces sine and cosine by the
    /// factor exp(−σ²/2) on average. `None` if the target is directly above the radar.
    pub fn position_of(&self, range: f64, azimuth: f64, height: f64) -> Option<[f64; 2]> {
        let ground = self.ground_squared(range, height)?;
        Some(self.position_at(ground, azimuth, self.stretch()))
    }

    /// Square of the ground range of a plot. `None` if the target is directly above the radar.
    #[inline]
    pub(crate) fn ground_squared(&self, range: f64, height: f64) -> Option<f64> {
        let up = if height.is_finite() { height - self.position[2] } else { 0.0 };
        let squared = range * range - up * up;
        let least = LEAST_GROUND_SHARE * range;
        (squared > least * least).then_some(squared)
    }

    /// Factor by which the mean position of plots is closer than the target, because of the noise of the
    /// azimuth.
    pub(crate) fn stretch(&self) -> f64 {
        exp(0.5 * self.azimuth_sigma * self.azimuth_sigma)
    }

    /// East and north from the square of the ground range and [`Radar::stretch`].
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

    /// Distance by a faster formula than [`Self::distance`], for bounds only.
    #[inline]
    pub(crate) fn about(&self, position: [f64; 2]) -> f64 {
        let [x, y] = [position[0] - self.position[0], position[1] - self.position[1]];
        (x * x + y * y).sqrt()
    }

    pub(crate) fn distance(&self, position: [f64; 2]) -> f64 {
        (position[0] - self.position[0]).hypot(position[1] - self.position[1])
    }
}

/// The ways of a radar to detect a target.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Ways {
    each: Vec<Way>,
    /// The radar with the noise of each way; below, with the largest noise of all.
    seen: Vec<Radar>,
    worst: Radar,
}

impl Ways {
    fn new(radar: &Radar, channels: [Option<Channel>; 3]) -> Self {
        let each = ways(channels);
        let plain = Radar { ways: None, ..*radar };
        let mut ways = Self { seen: vec![plain.clone(); each.len()], each, worst: plain };
        let own = [radar.range_sigma, radar.azimuth_sigma];
        ways.assume(own, own, [1.0; 2]);
        ways
    }

    /// Returns all ways.
    pub fn all(&self) -> &[Way] {
        &self.each
    }

    fn index(&self, detection: Detection) -> Option<usize> {
        self.each.iter().position(|way| way.detection == detection)
    }

    /// Sets the noise of all ways. The radar itself is assumed to have the standard deviations `assumed`
    /// instead of those `stated`; `factors` are the ratios of its estimated to its stated variances.
    pub(crate) fn assume(&mut self, assumed: [f64; 2], stated: [f64; 2], factors: [f64; 2]) {
        let mut most = assumed;
        for (way, radar) in self.each.iter().zip(&mut self.seen) {
            let used = [0, 1].map(|i| {
                let (own, more) = (way.sigmas[i], assumed[i].powi(2) - stated[i].powi(2));
                (own * own + more.max(0.0)).sqrt().max(factors[i].sqrt() * own)
            });
            most = [0, 1].map(|i| f64::max(most[i], used[i]));
            [radar.range_sigma, radar.azimuth_sigma] = used;
        }
        [self.worst.range_sigma, self.worst.azimuth_sigma] = most;
    }
}

impl Radar {
    /// Returns the radar with a primary channel, a secondary channel and a mode S channel, or some of
    /// them. The radar detects a target if one of its channels does.
    ///
    /// # Errors
    /// A number outside its domain, or no channel.
    pub fn with_channels(self, channels: [Option<Channel>; 3]) -> Result<Self> {
        channels.iter().flatten().try_for_each(Channel::check)?;
        let any = channels.iter().any(Option::is_some);
        require("channels", 0.0, any, "one channel or more")?;
        let ways = Ways::new(&self, channels);
        let detection_probability = ways.each.iter().map(|way| way.probability).sum();
        Ok(Self { detection_probability, ways: Some(Box::new(ways)), ..self })
    }

    /// Returns the detection of a plot if it is one of this radar's ways.
    #[inline]
    pub(crate) fn known(&self, detection: Option<Detection>) -> Option<Detection> {
        self.way(detection).map(|way| way.detection)
    }

    /// Returns the way in which a plot was detected.
    #[inline]
    pub(crate) fn way(&self, detection: Option<Detection>) -> Option<&Way> {
        let ways = self.ways.as_ref()?;
        Some(&ways.each[ways.index(detection?)?])
    }

    /// Returns the radar with the noise of plots with this detection.
    #[inline]
    pub(crate) fn detecting(&self, detection: Option<Detection>) -> &Self {
        let Some(ways) = &self.ways else { return self };
        let index = detection.and_then(|detection| ways.index(detection));
        index.map_or(self, |index| &ways.seen[index])
    }

    /// Returns the radar with the largest noise of all its ways.
    #[inline]
    pub(crate) fn at_worst(&self) -> &Self {
        self.ways.as_ref().map_or(self, |ways| &ways.worst)
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
        extent: 0.0,
        ways: None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_within;

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

    #[test]
    fn noise_above_the_radar_is_regular() {
        let noise = radar_of([1000.0, 0.04]).noise_at([0.03, -0.05], 140.0);
        assert_within(1e-4, noise.determinant() / (noise.xx + noise.yy).powi(2), 1e-10);
    }

    #[test]
    fn noise_at_the_radar_is_that_of_the_range() {
        let radar = radar_of([50.0, 1e-3]);
        assert_eq!(radar.noise_at([0.0; 2], 0.0), Plane { xx: 2500.0, xy: 0.0, yy: 2500.0 });
    }

    fn channel(detection_probability: f64, sigmas: [f64; 2]) -> Option<Channel> {
        Some(Channel { detection_probability, sigmas, clutter_per_scan: f64::NAN })
    }

    fn probability(radar: &Radar, detection: Detection) -> f64 {
        radar.way(Some(detection)).unwrap().probability
    }

    #[test]
    fn channels_detect_independently() {
        let [psr, ssr] = [channel(0.85, [60.0, 2e-3]), channel(0.95, [30.0, 1e-3])];
        let radar = radar_of([50.0, 1e-3]).with_channels([psr, ssr, None]).unwrap();
        for (detection, expected) in
            [(Detection::PsrSsr, 0.8075), (Detection::Ssr, 0.1425), (Detection::Psr, 0.0425)]
        {
            assert_within(1e-14, probability(&radar, detection), expected);
        }
        assert_within(1e-12, 1.0 - radar.detection_probability, 0.0075);
        assert_eq!(radar.known(Some(Detection::ModeS)), None);
        assert_eq!(radar_of([50.0, 1e-3]).known(Some(Detection::Psr)), None);
    }

    #[test]
    fn a_target_answers_one_kind_of_interrogation() {
        let [psr, ssr, mode_s] = [0.8, 0.9, 0.98].map(|p| channel(p, [50.0, 1e-3]));
        let radar = radar_of([50.0, 1e-3]).with_channels([psr, ssr, mode_s]).unwrap();
        assert_within(1e-14, probability(&radar, Detection::PsrModeS), 0.8 * 0.49);
        assert_within(1e-14, probability(&radar, Detection::Ssr), 0.2 * 0.45);
        assert_within(1e-14, probability(&radar, Detection::Psr), 0.8 * (0.05 + 0.01));
        assert_within(1e-14, radar.detection_probability, 1.0 - 0.2 * 0.06);
        assert!(radar_of([50.0, 1e-3]).with_channels([None; 3]).is_err());
        assert!(
            radar_of([50.0, 1e-3]).with_channels([channel(1.0, [1.0; 2]), None, None]).is_err()
        );
    }

    #[test]
    fn noise_is_that_of_the_reply_and_grows_with_what_is_assumed() {
        let [psr, ssr] = [channel(0.85, [60.0, 2e-3]), channel(0.95, [30.0, 1e-3])];
        let mut radar = radar_of([50.0, 1e-3]).with_channels([psr, ssr, None]).unwrap();
        let sigma = |radar: &Radar, detection| radar.detecting(Some(detection)).range_sigma;
        assert_within(1e-14, sigma(&radar, Detection::PsrSsr), 30.0);
        assert_within(1e-14, sigma(&radar, Detection::Psr), 60.0);
        assert_within(1e-14, radar.detecting(None).range_sigma, 50.0);
        let ways = radar.ways.as_mut().unwrap();
        ways.assume([130.0, 1e-3], [50.0, 1e-3], [1.0, 1.0]);
        assert_within(1e-14, sigma(&radar, Detection::Psr), f64::hypot(60.0, 120.0));
        let ways = radar.ways.as_mut().unwrap();
        ways.assume([50.0, 1e-3], [50.0, 1e-3], [4.0, 1.0]);
        assert_within(1e-14, sigma(&radar, Detection::Ssr), 60.0);
        assert_within(1e-14, radar.at_worst().range_sigma, 120.0);
        assert_within(1e-14, radar.at_worst().azimuth_sigma, 2e-3);
    }
}
