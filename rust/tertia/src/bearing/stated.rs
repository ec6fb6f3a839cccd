//! Records with stated noise, that is the standard deviation of each measurement; a single measurement
//! is sufficient.
//!
//! With the noise factor f, a measurement with the stated sigma σ is good, `N(y; μ, f² σ²)`, or bad and
//! anywhere within ±20 f m, where m is the median of the stated sigmas. The likelihood of μ has a mode
//! wherever measurements agree. The bearing is the mean over the modes, and its variance includes their
//! distances: if two measurements contradict each other, it is not known which one is bad.

use super::estimate::Estimate;
use super::maxima::{FARTHEST, Fit, Sample};
use super::robust::rest_of_rounding;
use super::rules::RobustRule;
use super::start::{MAD_TO_SIGMA, different, rounding_sigma, step_within};
use super::workspace::Workspace;
use crate::base::angle::median;
use crate::base::autoregression::Autoregression;
use crate::base::distribution::{chi_square_upper_real, fisher_upper, normal_two_sided};
use crate::base::error::Result;
use crate::base::moments::Moments;

/// The stated sigma contains as much information about the noise as a scatter with this number of
/// degrees of freedom.
const STATED_FREEDOM: f64 = 5.0;
/// Degrees of freedom of the scatter from which on a first noise factor, before outliers are known, and
/// a correlation are estimated.
const FEWEST: f64 = 4.0;
/// Largest difference that is taken as a rounding step, in sigmas; the same if more measurements are equal
/// than by finer steps.
const LARGEST_STEP: f64 = 4.0;
const LARGEST_SURE_STEP: f64 = 10.0;
/// Probability below which a step does not explain how many measurements are equal.
const UNLIKELY: f64 = 0.05;
/// Error of a multiple of a decimal step, in steps.
const SAME_DIGITS: f64 = 1e-6;
/// Limit of the probability to be good, below which a measurement is an outlier: of two measurements
/// that contradict each other, neither is marked, even if their sigmas differ.
const EVEN: f64 = 0.45;
/// Largest number of rounds in which centres and noise factor are found in turn.
const ROUNDS: usize = 4;
/// Relative change of the noise factor below which the rounds end.
const LEAST_CHANGE: f64 = 0.01;

/// Centre of the measurements with one systematic error.
pub(super) struct Centre {
    pub value: f64,
    pub sigma: f64,
    /// Expected number of good measurements.
    pub good: f64,
}

/// Results for all measurements.
pub(super) struct Stated {
    pub centres: Vec<Centre>,
    /// Probability that each measurement is good, and its weight in its centre.
    pub good: Vec<f64>,
    pub influence: Vec<f64>,
    /// Noise divided by the stated noise, at least 1, and p-value of the scatter if the noise is as
    /// stated.
    pub noise_factor: f64,
    pub pvalue: f64,
    /// Standard deviation of a measurement if all had the same: the square root of the harmonic mean of
    /// the variances.
    pub sigma: f64,
    pub correlation: f64,
    /// Rounding error that remains in a mean.
    pub rounding: f64,
}

/// Returns the robust estimate for the given `sigma` of each measurement. O(N) for each mode and EM
/// step.
pub(super) fn estimate(
    rule: &RobustRule,
    correlation: Option<f64>,
    sigma: &[f64],
    workspace: &mut Workspace,
    outlier: &mut [bool],
) -> Result<Estimate> {
    let Workspace { angle, blocks, .. } = workspace;
    let found = Stated::of(rule, correlation, angle, sigma, None)?;
    found.mark(outlier);
    blocks.fill_weighted(angle, &found.influence, outlier, rule.block_size);
    let centre = &found.centres[0];
    let sigma = centre.sigma.hypot(found.rounding);
    Ok(Estimate {
        value: centre.value,
        sigma,
        polarity: 0.0,
        pvalue: found.pvalue,
        correlation: found.correlation,
        effective_number: (found.sigma / sigma).powi(2),
        bias_sigma: f64::NAN,
        noise_factor: found.noise_factor,
    })
}

impl Stated {
    /// Marks measurements that are more probably bad than good.
    pub fn mark(&self, outlier: &mut [bool]) {
        for (flag, &good) in outlier.iter_mut().zip(&self.good) {
            *flag = good < EVEN;
        }
    }

