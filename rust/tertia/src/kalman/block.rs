//! Several series side by side, one in each lane of a vector: what a step costs is shared.

use super::filter::Filter;
use super::model::Transition;
use super::series::{PRODUCTS, Series, Summary, log_likelihood};
use super::state::{FACTORS_ABOVE, Innovation, State, residual};
use pulp::{Arch, Simd, WithSimd};
use std::ops::{Add, Mul, Sub};

/// Series that are filtered together: two vectors, or one, or four.
pub const LANES: usize = 8;
/// Steps whose plots are gathered at once: vectors are read long after their lanes were written.
const TILE: usize = 16;

type Lane = [f64; LANES];

/// Filters series of the same length with the same steps between their plots. `None` where they
/// must be filtered one by one: a prior that is kept as factors, or a start that takes all steps.
pub fn run_block(
    series: &[Series<'_>; LANES],
    filters: [Filter; LANES],
    sink: impl FnMut(usize, usize, &State, Innovation),
) -> Option<[Summary; LANES]> {
    let n = series[0].z.len();
    let start = series.iter().zip(&filters).map(|(series, filter)| known_from(series, filter));
    let start = start.max().filter(|&start| start < n)?;
    Arch::new().dispatch(Run { series, filters, start, sink })
}

/// The step by which the state of a series is known.
fn known_from(series: &Series<'_>, filter: &Filter) -> usize {
    if filter.plain().is_some() {
        return 1;
    }
    let mut plots = series.z.iter().enumerate().filter(|(_, z)| !z.is_nan());
    plots.nth(1).map_or(series.z.len(), |(step, _)| step + 1)
}

struct Run<'a, F> {
    series: &'a [Series<'a>; LANES],
    filters: [Filter; LANES],
    start: usize,
    sink: F,
}

impl<F: FnMut(usize, usize, &State, Innovation)> WithSimd for Run<'_, F> {
    type Output = Option<[Summary; LANES]>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        let Self { series, filters, start, mut sink } = self;
        let mut summaries = Vec::with_capacity(LANES);
        let mut lanes = Lanes::new();
        for (l, (series, filter)) in series.iter().zip(filters).enumerate() {
            let head = Series { z: &series.z[..start], ..*series };
            let summary = head.run(filter, |step, state, none| sink(l, step, state, none));
            lanes.set(l, &summary.filter.plain()?);
            summaries.push(summary);
        }
        let (n, period) = (series[0].z.len(), summaries[0].filter.period());
        let (mut z, mut r) = ([[0.0; LANES]; TILE], [[0.0; LANES]; TILE]);
        for from in (start..n).step_by(TILE) {
            let steps = TILE.min(n - from);
            for (l, series) in series.iter().enumerate() {
                for i in 0..steps {
                    z[i][l] = series.z[from + i];
                    r[i][l] = series.variance.at(from + i);
                }
            }
            for i in 0..steps {
                let step = from + i;
                lanes.step(simd, &series[0].transition.at(step - 1), &z[i], &r[i], period);
                for (l, &z) in z[i].iter().enumerate() {
                    sink(l, step, &lanes.state(l), lanes.innovation(l, z));
                }
            }
        }
        if lanes.wide.iter().any(|&excess| excess > 0.0) {
            return None;
        }
        for (l, (summary, series)) in summaries.iter_mut().zip(series).enumerate() {
            let count = series.z[start..].iter().filter(|z| !z.is_nan()).count();
            let noise = series.last_variance().unwrap_or(summary.filter.noise());
            summary.filter.set(lanes.state(l), noise);
            summary.log_likelihood += log_likelihood(lanes.squares[l], lanes.product[l], count);
            summary.count += count;
        }
        summaries.try_into().ok()
    }
}

/// Everything that changes from step to step, lane by lane.
struct Lanes {
    mean: [Lane; 3],
    covariance: [Lane; 6],
    value: Lane,
    variance: Lane,
    squares: Lane,
    product: Lane,
    /// Positive once a prior was too wide for its noise.
    wide: Lane,
}

/// A vector that adds and multiplies like a number.
#[derive(Clone, Copy)]
struct Vector<S: Simd> {
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

impl<S: Simd> Vector<S> {
    #[inline(always)]
    fn splat(simd: S, value: f64) -> Self {
        Self { simd, lanes: simd.splat_f64s(value) }
    }

    #[inline(always)]
    fn load(simd: S, lane: &Lane, at: usize) -> Self {
        Self { simd, lanes: S::as_simd_f64s(lane).0[at] }
    }

    #[inline(always)]
    fn load_all<const N: usize>(simd: S, lanes: &[Lane; N], at: usize) -> [Self; N] {
        let mut vectors = [Self::splat(simd, 0.0); N];
        // not `map`: its closure would not be compiled for the vectors of `simd`
        for (vector, lane) in vectors.iter_mut().zip(lanes) {
            *vector = Self::load(simd, lane, at);
        }
        vectors
    }

    #[inline(always)]
    fn splat_all<const N: usize>(simd: S, values: &[f64; N]) -> [Self; N] {
        let mut vectors = [Self::splat(simd, 0.0); N];
        for (vector, &value) in vectors.iter_mut().zip(values) {
            *vector = Self::splat(simd, value);
        }
        vectors
    }

    #[inline(always)]
    fn store(self, lane: &mut Lane, at: usize) {
        S::as_mut_simd_f64s(lane).0[at] = self.lanes;
    }

    /// This where `mask` is set, the other one elsewhere.
    #[inline(always)]
    fn or(self, mask: S::m64s, other: Self) -> Self {
        Self { lanes: self.simd.select_f64s(mask, self.lanes, other.lanes), ..self }
    }

