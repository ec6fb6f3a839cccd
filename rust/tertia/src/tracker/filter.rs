//! The filter of a track, by the model of its motion.

use super::bank::{Bank, Component, STRAIGHT, TURN, Transition};
use super::estimate::{Estimate, Moments, Plane};
use super::motion::{self, Noise};
use super::window::{Window, WindowRule};
use crate::kalman::Singer;
use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};

/// How targets are thought to move.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Motion {
    /// Straight and uniform, with white acceleration of this standard deviation.
    Straight(f64),
    /// Acceleration that fades.
    Singer(Singer),
    /// Straight flight and turns, by how likely they are.
    Multiple(Noise),
    /// Least squares over the last plots.
    Window(WindowRule),
}

/// What is known of a target's motion.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) enum Filter {
    Straight(Estimate<4>),
    Singer(Estimate<6>),
    Multiple(Box<Bank>),
    Window(Window),
}

impl Filter {
    /// A filter from a first position and velocity.
    pub fn new(motion: &Motion, start: Estimate<4>) -> Self {
        match motion {
            Motion::Straight(_) => Self::Straight(start),
            Motion::Singer(model) => Self::Singer(with_acceleration(&start, model)),
            Motion::Multiple(noise) => {
                let turning = noise.turn_time / (noise.turn_time + noise.straight_time);
                Self::Multiple(Box::new(Bank::new(start, turning, noise.turn_rate.powi(2))))
            }
            Motion::Window(_) => Self::Window(Window::new(start)),
        }
    }

    /// Lets so much time pass; `period` is that of the radar's scans.
    pub fn predict(&mut self, motion: &Motion, t: f64, period: f64) {
        match (self, motion) {
            (Self::Straight(estimate), Motion::Straight(sigma)) => {
                motion::straight(estimate, t, sigma * sigma * period);
            }
            (Self::Singer(estimate), Motion::Singer(model)) => singer(estimate, model, t),
            (Self::Multiple(bank), Motion::Multiple(noise)) => {
                bank.mix(&changes(noise, t), noise.turn_rate.powi(2));
                predict_bank(bank, noise, t, period);
            }
            (Self::Window(window), Motion::Window(_)) => window.predict(t),
            _ => unreachable!("a filter is made by its motion"),
        }
    }

    /// Calls `each` with every position that a model expects, and how likely it is.
    #[inline]
    pub fn components(&self, mut each: impl FnMut(Component)) {
        let one = |position, covariance| Component { probability: 1.0, position, covariance };
        match self {
            Self::Straight(e) => each(one(e.position(), e.position_covariance())),
            Self::Singer(e) => each(one(e.position(), e.position_covariance())),
            Self::Multiple(bank) => bank.components(each),
            Self::Window(window) => {
                let e = window.estimate();
                each(one(e.position(), e.position_covariance()));
            }
        }
    }

    /// Corrects by a plot.
    pub fn correct(&mut self, motion: &Motion, z: [f64; 2], r: Plane) {
        match (self, motion) {
            (Self::Straight(estimate), _) => {
                estimate.correct(z, r);
            }
            (Self::Singer(estimate), _) => {
                estimate.correct(z, r);
            }
            (Self::Multiple(bank), _) => {
                let before = bank.probability;
                bank.correct(z, r);
                let total = bank.total();
                if total > 0.0 {
                    bank.scale(total.recip());
                } else {
                    bank.probability = before;
                }
            }
            (Self::Window(window), Motion::Window(rule)) => window.correct(rule, z, r),
            _ => unreachable!("a filter is made by its motion"),
        }
    }

    /// Position and velocity, whatever the model.
    #[inline]
    pub fn estimate(&self) -> Estimate<4> {
        match self {
            Self::Straight(estimate) => *estimate,
            Self::Singer(e) => Estimate {
                mean: e.mean.fixed_rows::<4>(0).into_owned(),
                covariance: e.covariance.fixed_view::<4, 4>(0, 0).into_owned(),
            },
            Self::Multiple(bank) => {
                let mut moments = Moments::about(bank.straight.mean);
                bank.add_to(&mut moments, 1.0);
                moments.estimate()
            }
            Self::Window(window) => window.estimate(),
        }
    }

