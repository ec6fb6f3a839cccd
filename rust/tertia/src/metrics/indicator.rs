//! Correlation of indicators (inside or outside a region) of correlated normal variables.

use crate::base::distribution::{chi_square_upper_quantile, ln_gamma, normal_two_sided_quantile};
use crate::base::error::{Result, require};
use crate::metrics::lasting::POWERS;

/// Number of terms of the expansions.
const TERMS: usize = 200;

/// Returns the x with `P(X ≤ x) = probability` for chi-square with `degrees_of_freedom`.
///
/// # Errors
/// A probability that is not between 0 and 1, or no degrees of freedom.
pub fn chi_square_quantile(probability: f64, degrees_of_freedom: usize) -> Result<f64> {
    let holds = probability > 0.0 && probability < 1.0;
    require("probability", probability, holds, "between 0 and 1 (exclusive)")?;
    let some = degrees_of_freedom > 0;
    require("degrees_of_freedom", degrees_of_freedom as f64, some, "positive")?;
    Ok(chi_square_upper_quantile(1.0 - probability, degrees_of_freedom))
}

/// Returns the weights of the [`POWERS`] of ρ whose sum is the correlation of two indicators.
///
/// For `axes` m > 0 the indicators are `Σ z_a² ≤ x`, a = 1…m, of two vectors of standard normal
/// variables with correlation ρ on each axis; the region contains the `probability` p. With
/// Laguerre polynomials and t = x/2, α = m/2, the correlation is
/// `Σ_k ρ^2k [t^α e^-t L_{k−1}^(α)(t)]² Γ(k) / (k Γ(α) Γ(k+α) p (1−p))`.
/// For m = 0 the indicators are `z ≤ x`, with Hermite polynomials:
/// `Σ_k ρ^k φ(x)² He_{k−1}(x)² / (k! p (1−p))`. Powers between those of [`POWERS`] are replaced by the
/// next lower one, which overestimates the correlation.
///
/// # Errors
/// A probability that is not between 0 and 1.
pub fn indicator_powers(axes: usize, probability: f64) -> Result<[f64; POWERS.len()]> {
    let holds = probability > 0.0 && probability < 1.0;
    require("probability", probability, holds, "between 0 and 1 (exclusive)")?;
    let mut weights = [0.0; POWERS.len()];
    let spread = probability * (1.0 - probability);
    let terms = if axes == 0 { hermite(probability) } else { laguerre(axes, probability) };
    for (power, term) in terms {
        let at = POWERS.iter().rposition(|kept| *kept <= power).unwrap_or(0);
        weights[at] += term / spread;
    }
    // the remainder of the expansion
    weights[POWERS.len() - 1] += (1.0 - weights.iter().sum::<f64>()).max(0.0);
    Ok(weights)
}

fn hermite(probability: f64) -> Vec<(i32, f64)> {
    let outside = 2.0 * probability.min(1.0 - probability);
    let x = if outside < 1.0 { normal_two_sided_quantile(outside) } else { 0.0 };
    let density = (-x * x).exp() / std::f64::consts::TAU;
    // orthonormal polynomials: h_k = He_k / √k!
    let (mut before, mut now) = (0.0, 1.0);
    let mut terms = Vec::with_capacity(TERMS);
    for k in 1..=TERMS as i32 {
        let order = f64::from(k);
        terms.push((k, density * now * now / order));
        (before, now) = (now, (x * now - (order - 1.0).sqrt() * before) / order.sqrt());
    }
    terms
}

fn laguerre(axes: usize, probability: f64) -> Vec<(i32, f64)> {
    let alpha = 0.5 * axes as f64;
    let t = 0.5 * chi_square_upper_quantile(1.0 - probability, axes);
    let front = 2.0 * (alpha * t.ln() - t) - ln_gamma(alpha);
    let (mut before, mut now) = (0.0, 1.0);
    let mut terms = Vec::with_capacity(TERMS);
    for k in 1..=TERMS as i32 {
        let order = f64::from(k);
        let norm = ln_gamma(order) - ln_gamma(order + alpha) - order.ln();
        terms.push((2 * k, (front + norm).exp() * now * now));
        // k L_k = (2k − 1 + α − t) L_{k−1} − (k − 1 + α) L_{k−2}
        let next = (2.0 * order - 1.0 + alpha - t) * now - (order - 1.0 + alpha) * before;
        (before, now) = (now, next / order);
    }
    terms
}
