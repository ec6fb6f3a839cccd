//! The likelihood of a centre for measurements whose noise is stated, and its maxima.

use crate::base::angle::median;
use crate::base::exponential::{exp, exponentials};
use crate::base::interrupt::poll;
use pulp::{Simd, WithSimd};

/// Prior probability that a measurement is bad.
const BAD: f64 = 0.1;
/// Bad measurements are spread evenly over this many typical sigmas to either side.
const REACH: f64 = 20.0;
/// Density of bad measurements multiplied by the odds of a bad one, relative to the largest density of
/// a good one of typical sigma: the odds multiplied by `√(2π)` and divided by the whole range of bad ones.
const RATIO: f64 = BAD / (1.0 - BAD) * 2.506_628_274_631_000_5 / (2.0 * REACH);
/// Scores are limited to this size, so that their squares are finite; the density of a good one is
/// negligible there, but not 0 (see [`exp`]).
pub(super) const FARTHEST: f64 = 1e3;
const LANES: usize = 8;
/// Number of factors of a product that does not underflow.
const PRODUCTS: usize = 64;
/// Largest number of measurements from which modes are searched for.
const STARTS: usize = 32;
/// Weight of a mode, relative to the largest one, below which it is left out.
const LEAST_WEIGHT: f64 = 0.05;
/// No mode is searched for from a start whose log likelihood is this much below the highest.
const FAR_BELOW: f64 = 15.0;
/// The climb ends when the centre changes by less than this share of its standard error.
const TOLERANCE: f64 = 1e-8;
const MOST_STEPS: usize = 100;
/// A start from which Newton's step is at most this share of the standard error is close to a maximum.
const NEAR: f64 = 0.1;
/// Modes closer than this share of their standard error count as one.
const SAME: f64 = 0.3;
/// Smallest share of the information that is left to a mode by doubtful measurements.
const LEAST_INFORMATION: f64 = 0.1;

/// Measurements of one group, with their indices in the record.
#[derive(Clone, Default)]
pub(super) struct Sample {
    pub place: Vec<usize>,
    pub y: Vec<f64>,
    pub sigma: Vec<f64>,
    /// Median sigma of the record. How far off a bad measurement is does not depend on its own sigma, so that
    /// of two measurements that contradict each other, either may be bad.
    typical: f64,
}

/// A maximum of the likelihood.
struct Mode {
    centre: f64,
    variance: f64,
    /// Logarithm of its posterior probability at first, then this probability.
    weight: f64,
}

/// The likelihood at a centre: its logarithm, `W = Σ g/σ²`, `Σ g (y − μ)/σ²` and `Σ g (1 − g) z²/σ²`,
/// where g is the probability that a measurement is good.
struct Around {
    log_likelihood: f64,
    information: f64,
    slope: f64,
    doubt: f64,
}

/// Mean over the modes.
pub(super) struct Fit {
    pub value: f64,
    /// Mean variance of the modes for white noise, and variance of their centres.
    pub within: f64,
    pub between: f64,
    /// Probability that each measurement is good, and its weight in `value`.
    pub good: Vec<f64>,
    pub influence: Vec<f64>,
    /// `Σ g z²` and `Σ g − 1` of the most probable mode, with z in stated sigmas.
    pub squares: f64,
    pub freedom: f64,
}

impl Fit {
    /// Result for a single measurement, of which nothing can show that it is bad.
    fn of_one(value: f64, sigma: f64) -> Self {
        let (good, influence) = (vec![1.0], vec![1.0]);
        let within = sigma * sigma;
        Self { value, within, between: 0.0, good, influence, squares: 0.0, freedom: 0.0 }
    }
}

impl Sample {
    /// Returns the sample of each group; groups are numbered from 0, and `None` is a single group.
    pub fn by_group(y: &[f64], sigma: &[f64], groups: Option<&[f64]>) -> Vec<Self> {
        let group = |i: usize| groups.map_or(0, |groups| groups[i] as usize);
        let count = (0..y.len()).map(group).max().map_or(0, |last| last + 1);
        let mut samples =
            vec![Self { typical: median(&mut sigma.to_vec()), ..Self::default() }; count];
        for (i, (&y, &sigma)) in y.iter().zip(sigma).enumerate() {
            let sample = &mut samples[group(i)];
            sample.place.push(i);
            sample.y.push(y);
            sample.sigma.push(sigma);
        }
        samples
    }

