//! Random effects: estimates whose systematic errors are estimated from their contradictions.

use super::independent::Independent;
use super::joint::vector;
use crate::base::angle::median;
use crate::base::distribution::{normal_two_sided, two_sigma};
use crate::base::effects::{log_prior, taus};
use crate::base::error::{Error, Result};
use crate::base::exponential::exponentials;
use crate::base::matrix::{Square, factorise_sum, invert, zeros};
use crate::weights::COVARIANCES;
use nalgebra::allocator::Allocator;
use nalgebra::{DefaultAllocator, Dim, OVector};

/// Number of values of τ, from which the cost is estimated.
pub const STEPS: usize = 161;

/// A combination of estimates with systematic errors, with its buffers.
///
/// `x_k = x + u_k + e_k` with `e_k ~ N(0, S_k)`, `u_k ~ N(0, τ² M)`. The prior of x is flat; τ has a
/// half-Cauchy prior of scale 1 and is integrated out. M is the fused covariance, scaled so that the
/// median of `√(tr(M^-1 S_k) / m)` is 1; results therefore depend on no unit and no direction. For
/// scalars this is [`random_effects`](crate::base::effects::random_effects).
pub(super) struct Effects<D: Dim>
where
    DefaultAllocator: Allocator<D, D> + Allocator<D>,
{
    /// Mean weights; below them the covariance and the mean sigma of the systematic errors.
    pub weight: Vec<Square<D>>,
    pub fused: Square<D>,
    pub bias_sigma: OVector<f64, D>,
    independent: Independent<D>,
    inflated: Vec<Square<D>>,
    terms: Vec<Term<D>>,
}

/// Result for one value of τ.
struct Term<D: Dim>
where
    DefaultAllocator: Allocator<D, D> + Allocator<D>,
{
    log_weight: f64,
    weight: Vec<Square<D>>,
    fused: Square<D>,
    mean: OVector<f64, D>,
}

