//! The mean of values with correlated noise: an AR(1) process with gaps.

#[cfg(test)]
use super::distribution::{student_two_sided, two_sigma};
use super::exponential::{exp, ln};
use pulp::{Arch, Simd, WithSimd};
use std::sync::LazyLock;

/// Number of values of φ = tanh u; below, the smallest and largest u.
const STEPS: usize = 48;
const LOWEST: f64 = -0.55;
const HIGHEST: f64 = 2.65;
/// Largest gap whose factors are stored.
const SHORT: usize = 16;
/// Prior probability of no correlation.
const WHITE: f64 = 0.5;
/// Correlations with less weight than this are neglected.
const LEAST_WEIGHT: f64 = 1e-18;

/// Sums over the pairs of successive values with the same gap.
#[derive(Clone, Copy, Debug, Default)]
struct Pairs {
    gap: usize,
    count: f64,
    /// Σ of the earlier and of the later values, of their squares and products.
    first: f64,
    second: f64,
    first_squared: f64,
    second_squared: f64,
    product: f64,
}

/// Data for the exact marginal over the correlation of a record; reused from row to row.
#[derive(Clone, Debug, Default)]
pub struct Autoregression {
    count: usize,
    /// Value that is subtracted from all values.
    origin: f64,
    start: f64,
    pairs: Vec<Pairs>,
    correlation: Vec<f64>,
    weight: Vec<f64>,
    mean: Vec<f64>,
    sigma: Vec<f64>,
    /// Logarithm of the evidence relative to that of white noise.
    gain: f64,
    /// Standard deviation of the mean for white noise.
    white_sigma: f64,
}

impl Autoregression {
    /// Reads values with their indices in the record, and computes the posterior of their mean.
    ///
    /// If φ is unknown (`None`), half of its prior is at zero and half is flat between −.5 and .99. The
    /// prior of μ is flat, that of the scale is 1/s. With f = φ^gap, v = 1 − f², e = y' − f y of each
    /// pair of successive values, `A = 1 + Σ (1−f)²/v`, `m = (y_1 + Σ (1−f) e/v)/A`,
    /// `S = (y_1−m)² + Σ (e − (1−f) m)²/v`, the posterior of φ is `∝ p(φ) Π v^−½ A^−½ S^−(n−1)/2`, and μ
    /// given φ has Student's distribution about m with n − 1 degrees of freedom and scale
    /// `√(S/((n−1) A))`. Cost O(N) + O(48) for each distinct length of gap.
    pub fn read(&mut self, values: impl Iterator<Item = (usize, f64)>, phi: Option<f64>) {
        self.collect(values);
        for column in [&mut self.correlation, &mut self.weight, &mut self.mean, &mut self.sigma] {
            column.clear();
        }
        self.gain = 0.0;
        let varies = self.pairs.iter().any(|p| p.second_squared > 0.0);
        if self.count < 3 || !varies {
            return;
        }
        let white = self.given([0.0], &[]);
        self.white_sigma = white.sigma[0];
        if let Some(phi) = phi {
            let found = self.given([phi], &[]);
            self.gain = found.log_evidence[0] - white.log_evidence[0];
            self.push(phi, 1.0, &found, 0);
            return;
        }
        let Grid { ln_prior, phis, factors } = &*GRID;
        let found = self.given(*phis, factors);
        let log: [f64; STEPS] =
            std::array::from_fn(|i| ln_prior[i] + found.log_evidence[i] - white.log_evidence[0]);
        let highest = log.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let odds = Arch::new().dispatch(Exponentials(log.map(|l| l - highest)));
        let total: f64 = odds.iter().sum();
        self.gain = highest + total.ln();
        for i in 0..STEPS {
            let weight = odds[i] / total;
            if weight > LEAST_WEIGHT {
                self.push(phis[i], weight, &found, i);
            }
        }
    }

    fn push<const M: usize>(&mut self, phi: f64, weight: f64, found: &Given<M>, i: usize) {
        self.correlation.push(phi);
        self.weight.push(weight);
        self.mean.push(found.mean[i]);
        self.sigma.push(found.sigma[i]);
    }

    fn collect(&mut self, values: impl Iterator<Item = (usize, f64)>) {
        self.pairs.clear();
        self.count = 0;
        let mut previous: Option<(usize, f64)> = None;
        for (place, value) in values {
            self.count += 1;
            if let Some((before, y)) = previous {
                let x = value - self.origin;
                let pairs = self.of_gap(place - before);
                pairs.count += 1.0;
                pairs.first += y;
                pairs.second += x;
                pairs.first_squared += y * y;
                pairs.second_squared += x * x;
                pairs.product += x * y;
                previous = Some((place, x));
            } else {
                self.origin = value;
                self.start = 0.0;
                previous = Some((place, 0.0));
            }
        }
    }

