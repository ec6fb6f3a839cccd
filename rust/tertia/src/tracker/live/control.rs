//! What a controller changes while the tracker runs: plans, and the assignment of plans to tracks.

use super::Tracker;
use crate::flightplan::Plan;
use crate::tracker::track::Track;
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Why a command was refused. Nothing has changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum Refusal {
    /// No confirmed track has this number.
    #[error("track is {0}; there is no confirmed track of this number")]
    NoTrack(u64),
    /// No plan has this number, or it was removed.
    #[error("plan is {0}; there is no plan of this number")]
    NoPlan(usize),
    /// The motion model of the tracker does not use plans.
    #[error("motion takes no plans; 'imm' and 'window' do")]
    NoPlans,
    /// The plan belongs to another track.
    #[error("plan is {0}; it is the plan of track {1}")]
    Taken(usize, u64),
    /// The track has no plan.
    #[error("track is {0}; it has no plan")]
    NotCorrelated(u64),
}

type Done<T> = Result<T, Refusal>;

impl Tracker {
    /// Adds a plan; returns its number, which is one more than that of the plan added before. Cost O(1).
    ///
    /// # Errors
    /// A motion model that does not use plans.
    pub fn add_plan(&mut self, plan: Plan) -> Done<usize> {
        if !self.settings.motion.takes_plans() {
            return Err(Refusal::NoPlans);
        }
        Ok(self.settings.plans.add(plan))
    }

    /// Replaces a plan by another one. A track that has the old plan follows the new one from the leg on
    /// which the target is. If the new plan has the same path, nothing changes but the times. Cost O(tracks).
    ///
    /// # Errors
    /// No plan of this number.
    pub fn replace_plan(&mut self, number: usize, plan: Plan) -> Done<()> {
        self.change_plan(number, Some(plan))
    }

    /// Removes a plan; its number is not used again. Cost O(tracks).
    ///
    /// # Errors
    /// No plan of this number.
    pub fn remove_plan(&mut self, number: usize) -> Done<()> {
        self.change_plan(number, None)
    }

    fn change_plan(&mut self, number: usize, plan: Option<Plan>) -> Done<()> {
        let old = self.settings.plans.get(number).ok_or(Refusal::NoPlan(number))?;
        for track in &mut self.tracks {
            track.each_state(|state| state.change_plan(number, old, plan.as_ref()));
        }
        self.settings.plans.change(number, plan);
        Ok(())
    }

    /// Assigns a plan to a confirmed track by hand, until the track ends or the plan is removed. The track
    /// keeps the plan whatever its identity and its path are, but a plan that the target does not follow is
    /// blocked as usual. With `take`, another track that has this plan loses it and searches for another
    /// plan. Cost O(tracks).
    ///
    /// # Errors
    /// No such track or plan, or a plan that belongs to another track, without `take`.
    pub fn correlate(&mut self, number: u64, plan: usize, take: bool) -> Done<()> {
        self.settings.plans.get(plan).ok_or(Refusal::NoPlan(plan))?;
        if !self.settings.motion.takes_plans() {
            return Err(Refusal::NoPlans);
        }
        self.confirmed(number)?;
        let has = |track: &&mut Track| track.plan() == Some(plan) && track.number != number;
        for other in self.tracks.iter_mut().filter(has) {
            if !take {
                return Err(Refusal::Taken(plan, other.number));
            }
            other.each_state(|state| state.decorrelate(Some(plan)));
        }
        self.settings.plans.give(plan, number);
        let Self { tracks, settings, .. } = self;
        let found = tracks.iter_mut().find(|track| track.number == number);
        if let Some(track) = found {
            track.each_state(|state| state.correlate(plan, settings, true));
        }
        Ok(())
    }

    /// Removes the plan from a confirmed track, which will not find this plan again by itself. Cost
    /// O(tracks).
    ///
    /// # Errors
    /// No such track, or a track without a plan.
    pub fn decorrelate(&mut self, number: u64) -> Done<()> {
        let track = self.confirmed(number)?;
        let plan = track.plan().ok_or(Refusal::NotCorrelated(number))?;
        track.each_state(|state| state.decorrelate(Some(plan)));
        self.settings.plans.free(|track| track == number);
        Ok(())
    }

    /// Suspends the plan of a confirmed track, or resumes it; this also applies to a plan that the track
    /// finds later.
    ///
    /// # Errors
    /// No such track.
    pub fn suspend_plan(&mut self, number: u64, suspended: bool) -> Done<()> {
        self.confirmed(number).map(|track| track.suspend_plan(suspended))
    }

    /// Numbers of the confirmed tracks whose plans are suspended.
    pub fn suspended_plans(&self) -> Vec<u64> {
        let suspended = |track: &&Track| track.is_confirmed() && track.is_suspended();
        self.tracks.iter().filter(suspended).map(|track| track.number).collect()
    }

    fn confirmed(&mut self, number: u64) -> Done<&mut Track> {
        let mut tracks = self.tracks.iter_mut();
        let found = tracks.find(|track| track.number == number && track.is_confirmed());
        found.ok_or(Refusal::NoTrack(number))
    }
}

/// A command of a controller while the tracker runs.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub enum Command {
    /// [`Tracker::add_plan`]
    Add(Plan),
    /// [`Tracker::replace_plan`]
    Replace(usize, Plan),
    /// [`Tracker::remove_plan`]
    Remove(usize),
    /// [`Tracker::correlate`]
    Correlate(u64, usize, bool),
    /// [`Tracker::decorrelate`]
    Decorrelate(u64),
    /// [`Tracker::suspend_plan`]
    Suspend(u64, bool),
}

impl Command {
    /// The track that it changes.
    pub(in crate::tracker) fn track(&self) -> Option<u64> {
        match *self {
            Self::Correlate(number, ..) | Self::Decorrelate(number) | Self::Suspend(number, _) => {
                Some(number)
            }
            _ => None,
        }
    }

    pub(in crate::tracker) fn apply(&self, tracker: &mut Tracker) -> Done<Option<usize>> {
        match self {
            Self::Add(plan) => return tracker.add_plan(plan.clone()).map(Some),
            Self::Replace(number, plan) => tracker.replace_plan(*number, plan.clone()),
            Self::Remove(number) => tracker.remove_plan(*number),
            Self::Correlate(number, plan, take) => tracker.correlate(*number, *plan, *take),
            Self::Decorrelate(number) => tracker.decorrelate(*number),
            Self::Suspend(number, suspended) => tracker.suspend_plan(*number, *suspended),
        }?;
        Ok(None)
    }
}
