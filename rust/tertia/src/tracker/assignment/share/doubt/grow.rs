//! The states of tracks after the events that survive.

use super::{Doubt, Survivor, Taken};
use crate::tracker::assignment::claim::Claim;
use crate::tracker::assignment::cluster::{Cluster, Hypothesis};
use crate::tracker::assignment::share::View;
use crate::tracker::track::Track;
use crate::tracker::track::tree::{Branch, Choice, Leaf};

/// The states of all rows of a part after the events, and the indices of those of each survivor.
pub(super) struct Grown {
    pub states: Vec<Vec<Leaf<Track>>>,
    of: Vec<Vec<u32>>,
}

impl Doubt {
    /// Corrects each state by each of the plots that it takes in a survivor.
    pub(super) fn grow(&self, group: &[Claim], tracks: &mut [&mut Track], view: View<'_>) -> Grown {
        let View { plots, settings, rates, .. } = view;
        let radar = plots[group[0].root as usize].radar;
        let odds = rates.odds[radar];
        let mut of = vec![Vec::with_capacity(self.rows.len()); self.survivors.len()];
        let mut all = Vec::with_capacity(self.rows.len());
        // tracks without their trees are copied quickly
        let tree = |row: &usize| tracks[group[*row].track as usize].tree.take();
        let trees: Vec<_> = self.rows.iter().map(tree).collect();
        for i in 0..self.rows.len() {
            let mut made: Vec<(u32, Taken, Option<u32>)> = Vec::new();
            for (survivor, of) in self.survivors.iter().zip(&mut of) {
                let id = self.cluster.hypotheses[survivor.parent].states[self.members[i]];
                let other = match survivor.taken[i] {
                    Taken::Shared(_, other) => Some(self.members[other]),
                    _ => None,
                };
                let states = &self.cluster.hypotheses[survivor.parent].states;
                let key = (id, survivor.taken[i], other.map(|member| states[member]));
                let at = made.iter().position(|other| *other == key).unwrap_or_else(|| {
                    made.push(key);
                    made.len() - 1
                });
                of.push(at as u32);
            }
            let state_of = |i: usize, id: u32| {
                let track = &*tracks[group[self.rows[i]].track as usize];
                let tree = trees[i].as_deref();
                let leaf = tree.and_then(|t| t.others.iter().find(|leaf| leaf.branch.id == id));
                let own = tree.map(|tree| &tree.own.choices);
                leaf.map_or((track, own), |leaf| (&leaf.track, Some(&leaf.branch.choices)))
            };
            let mut states = Vec::with_capacity(made.len());
            for (new, (id, taken, other)) in made.into_iter().enumerate() {
                let (state, choices) = state_of(i, id);
                let (mut state, mut choices) =
                    (state.clone(), choices.cloned().unwrap_or_default());
                let index = taken.plot().map(|plot| plots[plot as usize].index);
                choices.push_back(Choice { time: state.time, plot: index });
                match (taken, other) {
                    (Taken::Plot(plot), _) => {
                        let plot = &plots[plot as usize];
                        let gain = state.score(plot, odds, settings).unwrap_or(0.0);
                        state.existence.see(gain, radar, settings);
                        state.correct(plot, settings);
                    }
                    (Taken::Guarded(plot), _) => {
                        let plot = &plots[plot as usize];
                        if let Some(surprise) = state.guarded_score(plot, odds, settings) {
                            state.existence.see(surprise.gain, radar, settings);
                            state.take_guarded(plot, &surprise, settings);
                        }
                    }
                    (Taken::Shared(plot, at), Some(other)) => {
                        // the plot says little about which of the two targets is there
                        let (other, _) = state_of(at, other);
                        state.correct_shared(other, &plots[plot as usize], settings);
                    }
                    _ => {}
                }
                let branch = Branch { id: new as u32, choices };
                states.push(Leaf { branch, track: state, probability: 0.0 });
            }
            all.push(states);
        }
        Grown { states: all, of }
    }

    /// The cluster of hypotheses after the events.
    pub(super) fn hypotheses(&self, grown: &Grown) -> Cluster {
        let next = |(survivor, of): (&Survivor, &Vec<u32>)| {
            let mut states = self.cluster.hypotheses[survivor.parent].states.clone();
            for (&member, &state) in self.members.iter().zip(of) {
                states[member] = state;
            }
            Hypothesis { weight: survivor.weight, states }
        };
        let hypotheses = self.survivors.iter().zip(&grown.of).map(next).collect();
        Cluster { members: self.cluster.members.clone(), hypotheses }
    }
}
