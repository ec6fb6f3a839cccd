//! Groups of measurements, each with its own systematic error: stops, hours or sectors, for example.

use super::estimate::Estimate;
use super::hypotheses::Hypotheses;
use super::robust::{self, SIGNIFICANCE};
use super::rules::{Known, RobustRule};
use super::start::{OUTSIDE, rounding_sigma, start};
use super::stated::{self, Stated};
use super::workspace::Workspace;
use crate::base::angle::median;
use crate::base::autoregression::Autoregression;
use crate::base::distribution::{
    chi_square_upper, chi_square_upper_quantile, student_two_sided_quantile,
};
use crate::base::effects::random_effects;
use crate::base::error::Result;
use crate::base::moments::Moments;

/// Number of rounds in which the centres of groups and the errors about them are found in turn.
const ROUNDS: usize = 2;
/// Smallest number of measurements, in groups of two or more, for the hypotheses about their errors.
const FEWEST: usize = 5;
/// Smallest sigma of a group, relative to the range of the groups' centres.
const LEAST: f64 = 1e-3;

/// Groups: centre, expected number of good measurements, and number of all measurements.
#[derive(Clone, Debug, Default)]
struct Table {
    centre: Vec<f64>,
    good: Vec<f64>,
    count: Vec<f64>,
}

/// Screens the errors within all groups together. The means of the groups, `m_g ± σ/√n_g`, have random
/// effects with the standard deviation `bias_sigma`, which is estimated if it is `None`
/// ([`random_effects`]).
pub(super) fn estimate(
    rule: &RobustRule,
    correlation: Option<f64>,
    Known { sigma: stated, groups, bias_sigma }: Known<'_>,
    workspace: &mut Workspace,
    outlier: &mut [bool],
) -> Result<Estimate> {
    let Some(groups) = groups else {
        return together(rule, correlation, stated, workspace, outlier);
    };
    Moments::of("theta", &workspace.angle)?;
    let mut table = Table::of(&workspace.angle, groups);
    let count = table.count.len();
    let stuck = stated.is_none() && workspace.angle.iter().all(|v| *v == workspace.angle[0]);
    // if each measurement has its own systematic error, these errors are random errors; they can be told from
    // those whose size is stated
    let each = count == groups.len() && stated.is_none();
    if count == 1 || stuck || each {
        let correlation = if each { Some(0.0) } else { correlation };
        let found = together(rule, correlation, stated, workspace, outlier)?;
        let bias = bias_sigma.unwrap_or(0.0) / if each { (count as f64).sqrt() } else { 1.0 };
        let bias_sigma = bias_sigma.unwrap_or(if each { 0.0 } else { f64::NAN });
        return Ok(Estimate { sigma: found.sigma.hypot(bias), bias_sigma, ..found });
    }
    let (within, mut sigma) = match stated {
        Some(sigma) => {
            let found = Stated::of(rule, correlation, &workspace.angle, sigma, Some(groups))?;
            table.take(&found, outlier)
        }
        None => {
            let within = table.screen(rule, correlation, groups, workspace, outlier)?;
            let sigma = table.good.iter().map(|&n| within.of_mean(n)).collect();
            (within, sigma)
        }
    };
    let Workspace { angle, scratch, blocks, .. } = workspace;
    let spread = table.spread();
    for sigma in &mut sigma {
        *sigma = sigma.max(LEAST * spread).max(f64::MIN_POSITIVE);
    }
    let (pvalue, given) = agreement(&table.centre, &sigma, bias_sigma.unwrap_or(0.0));
    let (value, sigma_of_value, bias) = match bias_sigma {
        None => {
            // the prior of a systematic error is as wide as the error of one measurement
            let scale = within.sigma.max(LEAST * spread).max(f64::MIN_POSITIVE);
            let found = random_effects(&table.centre, &sigma, scale);
            (found.mean, found.sigma * table.inflation(groups).sqrt(), found.tau)
        }
        Some(bias) => (given.0, given.1, bias),
    };
    let (weight, _) = weights(&sigma, bias);
    scratch.clear();
    scratch.extend((0..angle.len()).map(|i| {
        let g = groups[i] as usize;
        if outlier[i] { 0.0 } else { weight[g] / table.good[g].max(1.0) }
    }));
    blocks.fill_weighted(angle, scratch, outlier, rule.block_size);
    Ok(Estimate {
        value,
        sigma: sigma_of_value.hypot(within.rounding),
        polarity: 0.0,
        pvalue,
        correlation: within.correlation,
        effective_number: (within.sigma / sigma_of_value).powi(2),
        bias_sigma: bias,
        noise_factor: within.noise_factor,
    })
}

