//! Association of plots with tracks.
//!
//! Source: Glagovskiy, Lavina, Rudelson 2014: scores, gates and their sectors. The usual likelihood
//! ratio replaces the printed score where it is better. Symbols: innovation
//! `ΔZ = plot − prediction`, its covariance Σ, `d² = ΔZᵀ Σ⁻¹ ΔZ`, m components.
//!
//! | module | contents |
//! |---|---|
//! | `gate` | thresholds, sectors of a gate, pairs of tracks and plots within gates |
//! | `score` | the paper's score, the likelihood ratio |
//! | `grid` | a spatial index of points |
//! | `assignment`, `pair`, `dense` | assignment of at most one plot per track and one track per plot |
//! | `event`, `events`, `murty` | the best joint events; the first of them is the best assignment |
//! | `scan` | the complete association of the plots of one scan |

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
