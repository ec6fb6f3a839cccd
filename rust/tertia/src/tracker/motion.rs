//! Models of how targets move, and their parameters.

pub(super) mod agility;
pub(super) mod curve;
pub(super) mod deviation;
pub(super) mod estimate;
pub(super) mod height_effect;
pub(super) mod imm;
pub(super) mod kinematics;
pub(super) mod speed_change;
pub(super) mod tight_turns;
pub(super) mod velocities;

use crate::association::gate::{self, GUARD, INNER, OUTER};
use crate::base::error::{Result, require, require_positive};
use crate::kalman::Singer;
use serde::{Deserialize, Serialize};

/// Number of normalised distances squared that are summed to detect a manoeuvre.
pub(super) const SUMMED: usize = 3;

/// Number of plots with which a line begins after a quadratic.
const LINE: usize = 3;

/// How confirmed targets move.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Motion {
    /// Straight and uniform motion, with white acceleration of this standard deviation, m/s².
    Cv(f64),
    /// Singer's model: an acceleration that fades.
    Singer(Singer),
    /// Straight flight, turns and changes of speed, weighted by their probabilities (interacting
    /// multiple models).
    Imm(ImmModel),
    /// Least squares over a sliding window of plots.
    Window(WindowModel),
}

impl Motion {
    /// Acceleration that a target may have unnoticed, m/s², if scans take 4 s and if they take 10 s. It is
    /// larger for the window, which detects turns last.
    pub fn guard_acceleration(&self) -> [f64; 2] {
        match self {
            Self::Window(_) => [12.0, 7.0],
            _ => [5.0; 2],
        }
    }

    /// Whether it can follow flight plans.
    pub fn takes_plans(&self) -> bool {
        matches!(self, Self::Imm(_) | Self::Window(_))
    }

    /// # Errors
    /// A number outside its domain.
    pub(super) fn check(&self) -> Result<()> {
        match self {
            Self::Cv(sigma) => require_positive("straight_sigma", *sigma),
            Self::Imm(model) => [
                ("straight_sigma", model.straight_sigma),
                ("turn_sigma", model.turn_sigma),
                ("turn_rate_walk", model.turn_rate_walk),
                ("turn_rate_sigma", model.turn_rate_sigma),
                ("straight_time", model.straight_time),
                ("turn_time", model.turn_time),
                ("acceleration_sigma", model.acceleration_sigma),
                ("steady_time", model.steady_time),
                ("speed_change_time", model.speed_change_time),
            ]
            .into_iter()
            .try_for_each(|(name, value)| require_positive(name, value)),
            Self::Singer(_) | Self::Window(_) => Ok(()),
        }
    }

    /// Largest standard deviation of the acceleration in its models, m/s².
    pub(super) fn largest_sigma(&self) -> f64 {
        match self {
            Self::Cv(sigma) => *sigma,
            Self::Imm(model) => model.straight_sigma.max(model.turn_sigma),
            Self::Singer(model) => model.acceleration_variance().sqrt(),
            Self::Window(_) => 1.0,
        }
    }
}

/// Straight flight, turns at a rate that is not known, and changes of speed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ImmModel {
    /// Standard deviation of the acceleration of straight flight, constant for a scan, m/s².
    pub straight_sigma: f64,
    /// Standard deviation of the acceleration in turns, constant for a scan, m/s².
    pub turn_sigma: f64,
    /// Random walk of the rate of turn, rad/s per root of a second.
    pub turn_rate_walk: f64,
    /// Standard deviation of the rate at which a turn begins, rad/s.
    pub turn_rate_sigma: f64,
    /// Mean duration of straight flight, s.
    pub straight_time: f64,
    /// Mean duration of a turn, s.
    pub turn_time: f64,
    /// Standard deviation of the acceleration along the course while the speed changes, m/s² (BADA
    /// limits it to 2 ft/s² for civil flights).
    pub acceleration_sigma: f64,
    /// Mean time between changes of speed, s.
    pub steady_time: f64,
    /// Mean duration of a change of speed, s.
    pub speed_change_time: f64,
}

impl Default for ImmModel {
    fn default() -> Self {
        Self {
            straight_sigma: 0.1,
            turn_sigma: 0.8,
            turn_rate_walk: 0.03_f64.to_radians(),
            turn_rate_sigma: 1.2_f64.to_radians(),
            straight_time: 400.0,
            turn_time: 35.0,
            acceleration_sigma: 0.5,
            steady_time: 900.0,
            speed_change_time: 60.0,
        }
    }
}

/// Lengths of the window, and the gates by which a manoeuvre is detected.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct WindowModel {
    /// Number of plots in straight flight.
    pub straight: usize,
    /// Number of plots that are kept, for a line or a quadratic, when a manoeuvre is detected.
    pub after_turn: usize,
    /// Whether a quadratic is fitted to these plots.
    pub is_curved: bool,
    /// Number of plots with which a line begins after a manoeuvre.
    pub(super) shortest: usize,
    /// Number of plots near a turn of the flight plan.
    pub planned_turn: usize,
    /// Distance squared of the inner gate.
    pub(super) inner: f64,
    /// Distance squared of the outer gate.
    pub(super) outer: f64,
    /// Distance squared of the guard gate.
    pub(super) guard: f64,
    /// Sum of three distances squared above which a manoeuvre is detected.
    pub(super) sum: f64,
}

impl WindowModel {
    /// Creates windows of these numbers of plots, with the gates of the source (Glagovskiy, Lavina, Rudelson
    /// 2014).
    ///
    /// # Errors
    /// A window that no line can be fitted to.
    pub fn try_new(
        straight: usize,
        after_turn: usize,
        planned_turn: usize,
        is_curved: bool,
    ) -> Result<Self> {
        let windows =
            [("straight", straight), ("after_turn", after_turn), ("planned_turn", planned_turn)];
        for (name, plots) in windows {
            require(name, plots as f64, plots >= 2, "2 plots or more")?;
        }
        Ok(Self {
            straight,
            after_turn,
            is_curved,
            shortest: if is_curved { LINE } else { after_turn },
            planned_turn,
            inner: gate::threshold(INNER, 2)?,
            outer: gate::threshold(OUTER, 2)?,
            guard: gate::threshold(GUARD, 2)?,
            sum: gate::threshold(GUARD, 2 * SUMMED)?,
        })
    }
}
