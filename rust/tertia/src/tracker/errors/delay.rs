//! Delays of reported positions that differ from target to target, as those of transponders do.
//!
//! The delay of a sensor that is common to all targets is known outside; this module has the rest, which is
//! constant for a target. As in `lean`, it is separated from the filter (Friedland 1969): beside the filter
//! are the derivative of the state with respect to the delay, and what the innovations say about the delay.
//! The latter does not depend on how much delays differ, which is estimated from all tracks: as long as it is
//! zero, tracks do not change.

use crate::tracker::motion::height_effect::Lean;
use serde::{Deserialize, Serialize};

/// Time after which a plot says a third as much about the delay of its target, s.
const MEMORY: f64 = 200.0;
/// Longest delay of a target, s.
const LONGEST: f64 = 2.0;
/// Least number of targets from which the differences are estimated, and largest standard deviation with
/// which their delays are known, s.
const FEWEST: usize = 4;
const KNOWN: f64 = 0.25;
/// Standard deviation of the error of a delay by the errors of radars, s; differences below it are not sought.
const LEAST: f64 = 0.04;
/// Number of standard errors by which the differences must exceed those that noise causes.
const SURE: f64 = 5.0;
const ROUNDS: usize = 20;

/// Delays of the reports of a sensor of positions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Delays {
    /// Delay of all targets that was taken out of the times of the reports, s.
    pub common: f64,
    /// Standard deviation of the differences between targets, s; 0 where none were found.
    pub sigma: f64,
}

/// Delay of the reports of one target by one sensor, in addition to the common one.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Delay {
    pub sensor: usize,
    /// Derivatives of the state with respect to the delay.
    pub lean: Lean,
    /// Estimate with which the state was made, s.
    pub mean: f64,
    /// Standard deviation of the delays of all targets, s; 0 where they are not found to differ.
    pub sigma: f64,
    /// Information of the innovations about the delay, 1/s², and their score about zero, 1/s.
    information: f64,
    score: f64,
    /// Whether all plots of the track so far are of this sensor, and its velocity is not known.
    pub is_first: bool,
}

impl Delay {
    pub fn new(sensor: usize, sigma: f64, is_first: bool) -> Self {
        let (lean, mean, information, score) = (Lean::default(), 0.0, 0.0, 0.0);
        Self { sensor, lean, mean, sigma, information, score, is_first }
    }

    /// Variance of the delay.
    #[inline]
    pub fn variance(&self) -> f64 {
        let prior = self.sigma * self.sigma;
        prior / (1.0 + self.information * prior)
    }

    /// Derivative of the innovation of a plot of a sensor with respect to the delay, `t` seconds after the
    /// state with this velocity.
    #[inline]
    pub fn of_plot(&self, sensor: usize, [u, v]: [f64; 2], t: f64) -> [f64; 2] {
        let [x, y] = self.lean.position(t);
        if sensor == self.sensor { [x - u, y - v] } else { [x, y] }
    }

    /// Lets `t` seconds pass.
    #[inline]
    pub fn predict(&mut self, t: f64) {
        self.lean.predict(t);
        let rest = MEMORY / (MEMORY + t);
        self.information *= rest;
        self.score *= rest;
    }

    /// Learns from an innovation: `information` about the delay, and `score` about the present estimate.
    #[inline]
    pub fn learn(&mut self, information: f64, score: f64) {
        self.information += information;
        self.score += score + information * self.mean;
    }

    /// Brings the estimate up to date; returns its change.
    pub fn update(&mut self) -> f64 {
        let before = self.mean;
        self.mean = self.score * self.variance();
        self.mean - before
    }

    /// Refers the delay to another common one, which is longer by `more`.
    pub fn refer(&mut self, more: f64) {
        self.score -= self.information * more;
        if self.sigma > 0.0 {
            self.mean -= more;
        }
    }

    /// Estimate from the innovations alone, and its variance, with `unsure` for errors of radars; none if they
    /// say too little.
    fn found(&self, unsure: f64) -> Option<[f64; 2]> {
        let is_known = self.information * KNOWN * KNOWN > 1.0;
        let value = (self.score / self.information).clamp(-LONGEST, LONGEST);
        is_known.then(|| [value, 1.0 / self.information + LEAST * LEAST + unsure])
    }
}

