//! Errors of a kind of measurement that the residuals hardly show.
//!
//! Where the azimuths of two theodolites cross, only the elevations are redundant, and they change little
//! if the crossing is wrong. If the measurements of a batch contradict each other, the cause may therefore
//! be errors of the elevations, or much larger ones of the azimuths. For each factor of the variances of
//! such a kind, with the prior of a single instant, the other sigmas are either right or as wrong as the
//! residuals then require. The ellipse contains 95 % of the mixture over these factors, weighted by their
//! restricted likelihood.

use super::contradiction::{Contradiction, Problem, Sums};
use super::single_instant::{DOUBLINGS, UNLIKELY, prior};
use crate::location::solver::growth::containing;
use crate::location::solver::{Locator, Workspace};
use crate::sensors::KINDS;

/// Mean redundancy number below which a kind counts as hardly checked (Förstner 1987).
pub(in crate::location) const HARDLY: f64 = 0.1;
/// Weight of other sigmas that are wrong, by comparison with right ones: the prior probability of factors
/// that fit as well as the best one.
const OTHERS: f64 = 0.25;

impl Locator {
    /// Finds the variance that kinds which are hardly checked may have in addition, in a batch that contradicts
    /// its sigmas. Weights do not change, because the cause may as well be elsewhere.
    pub(in crate::location) fn doubt_unchecked<const D: usize>(
        &self,
        problem: &Problem<'_>,
        sums: &Sums,
        found: &mut Contradiction,
        workspace: &mut Workspace<D>,
    ) {
        let strongest = (0..KINDS).max_by(|&a, &b| sums.freedom[a].total_cmp(&sums.freedom[b]));
        let Some(strongest) = strongest else { return };
        let count = problem.sample.len();
        let worth = count as f64 * sums.independent(strongest, count);
        for kind in (0..KINDS).filter(|kind| found.redundancy[*kind] < HARDLY) {
            let growth = self.unchecked(kind, problem, worth, workspace);
            found.unchecked[kind] = (growth / found.growth[kind] - 1.0).max(0.0);
        }
    }

    /// Returns the factor of the variances of a kind with which ellipses contain 95 % of the mixture; the
    /// instants are `worth` so many independent ones.
    fn unchecked<const D: usize>(
        &self,
        kind: usize,
        problem: &Problem<'_>,
        worth: f64,
        workspace: &mut Workspace<D>,
    ) -> f64 {
        let mut terms = Vec::new();
        let mut highest = f64::NEG_INFINITY;
        for doublings in 0..=DOUBLINGS {
            let mut factor = [1.0; KINDS];
            factor[kind] = 2.0_f64.powi(doublings);
            if doublings > 0 && !problem.has_directions(&factor) {
                break;
            }
            let right = worth * self.sums(problem, &factor, workspace).mean_ln_likelihood();
            let (_, wrong) = self.settled_beside(Some(kind), problem, factor, workspace);
            let wrong = OTHERS.ln() + worth * wrong.mean_ln_likelihood();
            let both = right.max(wrong) + (-(right - wrong).abs()).exp().ln_1p();
            let weight = prior(doublings).ln() + both;
            highest = highest.max(weight);
            terms.push((factor[kind], weight));
            if weight < highest - UNLIKELY {
                break;
            }
        }
        containing::<D>(&mut terms)
    }
}
