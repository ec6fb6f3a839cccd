//! The flight plans of a tracker: they may be added, replaced and removed while it runs.

use crate::flightplan::Plan;
use serde::{Deserialize, Serialize};
use std::ops::Index;

/// A plan, and the track to which it was assigned by hand.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Filed {
    plan: Plan,
    track: Option<u64>,
}

/// Flight plans by their numbers, which are never reused.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Plans(Vec<Option<Filed>>);

impl From<Vec<Plan>> for Plans {
    fn from(plans: Vec<Plan>) -> Self {
        Self(plans.into_iter().map(|plan| Some(Filed { plan, track: None })).collect())
    }
}

impl Index<usize> for Plans {
    type Output = Plan;

    /// The plan of a track; tracks leave a plan when it is removed.
    fn index(&self, number: usize) -> &Plan {
        self.get(number).expect("tracks leave plans that are removed")
    }
}

impl Plans {
    /// Whether there never was a plan.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Number of plans ever added.
    pub(in crate::tracker) fn len(&self) -> usize {
        self.0.len()
    }

    /// The plan with this number; none if it was removed or never existed.
    pub fn get(&self, number: usize) -> Option<&Plan> {
        self.0.get(number)?.as_ref().map(|filed| &filed.plan)
    }

    /// The plan, unless it was assigned to a track by hand.
    pub(in crate::tracker) fn available(&self, number: usize) -> Option<&Plan> {
        let filed = self.0.get(number)?.as_ref();
        filed.filter(|filed| filed.track.is_none()).map(|filed| &filed.plan)
    }

    /// Whether the plan exists and was not assigned to another track by hand.
    pub(in crate::tracker) fn is_open_to(&self, number: usize, track: u64) -> bool {
        let filed = self.0.get(number).and_then(Option::as_ref);
        filed.is_some_and(|filed| filed.track.is_none_or(|holder| holder == track))
    }

    /// Adds a plan; returns its number.
    pub(in crate::tracker) fn add(&mut self, plan: Plan) -> usize {
        self.0.push(Some(Filed { plan, track: None }));
        self.0.len() - 1
    }

    /// Replaces an existing plan, or removes it.
    pub(in crate::tracker) fn change(&mut self, number: usize, plan: Option<Plan>) {
        let track = self.0[number].take().and_then(|filed| filed.track);
        self.0[number] = plan.map(|plan| Filed { plan, track });
    }

    /// Assigns a plan to a track by hand. Another track that had this plan by hand loses it, and
    /// this track loses any other plan that it had by hand.
    pub(in crate::tracker) fn give(&mut self, number: usize, track: u64) {
        self.free(|holder| holder == track);
        if let Some(Some(filed)) = self.0.get_mut(number) {
            filed.track = Some(track);
        }
    }

    /// Releases the plans that were assigned by hand to tracks with such numbers.
    pub(in crate::tracker) fn free(&mut self, of: impl Fn(u64) -> bool) {
        for filed in self.0.iter_mut().flatten() {
            filed.track = filed.track.filter(|&track| !of(track));
        }
    }
}
