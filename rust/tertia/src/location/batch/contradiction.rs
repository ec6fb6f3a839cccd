//! By how much the measurements of a batch contradict each other more than their sigmas allow.
//!
//! The residuals are what a position cannot explain. For kind c, they have the sum of squares
//! `N_c = Σ r²` and `H_c = Σ (1 − h)` degrees of freedom, with the leverages h, in a least-squares fit
//! without the outliers. The factor of the variances is updated by `φ_c ← φ_c N_c / H_c`, with new
//! positions each time; this converges to the maximum of the restricted likelihood (Patterson, Thompson
//! 1971).
//!
//! If outliers are rejected, a kind with few measurements may lose them one after the other as
//! outliers, until no contradiction is left. Therefore the rounds are repeated from the factors found
//! by least squares. If this leads to another result, the one with the larger restricted likelihood is
//! taken, for normal errors and a share of outliers. Sigmas that are far too small leave many instants
//! without a position; if there are many of these, all their redundant measurements count as outliers.
//!
//! If the residuals scatter less than the stated variance, the rest of the variance is an error that
//! all stations share. Such an error cannot be observed with these stations, so it is added to the
//! covariance.
//!
//! A lasting error repeats the same contradiction at many instants. With the correlation `ρ_l`, about
//! zero, of residuals that are l instants apart, n instants count as `n / (1 + 2 Σ ρ_l²)` (Bartlett
//! 1935, for squares).

use super::evidence::{ByShare, Evidence, Kept, Likelihood};
use crate::base::angle::median;
use crate::base::distribution::{chi_square_upper_quantile, fisher_upper_quantile};
use crate::location::descent::lane::LANES;
use crate::location::search::fix::{Fix, Instant, Solution, Status};
use crate::location::solver::growth::{agreeing, growth_of_all};
use crate::location::solver::{Locator, Workspace};
use crate::sensors::{KINDS, Kind, relative};

/// Largest number of instants of a batch, evenly spread, that are examined.
pub(in crate::location) const SAMPLE: usize = 256;
/// Largest number of rounds.
const ROUNDS: usize = 12;
/// Change of the logarithm of every factor below which the rounds end.
const SETTLED: f64 = 0.01;
/// Degrees of freedom of a kind below which nothing can be learnt about it.
const LEAST_FREEDOM: f64 = 1e-6;
const OUTSIDE: f64 = 0.05;
/// Weight, in degrees of freedom, of the assumption that the sigmas of a kind are as wrong as those of
/// all kinds together: if other kinds hardly check a kind, its few residuals may agree by chance.
const ALIKE: f64 = 10.0;
/// Quantile of the standard normal distribution for a one-sided test at 99 %.
const SURELY: f64 = 2.326;
/// Probability that the residuals of any instant count as far too large, in a batch with normal errors.
const HEAVY: f64 = 0.01;
const LEAST_SCATTER: f64 = 1e-6;
/// Share of outliers above which they may be due to sigmas that are too small.
const MANY: f64 = 0.03;
/// Share of instants without a position above which these count: a few are lost because of outliers
/// alone.
const LOST: f64 = 0.3;
/// Largest standard deviation of the errors of angles, in radians. With larger ones, angles show no
/// direction, and their errors are not normal.
pub(in crate::location) const WIDEST: f64 = 0.5;
/// Result for a batch: how wrong the sigmas of each kind of measurement are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contradiction {
    /// Factor of the variances, enlarged because it is uncertain; [`Contradiction::apply`] multiplies
    /// by it.
    pub growth: [f64; KINDS],
    /// The estimated factor itself; 1 if nothing contradicts.
    pub factor: [f64; KINDS],
    /// Effective degrees of freedom of the factor; lasting errors reduce them.
    pub degrees_of_freedom: [f64; KINDS],
    /// Share of the stated variance that does not show as scatter, and must be common to all stations.
    pub common: [f64; KINDS],
    /// Whether the residuals of some instants are far larger than those of normal noise with this factor.
    pub is_heavy: bool,
    /// Variance that the errors of a kind may have in addition, divided by that used as their weight: of kinds
    /// that are hardly checked.
    pub unchecked: [f64; KINDS],
    /// Mean redundancy number (Baarda 1968) of the measurements of each kind whose sigmas may be wrong: the
    /// share of an error that shows in the residuals; 1 if there are none.
    pub redundancy: [f64; KINDS],
}

impl Contradiction {
    /// Result if nothing contradicts.
    pub const NONE: Self = Self {
        growth: [1.0; KINDS],
        factor: [1.0; KINDS],
        degrees_of_freedom: [0.0; KINDS],
        common: [0.0; KINDS],
        is_heavy: false,
        unchecked: [0.0; KINDS],
        redundancy: [1.0; KINDS],
    };

    /// Multiplies the standard deviations of the 5 K measurements of each instant by the square root of
    /// the growth, where they are `free`. Unknown standard deviations are taken as 1.
    pub fn apply(&self, sigmas: &mut [f64], free: &[bool]) {
        stretch(sigmas, free, &self.growth);
    }

