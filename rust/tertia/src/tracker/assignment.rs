//! Assignment of plots to tracks: which tracks compete for which plots, and which tracks take them.

pub(super) mod claim;
pub(super) mod cluster;
pub(super) mod groups;
pub(super) mod prefetch;
pub(super) mod share;
