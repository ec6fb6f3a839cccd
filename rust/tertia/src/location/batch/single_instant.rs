//! Size of the errors of a single instant whose measurements contradict the stated sigmas.
//!
//! If the sigmas are too small, few measurements agree, and those by chance; the others are taken for
//! outliers, and the remaining ones show no contradiction. Therefore all residuals, including those of
//! outliers, are tested at 10 %. If they fail, either the noise is as stated, or its variances are
//! larger by a factor φ, with the prior of [`growth`](crate::location::solver::growth) for residuals that are the only
//! evidence about φ. Each φ has its own outliers, its own position, and its own restricted likelihood,
//! averaged over shares of outliers. The position is that of the most probable φ, or that of φ = 1 if
//! it needs no outliers. The error is a mixture of normal distributions about the positions for all φ,
//! and the 95 % ellipse contains 95 % of the mixture.

use super::contradiction::{WIDEST, stretch};
use super::normals::{self, Normal};
use crate::base::distribution::chi_square_upper;
use crate::location::search::fix::{Fix, Instant, Output, Solution, Status};
use crate::location::solver::growth::{DOUBTED, OUTSIDE, SCALE};
use crate::location::solver::{Locator, Workspace};
use crate::sensors::{KINDS, Kind};

/// p-value below which residuals are too large.
const CONTRADICTS: f64 = 0.1;
/// Factors of the variances are 1 and the powers of two up to this exponent.
pub(in crate::location) const DOUBLINGS: i32 = 13;
/// Difference in log weight from the most probable hypothesis beyond which no larger factors are tried.
pub(in crate::location) const UNLIKELY: f64 = 10.0;

/// The position for one size of the sigmas.
struct Hypothesis<const D: usize> {
    factor: f64,
    /// Probability of this size; its logarithm until [`settle`] has been called.
    weight: f64,
    fix: Fix,
    solution: Solution<D>,
    /// Whether the measurements bound the position: a region that is much larger than the distance from all
    /// stations reaches to infinity but for a likelihood that is hardly above its limit.
    is_bounded: bool,
}

impl Locator {
    /// Estimates the position of an instant without a batch, as [`Locator::locate`] does. The sigmas
    /// marked as `free` (5 K marks) may be too small.
    pub fn locate_alone<const D: usize>(
        &self,
        instant: &Instant<'_>,
        free: &[bool],
        out: &mut Output<'_>,
        workspace: &mut Workspace<D>,
    ) -> Fix {
        let fix = self.locate(instant, out, workspace);
        let several = fix.status == Status::Ambiguous && fix.degrees_of_freedom > 0;
        if !(fix.pvalue < CONTRADICTS || several && is_known(instant)) {
            return fix;
        }
        let mut all = self.hypotheses::<D>(instant, free, workspace);
        let Some(best) = settle(&mut all) else { return fix };
        let unbounded = all.iter().filter(|own| !own.is_bounded);
        if unbounded.map(|own| own.weight).sum::<f64>() > OUTSIDE {
            out.position.fill(f64::NAN);
            out.covariance.fill(f64::NAN);
            return Fix { status: Status::IllConditioned, ..Fix::UNKNOWN };
        }
        all[best].write(growth(&all, best), free, out)
    }

    /// Returns the positions for all sizes of the sigmas that have one.
    fn hypotheses<const D: usize>(
        &self,
        instant: &Instant<'_>,
        free: &[bool],
        workspace: &mut Workspace<D>,
    ) -> Vec<Hypothesis<D>> {
        let mut found: Vec<Hypothesis<D>> = Vec::new();
        let mut highest = f64::NEG_INFINITY;
        for doublings in 0..=DOUBLINGS {
            let factor = 2.0_f64.powi(doublings);
            let mut sigmas = instant.sigmas.to_vec();
            stretch(&mut sigmas, free, &[factor; KINDS]);
            let stretched = Instant { sigmas: &sigmas, ..*instant };
            if doublings > 0 && !has_directions(&stretched, free) {
                break;
            }
            let Some(own) = self.hypothesis(&stretched, free, doublings, workspace) else {
                continue;
            };
            highest = highest.max(own.weight);
            let is_beyond = own.weight < highest - UNLIKELY;
            found.push(own);
            if is_beyond {
                break;
            }
        }
        found
    }

    fn hypothesis<const D: usize>(
        &self,
        instant: &Instant<'_>,
        free: &[bool],
        doublings: i32,
        workspace: &mut Workspace<D>,
    ) -> Option<Hypothesis<D>> {
        let factor = 2.0_f64.powi(doublings);
        let mut solution = Solution::of(instant);
        let fix = self.locate(instant, &mut solution.output(), workspace);
        if !matches!(fix.status, Status::None | Status::IllConditioned) {
            return None;
        }
        let evidence = self.evidence(instant, 0, (free, &[factor; KINDS]), workspace)?;
        let likelihood = evidence.likelihood.by_share();
        let sum: f64 = likelihood.iter().map(|l| (l - likelihood[0]).exp()).sum();
        let weight = likelihood[0] + sum.ln() + prior(doublings).ln();
        let is_bounded = fix.status == Status::None && is_within_distance(instant, &solution);
        Some(Hypothesis { factor, weight, fix, solution, is_bounded })
    }
}

