//! An azimuth without a range, and what it says about a state: one equation, linearised about the
//! estimate.

use super::{Filter, LEAST_DENSITY, Multiple};
use crate::base::exponential::exp;
use crate::sensors::{Kind, Measurement, Row};
use crate::tracker::motion::estimate::Estimate;
use crate::tracker::motion::imm::Bank;
use crate::tracker::motion::speed_change::SpeedChange;
use crate::tracker::motion::{ImmModel, Motion};
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// A direction in which a sensor has seen a target.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Sight {
    /// Index among all plots that were passed to the tracker.
    pub index: usize,
    pub time: f64,
    pub sensor: usize,
    /// Position of the sensor.
    pub place: [f64; 2],
    pub azimuth: f64,
    pub sigma: f64,
}

/// A residual in sigmas, and the derivatives of the expected azimuth with respect to position and
/// velocity.
#[derive(Clone, Copy, Debug)]
pub(in crate::tracker) struct Equation {
    pub residual: f64,
    pub row: [f64; 4],
}

/// When a target was seen: time `t` after the estimate, s, which is never positive, and the time
/// between plots for the noise of the models, s.
#[derive(Clone, Copy, Debug)]
pub(in crate::tracker) struct When {
    pub t: f64,
    pub pace: f64,
}

impl When {
    /// Variance of the position since then, due to an acceleration of this standard deviation, m².
    fn moved(self, sigma: f64) -> f64 {
        sigma * sigma * self.pace * self.t.abs().powi(3) / 3.0
    }
}

impl Sight {
    /// The equation for a state of position and velocity; the target was seen `t` seconds after the
    /// time of this state.
    pub fn equation(&self, state: [f64; 4], t: f64) -> Equation {
        let then = [state[0] + t * state[2], state[1] + t * state[3]];
        let own = Measurement::new(Kind::Azimuth, 0, self.place, self.azimuth, self.sigma);
        let Row { residual, gradient: [x, y] } = own.row(&then);
        Equation { residual, row: [x, y, t * x, t * y] }
    }
}

impl Equation {
    /// Variance of the residual, including the motion of the target since then.
    fn noise(&self, moved: f64) -> f64 {
        let [x, y, ..] = self.row;
        1.0 + moved * (x * x + y * y)
    }
}

impl<const N: usize> Estimate<N> {
    /// Covariance of the state with a quantity that has these derivatives, and the variance of this
    /// quantity.
    pub(in crate::tracker) fn along(&self, row: &[f64; 4]) -> ([f64; N], f64) {
        let p = &self.covariance;
        let cross: [f64; N] =
            std::array::from_fn(|i| row.iter().enumerate().map(|(k, h)| p[(i, k)] * h).sum());
        let variance = row.iter().zip(&cross).map(|(h, c)| h * c).sum();
        (cross, variance)
    }

    /// Corrects by an azimuth; returns the density of its residual.
    fn see(&mut self, sight: &Sight, t: f64, moved: f64) -> f64 {
        let m = &self.mean;
        let equation = sight.equation([m[0], m[1], m[2], m[3]], t);
        let (cross, variance) = self.along(&equation.row);
        let (y, s) = (equation.residual, variance + equation.noise(moved));
        // x + P h' y / s, P − P h' h P / s
        for (i, own) in cross.iter().enumerate() {
            self.mean[i] += own * y / s;
            for (j, other) in cross.iter().enumerate() {
                self.covariance[(i, j)] -= own * other / s;
            }
        }
        exp(-0.5 * y * y / s) / (TAU * s).sqrt()
    }
}

impl Filter {
    /// Corrects by an azimuth. The window takes no azimuths.
    pub(in crate::tracker) fn see(&mut self, motion: &Motion, sight: &Sight, when: When) {
        match (self, motion) {
            (Self::Straight(estimate), Motion::Cv(sigma)) => {
                estimate.see(sight, when.t, when.moved(*sigma));
            }
            (Self::Singer(estimate), Motion::Singer(model)) => {
                let moved = 0.25 * model.acceleration_variance() * when.t.powi(4);
                estimate.see(sight, when.t, moved);
            }
            (Self::Multiple(multiple), Motion::Imm(noise)) => multiple.see(noise, sight, when),
            _ => {}
        }
    }
}

