//! Detection of noise that has grown suddenly, from the latest innovations of a radar.
//!
//! Noise is learnt slowly from blocks, and gates remove the plots that would show it. Therefore the noise of
//! a radar whose latest innovations are far too large is raised at once; only blocks lower it again. The
//! innovations that are examined together cover at least a certain part of a scan, however many targets there
//! are: among thousands of innovations, twenty successive ones are often too large by chance. Cost O(1) a
//! plot.

use crate::base::angle::median;
use serde::{Deserialize, Serialize};

/// Least number of innovations that are examined, and number of standard errors by which their mean square
/// must be too large.
const WATCHED: usize = 20;
const ERRORS: f64 = 4.5;
/// Least time that they cover, in scans.
const SCANS: f64 = 1.0 / 16.0;
/// Innovations by which their number has grown between two looks at the scans that they cover, as a share.
const MORE: usize = 16;
/// Share of them that a look leaves out of the next.
const STEP: usize = 5;
/// Number of times that show well enough which time all cover.
const SAMPLE: usize = 100;
/// Largest variance of an innovation relative to that of the noise with which it is used.
const PREDICTED: f64 = 10.0;

/// Latest innovations of a radar along one axis, in standard deviations, and their variance relative to that
/// of the noise.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Watch {
    values: Vec<(f64, f64)>,
    /// Time of each innovation, in scans.
    times: Vec<f64>,
}

impl Watch {
    /// Adds an innovation with its variance, at a time in scans. The variance was computed with the noise
    /// `used`, which may be smaller than the present noise `now`; the innovation then counts as if computed
    /// with the latter. Returns the factor by which the variance of the noise must grow, if it must; the
    /// watch then starts anew.
    pub fn see(
        &mut self,
        time: f64,
        (innovation, variance): (f64, f64),
        [used, now]: [f64; 2],
    ) -> Option<f64> {
        let noise = now * now;
        let variance = variance + (noise - used * used).max(0.0);
        if variance > PREDICTED * noise {
            return None;
        }
        self.values.push((innovation / variance.sqrt(), variance / noise));
        self.times.push(time);
        let count = self.values.len();
        let step = WATCHED * (1 + count / (MORE * WATCHED));
        if !count.is_multiple_of(step) || self.cover() < SCANS {
            return None;
        }
        let growth = self.growth();
        let seen = if growth.is_some() { count } else { count / STEP };
        self.values.drain(..seen);
        self.times.drain(..seen);
        growth
    }

    /// Time in scans that the innovations cover; they are not exactly in order of time. Cost O(1).
    fn cover(&self) -> f64 {
        let every = 1 + self.times.len() / SAMPLE;
        let mut times: Vec<f64> = self.times.iter().step_by(every).copied().collect();
        let middle = median(&mut times);
        times.iter_mut().for_each(|time| *time = (*time - middle).abs());
        4.0 * median(&mut times)
    }

    /// Returns the factor by which the variance of the noise must grow, if it must.
    fn growth(&self) -> Option<f64> {
        // quick test: squares about the mean are at least half of those about the median
        let count = self.values.len() as f64;
        let add = |(sum, squares): (f64, f64), (value, _): &(f64, f64)| {
            (sum + value, squares + value * value)
        };
        let (sum, squares) = self.values.iter().fold((0.0, 0.0), add);
        if 2.0 * (squares - sum * sum / count) < (count - 1.0) * most() {
            return None;
        }
        let mut values: Vec<f64> = self.values.iter().map(|(value, _)| *value).collect();
        let middle = median(&mut values);
        let squares = values.iter().map(|value| (value - middle).powi(2));
        let (sum, largest) =
            squares.fold((0.0, 0.0_f64), |(sum, most), one| (sum + one, most.max(one)));
        let mean = (sum - largest) / (count - 1.0);
        let share = self.values.iter().map(|(_, share)| share).sum::<f64>() / count;
        (mean > most()).then_some(1.0 + (mean - 1.0) * share)
    }
}

/// Largest mean square with which the noise has not grown.
fn most() -> f64 {
    1.0 + ERRORS * (2.0 / WATCHED as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grown(scale: f64) -> Option<f64> {
        let mut watch = Watch::default();
        let values = [0.3, -1.1, 0.8, -0.2, 1.5, -0.7, 0.1, -1.4, 0.6, 1.0];
        let found = |(i, value): (usize, &f64)| (0.01 * i as f64, (scale * value, 2.0));
        let found = values.iter().cycle().enumerate().take(60).map(found);
        found.into_iter().find_map(|(time, value)| watch.see(time, value, [1.0; 2]))
    }

    #[test]
    fn a_few_among_thousands_in_a_scan_are_too_large_by_chance() {
        let raised = |spare: usize| {
            let mut watch = Watch::default();
            (0..4000).any(|i| {
                let sign = if i % 2 == 0 { 1.0 } else { -1.0 };
                let size = if i % 200 < spare { 5.0 } else { 1.0 };
                watch.see(i as f64 / 4000.0, (sign * size, 1.0), [1.0; 2]).is_some()
            })
        };
        assert!(!raised(8) && raised(20) && raised(200));
    }

    #[test]
    fn noise_that_is_as_stated() {
        assert_eq!(grown(1.0), None);
        assert_eq!(grown(2.0), None);
    }

    #[test]
    fn plots_of_the_scan_that_raised_the_noise_raise_it_no_more() {
        let mut watch = Watch::default();
        let (mut noise, mut raised) = (1.0_f64, 0);
        for i in 0..400 {
            // noise of 5 where 1 was used
            let innovation = if i % 2 == 0 { 5.0 } else { -5.0 };
            if let Some(growth) = watch.see(0.01 * f64::from(i), (innovation, 1.2), [1.0, noise]) {
                noise *= growth.sqrt();
                raised += 1;
            }
        }
        assert!((1..=2).contains(&raised) && (3.0..6.0).contains(&noise), "{raised} {noise}");
    }

    #[test]
    fn innovations_of_uncertain_predictions_say_nothing() {
        let mut watch = Watch::default();
        let value = |i: i32| (0.01 * f64::from(i), (f64::from(i % 2) * 99.0, 20.0));
        let raised = (0..60).map(value).any(|(time, own)| watch.see(time, own, [1.0; 2]).is_some());
        assert!(!raised);
    }

    #[test]
    fn noise_that_has_grown() {
        // about the median .2, without the largest, 1.6: 17.6 less 2.56 in 20, with variance 2
        let growth = grown(3.0).unwrap();
        let values = [0.3, -1.1, 0.8, -0.2, 1.5, -0.7, 0.1, -1.4, 0.6, 1.0_f64];
        let sum: f64 = values.iter().map(|v| 2.0 * (v - 0.2).powi(2)).sum();
        let mean = 4.5 * (sum - 1.6_f64.powi(2)) / 19.0;
        assert!((growth - (1.0 + 2.0 * (mean - 1.0))).abs() < 1e-12);
    }
}
