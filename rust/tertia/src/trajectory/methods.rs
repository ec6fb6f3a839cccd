//! Results, and how paths are smoothed with or without a motion model.

pub(super) mod motion;
pub(super) mod result;
pub(super) mod spatial;
pub(super) mod temporal;
