//! Records whose noise is stated: the standard deviation of each measurement, from one measurement on.
//!
//! With the noise factor f, a measurement of the sigma σ is good, `N(y; μ, f² σ²)`, or bad and anywhere
//! within ±20 f σ. The likelihood of μ has a mode wherever measurements agree; the bearing is the mean
//! over the modes, and its variance counts how far these are apart: two measurements that contradict
//! each other do not tell which is bad.

use super::estimate::Estimate;
use super::robust::rest_of_rounding;
use super::rules::RobustRule;
use super::start::{MAD_TO_SIGMA, rounding_sigma};
use super::workspace::Workspace;
use crate::base::angle::median;
use crate::base::autoregression::Autoregression;
use crate::base::distribution::chi_square_upper_real;
use crate::base::error::Result;
use crate::base::exponential::exp;
use crate::base::moments::Moments;
use pulp::{Simd, WithSimd};

/// Share of bad measurements.
const BAD: f64 = 0.1;
/// Where they lie, in sigmas to either side.
const REACH: f64 = 20.0;
/// The stated sigma tells as much of the noise as the scatter of this many degrees of freedom.
const STATED_FREEDOM: f64 = 5.0;
/// Degrees of freedom from which the scatter tells a noise factor before outliers are known, and a
/// correlation.
const FEWEST: f64 = 4.0;
/// Density of a bad measurement, as probable as it is, over the largest of a good one: the odds, times
/// `√(2π)`, over the whole reach.
const RATIO: f64 = BAD / (1.0 - BAD) * 2.506_628_274_631_000_5 / (2.0 * REACH);
/// Scores are cut here, so that their squares can be taken: 0 remains of the density.
const FARTHEST: f64 = 1e3;
const LANES: usize = 8;
/// Factors of a product that does not underflow.
const PRODUCTS: usize = 64;
/// Measurements from which modes are looked for, at most.
const STARTS: usize = 32;
/// Modes of less weight than this share of the largest do not count...
const LEAST_WEIGHT: f64 = 0.05;
/// ...and are not looked for where the logarithm of the likelihood is smaller by this.
const FAR_BELOW: f64 = 15.0;
/// EM ends where the centre changes by less than this share of its standard error.
const TOLERANCE: f64 = 1e-4;
const MOST_STEPS: usize = 100;
/// Modes closer than this share of their standard error are one.
const SAME: f64 = 0.3;
/// Least share of its information that a mode has in spite of doubtful measurements.
const LEAST_INFORMATION: f64 = 0.1;
/// Of two measurements that contradict each other neither is more probably bad.
const EVEN: f64 = 0.5 - 1e-6;
/// Centres and noise factor are found in turn, at most so often, and until the factor changes by less.
const ROUNDS: usize = 4;
const LEAST_CHANGE: f64 = 0.01;

/// Centre of measurements with one systematic error.
pub(super) struct Centre {
    pub value: f64,
    pub sigma: f64,
    /// Expected number of good measurements.
    pub good: f64,
}

/// What is found of all measurements.
pub(super) struct Stated {
    pub centres: Vec<Centre>,
    /// Probability of each measurement to be good, and what it counts in its centre.
    pub good: Vec<f64>,
    pub influence: Vec<f64>,
    /// Noise over what is stated, at least 1; p-value of the scatter if the noise is as stated.
    pub noise_factor: f64,
    pub pvalue: f64,
    /// Standard deviation of a measurement, if all had the same: the root of the harmonic mean.
    pub sigma: f64,
    pub correlation: f64,
    /// Error of rounding that remains in a mean.
    pub rounding: f64,
}

