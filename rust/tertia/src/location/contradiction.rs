//! By how much the measurements of a batch contradict each other more than their sigmas allow.
//!
//! What a position cannot explain stays in the residuals: of kind c, `N_c = Σ r²` of `H_c = Σ (1 −
//! h)` degrees of freedom, with leverages h, of least squares without the outliers. The factor
//! `φ_c ← φ_c N_c / H_c` of the variances, with new positions each time, converges to the maximum
//! of the restricted likelihood (Patterson, Thompson 1971).
//!
//! Where outliers are rejected, few measurements of a kind may be taken for outliers one after the
//! other, so that nothing is left that contradicts. So the rounds start once more from the factors
//! of least squares, and where that leads elsewhere, the larger restricted likelihood counts, of
//! normal errors and a share of outliers. Sigmas that are far too small leave many instants without
//! a position: if there are many, all that is redundant there counts as outliers.
//!
//! What is stated of a variance but does not scatter is an error that all stations share: position
//! and stations do not tell it apart from none, so it is part of the covariance.
//!
//! An error that lasts is the same contradiction again and again. With the correlation `ρ_l` of
//! residuals that are l instants apart, about zero, n instants count as `n / (1 + 2 Σ ρ_l²)`
//! (Bartlett 1935, for squares).

use super::evidence::{ByShare, Evidence, Kept};
use super::fix::{Fix, Instant, Output, Status};
use super::growth::{agreeing, growth_of_all};
use super::lane::LANES;
use super::solver::{Locator, Workspace};
use crate::base::angle::median;
use crate::base::distribution::{chi_square_upper_quantile, fisher_upper_quantile};
use crate::sensors::{KINDS, Kind};

/// So many instants, evenly spread, tell enough of a batch.
pub(super) const SAMPLE: usize = 256;
/// Most rounds, and the change of every factor that ends them.
const ROUNDS: usize = 12;
const SETTLED: f64 = 0.01;
/// Degrees of freedom below which nothing is learnt.
const LEAST_FREEDOM: f64 = 1e-6;
const OUTSIDE: f64 = 0.05;
/// Degrees of freedom for which sigmas of one kind count that are as wrong as those of the others:
/// the few residuals of a kind that others hardly check may agree by chance.
const ALIKE: f64 = 10.0;
/// One-sided 99 % of a normal variable; the scatter, in stated variances, below which there is none.
const SURELY: f64 = 2.326;
/// Chance that an instant of a batch with normal errors has far larger residuals.
const HEAVY: f64 = 0.01;
const LEAST_SCATTER: f64 = 1e-6;
/// Share of outliers from which on they may be sigmas that are too small.
const MANY: f64 = 0.03;
/// Share of instants without a position from which on they count: a few are lost to outliers alone.
const LOST: f64 = 0.3;
/// Largest standard deviation of the errors of angles, in radians: with larger ones, they show no direction, and
/// their errors are not normal.
pub(super) const WIDEST: f64 = 0.5;
/// What a batch says of the errors of each kind of measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contradiction {
    /// Factor of the variances, with what is not known of it: see [`Contradiction::apply`].
    pub growth: [f64; KINDS],
    /// The factor alone; 1 where nothing contradicts.
    pub factor: [f64; KINDS],
    /// Degrees of freedom of the factor, less for errors that last.
    pub degrees_of_freedom: [f64; KINDS],
    /// Share of the stated variance that does not scatter, and must be common to all stations.
    pub common: [f64; KINDS],
    /// Whether residuals of some instants are far larger than those of larger noise.
    pub is_heavy: bool,
}

impl Contradiction {
    /// Nothing contradicts.
    pub const NONE: Self = Self {
        growth: [1.0; KINDS],
        factor: [1.0; KINDS],
        degrees_of_freedom: [0.0; KINDS],
        common: [0.0; KINDS],
        is_heavy: false,
    };

