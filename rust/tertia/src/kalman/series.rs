//! Runs the filter along a series of plots.

use super::filter::Filter;
use super::model::{Singer, Transition};
use super::state::{Innovation, State, residual};
use super::steps::Steps;
use crate::base::error::{Error, Result, require, require_each};
use pulp::{Arch, Simd, WithSimd};
use std::f64::consts::TAU;

/// Relative change of the covariance in a step below which it counts as converged.
const CONVERGED: f64 = 2.0 * f64::EPSILON;
/// Largest plot: squares of larger ones overflow.
pub(super) const LARGEST: f64 = 1e150;
pub(super) const VARIANCES: std::ops::RangeInclusive<f64> = 1e-100..=1e100;
/// Range of a product of variances; outside, its logarithm is taken and the product starts again.
pub(super) const PRODUCTS: std::ops::Range<f64> = 1e-150..1e150;

/// One value for all steps, or one for each step.
#[derive(Clone, Copy, Debug)]
pub enum PerStep<'a, T> {
    /// The same value for all steps.
    Constant(T),
    /// One value per step.
    Each(&'a [T]),
}

impl<T: Copy> PerStep<'_, T> {
    /// Returns the value for a step.
    #[inline(always)]
    pub fn at(&self, step: usize) -> T {
        match self {
            Self::Constant(value) => *value,
            Self::Each(values) => values[step],
        }
    }
}

/// Plots of one target (nan: none), the variances of their noise, and the transitions between them.
#[derive(Clone, Copy, Debug)]
pub struct Series<'a> {
    /// Plots, nan where there is none.
    pub z: &'a [f64],
    /// Variances of the noise of the plots.
    pub variance: PerStep<'a, f64>,
    /// Transition before each plot but the first: one fewer than plots.
    pub transition: PerStep<'a, Transition>,
}

impl Singer {
    /// Returns the transitions between plots that are `dt` apart, where `dt` has one number for all or
    /// one for each; `buffer` holds them if they differ.
    ///
    /// # Errors
    /// If the model does not allow an interval.
    pub fn over_all<'a>(
        &self,
        dt: &[f64],
        buffer: &'a mut Vec<Transition>,
    ) -> Result<PerStep<'a, Transition>> {
        let Some(&first) = dt.first() else {
            return Ok(PerStep::Constant(Transition::NONE));
        };
        let mut last = (first, self.over(first)?);
        if dt.iter().all(|&t| t == first) {
            return Ok(PerStep::Constant(last.1));
        }
        buffer.clear();
        for &t in dt {
            if t != last.0 {
                last = (t, self.over(t)?);
            }
            buffer.push(last.1);
        }
        Ok(PerStep::Each(buffer))
    }
}

impl<T> PerStep<'_, T> {
    /// Returns a reference to the value for a step.
    #[inline(always)]
    pub(super) fn get(&self, step: usize) -> &T {
        match self {
            Self::Constant(value) => value,
            Self::Each(values) => &values[step],
        }
    }
}

impl<'a> Series<'a> {
    /// Creates a series of plots.
    ///
    /// # Errors
    /// If a plot is infinite, or the variance of a plot is not positive.
    pub fn try_new(
        z: &'a [f64],
        variance: PerStep<'a, f64>,
        transition: PerStep<'a, Transition>,
    ) -> Result<Self> {
        let series = Self { z, variance, transition };
        if series.plots().is_none() {
            series.refuse()?;
        }
        Ok(series)
    }

    /// Returns the error for the first value that is refused.
    fn refuse(&self) -> Result<()> {
        require_plots(self.z)?;
        match self.variance {
            PerStep::Constant(_) if self.z.iter().all(|z| z.is_nan()) => Ok(()),
            PerStep::Constant(r) => require_plot(0.0, r),
            PerStep::Each(each) => {
                let requirement =
                    "it must be a positive number from 1e-100 to 1e100 where there is a plot";
                let holds = |(z, r): (&f64, &f64)| z.is_nan() || VARIANCES.contains(r);
                let refused = self.z.iter().zip(each).position(|pair| !holds(pair));
                refused.map_or(Ok(()), |index| {
                    let (argument, value) = ("measurement_variance", each[index]);
                    Err(Error::InvalidMeasurement { argument, index, value, requirement })
                })
            }
        }
    }

    /// Returns the number of plots; `None` if a plot or the variance of its noise is refused.
    #[inline(always)]
    pub(super) fn plots(&self) -> Option<usize> {
        let (mut count, mut refused) = (0, false);
        // without an early exit, because a loop that has one is not vectorised
        match self.variance {
            PerStep::Constant(r) => {
                for &z in self.z {
                    count += usize::from(!z.is_nan());
                    refused |= z.abs() > LARGEST;
                }
                refused |= !VARIANCES.contains(&r);
            }
            PerStep::Each(each) => {
                let (least, most) = (*VARIANCES.start(), *VARIANCES.end());
                for (&z, &r) in self.z.iter().zip(each) {
                    let seen = !z.is_nan();
                    count += usize::from(seen);
                    let allowed = (z.abs() <= LARGEST) & (least <= r) & (r <= most);
                    refused |= seen & !allowed;
                }
            }
        }
        (!refused).then_some(count)
    }
}