    fn of_gap(&mut self, gap: usize) -> &mut Pairs {
        let known = self.pairs.iter().position(|p| p.gap == gap);
        let index = known.unwrap_or_else(|| {
            self.pairs.push(Pairs { gap, ..Pairs::default() });
            self.pairs.len() - 1
        });
        &mut self.pairs[index]
    }

    /// The mean given each of M correlations; `known` contains their factors for short gaps.
    fn given<const M: usize>(&self, phis: [f64; M], known: &[Factors<M>]) -> Given<M> {
        Arch::new().dispatch(Conditional { record: self, phis, known })
    }

    /// Logarithm of the evidence relative to that of white noise; 0 for fewer than three values, and if
    /// all values are equal.
    pub fn gain(&self) -> f64 {
        self.gain
    }

    fn terms(&self) -> impl Iterator<Item = (f64, f64, f64)> {
        let pairs = self.weight.iter().zip(&self.mean).zip(&self.sigma);
        pairs.map(|((&w, &m), &s)| (w, m, s))
    }

    /// Posterior mean of φ.
    pub fn correlation(&self) -> f64 {
        self.weight.iter().zip(&self.correlation).map(|(w, phi)| w * phi).sum()
    }

    /// Posterior mean of μ.
    #[cfg(test)]
    fn mean(&self) -> f64 {
        self.origin + self.shift()
    }

    fn shift(&self) -> f64 {
        self.terms().map(|(w, m, _)| w * m).sum()
    }

    /// Variance of the values, as if they were white; 0 for fewer than three values, and if all are equal.
    pub fn variance(&self) -> f64 {
        if self.weight.is_empty() {
            return 0.0;
        }
        self.white_sigma * self.white_sigma * self.count as f64
    }

    /// Ratio of the variance of μ to its variance for white noise, without the factor for the degrees of
    /// freedom, which is common to both; 1 for fewer than three values, and if all values are equal.
    pub fn inflation(&self) -> f64 {
        if self.weight.is_empty() {
            return 1.0;
        }
        let shift = self.shift();
        let variance: f64 = self.terms().map(|(w, m, s)| w * (s * s + (m - shift).powi(2))).sum();
        variance / (self.white_sigma * self.white_sigma)
    }

    /// Half of the half-width of the interval about the mean that contains 95.45 % of the posterior.
    #[cfg(test)]
    fn sigma(&self) -> f64 {
        let (shift, degrees) = (self.shift(), self.count as f64 - 1.0);
        let beyond = |t: f64| {
            let half = 0.5 * student_two_sided(t.abs(), degrees);
            if t >= 0.0 { half } else { 1.0 - half }
        };
        let outside = |h: f64| {
            let tails = |m: f64, s: f64| beyond((h - m + shift) / s) + beyond((h + m - shift) / s);
            self.terms().map(|(w, m, s)| w * tails(m, s)).sum::<f64>()
        };
        let variance: f64 = self.terms().map(|(w, m, s)| w * (s * s + (m - shift).powi(2))).sum();
        two_sigma(outside, variance.sqrt())
    }
}

/// What follows from each of M correlations: the mean minus the origin, its sigma, and the evidence.
struct Given<const M: usize> {
    mean: [f64; M],
    sigma: [f64; M],
    log_evidence: [f64; M],
}

/// Computes [`Given`], side by side for all correlations.
struct Conditional<'a, const M: usize> {
    record: &'a Autoregression,
    phis: [f64; M],
    known: &'a [Factors<M>],
}

impl<const M: usize> WithSimd for Conditional<'_, M> {
    type Output = Given<M>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Given<M> {
        let Self { record, phis, known } = self;
        let (mut a, mut top, mut log_v) = ([1.0; M], [record.start; M], [0.0; M]);
        let mut square = [record.start * record.start; M];
        for p in &record.pairs {
            let rare;
            let factors = match known.get(p.gap - 1) {
                Some(usual) => usual,
                None => {
                    rare = Factors::of(phis, p.gap);
                    &rare
                }
            };
            let Factors { f, inverse, ln_v } = factors;
            for i in 0..M {
                let (f, rest) = (f[i], (1.0 - f[i]) * inverse[i]);
                a[i] += p.count * (1.0 - f) * rest;
                top[i] += rest * (p.second - f * p.first);
                let squares = p.second_squared - 2.0 * f * p.product + f * f * p.first_squared;
                square[i] += squares * inverse[i];
                log_v[i] += p.count * ln_v[i];
            }
        }
        let degrees = record.count as f64 - 1.0;
        let (mut mean, mut sigma, mut log_evidence) = ([0.0; M], [0.0; M], [0.0; M]);
        for i in 0..M {
            mean[i] = top[i] / a[i];
            let rss = (square[i] - a[i] * mean[i] * mean[i]).max(f64::MIN_POSITIVE);
            sigma[i] = (rss / (degrees * a[i])).sqrt();
            log_evidence[i] = -0.5 * (log_v[i] + ln(a[i]) + degrees * ln(rss));
        }
        Given { mean, sigma, log_evidence }
    }
}

