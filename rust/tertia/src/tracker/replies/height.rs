//! Estimates the height of a target over time, which distinguishes targets above one another.

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
pub(in crate::tracker) const SPAN: f64 = 12_000.0;
/// Probability that a reported height is wrong.
const WRONG: f64 = 1e-3;
/// Mean time between changes of the vertical rate, s, and the standard deviation of the rate after a change,
/// m/s.
const STEADY: f64 = 200.0;
const RATE: f64 = 20.0;
/// Normalised innovation squared up to which the vertical rate is taken to be unchanged.
const EXPECTED: f64 = 9.0;
/// Number of successive heights that no model expects and that are taken to be right if they agree, in general
/// and after a single height; largest vertical rate between two heights that agree, m/s, and margin for their
/// errors, m. Three heights at a constant vertical rate, whatever it is, agree as well.
const ENOUGH: u8 = 3;
const ENOUGH_FIRST: u8 = 2;
const MAX_RATE: f64 = 150.0;
const MARGIN: f64 = 4.0 * SIGMA;
const MARGIN_THREE: f64 = 10.0 * SIGMA;

/// Height and vertical rate.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Vertical {
    time: f64,
    pub height: f64,
    pub vertical_rate: f64,
    variance: [f64; 3],
    /// Largest variance of the height, m².
    most: f64,
    /// Whether the target has reported its height.
    pub reported: bool,
    /// Whether it follows from one reported height alone, which is as often wrong as any other.
    is_first: bool,
    refused: Refused,
}

/// Number of successive heights that agree although no model expects them, time and height of the last one,
/// and the vertical rate between the last two.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Refused {
    count: u8,
    time: f64,
    height: f64,
    rate: f64,
}

impl Refused {
    /// Counts one more height; a height that contradicts those before starts the count again.
    fn count(self, time: f64, height: f64) -> Self {
        let (t, d) = (time - self.time, height - self.height);
        let is_near = d.abs() <= MAX_RATE * t.abs() + MARGIN;
        let is_in_line = (d - self.rate * t).abs() <= MARGIN_THREE;
        let count = match self.count {
            0 => 1,
            _ if is_near => self.count + 1,
            _ if is_in_line && self.rate != 0.0 => ENOUGH,
            _ => 1,
        };
        let rate = if self.count > 0 && t != 0.0 { d / t } else { 0.0 };
        Self { count, time, height, rate }
    }
}

impl Vertical {
    pub fn new(time: f64, height: f64) -> Self {
        let variance = [SIGMA * SIGMA, 0.0, CLIMB * CLIMB];
        Self {
            time,
            height,
            vertical_rate: 0.0,
            variance,
            most: UNKNOWN,
            reported: true,
            is_first: true,
            refused: Refused::default(),
        }
    }

    /// Creates an estimate from an assumed height, because none was reported; `most` is the variance of the
    /// height.
    pub fn assumed(time: f64, [height, most]: [f64; 2]) -> Self {
        let variance = [most, 0.0, CLIMB * CLIMB];
        Self {
            time,
            height,
            vertical_rate: 0.0,
            variance,
            most,
            reported: false,
            is_first: false,
            refused: Refused::default(),
        }
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
        let variance =
            [hh + t * (2.0 * hc + t * cc) + q * t * t / 3.0, hc + t * cc + q * t / 2.0, cc + q];
        let variance = self.limited(variance);
        Self { time, height: self.height + t * self.vertical_rate, variance, ..*self }
    }

    /// Predicts the state if the vertical rate changes at some instant before this time, all instants being
    /// equally likely: the old rate holds before the change, and any rate after it.
    fn changed(&self, time: f64) -> Self {
        let t = time - self.time;
        let [hh, hc, cc] = self.variance;
        let (rate, any) = (self.vertical_rate, RATE * RATE);
        let spread = t * (hc + t * (cc + any) / 3.0 + t * rate * rate / 12.0);
        let variance = self.limited([hh + spread, 0.5 * t * any, any]);
        Self { time, height: self.height + 0.5 * t * rate, vertical_rate: 0.0, variance, ..*self }
    }

    /// The covariance of height and vertical rate with the same correlation, and not more than the largest
    /// variance of the height.
    #[inline]
    fn limited(&self, [hh, hc, cc]: [f64; 3]) -> [f64; 3] {
        if hh > self.most { [self.most, hc * (self.most / hh).sqrt(), cc] } else { [hh, hc, cc] }
    }