    #[inline(always)]
    fn reciprocal(self) -> Self {
        let one = self.simd.splat_f64s(1.0);
        Self { lanes: self.simd.div_f64s(one, self.lanes), ..self }
    }
}

impl Lanes {
    fn new() -> Self {
        let zeros = [0.0; LANES];
        Self {
            mean: [zeros; 3],
            covariance: [zeros; 6],
            value: zeros,
            variance: zeros,
            squares: zeros,
            product: [1.0; LANES],
            wide: zeros,
        }
    }

    fn set(&mut self, l: usize, state: &State) {
        for (lane, x) in self.mean.iter_mut().zip(state.mean) {
            lane[l] = x;
        }
        for (lane, p) in self.covariance.iter_mut().zip(state.covariance) {
            lane[l] = p;
        }
    }

    #[inline(always)]
    fn state(&self, l: usize) -> State {
        let ([x0, x1, x2], [p00, p01, p02, p11, p12, p22]) = (&self.mean, &self.covariance);
        State {
            mean: [x0[l], x1[l], x2[l]],
            covariance: [p00[l], p01[l], p02[l], p11[l], p12[l], p22[l]],
        }
    }

    #[inline(always)]
    fn innovation(&self, l: usize, z: f64) -> Innovation {
        if z.is_nan() {
            Innovation::NONE
        } else {
            Innovation { value: self.value[l], variance: self.variance[l] }
        }
    }

    /// [`State::predicted`] and [`State::updated`] in all lanes, in the same order; without a plot,
    /// gain and innovation are zero.
    #[inline(always)]
    fn step<S: Simd>(
        &mut self,
        simd: S,
        transition: &Transition,
        z: &Lane,
        r: &Lane,
        period: Option<f64>,
    ) {
        for at in 0..S::as_simd_f64s(z).0.len() {
            self.predict(simd, transition, z, at);
        }
        if let Some(period) = period {
            for ((value, &z), &x) in self.value.iter_mut().zip(z).zip(&self.mean[0]) {
                *value = residual(z, x, Some(period));
            }
        }
        for at in 0..S::as_simd_f64s(z).0.len() {
            self.update(simd, z, r, at);
        }
        // lanes without a plot have multiplied by one
        let mut outside = false;
        for product in &self.product {
            outside |= !PRODUCTS.contains(product);
        }
        if outside {
            for (squares, product) in self.squares.iter_mut().zip(&mut self.product) {
                *squares += product.ln();
                *product = 1.0;
            }
        }
    }

    #[inline(always)]
    fn predict<S: Simd>(&mut self, simd: S, transition: &Transition, z: &Lane, at: usize) {
        let [f01, f02, f12, f22] = Vector::splat_all(simd, &transition.f);
        let q = Vector::splat_all(simd, &transition.q);
        let x = Vector::load_all(simd, &self.mean, at);
        let [p00, p01, p02, p11, p12, p22] = Vector::load_all(simd, &self.covariance, at);
        let a00 = p00 + f01 * p01 + f02 * p02;
        let a01 = p01 + f01 * p11 + f02 * p12;
        let a02 = p02 + f01 * p12 + f02 * p22;
        let a11 = p11 + f12 * p12;
        let a12 = p12 + f12 * p22;
        let covariance = [
            a00 + f01 * a01 + f02 * a02 + q[0],
            a01 + f12 * a02 + q[1],
            f22 * a02 + q[2],
            a11 + f12 * a12 + q[3],
            f22 * a12 + q[4],
            f22 * f22 * p22 + q[5],
        ];
        let mean = [x[0] + f01 * x[1] + f02 * x[2], x[1] + f12 * x[2], f22 * x[2]];
        (Vector::load(simd, z, at) - mean[0]).store(&mut self.value, at);
        for (lane, value) in self.mean.iter_mut().zip(mean) {
            value.store(lane, at);
        }
        for (lane, value) in self.covariance.iter_mut().zip(covariance) {
            value.store(lane, at);
        }
    }

    #[inline(always)]
    fn update<S: Simd>(&mut self, simd: S, z: &Lane, r: &Lane, at: usize) {
        let (zero, one) = (Vector::splat(simd, 0.0), Vector::splat(simd, 1.0));
        let plot = S::as_simd_f64s(z).0[at];
        let seen = simd.equal_f64s(plot, plot);
        let r = Vector::load(simd, r, at);
        let x = Vector::load_all(simd, &self.mean, at);
        let [p00, p01, p02, p11, p12, p22] = Vector::load_all(simd, &self.covariance, at);
        let variance = (p00 + r).or(seen, one);
        let s = variance.reciprocal().or(seen, zero);
        let kept = (r * s).or(seen, one);
        let value = Vector::load(simd, &self.value, at).or(seen, zero);
        let excess = (p00 - r * Vector::splat(simd, FACTORS_ABOVE)).or(seen, zero);
        let wide = Vector::load(simd, &self.wide, at).lanes;
        let wide = Vector { simd, lanes: simd.max_f64s(wide, excess.lanes) };
        let gain = [p00 * s, p01 * s, p02 * s];
        for ((lane, x), k) in self.mean.iter_mut().zip(x).zip(gain) {
            (x + k * value).store(lane, at);
        }
        let covariance = [
            p00 * kept,
            p01 * kept,
            p02 * kept,
            p11 - p01 * gain[1],
            p12 - p01 * gain[2],
            p22 - p02 * gain[2],
        ];
        for (lane, value) in self.covariance.iter_mut().zip(covariance) {
            value.store(lane, at);
        }
        wide.store(&mut self.wide, at);
        variance.store(&mut self.variance, at);
        let squares = Vector::load(simd, &self.squares, at) + value * value * s;
        squares.store(&mut self.squares, at);
        let product = Vector::load(simd, &self.product, at) * variance;
        product.store(&mut self.product, at);
    }
}
