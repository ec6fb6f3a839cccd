//! Covariance intersection of any number of estimates at once.
//!
//! The bound of the covariance is `(Σ ω_k C_k)^-1`, `C_k = S_k^-1`, with shares ω_k ≥ 0 whose sum
//! is 1. It equals the fused covariance of independent estimates with the covariances `S_k / ω_k`, so
//! no covariance needs to be inverted here either.
//!
//! The shares minimise the determinant of the bound. Its trace would depend on the units, and would
//! add numbers of different units. With `W_k`, the weights of independent estimates, the determinant
//! is least where `φ = ln det Σ ω_k W_k` is largest. φ is concave, and `g_k = ∂φ/∂ω_k = tr N_k`,
//! `−∂²φ/∂ω_j∂ω_k = tr N_j N_k`, `N_k = (Σ ω_j W_j)^-1 W_k`. As `Σ ω_k g_k = m`, the shares that
//! maximise `φ − m Σ ω_k` have the sum 1 without a further constraint. They are found by a primal-dual
//! interior point method, which treats all estimates alike: equal estimates get equal shares.

use crate::base::error::{Error, Result};
use crate::base::matrix::{Square, large, solve_definite, zeros};
use crate::base::scratch::refill;
use crate::weights::Group;
use nalgebra::allocator::Allocator;
use nalgebra::{DMatrix, DefaultAllocator, Dim};

/// Largest error of the logarithm of the determinant at which the search ends.
const GAP: f64 = 1e-13;
/// If the gradient differs from m by less than this, equal shares are optimal.
const TIE: f64 = 1e-12;
/// Largest error of the gradient at which the search ends.
const GRADIENT: f64 = 1e-9;
/// Largest number of steps; 20 is the largest number observed.
const MAX_STEPS: usize = 60;
/// Largest share of the distance to a bound that one step may cover.
const TO_BOUND: f64 = 0.9995;
/// Largest ratio of the barrier of a step to the mean gap before the step.
const CLOSING: f64 = 0.1;

/// Weights and bound of a covariance intersection, with its buffers.
#[derive(Clone, Debug)]
pub(super) struct Intersection<D: Dim>
where
    DefaultAllocator: Allocator<D, D>,
{
    /// W_k.
    pub weight: Vec<Square<D>>,
    /// Fusion of the estimates with the inflated covariances S_k / ω_k.
    group: Group<D>,
    inflated: Vec<Square<D>>,
    used: Vec<usize>,
    search: Search<D>,
}

/// The current point of the search, with the buffers for a step.
#[derive(Clone, Debug)]
struct Search<D: Dim>
where
    DefaultAllocator: Allocator<D, D>,
{
    /// W_k of independent estimates, in units of standard deviations.
    weight: Vec<Square<D>>,
    /// N_k.
    relative: Vec<Square<D>>,
    sum: Square<D>,
    /// ω_k.
    share: Vec<f64>,
    /// Multiplier of the constraint ω_k ≥ 0; converges to `m − g_k`.
    multiplier: Vec<f64>,
    gradient: Vec<f64>,
    curvature: DMatrix<f64>,
    /// Cholesky factor of the curvature including that of the barrier.
    factor: DMatrix<f64>,
    step: Vec<f64>,
}

impl<D: Dim> Intersection<D>
where
    DefaultAllocator: Allocator<D, D>,
{
    pub fn new(sensors: usize, order: D) -> Self {
        Self {
            weight: vec![zeros(order); sensors],
            group: Group::new(sensors, order),
            inflated: vec![zeros(order); sensors],
            used: Vec::with_capacity(sensors),
            search: Search::new(sensors, order),
        }
    }

    /// Sets the weights of these estimates, at most as many as there are sensors, and returns the bound.
    /// Cost O(K m³ + K² m² + K³) for each of about ten steps.
    pub fn intersect(&mut self, covariances: &[Square<D>]) -> Result<&Square<D>> {
        let count = covariances.len();
        self.group.weigh(covariances, None)?;
        self.search.start(&self.group.weight[..count], &covariances[0]);
        self.search.run();
        self.used.clear();
        for (k, (covariance, &share)) in covariances.iter().zip(&self.search.share).enumerate() {
            if share > 0.0 {
                let inflated = &mut self.inflated[self.used.len()];
                inflated.copy_from(covariance);
                *inflated /= share;
                self.used.push(k);
            }
        }
        let inflated = &self.inflated[..self.used.len()];
        let place = |error: Error| error.renumbered(&self.used);
        self.group.weigh(inflated, None).map_err(place)?;
        self.group.fuse(inflated, None).map_err(place)?;
        self.group.require_known()?;
        self.weight[..count].iter_mut().for_each(|weight| weight.fill(0.0));
        for (at, &k) in self.used.iter().enumerate() {
            self.weight[k].copy_from(&self.group.weight[at]);
        }
        Ok(&self.group.fused)
    }
}

