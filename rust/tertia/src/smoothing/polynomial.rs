//! A polynomial through the instants around each, by least squares (Savitzky and Golay 1964), whose
//! degree may be chosen by a test.

use super::basis::Basis;
use crate::base::distribution::{fisher_upper_quantile, normal_two_sided_quantile};
use crate::base::error::{Error, Result, require, require_each, require_significance};
use pulp::{Simd, WithSimd};
use std::ops::Range;

/// Highest degree: polynomials of higher ones are not what a window is for.
pub const HIGHEST: usize = 9;
const VARIANCES: std::ops::RangeInclusive<f64> = 1e-140..=1e140;
const LARGEST: f64 = 1e140;
/// Windows that are fitted side by side.
const LANES: usize = 16;
/// Equal steps: the instants differ from them by no more than so many roundings.
const ROUNDINGS: f64 = 4.0;

/// Which polynomial.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Degree {
    /// Of this degree.
    Fixed(usize),
    /// Of the highest degree up to this one whose coefficient is significant.
    Adaptive(usize),
}

/// A series along time.
#[derive(Clone, Copy, Debug)]
pub struct Record<'a> {
    /// The measurements; nan where there is none.
    pub y: &'a [f64],
    /// Their times; without them 0, 1, 2, …
    pub time: Option<&'a [f64]>,
    /// Their variances: one for each, or one for all.
    pub variance: Option<&'a [f64]>,
}

/// Where the results go: one element per instant.
#[derive(Debug)]
pub struct Output<'a> {
    /// The polynomial, or its derivative; nan where the window has too few measurements.
    pub value: &'a mut [f64],
    /// Its standard error; ∞ there.
    pub sigma: &'a mut [f64],
    /// The degree; −1 there.
    pub degree: &'a mut [i64],
}

/// The noise of a record that comes without variances; nan with them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fit {
    /// Variance of the measurements about the polynomials of the highest degree.
    pub residual_variance: f64,
    /// Its degrees of freedom.
    pub degrees_of_freedom: f64,
}

/// The smoother and its buffers.
#[derive(Clone, Debug)]
pub struct Polynomial {
    window: usize,
    degree: Degree,
    derivative: usize,
    significance: f64,
    /// Critical values of F(1, ν), by ν; nan where not yet computed.
    critical: Vec<f64>,
    at: Window,
}

/// The window that was fitted last.
#[derive(Clone, Debug, Default)]
struct Window {
    start: Option<usize>,
    basis: Basis,
    x: Vec<f64>,
    w: Vec<f64>,
    y: Vec<f64>,
    coefficients: Vec<f64>,
    /// Left by the highest degree.
    squares: f64,
    /// Sum of the weights, and largest measurement.
    largest: f64,
    centre: f64,
    scale: f64,
    origin: f64,
    /// Highest degree; none if there is nothing.
    top: Option<usize>,
    values: Vec<f64>,
    derivatives: Vec<f64>,
}

/// Sums of the squares that are left and of what they are expected to be, for unit variance.
#[derive(Clone, Copy, Debug, Default)]
struct Residuals {
    squares: f64,
    expected: f64,
}

impl Polynomial {
    /// A smoother with a window of so many instants.
    ///
    /// # Errors
    /// A window that is even, a degree that it cannot have, or a derivative that is not there.
    pub fn try_new(
        window: usize,
        degree: Degree,
        derivative: usize,
        significance: f64,
    ) -> Result<Self> {
        require("window", window as f64, window % 2 == 1, "an odd number")?;
        let (name, top) = match degree {
            Degree::Fixed(top) => ("degree", top),
            Degree::Adaptive(top) => ("max_degree", top),
        };
        let (most, requirement) = match degree {
            Degree::Fixed(_) => (window, "less than window, and not above 9"),
            Degree::Adaptive(_) => (window - 1, "less than window - 1, and not above 9"),
        };
        require(name, top as f64, top < most && top <= HIGHEST, requirement)?;
        let requirement = "not above the degree";
        require("derivative", derivative as f64, derivative <= top, requirement)?;
        require_significance(significance)?;
        let at = Window::default();
        Ok(Self { window, degree, derivative, significance, critical: Vec::new(), at })
    }

