//! Correlation of a track with the flight plan that its target flies: by its identity, by its path, or by
//! hand.

use crate::flightplan::{self, Link, Plan, Sighting, Status, decide};
use crate::sensors::Identities;
use crate::tracker::filter::plan::Guide;
use crate::tracker::settings::Settings;
use serde::{Deserialize, Serialize};

/// Number of plots over which a plan is compared with a track, and number after which the comparison starts
/// again.
const SEARCH_PLOTS: u8 = 10;
const SEARCH_AGAIN: u8 = 20;

/// The link of a track to its plan, or the search for one.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Correlation {
    status: Status,
    /// Sum of the scores of each plan, and (`plots`) number of plots since the comparison with it began.
    scores: Vec<f64>,
    plots: Vec<u8>,
    link: Link,
    /// The identities of the track when it was linked.
    linked_as: Identities,
    /// Plans that were removed from the track by hand: it does not find them again.
    declined: Vec<usize>,
}

impl Default for Correlation {
    fn default() -> Self {
        Self {
            status: Status::None,
            scores: Vec::new(),
            plots: Vec::new(),
            link: Link::default(),
            linked_as: Identities::NONE,
            declined: Vec::new(),
        }
    }
}

impl Correlation {
    /// How the track came to its plan, or why it has none.
    pub fn status(&self) -> Status {
        self.status
    }

    /// Compares a track without a plan with all plans, and returns the plan that its target flies, if one is
    /// found. Cost O(legs).
    pub fn search(
        &mut self,
        settings: &Settings,
        seen: &Sighting,
        own: &Identities,
    ) -> Option<usize> {
        let Self { scores, plots, declined, .. } = self;
        scores.resize(settings.plans.len(), 0.0);
        plots.resize(settings.plans.len(), 0);
        let mut compared = false;
        for (number, (sum, plots)) in scores.iter_mut().zip(&mut *plots).enumerate() {
            let plan = settings.plans.available(number).filter(|_| !declined.contains(&number));
            let Some(plan) = plan else {
                (*sum, *plots) = (0.0, 0);
                continue;
            };
            *plots += 1;
            if *plots > SEARCH_AGAIN {
                (*sum, *plots) = (0.0, 0);
            } else if *plots <= SEARCH_PLOTS {
                let score = || flightplan::score(&plan.route, seen);
                *sum += if contradicts(plan, own) { f64::NEG_INFINITY } else { score() };
                compared = true;
            }
        }
        if !compared {
            return None;
        }
        let count = |plan: usize| plots[plan].min(SEARCH_PLOTS);
        let mean = |plan: usize| match count(plan) {
            0 => f64::NAN,
            plots => scores[plan] / f64::from(plots),
        };
        let means: Vec<f64> = (0..scores.len()).map(mean).collect();
        let is_same = |plan: usize| {
            settings.plans.get(plan).is_some_and(|plan| own.same(&plan.identities) == Some(true))
        };
        let best = (0..means.len()).filter(|&plan| !means[plan].is_nan());
        let best = best.max_by(|&a, &b| means[a].total_cmp(&means[b]));
        let found = decide(&means, is_same, best.map_or(0, |plan| usize::from(count(plan))));
        self.status = found.status;
        found.plan
    }

    /// Accepts the plan with which the track was initiated.
    pub fn accept(&mut self) {
        self.status = Status::Accepted;
    }

    /// Begins a link to a plan that was found, or to one that was assigned by hand.
    pub fn begin(&mut self, own: Identities, by_hand: bool) {
        let status = if by_hand { Status::Manual } else { self.status };
        let declined = std::mem::take(&mut self.declined);
        *self = Self { status, linked_as: own, declined, ..Self::default() };
    }

    /// Ends a link or a search; a plan that was `taken` from the track by hand is not found again.
    pub fn end(&mut self, taken: Option<usize>) {
        let mut declined = std::mem::take(&mut self.declined);
        declined.extend(taken.filter(|plan| !declined.contains(plan)));
        *self = Self { declined, ..Self::default() };
    }

    /// Whether the link still holds: it does not if the track has not followed its plan for several scans, or
    /// its identity has changed. A link that was made by hand always holds.
    pub fn holds(
        &mut self,
        guide: &Guide,
        settings: &Settings,
        seen: &Sighting,
        own: &Identities,
    ) -> bool {
        if self.status == Status::Manual {
            return true;
        }
        let score = flightplan::score(&settings.plans[guide.plan].route, seen);
        let is_same = own.same(&self.linked_as);
        if is_same == Some(true) {
            // the track may have more identities now
            self.linked_as = *own;
        }
        // a blocked plan may be flown again later: the track keeps it as long as it keeps its identity
        let is_kept = guide.monitor.is_blocked() && self.linked_as.is_some();
        self.link.holds(if is_kept { 0.0 } else { score }, is_same == Some(false))
    }

    /// Starts the comparison with a plan again, because the plan was replaced.
    pub fn restart(&mut self, plan: usize) {
        if let (Some(sum), Some(plots)) = (self.scores.get_mut(plan), self.plots.get_mut(plan)) {
            (*sum, *plots) = (0.0, 0);
        }
        self.declined.retain(|&declined| declined != plan);
    }

    /// Whether the link also holds for a plan that replaces the present one.
    pub fn accepts(&self, plan: &Plan, own: &Identities) -> bool {
        self.status == Status::Manual || !contradicts(plan, own)
    }
}

/// Whether plan and track have identities that differ.
pub(in crate::tracker) fn contradicts(plan: &Plan, own: &Identities) -> bool {
    plan.identities.same(own) == Some(false)
}
