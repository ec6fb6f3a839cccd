//! Changes of speed: an acceleration along the course.
//!
//! As long as it is unlikely, it is estimated from the innovations of straight flight alone, of which
//! it is a bias (Friedland 1969), with its likelihood (Willsky, Jones 1976): that costs little, and
//! straight flight is not disturbed. Once it is likely it becomes a model of the bank.

use super::bank::{Bank, SPEED, STRAIGHT, TURN, Transition};
use super::estimate::Estimate;
use super::kinematics;
use super::motion::ImmModel;
use super::sight::Sight;
use crate::base::exponential::exp;
use crate::base::plane::Plane;
use serde::{Deserialize, Serialize};

/// From this probability on it is a model of the bank, and below that it no longer is. Results hardly
/// depend on them.
const BEGINS: f64 = 0.2;
const ENDS: f64 = 0.05;
/// Below this probability it is not in the estimate.
const NEGLIGIBLE: f64 = 0.005;
/// The acceleration fades with this time constant, s.
const FADING: f64 = 5000.0;
/// Mean time of a manoeuvre until the other kind follows at once, s.
const OTHER_TIME: f64 = 1000.0;
/// The course of a target that is slower counts less, m/s.
const SLOWEST: f64 = 1.0;
/// Limit of the logarithm of the likelihood ratio of a plot.
const LARGEST: f64 = 50.0;

/// The acceleration along the course, if the speed changes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct SpeedChange {
    /// Odds against straight flight, while it is no model of the bank.
    odds: f64,
    acceleration: f64,
    variance: f64,
    /// Position and velocity by the acceleration: their covariance with it over its variance.
    response: [f64; 4],
}

impl SpeedChange {
    /// Nothing is known but how often speeds change.
    pub fn new(model: &ImmModel) -> Self {
        Self {
            odds: model.speed_change_time / model.steady_time,
            acceleration: 0.0,
            variance: model.acceleration_sigma.powi(2),
            response: [0.0; 4],
        }
    }

    /// Probability of the change, which the models of the bank leave to it.
    #[inline]
    pub fn probability(&self, bank: &Bank) -> f64 {
        if bank.probability[SPEED] > 0.0 {
            return bank.probability[SPEED];
        }
        let odds = self.odds * bank.probability[STRAIGHT];
        odds / (1.0 + odds)
    }

    /// Mixes the models and predicts them over the time `t`; `changes` are those of straight flight and
    /// turns.
    #[inline]
    pub fn predict(
        &mut self,
        bank: &mut Bank,
        model: &ImmModel,
        changes: &Transition,
        (t, period): (f64, f64),
    ) {
        let is_model = bank.probability[SPEED] > 0.0;
        if is_model {
            self.mix(bank, model, changes, t);
        } else {
            self.begin(bank, model, changes, t);
            bank.mix(changes, model.turn_rate_sigma.powi(2));
        }
        let [_, _, vx, vy] = self.basis(bank).mean.data.0[0];
        let speed = (vx * vx + vy * vy).sqrt().max(SLOWEST);
        let by = [0.5 * t * t * vx, 0.5 * t * t * vy, t * vx, t * vy].map(|v| v / speed);
        bank.predict(model, t, period);
        if is_model {
            self.accelerate(&mut bank.plan, by, t, model.straight_sigma.powi(2) * period);
        }
        let v = self.response;
        self.response =
            [v[0] + t * v[2] + by[0], v[1] + t * v[3] + by[1], v[2] + by[2], v[3] + by[3]];
        self.fade(model, t);
    }

    /// Lets the speed begin to change, or be steady again, while that is no model of the bank.
    #[inline]
    fn begin(&mut self, bank: &Bank, model: &ImmModel, changes: &Transition, t: f64) {
        let (begins, ends) = rates(model, t);
        let odds = self.odds * (1.0 - ends) + begins;
        let fresh = begins / odds;
        let (own, square) = (1.0 - fresh, self.acceleration.powi(2));
        let variance =
            own * self.variance + fresh * (model.acceleration_sigma.powi(2) + own * square);
        // what returns to straight flight from turns knows nothing of the acceleration
        let stays = bank.probability[STRAIGHT] * changes[STRAIGHT][STRAIGHT];
        let returns = bank.probability[TURN] * changes[TURN][STRAIGHT];
        let stays = stays / (stays + returns);
        self.odds = stays * odds / (1.0 - begins + self.odds * ends);
        let kept = stays * own * (self.variance + fresh * square) / variance;
        self.response = self.response.map(|v| v * kept);
        self.acceleration *= own;
        self.variance = variance;
    }

