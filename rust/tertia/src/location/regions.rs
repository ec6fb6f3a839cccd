//! Regions that contain the target with a given probability, their outlines, and protection levels.

pub(super) mod contour;
pub(super) mod protection;
mod radial;
pub(super) mod region;
