//! Windows of equal steps without a gap: the fit at the middle is a convolution, which is computed for many
//! windows side by side.

use crate::base::basis::Basis;
use crate::base::interrupt::poll;
use pulp::{Simd, WithSimd};
use std::borrow::Cow;

/// Highest degree; higher ones are of no use in a window.
pub(super) const HIGHEST: usize = 9;
/// Number of windows that are fitted side by side.
const LANES: usize = 16;
/// Number of windows between two checks for an interruption.
const POLLED: usize = 64 * LANES;

/// The fit at the middle of a window of equal steps.
#[derive(Clone, Debug)]
pub(super) struct Stencil {
    basis: Basis,
    window: usize,
    degree: usize,
    derivative: usize,
    /// Weights of the measurements after the middle in the derivative, and in the value.
    taps: Vec<f64>,
    value_taps: Vec<f64>,
    /// Derivatives, and values, of the polynomials at the middle.
    at: Vec<f64>,
    values: Vec<f64>,
    /// Standard error of every degree, for unit variance.
    pub error: Vec<f64>,
    /// Weight of the middle measurement in its own value.
    pub leverage: f64,
    /// Degrees of freedom per measurement.
    pub freedom: f64,
}

impl Stencil {
    /// Sets up the fit of polynomials up to `degree` to instants that are `step` apart.
    pub fn new(window: usize, degree: usize, derivative: usize, step: f64) -> Self {
        let half = window / 2;
        // whole numbers over the half width: the polynomials are those of Gram, exactly even or odd
        let scale = half.max(1) as f64;
        let x: Vec<f64> = (0..window).map(|k| (k as f64 - half as f64) / scale).collect();
        let mut basis = Basis::default();
        basis.build(degree, &x, &vec![1.0; window]);
        let (mut at, mut values) = (Vec::new(), Vec::new());
        basis.derivatives(derivative, 0.0, &mut at);
        basis.derivatives(0, 0.0, &mut values);
        let unit = (scale * step).powi(-(derivative as i32));
        at.iter_mut().for_each(|p| *p *= unit);
        let tap =
            |p: &[f64], k: usize| -> f64 { (0..=degree).map(|j| p[j] * basis.row(j)[k]).sum() };
        let taps = (half + 1..window).map(|k| tap(&at, k)).collect();
        let value_taps = (half + 1..window).map(|k| tap(&values, k)).collect();
        let all: Vec<f64> = (0..window).map(|k| tap(&values, k)).collect();
        let error =
            (0..=degree).map(|p| at[..=p].iter().map(|p| p * p).sum::<f64>().sqrt()).collect();
        let (leverage, freedom) = (all[half], freedom(&all));
        Self {
            basis,
            window,
            degree,
            derivative,
            taps,
            value_taps,
            at,
            values,
            error,
            leverage,
            freedom,
        }
    }
}

/// Degrees of freedom per measurement of the mean square of `y − Σ taps y`, from its first two moments.
fn freedom(taps: &[f64]) -> f64 {
    let half = taps.len() / 2;
    let filter: Vec<f64> =
        taps.iter().enumerate().map(|(k, tap)| f64::from(u8::from(k == half)) - tap).collect();
    let lagged =
        |lag: usize| -> f64 { filter.iter().zip(&filter[lag..]).map(|(a, b)| a * b).sum() };
    let zero = lagged(0).powi(2);
    let squared = |lag: usize| {
        poll();
        lagged(lag).powi(2)
    };
    let others: f64 = (1..taps.len()).map(squared).sum();
    if zero > 0.0 { zero / (zero + 2.0 * others) } else { 0.0 }
}

/// The polynomial of one degree at the middle of all windows; returns the sum of the squared residuals there.
pub(super) struct Convolution<'a> {
    pub stencil: &'a Stencil,
    pub y: &'a [f64],
    pub value: &'a mut [f64],
}

impl WithSimd for Convolution<'_> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> f64 {
        let Self { stencil, y, value } = self;
        let half = stencil.window / 2;
        let mut squares = [0.0; LANES];
        for (start, count) in blocks(value.len()) {
            let block = full(&y[start..start + count + 2 * half], LANES + 2 * half);
            let block = &block[..];
            let middle = lanes(block, half);
            let left = weigh(&stencil.value_taps, true, block, half, middle);
            let result = if stencil.derivative == 0 {
                let mut result = middle;
                for l in 0..LANES {
                    result[l] += left[l];
                }
                result
            } else {
                weigh(&stencil.taps, stencil.derivative % 2 == 0, block, half, middle)
            };
            for l in 0..LANES {
                if l < count {
                    squares[l] += left[l] * left[l];
                }
            }
            value[start..start + count].copy_from_slice(&result[..count]);
        }
        squares.iter().sum()
    }
}

/// Iterates over blocks of up to [`LANES`] of `n` windows: the first window, and their number.
#[inline(always)]
fn blocks(n: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..n).step_by(LANES).map(move |start| {
        if start % POLLED == 0 {
            poll();
        }
        (start, LANES.min(n - start))
    })
}

