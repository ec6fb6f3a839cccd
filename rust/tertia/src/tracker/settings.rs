//! Settings of a tracker.

pub(super) mod association;
pub(super) mod mht;
pub(super) mod plans;

use super::errors::delay::Delays;
use super::errors::quality::Quality;
use super::motion::Motion;
use super::plot::Measured;
use super::plot::geometry::Geometry;
use super::plot::level::Heights;
use crate::association::gate::{self, GUARD};
use crate::base::error::{Result, require, require_positive};
use crate::base::exponential::exp;
use crate::sensors::{Identities, IdentityKind, Radar};
use association::Association;
use mht::Mht;
use plans::Plans;
use serde::{Deserialize, Serialize};

/// Scan periods for which the guard acceleration is given, s; it is linear between them and
/// constant beyond.
const GUARD_PERIODS: [f64; 2] = [4.0, 10.0];
/// Largest probability of reading errors at which identities are considered to be addresses.
const ADDRESSES: f64 = 1e-6;
/// Mode 3/A codes that mean unlawful interference, radio failure and emergency.
const EMERGENCIES: [i16; 3] = [0o7500, 0o7600, 0o7700];
/// Largest delay of a plot, as a share of a scan.
pub(super) const MAX_DELAY: f64 = 0.25;

/// The rule by which a track is confirmed, and is ended before and after its confirmation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Confirmation {
    /// M plots within N scans.
    Plots(usize, usize),
    /// Three plots, and at least this probability that there is a target.
    Existence(f64),
}

impl Confirmation {
    /// Number of plots required for confirmation.
    pub(super) fn plots(self) -> usize {
        match self {
            Self::Plots(plots, _) => plots,
            Self::Existence(_) => 3,
        }
    }

    fn check(self) -> Result<()> {
        match self {
            Self::Plots(m, n) => {
                let requirement = "2 plots or more, in at least as many scans";
                require("confirmation", m as f64, m >= 2 && m <= n, requirement)
            }
            Self::Existence(p) => require("confirmation", p, p > 0.0 && p < 1.0, "between 0 and 1"),
        }
    }
}

/// Settings of a tracker.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Settings {
    /// The radars, to which plots refer by their index.
    pub radars: Vec<Radar>,
    /// Whether each radar may not confirm tracks now because its errors may have changed; empty if
    /// all may.
    pub held: Vec<bool>,
    /// Delays of the targets of each sensor; none where they are not sought, and empty if nowhere.
    pub delays: Vec<Option<Delays>>,
    /// Share of the plots of targets with a known identity that have none, by sensor; empty at first.
    pub unidentified: Vec<f64>,
    /// How the reports of each sensor differ from what it states; empty at first.
    pub qualities: Vec<Quality>,
    /// How positions follow from the plots of each radar; radars without an entry are in a flat
    /// plane.
    pub geometry: Vec<Geometry>,
    /// Flight plans.
    pub plans: Plans,
    /// How confirmed targets move.
    pub motion: Motion,
    /// How plots are assigned to tracks.
    pub association: Association,
    /// Squared normalised distance at the edge of the guard gate.
    pub guard: f64,
    /// Standard deviation of accelerations that may remain unnoticed, m/s², for scans of 4 s and of
    /// 10 s.
    pub guard_acceleration: [f64; 2],
    /// Rule by which a track is confirmed.
    pub confirmation: Confirmation,
    /// Scans without a plot after which a track ends.
    pub coasting: usize,
    /// Largest speed of a target, m/s.
    pub max_speed: f64,
    /// Distribution of the heights of targets that report none.
    pub heights: Heights,
    /// False plots per square metre and scan; nan if the density is to be estimated.
    pub clutter_density: f64,
    /// Probability that an identity is read wrongly.
    pub identity_error_probability: f64,
    /// Codes that signal an emergency, in addition to those that always do.
    pub emergency_codes: Vec<i64>,
    /// Probability that a planned turn is flown, before any turn was observed; 0 if plans have no
    /// influence.
    pub flown_probability: f64,
    /// Whether plans say where new targets are expected.
    pub initiation: bool,
    /// Wind: velocity of the air, east and north, m/s.
    pub wind: [f64; 2],
    /// Standard deviation of each component of the wind, m/s.
    pub wind_sigma: f64,
}

impl Settings {
    /// The usual settings, without flight plans.
    ///
    /// # Panics
    /// Never: the probability of the guard gate is valid.
    pub fn new(radars: Vec<Radar>, motion: Motion) -> Self {
        Self {
            radars,
            held: Vec::new(),
            delays: Vec::new(),
            unidentified: Vec::new(),
            qualities: Vec::new(),
            geometry: Vec::new(),
            plans: Plans::default(),
            motion,
            association: Association::default(),
            guard: gate::threshold(GUARD, 2).expect("a probability"),
            guard_acceleration: motion.guard_acceleration(),
            confirmation: Confirmation::Plots(3, 4),
            coasting: 5,
            max_speed: 350.0,
            heights: Heights::Air,
            clutter_density: f64::NAN,
            identity_error_probability: 1e-3,
            emergency_codes: Vec::new(),
            flown_probability: 0.8,
            initiation: false,
            wind: [0.0; 2],
            wind_sigma: 20.0,
        }
    }

    /// Whether targets may be larger than the resolution of a sensor.
    pub(super) fn has_extents(&self) -> bool {
        self.radars.iter().any(|radar| radar.extent > 0.0)
    }