/// The robust estimate with the `sigma` of each measurement. O(N) for each mode and step of EM.
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

    /// Finds the centre of each group, numbered from 0 (none: all are one), and what they share.
    pub fn of(
        rule: &RobustRule,
        correlation: Option<f64>,
        y: &[f64],
        sigma: &[f64],
        groups: Option<&[f64]>,
    ) -> Result<Self> {
        Moments::of("theta", y)?;
        let rounding = rounding_sigma(rule.rounding);
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
        found.rounding = rounding * rest_of_rounding(found.sigma, rule.rounding);
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

/// Measurements of one group, and their places in the record.
#[derive(Clone, Default)]
struct Sample {
    place: Vec<usize>,
    y: Vec<f64>,
    sigma: Vec<f64>,
}

/// A maximum of the likelihood.
struct Mode {
    centre: f64,
    variance: f64,
    /// The logarithm of its share in the posterior at first, then the share.
    weight: f64,
}

/// The likelihood about a centre: its logarithm, `W = Σ g/σ²`, `Σ g (y − μ)/σ²` and
/// `Σ g (1 − g) z²/σ²`, with the probability g to be good.
struct Around {
    log_likelihood: f64,
    information: f64,
    slope: f64,
    doubt: f64,
}

/// Mean over the modes.
struct Fit {
    value: f64,
    within: f64,
    between: f64,
    good: Vec<f64>,
    influence: Vec<f64>,
    /// `Σ g z²` and `Σ g − 1` of the likeliest mode, z in stated sigmas.
    squares: f64,
    freedom: f64,
}

impl Fit {
    /// Nothing tells that a single measurement is bad.
    fn of_one(value: f64, sigma: f64) -> Self {
        let (good, influence) = (vec![1.0], vec![1.0]);
        let within = sigma * sigma;
        Self { value, within, between: 0.0, good, influence, squares: 0.0, freedom: 0.0 }
    }
}

/// Centres and noise factor in turn. A sample of which nearly half is bad must not be mistaken for
/// noise, nor noise for bad measurements: the first factor is that of the median deviation.
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

/// Noise factor of so many squares of residuals: the stated variance is the prior mean, and the noise
/// is not taken for less.
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

/// Standard deviation whose information is the mean of all.
fn harmonic(sigma: &[f64]) -> f64 {
    let information: f64 = sigma.iter().map(|s| s.powi(-2)).sum();
    (sigma.len() as f64 / information).sqrt()
}

/// Correlation of successive good residuals, 0 for too few.
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

impl Sample {
    fn by_group(y: &[f64], sigma: &[f64], groups: Option<&[f64]>) -> Vec<Self> {
        let group = |i: usize| groups.map_or(0, |groups| groups[i] as usize);
        let count = (0..y.len()).map(group).max().map_or(0, |last| last + 1);
        let mut samples = vec![Self::default(); count];
        for (i, (&y, &sigma)) in y.iter().zip(sigma).enumerate() {
            let sample = &mut samples[group(i)];
            sample.place.push(i);
            sample.y.push(y);
            sample.sigma.push(sigma);
        }
        samples
    }

    fn fit(&self, factor: f64) -> Fit {
        if let ([y], [sigma]) = (&*self.y, &*self.sigma) {
            return Fit::of_one(*y, factor * sigma);
        }
        let modes = self.modes(factor);
        let mean = |f: fn(&Mode) -> f64| modes.iter().map(|mode| mode.weight * f(mode)).sum();
        let value: f64 = mean(|mode| mode.centre);
        let between = modes.iter().map(|m| m.weight * (m.centre - value).powi(2)).sum();
        let n = self.y.len();
        let (mut good, mut influence) = (vec![0.0; n], vec![0.0; n]);
        for &Mode { centre, weight, .. } in &modes {
            let g: Vec<f64> = (0..n).map(|k| self.is_good(k, centre, factor).0).collect();
            // one of them is good
            let some = 1.0 - g.iter().map(|g| 1.0 - g).product::<f64>();
            let counts = |k: usize| g[k] / (self.sigma[k] * self.sigma[k]);
            let total: f64 = (0..n).map(counts).sum();
            for k in 0..n {
                good[k] += weight * g[k] / some;
                influence[k] += weight * counts(k) / total;
            }
        }
        let likeliest =
            modes.iter().fold(&modes[0], |a, b| if b.weight > a.weight { b } else { a });
        let (mut squares, mut freedom) = (0.0, -1.0);
        for k in 0..n {
            let (g, z) = self.is_good(k, likeliest.centre, factor);
            squares += g * (factor * z).powi(2);
            freedom += g;
        }
        let freedom = f64::max(freedom, 0.0);
        Fit {
            value,
            within: mean(|mode| mode.variance),
            between,
            good,
            influence,
            squares,
            freedom,
        }
    }

    /// Probability of a measurement to be good, and its distance in sigmas.
    fn is_good(&self, k: usize, centre: f64, factor: f64) -> (f64, f64) {
        let z = score(self.y[k] - centre, factor * self.sigma[k]);
        let density = exp(-0.5 * z * z);
        (density / (density + RATIO), z)
    }

    fn around(&self, centre: f64, factor: f64) -> Around {
        pulp::Arch::new().dispatch(Sums { sample: self, centre, factor })
    }

    /// The modes that count.
    fn modes(&self, factor: f64) -> Vec<Mode> {
        let starts = self.starts();
        let around: Vec<Around> = starts.iter().map(|&c| self.around(c, factor)).collect();
        let likelihood = |k: usize| around[k].log_likelihood;
        let highest = (0..starts.len()).map(likelihood).fold(f64::NEG_INFINITY, f64::max);
        let mut modes: Vec<Mode> = Vec::new();
        for k in 0..starts.len() {
            if likelihood(k) < highest - FAR_BELOW || !leads_to_maximum(&around, k) {
                continue;
            }
            let mode = self.climb(starts[k], factor);
            let apart = |m: &Mode| (m.centre - mode.centre).abs() > SAME * mode.variance.sqrt();
            if modes.iter().all(apart) {
                modes.push(mode);
            }
        }
        let highest = modes.iter().map(|m| m.weight).fold(f64::NEG_INFINITY, f64::max);
        modes.iter_mut().for_each(|m| m.weight = (m.weight - highest).exp());
        modes.retain(|m| m.weight >= LEAST_WEIGHT);
        let total: f64 = modes.iter().map(|m| m.weight).sum();
        modes.iter_mut().for_each(|m| m.weight /= total);
        modes
    }

    /// Different measurements in order: all, or some between which equally many lie.
    fn starts(&self) -> Vec<f64> {
        let mut sorted = self.y.clone();
        sorted.sort_unstable_by(f64::total_cmp);
        sorted.dedup();
        let n = sorted.len();
        if n <= STARTS {
            return sorted;
        }
        (0..STARTS).map(|k| sorted[k * (n - 1) / (STARTS - 1)]).collect()
    }

    /// The next maximum by EM. Its variance is that of the observed information,
    /// `Σ g/σ² − Σ g (1 − g) z²/σ²` (Louis 1982), never below that of measurements that are all good.
    fn climb(&self, start: f64, factor: f64) -> Mode {
        let mut centre = start;
        let mut around = self.around(centre, factor);
        for _ in 0..MOST_STEPS {
            let step = around.slope / around.information;
            centre += step;
            around = self.around(centre, factor);
            if step.abs() * around.information.sqrt() < TOLERANCE {
                break;
            }
        }
        let Around { log_likelihood, information, doubt, .. } = around;
        let variance = 1.0 / (information - doubt).max(LEAST_INFORMATION * information);
        Mode { centre, variance, weight: log_likelihood + 0.5 * variance.ln() }
    }

    /// Variance of the weighted mean over that with white noise: with `a = g/σ`,
    /// `Σ a_i a_j φ^|i−j| / Σ a²`.
    fn inflation(&self, good: &[f64], correlation: f64) -> f64 {
        let (mut squares, mut products, mut before) = (0.0, 0.0, 0.0);
        for k in 0..good.len() {
            let a = good[k] / self.sigma[k];
            if k > 0 {
                let gap = i32::try_from(self.place[k] - self.place[k - 1]).unwrap_or(i32::MAX);
                before *= correlation.powi(gap);
            }
            squares += a * a;
            products += a * before;
            before += a;
        }
        1.0 + 2.0 * products / squares
    }
}

/// Whether the slope changes its sign between this start and the one that it points to. Both may have
/// a maximum of their own.
fn leads_to_maximum(around: &[Around], k: usize) -> bool {
    let slope = |k: usize| around.get(k).map(|a| a.slope);
    let (after, before) = (slope(k + 1), k.checked_sub(1).and_then(slope));
    around[k].slope >= 0.0 && after.is_none_or(|s| s <= 0.0)
        || around[k].slope <= 0.0 && before.is_none_or(|s| s >= 0.0)
}

#[inline(always)]
fn score(deviation: f64, sigma: f64) -> f64 {
    (deviation / sigma).clamp(-FARTHEST, FARTHEST)
}

/// The sums of [`Around`].
struct Sums<'a> {
    sample: &'a Sample,
    centre: f64,
    factor: f64,
}

