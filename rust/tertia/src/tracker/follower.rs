//! The filter of one target whose plots are known.

use super::bank::{Bank, Component, STRAIGHT, TURN, changes};
use super::estimate::{Estimate, POSITION};
use super::motion::ImmModel;
use crate::base::plane::Plane;
use nalgebra::{Matrix2, Vector2};
use serde::{Deserialize, Serialize};

/// A plot that all models exclude says nothing about which is right.
const LEAST_DENSITY: f64 = 1e-300;
/// Steps of Newton's method, and the distance at which it has arrived, m.
const STEPS: usize = 20;
const ARRIVED: f64 = 1e-4;

/// Straight flight and turns of a target, mixed by their probabilities, as the tracker does it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Follower {
    bank: Bank,
    /// Of the estimate, s.
    pub time: f64,
}

impl Follower {
    /// From a position and velocity, and the probability of a turn.
    pub fn new(model: &ImmModel, start: Estimate<4>, turning: f64, time: f64) -> Self {
        Self { bank: Bank::new(start, turning, model.turn_rate_sigma.powi(2)), time }
    }

    /// Predicts to a later time; `period` is that of the scans.
    pub fn predict(&mut self, model: &ImmModel, time: f64, period: f64) {
        let t = time - self.time;
        if t > 0.0 {
            self.bank.mix(&changes(model, t), model.turn_rate_sigma.powi(2));
            self.bank.predict(model, t, period);
            self.time = time;
        }
    }

    /// Corrects by a position of covariance `r`.
    pub fn correct(&mut self, z: [f64; 2], r: Plane) {
        let before = self.bank.probability;
        self.bank.correct::<POSITION>(z, r);
        let total = self.bank.total();
        if total > LEAST_DENSITY {
            self.bank.scale(total.recip());
        } else {
            self.bank.probability = before;
        }
    }

    /// Moves the estimate by what its position and velocity were off at a time.
    pub fn shift(&mut self, time: f64, [east, north, east_rate, north_rate]: [f64; 4]) {
        let ahead = self.time - time;
        let place = [east + ahead * east_rate, north + ahead * north_rate];
        self.bank.shift(&[place[0], place[1], east_rate, north_rate].into());
    }

    /// Position and velocity.
    pub fn estimate(&self) -> Estimate<4> {
        self.bank.estimate()
    }

    pub fn turn_probability(&self) -> f64 {
        self.bank.probability[TURN]
            / (self.bank.probability[STRAIGHT] + self.bank.probability[TURN])
    }

    /// The plot of covariance `r` by which the estimate moves to this position, by Newton's method; none
    /// where no plot does.
    pub fn plot_behind(&self, position: [f64; 2], r: Plane) -> Option<[f64; 2]> {
        let models = self.bank.models();
        let two = [STRAIGHT, TURN].map(|model| Expected::new(&models[model], r));
        let aim = Vector2::from(position);
        // where it was expected the models' weights are known, and one step goes nearly all the way
        let [a, b] = two.each_ref().map(|model| model.position);
        let turning = two[1].probability / (two[0].probability + two[1].probability);
        let mut z = a + (b - a) * turning;
        let (mut reached, mut slope) = corrected(&two, &z)?;
        for _ in 0..STEPS {
            let missing = aim - reached;
            if missing.norm() < ARRIVED {
                return Some(z.into());
            }
            let mut step = slope.try_inverse()? * missing;
            // half as far until it is nearer
            loop {
                let there = corrected(&two, &(z + step))?;
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

/// Where a model expects the target, and how a plot moves it.
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

/// The mean position after a plot, and its derivative by that; none where all models exclude it.
fn corrected(models: &[Expected; 2], z: &Vector2<f64>) -> Option<(Vector2<f64>, Matrix2<f64>)> {
    let parts = models.each_ref().map(|model| {
        let y = z - model.position;
        let pull = model.inverse * y;
        let weight = model.probability * (-0.5 * y.dot(&pull)).exp() / model.root;
        (weight, model.position + model.gain * y, pull)
    });
    let [(first, a, pull), (second, b, other)] = parts;
    let total = first + second;
    if total.is_nan() || total <= LEAST_DENSITY {
        return None;
    }
    let share = second / total;
    let mean = a + (b - a) * share;
    let gain = models[0].gain * (1.0 - share) + models[1].gain * share;
    // weights move with the plot
    let moved = (b - a) * (pull - other).transpose() * (share * (1.0 - share));
    Some((mean, gain + moved))
}
