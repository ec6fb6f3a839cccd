//! The filter of one target: from no plot at all, or from a given state.

use super::backward::Filtered;
use super::factored::Factored;
use super::model::Transition;
use super::state::{Innovation, State, residual};

/// A covariance is kept as factors until its ratio to the noise is below this.
const PLAIN_BELOW: f64 = 1e3;

/// The noise before the first plot: whatever is known is narrower.
const NONE: f64 = f64::INFINITY;

/// What is known of a target.
#[derive(Clone, Copy, Debug)]
enum Knowledge {
    Nothing,
    /// One plot with its variance, and the step from then to now.
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
/// Without an initial state, angle and rate are unknown and the acceleration has the variance that
/// its model says: exactly, not by large numbers. The angle is known from the first plot on, the
/// rate from the second.
#[derive(Clone, Copy, Debug)]
pub struct Filter {
    knowledge: Knowledge,
    acceleration_variance: f64,
    period: Option<f64>,
    /// Variance of the last plot.
    noise: f64,
}

impl Filter {
    /// A filter before the first plot, with the variance of the acceleration.
    pub fn new(acceleration_variance: f64, period: Option<f64>) -> Self {
        let knowledge = Knowledge::Nothing;
        Self { knowledge, acceleration_variance, period, noise: NONE }
    }

    /// A filter from a given state on.
    pub fn from_state(state: State, period: Option<f64>) -> Self {
        let knowledge = Knowledge::Plain(state);
        Self { knowledge, acceleration_variance: 0.0, period, noise: NONE }
    }

    /// Everything that it knows, as numbers.
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

    /// The same filter after [`Filter::saved`]; `None` for numbers that did not come from there.
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

    /// The state; before the first plot its mean is nan, and what is unknown has the variance ∞.
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

    /// The state where it is known and kept as it is: from where a series may go on by itself.
    #[inline(always)]
    pub(crate) fn plain(&self) -> Option<State> {
        match self.knowledge {
            Knowledge::Plain(state) => Some(state),
            _ => None,
        }
    }

    /// Variance of the acceleration before anything is measured; 0 for a given state.
    pub(crate) fn acceleration_variance(&self) -> f64 {
        self.acceleration_variance
    }

    /// Whether angle and rate are known.
    pub(crate) fn is_known(&self) -> bool {
        matches!(self.knowledge, Knowledge::Plain(_) | Knowledge::Factored(_))
    }

    /// Whether there was a plot, or a state was given.
    pub(crate) fn has_plot(&self) -> bool {
        !matches!(self.knowledge, Knowledge::Nothing)
    }

    /// The step since the first plot, while there is but one.
    pub(crate) fn since_first_plot(&self) -> Option<Transition> {
        match self.knowledge {
            Knowledge::Plot { since, .. } => Some(since),
            _ => None,
        }
    }

    /// Variance of the last plot; ∞ before the first.
    pub(crate) fn noise(&self) -> f64 {
        self.noise
    }

    /// Goes on from a state after a plot with this noise.
    pub(crate) fn set(&mut self, state: State, noise: f64) {
        self.knowledge = Knowledge::Plain(state);
        self.noise = noise;
    }

    pub(crate) fn period(&self) -> Option<f64> {
        self.period
    }

    /// The state for the smoother: where only one plot is known, finite and with the direction of
    /// what is unknown. `None` before the first plot.
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

    /// Goes on in time.
    pub fn predict(&mut self, transition: &Transition) {
        match &mut self.knowledge {
            Knowledge::Nothing => {}
            Knowledge::Plot { since, .. } => *since = since.then(transition),
            Knowledge::Plain(state) => {
                let predicted = state.predicted(transition);
                if predicted.needs_factors(self.noise) {
                    // before the prediction has rounded what is known off
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

    /// Takes in a plot whose innovation, which does not wrap, is known, after a prediction whose
    /// covariance is so many times what it was. The state must be known.
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

    /// Takes in a plot z with the variance r. No innovation: the plot was needed to start.
    pub fn update(&mut self, z: f64, r: f64) -> Option<Innovation> {
        self.noise = r;
        match &mut self.knowledge {
            Knowledge::Nothing => {
                self.knowledge = Knowledge::Plot { z, r, since: Transition::NONE };
                None
            }
            Knowledge::Plot { z: z0, r: r0, since } if since.f[0] == 0.0 => {
                // at the same time: their weighted mean is one plot
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

/// The state at the second of two plots, where angle and rate were unknown before the first: the
/// angle has risen by `rise` since, the rate is `rise / T`, and its error is that of both plots, of the acceleration (variance `a`)
/// since the first, and of its change.
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