    /// Finds the centre of each group and what the groups have in common. Groups are numbered from 0;
    /// `None` is a single group.
    pub fn of(
        rule: &RobustRule,
        correlation: Option<f64>,
        y: &[f64],
        sigma: &[f64],
        groups: Option<&[f64]>,
    ) -> Result<Self> {
        Moments::of("theta", y)?;
        let step = if rule.rounding > 0.0 { rule.rounding } else { seen_step(y, sigma) };
        let rounding = rounding_sigma(step);
        let noise: Vec<f64> = sigma.iter().map(|s| s.hypot(rounding)).collect();
        let samples = Sample::by_group(y, &noise, groups);
        let (noise_factor, fits) = fit(&samples);
        let pvalue = match scatter(&fits) {
            (_, freedom) if freedom < 0.5 => f64::NAN,
            (squares, freedom) => chi_square_upper_real(squares, freedom),
        };
        let mut found = Self {
            centres: Vec::new(),
            good: vec![0.0; y.len()],
            influence: vec![0.0; y.len()],
            noise_factor,
            pvalue,
            sigma: noise_factor * harmonic(&noise),
            correlation: 0.0,
            rounding: 0.0,
        };
        found.rounding = rounding * rest_of_rounding(found.sigma, step);
        for (sample, fit) in samples.iter().zip(&fits) {
            for (k, &i) in sample.place.iter().enumerate() {
                (found.good[i], found.influence[i]) = (fit.good[k], fit.influence[k]);
            }
        }
        found.correlation =
            correlation.unwrap_or_else(|| correlation_of(&samples, &fits, &found.good));
        let most = if correlation.is_some() { 0.0 } else { 1.0 };
        found.centres.extend(samples.iter().zip(&fits).map(|(sample, fit)| {
            let inflation = sample.inflation(&fit.good, found.correlation).max(most);
            let sigma = (fit.within * inflation + fit.between).sqrt();
            Centre { value: fit.value, sigma, good: fit.good.iter().sum() }
        }));
        Ok(found)
    }
}

/// Returns the rounding step of measurements some of which are equal, 0 if none are. With steps of more
/// than a few sigmas, noise of the stated size would make all readings equal, so a larger gap is not a
/// rounding step, unless more measurements are equal than finer steps would make. All may then be equal, but
/// their digits show the step if it is one of 1, 10, 0.1 ...: the one from one to ten sigmas is assumed.
fn seen_step(y: &[f64], sigma: &[f64]) -> f64 {
    let mut sorted = y.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    let noise = harmonic(sigma);
    let step = step_within(&sorted, LARGEST_STEP * noise);
    let decimal = 10_f64.powf(noise.log10().ceil());
    let explains =
        |step: f64| chance_of_equal(different(&sorted), y.len(), step / noise) > UNLIKELY;
    if step > 0.0 || explains(0.1 * decimal) {
        return step;
    }
    let is_multiple = |v: &f64| ((v / decimal).round() - v / decimal).abs() < SAME_DIGITS;
    if explains(decimal) && sorted.iter().all(is_multiple) {
        return decimal;
    }
    step_within(&sorted, LARGEST_SURE_STEP * noise)
}

/// Returns an upper bound of the probability that no more than this number of n measurements are different,
/// for a rounding step in sigmas, and if those that differ are so by several sigmas. The sum of the binomial
/// distribution is one of Fisher's.
fn chance_of_equal(different: usize, n: usize, step: f64) -> f64 {
    let (equal, new) = ((n - different) as f64, different as f64);
    let chance = 1.0 - normal_two_sided(0.5 * step);
    if equal > 0.0 {
        fisher_upper(equal * (1.0 - chance) / (new * chance), 2.0 * new, 2.0 * equal)
    } else {
        1.0
    }
}

/// Finds centres and noise factor in turn. A sample of which nearly half is bad must not be mistaken
/// for noise, nor noise for bad measurements; therefore the first factor is that of the median
/// deviation.
fn fit(samples: &[Sample]) -> (f64, Vec<Fit>) {
    let mut factor = first_factor(samples);
    let mut fits: Vec<Fit> = samples.iter().map(|sample| sample.fit(factor)).collect();
    for _ in 1..ROUNDS {
        let (squares, freedom) = scatter(&fits);
        let next = grown(squares, freedom);
        if (next / factor - 1.0).abs() < LEAST_CHANGE {
            break;
        }
        factor = next;
        fits = samples.iter().map(|sample| sample.fit(factor)).collect();
    }
    (factor, fits)
}

/// Returns the noise factor for a sum of squared residuals: the stated variance is the mean of the
/// prior, and the noise is never assumed to be smaller than stated.
fn grown(squares: f64, freedom: f64) -> f64 {
    ((STATED_FREEDOM + squares) / (STATED_FREEDOM + freedom)).max(1.0).sqrt()
}

fn scatter(fits: &[Fit]) -> (f64, f64) {
    fits.iter().fold((0.0, 0.0), |(q, n), fit| (q + fit.squares, n + fit.freedom))
}

fn first_factor(samples: &[Sample]) -> f64 {
    let count: usize = samples.iter().map(|sample| sample.y.len()).sum();
    let freedom = (count - samples.len()) as f64;
    if freedom < FEWEST {
        return 1.0;
    }
    let mut deviation = Vec::with_capacity(count);
    for Sample { y, sigma, .. } in samples {
        let middle = median(&mut y.clone());
        deviation.extend(y.iter().zip(sigma).map(|(y, s)| ((y - middle) / s).abs()));
    }
    let found = MAD_TO_SIGMA * median(&mut deviation).min(FARTHEST);
    grown(freedom * found * found, freedom)
}

/// Returns the standard deviation whose information is the mean of all.
fn harmonic(sigma: &[f64]) -> f64 {
    let information: f64 = sigma.iter().map(|s| s.powi(-2)).sum();
    (sigma.len() as f64 / information).sqrt()
}

