//! Tracks and plots that are read before they are needed: with thousands of them each is a wait for memory, and
//! waits together take no longer than one.

use super::claim::Claim;
use super::plot::Measured;
use super::track::Track;
use std::hint::black_box;

/// Claims or results that are read together.
pub(super) const TOGETHER: usize = 16;

/// How far claims were settled, and how far their tracks and plots were read.
#[derive(Default)]
pub(super) struct Ahead {
    settled: usize,
    read: usize,
}

impl Ahead {
    /// Reads tracks and plots of the next of these claims, where so many come now.
    pub fn read(
        &mut self,
        now: usize,
        claims: &[Claim],
        tracks: &[&mut Track],
        (plots, claimed): (&[Measured], &[u32]),
    ) {
        self.settled += now;
        while self.read < self.settled {
            let end = claims.len().min(self.read + TOGETHER);
            for claim in &claims[self.read..end] {
                black_box(tracks[claim.track as usize].touched());
                for &plot in claim.plots(claimed) {
                    black_box(plots[plot as usize].touched());
                }
            }
            self.read = end;
        }
    }
}
