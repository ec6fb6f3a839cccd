//! Errors of the measurements of a batch of instants: their sizes, and how many are outliers.

mod alone;
pub(super) mod contradiction;
mod evidence;
mod faulty;
pub(super) mod mixture;
mod modes;
mod normals;
mod unchecked;
