//! By how much a covariance grows if residuals are larger than the stated sigmas allow.
//!
//! The sum of squares of residuals with ν degrees of freedom is `s ~ φ χ²_ν`, where φ is 1 if the
//! sigmas are right. The prior is `P(φ = 1) = .8`, and otherwise a half-Cauchy distribution of
//! `√(φ − 1)` with scale 2 (a random effect of the size of the sigmas: Gelman 2006). The posterior of φ
//! is then a mixture, and the error of the position is a mixture of normal distributions with
//! covariances `φ P`. The growth is the factor of P for which the 95 % ellipse contains 95 % of this
//! mixture, divided by the factor for residuals that just pass a test at 10 %. So the growth is 1 if
//! nothing contradicts the sigmas.
//!
//! For a batch, or for a single instant, one φ applies to everything. If its residuals fail the test,
//! `P(φ = 1)` is .5, and the growth is the factor of P itself.

use crate::base::distribution::chi_square_upper;
use crate::base::exponential::exponentials;
use std::f64::consts::TAU;
use std::sync::LazyLock;

/// Prior probability that the sigmas are right.
const RIGHT: f64 = 0.8;
/// The same if one φ applies to everything and the residuals are too large.
pub(in crate::location) const DOUBTED: f64 = 0.5;
/// Scale of the half-Cauchy prior of `√(φ − 1)`.
pub(in crate::location) const SCALE: f64 = 2.0;
/// First and last value of `√(φ − 1)` besides zero.
const RANGE: (f64, f64) = (0.1, 100.0);
/// Number of these values.
const STEPS: usize = 40;
/// Probability outside the ellipse.
pub(in crate::location) const OUTSIDE: f64 = 0.05;
/// Limits of `χ²` for two and three coordinates at 5 %.
pub(in crate::location) const LIMIT: [f64; 2] = [5.991_464_547_107_979, 7.814_727_903_251_179];
/// Upper normal quantile at 10 %.
const QUANTILE: f64 = 1.281_551_565_544_600_4;
/// Largest number of steps towards the logarithm of a factor, and its accuracy.
const HALVINGS: usize = 50;
const SETTLED: f64 = 1e-13;
/// Relative weight below which terms are left out.
const LEAST_WEIGHT: f64 = 1e-12;

/// Returns the growth of a covariance of D coordinates if residuals of `freedom` degrees of freedom,
/// which may be fractional, have this sum of squares. O(1), a few µs if the growth is not 1.
pub(in crate::location) fn growth<const D: usize>(statistic: f64, freedom: f64) -> f64 {
    if !contradicts(statistic, freedom) {
        return 1.0;
    }
    let agreeing = quantile::<D>(agreeing(freedom), freedom, RIGHT);
    (quantile::<D>(statistic, freedom, RIGHT) / agreeing).max(1.0)
}

/// Returns the growth if one φ applies to everything, as in a batch or a single instant.
pub(in crate::location) fn growth_of_all<const D: usize>(statistic: f64, freedom: f64) -> f64 {
    if !contradicts(statistic, freedom) {
        return 1.0;
    }
    quantile::<D>(statistic, freedom, DOUBTED).max(1.0)
}

/// Whether a sum of squares fails a test at 10 %; false without degrees of freedom, and for nan.
fn contradicts(statistic: f64, freedom: f64) -> bool {
    freedom > 0.0 && statistic > agreeing(freedom)
}

/// Returns the largest sum of squares that passes a test at 10 %, by the approximation of Wilson,
/// Hilferty (1931).
pub(in crate::location) fn agreeing(freedom: f64) -> f64 {
    let v = 2.0 / (9.0 * freedom);
    freedom * (1.0 - v + QUANTILE * v.sqrt()).powi(3)
}

/// Returns the factor with which the ellipse contains 95 % of the mixture, for this prior probability
/// that the sigmas are right.
fn quantile<const D: usize>(statistic: f64, freedom: f64, right: f64) -> f64 {
    // beyond the largest φ, the result is proportional to the statistic
    let largest = 1.0 + RANGE.1 * RANGE.1;
    let beyond = (statistic / (freedom * largest)).max(1.0);
    let statistic = statistic / beyond;
    let others = (1.0 - right).ln();
    let likelihood = |own: &Size| -0.5 * (freedom * own.ln_factor + statistic / own.factor);
    let mut terms = [(1.0, right.ln() - 0.5 * statistic); STEPS + 1];
    for (term, own) in terms[1..].iter_mut().zip(SIZES.iter()) {
        *term = (own.factor, others + own.ln_prior + likelihood(own));
    }
    beyond * containing::<D>(&mut terms)
}

/// A value of φ other than 1, and its prior probability among these.
struct Size {
    factor: f64,
    ln_factor: f64,
    ln_prior: f64,
}

static SIZES: LazyLock<[Size; STEPS]> = LazyLock::new(|| {
    let ratio = (RANGE.1 / RANGE.0).ln() / (STEPS - 1) as f64;
    let root = |j: usize| RANGE.0 * (ratio * j as f64).exp();
    let density = |t: f64| t / (1.0 + (t / SCALE).powi(2));
    let total: f64 = (0..STEPS).map(|j| density(root(j))).sum();
    std::array::from_fn(|j| {
        let factor = 1.0 + root(j) * root(j);
        let ln_prior = (density(root(j)) / total).ln();
        Size { factor, ln_factor: factor.ln(), ln_prior }
    })
});

/// Returns the factor with which the ellipse contains 95 % of a mixture of factors, each with the logarithm
/// of its weight.
pub(in crate::location) fn containing<const D: usize>(terms: &mut [(f64, f64)]) -> f64 {
    let sum = exponentials(terms, |term| &mut term.1);
    let mut counting = 0;
    for at in 0..terms.len() {
        if terms[at].1 > LEAST_WEIGHT * sum {
            terms[counting] = terms[at];
            counting += 1;
        }
    }
    let terms = &terms[..counting];
    let mean = terms.iter().map(|(factor, weight)| weight * factor).sum::<f64>() / sum;
    let (mut low, mut high) = (0.0, (1.0 + RANGE.1 * RANGE.1).ln());
    let mut log = mean.ln().clamp(low, high);
    // Newton's method, with halvings where it leaves the interval
    for _ in 0..HALVINGS {
        let (mut outside, mut slope) = (0.0, 0.0);
        for &(factor, weight) in terms {
            let (tail, decrease) = upper::<D>(log.exp() / factor);
            outside += weight * tail / sum;
            slope += weight * decrease / sum;
        }
        if outside > OUTSIDE {
            low = log
        } else {
            high = log
        }
        let mut next = log + (outside / OUTSIDE).ln() * outside / slope;
        if !(low < next && next < high) {
            next = 0.5 * (low + high);
        }
        let step = next - log;
        log = next;
        if step.abs() < SETTLED {
            break;
        }
    }
    log.exp()
}

/// Returns `P(χ²_D > m LIMIT)`, and by how much it decreases with the logarithm of m.
fn upper<const D: usize>(m: f64) -> (f64, f64) {
    let x = m * LIMIT[D - 2];
    let tail = (-0.5 * x).exp();
    if D == 2 {
        (tail, 0.5 * x * tail)
    } else {
        (chi_square_upper(x, D), x * (x / TAU).sqrt() * tail)
    }
}
