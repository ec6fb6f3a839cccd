//! Estimates the height of a target over time, by which targets above one another are distinguished.

use crate::base::exponential::exp;
use crate::sensors::HEIGHT_SIGMA as SIGMA;
use serde::{Deserialize, Serialize};

/// Intensity of the white vertical acceleration, m/s² per root of a hertz.
const ACCELERATION: f64 = 0.7;
/// Standard deviation of the initial vertical rate, m/s.
const CLIMB: f64 = 10.0;
/// Variance of a height about which nothing is known, uniform over 12 km, m².
const UNKNOWN: f64 = 1.2e7;
/// Range over which wrong heights are uniform, m.
pub(super) const SPAN: f64 = 12_000.0;
/// Probability that a reported height is wrong.
const WRONG: f64 = 1e-3;

/// Height and vertical rate.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Vertical {
    time: f64,
    pub height: f64,
    pub vertical_rate: f64,
    variance: [f64; 3],
    /// Largest variance of the height, m².
    most: f64,
    /// Whether the target has reported its height.
    pub reported: bool,
}

impl Vertical {
    pub fn new(time: f64, height: f64) -> Self {
        let variance = [SIGMA * SIGMA, 0.0, CLIMB * CLIMB];
        Self { time, height, vertical_rate: 0.0, variance, most: UNKNOWN, reported: true }
    }

    /// A height that is assumed, because none was reported; `most` is its variance.
    pub fn assumed(time: f64, [height, most]: [f64; 2]) -> Self {
        let variance = [most, 0.0, CLIMB * CLIMB];
        Self { time, height, vertical_rate: 0.0, variance, most, reported: false }
    }

    /// Variance of the height.
    pub fn height_variance(&self) -> f64 {
        self.variance[0]
    }

    #[inline]
    pub fn at(&self, time: f64) -> Self {
        let t = time - self.time;
        let [hh, hc, cc] = self.variance;
        let q = ACCELERATION * ACCELERATION * t.abs();
        let mut variance =
            [hh + t * (2.0 * hc + t * cc) + q * t * t / 3.0, hc + t * cc + q * t / 2.0, cc + q];
        if variance[0] > self.most {
            variance[1] *= (self.most / variance[0]).sqrt();
            variance[0] = self.most;
        }
        Self { time, height: self.height + t * self.vertical_rate, variance, ..*self }
    }

    /// Likelihood ratio of a reported height: this target against any other.
    #[inline]
    pub fn ratio(&self, time: f64, height: f64) -> f64 {
        self.at(time).ratio_now(height)
    }

    #[inline]
    fn ratio_now(&self, height: f64) -> f64 {
        let s = self.variance[0] + SIGMA * SIGMA;
        let d = height - self.height;
        let density = exp(-0.5 * d * d / s) / (std::f64::consts::TAU * s).sqrt();
        WRONG + (1.0 - WRONG) * density * SPAN
    }

    /// Corrects by a reported height, unless it is wrong.
    pub fn correct(&mut self, time: f64, height: f64) {
        let now = self.at(time);
        if now.ratio_now(height) < WRONG.sqrt() {
            return;
        }
        *self = now;
        self.reported = true;
        self.learn(height, SIGMA * SIGMA);
    }

    /// Corrects by a height that was inferred from the ranges of several radars.
    pub fn infer(&mut self, time: f64, height: f64, variance: f64) {
        *self = self.at(time);
        self.learn(height, variance);
    }

    fn learn(&mut self, height: f64, r: f64) {
        let [hh, hc, cc] = self.variance;
        let gain = [hh / (hh + r), hc / (hh + r)];
        let d = height - self.height;
        self.height += gain[0] * d;
        self.vertical_rate += gain[1] * d;
        let left = r / (hh + r);
        self.variance = [hh * left, hc * left, cc - gain[1] * hc];
    }
}
