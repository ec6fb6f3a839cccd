//! The leave-one-out rule (M2)–(M4): compares each value with the mean and variance of the others.

use super::others::{MIN_COUNT, moments_of_cleaned, moments_of_kept, moments_of_others};
use super::summary::Summary;
use crate::base::error::{Result, require, require_positive, require_sample};
use crate::base::moments::Moments;

/// Smallest k for several passes that replace outliers. Below k = 2.1617, repeated passes consume the whole
/// sample.
const MIN_K_REPLACING_PASSES: f64 = 2.5;
/// Smallest k for several passes that exclude outliers. Below √3, they consume the whole sample.
const MIN_K_EXCLUDING_PASSES: f64 = 1.732_050_807_568_877_2;

/// The mean and variance with which the values of one pass are compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Statistics {
    /// Those of the sample cleaned up to the current value, as in the paper.
    Sequential,
    /// Those of the sample at the start of the pass.
    Frozen,
}

/// Direction of a sequential pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// From the first value to the last.
    Forward,
    /// From the last value to the first.
    Backward,
}

/// `N (N−2)/k² + N − 1`. The division allows k² to overflow; the lower bound of k keeps k² from being zero.
#[inline(always)]
fn room(k: f64, n: f64) -> f64 {
    const SMALLEST_K: f64 = 1e-150;
    let k = k.max(SMALLEST_K);
    n * (n - 2.0) / (k * k) + (n - 1.0)
}

/// Returns c √D of the rule `|y_i − M| > c √D`, `c = k (N−1)^(3/2) / √(N [N(N−2) + k²(N−1)])`.
#[inline(always)]
pub(super) fn threshold(k: f64, moments: &Moments) -> f64 {
    let n = moments.count();
    (n - 1.0) * (moments.sum_of_squares() / (n * room(k, n))).sqrt()
}

/// The leave-one-out rule with its treatment of outliers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LeaveOneOutRule {
    k: f64,
    statistics: Statistics,
    direction: Direction,
    replace: bool,
    passes: usize,
}

impl LeaveOneOutRule {
    /// Creates a rule that flags y_i if `|M'_i − y_i| > k √D'_i` and replaces it by M'_i or,
    /// without `replace`, excludes it.
    ///
    /// # Errors
    /// If k ≤ 0, if there is no pass, or for several passes with a k at which they would consume the
    /// whole sample.
    pub fn try_new(
        k: f64,
        statistics: Statistics,
        direction: Direction,
        replace: bool,
        passes: usize,
    ) -> Result<Self> {
        require_positive("k", k)?;
        require("passes", passes as f64, passes >= 1, "at least 1")?;
        if passes > 1 && replace {
            let holds = k >= MIN_K_REPLACING_PASSES;
            require("k", k, holds, "at least 2.5 with passes > 1 and replace=True")?;
        } else if passes > 1 {
            let holds = k >= MIN_K_EXCLUDING_PASSES;
            require("k", k, holds, "at least 1.7321 (√3) with passes > 1 and replace=False")?;
        }
        Ok(Self { k, statistics, direction, replace, passes })
    }

    /// Screens `y`: flags outliers and writes the cleaned sample (nan for excluded values).
    /// O(N) per pass; each of the few values that dominate the sum of squares costs an additional O(N).
    ///
    /// # Errors
    /// Fewer than 3 values, a value that is not finite, deviations out of range, or fewer than 2
    /// values left.
    ///
    /// # Panics
    /// If the slices differ in length.
    pub fn screen(
        &self,
        y: &[f64],
        outlier: &mut [bool],
        cleaned: &mut [f64],
        scratch: &mut Vec<f64>,
    ) -> Result<Summary> {
        assert_eq!(y.len(), outlier.len());
        require_sample("y", y, MIN_COUNT)?;
        cleaned.copy_from_slice(y);
        outlier.fill(false);
        let mut moments = Moments::of("y", y)?;
        let mut band = threshold(self.k, &moments);
        for _ in 0..self.passes {
            band = threshold(self.k, &moments);
            let found = match self.statistics {
                Statistics::Frozen => self.frozen_pass(&moments, outlier, cleaned, scratch)?,
                Statistics::Sequential => {
                    self.sequential_pass(moments, outlier, cleaned, scratch)?
                }
            };
            if !found {
                break;
            }
            moments = moments_of_cleaned(cleaned, scratch)?;
            if self.statistics == Statistics::Sequential {
                band = threshold(self.k, &moments);
            }
            if moments.count() < MIN_COUNT as f64 {
                break;
            }
        }
        Ok(Summary::of_moments(&moments, band))
    }