    /// Multiplies standard deviations, of the 5 K measurements of each instant, where they are
    /// `free`. Those that are not known are taken as 1.
    pub fn apply(&self, sigmas: &mut [f64], free: &[bool]) {
        stretch(sigmas, free, &self.growth);
    }

    /// By how much the variance of what all instants have in common grows: errors that last do not
    /// average out, so so many instants, with this redundancy, count as those of the degrees of freedom.
    pub fn lasting(&self, redundancy: f64, count: usize) -> f64 {
        let all = redundancy * count.min(SAMPLE) as f64;
        let of = |(growth, own): (&f64, &f64)| match *growth > 1.0 && *own > 0.0 {
            true => growth * (all / own).max(1.0),
            false => 1.0,
        };
        self.growth.iter().zip(&self.degrees_of_freedom).map(of).fold(1.0, f64::max)
    }

    /// The share of so many degrees of freedom that counts: less for errors that last.
    pub(super) fn independent(&self, freedom: &[f64; KINDS]) -> f64 {
        let all: f64 = freedom.iter().sum();
        (self.degrees_of_freedom.iter().sum::<f64>() / all).min(1.0)
    }

    /// Whether any variance changes.
    pub fn is_any(&self) -> bool {
        self.growth != [1.0; KINDS]
    }
}

pub(super) fn stretch(sigmas: &mut [f64], free: &[bool], factor: &[f64; KINDS]) {
    let stations = free.len() / KINDS;
    for instant in sigmas.chunks_mut(free.len()) {
        for (place, sigma) in instant.iter_mut().enumerate().filter(|(place, _)| free[*place]) {
            let known = if sigma.is_nan() { 1.0 } else { *sigma };
            *sigma = known * factor[place / stations].sqrt();
        }
    }
}

/// The instants that are asked, and which of their sigmas may be wrong.
struct Problem<'a> {
    sample: &'a [Instant<'a>],
    free: &'a [bool],
    pooled: bool,
}

impl Problem<'_> {
    /// Whether angles still have a direction, with these factors of their variances.
    fn has_directions(&self, factor: &[f64; KINDS]) -> bool {
        let stations = self.free.len() / KINDS;
        let is_direction = |instant: &Instant<'_>, place: usize| {
            let kind = place / stations;
            let sigma = instant.sigmas[place] * factor[kind].sqrt();
            let counts = self.free[place] && Kind::ALL[kind].is_angle() && !self.pooled;
            !counts || instant.values[place].is_nan() || sigma <= WIDEST
        };
        self.sample.iter().all(|own| (0..self.free.len()).all(|place| is_direction(own, place)))
    }
}