    /// Probability that the target turns.
    pub fn turning(&self) -> f64 {
        match self {
            Self::Multiple(bank) => bank.probability[TURN],
            Self::Window(window) => f64::from(u8::from(window.is_short())),
            Self::Straight(_) | Self::Singer(_) => 0.0,
        }
    }

    /// Widens the estimate, as if the target had accelerated unnoticed by `sigma` for `gap` seconds.
    /// A turn becomes as likely as straight flight.
    pub fn widen(&mut self, sigma: f64, gap: f64) {
        let mut extra = SMatrix::<f64, 4, 4>::zeros();
        let square = (sigma * gap).powi(2);
        for i in 0..2 {
            extra[(i, i)] = square * gap * gap / 4.0;
            extra[(i, i + 2)] = square * gap / 2.0;
            extra[(i + 2, i)] = square * gap / 2.0;
            extra[(i + 2, i + 2)] = square;
        }
        match self {
            Self::Straight(estimate) => estimate.covariance += extra,
            Self::Singer(estimate) => {
                let mut block = estimate.covariance.fixed_view_mut::<4, 4>(0, 0);
                block += extra;
            }
            Self::Multiple(bank) => {
                bank.widen(&extra);
                bank.expect_turn();
            }
            Self::Window(window) => window.widen(&extra),
        }
    }
}

/// Probabilities of the changes between straight flight and turns in the time `t`.
pub(super) fn changes(noise: &Noise, t: f64) -> Transition {
    let mut transition = [[0.0; 3]; 3];
    let begins = -(-t / noise.straight_time).exp_m1();
    let ends = -(-t / noise.turn_time).exp_m1();
    transition[STRAIGHT] = [1.0 - begins, begins, 0.0];
    transition[TURN] = [ends, 1.0 - ends, 0.0];
    transition
}

/// Lets time pass for straight flight and turn.
#[inline]
pub(super) fn predict_bank(bank: &mut Bank, noise: &Noise, t: f64, period: f64) {
    motion::straight(&mut bank.straight, t, noise.straight.powi(2) * period);
    motion::turn(&mut bank.turn, t, noise.turn.powi(2) * period, noise.turn_rate_walk);
}

/// Acceleration of zero, with its variance.
fn with_acceleration(start: &Estimate<4>, model: &Singer) -> Estimate<6> {
    let mut mean = SVector::<f64, 6>::zeros();
    let mut covariance = SMatrix::<f64, 6, 6>::zeros();
    mean.fixed_rows_mut::<4>(0).copy_from(&start.mean);
    covariance.fixed_view_mut::<4, 4>(0, 0).copy_from(&start.covariance);
    covariance[(4, 4)] = model.acceleration_variance();
    covariance[(5, 5)] = model.acceleration_variance();
    Estimate { mean, covariance }
}

/// One step of Singer's model for east and north; states are positions, velocities, accelerations.
fn singer(estimate: &mut Estimate<6>, model: &Singer, t: f64) {
    let step = model.over(t).expect("intervals are checked, the model is exact");
    let [f01, f02, f12, f22] = step.f;
    let mut f = SMatrix::<f64, 6, 6>::identity();
    let mut q = SMatrix::<f64, 6, 6>::zeros();
    let noise = [(0, 0), (0, 2), (0, 4), (2, 2), (2, 4), (4, 4)];
    for axis in 0..2 {
        f[(axis, axis + 2)] = f01;
        f[(axis, axis + 4)] = f02;
        f[(axis + 2, axis + 4)] = f12;
        f[(axis + 4, axis + 4)] = f22;
        for ((i, j), value) in noise.into_iter().zip(step.q) {
            q[(i + axis, j + axis)] = value;
            q[(j + axis, i + axis)] = value;
        }
    }
    estimate.mean = f * estimate.mean;
    estimate.covariance = f * estimate.covariance * f.transpose() + q;
}
