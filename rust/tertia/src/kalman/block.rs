//! Several series side by side, one in each lane of a vector: what a step costs is shared.

use super::filter::Filter;
use super::model::Transition;
use super::series::{PRODUCTS, PerStep, Series, Summary, log_likelihood};
use super::shared::Gains;
use super::state::{FACTORS_ABOVE, State, residual, wrapped};
use super::steps::Steps;
use crate::base::vector::Vector;
use pulp::{Arch, Simd, WithSimd};

/// Series that are filtered together: vectors enough to hide that each waits for its last step.
pub(super) const LANES: usize = 16;
/// Steps whose plots are gathered and whose states are shown at once, from the L1 cache.
const TILE: usize = 16;

pub(super) type Lane = [f64; LANES];

/// Filters up to [`LANES`] series of the same length with the same steps between their plots, with
/// `gains` if they are those of all of them and no plot is missing, and keeps what `out` has room
/// for. `None` where they must be filtered one by one: a prior that is kept as factors, or a start
/// that takes all steps.
pub(super) fn run_block(
    series: &[Series<'_>],
    filters: &[Filter],
    gains: Option<&Gains>,
    out: &mut [&mut Steps<'_>],
) -> Option<Vec<Summary>> {
    let n = series.first()?.z.len();
    let start = series.iter().zip(filters).map(|(series, filter)| known_from(series, filter));
    let start = start.max().filter(|&start| start < n)?;
    let gains = gains.filter(|_| series.iter().all(Series::is_complete));
    Arch::new().dispatch(Run { series, filters, gains, start, out })
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
}

impl WithSimd for Run<'_, '_, '_, '_> {
    type Output = Option<Vec<Summary>>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        let Self { series, filters, gains, start, out } = self;
        let mut summaries = Vec::with_capacity(series.len());
        let mut tile = Tile::new();
        for (l, (series, filter)) in series.iter().zip(filters).enumerate() {
            let head = Series { z: &series.z[..start], ..*series };
            let summary = head.fill(*filter, out[l]);
            let state = match gains {
                Some(_) => summary.filter.state(),
                None => summary.filter.plain()?,
            };
            tile.set(l, &state);
            summaries.push(summary);
        }
        tile.pad(series.len());
        let (n, period) = (series[0].z.len(), summaries[0].filter.period());
        for from in (start..n).step_by(TILE) {
            let steps = TILE.min(n - from);
            tile.gather(series, from, steps, from == start);
            for i in 0..steps {
                let transition = &series[0].transition.at(from + i - 1);
                match gains {
                    Some(gains) => tile.step_shared(simd, i, transition, gains, from + i, period),
                    None => tile.step(simd, i, transition, period),
                }
            }
            for (l, out) in out.iter_mut().enumerate() {
                tile.keep(l, from, steps, gains, period, out);
            }
            tile.shift(steps);
        }
        if tile.wide.iter().any(|&excess| excess > 0.0) {
            return None;
        }
        for (l, (summary, series)) in summaries.iter_mut().zip(series).enumerate() {
            let count = series.z[start..].iter().filter(|z| !z.is_nan()).count();
            let noise = series.last_variance().unwrap_or(summary.filter.noise());
            let mut state = tile.state(l, 0);
            let mut logarithms = tile.product[l].ln();
            if let Some(gains) = gains {
                state.covariance = gains.covariance[n - 1];
                logarithms = gains.logarithms[start];
            }
            summary.filter.set(state, noise);
            summary.log_likelihood += log_likelihood(tile.squares[l], logarithms, count);
            summary.count += count;
        }
        Some(summaries)
    }
}

/// Writes a row into lane l.
#[inline(always)]
fn transpose(row: &[f64], lanes: &mut [Lane; TILE], l: usize) {
    // of a known length where it can be: no loop
    if let Ok(row) = <&[f64; TILE]>::try_from(row) {
        for (lane, &value) in lanes.iter_mut().zip(row) {
            lane[l] = value;
        }
    } else {
        for (lane, &value) in lanes.iter_mut().zip(row) {
            lane[l] = value;
        }
    }
}

/// Some steps of all lanes.
struct Tile {
    z: [Lane; TILE],
    r: [Lane; TILE],
    /// Before the first step, and after each.
    mean: [[Lane; 3]; TILE + 1],
    covariance: [[Lane; 6]; TILE + 1],
    value: [Lane; TILE],
    variance: [Lane; TILE],
    squares: Lane,
    product: Lane,
    /// Positive once a prior was too wide for its noise.
    wide: Lane,
}

impl Tile {
    fn new() -> Self {
        let zeros = [0.0; LANES];
        Self {
            z: [zeros; TILE],
            r: [[1.0; LANES]; TILE],
            mean: [[zeros; 3]; TILE + 1],
            covariance: [[zeros; 6]; TILE + 1],
            value: [zeros; TILE],
            variance: [zeros; TILE],
            squares: zeros,
            product: [1.0; LANES],
            wide: zeros,
        }
    }

    fn set(&mut self, l: usize, state: &State) {
        for (lane, x) in self.mean[0].iter_mut().zip(state.mean) {
            lane[l] = x;
        }
        for (lane, p) in self.covariance[0].iter_mut().zip(state.covariance) {
            lane[l] = p;
        }
    }

    /// Lanes from `used` on have no plots, and a state of zeros.
    fn pad(&mut self, used: usize) {
        for z in &mut self.z {
            z[used..].fill(f64::NAN);
        }
    }

    #[inline(always)]
    fn gather(&mut self, series: &[Series<'_>], from: usize, steps: usize, first: bool) {
        for (l, series) in series.iter().enumerate() {
            transpose(&series.z[from..from + steps], &mut self.z, l);
            match series.variance {
                PerStep::Constant(r) if first => transpose(&[r; TILE], &mut self.r, l),
                PerStep::Constant(_) => {}
                PerStep::Each(each) => transpose(&each[from..from + steps], &mut self.r, l),
            }
        }
    }

    /// The last state is the first one of the next tile.
    fn shift(&mut self, steps: usize) {
        self.mean[0] = self.mean[steps];
        self.covariance[0] = self.covariance[steps];
    }

    #[inline(always)]
    fn state(&self, l: usize, i: usize) -> State {
        let ([x0, x1, x2], [p00, p01, p02, p11, p12, p22]) = (&self.mean[i], &self.covariance[i]);
        State {
            mean: [x0[l], x1[l], x2[l]],
            covariance: [p00[l], p01[l], p02[l], p11[l], p12[l], p22[l]],
        }
    }

    /// Keeps lane l's steps.
    #[inline(always)]
    fn keep(
        &self,
        l: usize,
        from: usize,
        steps: usize,
        gains: Option<&Gains>,
        period: Option<f64>,
        out: &mut Steps<'_>,
    ) {
        // known to be less than LANES without a check in the loops
        let (l, to) = (l % LANES, from + steps);
        if let Some(mean) = out.mean.get_mut(3 * from..3 * to) {
            for (row, lanes) in mean.as_chunks_mut::<3>().0.iter_mut().zip(&self.mean[1..]) {
                *row = [lanes[0][l], lanes[1][l], lanes[2][l]];
                if let Some(period) = period {
                    row[0] = wrapped(row[0], period);
                }
            }
        }
        if let Some(innovation) = out.innovation.get_mut(from..to) {
            for (value, lane) in innovation.iter_mut().zip(&self.value) {
                *value = lane[l];
            }
        }
        if let Some(variance) = out.variance.get_mut(from..to) {
            match gains {
                Some(gains) => variance.copy_from_slice(&gains.variance[from..to]),
                None => {
                    for (value, lane) in variance.iter_mut().zip(&self.variance) {
                        *value = lane[l];
                    }
                }
            }
        }
        let Some(covariance) = out.covariance.get_mut(6 * from..6 * to) else { return };
        if let Some(gains) = gains {
            covariance.copy_from_slice(gains.covariance[from..to].as_flattened());
            return;
        }
        for (row, p) in covariance.as_chunks_mut::<6>().0.iter_mut().zip(&self.covariance[1..]) {
            *row = [p[0][l], p[1][l], p[2][l], p[3][l], p[4][l], p[5][l]];
        }
    }

    /// [`State::predicted`] and [`State::updated`] in all lanes, in the same order; without a plot,
    /// gain and innovation are zero.
    #[inline(always)]
    fn step<S: Simd>(&mut self, simd: S, i: usize, transition: &Transition, period: Option<f64>) {
        let f = Vector::splat_all(simd, &transition.f);
        let q = Vector::splat_all(simd, &transition.q);
        for at in 0..LANES / S::F64_LANES {
            self.step_vector(simd, i, at, (&f, &q), period);
        }
        // lanes without a plot have multiplied by one
        let (mut least, mut most) = (f64::INFINITY, 0.0_f64);
        for &product in &self.product {
            least = if product < least { product } else { least };
            most = if product > most { product } else { most };
        }
        if !PRODUCTS.contains(&least) || !PRODUCTS.contains(&most) {
            for (squares, product) in self.squares.iter_mut().zip(&mut self.product) {
                *squares += product.ln();
                *product = 1.0;
            }
        }
    }

    #[inline(always)]
    fn step_vector<S: Simd>(
        &mut self,
        simd: S,
        i: usize,
        at: usize,
        (f, q): (&[Vector<S>; 4], &[Vector<S>; 6]),
        period: Option<f64>,
    ) {
        let [f01, f02, f12, f22] = *f;
        let [x0, x1, x2] = Vector::load_all(simd, &self.mean[i], at);
        let [p00, p01, p02, p11, p12, p22] = Vector::load_all(simd, &self.covariance[i], at);
        let a00 = p00 + f01 * p01 + f02 * p02;
        let a01 = p01 + f01 * p11 + f02 * p12;
        let a02 = p02 + f01 * p12 + f02 * p22;
        let a11 = p11 + f12 * p12;
        let a12 = p12 + f12 * p22;
        let (y0, y1, y2) = (x0 + f01 * x1 + f02 * x2, x1 + f12 * x2, f22 * x2);
        let p00 = a00 + f01 * a01 + f02 * a02 + q[0];
        let p01 = a01 + f12 * a02 + q[1];
        let p02 = f22 * a02 + q[2];
        let p11 = a11 + f12 * a12 + q[3];
        let p12 = f22 * a12 + q[4];
        let p22 = f22 * f22 * p22 + q[5];

        let (zero, one) = (Vector::splat(simd, 0.0), Vector::splat(simd, 1.0));
        let nan = Vector::splat(simd, f64::NAN);
        let (z, r) = (Vector::load(simd, &self.z[i], at), Vector::load(simd, &self.r[i], at));
        let seen = z.is_number();
        let raw = self.residual(simd, (i, at), z, y0, period);
        let value = raw.or(seen, zero);
        let variance = p00 + r;
        variance.or(seen, nan).store(&mut self.variance[i], at);
        let variance = variance.or(seen, one);
        let s = variance.reciprocal().or(seen, zero);
        let kept = (r * s).or(seen, one);
        let excess = (p00 - r * Vector::splat(simd, FACTORS_ABOVE)).or(seen, zero);
        Vector::load(simd, &self.wide, at).max(excess).store(&mut self.wide, at);
        let (k0, k1, k2) = (p00 * s, p01 * s, p02 * s);
        let mean = [y0 + k0 * value, y1 + k1 * value, y2 + k2 * value];
        let covariance =
            [p00 * kept, p01 * kept, p02 * kept, p11 - p01 * k1, p12 - p01 * k2, p22 - p02 * k2];
        Vector::store_all(&mean, &mut self.mean[i + 1], at);
        Vector::store_all(&covariance, &mut self.covariance[i + 1], at);
        let squares = Vector::load(simd, &self.squares, at) + value * value * s;
        squares.store(&mut self.squares, at);
        (Vector::load(simd, &self.product, at) * variance).store(&mut self.product, at);
    }

    /// The residual, kept as the innovation: nan without a plot.
    #[inline(always)]
    fn residual<S: Simd>(
        &mut self,
        simd: S,
        (i, at): (usize, usize),
        z: Vector<S>,
        x: Vector<S>,
        period: Option<f64>,
    ) -> Vector<S> {
        let difference = z - x;
        difference.store(&mut self.value[i], at);
        if let Some(period) = period
            && difference.exceeds(0.5 * period)
        {
            for value in &mut self.value[i][at * S::F64_LANES..][..S::F64_LANES] {
                *value = residual(*value, 0.0, Some(period));
            }
            return Vector::load(simd, &self.value[i], at);
        }
        difference
    }

    /// The means alone.
    #[inline(always)]
    fn step_shared<S: Simd>(
        &mut self,
        simd: S,
        i: usize,
        transition: &Transition,
        gains: &Gains,
        step: usize,
        period: Option<f64>,
    ) {
        let [f01, f02, f12, f22] = Vector::splat_all(simd, &transition.f);
        let [k0, k1, k2] = Vector::splat_all(simd, &gains.gain[step]);
        let s = Vector::splat(simd, 1.0 / gains.variance[step]);
        for at in 0..LANES / S::F64_LANES {
            let [x0, x1, x2] = Vector::load_all(simd, &self.mean[i], at);
            let (y0, y1, y2) = (x0 + f01 * x1 + f02 * x2, x1 + f12 * x2, f22 * x2);
            let z = Vector::load(simd, &self.z[i], at);
            let value = self.residual(simd, (i, at), z, y0, period);
            let mean = [y0 + k0 * value, y1 + k1 * value, y2 + k2 * value];
            Vector::store_all(&mean, &mut self.mean[i + 1], at);
            let squares = Vector::load(simd, &self.squares, at) + value * value * s;
            squares.store(&mut self.squares, at);
        }
    }
}
