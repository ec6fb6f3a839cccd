//! Sizes of the blocks of instants in which contradictions are collected.

use crate::trajectory::measured::{Measured, Record};
use crate::trajectory::search::fit::Found;

/// Number of blocks of instants within the memory of the smoother, least number of blocks in the record, and
/// largest product of the numbers of blocks and columns.
const IN_MEMORY: f64 = 4.0;
const LEAST_BLOCKS: usize = 10;
const MOST_NUMBERS: usize = 600;
/// Mean number of redundant measurements of an instant from which instants are not combined.
const REDUNDANT: f64 = 0.05;
/// Number of groups of combined instants within the memory of the smoother if stations measure in turn.
const TURNS_IN_MEMORY: f64 = 2.0;

/// Number of instants over which the smoother averages: the median ratio of variances before and after it.
pub(in crate::trajectory) fn memory<const D: usize, const N: usize>(
    record: &Record<'_>,
    found: &Found<D, N>,
) -> f64 {
    let trace = |matrix: &[f64]| matrix.iter().step_by(D + 1).sum::<f64>();
    let ratio = |t: usize| {
        let at = t * D * D..(t + 1) * D * D;
        trace(&found.plots.covariance[at.clone()]) / trace(&found.path.covariance[at])
    };
    let mut ratios: Vec<f64> = (0..record.len()).map(ratio).filter(|r| r.is_finite()).collect();
    ratios.sort_unstable_by(f64::total_cmp);
    ratios.get(ratios.len() / 2).copied().unwrap_or(1.0)
}

/// Number of instants that are combined if single instants have fewer measurements than coordinates, or if
/// stations measure at different times, so that hardly any instant has redundant measurements: enough for
/// redundant measurements, but only a part of those over which the smoother averages. O(N K²) for K
/// measurements of an instant.
pub(in crate::trajectory) fn together<const D: usize, const N: usize>(
    record: &Record<'_>,
    found: &Found<D, N>,
) -> usize {
    let measured = &found.measured;
    let n = record.len() as f64;
    let each = (0..record.len()).map(|t| measured.comparable(t)).sum::<usize>() as f64 / n;
    let in_turn = is_in_turn(measured, record.len());
    if each >= D as f64 && !in_turn {
        return 1;
    }
    let wished = (2.0 * D as f64 + 2.0) / each;
    let most = memory(record, found) / if each < D as f64 { IN_MEMORY } else { TURNS_IN_MEMORY };
    (wished.min(most) as usize).max(1)
}

/// Whether stations measure in turn: hardly any of the `n` instants has redundant measurements, but together
/// with the instant before it has, also if equal columns count once.
fn is_in_turn<const D: usize>(measured: &Measured<D>, n: usize) -> bool {
    let redundant = |own: usize| own.saturating_sub(D);
    let repeated = |t: usize| {
        let before = &measured.column[measured.instant(t - 1)];
        measured.column[measured.instant(t)].iter().filter(|own| before.contains(own)).count()
    };
    let pair = |t: usize| measured.comparable(t - 1) + measured.comparable(t);
    let alone: usize = (0..n).map(|t| redundant(measured.comparable(t))).sum();
    let pairs: usize = (1..n).map(|t| redundant(pair(t).saturating_sub(repeated(t)))).sum();
    let enough = REDUNDANT * n as f64;
    (alone as f64) < enough && pairs as f64 >= enough
}

/// Number of instants in a block: a part of the memory of the smoother, with a limited number of blocks.
pub(in crate::trajectory) fn length(n: usize, memory: f64, columns: usize) -> usize {
    let wished = (memory / IN_MEMORY) as usize;
    let most = (MOST_NUMBERS / columns).max(1);
    wished.min(n / LEAST_BLOCKS).max(n.div_ceil(most)).max(1)
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_block_has_an_instant_however_many_columns_there_are() {
        assert_eq!(super::length(40, 40.0, 610), 40);
    }
}
