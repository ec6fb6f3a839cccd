//! Several series side by side, one in each lane of a vector: what a step costs is shared.

use super::filter::Filter;
use super::kept::{Kept, RUN, TILE, rooms};
use super::model::Transition;
use super::series::{LARGEST, PRODUCTS, PerStep, Series, Summary, VARIANCES, log_likelihood};
use super::shared::Gains;
use super::state::{FACTORS_ABOVE, State, residual};
use super::steps::Steps;
use crate::base::vector::{Vector, WIDEST};
use pulp::{Arch, Simd, WithSimd};

/// Series that are filtered together: vectors enough to hide that each waits for its last step.
pub(super) const LANES: usize = 64;

/// Filters up to [`LANES`] series of the same length with the same steps between their plots, with
/// `gains` if they are those of all of them and no plot is missing, and keeps what `out` has room
/// for. `None` where they must be filtered one by one: a prior that is kept as factors, a start
/// that takes all steps, or plots and variances that are refused.
pub(super) fn run_block(
    series: &[Series<'_>],
    filters: &[Filter],
    gains: Option<&Gains>,
    out: &mut [&mut Steps<'_>],
    buffer: &mut Vec<f64>,
) -> Option<Vec<Summary>> {
    let n = series.first()?.z.len();
    let start = series.iter().zip(filters).map(|(series, filter)| known_from(series, filter));
    let start = start.max().filter(|&start| start < n)?;
    let gained = gains.and_then(|gains| {
        let (gains, out, buffer) = (Some(gains), &mut *out, &mut *buffer);
        Arch::new().dispatch(Run { series, filters, gains, start, out, buffer })
    });
    gained
        .or_else(|| Arch::new().dispatch(Run { series, filters, gains: None, start, out, buffer }))
}

/// The step by which the state of a series is known.
fn known_from(series: &Series<'_>, filter: &Filter) -> usize {
    if filter.plain().is_some() {
        return 1;
    }
    let mut plots = series.z.iter().enumerate().filter(|(_, z)| !z.is_nan());
    plots.nth(1).map_or(series.z.len(), |(step, _)| step + 1)
}

struct Run<'a, 'b, 'c, 'd> {
    series: &'a [Series<'a>],
    filters: &'a [Filter],
    gains: Option<&'a Gains>,
    start: usize,
    out: &'b mut [&'c mut Steps<'d>],
    buffer: &'b mut Vec<f64>,
}

impl WithSimd for Run<'_, '_, '_, '_> {
    type Output = Option<Vec<Summary>>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        let Self { series, filters, gains, start, out, buffer } = self;
        let n = series[0].z.len();
        let mut summaries = Vec::with_capacity(series.len());
        for ((series, filter), out) in series.iter().zip(filters).zip(&mut *out) {
            summaries.push(series.head(start)?.fill(*filter, out));
        }
        let mut vectors = Vec::with_capacity(LANES / S::F64_LANES);
        for summaries in summaries.chunks(S::F64_LANES) {
            vectors.push(Carried::new(simd, summaries, gains.is_some())?);
        }
        let mut widths = out[0].widths();
        if gains.is_some() {
            // they are the same for all series
            (widths[1], widths[3]) = (0, 0);
        }
        let mut kept = rooms(buffer, out.len(), widths);
        let all = !kept.is_empty();
        let mut tile = Tile::new(series, summaries[0].filter.period());
        for first in (start..n).step_by(RUN) {
            let end = n.min(first + RUN);
            let whole = first + (end - first) / TILE * TILE;
            for from in (first..whole).step_by(TILE) {
                tile.gather::<TILE>(series, from, first);
                match (gains, all) {
                    (Some(gains), _) => tile.share::<S, TILE>(simd, gains, &mut vectors, &mut kept),
                    (None, false) => tile.run::<S, TILE, false>(simd, &mut vectors, &mut kept),
                    (None, true) => tile.run::<S, TILE, true>(simd, &mut vectors, &mut kept),
                }
            }
            for from in whole..end {
                tile.gather::<1>(series, from, first);
                match (gains, all) {
                    (Some(gains), _) => tile.share::<S, 1>(simd, gains, &mut vectors, &mut kept),
                    (None, false) => tile.run::<S, 1, false>(simd, &mut vectors, &mut kept),
                    (None, true) => tile.run::<S, 1, true>(simd, &mut vectors, &mut kept),
                }
            }
            for (out, kept) in out.iter_mut().zip(&kept) {
                out.take(first, end - first, kept);
            }
        }
        if let Some(gains) = gains {
            out.iter_mut().for_each(|out| gains.put(start, out));
        }
        let groups = summaries.chunks_mut(S::F64_LANES).zip(series.chunks(S::F64_LANES));
        for (carried, (summaries, series)) in vectors.iter().zip(groups) {
            carried.finish(simd, summaries, series, gains.map(|gains| (gains, start)))?;
        }
        Some(summaries)
    }
}

