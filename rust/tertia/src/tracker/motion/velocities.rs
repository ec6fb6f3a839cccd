//! Velocities that sensors report, which may be wrong.

use super::Motion;
use super::estimate::Estimate;
use crate::base::exponential::exp;
use crate::base::plane::Plane;
use crate::tracker::plot::Moving;
use std::f64::consts::{PI, TAU};

/// Share of velocities that are wrong, whatever covariance they have.
const OUTLIERS: f64 = 0.02;

/// Limits of velocities.
#[derive(Clone, Copy, Debug)]
pub(in crate::tracker) struct Velocities {
    /// Squared normalised distance beyond which a velocity is wrong.
    pub guard: f64,
    /// Largest speed, m/s.
    pub max_speed: f64,
}

impl Velocities {
    /// Density of wrong velocities: any up to the largest speed.
    fn rivals(self) -> f64 {
        1.0 / (PI * self.max_speed * self.max_speed)
    }

    /// Densities of a right velocity, from its `density` about the prediction, and of a wrong one.
    pub fn either(self, density: f64) -> [f64; 2] {
        [(1.0 - OUTLIERS) * density, OUTLIERS * self.rivals()]
    }

    /// Likelihood ratio of a velocity of this density: its target against another target or none.
    pub fn ratio(self, density: f64) -> f64 {
        self.either(density).into_iter().sum::<f64>() / self.rivals()
    }
}

impl Moving {
    /// The velocity with the noise of the motion over the seconds since then.
    pub fn since(self, seconds: f64, motion: &Motion, pace: f64) -> Self {
        let variance = match motion {
            Motion::Cv(sigma) => sigma * sigma * pace * seconds,
            Motion::Imm(model) => model.straight_sigma.powi(2) * pace * seconds,
            Motion::Singer(model) => model.acceleration_variance() * seconds * seconds,
            Motion::Window(_) => 0.0,
        };
        self.wider(Plane { xx: variance, xy: 0.0, yy: variance })
    }

    /// The velocity with more noise.
    pub fn wider(self, by: Plane) -> Self {
        Self { noise: self.noise.plus(by), ..self }
    }
}

impl<const N: usize> Estimate<N> {
    /// Squared normalised distance of a velocity, and its density.
    pub(in crate::tracker) fn expects(&self, seen: &Moving) -> [f64; 2] {
        let s = self.velocity_covariance().plus(seen.noise);
        let y = [seen.velocity[0] - self.mean[2], seen.velocity[1] - self.mean[3]];
        let distance = s.inverse().form(y);
        [distance, exp(-0.5 * distance) / (TAU * s.determinant().sqrt())]
    }
}
