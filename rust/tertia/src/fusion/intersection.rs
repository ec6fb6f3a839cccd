//! Covariance intersection of any number of estimates at once.
//!
//! The bound of the covariance is `(Σ ω_k C_k)^-1`, `C_k = S_k^-1`, with shares ω_k ≥ 0 whose sum
//! is 1: the fused covariance of estimates that are independent and have the covariances
//! `S_k / ω_k`. So no covariance is inverted here either.
//!
//! The shares give the bound the least determinant. A trace would depend on the units, and add
//! numbers of different ones. With `W_k`, the weights of independent estimates, the determinant is
//! least where `φ = ln det Σ ω_k W_k` is largest; φ is concave, and `g_k = ∂φ/∂ω_k = tr N_k`,
//! `−∂²φ/∂ω_j∂ω_k = tr N_j N_k`, `N_k = (Σ ω_j W_j)^-1 W_k`. As `Σ ω_k g_k = m`, the shares that
//! maximise `φ − m Σ ω_k` have the sum 1 by themselves. They are found by an interior point method
//! (primal-dual), which treats all estimates alike: equal ones get equal shares.

use crate::base::error::{Error, Result};
use crate::base::matrix::{Square, large, solve_definite, zeros};
use crate::weights::Group;
use nalgebra::allocator::Allocator;
use nalgebra::{DMatrix, DefaultAllocator, Dim};

/// What the logarithm of the determinant may still be too large by.
const GAP: f64 = 1e-13;
/// Estimates that make less of a difference get equal shares.
const TIE: f64 = 1e-12;
/// Largest error of the gradient then.
const GRADIENT: f64 = 1e-9;
/// Seen: 20.
const MAX_STEPS: usize = 60;
/// Share of the way to a bound that a step goes at most.
const TO_BOUND: f64 = 0.9995;
/// How quickly the gap is closed at least.
const CLOSING: f64 = 0.1;

/// Weights and bound of a covariance intersection, and the buffers for them.
#[derive(Clone, Debug)]
pub(super) struct Intersection<D: Dim>
where
    DefaultAllocator: Allocator<D, D>,
{
    /// W_k.
    pub weight: Vec<Square<D>>,
    /// The weights of the inflated estimates.
    group: Group<D>,
    inflated: Vec<Square<D>>,
    used: Vec<usize>,
    search: Search<D>,
}

/// The point of the search, and the buffers for a step of it.
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
    /// Of the constraint ω_k ≥ 0: in the end `m − g_k`.
    multiplier: Vec<f64>,
    gradient: Vec<f64>,
    curvature: DMatrix<f64>,
    /// Of the curvature with that of the barrier.
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

    /// Sets the weights of all these estimates, as many as there is room for or fewer; returns the
    /// bound. Cost O(K m³ + K² m² + K³) for each of about ten steps.
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

    /// Starts with equal shares. `units` is a covariance in the units of the estimates.
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
            list.clear();
            list.resize(count, 0.0);
        }
        self.share.fill(1.0 / count as f64);
        if self.curvature.nrows() != count {
            (self.curvature, self.factor) = (large(count), large(count));
        }
    }

    /// Finds the shares; those that are not worth it become zero.
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

    /// Starts with multipliers that are above zero unless equal shares are the best.
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

    /// The largest error of `multiplier = m − gradient`.
    fn largest_error(&self) -> f64 {
        let m = self.sum.nrows() as f64;
        let pairs = self.gradient.iter().zip(&self.multiplier);
        pairs.map(|(gradient, multiplier)| (m - gradient - multiplier).abs()).fold(0.0, f64::max)
    }

    /// Newton's step towards `share · multiplier = barrier`.
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

    /// Goes as far as the logarithm is like its second-order expansion, and not to a bound.
    fn advance(&mut self, barrier: f64) {
        let count = self.share.len();
        let curved = |k: usize, j: usize| self.curvature[(k.max(j), k.min(j))] * self.step[j];
        let along: f64 =
            (0..count).map(|k| self.step[k] * (0..count).map(|j| curved(k, j)).sum::<f64>()).sum();
        let decrement = along.max(0.0).sqrt();
        let mut length = if decrement > 0.5 { 1.0 / (1.0 + decrement) } else { 1.0 };
        // the gradient is not needed any more
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