    /// Likelihood ratio of a reported height: this target against any other.
    #[inline]
    pub fn ratio(&self, time: f64, height: f64) -> f64 {
        let now = self.at(time);
        let mut likelihood = now.likelihood(height);
        if !now.expects(height) {
            let probability = self.change_probability(time);
            let changed = self.changed(time).likelihood(height);
            likelihood += probability * (changed - likelihood);
        }
        WRONG + (1.0 - WRONG) * likelihood
    }

    /// Whether a reported height is consistent with an unchanged vertical rate.
    #[inline]
    fn expects(&self, height: f64) -> bool {
        (height - self.height).powi(2) < EXPECTED * (self.variance[0] + SIGMA * SIGMA)
    }

    /// Returns the density of a correctly reported height, relative to that of a wrong one.
    #[inline]
    fn likelihood(&self, height: f64) -> f64 {
        let s = self.variance[0] + SIGMA * SIGMA;
        let d = height - self.height;
        SPAN * exp(-0.5 * d * d / s) / (std::f64::consts::TAU * s).sqrt()
    }

    /// Returns the probability that the vertical rate changes before this time.
    fn change_probability(&self, time: f64) -> f64 {
        let t = (time - self.time).max(0.0);
        t / (STEADY + t)
    }

    /// Updates the state by a reported height, unless the height is more likely wrong than right. The result
    /// for an unexpected height is the mean and the covariance of three cases: the rate is unchanged, the
    /// rate has changed, the height is wrong (Bar-Shalom, Li, Kirubarajan 2001, section 11.6).
    pub fn correct(&mut self, time: f64, height: f64) {
        let now = self.at(time);
        if now.expects(height) {
            *self = now.taught(height);
            return;
        }
        let (probability, changed) = (self.change_probability(time), self.changed(time));
        let steady = (1.0 - WRONG) * (1.0 - probability) * now.likelihood(height);
        let turned = (1.0 - WRONG) * probability * changed.likelihood(height);
        if steady + turned < WRONG {
            self.refuse(time, height);
            return;
        }
        let all = [(steady, now.taught(height)), (turned, changed.taught(height)), (WRONG, now)];
        *self = Self::mixed(&all);
    }

    /// Leaves a height out; if enough successive heights agree, starts again from this one and the one
    /// before.
    fn refuse(&mut self, time: f64, height: f64) {
        let before = self.refused;
        self.refused = before.count(time, height);
        let enough = if self.is_first { ENOUGH_FIRST } else { ENOUGH };
        if self.refused.count >= enough {
            let mut anew = Self::new(before.time, before.height);
            anew.variance[2] = RATE * RATE;
            if self.refused.rate.abs() > MAX_RATE {
                anew.vertical_rate = self.refused.rate;
            }
            *self = anew.at(time).taught(height);
        }
    }

    /// Returns the mean and the covariance of a mixture of states with these weights.
    fn mixed(all: &[(f64, Self); 3]) -> Self {
        let total: f64 = all.iter().map(|(weight, _)| weight).sum();
        let mean = |of: fn(&Self) -> f64| {
            all.iter().map(|(weight, one)| weight * of(one)).sum::<f64>() / total
        };
        let (height, vertical_rate) = (mean(|one| one.height), mean(|one| one.vertical_rate));
        let mut variance = [0.0; 3];
        for (weight, one) in all {
            let (u, v) = (one.height - height, one.vertical_rate - vertical_rate);
            for (sum, (own, apart)) in
                variance.iter_mut().zip(one.variance.into_iter().zip([u * u, u * v, v * v]))
            {
                *sum += weight / total * (own + apart);
            }
        }
        Self { height, vertical_rate, variance, ..all[0].1 }
    }

    /// Returns the state after an update by a correctly reported height.
    fn taught(mut self, height: f64) -> Self {
        self.learn(height, SIGMA * SIGMA);
        self.reported = true;
        self.is_first = false;
        self.refused = Refused::default();
        self
    }

    /// Updates the state by a height that was inferred from the ranges of several radars.
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

#[cfg(test)]
mod tests {
    use super::*;

    const STEP: f64 = 30.48;

    fn near(tolerance: f64, found: f64, expected: f64) {
        assert!((found - expected).abs() <= tolerance, "{found} is not {expected}");
    }