/// Largest standard deviation of a bounded position, relative to its distance from the farthest station.
const FAR: f64 = 6.0;

/// Whether the standard deviation of a position is smaller than a few times its distance from the farthest
/// station.
fn is_within_distance<const D: usize>(instant: &Instant<'_>, solution: &Solution<D>) -> bool {
    let square = |station: &[f64]| {
        station.iter().zip(&solution.position).map(|(s, p)| (p - s) * (p - s)).sum::<f64>()
    };
    let farthest = instant.stations.chunks_exact(D).map(square).fold(0.0, f64::max);
    (0..D).map(|i| solution.covariance[i][i]).sum::<f64>() < FAR * FAR * farthest
}

impl<const D: usize> Hypothesis<D> {
    /// Writes the position and the residuals, and the covariance multiplied by a factor.
    fn write(&self, growth: f64, free: &[bool], out: &mut Output<'_>) -> Fix {
        let Solution { position, covariance, residual, outlier } = &self.solution;
        out.position.copy_from_slice(position);
        for (to, from) in out.covariance.iter_mut().zip(covariance.as_flattened()) {
            *to = growth * from;
        }
        out.outlier.copy_from_slice(outlier);
        let unit = self.factor.sqrt();
        // residuals are in units of the stated sigmas
        for ((to, from), &free) in out.residual.iter_mut().zip(residual).zip(free) {
            *to = if free { unit * from } else { *from };
        }
        let squares = out.residual.iter().filter(|u| !u.is_nan()).map(|u| u * u);
        let statistic = if unit == 1.0 { self.fix.statistic } else { squares.sum() };
        Fix {
            statistic,
            pvalue: chi_square_upper(statistic, self.fix.degrees_of_freedom as usize),
            emission_sigma: growth.sqrt() * self.fix.emission_sigma,
            ..self.fix
        }
    }
}

/// Whether all sigmas are known.
fn is_known(instant: &Instant<'_>) -> bool {
    instant.values.iter().zip(instant.sigmas).all(|(v, sigma)| v.is_nan() || !sigma.is_nan())
}

/// Prior probability of a factor φ: [`DOUBTED`] for φ = 1, otherwise `√(φ − 1)` has a half-Cauchy
/// distribution.
pub(in crate::location) fn prior(doublings: i32) -> f64 {
    let density = |k: i32| {
        let factor = 2.0_f64.powi(k);
        let t = (factor - 1.0).sqrt();
        factor / t / (1.0 + (t / SCALE).powi(2))
    };
    match doublings {
        0 => DOUBTED,
        k => (1.0 - DOUBTED) * density(k) / (1..=DOUBLINGS).map(density).sum::<f64>(),
    }
}

/// Whether the free sigmas of angles are small enough for the angles to show a direction.
fn has_directions(instant: &Instant<'_>, free: &[bool]) -> bool {
    let stations = free.len() / KINDS;
    (0..free.len()).all(|place| {
        let counts = free[place] && Kind::ALL[place / stations].is_angle();
        !counts || instant.values[place].is_nan() || instant.sigmas[place] <= WIDEST
    })
}

/// Turns log weights into probabilities and returns the index of the hypothesis that gives the
/// position: the stated sigmas if they need no outliers, otherwise the most probable ones. Returns
/// `None` if there is no hypothesis.
fn settle<const D: usize>(all: &mut [Hypothesis<D>]) -> Option<usize> {
    let likeliest = (0..all.len()).max_by(|&a, &b| all[a].weight.total_cmp(&all[b].weight))?;
    let highest = all[likeliest].weight;
    let total: f64 = all.iter().map(|own| (own.weight - highest).exp()).sum();
    all.iter_mut().for_each(|own| own.weight = (own.weight - highest).exp() / total);
    let fits = all[0].factor == 1.0 && !all[0].solution.outlier.contains(&true);
    Some(if fits { 0 } else { likeliest })
}

/// Returns the factor, at least 1, of the covariance of the best hypothesis for which its 95 % ellipse
/// contains 95 % of the mixture.
fn growth<const D: usize>(all: &[Hypothesis<D>], best: usize) -> f64 {
    let of = |own: &Hypothesis<D>| Normal {
        weight: own.weight,
        position: own.solution.position,
        covariance: own.solution.covariance,
    };
    let bounded: Vec<_> = all.iter().filter(|own| own.is_bounded).map(of).collect();
    let Solution { position, covariance, .. } = &all[best].solution;
    normals::growth(bounded.iter(), position, covariance).max(1.0)
}
