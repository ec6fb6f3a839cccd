//! Least-squares polynomials through the instants around each instant (Savitzky and Golay 1964), whose degree
//! may be chosen by a test.

use super::record::{Record, complete_runs, regular_step, require_record};
use super::stencil::{Adaptive, Choice, Convolution, HIGHEST, Stencil};
use crate::base::basis::Basis;
use crate::base::distribution::{fisher_upper_quantile, normal_two_sided_quantile};
use crate::base::error::{Result, require, require_significance};
use crate::base::interrupt::poll;
use std::ops::Range;

/// Choice of the degree.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Degree {
    /// This degree.
    Fixed(usize),
    /// The highest degree up to this one whose coefficient is significant.
    Adaptive(usize),
}

/// Results, one element for each instant.
#[derive(Debug)]
pub struct Output<'a> {
    /// The polynomial or its derivative; nan if the window has too few measurements.
    pub value: &'a mut [f64],
    /// Standard error; ∞ where the value is nan.
    pub sigma: &'a mut [f64],
    /// Degree; −1 where the value is nan.
    pub degree: &'a mut [i64],
}

/// Noise of a record without variances; nan if variances are given.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fit {
    /// Variance of the measurements about the polynomials of the highest degree.
    pub residual_variance: f64,
    /// Degrees of freedom of this variance.
    pub degrees_of_freedom: f64,
}

/// The smoother with its buffers.
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
    /// Sum of the squared residuals of the highest degree.
    squares: f64,
    /// Size of the largest measurement.
    largest: f64,
    centre: f64,
    scale: f64,
    origin: f64,
    /// Highest degree that the window can have; none if it has no measurements.
    top: Option<usize>,
    values: Vec<f64>,
    derivatives: Vec<f64>,
}

/// Sums of the squared residuals and of their expected values for unit variance.
#[derive(Clone, Copy, Debug, Default)]
struct Residuals {
    squares: f64,
    expected: f64,
}

impl Polynomial {
    /// Sets up a smoother with a window of this number of instants.
    ///
    /// # Errors
    /// The window is even, the degree is too high for it, or the derivative is above the degree.
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

    fn stencil(&self, step: f64) -> Stencil {
        Stencil::new(self.window, self.top(), self.derivative, step)
    }

    /// Smooths a record. Cost O(N window degree), less with equal steps and without variances.
    ///
    /// # Errors
    /// A measurement is infinite, times decrease, or the variance of a measurement is not positive.
    pub fn smooth(&mut self, record: &Record<'_>, out: &mut Output<'_>) -> Result<Fit> {
        require_record(record)?;
        let n = record.y.len();
        let mut residuals = Residuals::default();
        self.at.start = None;
        let regular = if record.variance.is_none() { regular_step(record) } else { None };
        let mut done = 0;
        if let Some(step) = regular.filter(|_| self.window <= n) {
            let stencil = self.stencil(step);
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

    /// Smooths the instants whose windows are complete; `run` is the range of the starts of these windows.
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
        residuals.expected += count as f64 * (1.0 - stencil.leverage);
        if let Degree::Fixed(p) = self.degree {
            sigma.fill(stencil.error[p]);
            degree.fill(p as i64);
            residuals.squares += pulp::Arch::new().dispatch(Convolution { stencil, y, value });
            return;
        }
        let critical = self.table(self.window);
        let choice = Choice { stencil, critical: &critical, lowest: self.derivative };
        residuals.squares +=
            pulp::Arch::new().dispatch(Adaptive { choice, y, value, sigma, degree });
    }

    /// Critical values for the coefficient of every degree, with this number of measurements.
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

    /// Smooths one instant, with a window of its own.
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

    /// Fits the window of an instant, unless it was the last one fitted.
    fn fit_window(&mut self, record: &Record<'_>, i: usize) {
        let n = record.y.len();
        let size = self.window.min(n);
        let start = i.saturating_sub(self.window / 2).min(n - size);
        if self.at.start == Some(start) {
            return;
        }
        poll();
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

    /// Whether the window has enough measurements to test the highest degree. Otherwise a curvature, and the
    /// error of leaving it out, would not show.
    fn can_choose(&self, record: &Record<'_>, most: usize) -> bool {
        let enough = self.at.x.len() > most + 1 || record.variance.is_some();
        self.at.top == Some(most) && enough
    }

    /// Returns the highest degree whose coefficient is significant.
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

    /// Scales standard errors for unit variance to the noise of the record.
    fn scaled(&self, record: &Record<'_>, residuals: Residuals, out: &mut Output<'_>) -> Fit {
        let nothing = Fit { residual_variance: f64::NAN, degrees_of_freedom: f64::NAN };
        if record.variance.is_some() {
            return nothing;
        }
        let count = record.y.iter().filter(|y| !y.is_nan()).count() as f64;
        // if all leverages are one, only rounding remains
        if residuals.expected <= 1e-9 * count.max(1.0) {
            out.sigma.fill(f64::INFINITY);
            return nothing;
        }
        let variance = residuals.squares / residuals.expected;
        let root = variance.sqrt();
        out.sigma.iter_mut().for_each(|sigma| *sigma *= root);
        let most = count - self.top() as f64 - 1.0;
        // one polynomial for the whole record has so many; a window may be far longer than the record
        let is_one = self.window >= record.y.len();
        let nu = if is_one { most } else { (count * self.stencil(1.0).freedom).min(most) };
        Fit { residual_variance: variance, degrees_of_freedom: nu }
    }
}
