//! Records that are not as stated: clocks that differ, repeated measurements, too small standard deviations.

pub(super) mod clocks;
pub(super) mod differences;
pub(super) mod growth;
pub(super) mod partly_wrong;
pub(super) mod ranges;
pub(super) mod repeated;
