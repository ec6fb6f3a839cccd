//! Steps to which recorded ranges, azimuths and coordinates were rounded.
//!
//! Differences of rounded values are multiples of one step. It is their greatest common divisor, found by Euclid's
//! algorithm with a tolerance, since values in decimals are not exact. Differences between successive plots of slow
//! targets do not show such errors.

use serde::{Deserialize, Serialize};

/// Number of values from which a step is sought, number of different ones that are needed, and number of values
/// after which no more are awaited.
const VALUES: u32 = 128;
const DIFFERENT: usize = 6;
const LAST: u32 = 4096;
/// Largest step, in sigmas: farther apart are simulated targets at regular places, not rounded values.
const LARGEST: f64 = 50.0;
/// Distance within which values are equal, in sigmas, and largest distance of a value from a multiple of the step,
/// in steps.
const EQUAL: f64 = 1e-6;
const NEAR: f64 = 0.1;
/// Number of values over which the share of those beside multiples is taken, and the share above which values are
/// not rounded.
const REMEMBERED: f64 = 100.0;
const BESIDE: f64 = 0.2;
/// Largest number of divisors that are tried.
const ROUNDS: usize = 20;

/// Ranges and azimuths of a radar, or coordinates of reported positions.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Values {
    each: [Rounding; 2],
    are_coordinates: bool,
}

impl Values {
    /// Learns from range and azimuth of a plot, whose standard deviations are stated. Cost O(1).
    #[inline]
    pub fn saw(&mut self, values: [f64; 2], sigmas: [f64; 2]) {
        self.each[0].saw(values[0], sigmas[0]);
        self.each[1].saw(values[1], sigmas[1]);
    }

    /// The same for coordinates.
    pub fn saw_coordinates(&mut self, values: [f64; 2], sigmas: [f64; 2]) {
        self.are_coordinates = true;
        self.saw(values, sigmas);
    }

    /// Whether more values may change what is known.
    pub fn may_be_rounded(&self) -> bool {
        self.each.iter().any(Rounding::is_open)
    }

    /// Variances of the errors by which values are rounded; 0 if they are not.
    pub fn variances(&self) -> [f64; 2] {
        [self.each[0].variance(), self.each[1].variance()]
    }

    /// Returns the `assumed` standard deviations of range and azimuth together with the errors of rounded values.
    pub fn recorded(&self, assumed: [f64; 2]) -> [f64; 2] {
        let rounded = if self.are_coordinates { [0.0; 2] } else { self.variances() };
        let both = |i: usize| (assumed[i] * assumed[i] + rounded[i]).sqrt();
        [0, 1].map(|i| if rounded[i] > 0.0 { both(i) } else { assumed[i] })
    }
}

/// Values of one quantity.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Rounding {
    /// Different values, in order, before a step is sought.
    values: Vec<f64>,
    count: u32,
    is_sought: bool,
    /// The step, 0 if there is none; one of the values; share of those beside multiples.
    step: f64,
    origin: f64,
    beside: f64,
}

impl Rounding {
    /// Learns from a value, whose standard deviation is stated: smaller steps do not matter.
    fn saw(&mut self, value: f64, sigma: f64) {
        if !self.is_sought {
            self.collect(value, sigma);
        } else if self.step > 0.0 {
            let steps = (value - self.origin) / self.step;
            let is_beside = (steps - steps.round()).abs() > NEAR;
            self.beside += (f64::from(u8::from(is_beside)) - self.beside) / REMEMBERED;
            if self.beside > BESIDE {
                self.step = 0.0;
            }
        }
    }

    fn collect(&mut self, value: f64, sigma: f64) {
        let at = self.values.partition_point(|own| *own < value - EQUAL * sigma);
        if self.values.get(at).is_none_or(|own| *own > value + EQUAL * sigma) {
            self.values.insert(at, value);
        }
        self.count += 1;
        let is_enough = self.count >= VALUES && self.values.len() >= DIFFERENT;
        if is_enough || self.count >= LAST {
            (self.is_sought, self.origin) = (true, value);
            let step = if is_enough { step_of(&self.values, sigma) } else { 0.0 };
            self.step = if step <= LARGEST * sigma { step } else { 0.0 };
            self.values = Vec::new();
        }
    }

    fn is_open(&self) -> bool {
        !self.is_sought || self.step > 0.0
    }

    fn variance(&self) -> f64 {
        self.step * self.step / 12.0
    }
}

/// The step, at least as large as `least`, of which all differences of these increasing values are multiples; 0 if
/// there is none. Small differences come first, so that the step is known well enough for large ones.
fn step_of(values: &[f64], least: f64) -> f64 {
    let mut differences: Vec<f64> = values.windows(2).map(|pair| pair[1] - pair[0]).collect();
    differences.sort_by(f64::total_cmp);
    differences.extend(values[1..].iter().map(|value| value - values[0]));
    let mut first = differences[0];
    for _ in 0..ROUNDS {
        if first < least {
            break;
        }
        let (mut step, mut sums, mut rest) = (first, [0.0; 2], 0.0);
        for difference in &differences {
            let steps = (difference / step).round();
            rest = (difference - steps * step).abs();
            if rest > NEAR * step {
                break;
            }
            sums = [sums[0] + steps * difference, sums[1] + steps * steps];
            (step, rest) = (sums[0] / sums[1], 0.0);
        }
        if rest == 0.0 {
            return step;
        }
        first = rest;
    }
    0.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_within;
    use crate::base::random::Random;

    /// What is found from values between 0 and 60 000 that are recorded in this way.
    fn found(recorded: impl Fn(f64) -> f64) -> Rounding {
        let (mut found, mut random) = (Rounding::default(), Random::new(3));
        (0..1000).for_each(|_| found.saw(recorded(6e4 * random.uniform()), 30.0));
        found
    }

    #[test]
    fn steps_are_found_and_nothing_where_values_are_not_rounded() {
        let step = 1852.0 / 16.0;
        assert_within(1e-6, found(|x| (x / step).round() * step).step, step);
        // once more in whole metres, with an offset
        assert_within(1e-2, found(|x| ((x / step).round() * step + 40.0).round()).step, step);
        assert_within(1e-6, found(|x| (x / 50.0).floor() * 50.0).variance(), 2500.0 / 12.0);
        for other in [found(|x| x), found(f64::round), found(|x| x.sqrt().round().powi(2))] {
            assert!(other.variance() == 0.0 && !other.is_open());
        }
    }

    #[test]
    fn few_different_values_show_a_step_and_others_end_it() {
        let mut found = Rounding::default();
        for i in 0..200 {
            found.saw(f64::from(i / 20) * 75.0 + 1000.0, 10.0);
        }
        assert_within(1e-9, found.step, 75.0);
        (0..100).for_each(|i| found.saw(f64::from(i) * 7.3, 10.0));
        assert!(!found.is_open());
    }
}
