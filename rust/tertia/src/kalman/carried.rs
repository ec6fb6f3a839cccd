//! State of series in the lanes of a vector that is carried from step to step.

use super::kept::TILE;
use super::model::{predicted_covariance, predicted_mean};
use super::series::{PRODUCTS, Series, Summary, log_likelihood};
use super::shared::Gains;
use super::state::{FACTORS_ABOVE, State, residual};
use crate::base::vector::{Vector, WIDEST};
use pulp::Simd;

/// F and Q of a transition in all lanes.
pub(super) type Splat<S> = ([Vector<S>; 4], [Vector<S>; 6]);

/// Values that the lanes of a vector carry from tile to tile.
#[derive(Clone, Copy)]
#[repr(align(64))]
pub(super) struct Carried<S: Simd> {
    pub mean: [Vector<S>; 3],
    pub covariance: [Vector<S>; 6],
    /// Sum of the squares of normalised innovations, and of logarithms of their variances.
    squares: Vector<S>,
    /// Product of the variances of innovations whose logarithms have not been taken.
    product: Vector<S>,
    count: Vector<S>,
    /// Smallest R/S: it is small if a prior was too wide for the noise.
    narrowest: Vector<S>,
}

impl<S: Simd> Carried<S> {
    /// Creates the lanes for up to as many series as there are lanes; the other lanes have no state.
    /// Returns `None` if a covariance is kept as factors, unless only the mean is used.
    #[inline(always)]
    pub fn new(simd: S, summaries: &[Summary], mean_only: bool) -> Option<Self> {
        let mut rows = [[[0.0; 4]; WIDEST]; 3];
        for (l, summary) in summaries.iter().enumerate() {
            let state = if mean_only { summary.filter.state() } else { summary.filter.plain()? };
            let ([x0, x1, x2], [p00, p01, p02, p11, p12, p22]) = (state.mean, state.covariance);
            rows[0][l] = [x0, x1, x2, p00];
            rows[1][l] = [p01, p02, p11, p12];
            rows[2][l] = [p22, 0.0, 0.0, 0.0];
        }
        let [x0, x1, x2, p00] = Vector::from_rows(simd, &rows[0], 0);
        let [p01, p02, p11, p12] = Vector::from_rows(simd, &rows[1], 0);
        let [p22, zero, ..] = Vector::from_rows(simd, &rows[2], 0);
        let one = Vector::splat(simd, 1.0);
        Some(Self {
            mean: [x0, x1, x2],
            covariance: [p00, p01, p02, p11, p12, p22],
            squares: zero,
            product: one,
            count: zero,
            narrowest: one,
        })
    }

