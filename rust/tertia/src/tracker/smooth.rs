//! Tracks smoothed over all their plots, including later ones, by two filters with several models.
//!
//! `root <- mixture <- two_filter <- motion, vertical; two_filter <- passes, movement <- flight <- contradiction,
//! parallax, unmodelled`, and `noise`

mod contradiction;
mod flight;
mod mixture;
mod motion;
mod movement;
mod noise;
mod parallax;
mod passes;
mod root;
mod two_filter;
mod unmodelled;
#[cfg(test)]
mod vectors;
mod vertical;

pub use flight::{SmoothedRow, Times, TrackPlot};
pub use motion::Movement;
pub use movement::Manoeuvre;
pub use noise::{PlacedPlot, shown_covariances};
pub use parallax::height_offset;

use crate::association::gate::{self, GUARD};
use crate::base::batch::for_each_row;
use std::num::NonZero;

/// Computing time per state, ns.
const STATE_NS: f64 = 5000.0;

/// Smooths tracks. The plots of each track are in the order of time; its states extend from its
/// first plot to the last one.
///
/// Cost O(plots + times) per track; memory for the rows, and 1 kB per plot of the tracks that are
/// being smoothed.
///
/// # Panics
/// Never: the probability of the guard gate is valid, and tracks do not fail.
pub fn smooth_tracks(
    movement: &Movement,
    tracks: &[&[TrackPlot]],
    times: &Times,
    n_threads: Option<NonZero<usize>>,
) -> Vec<Vec<SmoothedRow>> {
    let guard = gate::threshold(GUARD, 2).expect("a probability");
    let plots: usize = tracks.iter().map(|track| track.len()).sum();
    let mut rows = vec![Vec::new(); tracks.len()];
    let work = |(): &mut (), (track, out): (&&[TrackPlot], &mut Vec<SmoothedRow>)| {
        *out = flight::smooth(movement, track, times, guard);
        contradiction::add_contradictions(track, out);
        if movement.turns() {
            unmodelled::add_unmodelled(track, guard, out);
        }
        Ok(())
    };
    let items = tracks.iter().zip(&mut rows);
    for_each_row(items, plots as f64 * STATE_NS, n_threads, || (), work).expect("none fails");
    rows
}
