//! Association: which plot belongs to which track.
//!
//! Source: Glagovskiy, Lavina, Rudelson 2014: scores, gates and their sectors; the usual likelihood
//! ratio replaces the printed score where it is better. Symbols: innovation
//! `ΔZ = plot − prediction`, its covariance Σ, `d² = ΔZᵀ Σ⁻¹ ΔZ`, m components.
//!
//! | module | contents |
//! |---|---|
//! | `gate` | thresholds, sectors of a gate, all pairs of many tracks and many plots |
//! | `score` | the paper's score, the likelihood ratio |
//! | `grid` | a spatial index of points |
//! | `assignment`, `pair`, `dense` | at most one plot for each track, and one track for each plot |
//! | `event`, `events`, `murty` | the best joint events, of which the assignment is the first |
//! | `scan` | all of it for the plots of one scan |

pub mod assignment;
mod dense;
pub mod event;
pub mod events;
pub mod gate;
pub mod grid;
mod murty;
mod pair;
mod scan;
pub mod score;

pub use assignment::Assigner;
pub use grid::Grid;
pub(crate) use grid::is_inside;
pub use pair::Pair;
pub use scan::{Association, Scoring, associate};