    /// Whether a sensor reports positions, of targets or of itself.
    pub(super) fn has_reports(&self) -> bool {
        self.geometry.iter().any(|own| own.is_position() || own.is_azimuth())
    }

    /// How the reports of a sensor differ from what it states.
    #[inline]
    pub(super) fn quality(&self, sensor: usize) -> Quality {
        self.qualities.get(sensor).copied().unwrap_or_default()
    }

    /// How positions follow from the plots of a radar.
    #[inline]
    pub(super) fn geometry(&self, radar: usize) -> &Geometry {
        self.geometry.get(radar).unwrap_or(&Geometry::Flat)
    }

    /// Whether a plot of a sensor that an unlikely tentative track has taken may start another track.
    pub(super) fn starts_again(&self, sensor: usize) -> bool {
        !self.geometry(sensor).is_position() && !matches!(self.association, Association::Paper(_))
    }

    /// Scan period of a radar for the noise of the motion models, s. For sensors of positions it is
    /// at least 4 s: the noise is set for such scans, and targets do not fly straighter because
    /// their positions are reported more often.
    #[inline]
    pub(super) fn pace(&self, radar: usize) -> f64 {
        let period = self.radars[radar].scan_period;
        if self.geometry(radar).is_position() { period.max(GUARD_PERIODS[0]) } else { period }
    }

    /// Logarithm of the odds p / ((1 − p) 2π others) that a plot of this radar belongs to a given
    /// target rather than to the `others` per square metre, before the plot is compared with the
    /// prediction.
    pub(super) fn odds(&self, radar: usize, others: f64) -> f64 {
        let p = self.radars[radar].detection_probability;
        (p / ((1.0 - p) * others * std::f64::consts::TAU)).ln()
    }

    /// Probability that this radar makes no plot of a target in the gate of the target.
    #[inline]
    pub(super) fn missed(&self, radar: usize) -> f64 {
        1.0 - self.radars[radar].detection_probability * (1.0 - exp(-0.5 * self.guard))
    }

    /// Whether identities are addresses, which no two targets share, and not codes.
    pub(super) fn has_addresses(&self) -> bool {
        self.identity_error_probability <= ADDRESSES
    }

    /// Whether several targets may have the same identity of this kind, as is the case with codes.
    pub(super) fn is_shared(&self, kind: IdentityKind) -> bool {
        match kind {
            IdentityKind::Address | IdentityKind::Callsign => false,
            IdentityKind::Number => !self.has_addresses(),
            IdentityKind::Code => true,
        }
    }

    /// The identities in a plot without emergency codes, and the emergency code; negative if there
    /// is none.
    #[inline]
    pub(super) fn identities(&self, plot: &Measured) -> (Identities, i64) {
        let (mut own, mut emergency) = (plot.identities, -1);
        // true of most plots of most sensors
        if own.mode_3a < 0 && self.emergency_codes.is_empty() {
            return (own, emergency);
        }
        if self.emergency_codes.contains(&own.identity) {
            emergency = std::mem::replace(&mut own.identity, -1);
        }
        let code = i64::from(own.mode_3a);
        if EMERGENCIES.contains(&own.mode_3a) || self.emergency_codes.contains(&code) {
            (own.mode_3a, emergency) = (-1, code);
        }
        (own, emergency)
    }

    /// Standard deviation of accelerations that may remain unnoticed at this scan period, m/s².
    pub(super) fn unnoticed(&self, period: f64) -> f64 {
        let [short, long] = GUARD_PERIODS;
        let [first, last] = self.guard_acceleration;
        first + (last - first) * ((period - short) / (long - short)).clamp(0.0, 1.0)
    }

    /// Limits of the hypotheses; none if there is only one and each radar resolves all targets.
    pub(super) fn limits(&self) -> Option<Mht> {
        let merges = self.radars.iter().any(|radar| radar.resolution.is_some());
        match self.association {
            Association::Mht(limits) => Some(limits),
            _ => merges.then_some(Mht::SINGLE),
        }
    }

    /// Checks all settings except the radars and the plans.
    ///
    /// # Errors
    /// A number outside its domain.
    pub fn check_options(&self) -> Result<()> {
        self.motion.check()?;
        self.association.check()?;
        require_positive("max_speed", self.max_speed)?;
        require_positive("guard", self.guard)?;
        for a in self.guard_acceleration {
            require("guard_acceleration", a, a >= 0.0 && a.is_finite(), "0 or a positive number")?;
        }
        self.confirmation.check()?;
        require("coasting", self.coasting as f64, self.coasting > 0, "1 scan or more")?;
        let p = self.flown_probability;
        let holds = (0.0..1.0).contains(&p);
        require("flown_probability", p, holds, "0 or more and less than 1")?;
        let w = self.wind_sigma;
        require("wind_sigma", w, w >= 0.0 && w.is_finite(), "0 or a positive number")?;
        for v in self.wind {
            require("wind", v, v.is_finite(), "a finite number")?;
        }
        if !self.clutter_density.is_nan() {
            require_positive("clutter_density", self.clutter_density)?;
        }
        let p = self.identity_error_probability;
        require("identity_error_probability", p, p > 0.0 && p < 1.0, "between 0 and 1")
    }

    /// Checks all settings except the plans.
    ///
    /// # Errors
    /// A number outside its domain, or no radar.
    pub fn check(&self) -> Result<()> {
        require("sensors", 0.0, !self.radars.is_empty(), "at least one radar")?;
        self.radars.iter().try_for_each(Radar::check)?;
        self.check_options()
    }
}
