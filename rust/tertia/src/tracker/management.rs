//! Track management: plots that start tracks, tracks that go on after they were lost, targets that left
//! their gates.

pub(super) mod azimuths;
pub(super) mod ended;
pub(super) mod origins;
pub(super) mod resume;
pub(super) mod schedule;
pub(super) mod sharp;
pub(super) mod strays;
