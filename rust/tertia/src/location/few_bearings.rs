//! Two to four bearings: the density of positions, and how concentrated the bearings are.

pub(super) mod concentration;
pub(super) mod posterior;
mod quadtree;