impl WithSimd for Sums<'_> {
    type Output = Around;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Around {
        let Self { sample: Sample { y, sigma, .. }, centre, factor } = self;
        let zero = [0.0; LANES];
        let [mut information, mut slope, mut doubt] = [zero; 3];
        let mut log_likelihood = 0.0;
        for (y, sigma) in y.chunks(LANES * PRODUCTS).zip(sigma.chunks(LANES * PRODUCTS)) {
            // logarithms are taken of products
            let mut product = [1.0; LANES];
            for (y, sigma) in y.chunks(LANES).zip(sigma.chunks(LANES)) {
                // lanes beyond the end count for nothing
                let (mut deviation, mut width, mut there) = (zero, [1.0; LANES], zero);
                for i in 0..y.len() {
                    (deviation[i], width[i], there[i]) = (y[i] - centre, factor * sigma[i], 1.0);
                }
                for i in 0..LANES {
                    let z = score(deviation[i], width[i]);
                    let density = exp(-0.5 * z * z);
                    let evidence = density + RATIO;
                    let g = density / evidence;
                    let weight = there[i] * g / (width[i] * width[i]);
                    product[i] *= if there[i] > 0.0 { evidence } else { 1.0 };
                    information[i] += weight;
                    slope[i] += weight * z * width[i];
                    doubt[i] += weight * (1.0 - g) * z * z;
                }
            }
            log_likelihood += product.iter().map(|p| p.ln()).sum::<f64>();
        }
        let [information, slope, doubt] =
            [information, slope, doubt].map(|lanes| lanes.iter().sum());
        Around { log_likelihood, information, slope, doubt }
    }
}
