//! How likely a measurement is no outlier, by what the rest of the path says.

use super::found::Found;
use super::measured::{REDUNDANCY, Record};
use crate::base::distribution::normal_two_sided_quantile;

/// Size of a residual that others of the instant do not contradict: two-sided 1 %.
const DOUBTED: f64 = 0.01;
/// Share of the measurements of an instant that agree, if it is the path that is wrong.
const AGREEING: f64 = 0.8;
/// Least share of a measurement that the others determine.
const REDUNDANT: f64 = 0.1;
/// Standard deviation of outliers over that of the noise: at least, as expected, and how many outliers
/// that is worth.
const LEAST_WIDTH: f64 = 3.0;
const WIDTH: f64 = 10.0;
const WORTH: f64 = 2.0;
/// Share of outliers: at the beginning, at most, and their number at least: one measurement in a record
/// without outliers is taken for one with a chance of about 1 %.
const SHARE: f64 = 0.1;
const LARGEST_SHARE: f64 = 0.5;
const LEAST_NUMBER: f64 = 0.5;
/// Share of the residuals by whose size the noise is first taken, and the largest that it is.
const LARGE: f64 = 0.9;
const LARGEST: f64 = 1000.0;
/// Noise that is as stated, as far as such sizes tell.
const LARGER: f64 = 1.2;
/// By how much the noise is made smaller in a step.
const STEP: f64 = 0.6;
/// Steps of expectation and maximisation, and the relative change of the share that ends them.
const STEPS: usize = 30;
const SETTLED: f64 = 0.01;
/// One-sided 99 % of a normal variable.
const SURELY: f64 = 2.326;
/// Measurements over which a running median tells errors that last from single faults, and the
/// variance of a median of so many normal errors, over theirs.
const RUNNING: usize = 5;
const OF_MEDIANS: f64 = 0.287;
/// Running medians that tell what lasts of one station alone.
const ENOUGH: usize = 20;
/// Size of what is not by chance, in standard errors: one-sided 5 %.
const CHANCE: f64 = 0.1;
/// Relative standard error of a median size of normal errors, times the root of their number.
const MEDIAN_ERROR: f64 = 1.17;

/// The number of standard errors that is exceeded by chance in one case of 20.
pub(super) fn chance() -> f64 {
    normal_two_sided_quantile(CHANCE)
}

/// By how much residuals are larger than their standard deviations say, at least 1: from their
/// median, less what it may be off by chance.
pub(super) fn scale(sizes: &mut [f64]) -> f64 {
    let n = sizes.len();
    let (below, &mut upper, _) = sizes.select_nth_unstable_by(n / 2, f64::total_cmp);
    let lower = below.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let median = if n % 2 == 1 { upper } else { 0.5 * (lower + upper) };
    let margin = 1.0 + chance() * MEDIAN_ERROR / (n as f64).sqrt();
    (median / normal_two_sided_quantile(0.5) / margin).max(1.0)
}

/// Noise and outliers, both normal, in the stated standard deviations.
#[derive(Clone, Debug)]
pub(super) struct Mixture {
    /// Share of outliers.
    share: f64,
    /// Standard deviations of the noise and of what outliers have besides.
    pub noise: f64,
    width: f64,
    /// Size of a residual that others of its instant do not contradict.
    doubted: f64,
    /// ln of the likelihood of the residuals.
    pub log_likelihood: f64,
}

/// A residual, where it stands, and the variance of what it is compared with.
struct Compared {
    at: usize,
    residual: f64,
    variance: f64,
}

