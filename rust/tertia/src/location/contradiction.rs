//! By how much the measurements of a batch contradict each other more than their sigmas allow.
//!
//! What a position cannot explain stays in the residuals: of kind c, `N_c = Σ w r²` of `H_c = Σ w
//! (1 − w h)` degrees of freedom, with the weights w and leverages h of the estimate. The factor
//! `φ_c ← φ_c N_c / H_c` of the variances, with new positions each time, converges to the maximum
//! of the restricted likelihood (Patterson, Thompson 1971).
//!
//! An error that lasts is the same contradiction again and again. With the correlation `ρ_l` of
//! residuals that are l instants apart, about zero, n instants count as `n / (1 + 2 Σ ρ_l²)`
//! (Bartlett 1935, for squares).

use super::descent::{Loss, TUKEY};
use super::fix::{Fix, Instant, Output, Status};
use super::growth::{agreeing, growth};
use super::record::Record;
use super::solver::{Locator, Workspace};
use super::summary::Expected;
use crate::base::angle::median;
use crate::base::distribution::{chi_square_upper_quantile, fisher_upper_quantile};
use crate::base::small::{Factor, Matrix, dot};
use crate::sensors::{KINDS, Row};

/// So many instants, evenly spread, tell enough of a batch.
const SAMPLE: usize = 256;
/// Most rounds, and the change of every factor that ends them.
const ROUNDS: usize = 12;
const SETTLED: f64 = 0.01;
/// Degrees of freedom below which nothing is learnt.
const LEAST_FREEDOM: f64 = 1e-6;
const OUTSIDE: f64 = 0.05;

/// What a batch says of the errors of each kind of measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contradiction {
    /// Factor of the variances, with what is not known of it: see [`Contradiction::apply`].
    pub growth: [f64; KINDS],
    /// The factor alone; 1 where nothing contradicts.
    pub factor: [f64; KINDS],
    /// Degrees of freedom of the factor, less for errors that last.
    pub degrees_of_freedom: [f64; KINDS],
}

impl Contradiction {
    /// Nothing contradicts.
    pub const NONE: Self =
        Self { growth: [1.0; KINDS], factor: [1.0; KINDS], degrees_of_freedom: [0.0; KINDS] };

    /// Multiplies standard deviations, of the 5 K measurements of each instant, where they are
    /// `free`. Those that are not known are taken as 1.
    pub fn apply(&self, sigmas: &mut [f64], free: &[bool]) {
        stretch(sigmas, free, &self.growth);
    }

    /// Whether any variance changes.
    pub fn is_any(&self) -> bool {
        self.growth != [1.0; KINDS]
    }
}

fn stretch(sigmas: &mut [f64], free: &[bool], factor: &[f64; KINDS]) {
    let stations = free.len() / KINDS;
    for instant in sigmas.chunks_mut(free.len()) {
        for (place, sigma) in instant.iter_mut().enumerate().filter(|(place, _)| free[*place]) {
            let known = if sigma.is_nan() { 1.0 } else { *sigma };
            *sigma = known * factor[place / stations].sqrt();
        }
    }
}

/// What the residuals of all instants add up to.
struct Sums {
    square: [f64; KINDS],
    freedom: [f64; KINDS],
    /// 5 K weighted residuals of each instant, 0 where there is none.
    residual: Vec<f64>,
}

