//! How targets move in the plane: straight on, in a turn, or with a change of speed.
//!
//! States are east and north, their velocities, and a state of the model's own: the rate of turn
//! (positive to the left), or the acceleration along the course. The own state fades instead of
//! walking without limit, so that its stationary distribution is that with which manoeuvres begin,
//! and the motion is the same backwards in time.

use super::mixture::State;
use super::two_filter::{Models, exponential};
use crate::base::exponential::exp;
use crate::base::small::{Matrix, Vector};
use crate::tracker::motion::kinematics::Arc;
use crate::tracker::motion::{ImmModel, Motion};

/// Number of states: east, north, their velocities, and the model's own.
pub(super) const STATES: usize = 5;
/// Number of models.
pub(super) const MODELS: usize = 3;
/// Straight and uniform motion.
pub(super) const STRAIGHT: usize = 0;
/// A turn at an unknown rate.
pub(super) const TURN: usize = 1;
/// A change of speed.
pub(super) const SPEED: usize = 2;
/// Index of the rate of turn or the acceleration among the states.
pub(super) const OWN: usize = 4;

/// Standard deviation of an unknown position, m, and of an unknown velocity, m/s. The weight of
/// such a state is negligible: a millionth of that of a plot.
const UNKNOWN: [f64; 2] = [30e3, 300.0];
/// Least variance of an unknown velocity relative to that of the estimate about which it is, because this
/// estimate and the filter use the same plots.
const VAGUE: f64 = 100.0;
/// Time for which accelerations are stated as constant, s.
const CONSTANT: f64 = 4.0;
/// Speed below which the course of a target is not linearised, m/s.
const SLOWEST: f64 = 1.0;

/// Noise and mean durations of the models.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Movement {
    /// Standard deviation of the acceleration in straight flight, in turns and in changes of speed,
    /// constant for 4 s, m/s².
    pub sigma: [f64; MODELS],
    /// Random walk of the rate of turn, rad/s per root of a second, and its standard deviation,
    /// rad/s.
    pub turn_rate: [f64; 2],
    /// Mean rate of turn, rad/s: the state of the model is the difference from it.
    pub mean_rate: f64,
    /// The same for the acceleration along the course, m/s² per root of a second and m/s².
    pub acceleration: [f64; 2],
    /// Rates of changes from one model (row) to another (column), per second; rows sum to zero.
    pub rates: Matrix<MODELS>,
    /// Probabilities of the models when nothing is known.
    pub stationary: [f64; MODELS],
}

/// Mean time of a manoeuvre until one of the other kind follows immediately, s.
const OTHER_TIME: f64 = 1000.0;
/// Random walk of the acceleration relative to its standard deviation, per root of a second.
const ACCELERATION_WALK: f64 = 0.02;

impl Default for Movement {
    fn default() -> Self {
        Self::with_turns(&ImmModel::default())
    }
}

/// Standard deviation of the rate at which a target circles, relative to this rate; its random walk, and the mean
/// duration of circling, relative to those of usual turns.
const CIRCLING_SPREAD: f64 = 0.35;
const CIRCLING_WALK: f64 = 5.0;
const CIRCLING_LONGER: f64 = 5.0;
/// Time after which changes of models are in balance, s.
const FOREVER: f64 = 1e6;

impl Movement {
    /// The models of a motion; none if this motion is not smoothed.
    pub fn of(motion: &Motion) -> Option<Self> {
        match motion {
            Motion::Imm(model) => Some(Self::with_turns(model)),
            Motion::Cv(sigma) => Some(Self::straight(*sigma)),
            Motion::Singer(_) | Motion::Window(_) => None,
        }
    }