    /// The same, and mixes the models of the bank, of which it is one.
    fn mix(&mut self, bank: &mut Bank, model: &ImmModel, changes: &Transition, t: f64) {
        let (begins, ends) = rates(model, t);
        let other = -(-t / OTHER_TIME).exp_m1();
        let [straight, turn] = [changes[STRAIGHT], changes[TURN]];
        let changes = [
            [straight[STRAIGHT] - begins, straight[TURN], begins],
            [turn[STRAIGHT], turn[TURN] - other, other],
            [ends, other, 1.0 - ends - other],
        ];
        let (before, own) = (bank.plan.mean, bank.probability[SPEED] * changes[SPEED][SPEED]);
        bank.mix(&changes, model.turn_rate_sigma.powi(2));
        let own = own / bank.probability[SPEED];
        let (fresh, square) = (1.0 - own, self.acceleration.powi(2));
        let variance =
            own * self.variance + fresh * (model.acceleration_sigma.powi(2) + own * square);
        // the others have none, whatever their states
        let moved = before - bank.plan.mean;
        for (i, v) in self.response.iter_mut().enumerate() {
            *v = own * (*v * self.variance + moved[i] * self.acceleration) / variance;
        }
        self.acceleration *= own;
        self.variance = variance;
    }

    /// Moves the model of the bank, which is `by` so much per acceleration.
    fn accelerate(&self, estimate: &mut Estimate<4>, by: [f64; 4], t: f64, q: f64) {
        kinematics::straight(estimate, t, q);
        let v = self.response;
        let before = [v[0] + t * v[2], v[1] + t * v[3], v[2], v[3]];
        let columns = &mut estimate.covariance.data.0;
        for j in 0..4 {
            estimate.mean[j] += self.acceleration * by[j];
            for i in 0..4 {
                let both = before[i] * by[j] + by[i] * before[j] + by[i] * by[j];
                columns[j][i] += self.variance * both;
            }
        }
    }

    /// Lets the acceleration fade towards its distribution at the beginning of a change.
    #[inline]
    fn fade(&mut self, model: &ImmModel, t: f64) {
        let left = exp(-t / FADING);
        let stays = left * left * self.variance;
        let variance = stays + model.acceleration_sigma.powi(2) * (1.0 - left * left);
        let kept = left * self.variance / variance;
        self.response = self.response.map(|v| v * kept);
        self.acceleration *= left;
        self.variance = variance;
    }

    /// Corrects by a plot, before the bank is.
    #[inline]
    pub fn correct(&mut self, bank: &Bank, z: [f64; 2], r: Plane) {
        let estimate = self.basis(bank);
        let y = [z[0] - estimate.mean[0], z[1] - estimate.mean[1]];
        let inverse = estimate.position_covariance().plus(r).inverse();
        let [a, b, ..] = self.response;
        let by = [inverse.xx * a + inverse.xy * b, inverse.xy * a + inverse.yy * b];
        let (information, seen) = (a * by[0] + b * by[1], y[0] * by[0] + y[1] * by[1]);
        let columns = &estimate.covariance.data.0;
        let gains = std::array::from_fn(|i| columns[0][i] * by[0] + columns[1][i] * by[1]);
        self.learn(bank.probability[SPEED] > 0.0, information, seen, &gains);
    }

    /// Corrects by an azimuth, before the bank is.
    pub fn see(&mut self, bank: &Bank, sight: &Sight, t: f64, moved: f64) {
        let estimate = self.basis(bank);
        let equation = sight.equation(estimate.mean.data.0[0], t);
        let (cross, variance) = estimate.along(&equation.row);
        let own: f64 = equation.row.iter().zip(&self.response).map(|(h, v)| h * v).sum();
        let by = own / (variance + equation.noise(moved));
        let gains = cross.map(|c| c * by);
        self.learn(bank.probability[SPEED] > 0.0, own * by, equation.residual * by, &gains);
    }