impl<D: Dim> Effects<D>
where
    DefaultAllocator: Allocator<D, D> + Allocator<D>,
{
    pub fn new(sensors: usize, order: D) -> Self {
        Self {
            weight: vec![zeros(order); sensors],
            fused: zeros(order),
            bias_sigma: vector(order),
            independent: Independent::new(sensors, order),
            inflated: Vec::new(),
            terms: Vec::with_capacity(STEPS),
        }
    }

    /// Combines two or more estimates (K, m). Returns the statistic of the test whether they agree without
    /// systematic errors. Cost O(K m³) for each of 161 values of τ.
    pub fn combine(&mut self, x: &[f64], s: &[Square<D>]) -> Result<f64> {
        let statistic = self.independent.combine(x, s)?;
        let (shape, reach) = self.shape(x, s)?;
        let values = taus(&[0.0, reach], 1.0);
        self.terms.clear();
        for j in 0..values.len() {
            let prior = log_prior(&values, j, 1.0);
            let term = self.term(x, s, &shape, values[j], prior)?;
            self.terms.push(term);
        }
        let sum = exponentials(&mut self.terms, |term| &mut term.log_weight);
        let shares: Vec<f64> = self.terms.iter().map(|term| term.log_weight / sum).collect();
        self.mix(&shares, s.len());
        let tau: f64 = shares.iter().zip(&values).map(|(w, tau)| w * tau).sum();
        for i in 0..self.bias_sigma.len() {
            self.bias_sigma[i] = tau * shape[(i, i)].sqrt();
        }
        Ok(statistic)
    }

    /// Returns M and the largest difference from the first estimate in units of M.
    fn shape(&self, x: &[f64], s: &[Square<D>]) -> Result<(Square<D>, f64)> {
        let mut shape = self.independent.group.fused.clone();
        let (mut factor, mut inverse) = (shape.clone(), shape.clone());
        let half = &shape * 0.5;
        if !factorise_sum(&half, &half, &mut factor) {
            return Err(Error::LostToRounding { argument: COVARIANCES });
        }
        invert(&mut factor, &mut inverse);
        let m = shape.nrows();
        let trace = |s: &Square<D>| inverse.dot(s) / m as f64;
        let mut sizes: Vec<f64> = s.iter().map(|s| trace(s).sqrt()).collect();
        let size = median(&mut sizes);
        let distance = |estimate: &[f64]| {
            let product =
                |i: usize, j: usize| (estimate[i] - x[i]) * inverse[(i, j)] * (estimate[j] - x[j]);
            let sum: f64 =
                (0..m).flat_map(|i| (0..m).map(move |j| (i, j))).map(|(i, j)| product(i, j)).sum();
            sum.max(0.0).sqrt() / size
        };
        let reach = x.chunks_exact(m).map(distance).fold(0.0, f64::max);
        shape *= size * size;
        Ok((shape, reach))
    }

    fn term(
        &mut self,
        x: &[f64],
        s: &[Square<D>],
        shape: &Square<D>,
        tau: f64,
        prior: f64,
    ) -> Result<Term<D>> {
        let m = shape.nrows();
        let (mut factor, effect) = (shape.clone(), shape * (tau * tau));
        let mut determinants = 0.0;
        let mut logarithm = |x: &Square<D>, y: &Square<D>| {
            // a singular covariance makes an effect of zero impossible
            if !factorise_sum(x, y, &mut factor) {
                return f64::INFINITY;
            }
            (0..m).map(|i| factor[(i, i)].ln()).sum::<f64>()
        };
        self.inflated.clear();
        for covariance in s {
            determinants += logarithm(covariance, &effect);
            self.inflated.push(covariance + &effect);
        }
        let misfit = self.independent.combine(x, &self.inflated)?;
        let group = &self.independent.group;
        let half = &group.fused * 0.5;
        let spread = logarithm(&half, &half);
        let mut mean = vector(shape.shape_generic().0);
        for (weight, x) in group.weight.iter().zip(x.chunks_exact(m)) {
            for (i, j) in (0..m).flat_map(|i| (0..m).map(move |j| (i, j))) {
                mean[i] += weight[(i, j)] * x[j];
            }
        }
        let log_weight = prior - 0.5 * (determinants - spread + misfit);
        let log_weight = if log_weight.is_nan() { f64::NEG_INFINITY } else { log_weight };
        Ok(Term {
            log_weight,
            weight: group.weight[..s.len()].to_vec(),
            fused: group.fused.clone(),
            mean,
        })
    }

    /// Mixes the terms over τ. The variances are such that two sigmas contain 95.45 % of a component.
    fn mix(&mut self, shares: &[f64], count: usize) {
        self.weight.iter_mut().for_each(|weight| weight.fill(0.0));
        self.fused.fill(0.0);
        let mut mean = self.bias_sigma.clone();
        mean.fill(0.0);
        for (term, &share) in self.terms.iter().zip(shares) {
            mean += &term.mean * share;
            for (weight, own) in self.weight[..count].iter_mut().zip(&term.weight) {
                *weight += own * share;
            }
        }
        for (term, &share) in self.terms.iter().zip(shares).filter(|(_, share)| **share > 0.0) {
            let away = &term.mean - &mean;
            self.fused += &term.fused * share;
            self.fused.ger(share, &away, &away, 1.0);
        }
        let m = mean.len();
        let factors: Vec<f64> = (0..m)
            .map(|i| {
                let outside = |h: f64| {
                    let tails = |(term, share): (&Term<D>, &f64)| {
                        let (away, s) = (term.mean[i] - mean[i], term.fused[(i, i)].sqrt());
                        let of = |h: f64| normal_two_sided(h / s);
                        0.5 * share * (of(h - away) + of(h + away))
                    };
                    self.terms.iter().zip(shares).filter(|(_, w)| **w > 0.0).map(tails).sum()
                };
                let sigma = self.fused[(i, i)].sqrt();
                two_sigma(outside, sigma) / sigma
            })
            .collect();
        for (i, j) in (0..m).flat_map(|i| (0..m).map(move |j| (i, j))) {
            self.fused[(i, j)] *= factors[i] * factors[j];
        }
        crate::base::matrix::symmetrise(&mut self.fused);
    }
}