    fn top(&self) -> usize {
        match self.degree {
            Degree::Fixed(top) | Degree::Adaptive(top) => top,
        }
    }

    /// Smooths a record. Cost O(N window degree), less with equal steps and without variances.
    ///
    /// # Errors
    /// A measurement that is infinite, times that decrease, or a variance that is not positive where
    /// there is a measurement.
    pub fn smooth(&mut self, record: &Record<'_>, out: &mut Output<'_>) -> Result<Fit> {
        require_record(record)?;
        let n = record.y.len();
        let mut residuals = Residuals::default();
        self.at.start = None;
        let regular = if record.variance.is_none() { regular_step(record) } else { None };
        let mut done = 0;
        if let Some(step) = regular.filter(|_| self.window <= n) {
            let stencil = Stencil::new(self, step);
            let half = self.window / 2;
            for run in complete_runs(record.y, self.window) {
                for i in done..run.start + half {
                    self.one(record, i, out, &mut residuals);
                }
                done = run.end + half;
                self.run(&stencil, record.y, run, out, &mut residuals);
            }
        }
        for i in done..n {
            self.one(record, i, out, &mut residuals);
        }
        Ok(self.scaled(record, residuals, out))
    }

    /// The instants whose windows are complete, `run` being where these windows start.
    fn run(
        &mut self,
        stencil: &Stencil,
        y: &[f64],
        run: Range<usize>,
        out: &mut Output<'_>,
        residuals: &mut Residuals,
    ) {
        let half = self.window / 2;
        let (count, to) = (run.len(), run.start + half..run.end + half);
        let y = &y[run.start..run.end + self.window - 1];
        let (value, sigma) = (&mut out.value[to.clone()], &mut out.sigma[to.clone()]);
        let degree = &mut out.degree[to];
        if let Degree::Fixed(p) = self.degree {
            residuals.expected += count as f64 * (1.0 - stencil.leverage);
            sigma.fill(stencil.error[p]);
            degree.fill(p as i64);
            residuals.squares += pulp::Arch::new().dispatch(Convolution { stencil, y, value });
            return;
        }
        residuals.expected += count as f64 * (1.0 - stencil.leverage);
        let critical = self.table(self.window);
        let choice = Choice { stencil, critical: &critical, lowest: self.derivative };
        residuals.squares +=
            pulp::Arch::new().dispatch(Adaptive { choice, y, value, sigma, degree });
    }

    /// Critical values of the coefficient of every degree, with so many measurements.
    fn table(&mut self, count: usize) -> [f64; HIGHEST + 1] {
        let mut table = [f64::INFINITY; HIGHEST + 1];
        for (p, critical) in table.iter_mut().enumerate().take(self.top() + 1) {
            *critical = self.critical_value(count - p - 1);
        }
        table
    }

    fn critical_value(&mut self, nu: usize) -> f64 {
        if self.critical.len() <= nu {
            self.critical.resize(nu + 1, f64::NAN);
        }
        if self.critical[nu].is_nan() {
            self.critical[nu] = if nu == 0 {
                normal_two_sided_quantile(self.significance).powi(2)
            } else {
                fisher_upper_quantile(self.significance, 1.0, nu as f64)
            };
        }
        self.critical[nu]
    }