    /// Returns the factor by which the variance of a quantity common to all instants grows. Lasting
    /// errors do not average out, so `count` instants with this redundancy each are worth only the
    /// effective degrees of freedom.
    pub fn lasting(&self, redundancy: f64, count: usize) -> f64 {
        let all = redundancy * count.min(SAMPLE) as f64;
        let of = |(growth, own): (&f64, &f64)| match *growth > 1.0 && *own > 0.0 {
            true => growth * (all / own).max(1.0),
            false => 1.0,
        };
        self.growth.iter().zip(&self.degrees_of_freedom).map(of).fold(1.0, f64::max)
    }

    /// Returns the effective share of these degrees of freedom; lasting errors reduce it.
    pub(in crate::location) fn independent(&self, freedom: &[f64; KINDS]) -> f64 {
        let all: f64 = freedom.iter().sum();
        (self.degrees_of_freedom.iter().sum::<f64>() / all).min(1.0)
    }

    /// Whether any variance changes.
    pub fn is_any(&self) -> bool {
        self.growth != [1.0; KINDS]
    }
}

/// Multiplies the variances of each instant by factors, where they are `free`. Where others are known, nan
/// means that nothing is measured, as at the first station of range differences.
pub(in crate::location) fn stretch(sigmas: &mut [f64], free: &[bool], factor: &[f64; KINDS]) {
    let stations = free.len() / KINDS;
    for instant in sigmas.chunks_mut(free.len()) {
        let are_unknown = instant.iter().all(|sigma| sigma.is_nan());
        for (place, sigma) in instant.iter_mut().enumerate().filter(|(place, _)| free[*place]) {
            let own = if are_unknown { relative(*sigma) } else { *sigma };
            *sigma = own * factor[place / stations].sqrt();
        }
    }
}

/// The instants of the sample, and which of their sigmas may be wrong.
pub(in crate::location) struct Problem<'a> {
    pub sample: &'a [Instant<'a>],
    pub free: &'a [bool],
    pub pooled: bool,
}