impl Mixture {
    /// For a path that may follow outliers: with a noise as large as the residuals.
    pub fn new<const D: usize, const N: usize>(found: &Found<D, N>) -> Self {
        let mut sizes: Vec<f64> = Vec::with_capacity(found.measured.len());
        for t in 0..found.anchor.len() {
            let rows = found.measured.rows(t, found.path.position::<D>(t));
            sizes.extend(rows.map(|(_, row)| row.residual.abs()).filter(|size| !size.is_nan()));
        }
        let at = (LARGE * sizes.len() as f64) as usize;
        let noise = match sizes.len() {
            0 => 1.0,
            _ => {
                let size = *sizes.select_nth_unstable_by(at, f64::total_cmp).1;
                let noise = size / normal_two_sided_quantile(1.0 - LARGE);
                if noise < LARGER { 1.0 } else { noise.min(LARGEST) }
            }
        };
        let doubted = normal_two_sided_quantile(DOUBTED);
        Self { share: SHARE, noise, width: WIDTH * noise, doubted, log_likelihood: 0.0 }
    }

    /// With a smaller noise, if it is larger than stated.
    pub fn sharper(&self) -> Option<Self> {
        (self.noise > 1.0).then(|| Self { noise: (self.noise * STEP).max(1.0), ..self.clone() })
    }

    /// Densities of a residual of the noise, and of an outlier, each with its probability.
    fn densities(&self, residual: f64, variance: f64) -> [f64; 2] {
        let inside = self.noise.powi(2) + variance;
        let outside = inside + self.width.powi(2);
        let density =
            |variance: f64| (-0.5 * residual * residual / variance).exp() / variance.sqrt();
        [(1.0 - self.share) * density(inside), self.share * density(outside)]
    }

    /// The likeliest share and size of outliers, and size of the noise unless it is held, by
    /// expectation and maximisation.
    fn fit(&mut self, residuals: &[Compared], is_held: bool) {
        for _ in 0..STEPS {
            let before = self.share;
            self.step(residuals, is_held);
            if (self.share - before).abs() < SETTLED * before {
                break;
            }
        }
    }

    fn step(&mut self, residuals: &[Compared], is_held: bool) {
        let (mut total, mut squares, mut outside, mut log) = (0.0, 0.0, 0.0, 0.0);
        for Compared { residual, variance, .. } in residuals {
            let square = residual * residual;
            let densities = self.densities(*residual, *variance);
            let trust = trust_of(densities);
            total += trust;
            squares += trust * square / (1.0 + variance / self.noise.powi(2));
            outside += (1.0 - trust) * (square - variance).max(0.0);
            log += (densities[0] + densities[1]).max(f64::MIN_POSITIVE).ln();
        }
        self.log_likelihood = log;
        let count = residuals.len() as f64;
        if total == 0.0 {
            return;
        }
        self.share = (1.0 - total / count).max(LEAST_NUMBER / count).min(LARGEST_SHARE);
        if !is_held {
            let growth = squares / total;
            let by_chance = 1.0 + SURELY * (2.0 / total).sqrt();
            self.noise = if growth > by_chance { growth.sqrt() } else { 1.0 };
        }
        let expected = (WIDTH * self.noise).powi(2);
        let width = (WORTH * expected + outside) / (WORTH + count - total);
        self.width = width.sqrt().max(LEAST_WIDTH * self.noise);
    }
}

/// Probability that a residual with these densities belongs to the noise: far from both it is an
/// outlier.
fn trust_of([inside, outside]: [f64; 2]) -> f64 {
    if inside > 0.0 { inside / (inside + outside) } else { 0.0 }
}

impl<const D: usize, const N: usize> Found<D, N> {
    /// The probabilities of all measurements by what the rest of the path says.
    ///
    /// With the residual r, the weight w and g = J P J' / σ²: the path without it predicts it with the
    /// error r / (1 − w g), of the variance σ² (1 + g / (1 − w g)).
    pub(super) fn trusted(
        &self,
        record: &Record<'_>,
        mixture: &mut Mixture,
        is_held: bool,
    ) -> Vec<f64> {
        let residuals = self.compared(record);
        mixture.fit(&residuals, is_held);
        // what is missing is no outlier
        let mut trust: Vec<f64> =
            self.measured.values.iter().map(|v| if v.is_nan() { 1.0 } else { 0.0 }).collect();
        for Compared { at, residual, variance } in residuals {
            trust[at] = trust_of(mixture.densities(residual, variance));
        }
        for t in 0..record.len() {
            self.trust_instant(record, t, mixture.noise * mixture.doubted, &mut trust);
        }
        trust
    }