impl Locator {
    /// How the instants contradict their sigmas, where these are `free` to be wrong (5 K marks).
    /// With `pooled` variances may shrink, too: sigmas are relative, or not known. O(N M), for at
    /// most 256 instants.
    pub fn contradiction<const D: usize>(
        &self,
        instants: &[Instant<'_>],
        free: &[bool],
        pooled: bool,
        workspace: &mut Workspace<D>,
    ) -> Contradiction {
        let count = instants.len().min(SAMPLE);
        let sample: Vec<_> = (0..count).map(|i| instants[i * instants.len() / count]).collect();
        let mut factor = [1.0; KINDS];
        if pooled {
            let Some(start) = self.first_factor(&sample, workspace) else {
                return Contradiction { growth: [f64::NAN; KINDS], ..Contradiction::NONE };
            };
            factor = [start; KINDS];
        }
        let mut sums;
        let mut round = 0;
        loop {
            sums = self.sums(&sample, free, &factor, workspace);
            let mut change = 0.0_f64;
            for kind in 0..KINDS {
                if sums.freedom[kind] <= LEAST_FREEDOM {
                    continue;
                }
                let agrees = sums.square[kind] <= agreeing(sums.freedom[kind]);
                sums.square[kind] *= factor[kind];
                if !pooled && factor[kind] == 1.0 && agrees {
                    continue;
                }
                let least = if pooled { f64::MIN_POSITIVE } else { 1.0 };
                let next = (sums.square[kind] / sums.freedom[kind]).max(least);
                change = change.max((next / factor[kind]).ln().abs());
                factor[kind] = next;
            }
            round += 1;
            if round == ROUNDS || change < SETTLED {
                break;
            }
        }
        let mut found = Contradiction { factor, ..Contradiction::NONE };
        for kind in 0..KINDS {
            let freedom = sums.freedom[kind];
            if freedom <= LEAST_FREEDOM {
                found.factor[kind] = 1.0;
                continue;
            }
            let effective = freedom * sums.independent(kind, count);
            found.degrees_of_freedom[kind] = effective;
            found.growth[kind] = if pooled {
                factor[kind] * student::<D>(effective)
            } else {
                growth::<D>(sums.square[kind] / freedom * effective, effective)
            };
        }
        found
    }

    /// The variance that the instants have in the median, 1 where sigmas are known; none if nothing
    /// tells.
    fn first_factor<const D: usize>(
        &self,
        sample: &[Instant<'_>],
        workspace: &mut Workspace<D>,
    ) -> Option<f64> {
        let mut factors = Vec::new();
        for instant in sample {
            let fix = self.located(instant, instant.sigmas, workspace);
            let freedom = fix.degrees_of_freedom;
            if fix.status != Status::None || freedom < 1 {
                continue;
            }
            let middle = chi_square_upper_quantile(0.5, freedom as usize) / freedom as f64;
            let known = fix.sigma.is_nan();
            factors.push(if known { 1.0 } else { fix.sigma * fix.sigma / middle });
        }
        let found = (!factors.is_empty()).then(|| median(&mut factors));
        found.filter(|factor| *factor > 0.0 && factor.is_finite())
    }

    fn located<const D: usize>(
        &self,
        instant: &Instant<'_>,
        sigmas: &[f64],
        workspace: &mut Workspace<D>,
    ) -> Fix {
        let (mut position, mut covariance) = ([0.0; D], vec![0.0; D * D]);
        let mut residual = vec![0.0; instant.values.len()];
        let mut outlier = vec![false; instant.values.len()];
        let mut out = Output {
            position: &mut position,
            covariance: &mut covariance,
            residual: &mut residual,
            outlier: &mut outlier,
        };
        self.locate(&Instant { sigmas, ..*instant }, &mut out, workspace)
    }

    /// Squares and degrees of freedom of the residuals with these factors of the variances.
    fn sums<const D: usize>(
        &self,
        sample: &[Instant<'_>],
        free: &[bool],
        factor: &[f64; KINDS],
        workspace: &mut Workspace<D>,
    ) -> Sums {
        let zero = [0.0; KINDS];
        let mut sums = Sums { square: zero, freedom: zero, residual: Vec::new() };
        for instant in sample {
            let at = sums.residual.len();
            sums.residual.resize(at + free.len(), 0.0);
            let mut sigmas = instant.sigmas.to_vec();
            stretch(&mut sigmas, free, factor);
            let fix = self.located(instant, &sigmas, workspace);
            if fix.status != Status::None || fix.degrees_of_freedom < 1 {
                continue;
            }
            let Workspace { records, plane, space, .. } = &*workspace;
            let of_arrivals = self.has_arrivals(instant);
            let loss = self.loss(fix.degrees_of_freedom as usize, of_arrivals);
            match (D, of_arrivals) {
                (_, false) => sums.add(loss, &records[0], free, at),
                (2, true) => sums.add(loss, &plane.0, free, at),
                _ => sums.add(loss, &space.0, free, at),
            }
        }
        sums
    }
}

impl Sums {
    fn add<const D: usize, const N: usize>(
        &mut self,
        loss: Loss,
        record: &Record<D, N>,
        free: &[bool],
        at: usize,
    ) {
        let Record { measurements, rows, places, .. } = record;
        let rows = || measurements.iter().zip(rows).zip(places);
        let mut normal: Matrix<N> = [[0.0; N]; N];
        for ((m, Row { residual, gradient }), _) in rows() {
            let (weight, ..) = loss.of(m.kind).at(*residual);
            for i in 0..N {
                for j in 0..N {
                    normal[i][j] += weight * gradient[i] * gradient[j];
                }
            }
        }
        let Some(factor) = Factor::try_new(&normal, 0.0) else { return };
        let spread = if loss == Loss::Tukey(TUKEY) { Expected::of_tukey(1.0).spread } else { 1.0 };
        let stations = free.len() / KINDS;
        for ((m, Row { residual, gradient }), &place) in rows().filter(|(_, place)| free[**place]) {
            let (weight, ..) = loss.of(m.kind).at(*residual);
            let leverage = dot(&factor.solve(gradient), gradient);
            let kind = place / stations;
            self.square[kind] += weight * residual * residual / spread;
            self.freedom[kind] += weight * (1.0 - weight * leverage).max(0.0);
            self.residual[at + place] = weight.sqrt() * residual;
        }
    }

    /// The share of so many instants that counts, of one kind.
    fn independent(&self, kind: usize, count: usize) -> f64 {
        let width = self.residual.len() / count;
        let stations = width / KINDS;
        let row = |t: usize| {
            let from = t * width + kind * stations;
            &self.residual[from..from + stations]
        };
        let product =
            |s: usize, t: usize| row(s).iter().zip(row(t)).map(|(a, b)| a * b).sum::<f64>();
        let total: f64 = (0..count).map(|t| product(t, t)).sum();
        if total == 0.0 {
            return 1.0;
        }
        let correlation =
            |lag: usize| (lag..count).map(|t| product(t - lag, t)).sum::<f64>() / total;
        let sum: f64 = (1..count).map(|lag| correlation(lag).powi(2)).sum();
        1.0 / (1.0 + 2.0 * sum)
    }
}

/// What makes an ellipse of 95 % hold as much if its scale has so many degrees of freedom.
fn student<const D: usize>(freedom: f64) -> f64 {
    let coordinates = D as f64;
    coordinates * fisher_upper_quantile(OUTSIDE, coordinates, freedom)
        / chi_square_upper_quantile(OUTSIDE, D)
}
