//! Rows of tracks, by vectors: results are the same to the last bit with any.

use super::super::exchange::Update;
use super::super::followed::Blocks;
use super::super::sighting::Errors;
use super::{Registrar, Unknowns};
use pulp::{Simd, WithSimd};

/// The rows of a scan, one after the other.
pub(super) struct Rows<'a> {
    pub registrar: &'a mut Registrar,
    pub updates: &'a [Update],
    pub applied: &'a [[[f64; 2]; 2]],
    pub unknowns: &'a Unknowns,
    pub moved: &'a [Errors],
    pub errors: &'a Blocks,
}

impl WithSimd for Rows<'_> {
    /// By how much each row moves, and what the errors add to its covariance.
    type Output = Vec<([f64; 4], [f64; 16])>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Self::Output {
        let mut rows = Vec::with_capacity(self.updates.len());
        for update in self.updates {
            let track = self.registrar.carry(update, self.applied, self.unknowns);
            rows.push((track.moved(self.moved), track.added(self.errors)));
        }
        rows
    }
}
