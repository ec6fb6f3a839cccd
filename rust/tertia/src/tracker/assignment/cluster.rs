//! Clusters of tracks that compete for plots, and joint hypotheses about their states.

use crate::tracker::settings::Settings;
use crate::tracker::settings::mht::Mht;
use crate::tracker::track::Track;
use crate::tracker::track::tree::Branch;
use serde::{Deserialize, Serialize};
use std::sync::Mutex;

/// One state for each member of a cluster, and how likely this combination is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Hypothesis {
    /// Logarithm of the ratio of its probability to that of the best hypothesis.
    pub weight: f64,
    /// Number (`Branch::id`) of the state of each member.
    pub states: Vec<u32>,
}

/// Tracks whose states depend on one another.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Cluster {
    /// Numbers of the tracks.
    pub members: Vec<u64>,
    /// Hypotheses, the best first.
    pub hypotheses: Vec<Hypothesis>,
}

impl Cluster {
    /// A cluster of one track with one state.
    pub fn of(track: &Track) -> Self {
        let hypothesis = Hypothesis { weight: 0.0, states: vec![0] };
        Self { members: vec![track.number], hypotheses: vec![hypothesis] }
    }

    /// Returns the union of two clusters with the best combinations of their hypotheses.
    pub fn times(self, other: &Self, limits: &Mht) -> Self {
        let mut members = self.members;
        members.extend(&other.members);
        let mut hypotheses = Vec::new();
        for one in &self.hypotheses {
            hypotheses.extend(other.hypotheses.iter().map(|two| Hypothesis {
                weight: one.weight + two.weight,
                states: [&one.states[..], &two.states[..]].concat(),
            }));
        }
        let mut product = Self { members, hypotheses };
        product.prune(limits);
        product
    }

    /// Keeps the best hypotheses, and normalises weights to the best.
    pub fn prune(&mut self, limits: &Mht) {
        self.hypotheses.sort_by(|a, b| b.weight.total_cmp(&a.weight));
        let best = self.hypotheses.first().map_or(0.0, |first| first.weight);
        self.hypotheses.retain(|hypothesis| hypothesis.weight >= best - limits.cut);
        self.hypotheses.truncate(limits.max_hypotheses);
        self.hypotheses.iter_mut().for_each(|hypothesis| hypothesis.weight -= best);
    }

    /// Probability of a state of a member.
    pub fn probability(&self, member: usize, state: u32) -> f64 {
        let weights = |h: &Hypothesis| h.weight.exp();
        let all: f64 = self.hypotheses.iter().map(weights).sum();
        let with = self.hypotheses.iter().filter(|h| h.states[member] == state);
        with.map(weights).sum::<f64>() / all
    }

    /// Leaves out members that are not `kept`; hypotheses that become equal are merged.
    pub fn keep(&mut self, kept: &[bool]) {
        let keep = |i: &mut usize| {
            *i += 1;
            kept[*i - 1]
        };
        let mut i = 0;
        self.members.retain(|_| keep(&mut i));
        for hypothesis in &mut self.hypotheses {
            let mut i = 0;
            hypothesis.states.retain(|_| keep(&mut i));
        }
        self.merge();
    }

    /// Merges equal hypotheses and adds their probabilities.
    fn merge(&mut self) {
        let mut merged: Vec<Hypothesis> = Vec::new();
        for hypothesis in self.hypotheses.drain(..) {
            match merged.iter_mut().find(|other| other.states == hypothesis.states) {
                Some(same) => same.weight = ln_sum(same.weight, hypothesis.weight),
                None => merged.push(hypothesis),
            }
        }
        self.hypotheses = merged;
    }

    /// Makes old choices final: drops hypotheses that differ from the best one in a choice that is now final.
    /// Also drops hypotheses with a state that has ended, except those with the best state.
    fn decide(&mut self, tracks: &mut [&mut Track], settings: &Settings, limits: &Mht) {
        for (member, track) in tracks.iter_mut().enumerate() {
            let memory = (limits.scans as f64 - 0.5) * track.period;
            loop {
                let best = self.hypotheses[0].states[member];
                let of = |state: u32| track.branch(state).map(|branch| &branch.choices);
                let Some(choices) = of(best) else { break };
                let (Some(first), Some(last)) = (choices.front(), choices.back()) else { break };
                if last.time - first.time < memory {
                    break;
                }
                let first = first.plot;
                let agrees = |state: u32| {
                    of(state).is_some_and(|c| c.front().is_some_and(|c| c.plot == first))
                };
                self.hypotheses.retain(|hypothesis| agrees(hypothesis.states[member]));
                track.forget_first();
            }
            let alive = |state: u32| track.state(state).is_alive(settings);
            let best = self.hypotheses[0].states[member];
            self.hypotheses.retain(|h| h.states[member] == best || alive(h.states[member]));
        }
    }

