//! Estimates a bearing from one sample by any of the methods.

use super::blocks::BlockOutput;
use super::estimate::Estimate;
use super::rules::{Known, Method};
use super::workspace::Workspace;
use super::{groups, paper, robust};
use crate::base::angle::{principal, require_period};
use crate::base::error::{
    Error, Result, require, require_correlation, require_each, require_positive, require_sample,
    require_significance,
};
use crate::base::moments::Moments;
use crate::screening::{KSigmaRule, Replacement};
use std::f64::consts::TAU;
use std::ops::RangeInclusive;

/// Range of sigmas and of rounding steps: outside, squares or their reciprocals would leave the range of a
/// double.
const SIGMAS: RangeInclusive<f64> = 1e-100..=1e100;
/// Angles with a standard deviation below this share of the period count as having a direction.
const NARROW: f64 = 1.0 / 6.0;
/// `n R²` of uniformly distributed angles exceeds this in 5 % of cases (Rayleigh's test: `−ln 0.05`).
const DIRECTED: f64 = 2.995_732_273_553_991;

/// A validated method, with period and correlation.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimator {
    method: Method,
    period: Option<f64>,
    /// Lag-one correlation of the noise; `None` if it is not given.
    correlation: Option<f64>,
}

impl Estimator {
    /// Creates an estimator of angles with this period (`None`: values do not wrap) and this lag-one
    /// correlation of the noise. If the correlation is `None`, the robust method estimates it, and the
    /// other methods assume white noise.
    ///
    /// # Errors
    /// If a parameter is outside its domain.
    pub fn try_new(method: Method, period: Option<f64>, correlation: Option<f64>) -> Result<Self> {
        if let Some(period) = period {
            require_period(period)?;
        }
        correlation.map_or(Ok(()), require_correlation)?;
        let (block_size, k) = match &method {
            Method::Mean => (2, 1.0),
            Method::KSigma(k) => (2, *k),
            Method::Paper(rule) => (rule.block_size, rule.validated()?.k),
            Method::Corrected(rule, significance) => {
                require_significance(*significance)?;
                (rule.block_size, rule.validated()?.k)
            }
            Method::Robust(rule) => {
                let holds = rule.rounding == 0.0 || SIGMAS.contains(&rule.rounding);
                let wanted = "zero or a positive number, from 1e-100 to 1e100";
                require("rounding", rule.rounding, holds, wanted)?;
                (rule.block_size, 1.0)
            }
        };
        require("block_size", block_size as f64, block_size >= 2, "at least 2")?;
        require_positive("k", k)?;
        Ok(Self { method, period, correlation })
    }

    /// Returns the number of blocks for a sample of `n`; the last block includes the remainder.
    pub fn blocks(&self, n: usize) -> usize {
        let block_size = match &self.method {
            Method::Mean | Method::KSigma(_) => return 0,
            Method::Paper(rule) | Method::Corrected(rule, _) => rule.block_size,
            Method::Robust(rule) => rule.block_size,
        };
        (n / block_size).max(1)
    }

    /// Returns the smallest number of measurements that the method accepts, with or without a `stated`
    /// sigma.
    pub fn min_count(&self, stated: bool) -> usize {
        match self.method {
            Method::Mean => 2,
            Method::KSigma(_) | Method::Paper(_) | Method::Corrected(..) => 3,
            Method::Robust(_) if stated => 1,
            Method::Robust(_) => robust::MIN_COUNT,
        }
    }

