//! One picture from the tracks of several sensors (Panasyuk, Pudovkin, Rogachev 2018; Bar-Shalom, Fortmann
//! 1988). The tracks are extrapolated to one instant, corrected for the systematic errors of their sensors,
//! compared in pairs, grouped into targets that keep their numbers, and fused.
//!
//! `row <- family; row, gain, family <- tracklet; family <- source; lasting <- filtered, target; row <- bias;
//! compare, near <- pairs <- groups; row, compare, tracklet <- rule; pairs, row <- target;
//! target, shadow, filtered, stated <- analysis; analysis, source <- member <- centre`.
//!
//! A cycle costs O(tracks) plus the cost of all pairs of tracks within 8 km; memory is O(tracks + pairs).

mod analysis;
mod bias;
mod centre;
mod compare;
mod family;
mod filtered;
mod gain;
mod groups;
mod jump;
mod lasting;
mod member;
mod near;
mod pairs;
mod row;
mod rule;
mod shadow;
mod share;
mod source;
mod stated;
mod target;
mod tracklet;

pub use centre::{Centre, Settings, SystemTrack};
pub use compare::{Distance, shared};
pub use row::Row;
pub use rule::Rule;