    /// Returns for each member the first member of its group of dependent members. Two members depend on
    /// each other if a state of one and a state of the other have the same plot.
    fn joined(&self, tracks: &[&mut Track]) -> Vec<usize> {
        let mut plots: Vec<(usize, usize)> = Vec::new();
        for (member, track) in tracks.iter().enumerate() {
            let held =
                |branch: &&Branch| self.hypotheses.iter().any(|h| h.states[member] == branch.id);
            for branch in track.branches().filter(held) {
                plots.extend(branch.choices.iter().filter_map(|c| Some((c.plot?, member))));
            }
        }
        plots.sort_unstable();
        let mut joined: Vec<usize> = (0..self.members.len()).collect();
        for pair in plots.windows(2).filter(|pair| pair[0].0 == pair[1].0) {
            let (a, b) = (joined[pair[0].1], joined[pair[1].1]);
            joined.iter_mut().filter(|own| **own == a.max(b)).for_each(|own| *own = a.min(b));
        }
        joined
    }

    /// Returns the group of members whose first member is `first`, as a cluster.
    fn part(&self, joined: &[usize], first: usize) -> Self {
        let mut part = self.clone();
        let kept: Vec<bool> = joined.iter().map(|own| *own == first).collect();
        part.keep(&kept);
        part
    }
}

/// Returns `ln(eᵃ + eᵇ)`.
fn ln_sum(a: f64, b: f64) -> f64 {
    a.max(b) + (-(a - b).abs()).exp().ln_1p()
}

/// All clusters, in the order of their first members.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Clusters(pub(in crate::tracker) Vec<Cluster>);

/// Clusters from which threads take some, and the index of the cluster of each track.
#[derive(Default)]
pub(in crate::tracker) struct Cells {
    cells: Vec<Mutex<Option<Cluster>>>,
    of: Vec<(u64, u32)>,
}

impl Clusters {
    /// Moves the clusters to where threads can take them.
    pub fn open(&mut self) -> Cells {
        let mut cells = Cells::default();
        for (index, cluster) in self.0.drain(..).enumerate() {
            cells.of.extend(cluster.members.iter().map(|number| (*number, index as u32)));
            cells.cells.push(Mutex::new(Some(cluster)));
        }
        cells.of.sort_unstable();
        cells
    }

    /// Takes back the clusters that no thread took and those that threads return. Makes final choices,
    /// separates members that do not depend on one another, and shows the best state of each track. Cost
    /// O(tracks) if there is a cluster.
    pub fn close(
        &mut self,
        cells: Cells,
        back: impl Iterator<Item = Cluster>,
        tracks: &mut [Track],
        (settings, limits): (&Settings, &Mht),
    ) {
        let left = cells.cells.into_iter().filter_map(|cell| cell.into_inner().ok().flatten());
        let clusters: Vec<Cluster> = left.chain(back).collect();
        if clusters.is_empty() {
            return;
        }
        let places = Places::of(tracks);
        for mut cluster in clusters {
            let there: Vec<bool> =
                cluster.members.iter().map(|number| places.find(*number).is_some()).collect();
            if there.contains(&false) {
                cluster.keep(&there);
            }
            if cluster.members.is_empty() {
                continue;
            }
            let mut members: Vec<(u64, usize)> = cluster.members.iter().copied().zip(0..).collect();
            members.sort_unstable();
            cluster.members = members.iter().map(|(number, _)| *number).collect();
            for hypothesis in &mut cluster.hypotheses {
                hypothesis.states = members.iter().map(|(_, i)| hypothesis.states[*i]).collect();
            }
            let mut own = places.tracks(&cluster.members, tracks);
            cluster.prune(limits);
            cluster.decide(&mut own, settings, limits);
            let joined = cluster.joined(&own);
            for first in 0..own.len() {
                if joined[first] == first {
                    self.settle(cluster.part(&joined, first), &mut own, limits);
                }
            }
        }
        self.0.sort_by_key(|cluster| cluster.members[0]);
    }