/// Returns the standard deviation of delays of targets, of which `before` is the last estimate; 0 unless the
/// delays that were found differ significantly. Errors of radars add the variance `unsure`. Cost O(n).
pub(in crate::tracker) fn spread<'a>(
    delays: impl Iterator<Item = &'a Delay>,
    unsure: f64,
    before: f64,
) -> f64 {
    let found: Vec<[f64; 2]> = delays.filter_map(|own| own.found(unsure)).collect();
    if found.len() < FEWEST {
        return before;
    }
    if before == 0.0 && !differ(&found) {
        return 0.0;
    }
    let mut variance = LEAST * LEAST;
    for _ in 0..ROUNDS {
        let (sum, weights) = found.iter().fold((0.0, 0.0), |(sum, weights), [value, own]| {
            let weight = (variance + own).powi(-2);
            (sum + weight * (value * value - own), weights + weight)
        });
        variance = (sum / weights).max(0.0);
    }
    if variance < LEAST * LEAST { 0.0 } else { variance.sqrt() }
}

/// Whether delays differ significantly; the delay that differs most is left out.
fn differ(found: &[[f64; 2]]) -> bool {
    let mean = mean(found.iter());
    let off = |own: &&[f64; 2]| (own[0] - mean).powi(2) / own[1];
    let farthest = found.iter().max_by(|a, b| off(a).total_cmp(&off(b)));
    let others = || found.iter().filter(|own| farthest.is_some_and(|one| !std::ptr::eq(one, *own)));
    let (mean, free) = (self::mean(others()), found.len() as f64 - 2.0);
    let sum: f64 = others().map(|own| (own[0] - mean).powi(2) / own[1]).sum();
    sum > free + SURE * (2.0 * free).sqrt()
}

/// Weighted mean of estimates with their variances.
fn mean<'a>(found: impl Iterator<Item = &'a [f64; 2]>) -> f64 {
    let (sum, weights) = found.fold((0.0, 0.0), |(sum, weights), [value, variance]| {
        (sum + value / variance, weights + 1.0 / variance)
    });
    sum / weights
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_within;

    /// A delay that was found to be `value`, with this standard deviation.
    fn known(value: f64, sigma: f64) -> Delay {
        let mut delay = Delay::new(0, 0.0, false);
        delay.learn(1.0 / (sigma * sigma), value / (sigma * sigma));
        delay
    }

    fn spread_of(values: &[f64], unsure: f64, before: f64) -> f64 {
        let delays: Vec<Delay> = values.iter().map(|value| known(*value, 0.05)).collect();
        spread(delays.iter(), unsure, before)
    }

    #[test]
    fn delays_that_differ_are_found() {
        let values = [0.4, -0.3, 0.6, -0.5, 0.1, -0.2];
        let squares: f64 = values.iter().map(|value| value * value).sum();
        let expected = (squares / 6.0 - 0.0025 - LEAST * LEAST).sqrt();
        assert_within(1e-9, spread_of(&values, 0.0, 0.0), expected);
        // of fewer targets, from noise alone, or where radars may be wrong, nothing follows
        assert_eq!(spread_of(&values[..3], 0.0, 0.0), 0.0);
        assert_eq!(spread_of(&values.map(|value| 0.1 * value), 0.0, 0.0), 0.0);
        assert_eq!(spread_of(&values, 0.25, 0.0), 0.0);
        // one that differs may be a mistake, and a common one is that of the sensor
        assert_eq!(spread_of(&[0.0, 0.0, 0.0, 0.0, 0.9], 0.0, 0.0), 0.0);
        assert_eq!(spread_of(&[0.5; 6], 0.0, 0.0), 0.0);
        // those that were found remain until they are negligible
        assert_eq!(spread_of(&values[..3], 0.0, 0.4), 0.4);
        assert_eq!(spread_of(&[0.01; 6], 0.0, 0.4), 0.0);
    }

    #[test]
    fn a_delay_is_that_of_a_kalman_filter() {
        let mut delay = known(0.3, 0.1);
        assert_eq!((delay.update(), delay.variance()), (0.0, 0.0));
        delay.sigma = 0.2;
        assert_within(1e-12, delay.update(), 0.3 * 0.8);
        assert_within(1e-12, delay.variance(), 0.01 * 0.8);
        // an innovation of .1 about the estimate, of variance .04
        delay.learn(25.0, 25.0 * 0.1);
        let gain = 0.008 / 0.048;
        assert_within(1e-12, delay.update(), gain * 0.1);
        assert_within(1e-12, delay.variance(), 0.008 * (1.0 - gain));
        // relative to a common delay that is longer by .05
        let before = delay.mean;
        delay.refer(0.05);
        assert_within(1e-12, delay.mean, before - 0.05);
        delay.update();
        assert_within(1e-12, delay.mean, before - 0.05 * (1.0 - delay.variance() / 0.04));
    }
}