/// What the residuals of all instants add up to.
#[derive(Default)]
struct Sums {
    square: [f64; KINDS],
    freedom: [f64; KINDS],
    /// 5 K residuals of each instant, 0 where there is none.
    residual: Vec<f64>,
    /// Restricted log likelihood of each instant, by the share of outliers; nan where there is no
    /// position.
    likelihood: Vec<ByShare>,
    /// The same if all that is redundant were outliers.
    none: Vec<ByShare>,
    /// Measurements without and with weight.
    rejected: f64,
    kept: f64,
    /// Instants with redundant measurements that have no position, and that have one.
    lost: f64,
    found: f64,
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
        let mut start = [1.0; KINDS];
        if pooled {
            let Some(first) = self.first_factor(&sample, workspace) else {
                return Contradiction { growth: [f64::NAN; KINDS], ..Contradiction::NONE };
            };
            start = [first; KINDS];
        }
        let problem = Problem { sample: &sample, free, pooled };
        let (mut factor, mut sums) = self.settled(&problem, start, workspace);
        let many = sums.rejected > MANY * sums.kept || sums.lost > MANY * sums.found;
        let doubtful = factor != start || many;
        if doubtful && self.is_robust() {
            // few measurements of a kind may all be taken for outliers, one after the other
            let (above, _) = self.plain().settled(&problem, start, workspace);
            let (other, others) = self.settled(&problem, above, workspace);
            if problem.has_directions(&other) && others.explains_better_than(&sums) {
                (factor, sums) = (other, others);
            }
        }
        let is_heavy = !pooled && factor != start && sums.are_heavy(count);
        let mut found = Contradiction { factor, is_heavy, ..Contradiction::NONE };
        let total: f64 = sums.freedom.iter().sum();
        let others = |freedom: f64| ALIKE.min(total - freedom);
        for kind in 0..KINDS {
            let freedom = sums.freedom[kind];
            if freedom <= LEAST_FREEDOM {
                found.factor[kind] = 1.0;
                continue;
            }
            let own = freedom * sums.independent(kind, count);
            let effective = own + others(freedom);
            found.degrees_of_freedom[kind] = effective;
            let scatter = sums.square[kind] / freedom;
            if !pooled && factor[kind] == 1.0 && scatter > LEAST_SCATTER {
                let most = scatter * (1.0 + SURELY * (2.0 / own).sqrt());
                found.common[kind] = (1.0 - most).max(0.0);
            }
            found.growth[kind] = if pooled {
                factor[kind] * student::<D>(effective)
            } else {
                growth_of_all::<D>(factor[kind] * effective, effective)
            };
        }
        found
    }

    /// The factors to which rounds of estimation lead, and the sums there.
    fn settled<const D: usize>(
        &self,
        problem: &Problem<'_>,
        start: [f64; KINDS],
        workspace: &mut Workspace<D>,
    ) -> ([f64; KINDS], Sums) {
        let mut factor = start;
        let mut round = 0;
        loop {
            let mut sums = self.sums(problem, &factor, workspace);
            let known = |kind: &usize| sums.freedom[*kind] > LEAST_FREEDOM;
            let kinds: Vec<usize> = (0..KINDS).filter(known).collect();
            let contradicts = |&kind: &usize| {
                factor[kind] != 1.0 || sums.square[kind] > agreeing(sums.freedom[kind])
            };
            if !problem.pooled && !kinds.iter().any(contradicts) {
                return (factor, sums);
            }
            let least = if problem.pooled { f64::MIN_POSITIVE } else { 1.0 };
            for &kind in &kinds {
                sums.square[kind] *= factor[kind];
            }
            let common = sums.common();
            let mut change = 0.0_f64;
            for &kind in &kinds {
                let (square, freedom) = (sums.square[kind], sums.freedom[kind]);
                let next = ((square + ALIKE * common) / (freedom + ALIKE)).max(least);
                change = change.max((next / factor[kind]).ln().abs());
                factor[kind] = next;
            }
            round += 1;
            if round == ROUNDS || change < SETTLED {
                return (factor, sums);
            }
        }
    }

    /// The variance that the instants have in the median, 1 where sigmas are known; none if nothing
    /// tells.
    fn first_factor<const D: usize>(
        &self,
        sample: &[Instant<'_>],
        workspace: &mut Workspace<D>,
    ) -> Option<f64> {
        let mut factors = Vec::new();
        for block in sample.chunks(LANES) {
            self.descend(block, workspace);
            for (lane, instant) in block.iter().enumerate() {
                let fix = self.finished(instant, lane, workspace);
                let freedom = fix.degrees_of_freedom;
                if fix.status != Status::None || freedom < 1 {
                    continue;
                }
                let middle = chi_square_upper_quantile(0.5, freedom as usize) / freedom as f64;
                let known = fix.sigma.is_nan();
                factors.push(if known { 1.0 } else { fix.sigma * fix.sigma / middle });
            }
        }
        let found = (!factors.is_empty()).then(|| median(&mut factors));
        found.filter(|factor| *factor > 0.0 && factor.is_finite())
    }

    /// Finishes an instant of a block, for what it leaves in the workspace.
    fn finished<const D: usize>(
        &self,
        instant: &Instant<'_>,
        lane: usize,
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
        self.one(instant, lane, &mut out, workspace)
    }

    /// Squares and degrees of freedom of the residuals with these factors of the variances.
    fn sums<const D: usize>(
        &self,
        problem: &Problem<'_>,
        factor: &[f64; KINDS],
        workspace: &mut Workspace<D>,
    ) -> Sums {
        let mut sums = Sums::default();
        for block in problem.sample.chunks(LANES) {
            let mut sigmas: Vec<_> = block.iter().map(|own| own.sigmas.to_vec()).collect();
            sigmas.iter_mut().for_each(|own| stretch(own, problem.free, factor));
            let instants: Vec<_> = block
                .iter()
                .zip(&sigmas)
                .map(|(instant, sigmas)| Instant { sigmas, ..*instant })
                .collect();
            self.descend(&instants, workspace);
            for (lane, instant) in instants.iter().enumerate() {
                self.add(instant, lane, (problem.free, factor), workspace, &mut sums);
            }
        }
        sums
    }

    /// Adds an instant of a block.
    fn add<const D: usize>(
        &self,
        instant: &Instant<'_>,
        lane: usize,
        (free, factor): (&[bool], &[f64; KINDS]),
        workspace: &mut Workspace<D>,
        sums: &mut Sums,
    ) {
        let at = sums.residual.len();
        sums.residual.resize(at + free.len(), 0.0);
        sums.likelihood.push(ByShare::default().map(|_| f64::NAN));
        sums.none.push(ByShare::default().map(|_| f64::NAN));
        let fix = self.finished(instant, lane, workspace);
        if fix.degrees_of_freedom < 1 {
            return;
        }
        if fix.status != Status::None {
            sums.lost += 1.0;
            return;
        }
        sums.found += 1.0;
        if let Some(evidence) = self.evidence(instant, lane, (free, factor), workspace) {
            sums.add(&evidence, at, free.len() / KINDS);
        }
    }
}