    /// Shows the best states of a cluster, and keeps the members whose states differ between its hypotheses.
    fn settle(&mut self, mut cluster: Cluster, tracks: &mut [&mut Track], limits: &Mht) {
        cluster.prune(limits);
        let states = &cluster.hypotheses[0].states;
        for (member, (number, &state)) in cluster.members.iter().zip(states).enumerate() {
            let track = tracks.iter_mut().find(|track| track.number == *number);
            let track = &mut **track.expect("members are there");
            track.show(state);
            let held = |id: u32| cluster.hypotheses.iter().any(|h| h.states[member] == id);
            if let Some(tree) = &mut track.tree {
                tree.others.retain(|leaf| held(leaf.branch.id));
                tree.probability = cluster.probability(member, state);
                for leaf in &mut tree.others {
                    leaf.probability = cluster.probability(member, leaf.branch.id);
                }
                if tree.others.is_empty() {
                    track.tree = None;
                }
            }
        }
        let varies: Vec<bool> = (0..cluster.members.len())
            .map(|i| {
                cluster.hypotheses.iter().any(|h| h.states[i] != cluster.hypotheses[0].states[i])
            })
            .collect();
        if varies.contains(&true) {
            if varies.contains(&false) {
                cluster.keep(&varies);
            }
            self.0.push(cluster);
        }
    }
}

impl Cells {
    /// Whether there are no clusters.
    pub fn is_empty(&self) -> bool {
        self.cells.is_empty()
    }

    /// Index of the cluster of a track.
    pub fn of(&self, number: u64) -> Option<usize> {
        let at = self.of.binary_search_by_key(&number, |(number, _)| *number).ok()?;
        Some(self.of[at].1 as usize)
    }

    /// Number of clusters.
    pub fn len(&self) -> usize {
        self.cells.len()
    }

    /// Takes the cluster of a track; none if it was already taken.
    pub fn take(&self, number: u64) -> Option<Cluster> {
        let cell = &self.cells[self.of(number)?];
        cell.lock().ok()?.take()
    }
}

/// Numbers and indices of all tracks, sorted by number: the tracks themselves are not sorted if one was
/// resumed under an older number.
struct Places(Vec<(u64, usize)>);

impl Places {
    /// Returns the numbers and indices of these tracks. Cost O(tracks) if the tracks are sorted by number.
    fn of(tracks: &[Track]) -> Self {
        let mut places: Vec<_> = tracks.iter().map(|track| track.number).zip(0..).collect();
        places.sort_unstable();
        Self(places)
    }

    /// Returns the index of the track with this number.
    fn find(&self, number: u64) -> Option<usize> {
        let at = self.0.binary_search_by_key(&number, |(number, _)| *number).ok()?;
        Some(self.0[at].1)
    }

    /// Returns the tracks with these numbers, sorted by number.
    fn tracks<'a>(&self, numbers: &[u64], tracks: &'a mut [Track]) -> Vec<&'a mut Track> {
        let mut places: Vec<usize> = numbers.iter().filter_map(|own| self.find(*own)).collect();
        places.sort_unstable();
        let (mut found, mut rest, mut before) = (Vec::with_capacity(places.len()), tracks, 0);
        for at in places {
            let (track, later) =
                std::mem::take(&mut rest)[at - before..].split_first_mut().expect("it is there");
            found.push(track);
            (rest, before) = (later, at + 1);
        }
        found.sort_unstable_by_key(|track| track.number);
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensors::radar_of;
    use crate::tracker::motion::Motion;
    use crate::tracker::plot::Measured;

    #[test]
    fn tracks_are_found_although_one_was_resumed_under_an_older_number() {
        let settings = Settings::new(vec![radar_of([50.0, 1e-3])], Motion::Cv(1.0));
        let numbers = [1, 4, 5, 6, 8, 2, 9, 11, 12];
        let mut tracks: Vec<Track> = numbers
            .into_iter()
            .map(|number| Track::new(number, &Measured::default(), 1.0, &settings))
            .collect();
        let places = Places::of(&tracks);
        for (at, number) in numbers.into_iter().enumerate() {
            assert_eq!(places.find(number), Some(at));
        }
        assert_eq!(places.find(3), None);
        let found = places.tracks(&[2, 5, 9, 12], &mut tracks);
        let found: Vec<u64> = found.iter().map(|track| track.number).collect();
        assert_eq!(found, [2, 5, 9, 12]);
    }
}
