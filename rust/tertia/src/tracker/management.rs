//! Track management: plots that start tracks, tracks that go on after they were lost, targets that left
//! their gates.

pub(super) mod azimuths;
pub(super) mod due_flights;
pub(super) mod ended_tracks;
pub(super) mod hard_turns;
pub(super) mod outlying_plots;
pub(super) mod resume;
pub(super) mod second_starts;
