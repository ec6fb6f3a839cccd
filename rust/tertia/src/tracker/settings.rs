//! What a tracker is told.

use super::filter::Motion;
use super::plot::Radar;
use crate::base::error::{Result, require};
use crate::flightplan::Plan;
use serde::{Deserialize, Serialize};

/// What a tracker is told.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Settings {
    /// The radars, which plots name by their index.
    pub radars: Vec<Radar>,
    /// How confirmed targets move.
    pub motion: Motion,
    /// Distance squared of the guard gate.
    pub guard: f64,
    /// Acceleration that a target may have unnoticed, m/s², where scans take 4 s and where they take
    /// 10 s.
    pub guard_acceleration: [f64; 2],
    /// Plots that confirm a track, and scans in which they must come.
    pub confirmation: (usize, usize),
    /// Scans without a plot after which a track ends.
    pub coasting: usize,
    /// No target is faster, m/s.
    pub max_speed: f64,
    /// False plots per square metre and scan; nan: estimated.
    pub clutter_density: f64,
    /// How often an identity is read wrongly.
    pub identity_error_probability: f64,
    /// Identities that tell of an emergency.
    pub emergency_codes: Vec<i64>,
    /// Share of a scan for which a plot may be late.
    pub patience: f64,
    /// Flight plans.
    pub plans: Vec<Plan>,
    /// Probability that a planned turn is flown, before any; 0: plans are not used.
    pub flown_probability: f64,
    /// Velocity of the air, east and north, m/s.
    pub wind: [f64; 2],
    /// Its standard deviation, m/s.
    pub wind_sigma: f64,
}

/// Scans for which the guard acceleration is told, s; between, it is linear.
const GUARD_PERIODS: [f64; 2] = [4.0, 10.0];

impl Settings {
    /// Acceleration that a target may have unnoticed where scans take so long, m/s².
    pub(super) fn unnoticed(&self, period: f64) -> f64 {
        let [short, long] = GUARD_PERIODS;
        let [first, last] = self.guard_acceleration;
        first + (last - first) * ((period - short) / (long - short)).clamp(0.0, 1.0)
    }

    /// # Errors
    /// A number outside its domain.
    pub fn check(&self) -> Result<()> {
        require("radars", 0.0, !self.radars.is_empty(), "at least one radar")?;
        self.radars.iter().try_for_each(Radar::check)?;
        let positive = |name, value: f64| {
            require(name, value, value > 0.0 && value.is_finite(), "a positive number")
        };
        positive("max_speed", self.max_speed)?;
        positive("guard", self.guard)?;
        for a in self.guard_acceleration {
            require("guard_acceleration", a, a >= 0.0 && a.is_finite(), "0 or a positive number")?;
        }
        let (m, n) = self.confirmation;
        require("confirmation", m as f64, m >= 2 && m <= n, "2 plots or more, of no fewer scans")?;
        let p = self.flown_probability;
        require("flown_probability", p, (0.0..1.0).contains(&p), "0 or more, less than 1")?;
        let w = self.wind_sigma;
        require("wind_sigma", w, w >= 0.0 && w.is_finite(), "0 or a positive number")?;
        for v in self.wind {
            require("wind", v, v.is_finite(), "a finite number")?;
        }
        let b = self.clutter_density;
        require("clutter_density", b, b.is_nan() || b > 0.0, "a positive number")?;
        let p = self.identity_error_probability;
        require("identity_error_probability", p, p > 0.0 && p < 1.0, "between 0 and 1")
    }
}
