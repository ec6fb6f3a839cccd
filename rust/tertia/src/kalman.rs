//! The filter of an angle with its rate and acceleration, along a series, and back.
//!
//! Source: Panasyuk, Pudovkin, Rogachev 2018, (14) to (20), misprints mended. `x = [φ, ω, a]`,
//! acceleration with an exponential correlation (Singer 1970), plots of the angle alone. Units are
//! the caller's: an angle, its rate per unit of time, and so on.

mod block;
mod factored;
mod filter;
mod model;
mod series;
mod smoother;
mod state;

use crate::angle::principal;
pub use crate::angle::require_period;
use crate::distribution::chi_square_upper_quantile;
use crate::error::{Error, Result, require};
use factored::Factored;

pub use block::{LANES, run_block};
pub use filter::Filter;
pub use model::{Singer, Transition};
pub use series::{PerStep, Series, Summary, require_plot};
pub(crate) use state::residual;
pub use state::{Innovation, State};

/// An angle in [0, period).
#[inline(always)]
pub fn wrapped(angle: f64, period: f64) -> f64 {
    if angle.is_nan() || (0.0..period).contains(&angle) { angle } else { principal(angle, period) }
}

/// Tails of more degrees of freedom take seconds.
const MAX_DEGREES_OF_FREEDOM: usize = 100_000_000;
/// Steps after which a gain that still changes is given up.
const MAX_STEPS: usize = 10_000_000;
/// A covariance that changes by less in a step, in standard deviations, is steady.
const STEADY: f64 = 1e-14;
/// One that changes by less, and no longer less than the step before, is as steady as it gets.
const STALLED: f64 = 1e-13;

/// What the filter converges to with a plot of variance r every `dt`: the gain, and the covariance
/// after a plot.
///
/// # Errors
/// There is none: no process noise.
pub fn steady_state(model: &Singer, dt: f64, r: f64) -> Result<([f64; 3], [f64; 6])> {
    let transition = model.over(dt)?;
    let (sigma, noise) = (model.acceleration_sigma(), transition.q[5]);
    let requirement = "such that the model has process noise and time passes: there is no steady \
                       state otherwise";
    require("acceleration_sigma", sigma, noise > 0.0 && dt > 0.0, requirement)?;
    let covariance = [r, 0.0, 0.0, r / (dt * dt) + noise, 0.0, noise];
    let mut factored = Factored::new(&State { mean: [0.0; 3], covariance });
    let (mut before, mut last_change) = ([0.0; 6], f64::INFINITY);
    for _ in 0..MAX_STEPS {
        factored.update(0.0, r, None);
        let posterior = factored.state().covariance;
        factored.predict(&transition);
        let prior = factored.state();
        // what the noise of the motion hides in the prior shows in the posterior
        let [s0, s1, s2] = [posterior[0], posterior[3], posterior[5]].map(f64::sqrt);
        let scales = [s0 * s0, s0 * s1, s0 * s2, s1 * s1, s1 * s2, s2 * s2];
        let pairs = posterior.iter().zip(&before).zip(scales);
        let change = pairs.map(|((a, b), scale)| (a - b).abs() / scale).fold(0.0, f64::max);
        // rounding may keep it from getting smaller
        let stalled = change <= STALLED && change >= last_change;
        (before, last_change) = (posterior, change);
        if change <= STEADY || stalled {
            let [p00, p01, p02, ..] = prior.covariance;
            let gain = [p00, p01, p02].map(|p| p / (p00 + r));
            // the first row of (I − K h^T) P⁻ is K R
            let [.., p11, p12, p22] = posterior;
            return Ok((gain, [gain[0] * r, gain[1] * r, gain[2] * r, p11, p12, p22]));
        }
    }
    Err(Error::InvalidParameter {
        argument: "acceleration_sigma",
        value: sigma,
        requirement: "larger: the gain does not settle",
    })
}