    /// Estimates the bearing of one sample. O(N); for the robust method O(N) for each EM step.
    ///
    /// ```
    /// use tertia::bearing::{BlockOutput, Estimator, Known, Method, Workspace};
    ///
    /// let estimator = Estimator::try_new(Method::Mean, Some(360.0), Some(0.0))?;
    /// let mut blocks = BlockOutput { mean: &mut [], variance: &mut [], weight: &mut [] };
    /// let (theta, mut outlier) = ([359.0, 1.0, 3.0], [false; 3]);
    /// let workspace = &mut Workspace::default();
    /// let found = estimator.estimate(&theta, Known::default(), &mut outlier, &mut blocks, workspace)?;
    /// assert!((found.value - 1.0).abs() < 1e-12);
    /// assert!((found.sigma - (4.0_f64 / 3.0).sqrt()).abs() < 1e-12);
    /// # Ok::<(), tertia::Error>(())
    /// ```
    ///
    /// # Errors
    /// If there are too few measurements, before or after outliers are excluded, a measurement is not
    /// finite, or deviations are out of range.
    ///
    /// # Panics
    /// If the lengths of `theta`, `outlier` and the arrays in `known` differ, or if a block output does
    /// not have the length that [`Estimator::blocks`] returns.
    pub fn estimate(
        &self,
        theta: &[f64],
        known: Known<'_>,
        outlier: &mut [bool],
        output: &mut BlockOutput<'_>,
        workspace: &mut Workspace,
    ) -> Result<Estimate> {
        assert_eq!(theta.len(), outlier.len());
        assert!([known.sigma, known.groups].iter().flatten().all(|k| k.len() == theta.len()));
        require_sample("theta", theta, self.min_count(known.sigma.is_some()))?;
        let wanted = "it must be a positive number, from 1e-100 to 1e100";
        require_each("sigma", known.sigma.unwrap_or(&[]), |s| SIGMAS.contains(&s), wanted)?;
        workspace.read(theta, self.period)?;
        let found = match &self.method {
            Method::Robust(rule) => {
                groups::estimate(rule, self.correlation, known, workspace, outlier).map(|found| {
                    let without = known.sigma.is_none() && self.is_undirected(workspace, outlier);
                    Estimate { sigma: found.sigma.max(self.unknown(without)), ..found }
                })
            }
            Method::Mean => mean(workspace, outlier).map(|v| self.of(v, workspace, outlier)),
            Method::KSigma(k) => {
                k_sigma(*k, workspace, outlier).map(|v| self.of(v, workspace, outlier))
            }
            Method::Paper(rule) => {
                paper::as_printed(rule, workspace, outlier).map(|v| self.of(v, workspace, outlier))
            }
            Method::Corrected(rule, significance) => {
                paper::corrected(rule, *significance, workspace, outlier)
                    .map(|v| self.of(v, workspace, outlier))
            }
        };
        let found = found.map_err(Error::about_theta)?;
        if self.blocks(theta.len()) > 0 {
            workspace.blocks.write(output);
        }
        let alone = known.groups.is_none();
        let bias_sigma =
            if alone { known.bias_sigma.unwrap_or(f64::NAN) } else { found.bias_sigma };
        let added = if alone { known.bias_sigma.unwrap_or(0.0) } else { 0.0 };
        Ok(Estimate {
            value: self.period.map_or(found.value, |period| principal(found.value, period)),
            sigma: if added > 0.0 { found.sigma.hypot(added) } else { found.sigma },
            polarity: polarity(&workspace.angle, outlier, found.value),
            bias_sigma,
            ..found
        })
    }

    /// Returns the standard deviation of a completely unknown direction if `is_unknown`, otherwise 0.
    fn unknown(&self, is_unknown: bool) -> f64 {
        self.period.filter(|_| is_unknown).map_or(0.0, |period| period / 12_f64.sqrt())
    }

    /// Whether the measurements that are kept may be noise all around, without any direction.
    fn is_undirected(&self, workspace: &mut Workspace, outlier: &[bool]) -> bool {
        let Some(period) = self.period else { return false };
        let is_wide = |m: Moments| m.variance() > (NARROW * period).powi(2);
        if !workspace.keep(outlier).is_ok_and(is_wide) {
            return false;
        }
        let kept = &workspace.scratch;
        let turns = kept.iter().map(|v| (v * TAU / period).sin_cos());
        let (sine, cosine) = turns.fold((0.0, 0.0), |(s, c), (sin, cos)| (s + sin, c + cos));
        sine * sine + cosine * cosine < DIRECTED * kept.len() as f64
    }

    /// Returns the estimate of a method other than the robust one: a given correlation increases sigma,
    /// except for the method of the paper, whose sigma remains as printed.
    fn of(
        &self,
        (value, sigma): (f64, f64),
        workspace: &mut Workspace,
        outlier: &[bool],
    ) -> Estimate {
        let correlation = match self.method {
            Method::Paper(_) => 0.0,
            _ => self.correlation.unwrap_or(0.0),
        };
        let sigma = sigma * ((1.0 + correlation) / (1.0 - correlation)).sqrt();
        let variance = workspace.keep(outlier).map_or(f64::NAN, |m| m.variance());
        Estimate {
            value,
            sigma,
            polarity: 0.0,
            pvalue: f64::NAN,
            correlation,
            effective_number: variance / (sigma * sigma),
            bias_sigma: f64::NAN,
            noise_factor: f64::NAN,
        }
    }
}

fn mean(workspace: &Workspace, outlier: &mut [bool]) -> Result<(f64, f64)> {
    outlier.fill(false);
    let moments = Moments::of("theta", &workspace.angle)?;
    Ok((moments.mean(), (moments.variance() / moments.count()).sqrt()))
}

fn k_sigma(k: f64, workspace: &mut Workspace, outlier: &mut [bool]) -> Result<(f64, f64)> {
    let Workspace { angle, cleaned, scratch, .. } = workspace;
    let rule = KSigmaRule::try_new(k, Replacement::Excluded)?;
    let summary = rule.screen(angle, outlier, cleaned, scratch)?;
    let kept = outlier.iter().filter(|&&flag| !flag).count() as f64;
    Ok((summary.mean, (summary.variance / kept).sqrt()))
}

