//! The filter of one target, starting without any knowledge or from a given state.

use super::backward::Filtered;
use super::factored::Factored;
use super::model::Transition;
use super::state::{Innovation, State, residual};

/// Ratio of prior variance to noise below which the covariance is no longer kept as factors.
const PLAIN_BELOW: f64 = 1e3;

/// Noise before the first plot: any prior is narrower.
const NONE: f64 = f64::INFINITY;

/// What is known about a target.
#[derive(Clone, Copy, Debug)]
enum Knowledge {
    Nothing,
    /// One plot with its variance, and the transition from the time of this plot to now.
    Plot {
        z: f64,
        r: f64,
        since: Transition,
    },
    Plain(State),
    Factored(Factored),
}

/// A filter of an angle that may wrap.
///
/// Without an initial state, angle and rate are unknown, and the acceleration has the variance of its
/// model. This is treated exactly, not approximated by large variances. The angle is known from the
/// first plot on, the rate from the second.
#[derive(Clone, Copy, Debug)]
pub struct Filter {
    knowledge: Knowledge,
    acceleration_variance: f64,
    period: Option<f64>,
    /// Variance of the last plot.
    noise: f64,
}

impl Filter {
    /// Creates a filter before the first plot, with the variance of the acceleration.
    pub fn new(acceleration_variance: f64, period: Option<f64>) -> Self {
        let knowledge = Knowledge::Nothing;
        Self { knowledge, acceleration_variance, period, noise: NONE }
    }

    /// Creates a filter that starts from a given state.
    pub fn from_state(state: State, period: Option<f64>) -> Self {
        let knowledge = Knowledge::Plain(state);
        Self { knowledge, acceleration_variance: 0.0, period, noise: NONE }
    }

    /// Returns the state of the filter as numbers.
    pub fn saved(&self) -> Vec<f64> {
        let noise = self.noise;
        match &self.knowledge {
            Knowledge::Nothing => vec![noise, 0.0],
            Knowledge::Plot { z, r, since } => {
                [&[noise, 1.0, *z, *r], &since.f[..], &since.q[..]].concat()
            }
            Knowledge::Plain(state) => {
                [&[noise, 2.0], &state.mean[..], &state.covariance[..]].concat()
            }
            Knowledge::Factored(factored) => [&[noise, 3.0], &factored.saved()[..]].concat(),
        }
    }

    /// Returns the filter with the state from [`Filter::saved`]; `None` if the numbers do not come from
    /// there.
    pub fn restored(&self, saved: &[f64]) -> Option<Self> {
        let (&noise, saved) = saved.split_first()?;
        let knowledge = match saved {
            [0.0] => Knowledge::Nothing,
            [1.0, z, r, rest @ ..] => {
                let (f, q) = rest.split_at_checked(4)?;
                let since = Transition { f: f.try_into().ok()?, q: q.try_into().ok()? };
                Knowledge::Plot { z: *z, r: *r, since }
            }
            [2.0, rest @ ..] => {
                let (mean, covariance) = rest.split_at_checked(3)?;
                Knowledge::Plain(State {
                    mean: mean.try_into().ok()?,
                    covariance: covariance.try_into().ok()?,
                })
            }
            [3.0, rest @ ..] => Knowledge::Factored(Factored::restored(rest.try_into().ok()?)),
            _ => return None,
        };
        Some(Self { knowledge, noise, ..*self })
    }

    /// Returns the state. Before the first plot its mean is nan; unknown components have the variance
    /// ∞.
    pub fn state(&self) -> State {
        match &self.knowledge {
            Knowledge::Nothing => State::UNKNOWN,
            Knowledge::Plot { z, r, since } => {
                let known = since.f[0] == 0.0;
                let variance = if known { *r } else { f64::INFINITY };
                let acceleration =
                    since.f[3] * since.f[3] * self.acceleration_variance + since.q[5];
                State {
                    mean: [*z, 0.0, 0.0],
                    covariance: [variance, 0.0, 0.0, f64::INFINITY, 0.0, acceleration],
                }
            }
            Knowledge::Plain(state) => *state,
            Knowledge::Factored(factored) => factored.state(),
        }
    }

    /// Returns the state if it is known and its covariance is not kept as factors: a series can
    /// continue from it.
    #[inline(always)]
    pub(crate) fn plain(&self) -> Option<State> {
        match self.knowledge {
            Knowledge::Plain(state) => Some(state),
            _ => None,
        }
    }

    /// Returns the variance of the acceleration before any measurement; 0 for a given state.
    pub(crate) fn acceleration_variance(&self) -> f64 {
        self.acceleration_variance
    }

    /// Whether angle and rate are known.
    pub(crate) fn is_known(&self) -> bool {
        matches!(self.knowledge, Knowledge::Plain(_) | Knowledge::Factored(_))
    }

    /// Whether there has been a plot, or a state was given.
    pub(crate) fn has_plot(&self) -> bool {
        !matches!(self.knowledge, Knowledge::Nothing)
    }

    /// Returns the transition since the first plot, as long as there is only one plot.
    pub(crate) fn since_first_plot(&self) -> Option<Transition> {
        match self.knowledge {
            Knowledge::Plot { since, .. } => Some(since),
            _ => None,
        }
    }

