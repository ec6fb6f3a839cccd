//! What a few bearings say about their own concentration, and about a position if it is unknown.
//!
//! Bearings have von Mises errors about the directions to the target, all with the same factor f
//! between true and stated σ. With `S(p) = Σ (1 − cos(θ_i − a_i(p))) / σ_i²`, the likelihood is
//!
//! ```text
//! L(p, λ) = Π c(λ/σ_i²) e^(−λ S(p)),   λ = 1/f²,   c(κ) = 1 / (2π I0(κ) e^−κ),
//! ```
//!
//! and integration over λ leaves a function of S alone, which is tabulated.

use std::f64::consts::PI;

/// Number of values of the factor between true and stated σ in the integration, equally spaced in its
/// logarithm.
pub const STEPS: usize = 121;
/// Limits of λ. With a stated σ of 5°, the concentrations are 1 to 40,000, which corresponds to σ from
/// 57° to 0.3°.
const LOWEST: f64 = 0.007_615_435_494_667_714;
const HIGHEST: f64 = 40_000.0 * LOWEST;
/// Prior standard deviation of ln f: a stated σ is assumed to be right within a factor of two.
const SPREAD: f64 = 0.7;
/// Number of these standard deviations within which f is plausible.
const LIKELY: f64 = 3.0;
/// Smallest S of the tables; for smaller ones the density does not change.
const SMALLEST: f64 = 1e-6;
/// Distance of the nodes of tables in ln S.
const SPACING: f64 = 0.05;
/// Argument from which on the asymptotic series of I0 is accurate to double precision.
const LARGE: f64 = 30.0;

/// Logarithms of the weights or likelihoods of the values of the factor.
pub type Weights = [f64; STEPS];

/// Returns `ln λ` of a step.
fn ln_lambda(step: usize) -> f64 {
    let (low, high) = (LOWEST.ln(), HIGHEST.ln());
    low + (high - low) * step as f64 / (STEPS - 1) as f64
}

/// Returns λ of each step.
pub(in crate::location) fn lambdas() -> [f64; STEPS] {
    std::array::from_fn(|step| ln_lambda(step).exp())
}

/// Returns `f = λ^-½` of each step.
pub(in crate::location) fn factors() -> [f64; STEPS] {
    std::array::from_fn(|step| (-0.5 * ln_lambda(step)).exp())
}

/// Returns the logarithms of the weights for the log-normal prior of f with median 1.
pub(in crate::location) fn prior() -> Weights {
    let mut ln: Weights =
        std::array::from_fn(|step| -0.5 * (0.5 * ln_lambda(step) / SPREAD).powi(2));
    normalise(&mut ln);
    ln
}

/// Returns equal weights for all plausible f: a tree of squares that was refined for one λ is not fine
/// enough to integrate for another.
pub(in crate::location) fn likely() -> Weights {
    std::array::from_fn(|step| {
        if (0.5 * ln_lambda(step)).abs() <= LIKELY * SPREAD { 0.0 } else { f64::NEG_INFINITY }
    })
}

/// Scales the weights so that they sum to one.
pub(in crate::location) fn normalise(ln: &mut Weights) {
    let total = ln_sum_exp(ln);
    for value in ln {
        *value -= total;
    }
}

fn ln_sum_exp(ln: &Weights) -> f64 {
    let largest = ln.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    largest + ln.iter().map(|v| (v - largest).exp()).sum::<f64>().ln()
}

/// Returns `I0(x) e^-x` by the power series, or by the asymptotic one (Abramowitz, Stegun 9.6.12,
/// 9.7.1).
fn scaled_bessel(x: f64) -> f64 {
    let (mut sum, mut term, mut k) = (1.0, 1.0, 1.0);
    if x < LARGE {
        while term > f64::EPSILON * sum {
            term *= 0.25 * x * x / (k * k);
            sum += term;
            k += 1.0;
        }
        return sum * (-x).exp();
    }
    while term > f64::EPSILON * sum {
        term *= (2.0 * k - 1.0).powi(2) / (8.0 * x * k);
        sum += term;
        k += 1.0;
    }
    sum / (2.0 * PI * x).sqrt()
}

/// Returns `Σ_i ln c(λ/σ_i²)` of each step, from the stated `1/σ_i²`.
pub(in crate::location) fn ln_constants(precisions: impl Iterator<Item = f64>) -> Weights {
    let lambdas = lambdas();
    let mut sum = [0.0; STEPS];
    let mut last = (f64::NAN, [0.0; STEPS]);
    for precision in precisions {
        if last.0 != precision {
            let of = |lambda: f64| -(2.0 * PI * scaled_bessel(lambda * precision)).ln();
            last = (precision, lambdas.map(of));
        }
        for (sum, value) in sum.iter_mut().zip(&last.1) {
            *sum += value;
        }
    }
    sum
}

/// `e^(−λ S)` for each λ, at nodes that are equally spaced in ln S.
#[derive(Debug)]
pub struct Decay {
    nodes: Vec<[f64; STEPS]>,
}