    /// Returns the mean over the modes if the true sigmas are the stated ones multiplied by `factor`.
    pub fn fit(&self, factor: f64) -> Fit {
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
            // given that at least one measurement is good
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

    /// Returns the probability that a measurement is good, and its distance from the centre in sigmas.
    fn is_good(&self, k: usize, centre: f64, factor: f64) -> (f64, f64) {
        let z = score(self.y[k] - centre, factor * self.sigma[k]);
        let density = exp(-0.5 * z * z);
        (density / (density + RATIO * (self.sigma[k] / self.typical)), z)
    }

    fn around(&self, centre: f64, factor: f64) -> Around {
        poll();
        pulp::Arch::new().dispatch(Sums { sample: self, centre, factor })
    }

    /// Returns the modes that are not left out, with weights that sum to one.
    fn modes(&self, factor: f64) -> Vec<Mode> {
        let starts = self.starts();
        let around: Vec<Around> = starts.iter().map(|&c| self.around(c, factor)).collect();
        let likelihood = |k: usize| around[k].log_likelihood;
        let highest = (0..starts.len()).map(likelihood).fold(f64::NEG_INFINITY, f64::max);
        let mut modes: Vec<Mode> = Vec::new();
        let leads =
            |&k: &usize| likelihood(k) >= highest - FAR_BELOW && leads_to_maximum(&around, k);
        // the slope may also change its sign twice between the likeliest start and its neighbour
        let likeliest = (0..starts.len()).filter(|&k| likelihood(k) == highest);
        for k in (0..starts.len()).filter(leads).chain(likeliest) {
            let mode = self.climb(starts[k], factor);
            let apart = |m: &Mode| (m.centre - mode.centre).abs() > SAME * mode.variance.sqrt();
            if modes.iter().all(apart) {
                modes.push(mode);
            }
        }
        exponentials(&mut modes, |m| &mut m.weight);
        modes.retain(|m| m.weight >= LEAST_WEIGHT);
        let total: f64 = modes.iter().map(|m| m.weight).sum();
        modes.iter_mut().for_each(|m| m.weight /= total);
        modes
    }

    /// Returns different measurements in ascending order: all, or some at equal distances in this
    /// order.
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

    /// Climbs to the next maximum by Newton's steps, which are limited to twice the EM steps. The
    /// variance is that of the observed information, `Σ g/σ² − Σ g (1 − g) z²/σ²` (Louis 1982), and
    /// never smaller than if all measurements were good.
    fn climb(&self, start: f64, factor: f64) -> Mode {
        let mut centre = start;
        let mut around = self.around(centre, factor);
        for _ in 0..MOST_STEPS {
            let Around { information, doubt, .. } = around;
            let step = around.slope / (information - doubt).max(0.5 * information);
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

    /// Returns the variance of the weighted mean relative to white noise: `Σ a_i a_j φ^|i−j| / Σ a²`
    /// with `a = g/σ`.
    pub fn inflation(&self, good: &[f64], correlation: f64) -> f64 {
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

/// Whether the slope changes its sign between this start and the neighbour towards which it points.
/// Both then are starts of a climb, as each may lead to its own maximum. A measurement that is far from all
/// others is its own maximum.
fn leads_to_maximum(around: &[Around], k: usize) -> bool {
    let Around { information, slope, doubt, .. } = around[k];
    if slope.abs() <= NEAR * (information - doubt).max(0.0).sqrt() {
        return true;
    }
    let slope = |k: usize| around.get(k).map(|a| a.slope);
    let (after, before) = (slope(k + 1), k.checked_sub(1).and_then(slope));
    around[k].slope >= 0.0 && after.is_none_or(|s| s <= 0.0)
        || around[k].slope <= 0.0 && before.is_none_or(|s| s >= 0.0)
}

#[inline(always)]
fn score(deviation: f64, sigma: f64) -> f64 {
    (deviation / sigma).clamp(-FARTHEST, FARTHEST)
}

/// Computes the sums of [`Around`].
struct Sums<'a> {
    sample: &'a Sample,
    centre: f64,
    factor: f64,
}

impl WithSimd for Sums<'_> {
    type Output = Around;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Around {
        let Self { sample: Sample { y, sigma, typical, .. }, centre, factor } = self;
        let zero = [0.0; LANES];
        let [mut information, mut slope, mut doubt] = [zero; 3];
        let mut log_likelihood = 0.0;
        for (y, sigma) in y.chunks(LANES * PRODUCTS).zip(sigma.chunks(LANES * PRODUCTS)) {
            // logarithms are taken of products of several densities
            let mut product = [1.0; LANES];
            for (y, sigma) in y.chunks(LANES).zip(sigma.chunks(LANES)) {
                // lanes beyond the end do not count
                let (mut deviation, mut width, mut there) = (zero, [1.0; LANES], zero);
                let mut bad = [RATIO; LANES];
                for i in 0..y.len() {
                    (deviation[i], width[i], there[i]) = (y[i] - centre, factor * sigma[i], 1.0);
                    bad[i] = RATIO * (sigma[i] / typical);
                }
                for i in 0..LANES {
                    let z = score(deviation[i], width[i]);
                    let density = exp(-0.5 * z * z);
                    let evidence = density + bad[i];
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;

    /// The density of measurements that are very far away is not exactly zero: their slopes may be larger
    /// than those of the good ones.
    #[test]
    fn distant_measurements_do_not_hide_the_others() {
        let y = [102.7, 100.0, 100.0, 100.0, 100.0, 117.2, 100.0, 164.1];
        let fit = Sample::by_group(&y, &[0.03; 8], None)[0].fit(1.0);
        assert_eq!(fit.value, 100.0);
    }

    /// With sigmas that are far too small, every few measurements form a maximum, and the slopes at the
    /// starts, which are only some of the measurements, need not point to the highest one.
    #[test]
    fn the_likeliest_measurement_leads_to_a_mode() {
        for seed in 0..60 {
            let mut random = Random::new(seed);
            let mut normal = || (0..4).map(|_| random.symmetric(0.866)).sum::<f64>();
            let y: Vec<f64> = (0..300).map(|_| 45.0 + normal()).collect();
            let fit = Sample::by_group(&y, &[0.01; 300], None)[0].fit(1.0);
            assert!((fit.value - 45.0).abs() < 3.0 && fit.within > 0.0, "{seed}");
        }
    }
}