impl Sums {
    fn add(&mut self, evidence: &Evidence, at: usize, stations: usize) {
        self.kept += evidence.kept as f64;
        self.rejected += evidence.rejected as f64;
        for &Kept { place, residual, square, freedom } in &evidence.free {
            self.square[place / stations] += square;
            self.freedom[place / stations] += freedom;
            self.residual[at + place] = residual;
        }
        if let (Some(own), Some(other)) = (self.likelihood.last_mut(), self.none.last_mut()) {
            (*own, *other) = (evidence.likelihood, evidence.none);
        }
    }

    /// The factor that all kinds have in common.
    fn common(&self) -> f64 {
        self.square.iter().sum::<f64>() / self.freedom.iter().sum::<f64>()
    }

    /// Whether instants that are located with either are likelier, with the better share of outliers.
    fn explains_better_than(&self, other: &Self) -> bool {
        let mut sums = [ByShare::default(); 2];
        for at in 0..self.likelihood.len() {
            let [mut own, mut others] = [self.likelihood[at], other.likelihood[at]];
            if own[0].is_nan() && self.loses_many() {
                own = other.none[at];
            }
            if others[0].is_nan() && other.loses_many() {
                others = self.none[at];
            }
            // of what has no position with either, nothing is known
            if own[0].is_nan() || others[0].is_nan() {
                continue;
            }
            for i in 0..own.len() {
                sums[0][i] += own[i];
                sums[1][i] += others[i];
            }
        }
        let [own, others] = sums.map(|sum| sum.into_iter().fold(f64::NEG_INFINITY, f64::max));
        own > others
    }

    /// Whether many instants have no position.
    fn loses_many(&self) -> bool {
        self.lost > LOST * (self.lost + self.found)
    }

    /// Whether the residuals of an instant, of so many, are larger than normal ones.
    fn are_heavy(&self, count: usize) -> bool {
        let freedom = (self.freedom.iter().sum::<f64>() / self.found).ceil() as usize;
        let limit = chi_square_upper_quantile(HEAVY / count as f64, freedom.max(1));
        let of = |own: &[f64]| own.iter().map(|r| r * r).sum::<f64>();
        self.residual.chunks(self.residual.len() / count).any(|own| of(own) > limit)
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
