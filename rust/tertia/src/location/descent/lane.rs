//! Values of several instants, side by side.

use crate::base::vector::Vector;
use pulp::Simd;

/// Number of instants side by side: two AVX2 vectors, so that the operations of the two can overlap.
pub(in crate::location) const LANES: usize = 8;

pub(in crate::location) type Lane = [f64; LANES];

/// The lanes that are computed together, as one vector that begins at vector number `at`.
#[derive(Clone, Copy)]
pub(in crate::location) struct Lanes<S: Simd> {
    pub simd: S,
    pub at: usize,
    /// Whether angles that are not small are replaced by infinity, because their cost does not depend
    /// on their size.
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
