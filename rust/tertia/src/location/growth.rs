//! By how much a covariance grows where residuals are larger than the stated sigmas allow.
//!
//! Residuals of ν degrees of freedom have the sum of squares `s ~ φ χ²_ν`; φ is 1 where the sigmas
//! are right. With the prior `P(φ = 1) = .8`, otherwise `√(φ − 1)` half-Cauchy with scale 2 (a
//! random effect of the size of the sigmas: Gelman 2006), the posterior of φ is a mixture, and
//! the error of the position a mixture of normals with covariances `φ P`. The growth is the factor
//! of P for which the ellipse of 95 % holds 95 % of that mixture, relative to the same of residuals
//! that just pass a test at 10 %. So it is 1 where nothing contradicts, and there it adds nothing.
//!
//! Of a batch, or of an instant without company, one φ decides about everything. If its residuals
//! fail the test, `P(φ = 1)` is .5, and the growth is that of the ellipse itself.

use crate::base::distribution::chi_square_upper;

/// Probability that sigmas are right; the same where residuals that decide about everything are too
/// large.
const RIGHT: f64 = 0.8;
pub(super) const DOUBTED: f64 = 0.5;
/// Scale of the half-Cauchy prior of `√(φ − 1)`.
pub(super) const SCALE: f64 = 2.0;
/// Values of `√(φ − 1)` besides zero: the first, the last, their number.
const RANGE: (f64, f64) = (0.1, 100.0);
const STEPS: usize = 40;
/// What lies outside the ellipse.
pub(super) const OUTSIDE: f64 = 0.05;
/// `χ²` of two and three coordinates at 5 %.
pub(super) const LIMIT: [f64; 2] = [5.991_464_547_107_979, 7.814_727_903_251_179];
/// The normal quantile at 10 %.
const QUANTILE: f64 = 1.281_551_565_544_600_4;
/// Steps of the bisection of a logarithm.
const HALVINGS: usize = 40;
/// Terms of less weight do not count.
const LEAST_WEIGHT: f64 = 1e-12;

/// By how much a covariance of D coordinates grows if residuals of `freedom` degrees of freedom,
/// not necessarily whole, have this sum of squares. O(1), about 5 µs where it is not 1.
pub(super) fn growth<const D: usize>(statistic: f64, freedom: f64) -> f64 {
    if !contradicts(statistic, freedom) {
        return 1.0;
    }
    let agreeing = quantile::<D>(agreeing(freedom), freedom, RIGHT);
    (quantile::<D>(statistic, freedom, RIGHT) / agreeing).max(1.0)
}

/// The same of residuals that decide about everything.
pub(super) fn growth_of_all<const D: usize>(statistic: f64, freedom: f64) -> f64 {
    if !contradicts(statistic, freedom) {
        return 1.0;
    }
    quantile::<D>(statistic, freedom, DOUBTED).max(1.0)
}

/// Whether a sum of squares fails a test at 10 %; not that of no degrees of freedom, or nan.
fn contradicts(statistic: f64, freedom: f64) -> bool {
    freedom > 0.0 && statistic > agreeing(freedom)
}

/// The sum of squares that passes a test at 10 %: the approximation of Wilson, Hilferty (1931).
pub(super) fn agreeing(freedom: f64) -> f64 {
    let v = 2.0 / (9.0 * freedom);
    freedom * (1.0 - v + QUANTILE * v.sqrt()).powi(3)
}

/// The factor of the ellipse that holds 95 % of the mixture, if sigmas are right with a probability.
fn quantile<const D: usize>(statistic: f64, freedom: f64, right: f64) -> f64 {
    // beyond the largest φ everything is in proportion
    let largest = 1.0 + RANGE.1 * RANGE.1;
    let beyond = (statistic / (freedom * largest)).max(1.0);
    let statistic = statistic / beyond;
    let mut terms = [(0.0, 0.0); STEPS + 1];
    let ratio = (RANGE.1 / RANGE.0).ln() / (STEPS - 1) as f64;
    let root = |j: usize| RANGE.0 * (ratio * j as f64).exp();
    let density = |t: f64| t / (1.0 + (t / SCALE).powi(2));
    let total: f64 = (0..STEPS).map(|j| density(root(j))).sum();
    for (j, term) in terms.iter_mut().enumerate() {
        let t = if j == 0 { 0.0 } else { root(j - 1) };
        let prior = if j == 0 { right } else { (1.0 - right) * density(t) / total };
        let factor = 1.0 + t * t;
        *term = (factor, prior.ln() - 0.5 * (freedom * factor.ln() + statistic / factor));
    }
    let highest = terms.iter().fold(f64::NEG_INFINITY, |highest, term| highest.max(term.1));
    let mut sum = 0.0;
    for term in &mut terms {
        term.1 = (term.1 - highest).exp();
        sum += term.1;
    }
    let counting = |term: &&(f64, f64)| term.1 > LEAST_WEIGHT * sum;
    let outside = |m: f64| {
        let tail = |(factor, weight): &(f64, f64)| weight * upper::<D>(m / factor);
        terms.iter().filter(counting).map(tail).sum::<f64>() / sum
    };
    let (mut low, mut high) = (0.0, (1.0 + RANGE.1 * RANGE.1).ln());
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if outside(middle.exp()) > OUTSIDE { low = middle } else { high = middle }
    }
    beyond * (0.5 * (low + high)).exp()
}

/// `P(χ²_D > m LIMIT)`
fn upper<const D: usize>(m: f64) -> f64 {
    let x = m * LIMIT[D - 2];
    if D == 2 { (-0.5 * x).exp() } else { chi_square_upper(x, D) }
}