impl Multiple {
    fn see(&mut self, noise: &ImmModel, sight: &Sight, when: When) {
        if let Some(speed) = &mut self.speed {
            speed.see(&self.bank, sight, when.t, when.moved(noise.straight_sigma));
        }
        let before: f64 = self.banks().map(Bank::total).sum();
        let mut banks: Vec<Bank> = self.banks().copied().collect();
        banks.iter_mut().for_each(|bank| bank.see(noise, sight, when));
        let total: f64 = banks.iter().map(Bank::total).sum();
        for (own, mut seen) in self.banks_mut().zip(banks) {
            if total > LEAST_DENSITY {
                seen.scale(before / total);
            } else {
                seen.probability = own.probability;
            }
            *own = seen;
        }
    }
}

impl Bank {
    /// Corrects all models; the probabilities are multiplied by the densities.
    fn see(&mut self, noise: &ImmModel, sight: &Sight, when: When) {
        let (straight, turn) = (when.moved(noise.straight_sigma), when.moved(noise.turn_sigma));
        let [p, q, r] = &mut self.probability;
        if *p > 0.0 {
            *p *= self.straight.see(sight, when.t, straight);
        }
        if *q > 0.0 {
            *q *= self.turn.see(sight, when.t, turn);
        }
        if *r > 0.0 {
            *r *= self.plan.see(sight, when.t, straight);
        }
    }
}

impl SpeedChange {
    /// Corrects by an azimuth, before the bank is corrected.
    fn see(&mut self, bank: &Bank, sight: &Sight, t: f64, moved: f64) {
        let estimate = self.basis(bank);
        let equation = sight.equation(estimate.mean.data.0[0], t);
        let (cross, variance) = estimate.along(&equation.row);
        let own: f64 = equation.row.iter().zip(&self.response).map(|(h, v)| h * v).sum();
        let by = own / (variance + equation.noise(moved));
        let gains = cross.map(|c| c * by);
        self.learn(bank, own * by, equation.residual * by, &gains);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_within;
    use nalgebra::{SMatrix, SVector};

    fn estimate() -> Estimate<4> {
        let root = SMatrix::<f64, 4, 4>::new(
            30.0, 1.0, 2.0, -3.0, 0.0, 20.0, 5.0, 1.0, 4.0, 0.0, 1.0, 0.2, 0.1, 0.3, 0.0, 1.5,
        );
        let mean = SVector::from([3e4, -4e4, 200.0, 50.0]);
        Estimate { mean, covariance: root * root.transpose() }
    }

    fn sight(place: [f64; 2], azimuth: f64) -> Sight {
        Sight { index: 0, time: 0.0, sensor: 0, place, azimuth, sigma: 1e-3 }
    }

    #[test]
    fn an_azimuth_of_before_is_that_of_the_state_then() {
        let (t, moved) = (-2.5, 40.0);
        let seen = sight([1e3, 2e3], (2.9e4_f64 - 500.0).atan2(-4.2e4 - 125.0) + 5e-4);
        let mut now = estimate();
        let density = now.see(&seen, t, moved);
        // the same correction in the state of that time
        let mut then = estimate();
        let mut back = SMatrix::<f64, 4, 4>::identity();
        (back[(0, 2)], back[(1, 3)]) = (t, t);
        then.mean = back * then.mean;
        then.covariance = back * then.covariance * back.transpose();
        let scale = seen.equation(then.mean.data.0[0], 0.0).noise(moved).sqrt();
        let wide = Sight { sigma: seen.sigma * scale, ..seen };
        let other = then.see(&wide, 0.0, 0.0);
        let ahead = back.try_inverse().unwrap();
        assert!((now.mean - ahead * then.mean).amax() < 1e-8);
        let covariance = ahead * then.covariance * ahead.transpose();
        assert!((now.covariance - covariance).amax() < 1e-9);
        assert_within(1e-12, density, other / scale);
    }

    #[test]
    fn only_what_is_across_the_line_of_sight_is_learned() {
        let mut estimate = estimate();
        estimate.covariance = SMatrix::from_diagonal(&SVector::from([1e4, 1e4, 25.0, 25.0]));
        estimate.see(&sight([3e4, 0.0], std::f64::consts::PI), 0.0, 0.0);
        assert_within(1e-12, estimate.covariance[(1, 1)], 1e4);
        let (r, p) = ((4e4_f64 * 1e-3).powi(2), 1e4);
        assert_within(1e-9, estimate.covariance[(0, 0)], p * r / (p + r));
    }
}
