//! Groups of claims: a union-find structure, and sorting by counting.

use super::claim::Claim;

/// Returns the lowest index to which this one is joined.
pub(in crate::tracker) fn root(joined: &mut [u32], mut i: u32) -> u32 {
    while joined[i as usize] != i {
        joined[i as usize] = joined[joined[i as usize] as usize];
        i = joined[i as usize];
    }
    i
}

/// Joins two indices, and all indices that are joined to one of them.
pub(in crate::tracker) fn unite(joined: &mut [u32], a: u32, b: u32) {
    let (a, b) = (root(joined, a), root(joined, b));
    joined[a.max(b) as usize] = a.min(b);
}

/// Sorts claims by a number below `count`; claims with equal numbers keep their order.
pub(in crate::tracker) fn sort(
    claims: &[Claim],
    sorted: &mut Vec<Claim>,
    counts: &mut Vec<u32>,
    count: usize,
    key: impl Fn(&Claim) -> u32,
) {
    counts.clear();
    counts.resize(count, 0);
    for claim in claims {
        counts[key(claim) as usize] += 1;
    }
    let mut end = 0;
    for count in &mut *counts {
        end += *count;
        *count = end;
    }
    // every place is written below
    sorted.resize(claims.len(), Claim::new(0, 0, 0));
    for claim in claims.iter().rev() {
        let place = &mut counts[key(claim) as usize];
        *place -= 1;
        sorted[*place as usize] = *claim;
    }
}
