//! Numbers of several instants, side by side.

use crate::base::vector::Vector;
use pulp::Simd;

/// Instants side by side: two vectors of AVX2, so that one works while the other waits.
pub(super) const LANES: usize = 8;

pub(super) type Lane = [f64; LANES];

/// The lanes that are computed together.
#[derive(Clone, Copy)]
pub(super) struct Lanes<S: Simd> {
    pub simd: S,
    pub at: usize,
    /// Whether angles that are not small are infinite: whatever they are, they cost the same.
    pub cut: bool,
}

impl<S: Simd> Lanes<S> {
    #[inline(always)]
    pub fn splat(self, value: f64) -> Vector<S> {
        Vector::splat(self.simd, value)
    }

    #[inline(always)]
    pub fn load(self, lane: &Lane) -> Vector<S> {
        Vector::load(self.simd, lane, self.at)
    }
}
