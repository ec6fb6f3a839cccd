//! Errors of the measurements of a batch of instants: their sizes, and how many are outliers.

pub(super) mod contradiction;
mod evidence;
pub(super) mod explained;
pub(super) mod lasting;
pub(super) mod mixture;
mod modes;
mod normals;
mod outlier_frequency;
mod single_instant;
mod unchecked;
