//! One track from the plots of several radars: each radar's own filter, and the weights of their
//! states.
//!
//! Source: Panasyuk, Pudovkin, Rogachev 2018, (1) to (13), for K radars, misprints mended; and
//! weights that are robust against radars that are worse than they say. All radars see one angle in
//! one frame at common times; a radar without a plot at a time has none.

mod belief;
mod centre;
mod instant;
mod intersection;
mod joint;
mod matrix;
mod mixture;
mod robust;
mod rules;

pub use centre::{Centre, Fused, RadarReport};
pub use instant::{Consistency, Fusing, Instant, InstantFusion, Weighting, fusing};
pub use rules::{Beliefs, Rule};