/// Returns the correlation of successive good residuals; 0 if there are too few.
fn correlation_of(samples: &[Sample], fits: &[Fit], good: &[f64]) -> f64 {
    let mut residual = vec![0.0; good.len()];
    for (sample, fit) in samples.iter().zip(fits) {
        for (k, &i) in sample.place.iter().enumerate() {
            residual[i] = (sample.y[k] - fit.value) / sample.sigma[k];
        }
    }
    let kept: Vec<usize> = (0..good.len()).filter(|&i| good[i] > 0.5).collect();
    if (kept.len() as f64) <= FEWEST {
        return 0.0;
    }
    let mut errors = Autoregression::default();
    errors.read(kept.into_iter().map(|i| (i, residual[i])), None);
    errors.correlation()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::{assert_close, assert_within};

    fn of(y: &[f64], sigma: &[f64], correlation: f64) -> Stated {
        let rule = RobustRule { block_size: 10, rounding: 0.0 };
        Stated::of(&rule, Some(correlation), y, sigma, None).unwrap()
    }

    #[test]
    fn one_measurement_has_its_stated_sigma() {
        let found = of(&[7.0], &[2.0], 0.5);
        assert_eq!((found.centres[0].value, found.centres[0].sigma), (7.0, 2.0));
        assert_eq!((found.noise_factor, found.good[0]), (1.0, 1.0));
    }

    #[test]
    fn measurements_about_their_mean_have_it() {
        let found = of(&[-1.0, 1.0, -2.0, 2.0], &[2.0; 4], 0.0);
        assert!(found.centres[0].value.abs() < 1e-14);
    }

    #[test]
    fn two_that_contradict_each_other_count_alike() {
        let found = of(&[0.0, 30.0], &[1.0, 1.0], 0.0);
        assert_close(found.centres[0].value, 15.0);
        assert_within(0.01, found.centres[0].sigma / 15.0, 1.0);
        let mut outlier = [true; 2];
        found.mark(&mut outlier);
        assert_eq!(outlier, [false; 2]);
    }

    /// Either may be bad, however precise it says that it is.
    #[test]
    fn so_do_two_whose_sigmas_differ() {
        let found = of(&[100.0, 129.0], &[0.2, 3.0], 0.0);
        assert_within(0.003, found.centres[0].value, 114.5);
        assert_within(0.05, found.centres[0].sigma, 14.5);
        let mut outlier = [true; 2];
        found.mark(&mut outlier);
        assert_eq!(outlier, [false; 2]);
    }

    #[test]
    fn a_measurement_far_from_others_is_weighed_whether_they_are_equal_or_not() {
        for other in [100.0, 100.1, 99.9] {
            let found = of(&[100.0, other, 129.0], &[0.2, 0.2, 3.0], 0.0);
            let mean = 0.5 * (100.0 + other);
            assert_within(1e-5, found.centres[0].value, mean);
            assert_within(0.01, found.centres[0].sigma, 0.2 * 0.5_f64.sqrt());
        }
    }

    /// Each may be the good one. The slopes at the measurements do not show the maximum at the first.
    #[test]
    fn three_that_contradict_each_other_count_alike() {
        let found = of(&[100.0, 129.0, 146.0], &[3.0; 3], 0.0);
        assert_within(0.005, found.centres[0].value, 125.0);
        assert!(found.good.iter().all(|good| (good - 1.0 / 3.0).abs() < 0.02));
    }

    /// Five equal readings of 0.2 sigmas are rounded more coarsely than to 0.1, and to 1 as their digits show; two
    /// may be equal by chance.
    #[test]
    fn equal_measurements_show_their_rounding() {
        assert_eq!(seen_step(&[40.0; 5], &[0.2; 5]), 1.0);
        assert_eq!(seen_step(&[40.0, 41.0, 40.0, 40.0, 40.0, 40.0, 40.0], &[0.2; 7]), 1.0);
        assert_eq!(seen_step(&[40.5, 41.0, 40.5, 40.5, 40.5, 40.5, 40.5], &[0.1; 7]), 0.5);
        assert_eq!(seen_step(&[40.0, 41.0, 40.0, 41.0, 40.0], &[0.2; 5]), 1.0);
        assert_eq!(seen_step(&[40.0; 2], &[0.2; 2]), 0.0);
        assert_eq!(seen_step(&[40.0, 40.0, 69.0], &[0.2; 3]), 0.0);
        assert_eq!(seen_step(&[40.1, 40.2, 40.3, 40.4, 40.7], &[0.2; 5]), 0.0);
    }

    /// `1 + 2 φ (1 − 1/n) + …` of equal measurements: (3 + 4 φ + 2 φ²)/3 for three.
    #[test]
    fn a_correlation_widens_the_mean() {
        let (white, lasting) = (of(&[5.0; 3], &[1.0; 3], 0.0), of(&[5.0; 3], &[1.0; 3], 0.5));
        let ratio = (lasting.centres[0].sigma / white.centres[0].sigma).powi(2);
        assert_close(ratio, (3.0 + 4.0 * 0.5 + 2.0 * 0.25) / 3.0);
    }
}
