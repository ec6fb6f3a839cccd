//! The filter of one target whose plots are known.

use super::bank::{Bank, STRAIGHT, TURN, changes};
use super::estimate::Estimate;
use super::motion::ImmModel;
use crate::base::plane::Plane;
use serde::{Deserialize, Serialize};

/// A plot that all models exclude says nothing about which is right.
const LEAST_DENSITY: f64 = 1e-300;

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
        self.bank.correct(z, r);
        let total = self.bank.total();
        if total > LEAST_DENSITY {
            self.bank.scale(total.recip());
        } else {
            self.bank.probability = before;
        }
    }

    /// Position and velocity.
    pub fn estimate(&self) -> Estimate<4> {
        self.bank.estimate()
    }

    pub fn turn_probability(&self) -> f64 {
        self.bank.probability[TURN]
            / (self.bank.probability[STRAIGHT] + self.bank.probability[TURN])
    }
}