    fn frozen_pass(
        &self,
        moments: &Moments,
        outlier: &mut [bool],
        cleaned: &mut [f64],
        scratch: &mut Vec<f64>,
    ) -> Result<bool> {
        let half_width = threshold(self.k, moments);
        let mut replacements = Vec::new();
        for (i, &v) in cleaned.iter().enumerate() {
            if moments.is_beyond(v, half_width) {
                let others = moments_of_others(cleaned, i, moments, scratch)?;
                replacements.push((i, if self.replace { others.mean() } else { f64::NAN }));
            }
        }
        for &(i, value) in &replacements {
            outlier[i] = true;
            cleaned[i] = value;
        }
        Ok(!replacements.is_empty())
    }

    /// A flagged value changes the statistics to exactly M ← M'_i, SS ← SS'_i. Between two flagged values,
    /// the pass is therefore a search for the next value outside a fixed band.
    fn sequential_pass(
        &self,
        mut moments: Moments,
        outlier: &mut [bool],
        cleaned: &mut [f64],
        scratch: &mut Vec<f64>,
    ) -> Result<bool> {
        let mut reference = moments.sum_of_squares();
        let mut found = false;
        let mut open = 0..cleaned.len();
        while moments.count() >= MIN_COUNT as f64 {
            let half_width = threshold(self.k, &moments);
            let Some(i) = self.next_beyond(&moments, half_width, cleaned, open.clone()) else {
                break;
            };
            let mut others = moments_of_others(cleaned, i, &moments, scratch)?;
            cleaned[i] = f64::NAN;
            if others.sum_of_squares() < 0.5 * reference {
                // many small downdates have cancelled digits: compute the moments again
                others = moments_of_kept(cleaned, scratch)?;
                reference = others.sum_of_squares();
            }
            moments = others;
            if self.replace {
                cleaned[i] = others.mean();
                moments = others.with_one_at_mean();
            }
            outlier[i] = true;
            found = true;
            match self.direction {
                Direction::Forward => open.start = i + 1,
                Direction::Backward => open.end = i,
            }
        }
        Ok(found)
    }

    fn next_beyond(
        &self,
        moments: &Moments,
        half_width: f64,
        y: &[f64],
        open: std::ops::Range<usize>,
    ) -> Option<usize> {
        let beyond = |v: &f64| moments.is_beyond(*v, half_width);
        let start = open.start;
        let y = &y[open];
        let found = match self.direction {
            Direction::Forward => y.iter().position(beyond),
            Direction::Backward => y.iter().rposition(beyond),
        };
        found.map(|i| start + i)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_close;
    use crate::base::random::noise;

    const SAMPLE: [f64; 10] = [12.4, 11.8, 40.0, 12.1, 12.9, 11.5, 20.0, 12.2, 12.0, 11.9];

    fn screen(rule: LeaveOneOutRule) -> (Vec<usize>, Vec<f64>, Summary) {
        let (mut outlier, mut cleaned) = ([false; 10], vec![0.0; 10]);
        let summary = rule.screen(&SAMPLE, &mut outlier, &mut cleaned, &mut Vec::new()).unwrap();
        ((0..10).filter(|&i| outlier[i]).collect(), cleaned, summary)
    }

    fn rule(statistics: Statistics, direction: Direction, replace: bool) -> LeaveOneOutRule {
        LeaveOneOutRule::try_new(2.5, statistics, direction, replace, 1).unwrap()
    }

    #[test]
    fn direction_and_statistics_decide_what_is_found() {
        let (found, cleaned, summary) =
            screen(rule(Statistics::Sequential, Direction::Forward, true));
        assert_eq!(found, [2, 6]);
        assert_close(cleaned[6], 12.197_530_864_197_53);
        assert_close(summary.variance, 0.213_875_933_546_715);
        let (found, ..) = screen(rule(Statistics::Sequential, Direction::Backward, true));
        assert_eq!(found, [2]);
        let (found, cleaned, _) = screen(rule(Statistics::Frozen, Direction::Forward, true));
        assert_eq!(found, [2]);
        assert_close(cleaned[2], 116.8 / 9.0);
        let (found, cleaned, _) = screen(rule(Statistics::Sequential, Direction::Forward, false));
        assert!(found == [2, 6] && cleaned[2].is_nan() && cleaned[6].is_nan());
    }

    #[test]
    fn threshold_coefficients() {
        for (k, n, c) in [
            (2.5, 10, 1.828_670_745_992_21),
            (2.5, 100, 2.412_598_158_422_82),
            (2.2, 20, 1.916_408_482_272_67),
            (3.0, 100, 2.858_017_487_759_74),
            (2.5, 5, std::f64::consts::SQRT_2),
        ] {
            let y: Vec<f64> = (0..n).map(noise).collect();
            let moments = Moments::of("y", &y).unwrap();
            assert_close(threshold(k, &moments) / moments.variance().sqrt(), c);
        }
    }
}
