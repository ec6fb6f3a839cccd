//! Systematic errors of the stations, from contradictions between stations.

pub(super) mod bias;
mod blocks;
mod contradictions;
mod grid;
pub(super) mod lasting;
pub(super) mod prior;
pub(super) mod speed;
pub(super) mod survey;