    /// Returns the variance of the last plot; ∞ before the first one.
    pub(crate) fn noise(&self) -> f64 {
        self.noise
    }

    /// Sets the state after a plot with this noise.
    pub(crate) fn set(&mut self, state: State, noise: f64) {
        self.knowledge = Knowledge::Plain(state);
        self.noise = noise;
    }

    pub(crate) fn period(&self) -> Option<f64> {
        self.period
    }

    /// Returns the state for the smoother. If only one plot is known, the covariance is finite, and the
    /// direction that is unknown is given as well. `None` before the first plot.
    pub(crate) fn filtered(&self) -> Option<Filtered> {
        match &self.knowledge {
            Knowledge::Nothing => None,
            Knowledge::Plot { z, r, since } => {
                let covariance = [*r, 0.0, 0.0, 0.0, 0.0, self.acceleration_variance];
                let start = State { mean: [*z, 0.0, 0.0], covariance };
                let unknown = Some([since.f[0], 1.0, 0.0]);
                let factored = Factored::new(&start.predicted(since));
                Some(Filtered { factored, unknown })
            }
            Knowledge::Plain(state) => {
                Some(Filtered { factored: Factored::new(state), unknown: None })
            }
            Knowledge::Factored(factored) => Some(Filtered { factored: *factored, unknown: None }),
        }
    }

    /// Predicts the state over a transition.
    pub fn predict(&mut self, transition: &Transition) {
        match &mut self.knowledge {
            Knowledge::Nothing => {}
            Knowledge::Plot { since, .. } => *since = since.then(transition),
            Knowledge::Plain(state) => {
                let predicted = state.predicted(transition);
                if predicted.needs_factors(self.noise) {
                    // before rounding in the prediction destroys information
                    let mut factored = Factored::new(state);
                    factored.predict(transition);
                    self.knowledge = Knowledge::Factored(factored);
                } else {
                    *state = predicted;
                }
            }
            Knowledge::Factored(factored) => factored.predict(transition),
        }
    }

    /// Updates the state with a plot whose innovation is known and does not wrap, after the predicted
    /// covariance has been multiplied by `inflation`. The state must be known.
    pub(crate) fn correct(&mut self, innovation: f64, r: f64, inflation: f64) {
        let period = self.period.take();
        match &mut self.knowledge {
            Knowledge::Plain(state) => state.covariance = state.covariance.map(|p| p * inflation),
            Knowledge::Factored(factored) => factored.inflate(inflation),
            _ => {}
        }
        self.update(self.state().mean[0] + innovation, r);
        self.period = period;
    }

    /// Updates the state with a plot z of variance r. Returns `None` if the plot was needed to start,
    /// so that it has no innovation.
    pub fn update(&mut self, z: f64, r: f64) -> Option<Innovation> {
        self.noise = r;
        match &mut self.knowledge {
            Knowledge::Nothing => {
                self.knowledge = Knowledge::Plot { z, r, since: Transition::NONE };
                None
            }
            Knowledge::Plot { z: z0, r: r0, since } if since.f[0] == 0.0 => {
                // at the same time: both plots are replaced by their weighted mean
                let innovation =
                    Innovation { value: residual(z, *z0, self.period), variance: *r0 + r };
                let share = *r0 / innovation.variance;
                *z0 += share * innovation.value;
                *r0 = r * share;
                Some(innovation)
            }
            Knowledge::Plot { z: z0, r: r0, since } => {
                let state = two_plots(
                    *z0,
                    residual(z, *z0, self.period),
                    (*r0, r),
                    since,
                    self.acceleration_variance,
                );
                self.knowledge = Knowledge::Plain(state);
                None
            }
            Knowledge::Plain(state) if state.needs_factors(r) => {
                let mut factored = Factored::new(state);
                let innovation = factored.update(z, r, self.period);
                self.knowledge = Knowledge::Factored(factored);
                Some(innovation)
            }
            Knowledge::Plain(state) => {
                let (updated, innovation) = state.updated(z, r, self.period);
                *state = updated;
                Some(innovation)
            }
            Knowledge::Factored(factored) => {
                let innovation = factored.update(z, r, self.period);
                let narrow = innovation.variance < PLAIN_BELOW * r;
                if narrow && factored.is_moderate() {
                    self.knowledge = Knowledge::Plain(factored.state());
                }
                Some(innovation)
            }
        }
    }
}

/// Returns the state at the second of two plots, if angle and rate were unknown before the first. The
/// angle has increased by `rise` between them, so the rate is `rise / T`; its error is due to both
/// plots, to the acceleration (variance `a`) at the first plot, and to the change of the acceleration
/// since then.
fn two_plots(z0: f64, rise: f64, (r0, r1): (f64, f64), since: &Transition, a: f64) -> State {
    let [t, f02, f12, f22] = since.f;
    let q = &since.q;
    let lever = f12 - f02 / t;
    let rate = lever * lever * a + q[3] - 2.0 * q[1] / t + q[0] / (t * t) + (r0 + r1) / (t * t);
    State {
        mean: [z0 + rise, rise / t, 0.0],
        covariance: [
            r1,
            r1 / t,
            0.0,
            rate,
            lever * f22 * a + q[4] - q[2] / t,
            f22 * f22 * a + q[5],
        ],
    }
}
