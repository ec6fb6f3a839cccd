//! Tracks from all their plots, those that came later as well: two filters of several models.
//!
//! `root <- mixture <- two_filter <- motion, vertical; two_filter <- passes, movement <- flight`

mod flight;
mod mixture;
mod motion;
mod movement;
mod passes;
mod root;
mod two_filter;
#[cfg(test)]
mod vectors;
mod vertical;

pub use flight::{SmoothedRow, Times, TrackPlot};
pub use motion::Movement;
pub use movement::Manoeuvre;

use crate::association::gate::{self, GUARD};
use crate::base::batch::for_each_row;
use std::num::NonZero;

/// Cost of a state, ns.
const STATE_NS: f64 = 5000.0;

/// Smooths tracks, of each of which the plots are in the order of time; states are from its first
/// plot to the last one.
///
/// Cost O(plots + times) a track; memory for the rows, and 1 kB a plot of the tracks at work.
///
/// # Panics
/// Never: the guard gate has a threshold, and tracks do not fail.
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
        Ok(())
    };
    let items = tracks.iter().zip(&mut rows);
    for_each_row(items, plots as f64 * STATE_NS, n_threads, || (), work).expect("none fails");
    rows
}