    /// Adds the results to the summaries of the first steps; returns `None` if something is refused.
    #[inline(always)]
    pub fn finish(
        &self,
        simd: S,
        summaries: &mut [Summary],
        series: &[Series<'_>],
        gains: Option<(&Gains, usize)>,
    ) -> Option<()> {
        let mut rows = [[[0.0; 4]; WIDEST]; 4];
        let [x0, x1, x2] = self.mean;
        let [p00, p01, p02, p11, p12, p22] = self.covariance;
        let columns = [
            [x0, x1, x2, p00],
            [p01, p02, p11, p12],
            [p22, self.squares, self.product, self.count],
            [self.narrowest; 4],
        ];
        for (columns, rows) in columns.into_iter().zip(&mut rows) {
            Vector::to_rows(simd, columns, rows, 0);
        }
        for (l, (summary, series)) in summaries.iter_mut().zip(series).enumerate() {
            let ([x0, x1, x2, p00], [p01, p02, p11, p12]) = (rows[0][l], rows[1][l]);
            let ([p22, squares, product, count], [narrowest, ..]) = (rows[2][l], rows[3][l]);
            if narrowest * (1.0 + FACTORS_ABOVE) < 1.0 || !squares.is_finite() {
                return None;
            }
            let mean = [x0, x1, x2];
            let (covariance, logarithms, count) = match gains {
                None => ([p00, p01, p02, p11, p12, p22], product.ln(), count as usize),
                Some((gains, start)) => {
                    let n = gains.covariance.len();
                    (gains.covariance[n - 1], gains.logarithms[start], n - start)
                }
            };
            let noise = series.last_variance().unwrap_or(summary.filter.noise());
            summary.filter.set(State { mean, covariance }, noise);
            summary.log_likelihood += log_likelihood(squares, logarithms, count);
            summary.count += count;
        }
        Some(())
    }

    /// [`State::predicted`] and [`State::updated`] in all lanes, with the operations in the same order.
    /// Without a plot, gain and innovation are zero. Returns the innovation (nan without a plot) and
    /// its variance (1 without a plot).
    #[inline(always)]
    pub fn step(
        &mut self,
        simd: S,
        transition: &Splat<S>,
        z: Vector<S>,
        r: Vector<S>,
        period: Option<f64>,
    ) -> (Vector<S>, Vector<S>) {
        let (zero, one) = (Vector::splat(simd, 0.0), Vector::splat(simd, 1.0));
        let (f, q) = transition;
        let y = predicted_mean(f, &self.mean);
        let [p00, p01, p02, p11, p12, p22] = predicted_covariance(f, q, &self.covariance);
        let seen = z.is_number();
        let raw = innovation(simd, z, y[0], period);
        let value = raw.or(seen, zero);
        let variance = p00 + r;
        let s = variance.reciprocal().or(seen, zero);
        let rest = (r * s).or(seen, one);
        let (k0, k1, k2) = (p00 * s, p01 * s, p02 * s);
        self.mean = [y[0] + k0 * value, y[1] + k1 * value, y[2] + k2 * value];
        self.covariance =
            [p00 * rest, p01 * rest, p02 * rest, p11 - p01 * k1, p12 - p01 * k2, p22 - p02 * k2];
        self.squares += value * value * s;
        self.count += one.or(seen, zero);
        self.narrowest = self.narrowest.min(rest);
        (raw, variance.or(seen, one))
    }

    /// Computes a step of the mean with known gain and 1/S; returns the innovation.
    #[inline(always)]
    pub fn share(
        &mut self,
        simd: S,
        f: &[Vector<S>; 4],
        gain: &[Vector<S>; 4],
        z: Vector<S>,
        period: Option<f64>,
    ) -> Vector<S> {
        let ([y0, y1, y2], [k0, k1, k2, s]) = (predicted_mean(f, &self.mean), *gain);
        let value = innovation(simd, z, y0, period);
        self.mean = [y0 + k0 * value, y1 + k1 * value, y2 + k2 * value];
        self.squares += value * value * s;
        value
    }

    /// Multiplies the variances of the innovations of a tile; if the product leaves its range,
    /// logarithms are taken.
    #[inline(always)]
    pub fn multiply(&mut self, simd: S, variances: &[Vector<S>; TILE]) {
        let [a, b, c, d, e, f, g, h] = *variances;
        let tile = (a * b * (c * d)) * (e * f * (g * h));
        let total = self.product * tile;
        if total.is_within(PRODUCTS.start, PRODUCTS.end) {
            self.product = total;
            return;
        }
        let fits = tile.is_within(PRODUCTS.start, PRODUCTS.end);
        let (single, one) = ([a, b, c, d, e, f, g, h], Vector::splat(simd, 1.0));
        let mut sums = [0.0; WIDEST];
        for factor in single[..if fits { 0 } else { TILE }].iter().chain([&self.product]) {
            let mut lanes = [1.0; WIDEST];
            factor.store(&mut lanes, 0);
            for (sum, variance) in sums.iter_mut().zip(lanes) {
                *sum += variance.ln();
            }
        }
        self.squares += Vector::load(simd, &sums, 0);
        self.product = if fits { tile } else { one };
    }
}

/// Returns the innovation; nan without a plot.
#[inline(always)]
fn innovation<S: Simd>(simd: S, z: Vector<S>, x: Vector<S>, period: Option<f64>) -> Vector<S> {
    let difference = z - x;
    if let Some(period) = period
        && difference.exceeds(0.5 * period)
    {
        let mut lanes = [0.0; WIDEST];
        difference.store(&mut lanes, 0);
        for value in &mut lanes {
            *value = residual(*value, 0.0, Some(period));
        }
        return Vector::load(simd, &lanes, 0);
    }
    difference
}
