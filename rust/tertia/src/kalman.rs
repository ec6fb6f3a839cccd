//! Filter and smoother for a series of angles: estimates of the angle, its rate and its acceleration.
//!
//! Source: Panasyuk, Pudovkin, Rogachev 2018, (14) to (20), with the misprints corrected.
//! `x = [φ, ω, a]`; the acceleration is exponentially correlated (Singer 1970), and plots contain the
//! angle only. Units are those of the caller: of angle, angle per unit of time, and so on.
//!
//! Order of the modules: `model <- state <- adjoint, factored <- backward <- filter <- steps, series <-
//! shared <- kept <- carried <- tile <- block <- batch, smoother <-
//! fit`; `steady` and `consistency` depend on none of the others except `model`.

mod adjoint;
mod backward;
mod batch;
mod block;
mod carried;
mod consistency;
mod factored;
mod filter;
mod fit;
mod kept;
mod model;
mod series;
mod shared;
mod smoother;
mod state;
mod steady;
mod steps;
mod tile;

pub use crate::base::angle::require_period;
pub use batch::{Batch, End, Row, Table};
pub use consistency::consistency_bounds;
pub use filter::Filter;
pub use fit::{Limit, NoiseFit, Recording, fit_noise};
pub use model::{Singer, Transition};
pub use series::{PerStep, Series, Summary, require_plot, require_plots};
pub use smoother::{Workspace, smooth};
pub(crate) use state::residual;
pub use state::{Innovation, State, wrapped};
pub use steady::steady_state;
pub use steps::Steps;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_all_close;

    fn model() -> Transition {
        // D = σ² (1 − 0.8²) = 4e-6
        Singer::try_new(0.05, (4e-6_f64 / 0.36).sqrt(), false).unwrap().over(4.0).unwrap()
    }

    /// Values of exact rational arithmetic.
    #[test]
    fn one_step() {
        let state = State {
            mean: [10.0, 0.5, 0.01],
            covariance: [0.01, 0.002, 0.0001, 0.0025, 0.0002, 0.0001],
        };
        let predicted = state.predicted(&model());
        assert_all_close(&predicted.mean, &[12.08, 0.54, 0.008]);
        assert_all_close(
            &predicted.covariance,
            &[0.0868, 0.0204, 0.00136, 0.0057, 0.00048, 6.8e-5],
        );
        let (updated, innovation) = predicted.updated(12.1, 0.01, None);
        assert_all_close(&[innovation.variance], &[0.0968]);
        let mean = [12.0979338842975, 0.544214876033058, 0.00828099173553719];
        assert_all_close(&updated.mean, &mean);
        let covariance = [
            0.00896694214876033,
            0.00210743801652893,
            0.000140495867768595,
            0.00140082644628099,
            0.000193388429752066,
            4.88925619834711e-05,
        ];
        assert_all_close(&updated.covariance, &covariance);
        let mut factored = factored::Factored::new(&state);
        factored.predict(&model());
        factored.update(12.1, 0.01, None);
        assert_all_close(&factored.state().mean, &mean);
        assert_all_close(&factored.state().covariance, &covariance);
    }

    /// Several steps are equal to one long step in the exact model.
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

    /// Unknown angle and rate give the limit of a very wide prior, in the filter and in the smoother.
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
        // with a wide prior, the smoother loses as many digits as P0/R has
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

    /// Plots of a single instant do not determine the rate; the angle there is their weighted mean at
    /// every step, and unknown after it.
    #[test]
    fn plots_of_one_instant_are_smoothed_to_their_mean() {
        let singer = Singer::try_new(0.05, 0.02, true).unwrap();
        let transitions = [0.0, 0.0, 0.0, 5.0].map(|dt| singer.over(dt).unwrap());
        let (n, variances) = (f64::NAN, [1.0, 3.0, 1.0, 1.0, 1.0]);
        let series = Series {
            z: &[4.0, 8.0, n, n, n],
            variance: PerStep::Each(&variances),
            transition: PerStep::Each(&transitions),
        };
        let filter = Filter::new(singer.acceleration_variance(), None);
        let mut states = [State::UNKNOWN; 5];
        smooth(&series, filter, &mut Workspace::default(), |i, state| states[i] = *state);
        for state in &states[..4] {
            assert_eq!((state.mean[0], state.covariance[0]), (5.0, 0.75));
            assert_eq!(state.covariance[3], f64::INFINITY);
        }
        assert_eq!(states[4].covariance[0], f64::INFINITY);
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
        // the same, step by step
        let mut filter = Filter::new(1e-5, None);
        for (i, &z) in z.iter().enumerate() {
            if i > 0 {
                filter.predict(&transition);
            }
            filter.update(z, 0.01);
        }
        for (x, y) in last.mean.iter().zip(filter.state().mean) {
            assert!((x - y).abs() < 1e-13, "{x} is not {y}");
        }
    }
}