/// Estimates the bearing from measurements without systematic errors, or with a common one.
fn together(
    rule: &RobustRule,
    correlation: Option<f64>,
    stated: Option<&[f64]>,
    workspace: &mut Workspace,
    outlier: &mut [bool],
) -> Result<Estimate> {
    match stated {
        Some(sigma) => stated::estimate(rule, correlation, sigma, workspace, outlier),
        None => robust::estimate(rule, correlation, workspace, outlier),
    }
}

/// Random errors within groups.
struct Within {
    sigma: f64,
    /// Half of the quantile of Student's distribution for two sigmas.
    student: f64,
    correlation: f64,
    rounding: f64,
    /// nan if no noise is stated.
    noise_factor: f64,
}

impl Within {
    /// Returns the standard deviation of the mean of n measurements of an AR(1) process.
    fn of_mean(&self, n: f64) -> f64 {
        let (n, phi) = (n.max(1.0), self.correlation);
        // 1 + 2 Σ (1 − j/n) φ^j over j < n
        let rest = 2.0 * phi * (1.0 - phi.abs().powf(n)) / (n * (1.0 - phi).powi(2));
        let inflation = ((1.0 + phi) / (1.0 - phi) - rest).clamp(1.0 / n, n);
        self.student * self.sigma * (inflation / n).sqrt()
    }
}

impl Table {
    fn of(y: &[f64], groups: &[f64]) -> Self {
        let count = groups.iter().copied().fold(0.0, f64::max) as usize + 1;
        let mut members = vec![Vec::new(); count];
        for (&y, &g) in y.iter().zip(groups) {
            members[g as usize].push(y);
        }
        let number: Vec<f64> = members.iter().map(|m| m.len() as f64).collect();
        let centre = members.iter_mut().map(|m| median(m)).collect();
        Self { centre, good: number.clone(), count: number }
    }

    /// Copies the results for stated noise, and marks outliers; returns the sigma of each centre.
    fn take(&mut self, found: &Stated, outlier: &mut [bool]) -> (Within, Vec<f64>) {
        found.mark(outlier);
        self.centre = found.centres.iter().map(|centre| centre.value).collect();
        self.good = found.centres.iter().map(|centre| centre.good).collect();
        let within = Within {
            sigma: found.sigma,
            student: 1.0,
            correlation: found.correlation,
            rounding: found.rounding,
            noise_factor: found.noise_factor,
        };
        (within, found.centres.iter().map(|centre| centre.sigma).collect())
    }

    /// Returns the variance of the mean of the groups relative to that with independent errors: the
    /// errors of successive groups may be correlated.
    fn inflation(&self, groups: &[f64]) -> f64 {
        let mut seen = vec![false; self.centre.len()];
        let first = |g: &&f64| !std::mem::replace(&mut seen[**g as usize], true);
        let in_order = groups.iter().filter(first).map(|&g| self.centre[g as usize]);
        let mut errors = Autoregression::default();
        errors.read(in_order.enumerate(), None);
        errors.inflation()
    }

    fn spread(&self) -> f64 {
        let range = |(l, h): (f64, f64), &c: &f64| (l.min(c), h.max(c));
        let (low, high) = self.centre.iter().fold((f64::INFINITY, f64::NEG_INFINITY), range);
        high - low
    }

    /// Finds outliers among the errors about the centres of the groups, and the errors without them.
    fn screen(
        &mut self,
        rule: &RobustRule,
        correlation: Option<f64>,
        groups: &[f64],
        workspace: &mut Workspace,
        outlier: &mut [bool],
    ) -> Result<Within> {
        let Workspace { angle, scratch, hypotheses, .. } = workspace;
        outlier.fill(false);
        let together: Vec<usize> =
            (0..angle.len()).filter(|&i| self.count[groups[i] as usize] > 1.0).collect();
        let mut within = Within {
            sigma: 0.0,
            student: 1.0,
            correlation: 0.0,
            rounding: rounding_sigma(rule.rounding),
            noise_factor: f64::NAN,
        };
        for _ in 0..ROUNDS {
            // n/(n−1), because the centre is estimated from the same measurements
            let error = |&i: &usize| {
                let g = groups[i] as usize;
                let n = self.good[g].max(2.0);
                (angle[i] - self.centre[g]) * (n / (n - 1.0)).sqrt()
            };
            let errors: Vec<f64> = together.iter().map(error).collect();
            Moments::of("theta", &errors)?;
            let squares: f64 = errors.iter().map(|e| e * e).sum();
            within.sigma = (squares / errors.len() as f64).sqrt();
            let found = start(&errors, rule.rounding, scratch);
            let (Some(found), true) = (found, errors.len() >= FEWEST) else {
                break;
            };
            hypotheses.read(&errors, &found);
            hypotheses.fit(found.step / found.scale, correlation, false);
            within.sigma = found.scale * hypotheses.mean(|h| h.width);
            within.correlation = correlation.unwrap_or_else(|| hypotheses.mean(|h| h.correlation));
            within.rounding =
                rounding_sigma(found.step) * robust::rest_of_rounding(within.sigma, found.step);
            self.recentre(angle, groups, &together, hypotheses, outlier);
        }
        let alone = angle.len() - together.len();
        let good: f64 = self.good.iter().sum::<f64>() - alone as f64;
        let groups = self.count.iter().filter(|&&n| n > 1.0).count();
        let degrees = (good - groups as f64).max(1.0);
        within.student = 0.5 * student_two_sided_quantile(OUTSIDE, degrees);
        Ok(within)
    }

