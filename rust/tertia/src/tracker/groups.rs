//! Groups of claims: what is joined, and sorting by counting.

use super::claim::Claim;

/// The lowest index that this one is joined to.
pub(super) fn root(joined: &mut [u32], mut i: u32) -> u32 {
    while joined[i as usize] != i {
        joined[i as usize] = joined[joined[i as usize] as usize];
        i = joined[i as usize];
    }
    i
}

/// Joins two indices, and all that are joined to them.
pub(super) fn unite(joined: &mut [u32], a: u32, b: u32) {
    let (a, b) = (root(joined, a), root(joined, b));
    joined[a.max(b) as usize] = a.min(b);
}

/// Sorts claims by a number below `count`; equal ones stay in their order.
pub(super) fn sort(
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