fn polarity(angle: &[f64], outlier: &[bool], value: f64) -> f64 {
    let flagged = angle.iter().zip(outlier).filter(|(_, flag)| **flag);
    let balance: f64 = flagged.map(|(v, _)| (v - value).partial_cmp(&0.0)).map(sign).sum();
    // the sum of no values is −0
    (balance + 0.0) / angle.len() as f64
}

fn sign(ordering: Option<std::cmp::Ordering>) -> f64 {
    ordering.map_or(0.0, |o| f64::from(o as i8))
}

#[cfg(test)]
mod tests {
    use super::super::rules::{PaperRule, RobustRule, VarianceTest};
    use super::*;
    use crate::base::checks::assert_close;

    struct Outcome {
        estimate: Estimate,
        outlier: Vec<usize>,
        weight: Vec<f64>,
    }

    fn run(method: Method, period: Option<f64>, theta: &[f64]) -> Outcome {
        let estimator = Estimator::try_new(method, period, Some(0.0)).unwrap();
        let mut outlier = vec![false; theta.len()];
        let [mut mean, mut variance, mut weight] =
            [(); 3].map(|()| vec![0.0; estimator.blocks(theta.len())]);
        let mut output =
            BlockOutput { mean: &mut mean, variance: &mut variance, weight: &mut weight };
        let estimate = estimator
            .estimate(theta, Known::default(), &mut outlier, &mut output, &mut Workspace::default())
            .unwrap();
        let outlier = (0..theta.len()).filter(|&i| outlier[i]).collect();
        Outcome { estimate, outlier, weight }
    }

    fn robust(block_size: usize) -> Method {
        Method::Robust(RobustRule { block_size, rounding: 0.0 })
    }

    const WITH_BURST: [f64; 30] = [
        10.3, 9.1, 10.8, 9.7, 10.5, 19.0, 9.4, 10.1, 11.2, 9.9, 8.8, 10.6, 14.2, 13.1, 14.9, 13.8,
        14.4, 13.5, 10.2, 9.3, 10.9, 9.8, 11.0, 9.6, 10.4, 9.2, 10.7, 10.0, 9.5, 10.1,
    ];

    #[test]
    fn the_default_leaves_out_a_point_and_a_burst() {
        let result = run(robust(5), None, &WITH_BURST);
        assert_eq!(result.outlier, [5, 12, 13, 14, 15, 16, 17]);
        assert!((result.estimate.value - 10.05).abs() < 0.02, "{:?}", result.estimate);
        assert!((result.estimate.sigma - 0.15).abs() < 0.03, "{:?}", result.estimate);
        assert_close(result.estimate.polarity, 7.0 / 30.0);
    }

    #[test]
    fn a_rounding_step_whose_square_vanishes_is_refused() {
        let of = |rounding| Method::Robust(RobustRule { block_size: 10, rounding });
        let made = |rounding| Estimator::try_new(of(rounding), None, None);
        assert!(made(1e-201).is_err() && made(1e-100).is_ok() && made(0.0).is_ok());
    }

    #[test]
    fn north_is_a_direction_like_any_other() {
        let rule = PaperRule { k: 2.5, block_size: 5, variance_test: VarianceTest::Cochran(0.05) };
        for method in [
            Method::Mean,
            Method::KSigma(2.5),
            Method::Paper(rule),
            Method::Corrected(rule, 0.05),
            robust(5),
        ] {
            let south = run(method.clone(), Some(360.0), &WITH_BURST.map(|v| v + 170.0));
            let north = run(method, Some(360.0), &WITH_BURST.map(|v| (v + 350.0) % 360.0));
            let turned = (north.estimate.value - south.estimate.value).rem_euclid(360.0);
            assert!((turned - 180.0).abs() < 1e-10);
            assert!((north.estimate.sigma / south.estimate.sigma - 1.0).abs() < 1e-10);
            assert_eq!(north.outlier, south.outlier);
        }
    }

    /// The mean of one block and the variance of another are too large; no single value is, at k = 4.
    #[test]
    fn the_paper_replaces_blocks() {
        let theta = [
            10.3, 9.6, 10.5, 9.8, 10.4, 10.1, 9.5, 10.2, 13.9, 14.3, 14.1, 13.6, 9.7, 10.0, 9.8,
            10.1, 10.0, 6.5, 13.4, 9.8, 9.9, 10.6, 9.7, 10.3,
        ];
        let rule = PaperRule { k: 4.0, block_size: 4, variance_test: VarianceTest::Cochran(0.05) };
        let result = run(Method::Paper(rule), None, &theta);
        assert_eq!(result.outlier, [8, 9, 10, 11, 16, 17, 18, 19]);
        assert_close(result.estimate.value, 9.949_805_171_303_07);
        assert_close(result.estimate.sigma, 0.105_587_824_271_096);
        assert!((result.weight.iter().sum::<f64>() - 1.0).abs() < 1e-15);
        // the variance of the block with the smallest one was copied
        assert_eq!(result.weight[4], result.weight[3]);
    }
}
