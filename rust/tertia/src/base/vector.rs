//! SIMD vectors that add and multiply like numbers.

use pulp::Simd;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

/// Number of lanes of the widest vector.
pub(crate) const WIDEST: usize = 8;

/// A vector of as many lanes as the processor has.
#[derive(Clone, Copy)]
pub(crate) struct Vector<S: Simd> {
    simd: S,
    lanes: S::f64s,
}

impl<S: Simd> Add for Vector<S> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self { lanes: self.simd.add_f64s(self.lanes, other.lanes), ..self }
    }
}

impl<S: Simd> Sub for Vector<S> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self { lanes: self.simd.sub_f64s(self.lanes, other.lanes), ..self }
    }
}

impl<S: Simd> Mul for Vector<S> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self { lanes: self.simd.mul_f64s(self.lanes, other.lanes), ..self }
    }
}

impl<S: Simd> Div for Vector<S> {
    type Output = Self;
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        Self { lanes: self.simd.div_f64s(self.lanes, other.lanes), ..self }
    }
}

impl<S: Simd> Neg for Vector<S> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self { lanes: self.simd.neg_f64s(self.lanes), ..self }
    }
}

impl<S: Simd> AddAssign for Vector<S> {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl<S: Simd> SubAssign for Vector<S> {
    #[inline(always)]
    fn sub_assign(&mut self, other: Self) {
        *self = *self - other;
    }
}

impl<S: Simd> Vector<S> {
    #[inline(always)]
    pub fn splat(simd: S, value: f64) -> Self {
        Self { simd, lanes: simd.splat_f64s(value) }
    }

    #[inline(always)]
    pub fn splat_all<const N: usize>(simd: S, values: &[f64; N]) -> [Self; N] {
        let mut vectors = [Self::splat(simd, 0.0); N];
        // not `map`: its closure would not be compiled with the vectors of `simd`
        for (vector, &value) in vectors.iter_mut().zip(values) {
            *vector = Self::splat(simd, value);
        }
        vectors
    }

    #[inline(always)]
    pub fn load<const L: usize>(simd: S, lane: &[f64; L], at: usize) -> Self {
        Self { simd, lanes: S::as_simd_f64s(lane).0[at] }
    }

    #[inline(always)]
    pub fn load_all<const L: usize, const N: usize>(
        simd: S,
        lanes: &[[f64; L]; N],
        at: usize,
    ) -> [Self; N] {
        let mut vectors = [Self::splat(simd, 0.0); N];
        for (vector, lane) in vectors.iter_mut().zip(lanes) {
            *vector = Self::load(simd, lane, at);
        }
        vectors
    }

    #[inline(always)]
    pub fn store<const L: usize>(self, lane: &mut [f64; L], at: usize) {
        S::as_mut_simd_f64s(lane).0[at] = self.lanes;
    }

    #[inline(always)]
    pub fn store_all<const L: usize, const N: usize>(
        vectors: &[Self; N],
        lanes: &mut [[f64; L]; N],
        at: usize,
    ) {
        for (vector, lane) in vectors.iter().zip(lanes) {
            vector.store(lane, at);
        }
    }

    #[inline(always)]
    fn of(simd: S, lanes: S::f64s) -> Self {
        Self { simd, lanes }
    }

    /// Returns four vectors of the first, second, third and fourth numbers of as many rows as there are
    /// lanes; the first row is `at` times the number of lanes. The order of rows in the lanes depends on the
    /// machine; [`Vector::to_rows`] restores it.
    #[inline(always)]
    pub fn from_rows(simd: S, rows: &[[f64; 4]], at: usize) -> [Self; 4] {
        let lanes = &S::as_simd_f64s(rows.as_flattened()).0[4 * at..][..4];
        let [a, b, c, d] = simd.deinterleave_shfl_f64s([lanes[0], lanes[1], lanes[2], lanes[3]]);
        [Self::of(simd, a), Self::of(simd, b), Self::of(simd, c), Self::of(simd, d)]
    }

    /// Writes four vectors from [`Vector::from_rows`] back to their rows.
    #[inline(always)]
    pub fn to_rows(simd: S, [a, b, c, d]: [Self; 4], rows: &mut [[f64; 4]], at: usize) {
        let columns = simd.interleave_shfl_f64s([a.lanes, b.lanes, c.lanes, d.lanes]);
        S::as_mut_simd_f64s(rows.as_flattened_mut()).0[4 * at..][..4].copy_from_slice(&columns);
    }

    /// Mask of the lanes that are not nan.
    #[inline(always)]
    pub fn is_number(self) -> S::m64s {
        self.simd.equal_f64s(self.lanes, self.lanes)
    }

    /// Whether the size of any lane exceeds the bound; a nan does not.
    #[inline(always)]
    pub fn exceeds(self, bound: f64) -> bool {
        let size = self.simd.abs_f64s(self.lanes);
        let larger = self.simd.greater_than_f64s(size, self.simd.splat_f64s(bound));
        self.simd.first_true_m64s(larger) < S::F64_LANES
    }

    /// Whether all lanes are at least `low` and less than `high`.
    #[inline(always)]
    pub fn is_within(self, low: f64, high: f64) -> bool {
        let above = self.simd.greater_than_or_equal_f64s(self.lanes, self.simd.splat_f64s(low));
        let below = self.simd.less_than_f64s(self.lanes, self.simd.splat_f64s(high));
        let outside = self.simd.not_m64s(self.simd.and_m64s(above, below));
        self.simd.first_true_m64s(outside) >= S::F64_LANES
    }

    /// Selects this vector where `mask` is set, and the other one elsewhere.
    #[inline(always)]
    pub fn or(self, mask: S::m64s, other: Self) -> Self {
        Self { lanes: self.simd.select_f64s(mask, self.lanes, other.lanes), ..self }
    }

    #[inline(always)]
    pub fn max(self, other: Self) -> Self {
        Self { lanes: self.simd.max_f64s(self.lanes, other.lanes), ..self }
    }

    #[inline(always)]
    pub fn min(self, other: Self) -> Self {
        Self { lanes: self.simd.min_f64s(self.lanes, other.lanes), ..self }
    }

    #[inline(always)]
    pub fn reciprocal(self) -> Self {
        let one = self.simd.splat_f64s(1.0);
        Self { lanes: self.simd.div_f64s(one, self.lanes), ..self }
    }

    #[inline(always)]
    pub fn sqrt(self) -> Self {
        Self { lanes: self.simd.sqrt_f64s(self.lanes), ..self }
    }

    #[inline(always)]
    pub fn abs(self) -> Self {
        Self { lanes: self.simd.abs_f64s(self.lanes), ..self }
    }

    /// Mask of the lanes that are at most as large as those of the other vector; unset if one is nan.
    #[inline(always)]
    pub fn at_most(self, other: Self) -> S::m64s {
        self.simd.less_than_or_equal_f64s(self.lanes, other.lanes)
    }

    /// Whether all lanes are positive.
    #[inline(always)]
    pub fn all_positive(self) -> bool {
        let zero = self.simd.splat_f64s(0.0);
        let others = self.simd.less_than_or_equal_f64s(self.lanes, zero);
        self.simd.first_true_m64s(others) >= S::F64_LANES
    }
}