    /// One instant, with a window of its own.
    fn one(
        &mut self,
        record: &Record<'_>,
        i: usize,
        out: &mut Output<'_>,
        residuals: &mut Residuals,
    ) {
        self.fit_window(record, i);
        (out.value[i], out.sigma[i], out.degree[i]) = (f64::NAN, f64::INFINITY, -1);
        let Some(top) = self.at.top else { return };
        let degree = match self.degree {
            Degree::Fixed(degree) if degree <= top => degree,
            Degree::Adaptive(most) if self.can_choose(record, most) => self.chosen(record, most),
            _ => return,
        };
        let Window { basis, centre, scale, coefficients, derivatives, values, origin, .. } =
            &mut self.at;
        let x = (record.time(i) - *centre) / *scale;
        basis.derivatives(self.derivative, x, derivatives);
        basis.derivatives(0, x, values);
        let sum = |p: &[f64], to: usize| -> f64 {
            coefficients.iter().zip(p).take(to + 1).map(|(c, p)| c * p).sum()
        };
        let unit = scale.powi(-(self.derivative as i32));
        let offset = if self.derivative == 0 { *origin } else { 0.0 };
        out.value[i] = sum(derivatives, degree) * unit + offset;
        let square: f64 = derivatives.iter().take(degree + 1).map(|p| p * p).sum();
        out.sigma[i] = square.sqrt() * unit;
        out.degree[i] = degree as i64;
        if !record.y[i].is_nan() {
            let leverage: f64 = values.iter().map(|p| p * p).sum();
            let left = record.y[i] - *origin - sum(values, top);
            residuals.squares += left * left;
            residuals.expected += 1.0 - leverage;
        }
    }

    /// Fits the window of an instant, unless it is that of the last one.
    fn fit_window(&mut self, record: &Record<'_>, i: usize) {
        let n = record.y.len();
        let size = self.window.min(n);
        let start = i.saturating_sub(self.window / 2).min(n - size);
        if self.at.start == Some(start) {
            return;
        }
        let top = self.top();
        (self.at.start, self.at.top) = (Some(start), None);
        let Window {
            basis, x, w, y, coefficients, squares, largest, centre, scale, origin, ..
        } = &mut self.at;
        for values in [&mut *x, &mut *w, &mut *y] {
            values.clear();
        }
        let range = start..start + size;
        let (first, last) = (record.time(range.start), record.time(range.end - 1));
        *centre = first + 0.5 * (last - first);
        *scale = if last > first { 0.5 * (last - first) } else { 1.0 };
        let (mut distinct, mut before) = (0, f64::NAN);
        *largest = 0.0;
        for k in range.filter(|&k| !record.y[k].is_nan()) {
            let t = record.time(k);
            distinct += usize::from(t != before);
            before = t;
            x.push((t - *centre) / *scale);
            w.push(1.0 / record.variance(k));
            y.push(record.y[k]);
            *largest = largest.max(record.y[k].abs());
        }
        if distinct == 0 {
            return;
        }
        let top = top.min(distinct - 1);
        *origin = y[y.len() / 2];
        y.iter_mut().for_each(|y| *y -= *origin);
        basis.build(top, x, w);
        *squares = basis.fit(w, y, coefficients);
        self.at.top = Some(top);
    }

    /// Whether the window is enough to test the highest degree. One that is not would not show a
    /// curvature, and so not the error of leaving it out.
    fn can_choose(&self, record: &Record<'_>, most: usize) -> bool {
        let enough = self.at.x.len() > most + 1 || record.variance.is_some();
        self.at.top == Some(most) && enough
    }

    /// The highest degree whose coefficient is significant.
    fn chosen(&mut self, record: &Record<'_>, top: usize) -> usize {
        let count = self.at.x.len();
        let known = record.variance.is_some();
        let rounding = count as f64 * (f64::EPSILON * self.at.largest).powi(2);
        let mut squares = self.at.squares.max(if known { 0.0 } else { rounding });
        for p in (self.derivative + 1..=top).rev() {
            let square = self.at.coefficients[p].powi(2);
            if known {
                if square > self.critical_value(0) {
                    return p;
                }
            } else {
                let nu = count - p - 1;
                if square * nu as f64 > self.critical_value(nu) * squares {
                    return p;
                }
            }
            squares += square;
        }
        self.derivative
    }

