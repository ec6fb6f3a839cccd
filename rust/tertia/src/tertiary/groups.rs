//! Grouping of the tracks of several sensors; each group is one target.

use super::near::Sample;
use super::pairs::Candidate;
use crate::association::{Assigner, Pair};

/// A group of tracks that belong to one target.
#[derive(Clone, Debug, Default)]
pub(super) struct Group {
    /// Indices in the list of samples.
    pub members: Vec<usize>,
    /// Sum of the gains of all pairs of the group.
    sum: f64,
    /// Sum of the squared distances of all pairs.
    pub squared: f64,
}

/// Contribution of a track if it is added to a group.
#[derive(Clone, Copy, Default)]
struct Offer {
    group: usize,
    gain: f64,
    squared: f64,
    pairs: usize,
    passes: bool,
}

/// Groups tracks. For each sensor, in this order, its tracks are assigned to the groups made so far.
///
/// A group of n tracks whose pairs have gains of sum s has the value `2 s / n`; for equal covariances this is
/// the joint log-likelihood ratio. Cost O(pairs) plus the cost of the assignments.
pub(super) fn grouped(samples: &[Sample], candidates: &[Candidate], order: &[usize]) -> Vec<Group> {
    let near = Near::new(samples.len(), candidates);
    let mut groups: Vec<Group> = Vec::new();
    let mut group_of = vec![usize::MAX; samples.len()];
    let mut assigner = Assigner::default();
    let mut of_sensor = vec![Vec::new(); order.len()];
    samples.iter().enumerate().for_each(|(i, sample)| of_sensor[sample.sensor].push(i));
    for &sensor in order {
        let own = &of_sensor[sensor];
        let (mut pairs, mut offers) = (Vec::new(), Vec::new());
        let mut of_track = Vec::new();
        let mut place_of = vec![usize::MAX; groups.len()];
        for (row, &i) in own.iter().enumerate() {
            near.offers(i, &group_of, &groups, &mut place_of, &mut of_track);
            for &offer in &of_track {
                let group = &groups[offer.group];
                let n = group.members.len() as f64;
                let gain = 2.0 / (n + 1.0) * (group.sum + offer.gain) - 2.0 / n * group.sum;
                let pair = Pair { row: row as u32, column: offer.group as u32, gain };
                pairs.push(pair);
                offers.push(offer);
            }
        }
        let chosen = assigner.assign(&pairs, own.len(), groups.len()).to_vec();
        for (pair, offer) in pairs.iter().zip(&offers) {
            if chosen[pair.row as usize] == Some(pair.column) {
                let group = &mut groups[offer.group];
                group.sum += offer.gain;
                group.squared += offer.squared;
            }
        }
        for (&i, column) in own.iter().zip(chosen) {
            let group = column.map_or_else(
                || {
                    groups.push(Group::default());
                    groups.len() - 1
                },
                |column| column as usize,
            );
            groups[group].members.push(i);
            group_of[i] = group;
        }
    }
    groups
}

/// Candidates for each track.
struct Near<'a> {
    candidates: &'a [Candidate],
    /// Start of the list of each track in `own`, and the end of the last list.
    start: Vec<u32>,
    /// Indices of the candidates of each track.
    own: Vec<u32>,
}

impl<'a> Near<'a> {
    fn new(count: usize, candidates: &'a [Candidate]) -> Self {
        let mut start = vec![0; count + 1];
        for one in candidates {
            start[one.first + 1] += 1;
            start[one.second + 1] += 1;
        }
        for i in 0..count {
            start[i + 1] += start[i];
        }
        let mut next = start.clone();
        let mut own = vec![0; 2 * candidates.len()];
        for (at, one) in candidates.iter().enumerate() {
            for i in [one.first, one.second] {
                own[next[i] as usize] = at as u32;
                next[i] += 1;
            }
        }
        Self { candidates, start, own }
    }

    /// Sets the contributions of a track to all groups in which at least one pair with the track is in the
    /// gate and every member is a candidate. `place_of` is the place of each group among them; before and
    /// afterwards none has one. Cost O(candidates).
    fn offers(
        &self,
        i: usize,
        group_of: &[usize],
        groups: &[Group],
        place_of: &mut [usize],
        offers: &mut Vec<Offer>,
    ) {
        offers.clear();
        for &at in &self.own[self.start[i] as usize..self.start[i + 1] as usize] {
            let candidate = &self.candidates[at as usize];
            let group = group_of[candidate.first + candidate.second - i];
            if group == usize::MAX {
                continue;
            }
            if place_of[group] == usize::MAX {
                place_of[group] = offers.len();
                offers.push(Offer { group, ..Offer::default() });
            }
            let offer = &mut offers[place_of[group]];
            offer.gain += candidate.gain;
            offer.squared += candidate.squared;
            offer.pairs += 1;
            offer.passes |= candidate.passes;
        }
        offers.iter().for_each(|one| place_of[one.group] = usize::MAX);
        offers.retain(|one| one.passes && one.pairs == groups[one.group].members.len());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All pairs of tracks of two sensors at one place.
    fn at_one_place(count: usize) -> (Vec<Sample>, Vec<Candidate>) {
        let sample = |i: usize| Sample { sensor: i / count, ..Sample::default() };
        let pair = |at: usize| Candidate {
            first: at / count,
            second: count + at % count,
            gain: 1.0,
            passes: true,
            squared: 0.5,
        };
        ((0..2 * count).map(sample).collect(), (0..count * count).map(pair).collect())
    }

    #[test]
    fn each_track_has_one_partner_wherever_all_fit() {
        let (samples, candidates) = at_one_place(20);
        let groups = grouped(&samples, &candidates, &[0, 1]);
        assert_eq!(groups.len(), 20);
        assert!(groups.iter().all(|group| group.members.len() == 2 && group.squared == 0.5));
    }
}