    /// Straight flight and turns of this model, and changes of speed.
    fn with_turns(model: &ImmModel) -> Self {
        let [speeds, sped, other] =
            [model.steady_time, model.speed_change_time, OTHER_TIME].map(f64::recip);
        let (turns, turned) = (model.straight_time.recip(), model.turn_time.recip());
        let rates = [
            [-turns - speeds, turns, speeds],
            [turned, -turned - other, other],
            [sped, other, -sped - other],
        ];
        Self {
            sigma: [model.straight_sigma, model.turn_sigma, model.straight_sigma],
            turn_rate: [model.turn_rate_walk, model.turn_rate_sigma],
            mean_rate: 0.0,
            acceleration: [ACCELERATION_WALK, 1.0].map(|share| share * model.acceleration_sigma),
            rates,
            stationary: exponential(&rates, FOREVER)[STRAIGHT],
        }
    }

    /// Whether targets turn.
    pub(super) fn turns(&self) -> bool {
        self.stationary[TURN] > 0.0
    }

    /// The same for targets whose manoeuvres are `factor` times as sharp: they also change faster.
    pub(super) fn sharper(self, factor: f64) -> Self {
        let [walk, sigma] = self.turn_rate;
        let [straight, turn, speed] = self.sigma;
        Self {
            sigma: [straight, factor * turn, speed],
            turn_rate: [factor * factor * walk, factor * sigma],
            acceleration: self.acceleration.map(|own| factor * own),
            ..self
        }
    }

    /// The same for targets that circle at about this rate, rad/s, as gliders do in thermals.
    pub(super) fn circling(self, rate: f64) -> Self {
        let [walk, _] = self.turn_rate;
        let mut rates = self.rates;
        let ends = rates[TURN][STRAIGHT];
        rates[TURN][STRAIGHT] = ends / CIRCLING_LONGER;
        rates[TURN][TURN] += ends - rates[TURN][STRAIGHT];
        Self {
            turn_rate: [CIRCLING_WALK * walk, CIRCLING_SPREAD * rate.abs()],
            mean_rate: rate,
            rates,
            stationary: exponential(&rates, FOREVER)[STRAIGHT],
            ..self
        }
    }

    /// Straight flight alone, with this standard deviation of the acceleration, m/s².
    fn straight(sigma: f64) -> Self {
        Self {
            sigma: [sigma; MODELS],
            rates: [[0.0; MODELS]; MODELS],
            stationary: [1.0, 0.0, 0.0],
            ..Self::default()
        }
    }

    /// Share of a bounded random walk that remains after the time `t`.
    fn fading([walk, sigma]: [f64; 2], t: f64) -> f64 {
        exp(-0.5 * t * (walk / sigma).powi(2))
    }
}

impl Models<STATES, MODELS> for Movement {
    const SIGNS: Vector<STATES> = [1.0, 1.0, -1.0, -1.0, -1.0];

    fn backwards(&self) -> Self {
        Self { mean_rate: -self.mean_rate, ..*self }
    }

    fn predict(&self, model: usize, state: &mut State<STATES>, t: f64) {
        let f = match model {
            TURN => self.turn(state, t),
            SPEED => self.speed(state, t),
            _ => straight(state, t),
        };
        state.transform(&f);
        self.add_noise(model, state, t);
    }

    fn changes(&self, t: f64) -> Matrix<MODELS> {
        exponential(&self.rates, t)
    }

    fn variances(&self) -> [f64; MODELS] {
        // straight flight has no state of its own
        [1.0, self.turn_rate[1].powi(2), self.acceleration[1].powi(2)]
    }

    fn stationary(&self) -> [f64; MODELS] {
        self.stationary
    }

    fn unknown(&self, near: &State<STATES>) -> State<STATES> {
        let [p, v] = UNKNOWN.map(|sigma| sigma * sigma);
        let [u, v] = [2, 3].map(|i| v.max(VAGUE * near.covariance[i][i]));
        let [x, y, vx, vy, _] = near.mean;
        State::new([x, y, vx, vy, 0.0], [p, p, u, v, 0.0])
    }
}