    /// Turns standard errors for unit variance into those of the record.
    fn scaled(&self, record: &Record<'_>, residuals: Residuals, out: &mut Output<'_>) -> Fit {
        let nothing = Fit { residual_variance: f64::NAN, degrees_of_freedom: f64::NAN };
        if record.variance.is_some() {
            return nothing;
        }
        let count = record.y.iter().filter(|y| !y.is_nan()).count() as f64;
        // leverages of one add up to rounding
        if residuals.expected <= 1e-9 * count.max(1.0) {
            out.sigma.fill(f64::INFINITY);
            return nothing;
        }
        let variance = residuals.squares / residuals.expected;
        let root = variance.sqrt();
        out.sigma.iter_mut().for_each(|sigma| *sigma *= root);
        let most = count - self.top() as f64 - 1.0;
        let nu = (count * Stencil::new(self, 1.0).freedom).min(most);
        Fit { residual_variance: variance, degrees_of_freedom: nu }
    }
}

impl Record<'_> {
    fn time(&self, i: usize) -> f64 {
        self.time.map_or(i as f64, |times| times[i])
    }

    fn variance(&self, i: usize) -> f64 {
        match self.variance {
            None => 1.0,
            Some([single]) => *single,
            Some(each) => each[i],
        }
    }
}

fn require_record(record: &Record<'_>) -> Result<()> {
    let requirement = "a measurement must be a finite number, or nan for none";
    require_each("y", record.y, |y| y.is_nan() || y.abs() <= LARGEST, requirement)?;
    if let Some(times) = record.time {
        let requirement = "every time must be a finite number";
        require_each("time", times, |t| t.abs() <= LARGEST, requirement)?;
        if let Some(before) = times.windows(2).position(|pair| pair[1] < pair[0]) {
            let (argument, requirement) = ("time", "time must not decrease");
            let (index, value) = (before + 1, times[before + 1]);
            return Err(Error::InvalidMeasurement { argument, index, value, requirement });
        }
    }
    let requirement = "it must be positive, between 1e-140 and 1e140, where there is a measurement";
    for index in 0..record.y.len() {
        let value = record.variance(index);
        if !record.y[index].is_nan() && !VARIANCES.contains(&value) {
            let argument = "variance";
            return Err(Error::InvalidMeasurement { argument, index, value, requirement });
        }
    }
    Ok(())
}

/// The step of times that are equally spaced, but for rounding.
fn regular_step(record: &Record<'_>) -> Option<f64> {
    let Some(times) = record.time else { return Some(1.0) };
    let (&first, &last) = (times.first()?, times.last()?);
    let step = (last - first) / (times.len() - 1).max(1) as f64;
    let rounding = ROUNDINGS * f64::EPSILON * first.abs().max(last.abs());
    let fits = |(i, t): (usize, &f64)| (t - first - i as f64 * step).abs() <= rounding;
    (step > 0.0 && times.iter().enumerate().all(fits)).then_some(step)
}

/// The starts of windows without a gap.
fn complete_runs(y: &[f64], window: usize) -> Vec<Range<usize>> {
    let mut runs = Vec::new();
    let mut start = 0;
    let gaps = y.iter().enumerate().filter(|(_, y)| y.is_nan()).map(|(i, _)| i);
    for gap in gaps.chain([y.len()]) {
        if gap >= start + window {
            runs.push(start..gap - window + 1);
        }
        start = gap + 1;
    }
    runs
}

/// The fit in the middle of a window of equal steps.
#[derive(Clone, Debug)]
struct Stencil {
    basis: Basis,
    window: usize,
    degree: usize,
    derivative: usize,
    /// What the measurements after the middle count in the derivative, and in the value.
    taps: Vec<f64>,
    value_taps: Vec<f64>,
    /// Derivatives, and values, of the polynomials in the middle.
    at: Vec<f64>,
    values: Vec<f64>,
    /// Standard error of every degree, for unit variance.
    error: Vec<f64>,
    /// What the middle measurement counts in its own value.
    leverage: f64,
    /// Degrees of freedom per measurement.
    freedom: f64,
}