    fn recentre(
        &mut self,
        angle: &[f64],
        groups: &[f64],
        together: &[usize],
        hypotheses: &Hypotheses,
        outlier: &mut [bool],
    ) {
        let mut good = vec![0.0; self.count.len()];
        let mut sum = vec![0.0; self.count.len()];
        for (k, &i) in together.iter().enumerate() {
            let g = groups[i] as usize;
            let share = hypotheses.mean(|h| h.is_good(k));
            outlier[i] = share < 0.5;
            good[g] += share;
            sum[g] += share * (angle[i] - self.centre[g]);
        }
        for g in (0..good.len()).filter(|&g| self.count[g] > 1.0) {
            if good[g] >= 1.0 {
                self.centre[g] += sum[g] / good[g];
                self.good[g] = good[g];
            } else {
                // no good measurement is left: the median counts as one measurement
                self.good[g] = 1.0;
            }
        }
    }
}

/// Returns the weights of the means of the groups, which sum to one, and the standard deviation of their
/// weighted mean. The variance of each mean includes that of the systematic errors, which may be infinite.
fn weights(sigma: &[f64], bias: f64) -> (Vec<f64>, f64) {
    let width: Vec<f64> = sigma.iter().map(|s| s.hypot(bias)).collect();
    let least = width.iter().copied().fold(f64::INFINITY, f64::min);
    // relative to the largest one, because the square of a large width is infinite
    let share = |w: &f64| if least.is_finite() { (least / w).powi(2) } else { 1.0 };
    let total: f64 = width.iter().map(share).sum();
    (width.iter().map(|w| share(w) / total).collect(), least / total.sqrt())
}

/// Returns the p-value of the agreement of the means of the groups with systematic errors of this size,
/// and their weighted mean with its sigma, which is increased if they disagree at 5 %.
fn agreement(x: &[f64], sigma: &[f64], bias: f64) -> (f64, (f64, f64)) {
    let (weight, deviation) = weights(sigma, bias);
    let mean = x[0] + x.iter().zip(&weight).map(|(x_k, w)| w * (x_k - x[0])).sum::<f64>();
    if bias.is_infinite() {
        return (f64::NAN, (mean, f64::INFINITY));
    }
    let q: f64 = x.iter().zip(&weight).map(|(x, w)| w * ((x - mean) / deviation).powi(2)).sum();
    let pvalue = chi_square_upper(q, x.len() - 1);
    let limit = if pvalue < SIGNIFICANCE {
        q / chi_square_upper_quantile(SIGNIFICANCE, x.len() - 1)
    } else {
        1.0
    };
    (pvalue, (mean, deviation * limit.sqrt()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::{assert_all_close, assert_close};

    #[test]
    fn the_weights_include_the_variance_of_the_systematic_errors() {
        let (weight, deviation) = weights(&[3.0, 4.0, 12.0], 4.0);
        let information = [1.0 / 25.0, 1.0 / 32.0, 1.0 / 160.0];
        let total: f64 = information.iter().sum();
        assert_all_close(&weight, &information.map(|i| i / total));
        assert_close(deviation, total.sqrt().recip());
    }

    #[test]
    fn groups_count_alike_beside_errors_without_bound() {
        for bias in [1e200, f64::INFINITY] {
            let (weight, deviation) = weights(&[1.0, 2.0, 3.0, 4.0], bias);
            assert_eq!((weight, deviation), (vec![0.25; 4], 0.5 * bias));
            let (_, (mean, sigma)) = agreement(&[5.0, 7.0, 8.0, 10.0], &[1.0; 4], bias);
            assert_eq!((mean, sigma), (7.5, 0.5 * bias));
        }
    }
}