impl<'a> Series<'a> {
    /// The first steps, if their plots and variances can be used.
    fn head(&self, steps: usize) -> Option<Self> {
        let variance = match self.variance {
            PerStep::Constant(r) => PerStep::Constant(r),
            PerStep::Each(each) => PerStep::Each(&each[..steps]),
        };
        Series::try_new(&self.z[..steps], variance, self.transition).ok()
    }
}

/// What the lanes of a vector carry from tile to tile.
#[derive(Clone, Copy)]
struct Carried<S: Simd> {
    mean: [Vector<S>; 3],
    covariance: [Vector<S>; 6],
    /// Sum of the squares of normalised innovations.
    squares: Vector<S>,
    /// Product of the variances of innovations.
    product: Vector<S>,
    count: Vector<S>,
    /// Positive once a prior was too wide for its noise.
    excess: Vector<S>,
    /// Size of the largest plot.
    largest: Vector<S>,
    /// Least and largest variance of the noise.
    least: Vector<S>,
    most: Vector<S>,
}

impl<S: Simd> Carried<S> {
    /// Of up to as many series as there are lanes; without a state where there are none. `None`
    /// where a covariance is kept as factors, unless only the mean is used.
    #[inline(always)]
    fn new(simd: S, summaries: &[Summary], mean_only: bool) -> Option<Self> {
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
        Some(Self {
            mean: [x0, x1, x2],
            covariance: [p00, p01, p02, p11, p12, p22],
            squares: zero,
            product: Vector::splat(simd, 1.0),
            count: zero,
            excess: zero,
            largest: zero,
            least: Vector::splat(simd, 1.0),
            most: Vector::splat(simd, 1.0),
        })
    }

    /// Adds what was found to the summaries of the first steps; `None` where something is refused.
    #[inline(always)]
    fn finish(
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
            [self.excess, self.largest, self.least, self.most],
        ];
        for (columns, rows) in columns.into_iter().zip(&mut rows) {
            Vector::to_rows(simd, columns, rows, 0);
        }
        for (l, (summary, series)) in summaries.iter_mut().zip(series).enumerate() {
            let ([x0, x1, x2, p00], [p01, p02, p11, p12]) = (rows[0][l], rows[1][l]);
            let [p22, squares, product, count] = rows[2][l];
            let [excess, largest, least, most] = rows[3][l];
            let allowed = VARIANCES.contains(&least) && VARIANCES.contains(&most);
            if excess > 0.0 || largest > LARGEST || !allowed || !squares.is_finite() {
                return None;
            }
            let mean = [x0, x1, x2];
            let (mut covariance, mut logarithms, mut count) =
                ([p00, p01, p02, p11, p12, p22], product.ln(), count as usize);
            if let Some((gains, start)) = gains {
                let n = gains.covariance.len();
                (covariance, logarithms) = (gains.covariance[n - 1], gains.logarithms[start]);
                count = n - start;
            }
            let noise = series.last_variance().unwrap_or(summary.filter.noise());
            summary.filter.set(State { mean, covariance }, noise);
            summary.log_likelihood += log_likelihood(squares, logarithms, count);
            summary.count += count;
        }
        Some(())
    }
}

/// Some steps of all series.
struct Tile<'a> {
    z: [[f64; TILE]; LANES],
    r: [[f64; TILE]; LANES],
    transition: PerStep<'a, Transition>,
    period: Option<f64>,
    /// The first of its steps, and of those that are kept together.
    from: usize,
    first: usize,
}

/// F and Q of a step in all lanes.
type Splat<S> = ([Vector<S>; 4], [Vector<S>; 6]);

