//! Heights over time, by which targets above one another are distinguished.

use crate::base::exponential::exp;
use crate::sensors::HEIGHT_SIGMA as SIGMA;
use serde::{Deserialize, Serialize};

/// Standard deviation of the vertical acceleration in white noise, m/s² per root of a hertz.
const ACCELERATION: f64 = 0.7;
/// Standard deviation of the first vertical rate, m/s.
const CLIMB: f64 = 10.0;
/// Range of wrong heights, m.
const SPAN: f64 = 12_000.0;
/// Probability that a height is wrong.
const WRONG: f64 = 1e-3;

/// Height and vertical rate.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Vertical {
    time: f64,
    pub height: f64,
    pub vertical_rate: f64,
    variance: [f64; 3],
}

impl Vertical {
    pub fn new(time: f64, height: f64) -> Self {
        Self { time, height, vertical_rate: 0.0, variance: [SIGMA * SIGMA, 0.0, CLIMB * CLIMB] }
    }

    #[inline]
    fn at(&self, time: f64) -> Self {
        let t = time - self.time;
        let [hh, hc, cc] = self.variance;
        let q = ACCELERATION * ACCELERATION * t.abs();
        let variance =
            [hh + t * (2.0 * hc + t * cc) + q * t * t / 3.0, hc + t * cc + q * t / 2.0, cc + q];
        Self {
            time,
            height: self.height + t * self.vertical_rate,
            vertical_rate: self.vertical_rate,
            variance,
        }
    }

    /// Likelihood ratio of the height: this target against any.
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

    /// Corrects by a height, unless it is wrong.
    pub fn correct(&mut self, time: f64, height: f64) {
        let now = self.at(time);
        if now.ratio_now(height) < WRONG.sqrt() {
            return;
        }
        *self = now;
        let [hh, hc, cc] = self.variance;
        let gain = [hh / (hh + SIGMA * SIGMA), hc / (hh + SIGMA * SIGMA)];
        let d = height - self.height;
        self.height += gain[0] * d;
        self.vertical_rate += gain[1] * d;
        let left = SIGMA * SIGMA / (hh + SIGMA * SIGMA);
        self.variance = [hh * left, hc * left, cc - gain[1] * hc];
    }
}