    /// No longer relates position and velocity to the acceleration: they were corrected otherwise.
    pub fn forget(&mut self) {
        self.response = [0.0; 4];
    }

    /// The estimate to which the response belongs.
    #[inline]
    fn basis<'a>(&self, bank: &'a Bank) -> &'a Estimate<4> {
        if bank.probability[SPEED] > 0.0 { &bank.plan } else { &bank.straight }
    }

    /// Corrects by what a measurement tells of the acceleration: its information, what was seen of it,
    /// both by the covariance of the innovation, and how far the response goes with the estimate.
    #[inline]
    fn learn(&mut self, is_model: bool, information: f64, seen: f64, gains: &[f64; 4]) {
        let p = self.variance;
        let (variance, gain) = if is_model {
            // the covariance of the innovation has that of the acceleration in it
            (p * (1.0 - p * information), p * seen)
        } else {
            let rest = seen - information * self.acceleration;
            let variance = p / (1.0 + p * information);
            let ratio = self.acceleration * (seen - 0.5 * information * self.acceleration)
                + 0.5 * rest * rest * variance;
            self.odds *= exp(ratio.min(LARGEST)) * (variance / p).sqrt();
            (variance, variance * rest)
        };
        let scale = if is_model { p / variance } else { 1.0 };
        for (v, gain) in self.response.iter_mut().zip(gains) {
            *v = scale * (*v - gain);
        }
        self.acceleration += gain;
        self.variance = variance;
    }

    /// Makes it a model of the bank where it has become likely, or no longer.
    #[inline]
    pub fn decide(&mut self, bank: &mut Bank, model: &ImmModel) {
        let probability = self.probability(bank);
        if bank.probability[SPEED] > 0.0 {
            if probability < ENDS {
                bank.probability[SPEED] = 0.0;
                bank.scale((1.0 - probability).recip());
                *self = Self::new(model);
            }
        } else if probability > BEGINS {
            bank.plan = self.added_to(&bank.straight);
            bank.scale(1.0 - probability);
            bank.probability[SPEED] = probability;
        }
    }

    /// Position and velocity if the speed changes, from those of straight flight.
    #[inline]
    fn added_to(&self, straight: &Estimate<4>) -> Estimate<4> {
        let mut with = *straight;
        let v = self.response;
        for (j, column) in with.covariance.data.0.iter_mut().enumerate() {
            with.mean[j] += self.acceleration * v[j];
            let of_column = self.variance * v[j];
            for (entry, v) in column.iter_mut().zip(v) {
                *entry += of_column * v;
            }
        }
        with
    }

    /// Position and velocity by a bank and this.
    #[inline]
    pub fn estimate(&self, bank: &Bank) -> Estimate<4> {
        let own = self.probability(bank);
        if own < NEGLIGIBLE || bank.probability[SPEED] > 0.0 {
            return bank.estimate();
        }
        // moments about straight flight: those of turns, and of what follows from an acceleration
        let turning = (1.0 - own) * bank.probability[TURN];
        let square = own * (self.variance + self.acceleration.powi(2));
        let (mut turned, mut moved) = ([0.0; 4], [0.0; 4]);
        let mut estimate = bank.straight;
        let mean = &mut estimate.mean.data.0[0];
        for i in 0..4 {
            turned[i] = bank.turn.mean[i] - mean[i];
            moved[i] = turning * turned[i] + own * self.acceleration * self.response[i];
            mean[i] += moved[i];
        }
        let (columns, turns) = (&mut estimate.covariance.data.0, &bank.turn.covariance.data.0);
        for j in 0..4 {
            let [by_turn, by_response] = [turning * turned[j], square * self.response[j]];
            for i in 0..4 {
                columns[j][i] = (1.0 - turning) * columns[j][i]
                    + turning * turns[j][i]
                    + by_turn * turned[i]
                    + by_response * self.response[i]
                    - moved[j] * moved[i];
            }
        }
        estimate
    }
}

/// Probabilities that the speed begins to change in the time `t`, and that it is steady again.
#[inline]
fn rates(model: &ImmModel, t: f64) -> (f64, f64) {
    (1.0 - exp(-t / model.steady_time), 1.0 - exp(-t / model.speed_change_time))
}
