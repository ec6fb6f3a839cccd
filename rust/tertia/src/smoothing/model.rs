//! Model of a track: its motion, noise that differs from the stated one, and faults.

use super::motion::ProcessNoise;
use super::seen::Quantity;
use super::track::Track;

/// Noise of the whitened positions or velocities, a share of which is correlated over time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct LastingNoise {
    pub of: Quantity,
    /// Share of the variance that lasts; the white part has the variance `1 − share`.
    pub share: f64,
    /// Correlation time of the lasting part.
    pub time: f64,
}

impl LastingNoise {
    pub const NONE: Self = Self { of: Quantity::Position, share: 0.0, time: 0.0 };

    /// Correlation of the lasting part over a time; 0 if there is none.
    pub fn correlation(&self, t: f64) -> f64 {
        if self.time == 0.0 { 0.0 } else { (-t / self.time).exp() }
    }
}

/// Motion and noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Model {
    pub motion: ProcessNoise,
    pub lasting: LastingNoise,
    /// Standard deviations with which the position of each axis wanders about the path; then no noise lasts,
    /// and the correlation time is that of this motion.
    pub wandering: [f64; 3],
    /// Angular frequency if the wandering is a damped oscillation, which its correlation time damps; else 0.
    pub frequency: f64,
    /// Standard deviation of velocities relative to the stated one.
    pub velocity_factor: f64,
    /// Time by which velocities lag behind positions.
    pub velocity_time_offset: f64,
}

impl Model {
    /// A model of this motion with the noise as stated.
    pub fn as_stated(motion: ProcessNoise) -> Self {
        let lasting = LastingNoise::NONE;
        let (wandering, frequency) = ([0.0; 3], 0.0);
        let (velocity_factor, velocity_time_offset) = (1.0, 0.0);
        Self { motion, lasting, wandering, frequency, velocity_factor, velocity_time_offset }
    }

    /// The motion with the white velocity that moves the position like the wandering over short times.
    pub fn whole_motion(&self) -> ProcessNoise {
        let mut motion = self.motion;
        if self.wanders() && self.frequency == 0.0 {
            motion.velocity += 2.0 * self.wandering[0].powi(2) / self.lasting.time;
        }
        motion
    }

    /// Whether the position wanders, or oscillates, about the path: along all axes, or along none.
    #[inline(always)]
    pub fn wanders(&self) -> bool {
        self.wandering[0] > 0.0
    }

    /// Angular frequency of the oscillation if it were not damped.
    pub fn natural_frequency(&self) -> f64 {
        self.frequency.hypot(1.0 / self.lasting.time)
    }

    /// Position, velocity and acceleration of a wandering of unit variance: the coefficients of its displacement
    /// and, if it oscillates, of its velocity over the natural frequency. Those of a random walk are not defined.
    pub fn derivatives(&self) -> [[f64; 2]; 3] {
        if self.frequency == 0.0 {
            return [[1.0, 0.0], [0.0; 2], [0.0; 2]];
        }
        let rate = self.natural_frequency();
        [[1.0, 0.0], [0.0, rate], [-rate * rate, -2.0 * rate / self.lasting.time]]
    }

    /// Variance of a whitened number, and the share of it that lasts.
    #[inline(always)]
    pub fn noise(&self, quantity: Quantity) -> (f64, f64) {
        let share = if self.lasting.of == quantity { self.lasting.share } else { 0.0 };
        match quantity {
            Quantity::Position => (1.0, share),
            Quantity::Velocity => (self.velocity_factor.powi(2), share),
        }
    }
}

/// Times at which the noise of the positions, or the motion, is larger than at other times.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Levels {
    /// Whether it is larger, for each instant and the step to it; empty if it never is.
    pub raised: Vec<bool>,
    /// Variance of positions at these times, and intensity of the motion, relative to those at other times.
    pub noise: f64,
    pub motion: f64,
}

impl Default for Levels {
    fn default() -> Self {
        Self { raised: Vec::new(), noise: 1.0, motion: 1.0 }
    }
}

impl Levels {
    #[inline(always)]
    fn is_raised(&self, k: usize) -> bool {
        self.raised.get(k).is_some_and(|raised| *raised)
    }

    /// Relative variance of the positions at an instant.
    #[inline(always)]
    pub fn noise(&self, k: usize) -> f64 {
        if self.is_raised(k) { self.noise } else { 1.0 }
    }

    /// Relative intensity of the motion over the step to an instant.
    #[inline(always)]
    pub fn motion(&self, k: usize) -> f64 {
        if self.is_raised(k) { self.motion } else { 1.0 }
    }
}

/// Measurements that do not belong to the path, jumps, and times at which the noise or the motion is larger.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Faults {
    /// Positions, and velocities if these are measured, that are left out, plot by plot.
    pub gross: Vec<bool>,
    /// Instants before which the position jumps.
    pub jumps: Vec<bool>,
    pub levels: Levels,
}

impl Faults {
    /// Returns no faults.
    pub fn none(track: &Track<'_>) -> Self {
        let parts = track.parts().count() * track.len();
        let (gross, jumps) = (vec![false; parts], vec![false; track.len()]);
        Self { gross, jumps, levels: Levels::default() }
    }
}