impl Movement {
    /// Moves the mean along a turn at the rate in the state; returns the derivatives.
    fn turn(&self, state: &mut State<STATES>, t: f64) -> Matrix<STATES> {
        let [x, y, vx, vy, own] = state.mean;
        let arc = Arc::new(self.mean_rate + own, t);
        let velocity = [arc.cosine * vx - arc.sine * vy, arc.sine * vx + arc.cosine * vy];
        let left = Self::fading(self.turn_rate, t);
        let by_rate = arc.by_rate([vx, vy]);
        state.mean = [
            x + arc.along * vx - arc.across * vy,
            y + arc.across * vx + arc.along * vy,
            velocity[0],
            velocity[1],
            left * own,
        ];
        [
            [1.0, 0.0, arc.along, -arc.across, by_rate[0]],
            [0.0, 1.0, arc.across, arc.along, by_rate[1]],
            [0.0, 0.0, arc.cosine, -arc.sine, -t * velocity[1]],
            [0.0, 0.0, arc.sine, arc.cosine, t * velocity[0]],
            [0.0, 0.0, 0.0, 0.0, left],
        ]
    }

    /// Moves the mean with the acceleration in the state along its course; returns the derivatives.
    fn speed(&self, state: &mut State<STATES>, t: f64) -> Matrix<STATES> {
        let [x, y, vx, vy, a] = state.mean;
        let speed = vx.hypot(vy).max(SLOWEST);
        let u = [vx / speed, vy / speed];
        let (half, left) = (0.5 * t * t, Self::fading(self.acceleration, t));
        state.mean = [
            x + t * vx + half * a * u[0],
            y + t * vy + half * a * u[1],
            vx + t * a * u[0],
            vy + t * a * u[1],
            left * a,
        ];
        // du/dv = (1 − u u') / |v|
        let by_velocity = [
            [(1.0 - u[0] * u[0]) / speed, -u[0] * u[1] / speed],
            [-u[0] * u[1] / speed, (1.0 - u[1] * u[1]) / speed],
        ];
        let [p, v] = [half * a, t * a].map(|w| by_velocity.map(|row| row.map(|b| w * b)));
        [
            [1.0, 0.0, t + p[0][0], p[0][1], half * u[0]],
            [0.0, 1.0, p[1][0], t + p[1][1], half * u[1]],
            [0.0, 0.0, 1.0 + v[0][0], v[0][1], t * u[0]],
            [0.0, 0.0, v[1][0], 1.0 + v[1][1], t * u[1]],
            [0.0, 0.0, 0.0, 0.0, left],
        ]
    }

    /// Adds white acceleration, and the variance that the rate of turn or the acceleration has lost
    /// by fading.
    fn add_noise(&self, model: usize, state: &mut State<STATES>, t: f64) {
        let q = self.sigma[model].powi(2) * CONSTANT;
        let p = &mut state.covariance;
        for i in 0..2 {
            p[i][i] += q * t * t * t / 3.0;
            p[i][i + 2] += q * t * t / 2.0;
            p[i + 2][i] += q * t * t / 2.0;
            p[i + 2][i + 2] += q * t;
        }
        let lost = |walk: [f64; 2]| walk[1].powi(2) * (1.0 - Self::fading(walk, t).powi(2));
        match model {
            TURN => p[OWN][OWN] += lost(self.turn_rate),
            SPEED => p[OWN][OWN] += lost(self.acceleration),
            _ => p[OWN][OWN] = 1.0,
        }
    }
}

/// Moves the mean straight on; returns the derivatives.
fn straight(state: &mut State<STATES>, t: f64) -> Matrix<STATES> {
    let [x, y, vx, vy, ..] = state.mean;
    state.mean = [x + t * vx, y + t * vy, vx, vy, 0.0];
    [
        [1.0, 0.0, t, 0.0, 0.0],
        [0.0, 1.0, 0.0, t, 0.0],
        [0.0, 0.0, 1.0, 0.0, 0.0],
        [0.0, 0.0, 0.0, 1.0, 0.0],
        [0.0; STATES],
    ]
}
