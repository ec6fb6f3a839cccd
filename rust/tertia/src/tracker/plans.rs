//! The flight plans of a tracker: they may be added, replaced and removed while it runs.

use crate::flightplan::Plan;
use serde::{Deserialize, Serialize};
use std::ops::Index;

/// A plan, and the track that was given it by hand.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Filed {
    plan: Plan,
    track: Option<u64>,
}

/// Flight plans by their numbers, which are never used again.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Plans(Vec<Option<Filed>>);

impl From<Vec<Plan>> for Plans {
    fn from(plans: Vec<Plan>) -> Self {
        Self(plans.into_iter().map(|plan| Some(Filed { plan, track: None })).collect())
    }
}

impl Index<usize> for Plans {
    type Output = Plan;

    /// The plan that a track has: it is there as long as the track has it.
    fn index(&self, number: usize) -> &Plan {
        self.get(number).expect("tracks leave plans that are removed")
    }
}

impl Plans {
    /// Whether there never was a plan.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Numbers given so far.
    pub(super) fn len(&self) -> usize {
        self.0.len()
    }

    /// A plan; none where it was removed, or there never was one.
    pub fn get(&self, number: usize) -> Option<&Plan> {
        self.0.get(number)?.as_ref().map(|filed| &filed.plan)
    }

    /// The plan, unless it was given to a track by hand.
    pub(super) fn available(&self, number: usize) -> Option<&Plan> {
        let filed = self.0.get(number)?.as_ref();
        filed.filter(|filed| filed.track.is_none()).map(|filed| &filed.plan)
    }

    /// Adds a plan; returns its number.
    pub(super) fn add(&mut self, plan: Plan) -> usize {
        self.0.push(Some(Filed { plan, track: None }));
        self.0.len() - 1
    }

    /// Puts a plan in the place of one that is there, or removes that.
    pub(super) fn change(&mut self, number: usize, plan: Option<Plan>) {
        let track = self.0[number].take().and_then(|filed| filed.track);
        self.0[number] = plan.map(|plan| Filed { plan, track });
    }

    /// Gives a plan to a track by hand; the track that had it so loses it.
    pub(super) fn give(&mut self, number: usize, track: u64) {
        self.free(|holder| holder == track);
        if let Some(Some(filed)) = self.0.get_mut(number) {
            filed.track = Some(track);
        }
    }

    /// Takes plans that were given by hand from such tracks.
    pub(super) fn free(&mut self, of: impl Fn(u64) -> bool) {
        for filed in self.0.iter_mut().flatten() {
            filed.track = filed.track.filter(|&track| !of(track));
        }
    }
}
