//! Tracks of several sensors in one picture (Panasyuk, Pudovkin, Rogachev 2018; Bar-Shalom, Fortmann
//! 1988): brought to one instant, freed of the systematic errors of their sensors, compared in pairs,
//! grouped into targets that keep their numbers, and fused.
//!
//! `row, gain <- tracklet; row <- bias; compare, near <- pairs <- groups; row, compare, tracklet <- rule; pairs, row <-
//! target, shadow, filtered <- member <- centre`. A cycle costs O(tracks) and what the pairs of tracks within 8 km cost; memory is
//! O(tracks + pairs).

mod bias;
mod centre;
mod compare;
mod filtered;
mod gain;
mod groups;
mod member;
mod near;
mod pairs;
mod row;
mod rule;
mod shadow;
mod share;
mod target;
mod tracklet;

pub use centre::{Centre, Settings, SystemTrack};
pub use compare::{Distance, shared};
pub use row::Row;
pub use rule::Rule;