impl<'a> Tile<'a> {
    fn new(series: &[Series<'a>], period: Option<f64>) -> Self {
        let mut r = [[1.0; TILE]; LANES];
        for (row, series) in r.iter_mut().zip(series) {
            if let PerStep::Constant(variance) = series.variance {
                *row = [variance; TILE];
            }
        }
        let transition = series[0].transition;
        Self { z: [[f64::NAN; TILE]; LANES], r, transition, period, from: 0, first: 0 }
    }

    /// Reads the plots of the next N steps, and the variances of their noise.
    #[inline(always)]
    fn gather<const N: usize>(&mut self, series: &[Series<'_>], from: usize, first: usize) {
        (self.from, self.first) = (from, first);
        for ((z, r), series) in self.z.iter_mut().zip(&mut self.r).zip(series) {
            z[..N].copy_from_slice(&series.z[from..][..N]);
            if let PerStep::Each(each) = series.variance {
                r[..N].copy_from_slice(&each[from..][..N]);
            }
        }
    }

    /// [`State::predicted`] and [`State::updated`] in all lanes, in the same order; without a plot,
    /// gain and innovation are zero.
    #[inline(always)]
    fn run<S: Simd, const N: usize, const ALL: bool>(
        &self,
        simd: S,
        vectors: &mut [Carried<S>],
        out: &mut [Steps<'_>],
    ) {
        let (zero, one) = (Vector::splat(simd, 0.0), Vector::splat(simd, 1.0));
        let nan = Vector::splat(simd, f64::NAN);
        let transitions = self.transitions::<S, N>(simd);
        let mut kept = Kept::new(simd);
        for (at, c) in vectors.iter_mut().enumerate() {
            let z = Vector::from_rows(simd, &self.z, at);
            let r = Vector::from_rows(simd, &self.r, at);
            let mut variances = [one; TILE];
            for i in 0..N {
                let (y, p) = predicted(&transitions[i], &c.mean, &c.covariance);
                let [p00, p01, p02, p11, p12, p22] = p;
                let seen = z[i].is_number();
                let r = r[i].or(seen, one);
                let raw = self.residual(simd, z[i], y[0]);
                let value = raw.or(seen, zero);
                let variance = p00 + r;
                let s = variance.reciprocal().or(seen, zero);
                let rest = (r * s).or(seen, one);
                let (k0, k1, k2) = (p00 * s, p01 * s, p02 * s);
                c.mean = [y[0] + k0 * value, y[1] + k1 * value, y[2] + k2 * value];
                c.covariance = [
                    p00 * rest,
                    p01 * rest,
                    p02 * rest,
                    p11 - p01 * k1,
                    p12 - p01 * k2,
                    p22 - p02 * k2,
                ];
                c.squares += value * value * s;
                c.count += one.or(seen, zero);
                c.look(simd, seen, z[i], r, p00);
                variances[i] = variance.or(seen, one);
                if ALL {
                    kept.mean[i] = c.mean;
                    kept.covariance[i] = c.covariance;
                    kept.value[i] = raw;
                    kept.variance[i] = variance.or(seen, nan);
                }
            }
            c.multiply(simd, variances);
            if ALL {
                let lanes = at * S::F64_LANES..out.len().min((at + 1) * S::F64_LANES);
                kept.keep::<N>(simd, self.from - self.first, self.period, &mut out[lanes]);
            }
        }
    }

    /// F and Q before each of N steps, in all lanes.
    #[inline(always)]
    fn transitions<S: Simd, const N: usize>(&self, simd: S) -> [Splat<S>; N] {
        let zero = Vector::splat(simd, 0.0);
        let mut transitions = [([zero; 4], [zero; 6]); N];
        for (i, (f, q)) in transitions.iter_mut().enumerate() {
            let transition = self.transition.get(self.from + i - 1);
            *f = Vector::splat_all(simd, &transition.f);
            *q = Vector::splat_all(simd, &transition.q);
        }
        transitions
    }

    /// The means alone.
    #[inline(always)]
    fn share<S: Simd, const N: usize>(
        &self,
        simd: S,
        gains: &Gains,
        vectors: &mut [Carried<S>],
        out: &mut [Steps<'_>],
    ) {
        let transitions = self.transitions::<S, N>(simd);
        let zero = Vector::splat(simd, 0.0);
        let mut gain = [[zero; 4]; N];
        for (i, gain) in gain.iter_mut().enumerate() {
            let [k0, k1, k2] = gains.gain[self.from + i];
            *gain = Vector::splat_all(simd, &[k0, k1, k2, 1.0 / gains.variance[self.from + i]]);
        }
        let mut kept = Kept::new(simd);
        for (at, carried) in vectors.iter_mut().enumerate() {
            let z = Vector::from_rows(simd, &self.z, at);
            let [mut x0, mut x1, mut x2] = carried.mean;
            let mut squares = carried.squares;
            for i in 0..N {
                let ([f01, f02, f12, f22], [k0, k1, k2, s]) = (transitions[i].0, gain[i]);
                let (y0, y1, y2) = (x0 + f01 * x1 + f02 * x2, x1 + f12 * x2, f22 * x2);
                let value = self.residual(simd, z[i], y0);
                (x0, x1, x2) = (y0 + k0 * value, y1 + k1 * value, y2 + k2 * value);
                squares += value * value * s;
                kept.mean[i] = [x0, x1, x2];
                kept.value[i] = value;
            }
            (carried.mean, carried.squares) = ([x0, x1, x2], squares);
            if !out.is_empty() {
                let lanes = at * S::F64_LANES..out.len().min((at + 1) * S::F64_LANES);
                kept.keep::<N>(simd, self.from - self.first, self.period, &mut out[lanes]);
            }
        }
    }

    /// The innovation: nan without a plot.
    #[inline(always)]
    fn residual<S: Simd>(&self, simd: S, z: Vector<S>, x: Vector<S>) -> Vector<S> {
        let difference = z - x;
        if let Some(period) = self.period
            && difference.exceeds(0.5 * period)
        {
            let mut lanes = [0.0; WIDEST];
            difference.store(&mut lanes, 0);
            for value in &mut lanes {
                *value = residual(*value, 0.0, self.period);
            }
            return Vector::load(simd, &lanes, 0);
        }
        difference
    }
}

impl<S: Simd> Carried<S> {
    /// Remembers the widest prior, the largest plot, and the variances of least and most noise. A
    /// variance that is nan makes the likelihood nan.
    #[inline(always)]
    fn look(&mut self, simd: S, seen: S::m64s, z: Vector<S>, r: Vector<S>, p00: Vector<S>) {
        let excess = p00 - r * Vector::splat(simd, FACTORS_ABOVE);
        self.excess = self.excess.max(excess.or(seen, Vector::splat(simd, 0.0)));
        self.largest = self.largest.max(z.abs().or(seen, self.largest));
        self.least = self.least.min(r);
        self.most = self.most.max(r);
    }

    /// Multiplies the variances of a tile's innovations; where the product leaves its range, their
    /// logarithms are taken.
    #[inline(always)]
    fn multiply(&mut self, simd: S, variances: [Vector<S>; TILE]) {
        let [a, b, c, d] = variances;
        let total = self.product * (a * b * (c * d));
        if total.is_within(PRODUCTS.start, PRODUCTS.end) {
            self.product = total;
            return;
        }
        let mut sums = [0.0; WIDEST];
        for factor in [a, b, c, d, self.product] {
            let mut lanes = [1.0; WIDEST];
            factor.store(&mut lanes, 0);
            for (sum, variance) in sums.iter_mut().zip(lanes) {
                *sum += variance.ln();
            }
        }
        self.squares += Vector::load(simd, &sums, 0);
        self.product = Vector::splat(simd, 1.0);
    }
}

/// `F x` and `F P F^T + Q` in all lanes.
#[inline(always)]
fn predicted<S: Simd>(
    ([f01, f02, f12, f22], q): &Splat<S>,
    [x0, x1, x2]: &[Vector<S>; 3],
    p: &[Vector<S>; 6],
) -> ([Vector<S>; 3], [Vector<S>; 6]) {
    let (f01, f02, f12, f22) = (*f01, *f02, *f12, *f22);
    let [p00, p01, p02, p11, p12, p22] = *p;
    let a00 = p00 + f01 * p01 + f02 * p02;
    let a01 = p01 + f01 * p11 + f02 * p12;
    let a02 = p02 + f01 * p12 + f02 * p22;
    let a11 = p11 + f12 * p12;
    let a12 = p12 + f12 * p22;
    let mean = [*x0 + f01 * *x1 + f02 * *x2, *x1 + f12 * *x2, f22 * *x2];
    let covariance = [
        a00 + f01 * a01 + f02 * a02 + q[0],
        a01 + f12 * a02 + q[1],
        f22 * a02 + q[2],
        a11 + f12 * a12 + q[3],
        f22 * a12 + q[4],
        f22 * f22 * p22 + q[5],
    ];
    (mean, covariance)
}

#[cfg(test)]
mod levels;