/// Checks that all plots are finite, or nan where there is none.
///
/// # Errors
/// If a plot is infinite or too large.
pub fn require_plots(z: &[f64]) -> Result<()> {
    let refused = |z: f64| z.abs() > LARGEST;
    // without an early exit, because a loop that has one is not vectorised
    if z.iter().fold(false, |any, &z| any | refused(z)) {
        let requirement = "a plot must be a finite number, or nan for none";
        require_each("z", z, |z| !refused(z), requirement)?;
    }
    Ok(())
}

/// Checks that a plot and the variance of its noise can be used.
///
/// # Errors
/// If one of them cannot be used.
pub fn require_plot(z: f64, variance: f64) -> Result<()> {
    require("z", z, z.abs() <= LARGEST, "a finite number, or nan for no plot")?;
    let holds = VARIANCES.contains(&variance);
    let requirement = "a positive number from 1e-100 to 1e100";
    require("measurement_variance", variance, holds, requirement)
}

/// Results at the end of a series.
#[derive(Clone, Copy, Debug)]
pub struct Summary {
    /// The filter after the last step.
    pub filter: Filter,
    /// Log likelihood of all plots that have an innovation.
    pub log_likelihood: f64,
    /// Number of these plots.
    pub count: usize,
}

/// `−2 ln L` as a sum and a product, so that logarithms are rarely computed.
struct Likelihood {
    squares: f64,
    product: f64,
    count: usize,
}

impl Likelihood {
    #[inline(always)]
    fn add(&mut self, innovation: Innovation) {
        self.squares += innovation.value * innovation.value * (1.0 / innovation.variance);
        self.product *= innovation.variance;
        self.count += 1;
        if !PRODUCTS.contains(&self.product) {
            self.squares += self.product.ln();
            self.product = 1.0;
        }
    }

    /// Adds `count` innovations with the same variance, given the sum of their squares.
    fn add_all(&mut self, squares: f64, variance: f64, count: usize) {
        self.squares += squares / variance + count as f64 * variance.ln();
        self.count += count;
    }

    fn logarithm(&self) -> f64 {
        log_likelihood(self.squares, self.product.ln(), self.count)
    }
}

/// Returns `ln L` from the sum of ν²/S and of the logarithms of S taken so far, the logarithm of the
/// product of the other S, and the number of innovations.
pub(super) fn log_likelihood(squares: f64, logarithms: f64, count: usize) -> f64 {
    // no plots: 0, not −0
    0.0 - 0.5 * (squares + logarithms + count as f64 * TAU.ln())
}

/// [`Series::fill`] compiled for the instructions of this processor, which may have more registers.
struct Fill<'a, 'b, 'c> {
    series: &'a Series<'a>,
    filter: Filter,
    out: &'b mut Steps<'c>,
}

impl WithSimd for Fill<'_, '_, '_> {
    type Output = Summary;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Summary {
        let Self { series, filter, out } = self;
        let period = filter.period();
        series.run(filter, |step, state, new| out.put(step, state, new, period))
    }
}

impl Series<'_> {
    /// Runs `filter` along the series and writes the results for which `out` has room. O(steps).
    pub fn fill(&self, filter: Filter, out: &mut Steps<'_>) -> Summary {
        Arch::new().dispatch(Fill { series: self, filter, out })
    }

    /// Runs `filter` from before the first plot to after the last one, and passes the state and the
    /// innovation (nan if there is none) of every step to `sink`. O(steps).
    ///
    /// ```
    /// use tertia::kalman::{Filter, PerStep, Series, Singer};
    ///
    /// let model = Singer::try_new(0.05, 0.003, true)?;
    /// let z = [10.0, 10.5, f64::NAN, 11.5]; // a plot every five seconds, one of them missing
    /// let transition = PerStep::Constant(model.over(5.0)?);
    /// let series = Series { z: &z, variance: PerStep::Constant(0.01), transition };
    /// let mut angles = Vec::new();
    /// let filter = Filter::new(model.acceleration_variance(), None);
    /// series.run(filter, |_, state, _| angles.push(state.mean[0]));
    /// assert_eq!(angles[0], 10.0);
    /// assert!((angles[3] - 11.5).abs() < 0.01);
    /// # Ok::<(), tertia::Error>(())
    /// ```
    #[inline(always)]
    pub fn run(
        &self,
        mut filter: Filter,
        mut sink: impl FnMut(usize, &State, Innovation),
    ) -> Summary {
        let mut likelihood = Likelihood { squares: 0.0, product: 1.0, count: 0 };
        let mut step = 0;
        while step < self.z.len() {
            if let Some(state) = filter.plain().filter(|_| step > 0) {
                let before = step;
                step = self.run_plain(state, step, &mut filter, &mut likelihood, &mut sink);
                if step > before {
                    continue;
                }
            }
            if step > 0 {
                filter.predict(&self.transition.at(step - 1));
            }
            let z = self.z[step];
            let innovation =
                if z.is_nan() { None } else { filter.update(z, self.variance.at(step)) };
            if let Some(innovation) = innovation {
                likelihood.add(innovation);
            }
            sink(step, &filter.state(), innovation.unwrap_or(Innovation::NONE));
            step += 1;
        }
        Summary { filter, log_likelihood: likelihood.logarithm(), count: likelihood.count }
    }
}

