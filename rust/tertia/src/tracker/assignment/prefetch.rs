//! Reads tracks and plots before they are needed. With thousands of them, each access waits for memory, and
//! several waits at the same time take no longer than one.

use super::claim::Claim;
use crate::tracker::plot::Measured;
use crate::tracker::track::Track;
use std::hint::black_box;

/// Number of claims or results that are read together.
pub(in crate::tracker) const TOGETHER: usize = 16;

/// Number of claims that were settled, and number of claims whose tracks and plots were read.
#[derive(Default)]
pub(in crate::tracker) struct Ahead {
    settled: usize,
    read: usize,
}

impl Ahead {
    /// Reads tracks and plots of the next claims; `now` is the number of claims that are settled next.
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