impl<D: Dim> Search<D>
where
    DefaultAllocator: Allocator<D, D>,
{
    fn new(sensors: usize, order: D) -> Self {
        let numbers = || vec![0.0; sensors];
        Self {
            weight: vec![zeros(order); sensors],
            relative: vec![zeros(order); sensors],
            sum: zeros(order),
            share: numbers(),
            multiplier: numbers(),
            gradient: numbers(),
            curvature: large(sensors),
            factor: large(sensors),
            step: numbers(),
        }
    }

    /// Starts with equal shares. `units` is any covariance in the units of the estimates.
    fn start(&mut self, weight: &[Square<D>], units: &Square<D>) {
        let (count, m) = (weight.len(), units.nrows());
        for (scaled, weight) in self.weight.iter_mut().zip(weight) {
            for j in 0..m {
                for i in 0..m {
                    let unit = (units[(j, j)] / units[(i, i)]).sqrt();
                    scaled[(i, j)] = weight[(i, j)] * unit;
                }
            }
        }
        for list in [&mut self.share, &mut self.multiplier, &mut self.gradient, &mut self.step] {
            refill(list, count, 0.0);
        }
        self.share.fill(1.0 / count as f64);
        if self.curvature.nrows() != count {
            (self.curvature, self.factor) = (large(count), large(count));
        }
    }

    /// Finds the shares; shares smaller than their multiplier are set to zero.
    fn run(&mut self) {
        for step in 0..MAX_STEPS {
            if !self.differentiate() {
                break;
            }
            if step == 0 {
                self.start_multipliers();
            }
            let pairs = self.share.iter().zip(&self.multiplier);
            let gap = pairs.map(|(share, multiplier)| share * multiplier).sum::<f64>();
            if gap <= GAP && self.largest_error() <= GRADIENT {
                break;
            }
            let mean = gap / self.share.len() as f64;
            let barrier = (CLOSING * mean).min(mean * mean).max(CLOSING * GAP);
            if !self.solve(barrier) {
                break;
            }
            self.advance(barrier);
        }
        for (share, multiplier) in self.share.iter_mut().zip(&self.multiplier) {
            if *share < *multiplier {
                *share = 0.0;
            }
        }
        let sum: f64 = self.share.iter().sum();
        self.share.iter_mut().for_each(|share| *share /= sum);
    }

    /// Sets the initial multipliers: above zero, or all zero if equal shares are already optimal.
    fn start_multipliers(&mut self) {
        let m = self.sum.nrows() as f64;
        let farthest = self.gradient.iter().map(|g| (m - g).abs()).fold(0.0, f64::max);
        let least = if farthest > TIE { farthest.min(m) } else { 0.0 };
        for (multiplier, gradient) in self.multiplier.iter_mut().zip(&self.gradient) {
            *multiplier = if least > 0.0 { (m - gradient).max(0.0) + least } else { 0.0 };
        }
    }

    /// Sets N_k, gradient and curvature.
    fn differentiate(&mut self) -> bool {
        let m = self.sum.nrows();
        self.sum.fill(0.0);
        for (&share, weight) in self.share.iter().zip(&self.weight) {
            for (sum, &w) in self.sum.iter_mut().zip(weight.iter()) {
                *sum += share * w;
            }
        }
        if !self.sum.try_inverse_mut() {
            return false;
        }
        for (k, gradient) in self.gradient.iter_mut().enumerate() {
            self.sum.mul_to(&self.weight[k], &mut self.relative[k]);
            *gradient = self.relative[k].trace();
            for j in 0..=k {
                let (a, b) = (&self.relative[j], &self.relative[k]);
                let row = |i: usize| (0..m).map(|p| a[(i, p)] * b[(p, i)]).sum::<f64>();
                self.curvature[(k, j)] = (0..m).map(row).sum();
            }
        }
        true
    }

    /// Largest error of the condition `multiplier = m − gradient`.
    fn largest_error(&self) -> f64 {
        let m = self.sum.nrows() as f64;
        let pairs = self.gradient.iter().zip(&self.multiplier);
        pairs.map(|(gradient, multiplier)| (m - gradient - multiplier).abs()).fold(0.0, f64::max)
    }

    /// Computes Newton's step towards `share · multiplier = barrier`.
    fn solve(&mut self, barrier: f64) -> bool {
        let (count, m) = (self.share.len(), self.sum.nrows() as f64);
        for k in 0..count {
            self.step[k] = self.gradient[k] - m + barrier / self.share[k];
        }
        self.factor.copy_from(&self.curvature);
        for k in 0..count {
            self.factor[(k, k)] += self.multiplier[k] / self.share[k];
        }
        solve_definite(&mut self.factor, &mut self.step)
    }

    /// Advances as far as the second-order expansion of the logarithm is valid, without reaching a bound.
    fn advance(&mut self, barrier: f64) {
        let count = self.share.len();
        let curved = |k: usize, j: usize| self.curvature[(k.max(j), k.min(j))] * self.step[j];
        let along: f64 =
            (0..count).map(|k| self.step[k] * (0..count).map(|j| curved(k, j)).sum::<f64>()).sum();
        let decrement = along.max(0.0).sqrt();
        let mut length = if decrement > 0.5 { 1.0 / (1.0 + decrement) } else { 1.0 };
        // the gradient is no longer needed
        let change = &mut self.gradient;
        for (k, change) in change.iter_mut().enumerate() {
            let (share, multiplier, step) = (self.share[k], self.multiplier[k], self.step[k]);
            *change = (barrier - multiplier * (share + step)) / share;
            for (value, step) in [(share, step), (multiplier, *change)] {
                if step < 0.0 {
                    length = length.min(-TO_BOUND * value / step);
                }
            }
        }
        let points = self.share.iter_mut().zip(&mut self.multiplier);
        for ((share, multiplier), (step, change)) in points.zip(self.step.iter().zip(change)) {
            *share += length * step;
            *multiplier += length * *change;
        }
    }
}