struct Exponentials([f64; STEPS]);

impl WithSimd for Exponentials {
    type Output = [f64; STEPS];

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> [f64; STEPS] {
        let mut found = self.0;
        for x in &mut found {
            *x = exp(*x);
        }
        found
    }
}

/// f = φ^gap, 1/v with v = 1 − f², and ln v, for each φ.
#[derive(Clone, Copy, Debug)]
struct Factors<const M: usize> {
    f: [f64; M],
    inverse: [f64; M],
    ln_v: [f64; M],
}

impl<const M: usize> Factors<M> {
    fn of(phis: [f64; M], gap: usize) -> Self {
        let f = phis.map(|phi| phi.powi(i32::try_from(gap).unwrap_or(i32::MAX)));
        let v = f.map(|f| 1.0 - f * f);
        Self { f, inverse: v.map(|v| 1.0 / v), ln_v: v.map(f64::ln) }
    }
}

/// Values of φ with the logarithm of their prior, which is flat with an additional half at the value
/// nearest to zero; and the factors for short gaps.
struct Grid {
    phis: [f64; STEPS],
    ln_prior: [f64; STEPS],
    factors: [Factors<STEPS>; SHORT],
}

static GRID: LazyLock<Grid> = LazyLock::new(|| {
    let step = (HIGHEST - LOWEST) / (STEPS - 1) as f64;
    let phis: [f64; STEPS] = std::array::from_fn(|i| (LOWEST + step * i as f64).tanh());
    // dφ = (1 − φ²) du
    let flat = phis.map(|phi| 1.0 - phi * phi);
    let total: f64 = flat.iter().sum();
    let mut prior = flat.map(|f| (1.0 - WHITE) * f / total);
    let nearest = (0..STEPS).fold(0, |a, b| if phis[b].abs() < phis[a].abs() { b } else { a });
    prior[nearest] += WHITE;
    let factors = std::array::from_fn(|gap| Factors::of(phis, gap + 1));
    Grid { phis, ln_prior: prior.map(f64::ln), factors }
});

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::{assert_close, assert_within};

    const Y: [f64; 10] = [1.2, 0.9, 1.1, 0.4, 0.3, 0.6, 0.2, -0.1, 0.3, 0.5];

    fn of(places: [usize; 10], phi: Option<f64>) -> Autoregression {
        let mut found = Autoregression::default();
        found.read(places.into_iter().zip(Y), phi);
        found
    }

    #[test]
    fn a_correlation_that_is_given() {
        let found = of(std::array::from_fn(|i| i), Some(0.5));
        assert_close(found.mean(), 0.591_666_666_666_666_7);
        assert_close(found.sigma[0], 0.199_284_987_324_282_68);
    }

    /// Expected values from an independent computation with NumPy and SciPy.
    #[test]
    fn a_correlation_that_is_found() {
        let found = of(std::array::from_fn(|i| i), None);
        assert_close(found.mean(), 0.629_104_340_364_989_9);
        assert_close(found.sigma(), 0.567_846_763_175_430_5);
        assert_close(found.correlation(), 0.526_941_224_297_795);
    }

    #[test]
    fn with_gaps() {
        let found = of([0, 1, 2, 4, 5, 6, 9, 10, 11, 12], None);
        assert_close(found.mean(), 0.633_668_425_602_643_5);
        assert_close(found.sigma(), 0.527_827_256_452_714_4);
        assert_close(found.correlation(), 0.609_770_896_664_909);
    }

    #[test]
    fn an_offset_does_not_matter() {
        let mut found = Autoregression::default();
        found.read(Y.iter().enumerate().map(|(i, y)| (i, y + 1e6)), None);
        assert_within(1e-8, found.mean() - 1e6, 0.629_104_340_364_989_9);
        assert_within(1e-8, found.sigma(), 0.567_846_763_175_430_5);
    }

    #[test]
    fn two_values_say_nothing_of_it() {
        let mut found = Autoregression::default();
        found.read([(0, 1.0), (1, 2.0)].into_iter(), None);
        assert_eq!((found.gain(), found.inflation()), (0.0, 1.0));
    }
}