impl Series<'_> {
    /// Returns the variance of the last plot.
    pub(super) fn last_variance(&self) -> Option<f64> {
        self.z.iter().rposition(|z| !z.is_nan()).map(|step| self.variance.at(step))
    }

    /// Returns the transition after a plot; after the last plot, an arbitrary one.
    #[inline(always)]
    fn transition_after(&self, step: usize) -> &Transition {
        match &self.transition {
            PerStep::Constant(transition) => transition,
            PerStep::Each(each) => each.get(step).unwrap_or(&Transition::NONE),
        }
    }

    /// Continues from the `state` after the step before `step` for as long as the covariance need not
    /// be kept as factors. Returns the first step that has not been processed.
    #[inline(always)]
    fn run_plain(
        &self,
        mut state: State,
        mut step: usize,
        filter: &mut Filter,
        likelihood: &mut Likelihood,
        sink: &mut impl FnMut(usize, &State, Innovation),
    ) -> usize {
        let (mut previous, mut noise) = ([f64::NAN; 6], filter.noise());
        let constant = match (self.variance, self.transition) {
            (PerStep::Constant(_), PerStep::Constant(transition)) => Some(transition),
            _ => None,
        };
        let mut predicted = state.predicted(self.transition.get(step - 1));
        while step < self.z.len() {
            let (z, r) = (self.z[step], self.variance.at(step));
            let next = self.transition_after(step);
            let missing = z.is_nan();
            if predicted.needs_factors(noise) || (!missing && predicted.needs_factors(r)) {
                break;
            }
            if missing {
                previous = [f64::NAN; 6];
                state = predicted;
                sink(step, &state, Innovation::NONE);
                predicted = state.predicted(next);
                step += 1;
                continue;
            }
            let (updated, innovation) = predicted.updated(z, r, filter.period());
            likelihood.add(innovation);
            sink(step, &updated, innovation);
            (state, noise) = (updated, r);
            step += 1;
            if let Some(transition) = constant {
                if is_close(previous, state.covariance) {
                    let gain = Converged::new(&predicted, innovation.variance, transition);
                    step = gain.run(self.z, step, filter.period(), &mut state, likelihood, sink);
                    predicted = state.predicted(next);
                    continue;
                }
                previous = state.covariance;
            }
            // without process noise, rounding accumulates over all steps, so the form with least
            // rounding is used
            predicted = if next.q[5] > 0.0 {
                let covariance = predicted.covariance_after(r, next);
                State { mean: next.mean(state.mean), covariance }
            } else {
                state.predicted(next)
            };
        }
        filter.set(state, noise);
        step
    }
}

#[inline(always)]
fn is_close(a: [f64; 6], b: [f64; 6]) -> bool {
    let close = |i: usize| (a[i] - b[i]).abs() <= CONVERGED * b[i].abs();
    close(0) && close(1) && close(2) && close(3) && close(4) && close(5)
}

/// A gain that has converged: only the mean has to be computed.
struct Converged {
    gain: [f64; 3],
    variance: f64,
    transition: Transition,
}

impl Converged {
    fn new(predicted: &State, variance: f64, transition: Transition) -> Self {
        let [p00, p01, p02, ..] = predicted.covariance;
        let s = 1.0 / variance;
        Self { gain: [p00 * s, p01 * s, p02 * s], variance, transition }
    }

    /// Continues until the next step without a plot, and returns this step.
    #[inline(always)]
    fn run(
        &self,
        z: &[f64],
        mut step: usize,
        period: Option<f64>,
        state: &mut State,
        likelihood: &mut Likelihood,
        sink: &mut impl FnMut(usize, &State, Innovation),
    ) -> usize {
        let [k0, k1, k2] = self.gain;
        let (mut mean, first, mut squares) = (state.mean, step, 0.0);
        while step < z.len() && !z[step].is_nan() {
            let [y0, y1, y2] = self.transition.mean(mean);
            let value = residual(z[step], y0, period);
            mean = [y0 + k0 * value, y1 + k1 * value, y2 + k2 * value];
            squares += value * value;
            state.mean = mean;
            sink(step, state, Innovation { value, variance: self.variance });
            step += 1;
        }
        likelihood.add_all(squares, self.variance, step - first);
        step
    }
}

#[cfg(test)]
mod levels;
