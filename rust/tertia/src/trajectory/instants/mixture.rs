//! Mixture of noise and outliers: their sizes, the share of outliers, and the probabilities of each residual.

use crate::base::distribution::normal_two_sided_quantile;
use std::f64::consts::TAU;

/// Standard deviation of outliers relative to that of the noise: least value, expected value, and the number
/// of outliers that the expectation is worth.
const LEAST_WIDTH: f64 = 3.0;
const WIDTH: f64 = 10.0;
const WORTH: f64 = 2.0;
/// Share of outliers: initial value, largest value, and the least number of outliers. With this number, one
/// measurement is taken for an outlier in about 1 % of the records without outliers.
const SHARE: f64 = 0.1;
const LARGEST_SHARE: f64 = 0.5;
const LEAST_NUMBER: f64 = 0.5;
/// Prior numbers of late and of early outliers, which are added to the counts: a few outliers say little
/// about the others.
const EITHER: f64 = 5.0;
/// Quantile of the sizes of residuals from which the initial noise is taken, and the largest initial noise.
const LARGE: f64 = 0.9;
const LARGEST: f64 = 1000.0;
/// Initial noise below which it is taken as stated: the quantile is not more accurate.
const LARGER: f64 = 1.2;
/// Factor by which the noise is reduced in a step.
const STEP: f64 = 0.6;
/// Largest number of steps of expectation and maximisation, and the relative change of the share that ends
/// them.
const STEPS: usize = 30;
const SETTLED: f64 = 0.01;
/// One-sided 99 % quantile of the standard normal distribution.
const SURELY: f64 = 2.326;

/// Noise and outliers, both normal, in units of the stated standard deviations.
#[derive(Clone, Debug)]
pub(in crate::trajectory) struct Mixture {
    /// Share of outliers.
    share: f64,
    /// Standard deviations of the noise, and of the additional error of outliers.
    pub noise: f64,
    width: f64,
    /// Share of late ones among the outliers of signals that travel: a detour is never shorter.
    late: f64,
    /// ln of the likelihood of the residuals. If there are outliers, 1/2 ln N is subtracted for each of their
    /// parameters (Schwarz 1978), and 1 for each parameter of the path, because the path follows the
    /// measurements that agree with it.
    pub log_evidence: f64,
}

/// A residual about the path as predicted from the other measurements.
pub(in crate::trajectory) struct Compared {
    /// Index of the measurement in (N, 5, K).
    pub at: usize,
    pub residual: f64,
    /// Variance of the prediction.
    pub variance: f64,
    /// Contribution to the effective number of parameters of the path.
    pub held: f64,
    /// Whether the measurement is of a signal that travelled: a detour makes it late.
    pub travels: bool,
}

impl Mixture {
    /// Returns the initial mixture for a path that may follow outliers: the noise is as large as the
    /// residuals.
    pub fn new(mut sizes: Vec<f64>) -> Self {
        let at = (LARGE * sizes.len() as f64) as usize;
        let noise = match sizes.len() {
            0 => 1.0,
            _ => {
                let size = *sizes.select_nth_unstable_by(at, f64::total_cmp).1;
                let noise = size / normal_two_sided_quantile(1.0 - LARGE);
                if noise < LARGER { 1.0 } else { noise.min(LARGEST) }
            }
        };
        Self { share: SHARE, noise, width: WIDTH * noise, late: 0.5, log_evidence: 0.0 }
    }

    /// Returns the mixture with a smaller noise, if the noise is larger than stated.
    pub fn sharper(&self) -> Option<Self> {
        (self.noise > 1.0).then(|| Self { noise: (self.noise * STEP).max(1.0), ..self.clone() })
    }

    /// Densities of a residual as noise and as an outlier, each times its prior probability.
    pub fn densities(&self, one: &Compared) -> [f64; 2] {
        let inside = self.noise.powi(2) + one.variance;
        let outside = inside + self.width.powi(2);
        let density =
            |variance: f64| (-0.5 * one.residual * one.residual / variance).exp() / variance.sqrt();
        let side = match one.travels {
            true if one.residual > 0.0 => 2.0 * self.late,
            true => 2.0 * (1.0 - self.late),
            false => 1.0,
        };
        [(1.0 - self.share) * density(inside), side * self.share * density(outside)]
    }

    /// Lower bound of ln of the density of a residual that is noise with probability `trust`: the residual as
    /// noise does not include the error of the path.
    pub fn bound(&self, residual: f64, trust: f64) -> f64 {
        let normal =
            |variance: f64| -0.5 * (residual * residual / variance + (TAU * variance).ln());
        let inside = self.noise.powi(2);
        let part = |p: f64, share: f64, density: f64| {
            if p > 0.0 { p * (share.ln() + density - p.ln()) } else { 0.0 }
        };
        part(trust, 1.0 - self.share, normal(inside))
            + part(1.0 - trust, self.share, normal(inside + self.width.powi(2)))
    }

    /// Estimates the share and size of outliers and, unless it is held, the size of the noise, by expectation
    /// and maximisation.
    pub fn fit(&mut self, residuals: &[Compared], is_held: bool) {
        for _ in 0..STEPS {
            let before = self.share;
            self.step(residuals, is_held);
            if (self.share - before).abs() < SETTLED * before {
                break;
            }
        }
    }

    fn step(&mut self, residuals: &[Compared], is_held: bool) {
        let (mut total, mut squares, mut outside, mut log) = (0.0, 0.0, 0.0, 0.0);
        let (mut late, mut either) = (EITHER, 2.0 * EITHER);
        for one @ Compared { residual, variance, .. } in residuals {
            let square = residual * residual;
            let densities = self.densities(one);
            let trust = trust_of(densities);
            total += trust;
            if one.travels {
                either += 1.0 - trust;
                late += if *residual > 0.0 { 1.0 - trust } else { 0.0 };
            }
            squares += trust * square / (1.0 + variance / self.noise.powi(2));
            outside += (1.0 - trust) * (square - variance).max(0.0);
            log += (densities[0] + densities[1]).max(f64::MIN_POSITIVE).ln();
        }
        let count = residuals.len() as f64;
        let is_mixed = self.share * count > LEAST_NUMBER * (1.0 + SETTLED);
        let held: f64 = residuals.iter().map(|one| one.held).sum();
        self.log_evidence = log - if is_mixed { count.ln() + held } else { 0.0 };
        if total == 0.0 {
            return;
        }
        self.share = (1.0 - total / count).max(LEAST_NUMBER / count).min(LARGEST_SHARE);
        if !is_held {
            // the first paths may be wrong, and then the wrong measurements seem to be late
            self.late = late / either;
            let growth = squares / total;
            let by_chance = 1.0 + SURELY * (2.0 / total).sqrt();
            self.noise = if growth > by_chance { growth.sqrt() } else { 1.0 };
        }
        let expected = (WIDTH * self.noise).powi(2);
        let width = (WORTH * expected + outside) / (WORTH + count - total);
        self.width = width.sqrt().max(LEAST_WIDTH * self.noise);
    }
}

/// Probability that a residual with these densities belongs to the noise; 0 where both densities vanish.
pub(in crate::trajectory) fn trust_of([inside, outside]: [f64; 2]) -> f64 {
    if inside > 0.0 { inside / (inside + outside) } else { 0.0 }
}