    /// The residuals of all measurements about the path without them.
    fn compared(&self, record: &Record<'_>) -> Vec<Compared> {
        let mut residuals = Vec::with_capacity(self.measured.len());
        let lasting = self.lasting(record);
        for t in 0..record.len() {
            let covariance = &self.path.covariance[t * D * D..][..D * D];
            for (m, row) in self.measured.rows(t, self.path.position::<D>(t)) {
                let at = t * record.width() + self.measured.column[m];
                let mut g = 0.0;
                for i in 0..D {
                    for j in 0..D {
                        g += row.gradient[i] * covariance[i * D + j] * row.gradient[j];
                    }
                }
                if g.is_finite() && !row.residual.is_nan() {
                    let held = self.trust[at] * g / (self.scale * self.scale);
                    let rest = (1.0 - held).max(REDUNDANT);
                    let variance = g / rest + lasting[self.measured.column[m]];
                    residuals.push(Compared { at, residual: row.residual / rest, variance });
                }
            }
        }
        residuals
    }

    /// Trusts an instant whose measurements agree, with as many to spare as it takes to be located
    /// robustly, where the path contradicts most of them: it does not know the motion.
    fn trust_instant(&self, record: &Record<'_>, t: usize, limit: f64, trust: &mut [f64]) {
        if !self.fixes.is_located(t) {
            return;
        }
        let agrees =
            |at: &usize| !self.fixes.outlier[*at] && self.fixes.residual[*at].abs() <= limit;
        let own = t * record.width()..(t + 1) * record.width();
        let (mut count, mut sum) = (0, 0.0);
        for at in own.clone().filter(agrees) {
            count += 1;
            sum += trust[at];
        }
        let measured = self.measured.instant(t).len() as f64;
        let most = count >= D + REDUNDANCY && count as f64 >= AGREEING * measured;
        if most && sum < 0.5 * count as f64 {
            own.filter(agrees).for_each(|at| trust[at] = 1.0);
        }
    }

    /// Variances of errors that last, of each number of an instant, in the stated ones: what lasts is
    /// no outlier. From running medians of the residuals, of all where one station has few.
    fn lasting(&self, record: &Record<'_>) -> Vec<f64> {
        let mut series = vec![Vec::new(); record.width()];
        for t in 0..record.len() {
            for (m, row) in self.measured.rows(t, self.path.position::<D>(t)) {
                if !row.residual.is_nan() {
                    series[self.measured.column[m]].push(row.residual);
                }
            }
        }
        let sizes = |own: &Vec<f64>| -> Vec<f64> { own.windows(RUNNING).map(middle).collect() };
        let own: Vec<Vec<f64>> = series.iter().map(sizes).collect();
        let all = variance_of(&mut own.concat());
        let of = |mut own: Vec<f64>| if own.len() < ENOUGH { all } else { variance_of(&mut own) };
        own.into_iter().map(of).collect()
    }
}

/// The size of the median of a window.
fn middle(window: &[f64]) -> f64 {
    let mut own: [f64; RUNNING] = std::array::from_fn(|i| window[i]);
    own.sort_unstable_by(f64::total_cmp);
    own[RUNNING / 2].abs()
}

/// The variance of errors that last, from sizes of running medians; none where it may be by chance.
fn variance_of(sizes: &mut [f64]) -> f64 {
    if sizes.is_empty() {
        return 0.0;
    }
    let at = sizes.len() / 2;
    let median = *sizes.select_nth_unstable_by(at, f64::total_cmp).1;
    let margin = 1.0 + chance() * MEDIAN_ERROR * (RUNNING as f64 / sizes.len() as f64).sqrt();
    let size = median / normal_two_sided_quantile(0.5) / margin;
    (size * size - OF_MEDIANS).max(0.0)
}