/// The bounds within which the mean of `count` normalised squared errors of `dimension` components
/// lies with this probability, if their covariances are right.
///
/// # Errors
/// A probability that is none, or no errors.
pub fn consistency_bounds(probability: f64, count: usize, dimension: usize) -> Result<[f64; 2]> {
    let holds = probability > 0.0 && probability < 1.0;
    require("probability", probability, holds, "between 0 and 1 (exclusive)")?;
    let nu = count.saturating_mul(dimension);
    let requirement = "such that count times dimension is between 1 and 1e8";
    require("count", count as f64, (1..=MAX_DEGREES_OF_FREEDOM).contains(&nu), requirement)?;
    let outside = 0.5 * (1.0 - probability);
    let bound = |p: f64| chi_square_upper_quantile(p, nu) / count as f64;
    Ok([bound(1.0 - outside), bound(outside)])
}

/// Buffers of the smoother.
#[derive(Clone, Debug, Default)]
pub struct Workspace {
    filtered: Vec<(State, Option<smoother::Filtered>)>,
}

/// The state at every step from all plots; those before the first plot are unknown, as in the
/// filter. Cost O(steps).
pub fn smooth(
    series: &Series<'_>,
    filter: Filter,
    workspace: &mut Workspace,
    mut sink: impl FnMut(usize, &State),
) {
    let mut filter = filter.factored();
    let filtered = &mut workspace.filtered;
    filtered.clear();
    for (step, &z) in series.z.iter().enumerate() {
        if step > 0 {
            filter.predict(&series.transition.at(step - 1), series.variance.at(step));
        }
        if !z.is_nan() {
            filter.update(z, series.variance.at(step));
        }
        filtered.push((filter.state(), filter.filtered()));
    }
    let mut later: Option<State> = None;
    for (step, (shown, filtered)) in filtered.iter().enumerate().rev() {
        let state = match (filtered, later) {
            (Some(filtered), Some(next)) => filtered.smoothed(&series.transition.at(step), &next),
            _ => *shown,
        };
        if later.is_some() || filtered.is_some_and(|filtered| filtered.unknown.is_none()) {
            later = Some(state);
        }
        sink(step, &state);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn assert_close(found: &[f64], expected: &[f64]) {
        assert_eq!(found.len(), expected.len());
        for (x, y) in found.iter().zip(expected) {
            assert!((x - y).abs() <= 1e-12 * y.abs(), "{x} is not {y}");
        }
    }

    fn model() -> Transition {
        // D = σ² (1 − 0.8²) = 4e-6
        Singer::try_new(0.05, (4e-6_f64 / 0.36).sqrt(), false).unwrap().over(4.0).unwrap()
    }

    /// V1 of exact rational arithmetic.
    #[test]
    fn one_step() {
        let state = State {
            mean: [10.0, 0.5, 0.01],
            covariance: [0.01, 0.002, 0.0001, 0.0025, 0.0002, 0.0001],
        };
        let predicted = state.predicted(&model());
        assert_close(&predicted.mean, &[12.08, 0.54, 0.008]);
        assert_close(&predicted.covariance, &[0.0868, 0.0204, 0.00136, 0.0057, 0.00048, 6.8e-5]);
        let (updated, innovation) = predicted.updated(12.1, 0.01, None);
        assert_close(&[innovation.variance], &[0.0968]);
        let mean = [12.0979338842975, 0.544214876033058, 0.00828099173553719];
        assert_close(&updated.mean, &mean);
        let covariance = [
            0.00896694214876033,
            0.00210743801652893,
            0.000140495867768595,
            0.00140082644628099,
            0.000193388429752066,
            4.88925619834711e-05,
        ];
        assert_close(&updated.covariance, &covariance);
        let mut factored = factored::Factored::new(&state);
        factored.predict(&model());
        factored.update(12.1, 0.01, None);
        assert_close(&factored.state().mean, &mean);
        assert_close(&factored.state().covariance, &covariance);
    }

    /// Steps added up are one long step, and the exact model is that of the printed one's limit.
    #[test]
    fn exact_steps_compose() {
        for alpha in [0.0, 1e-9, 0.01, 0.3, 2.0] {
            let model = Singer::try_new(alpha, 0.7, true).unwrap();
            let [short, long] = [1.5, 4.5].map(|dt| model.over(dt).unwrap());
            let three = short.then(&short).then(&short);
            for (a, b) in three.f.iter().zip(long.f).chain(three.q.iter().zip(long.q)) {
                assert!((a - b).abs() <= 1e-13 * b.abs(), "{a} is not {b} at alpha {alpha}");
            }
        }
    }

    fn run(series: &Series<'_>, filter: Filter) -> Vec<State> {
        let mut states = Vec::new();
        series.run(filter, |_, state, _| states.push(*state));
        states
    }

    /// Unknown angle and rate against a prior that is nearly so, forwards and backwards.
    #[test]
    fn the_start_is_the_limit_of_a_wide_prior() {
        let singer = Singer::try_new(0.05, 0.02, true).unwrap();
        let variances: Vec<f64> = (0..12).map(|i| 0.01 + 0.003 * f64::from(i % 4)).collect();
        let transitions: Vec<_> =
            (0..11).map(|i| singer.over(3.0 + f64::from(i % 3)).unwrap()).collect();
        let n = f64::NAN;
        let z = [n, n, 3.0, n, n, 3.4, 3.7, n, 4.4, 4.2, 4.6, 4.9];
        let series = Series {
            z: &z,
            variance: PerStep::Each(&variances),
            transition: PerStep::Each(&transitions),
        };
        let a = singer.acceleration_variance();
        let unknown = Filter::new(a, None);
        let given = |wide| {
            let prior = State { mean: [0.0; 3], covariance: [wide, 0.0, 0.0, wide, 0.0, a] };
            Filter::from_state(prior, None)
        };
        let forwards = [unknown, given(1e13)].map(|filter| run(&series, filter));
        // the smoother loses the digits of P0/R
        let backwards = [unknown, given(1e6)].map(|filter| {
            let mut states = vec![State::UNKNOWN; z.len()];
            smooth(&series, filter, &mut Workspace::default(), |i, state| states[i] = *state);
            states
        });
        let close = |tolerance: f64, x: &State, y: &State| {
            let values = x.mean.iter().chain(&x.covariance);
            for (x, y) in values.zip(y.mean.iter().chain(&y.covariance)) {
                assert!((x - y).abs() <= tolerance * y.abs().max(0.1), "{x} is not {y}");
            }
        };
        for (x, y) in forwards[0].iter().zip(&forwards[1]).skip(5) {
            close(1e-12, x, y);
        }
        for (x, y) in backwards[0].iter().zip(&backwards[1]).skip(2) {
            close(1e-5, x, y);
        }
        assert_eq!(forwards[0][2].covariance[0], variances[2]);
        assert_eq!(forwards[0][4].covariance[0], f64::INFINITY);
    }

    #[test]
    fn the_gain_converges_to_the_steady_one() {
        let transition = model();
        let z: Vec<f64> = (0..2000).map(|i| (f64::from(i) * 0.37).sin()).collect();
        let series = Series {
            z: &z,
            variance: PerStep::Constant(0.01),
            transition: PerStep::Constant(transition),
        };
        let states = run(&series, Filter::new(1e-5, None));
        let model = Singer::try_new(0.05, (4e-6_f64 / 0.36).sqrt(), false).unwrap();
        let steady = steady_state(&model, 4.0, 0.01).unwrap();
        let last = states.last().unwrap();
        for (x, y) in last.covariance.iter().zip(steady.1) {
            assert!((x - y).abs() < 1e-13 * y.abs());
        }
        // the same as step by step
        let mut filter = Filter::new(1e-5, None);
        for (i, &z) in z.iter().enumerate() {
            if i > 0 {
                filter.predict(&transition, 0.01);
            }
            filter.update(z, 0.01);
        }
        for (x, y) in last.mean.iter().zip(filter.state().mean) {
            assert!((x - y).abs() < 1e-13, "{x} is not {y}");
        }
    }
}