impl Problem<'_> {
    /// Whether angles still show a direction with these factors of their variances.
    pub fn has_directions(&self, factor: &[f64; KINDS]) -> bool {
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

/// Sums over the residuals of all instants.
#[derive(Default)]
pub(in crate::location) struct Sums {
    square: [f64; KINDS],
    pub freedom: [f64; KINDS],
    /// Number of kept measurements whose sigmas may be wrong.
    counts: [f64; KINDS],
    /// 5 K residuals of each instant; 0 where there is none.
    residual: Vec<f64>,
    /// Restricted likelihood of each instant; `None` if it has no position.
    likelihood: Vec<Option<Likelihood>>,
    /// Number of rejected measurements.
    rejected: f64,
    /// Number of measurements that are not rejected.
    kept: f64,
    /// Number of instants with redundant measurements but without a position.
    lost: f64,
    /// Number of instants with redundant measurements and a position.
    found: f64,
}

impl Locator {
    /// Estimates by how much the instants contradict those of their sigmas that are `free` to be wrong
    /// (5 K marks). With `pooled`, sigmas are relative or unknown, and variances may also shrink.
    /// O(N M), for at most 256 instants.
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
            // all of the few measurements of a kind may have been rejected one after the other
            let (above, _) = self.plain().settled(&problem, start, workspace);
            let (other, others) = self.settled(&problem, above, workspace);
            if problem.has_directions(&other) && others.explains_better_than(&sums) {
                (factor, sums) = (other, others);
            }
        }
        let is_heavy = !pooled && factor != start && sums.are_heavy(count);
        // with larger sigmas, the other kinds would seem to check a kind
        let redundancy = match factor == start {
            true => sums.redundancy(),
            false => self.plain().sums(&problem, &start, workspace).redundancy(),
        };
        let mut found = Contradiction { factor, is_heavy, redundancy, ..Contradiction::NONE };
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
        if !pooled && factor != start {
            self.doubt_unchecked(&problem, &sums, &mut found, workspace);
        }
        found
    }

    /// Returns the mean redundancy number of the `free` measurements of each kind at one instant.
    pub fn redundancy<const D: usize>(
        &self,
        instant: &Instant<'_>,
        free: &[bool],
        workspace: &mut Workspace<D>,
    ) -> [f64; KINDS] {
        let sample = std::slice::from_ref(instant);
        let problem = Problem { sample, free, pooled: false };
        self.sums(&problem, &[1.0; KINDS], workspace).redundancy()
    }

    /// Repeats rounds of estimation until the factors settle; returns these, and the sums of the last
    /// round.
    fn settled<const D: usize>(
        &self,
        problem: &Problem<'_>,
        start: [f64; KINDS],
        workspace: &mut Workspace<D>,
    ) -> ([f64; KINDS], Sums) {
        self.settled_beside(None, problem, start, workspace)
    }

    /// The same, with a kind whose factor remains as it is at the start.
    pub(in crate::location) fn settled_beside<const D: usize>(
        &self,
        held: Option<usize>,
        problem: &Problem<'_>,
        start: [f64; KINDS],
        workspace: &mut Workspace<D>,
    ) -> ([f64; KINDS], Sums) {
        let mut factor = start;
        let mut round = 0;
        loop {
            let mut sums = self.sums(problem, &factor, workspace);
            let known = |kind: &usize| sums.freedom[*kind] > LEAST_FREEDOM && held != Some(*kind);
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

    /// Returns the median over the instants of the estimated variance, which is 1 where sigmas are
    /// known; `None` if no instant is redundant.
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

    /// Finishes an instant of a block; the results needed here remain in the workspace.
    fn finished<const D: usize>(
        &self,
        instant: &Instant<'_>,
        lane: usize,
        workspace: &mut Workspace<D>,
    ) -> Fix {
        self.one(instant, lane, &mut Solution::<D>::of(instant).output(), workspace)
    }

    /// Sums squares and degrees of freedom of the residuals for these factors of the variances.
    pub(in crate::location) fn sums<const D: usize>(
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

    /// Adds an instant of a block to the sums.
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
        sums.likelihood.push(None);
        let (status, redundancy) = self.status(instant, lane, workspace);
        if redundancy < 1 {
            return;
        }
        if status != Status::None {
            sums.lost += 1.0;
            return;
        }
        sums.found += 1.0;
        if let Some(evidence) = self.evidence(instant, lane, (free, factor), workspace) {
            sums.add(evidence, at, free.len() / KINDS);
        }
    }
}

impl Sums {
    fn add(&mut self, evidence: Evidence, at: usize, stations: usize) {
        self.kept += evidence.kept as f64;
        self.rejected += evidence.rejected as f64;
        for &Kept { place, residual, square, freedom } in &evidence.free {
            self.square[place / stations] += square;
            self.freedom[place / stations] += freedom;
            self.counts[place / stations] += 1.0;
            self.residual[at + place] = residual;
        }
        if let Some(own) = self.likelihood.last_mut() {
            *own = Some(evidence.likelihood);
        }
    }

    /// Returns the mean redundancy number of the measurements of each kind.
    fn redundancy(&self) -> [f64; KINDS] {
        std::array::from_fn(|kind| match self.counts[kind] {
            0.0 => 1.0,
            count => self.freedom[kind] / count,
        })
    }

    /// Returns the largest restricted log likelihood of an instant, on average over those that have a
    /// position, for any share of outliers.
    pub fn mean_ln_likelihood(&self) -> f64 {
        let known = self.likelihood.iter().flatten().map(Likelihood::by_share);
        let known: Vec<_> = known.filter(|own| !own[0].is_nan()).collect();
        let of = |share: usize| known.iter().map(|own| own[share]).sum::<f64>();
        let most = (0..ByShare::default().len()).map(of).fold(f64::NEG_INFINITY, f64::max);
        most / known.len() as f64
    }

    /// Returns the factor for all kinds together.
    fn common(&self) -> f64 {
        self.square.iter().sum::<f64>() / self.freedom.iter().sum::<f64>()
    }

    /// Whether the instants are more likely than with `other`, each with its best share of outliers.
    /// Only instants are compared that have a likelihood in both; if many have no position, such an
    /// instant counts as if all its redundant measurements were outliers.
    fn explains_better_than(&self, other: &Self) -> bool {
        let mut sums = [ByShare::default(); 2];
        for pair in self.likelihood.iter().zip(&other.likelihood) {
            let (own, others) = match pair {
                (Some(own), Some(others)) => (own.by_share(), others.by_share()),
                (None, Some(others)) if self.loses_many() => {
                    (others.of_outliers(), others.by_share())
                }
                (Some(own), None) if other.loses_many() => (own.by_share(), own.of_outliers()),
                // instants without a position in both are left out
                _ => continue,
            };
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

    /// Whether the residuals of any of the `count` instants are far larger than normal ones.
    fn are_heavy(&self, count: usize) -> bool {
        let freedom = (self.freedom.iter().sum::<f64>() / self.found).ceil() as usize;
        let limit = chi_square_upper_quantile(HEAVY / count as f64, freedom.max(1));
        let of = |own: &[f64]| own.iter().map(|r| r * r).sum::<f64>();
        self.residual.chunks(self.residual.len() / count).any(|own| of(own) > limit)
    }

    /// Returns the effective number of instants divided by their number `count`, from the correlation
    /// of the residuals of one kind.
    pub fn independent(&self, kind: usize, count: usize) -> f64 {
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

/// Returns the factor of the covariance with which the 95 % ellipse contains 95 % if its scale was
/// estimated with this number of degrees of freedom.
fn student<const D: usize>(freedom: f64) -> f64 {
    let coordinates = D as f64;
    coordinates * fisher_upper_quantile(OUTSIDE, coordinates, freedom)
        / chi_square_upper_quantile(OUTSIDE, D)
}
