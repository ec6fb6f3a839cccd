//! Errors of reported positions: by how much they exceed what is stated, and how late positions are.

pub(super) mod delay;
pub(super) mod differences;
pub(super) mod quality;
pub(super) mod rounding;
