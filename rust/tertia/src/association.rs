//! Association: which plot belongs to which track.
//!
//! Source: Glagovskiy, Lavina, Rudelson 2014: quality of laying, gates, regions of a gate; with the
//! usual likelihood in place of the printed score where that is better. Symbols: innovation
//! `ΔZ = plot − prediction`, its covariance Σ, `d² = ΔZᵀ Σ⁻¹ ΔZ`, m components.
//!
//! | part | what |
//! |---|---|
//! | `gate` | thresholds, regions of a gate, all pairs of many tracks and many plots |
//! | `score` | what a pair is worth: the paper's score, the likelihood ratio |
//! | `grid` | the points near a place |
//! | `assignment` | each track one plot at most, and each plot one track |

pub mod assignment;
pub mod gate;
pub mod grid;
pub mod score;

pub use assignment::{Assigner, Pair};
pub use grid::Grid;