/// Returns the plots of a block of windows, with zeros after the end of the last one.
#[inline(always)]
fn full(y: &[f64], size: usize) -> Cow<'_, [f64]> {
    if y.len() == size {
        return Cow::Borrowed(y);
    }
    let mut padded = vec![0.0; size];
    padded[..y.len()].copy_from_slice(y);
    Cow::Owned(padded)
}

#[inline(always)]
fn lanes(y: &[f64], at: usize) -> [f64; LANES] {
    let mut lanes = [0.0; LANES];
    lanes.copy_from_slice(&y[at..at + LANES]);
    lanes
}

/// `Σ c_k (y_k − y_0 ± (y_−k − y_0))` for all lanes: a common offset costs no accuracy.
#[inline(always)]
fn weigh(taps: &[f64], even: bool, y: &[f64], half: usize, middle: [f64; LANES]) -> [f64; LANES] {
    let mut sums = [0.0; LANES];
    for (k, &tap) in taps.iter().enumerate() {
        let (after, before) = (lanes(y, half + k + 1), lanes(y, half - k - 1));
        if even {
            for l in 0..LANES {
                sums[l] += tap * ((after[l] - middle[l]) + (before[l] - middle[l]));
            }
        } else {
            for l in 0..LANES {
                sums[l] += tap * (after[l] - before[l]);
            }
        }
    }
    sums
}

/// How a degree is chosen.
#[derive(Clone, Copy)]
pub(super) struct Choice<'a> {
    pub stencil: &'a Stencil,
    /// Critical values of F(1, ν) for every degree.
    pub critical: &'a [f64; HIGHEST + 1],
    pub lowest: usize,
}

/// The polynomial of the chosen degree at the middle of all windows. One pass over a window gives the
/// coefficients of all degrees, another one the residuals of the highest degree.
pub(super) struct Adaptive<'a> {
    pub choice: Choice<'a>,
    pub y: &'a [f64],
    pub value: &'a mut [f64],
    pub sigma: &'a mut [f64],
    pub degree: &'a mut [i64],
}

impl WithSimd for Adaptive<'_> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> f64 {
        let Self { choice, y, value, sigma, degree } = self;
        let stencil = choice.stencil;
        let (window, half, top) = (stencil.window, stencil.window / 2, stencil.degree);
        let mut total = 0.0;
        for (start, count) in blocks(value.len()) {
            let block = full(&y[start..start + count + 2 * half], LANES + 2 * half);
            let block = &block[..];
            let middle = lanes(block, half);
            let mut coefficients = [[0.0; LANES]; HIGHEST + 1];
            let (mut squares, mut largest) = ([0.0; LANES], [0.0_f64; LANES]);
            for k in 0..window {
                let own = lanes(block, k);
                for (j, sums) in coefficients[..=top].iter_mut().enumerate() {
                    let p = stencil.basis.row(j)[k];
                    for l in 0..LANES {
                        sums[l] += p * (own[l] - middle[l]);
                    }
                }
            }
            for k in 0..window {
                let own = lanes(block, k);
                let mut left = own;
                for l in 0..LANES {
                    left[l] -= middle[l];
                    largest[l] = if own[l].abs() > largest[l] { own[l].abs() } else { largest[l] };
                }
                for (j, c) in coefficients[..=top].iter().enumerate() {
                    let p = stencil.basis.row(j)[k];
                    for l in 0..LANES {
                        left[l] -= p * c[l];
                    }
                }
                for l in 0..LANES {
                    squares[l] += left[l] * left[l];
                }
            }
            for l in 0..count {
                let mut c = [0.0; HIGHEST + 1];
                for (c, lanes) in c.iter_mut().zip(&coefficients) {
                    *c = lanes[l];
                }
                let rounding = window as f64 * (f64::EPSILON * largest[l]).powi(2);
                let p = choice.degree(&c, squares[l].max(rounding));
                let offset = if stencil.derivative == 0 { middle[l] } else { 0.0 };
                let mut sum = 0.0;
                for (c, at) in c[..=p].iter().zip(&stencil.at) {
                    sum += c * at;
                }
                let mut left = 0.0;
                for (c, value) in c.iter().zip(&stencil.values) {
                    left += c * value;
                }
                value[start + l] = offset + sum;
                sigma[start + l] = stencil.error[p];
                degree[start + l] = p as i64;
                total += left * left;
            }
        }
        total
    }
}

impl Choice<'_> {
    #[inline(always)]
    fn degree(&self, c: &[f64; HIGHEST + 1], mut squares: f64) -> usize {
        let (mut p, window) = (self.stencil.degree, self.stencil.window);
        while p > self.lowest {
            let square = c[p] * c[p];
            if square * (window - p - 1) as f64 > self.critical[p] * squares {
                return p;
            }
            squares += square;
            p -= 1;
        }
        p
    }
}
