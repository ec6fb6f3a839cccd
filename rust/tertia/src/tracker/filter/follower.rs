//! The filter of a single target whose plots are known.

use super::LEAST_DENSITY;
use crate::base::plane::Plane;
use crate::tracker::motion::ImmModel;
use crate::tracker::motion::agility::Agility;
use crate::tracker::motion::estimate::{Estimate, POSITION};
use crate::tracker::motion::imm::{Bank, Component, MODELS, SPEED, TURN, changes};
use crate::tracker::motion::speed_change::SpeedChange;
use nalgebra::{Matrix2, Vector2};
use serde::{Deserialize, Serialize};

/// Largest number of steps of Newton's method, and the distance at which it has converged, m.
const STEPS: usize = 20;
const ARRIVED: f64 = 1e-4;

/// Straight flight, turns and changes of speed of a target, weighted by their probabilities, as in the
/// tracker.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Follower {
    bank: Bank,
    speed: SpeedChange,
    agility: Agility,
    /// Time of the estimate, s.
    pub time: f64,
}

impl Follower {
    /// Creates a filter from a position and velocity and the probability of a turn.
    pub fn new(model: &ImmModel, start: Estimate<4>, turning: f64, time: f64) -> Self {
        let bank = Bank::new(start, turning, model.turn_rate_sigma.powi(2));
        Self { bank, speed: SpeedChange::new(model), agility: Agility::default(), time }
    }

    /// Predicts to a later time; `period` is the scan period.
    pub fn predict(&mut self, model: &ImmModel, time: f64, period: f64) {
        let t = time - self.time;
        if t > 0.0 {
            let model = &self.agility.adapted(model, t, period);
            self.speed.predict(&mut self.bank, model, &changes(model, t), (t, period));
            self.time = time;
        }
    }

    /// Corrects by a position of covariance `r`.
    pub fn correct(&mut self, model: &ImmModel, z: [f64; 2], r: Plane) {
        let (before, expected) = (self.bank.probability, self.estimate());
        let innovation = [z[0] - expected.mean[0], z[1] - expected.mean[1]];
        self.agility.saw(innovation, expected.position_covariance().plus(r));
        self.speed.correct::<POSITION>(&self.bank, z, r);
        self.bank.correct::<POSITION>(z, r);
        let total = self.bank.total();
        if total > LEAST_DENSITY {
            self.bank.scale(total.recip());
        } else {
            self.bank.probability = before;
        }
        self.speed.decide(&mut self.bank, model);
    }

    /// Shifts the estimate by errors of its position and velocity, which are given for some time.
    pub fn shift(&mut self, time: f64, [east, north, east_rate, north_rate]: [f64; 4]) {
        let ahead = self.time - time;
        let place = [east + ahead * east_rate, north + ahead * north_rate];
        self.bank.shift(&[place[0], place[1], east_rate, north_rate].into());
    }

    /// Position and velocity.
    pub fn estimate(&self) -> Estimate<4> {
        self.speed.estimate(&self.bank)
    }

    /// Probability that the target turns, as for tracks of the tracker.
    pub fn turn_probability(&self) -> f64 {
        let turning = self.bank.probability[TURN];
        if self.bank.probability[SPEED] > 0.0 {
            return turning;
        }
        turning * (1.0 - self.speed.probability(&self.bank))
    }

    /// Finds the plot of covariance `r` that moves the estimate to this position, by Newton's method; none if
    /// there is no such plot.
    pub fn plot_behind(&self, position: [f64; 2], r: Plane) -> Option<[f64; 2]> {
        let all = self.bank.models().map(|model| Expected::new(&model, r));
        let count = if all[SPEED].probability > 0.0 { MODELS } else { SPEED };
        let models = &all[..count];
        let aim = Vector2::from(position);
        // at the expected position the weights of the models are known, and one step from there nearly
        // suffices
        let total: f64 = models.iter().map(|model| model.probability).sum();
        let weighted = models.iter().map(|model| model.position * model.probability);
        let mut z = weighted.sum::<Vector2<f64>>() / total;
        let (mut reached, mut slope) = corrected(models, &z)?;
        for _ in 0..STEPS {
            let missing = aim - reached;
            if missing.norm() < ARRIVED {
                return Some(z.into());
            }
            let mut step = slope.try_inverse()? * missing;
            // halve the step until it leads nearer
            loop {
                let there = corrected(models, &(z + step))?;
                if (aim - there.0).norm() < missing.norm() {
                    (reached, slope) = there;
                    z += step;
                    break;
                }
                step *= 0.5;
                if step.norm() < ARRIVED {
                    return None;
                }
            }
        }
        None
    }
}

/// The position that a model expects, and how a plot moves it.
struct Expected {
    probability: f64,
    position: Vector2<f64>,
    gain: Matrix2<f64>,
    inverse: Matrix2<f64>,
    root: f64,
}

impl Expected {
    fn new(model: &Component, r: Plane) -> Self {
        let matrix = |p: Plane| Matrix2::new(p.xx, p.xy, p.xy, p.yy);
        let s = model.covariance.plus(r);
        let inverse = matrix(s.inverse());
        Self {
            probability: model.probability,
            position: Vector2::from(model.position),
            gain: matrix(model.covariance) * inverse,
            inverse,
            root: s.determinant().sqrt(),
        }
    }
}

/// Mean position after a plot, and its derivative with respect to the plot; none if all models exclude the
/// plot.
fn corrected(models: &[Expected], z: &Vector2<f64>) -> Option<(Vector2<f64>, Matrix2<f64>)> {
    let (mut total, mut mean, mut pull) = (0.0, Vector2::zeros(), Vector2::zeros());
    let (mut gain, mut moved) = (Matrix2::zeros(), Matrix2::zeros());
    for model in models {
        let y = z - model.position;
        let own = model.inverse * y;
        let weight = model.probability * (-0.5 * y.dot(&own)).exp() / model.root;
        // relative to the first model, so that numbers are small
        let place = model.position - models[0].position + model.gain * y;
        total += weight;
        mean += place * weight;
        pull += own * weight;
        gain += model.gain * weight;
        moved += place * own.transpose() * weight;
    }
    if total.is_nan() || total <= LEAST_DENSITY {
        return None;
    }
    let (mean, pull) = (mean / total, pull / total);
    // the weights of the models depend on the plot, too
    let slope = (gain - moved) / total + mean * pull.transpose();
    Some((models[0].position + mean, slope))
}