    /// The variance of a height is never negative, also if heights are known well beforehand.
    #[test]
    fn a_change_of_the_rate_leaves_a_covariance() {
        for most in [10.0, 1e3, 1e5] {
            let own = Vertical { most, ..level(4.0) };
            for t in [4.0, 20.0, 100.0] {
                let [hh, hc, cc] = own.changed(own.time + t).variance;
                assert!(hh <= most && hc * hc <= hh * cc * (1.0 + 1e-12), "{most} {t}");
            }
        }
    }

    fn rounded(height: f64) -> f64 {
        (height / STEP).round() * STEP
    }

    fn level(period: f64) -> Vertical {
        let mut own = Vertical::new(0.0, 5000.0);
        for k in 1..20 {
            own.correct(f64::from(k) * period, 5000.0);
        }
        own
    }

    #[test]
    fn a_new_vertical_rate_is_followed() {
        for period in [4.0, 6.0, 10.0, 12.0] {
            for rate in [-40.0, -25.0, -15.0, 15.0, 25.0, 40.0] {
                let mut own = level(period);
                let begin = own.time + 0.3 * period;
                for k in 1..=20 {
                    let time = own.time + period;
                    let height = 5000.0 + rate * (time - begin);
                    own.correct(time, rounded(height));
                    near(45.0, own.height, height);
                    if k > 3 {
                        near(4.0, own.vertical_rate, rate);
                    }
                }
            }
        }
    }

    #[test]
    fn one_wrong_height_is_left_out() {
        let own = level(4.0);
        for height in [0.0, 4300.0, 5700.0, 9000.0] {
            let mut other = own;
            other.correct(80.0, height);
            other.correct(84.0, 5000.0);
            near(1e-9, other.height, 5000.0);
            near(1e-9, other.vertical_rate, 0.0);
        }
        // a height that deviates little may be right, but the next one decides
        let mut other = own;
        other.correct(80.0, 5152.4);
        for time in [84.0, 88.0, 92.0] {
            other.correct(time, 5000.0);
        }
        near(25.0, other.height, 5000.0);
    }

    #[test]
    fn three_heights_that_agree_are_right() {
        let mut own = level(4.0);
        for (time, height) in [(80.0, 9000.0), (84.0, 9100.0)] {
            own.correct(time, height);
            near(1e-9, own.at(time).height, 5000.0);
        }
        let mut other = own;
        own.correct(88.0, 9200.0);
        near(10.0, own.height, 9200.0);
        near(3.0, own.vertical_rate, 25.0);
        // a height that contradicts the others starts the count again
        other.correct(88.0, 2000.0);
        other.correct(92.0, 9300.0);
        near(1e-9, other.at(92.0).height, 5000.0);
    }

    #[test]
    fn three_heights_at_any_constant_rate_are_right() {
        for (period, rate) in [(4.0, 160.0), (4.0, 250.0), (12.0, -250.0), (10.0, 600.0)] {
            let mut own = level(period);
            let begin = own.time;
            for k in 1..=8 {
                let height = 5000.0 + rate * period * (f64::from(k) - 0.3);
                own.correct(begin + f64::from(k) * period, rounded(height));
                if k > 3 {
                    near(60.0, own.height, height);
                    near(20.0, own.vertical_rate, rate);
                }
            }
        }
    }

    #[test]
    fn two_heights_that_agree_outvote_the_first() {
        let mut own = Vertical::new(0.0, 9000.0);
        for (time, height) in [(4.0, 5000.0), (8.0, 5030.48)] {
            own.correct(time, height);
        }
        near(20.0, own.height, 5030.48);
    }

    #[test]
    fn a_change_spreads_over_the_time_until_then() {
        // mean and covariance over all instants of the change, by numerical summation
        let own = Vertical { vertical_rate: 8.0, ..level(4.0) };
        let found = own.changed(own.time + 10.0);
        let [hh, hc, cc] = own.variance;
        let (mut mean, mut square, mut with) = (0.0, 0.0, 0.0);
        for k in 0..1000 {
            let before = 10.0 * (f64::from(k) + 0.5) / 1000.0;
            let (mean_then, after) = (own.height + 8.0 * before, 10.0 - before);
            let variance = hh + 2.0 * before * hc + before * before * cc + 400.0 * after * after;
            mean += mean_then / 1000.0;
            square += (variance + (mean_then - 5040.0).powi(2)) / 1000.0;
            with += 400.0 * after / 1000.0;
        }
        near(1e-6, found.height, mean);
        near(1e-3 * square, found.variance[0], square);
        near(1e-6, found.variance[1], with);
    }
}
