//! Sizes of the blocks of instants in which contradictions are collected.

use super::found::Found;
use super::measured::Record;

/// Number of blocks of instants within the memory of the smoother, least number of blocks in the record, and
/// largest product of the numbers of blocks and columns.
const IN_MEMORY: f64 = 4.0;
const LEAST_BLOCKS: usize = 10;
const MOST_NUMBERS: usize = 600;

/// Number of instants over which the smoother averages: the median ratio of variances before and after it.
pub(super) fn memory<const D: usize, const N: usize>(
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

/// Number of instants that are combined if single instants have fewer measurements than coordinates: enough
/// for redundant measurements, but only a part of those over which the smoother averages.
pub(super) fn together<const D: usize, const N: usize>(
    record: &Record<'_>,
    found: &Found<D, N>,
    memory: f64,
) -> usize {
    let each = found.measured.comparable() as f64 / record.len() as f64;
    if each >= D as f64 || record.common_variance() > 0.0 {
        return 1;
    }
    let wished = (2.0 * D as f64 + 2.0) / each;
    (wished.min(memory / IN_MEMORY) as usize).max(1)
}

/// Number of instants in a block: a part of the memory of the smoother, with a limited number of blocks.
pub(super) fn length(n: usize, memory: f64, columns: usize) -> usize {
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