impl Decay {
    /// Creates the table for K stations with these standard deviations (nan: no measurement), once for
    /// a batch. The nodes of small S do not depend on the largest S. O(STEPS nodes).
    pub fn new(k: usize, sigmas: &[f64]) -> Self {
        let least = sigmas.iter().copied().fold(f64::INFINITY, f64::min);
        let largest = 2.0 * k as f64 / (least * least);
        let count = ((largest / SMALLEST).ln() / SPACING).ceil().max(1.0) as usize + 2;
        let lambdas = lambdas();
        let node = |i: usize| lambdas.map(|lambda| (-lambda * misfit_of(i)).exp());
        Self { nodes: (0..count).map(node).collect() }
    }

    /// Returns the node before S, and the fraction of the distance to the next one.
    fn place(&self, s: f64) -> (usize, f64) {
        let at = (s.max(SMALLEST) / SMALLEST).ln() / SPACING;
        let node = (at as usize).min(self.nodes.len() - 2);
        (node, at - node as f64)
    }

    /// Returns `ln g(S) = ln Σ w c e^(−λ S)` at the nodes. O(STEPS nodes).
    pub(in crate::location) fn evidence(
        &self,
        ln_weights: &Weights,
        ln_constants: &Weights,
    ) -> Evidence<'_> {
        let ln: Weights = std::array::from_fn(|k| ln_weights[k] + ln_constants[k]);
        let largest = ln.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let factors = ln.map(|v| (v - largest).exp());
        let lambdas = lambdas();
        let value = |(i, decays): (usize, &[f64; STEPS])| {
            let sum: f64 = factors.iter().zip(decays).map(|(factor, decay)| factor * decay).sum();
            if sum > f64::MIN_POSITIVE {
                return largest + sum.ln();
            }
            // with many bearings, only the smallest concentrations contribute: add via logarithms
            let s = misfit_of(i);
            ln_sum_exp(&std::array::from_fn(|k| ln[k] - lambdas[k] * s))
        };
        Evidence { decay: self, ln: self.nodes.iter().enumerate().map(value).collect() }
    }

    /// Returns `ln Π c ∫ e^(−λ S) dp` of each λ, from S and the area of each node of a quadrature,
    /// which is divided between the two neighbouring nodes of the table. O(STEPS nodes).
    pub(in crate::location) fn ln_likelihood(
        &self,
        ln_constants: &Weights,
        areas: impl Iterator<Item = (f64, f64)>,
    ) -> Weights {
        let mut histogram = vec![0.0; self.nodes.len()];
        for (s, area) in areas {
            let (node, share) = self.place(s);
            histogram[node] += area * (1.0 - share);
            histogram[node + 1] += area * share;
        }
        let mut sum = [0.0; STEPS];
        for (area, decays) in histogram.iter().zip(&self.nodes).filter(|(area, _)| **area > 0.0) {
            for (sum, decay) in sum.iter_mut().zip(decays) {
                *sum += area * decay;
            }
        }
        // at least the smallest positive number: ln 0 could not be subtracted again
        std::array::from_fn(|k| ln_constants[k] + sum[k].max(f64::MIN_POSITIVE).ln())
    }
}

/// Returns S of a node.
fn misfit_of(node: usize) -> f64 {
    SMALLEST * (SPACING * node as f64).exp()
}

/// `ln g(S)`, interpolated linearly in ln S between the nodes.
pub(in crate::location) struct Evidence<'a> {
    decay: &'a Decay,
    ln: Vec<f64>,
}

impl Evidence<'_> {
    pub fn ln_at(&self, s: f64) -> f64 {
        let (node, share) = self.decay.place(s);
        self.ln[node] + share * (self.ln[node + 1] - self.ln[node])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_within;

    /// Values of SciPy's `special.i0e`.
    #[test]
    fn bessel() {
        for (x, expected) in [
            (0.0, 1.0),
            (1.0, 0.465_759_607_593_640_44),
            (29.0, 0.074_407_468_222_225_59),
            (31.0, 0.071_946_496_696_983_83),
            (4e4, 0.001_994_717_635_567_955),
        ] {
            assert_within(1e-14, scaled_bessel(x), expected);
        }
    }

    /// Values of a sum of 121 exponentials in double precision, for three bearings of 5°.
    #[test]
    fn evidence() {
        let sigma = 5_f64.to_radians();
        let precision = sigma.powi(-2);
        let constants = ln_constants([precision; 3].into_iter());
        let decay = Decay::new(3, &[sigma]);
        let evidence = decay.evidence(&prior(), &constants);
        for (s, expected) in [
            (0.001, 5.233_149_008_189_221),
            (0.01, 2.588_215_109_392_012),
            (0.1, -2.003_425_035_892_590_2),
        ] {
            assert_within(1e-4, evidence.ln_at(s * precision), expected);
            let lambdas = lambdas();
            let ln: Weights =
                std::array::from_fn(|k| prior()[k] + constants[k] - lambdas[k] * s * precision);
            assert_within(1e-12, ln_sum_exp(&ln), expected);
        }
    }
}
