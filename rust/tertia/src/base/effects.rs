//! Random effects: estimates that differ by more than their sigmas allow.

use super::distribution::{normal_two_sided, two_sigma};

/// Number of values of τ besides zero.
const STEPS: usize = 160;
/// Smallest and largest τ, in units of the prior's scale.
const RANGE: (f64, f64) = (0.01, 300.0);
/// If the estimates differ by more than the range of τ, the range is extended to this multiple of the
/// difference.
const REACH: f64 = 10.0;
/// Values of τ with less weight than this are neglected.
const LEAST_WEIGHT: f64 = 1e-18;

/// Combination of K estimates of the same quantity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Effects {
    /// Mean of the posterior of μ.
    pub mean: f64,
    /// Half of the half-width of the interval about the mean that contains 95.45 % of the posterior.
    pub sigma: f64,
    /// Mean of the posterior of τ, the standard deviation of the effects.
    pub tau: f64,
}

/// Combines estimates `x_k = μ + u_k + e_k` with `e_k ~ N(0, σ_k²)` and `u_k ~ N(0, τ²)`. The prior of μ
/// is flat; τ has a half-Cauchy prior of this `scale` and is integrated out. O(K) for each of 161 values
/// of τ.
///
/// For each τ, `v_k = σ_k² + τ²`, `W = Σ 1/v_k`, `m = Σ (x_k/v_k) / W`, and its weight is
/// `p(τ) dτ W^−½ Π v_k^−½ exp(−½ Σ (x_k − m)²/v_k)` (Gelman 2006). Averaging over τ makes the
/// posterior of μ heavy-tailed. A single estimate contains no information on τ and is returned unchanged.
///
/// # Panics
/// If the slices are empty or differ in length.
pub fn random_effects(x: &[f64], sigma: &[f64], scale: f64) -> Effects {
    assert_eq!(x.len(), sigma.len());
    let origin = x[0];
    if let [sigma] = sigma {
        return Effects { mean: origin, sigma: *sigma, tau: 0.0 };
    }
    let posterior = Posterior::of(x, sigma, (origin, scale));
    let mean: f64 = posterior.terms().map(|(w, m, _)| w * m).sum();
    let variance: f64 = posterior.terms().map(|(w, m, s)| w * (s * s + (m - mean).powi(2))).sum();
    let outside = |h: f64| {
        let tails = |m: f64, s: f64| {
            normal_two_sided((h - m + mean) / s) + normal_two_sided((h + m - mean) / s)
        };
        0.5 * posterior.terms().map(|(w, m, s)| w * tails(m, s)).sum::<f64>()
    };
    let sigma = two_sigma(outside, variance.sqrt());
    Effects { mean: origin + mean, sigma, tau: posterior.tau }
}

/// Posterior of μ as a mixture of normal distributions, one for each τ that is not negligible.
struct Posterior {
    weight: Vec<f64>,
    mean: Vec<f64>,
    sigma: Vec<f64>,
    tau: f64,
}

impl Posterior {
    fn of(x: &[f64], sigma: &[f64], (origin, scale): (f64, f64)) -> Self {
        let values = taus(x, scale);
        let (mut log_weight, mut mean, mut width) = (Vec::new(), Vec::new(), Vec::new());
        for (j, &tau) in values.iter().enumerate() {
            let (mut total, mut first, mut log_variances) = (0.0, 0.0, 0.0);
            for (&x, &s) in x.iter().zip(sigma) {
                let v = s * s + tau * tau;
                total += 1.0 / v;
                first += (x - origin) / v;
                log_variances += v.ln();
            }
            let m = first / total;
            let square = |(&x, &s): (&f64, &f64)| (x - origin - m).powi(2) / (s * s + tau * tau);
            let misfit: f64 = x.iter().zip(sigma).map(square).sum();
            log_weight
                .push(log_prior(&values, j, scale) - 0.5 * (log_variances + total.ln() + misfit));
            mean.push(m);
            width.push(total.recip().sqrt());
        }
        Self::normalised(&values, &log_weight, &mean, &width)
    }

    /// Normalises the weights to a sum of one, and leaves out negligible values of τ.
    fn normalised(values: &[f64], log_weight: &[f64], mean: &[f64], width: &[f64]) -> Self {
        let highest = log_weight.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let share: Vec<f64> = log_weight.iter().map(|l| (l - highest).exp()).collect();
        let sum: f64 = share.iter().sum();
        let counting: Vec<usize> =
            (0..share.len()).filter(|&j| share[j] > LEAST_WEIGHT * sum).collect();
        let of = |column: &[f64]| counting.iter().map(|&j| column[j]).collect();
        let weight: Vec<f64> = counting.iter().map(|&j| share[j] / sum).collect();
        let tau = counting.iter().zip(&weight).map(|(&j, w)| w * values[j]).sum();
        Self { weight, mean: of(mean), sigma: of(width), tau }
    }

    fn terms(&self) -> impl Iterator<Item = (f64, f64, f64)> {
        let pairs = self.weight.iter().zip(&self.mean).zip(&self.sigma);
        pairs.map(|((&w, &m), &s)| (w, m, s))
    }
}

/// Logarithm of the half-Cauchy density at the j-th value of τ, times its step.
pub(crate) fn log_prior(values: &[f64], j: usize, scale: f64) -> f64 {
    let last = values.len() - 1;
    let step = values[(j + 1).min(last)] - values[j.saturating_sub(1)];
    let step = if j == 0 || j == last { step } else { 0.5 * step };
    step.ln() - (values[j] / scale).powi(2).ln_1p()
}

/// Returns zero and values in geometric progression.
pub(crate) fn taus(x: &[f64], scale: f64) -> Vec<f64> {
    let (low, high) = x.iter().fold((x[0], x[0]), |(l, h), &v| (l.min(v), h.max(v)));
    let top = RANGE.1.max(REACH * (high - low) / scale);
    let ratio = (top / RANGE.0).ln() / (STEPS - 1) as f64;
    let value = |j: usize| scale * RANGE.0 * (ratio * j as f64).exp();
    std::iter::once(0.0).chain((0..STEPS).map(value)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::{assert_close, assert_within};

    /// Expected values from an independent computation with NumPy and SciPy.
    #[test]
    fn four_estimates_that_disagree() {
        let found = random_effects(&[10.0, 14.0, 9.0, 20.0], &[1.0, 1.5, 1.2, 2.0], 1.35);
        assert_close(found.mean, 12.959_393_660_027_319);
        assert_close(found.sigma, 2.903_832_169_071_31);
        assert_close(found.tau, 4.755_114_338_013_392);
    }

    #[test]
    fn a_common_offset_and_a_unit_do_not_matter() {
        let found = random_effects(&[10.0, 14.0, 9.0, 20.0], &[1.0, 1.5, 1.2, 2.0], 1.35);
        let x = [1e6 + 1e3, 1e6 + 1.4e3, 1e6 + 9e2, 1e6 + 2e3];
        let other = random_effects(&x, &[1e2, 1.5e2, 1.2e2, 2e2], 1.35e2);
        assert_within(1e-11, (other.mean - 1e6) / 100.0, found.mean);
        assert_within(1e-11, other.sigma / 100.0, found.sigma);
    }

    #[test]
    fn differences_beyond_any_expectation_widen_sigma() {
        let found = random_effects(&[0.0, 1e9], &[1.0, 1.0], 1.0);
        assert!(found.sigma > 2e8, "{found:?}");
        let alone = random_effects(&[3.0], &[0.5], 0.5);
        assert_eq!(alone, Effects { mean: 3.0, sigma: 0.5, tau: 0.0 });
    }
}
