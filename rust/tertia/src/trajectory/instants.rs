//! Single instants: their locations, and how their measurements depend on positions.

pub(super) mod fixes;
pub(super) mod instant;
mod isolated;
pub(super) mod mixture;
pub(super) mod tukey;