impl Stencil {
    fn new(polynomial: &Polynomial, step: f64) -> Self {
        let (window, degree) = (polynomial.window, polynomial.top());
        let half = window / 2;
        // whole numbers: the polynomials are those of Gram, even and odd exactly
        let scale = half.max(1) as f64;
        let x: Vec<f64> = (0..window).map(|k| (k as f64 - half as f64) / scale).collect();
        let mut basis = Basis::default();
        basis.build(degree, &x, &vec![1.0; window]);
        let (mut at, mut values) = (Vec::new(), Vec::new());
        basis.derivatives(polynomial.derivative, 0.0, &mut at);
        basis.derivatives(0, 0.0, &mut values);
        let unit = (scale * step).powi(-(polynomial.derivative as i32));
        at.iter_mut().for_each(|p| *p *= unit);
        let tap =
            |p: &[f64], k: usize| -> f64 { (0..=degree).map(|j| p[j] * basis.row(j)[k]).sum() };
        let taps = (half + 1..window).map(|k| tap(&at, k)).collect();
        let value_taps = (half + 1..window).map(|k| tap(&values, k)).collect();
        let all: Vec<f64> = (0..window).map(|k| tap(&values, k)).collect();
        let error =
            (0..=degree).map(|p| at[..=p].iter().map(|p| p * p).sum::<f64>().sqrt()).collect();
        let (leverage, freedom) = (all[half], freedom(&all));
        let derivative = polynomial.derivative;
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

/// Degrees of freedom per measurement of the mean square of `y − Σ taps y`, by its first two moments.
fn freedom(taps: &[f64]) -> f64 {
    let half = taps.len() / 2;
    let filter: Vec<f64> =
        taps.iter().enumerate().map(|(k, tap)| f64::from(u8::from(k == half)) - tap).collect();
    let lagged =
        |lag: usize| -> f64 { filter.iter().zip(&filter[lag..]).map(|(a, b)| a * b).sum() };
    let zero = lagged(0).powi(2);
    let others: f64 = (1..taps.len()).map(|lag| lagged(lag).powi(2)).sum();
    if zero > 0.0 { zero / (zero + 2.0 * others) } else { 0.0 }
}

/// The polynomial of one degree in the middle of all windows; returns the sum of squares of what is
/// left there.
struct Convolution<'a> {
    stencil: &'a Stencil,
    y: &'a [f64],
    value: &'a mut [f64],
}

impl WithSimd for Convolution<'_> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> f64 {
        let Self { stencil, y, value } = self;
        let half = stencil.window / 2;
        let mut squares = [0.0; LANES];
        let mut start = 0;
        while start < value.len() {
            let count = LANES.min(value.len() - start);
            let block = &y[start..start + count + 2 * half];
            let mut padded;
            let block = if count == LANES {
                block
            } else {
                padded = vec![0.0; LANES + 2 * half];
                padded[..block.len()].copy_from_slice(block);
                &padded[..]
            };
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
            start += count;
        }
        squares.iter().sum()
    }
}

#[inline(always)]
fn lanes(y: &[f64], at: usize) -> [f64; LANES] {
    let mut lanes = [0.0; LANES];
    lanes.copy_from_slice(&y[at..at + LANES]);
    lanes
}

/// `Σ c_k (y_k − y_0 ± (y_−k − y_0))` for all lanes: a common offset costs nothing.
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
struct Choice<'a> {
    stencil: &'a Stencil,
    /// Of F(1, ν) for every degree.
    critical: &'a [f64; HIGHEST + 1],
    lowest: usize,
}

/// The polynomial whose degree is chosen, in the middle of all windows. One pass over a window gives
/// the coefficients of all degrees, another one what the highest degree leaves.
struct Adaptive<'a> {
    choice: Choice<'a>,
    y: &'a [f64],
    value: &'a mut [f64],
    sigma: &'a mut [f64],
    degree: &'a mut [i64],
}

impl WithSimd for Adaptive<'_> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> f64 {
        let Self { choice, y, value, sigma, degree } = self;
        let stencil = choice.stencil;
        let (window, half, top) = (stencil.window, stencil.window / 2, stencil.degree);
        let mut total = 0.0;
        let mut start = 0;
        while start < value.len() {
            let count = LANES.min(value.len() - start);
            let block = &y[start..start + count + 2 * half];
            let mut padded;
            let block = if count == LANES {
                block
            } else {
                padded = vec![0.0; LANES + 2 * half];
                padded[..block.len()].copy_from_slice(block);
                &padded[..]
            };
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
            start += count;
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
