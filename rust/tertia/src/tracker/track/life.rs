//! Confirmation and end of a track, plots that it refuses, and continuation of an older track of the same
//! target.

use super::super::filter::Filter;
use super::super::filter::prospects::Expected;
use super::super::motion::estimate::VELOCITY;
use super::super::plot::Measured;
use super::super::settings::{Confirmation, Settings};
use super::super::track::correlation::contradicts;
use super::{EMERGENCY_AFTER, Stage, Track};
use crate::base::distribution::normal_two_sided;
use crate::base::plane::Plane;
use crate::flightplan::Status;
use crate::sensors::Identities;
use crate::tracker::motion::Motion;
use crate::tracker::track::tree::Leaf;

/// Odds of a target below which a confirmed track ends, and the scans without a plot after which a track that
/// was confirmed by its existence may end: several missed detections in succession may have one cause.
const LEAST_ODDS: f64 = 0.01 / 0.99;
const SCANS_BEFORE: f64 = 2.5;
/// Largest ratio of the scan periods of two sensors by which it is judged whether a target is lost.
const SLOWER: f64 = 5.0;
/// Standard deviation of a velocity that is known well enough for a turn, as a share of the largest speed.
const KNOWN: f64 = 0.25;
/// Factor by which a track may seem faster than the fastest target, as its models are not exact.
const TOO_FAST: f64 = 1.25;

impl Track {
    /// Begins the track with the flights that are due at its first plot.
    pub fn expect(&mut self, expected: Expected, settings: &Settings) {
        self.there = expected.there;
        if let Stage::Tentative { evidence, least, .. } = &mut self.stage {
            *evidence += expected.ratio.ln();
            *least *= expected.ratio;
        }
        self.existence.favour(expected.ratio);
        self.begin(Some(expected), settings);
    }

    /// Requires one more plot for confirmation: one of the plots may be far from the target.
    pub fn require_more(&mut self) {
        if let Stage::Tentative { plots, .. } = &mut self.stage {
            *plots += 1;
        }
    }

    /// Lets the target of a tentative track turn as soon as its velocity is known.
    pub(super) fn allow_turns(&mut self, settings: &Settings) {
        let Plane { xx, yy, .. } = self.estimate.velocity_covariance();
        let is_known = 0.5 * (xx + yy) < (KNOWN * settings.max_speed).powi(2);
        if is_known
            && matches!((&self.filter, &settings.motion), (Filter::Straight(_), Motion::Imm(_)))
        {
            self.filter = Filter::appearing(&settings.motion, self.estimate, self.pace(settings));
        }
    }

    /// Confirms the track, with the plan of the flight that its target turned out to be, if any.
    pub(super) fn confirm(&mut self, settings: &Settings) {
        self.stage = Stage::Confirmed;
        self.stand_alone();
        let flight = self.filter.prospects().map(|prospects| {
            let (estimate, plan) = prospects.decide();
            self.estimate = estimate;
            plan
        });
        if !matches!(self.filter, Filter::Multiple(_)) {
            self.filter = Filter::appearing(&settings.motion, self.estimate, self.pace(settings));
        }
        let own = self.identities();
        let is_possible = |plan: &usize| {
            settings.plans.available(*plan).is_some_and(|plan| !contradicts(plan, &own))
        };
        if let Some(plan) = flight.flatten().filter(is_possible) {
            self.correlation.accept();
            self.correlate(plan, settings, false);
        }
    }

    /// Whether the track continues: it had enough plots at the beginning, has not been without a plot for too
    /// long, and was not found to be a reflection or to consist of false plots.
    pub fn is_alive(&self, settings: &Settings) -> bool {
        let silence = self.time - self.seen;
        let gone = match (settings.confirmation, self.stage) {
            (Confirmation::Plots(m, n), Stage::Tentative { misses, .. }) => misses > n - m,
            // a track that has moved ends only for lack of plots
            (Confirmation::Plots(..), Stage::Confirmed) => {
                !self.moved && self.existence.is_below(LEAST_ODDS)
            }
            (Confirmation::Existence(_), Stage::Tentative { least, .. }) => {
                self.existence.is_below(least)
            }
            (Confirmation::Existence(_), Stage::Confirmed) => {
                silence > SCANS_BEFORE * self.period && self.existence.is_below(LEAST_ODDS)
            }
        };
        let refuted = self.is_confirmed()
            && self.may_be_clutter()
            && self.existence.is_refuted(self.speed_probability(settings));
        !gone
            && !refuted
            && !self.is_refuted()
            && silence <= (settings.coasting as f64 + 0.5) * self.period
    }

    /// Probability that the track consists of false plots; 0 for confirmed tracks.
    pub fn false_probability(&self) -> f64 {
        if self.is_confirmed() { 0.0 } else { 1.0 - self.existence.probability() }
    }

    /// Notes that another tentative track has taken the first plot before; `probability` is the probability
    /// that the other track consists of false plots.
    pub fn share_first(&mut self, probability: f64) {
        self.is_shared = true;
        self.existence.favour(probability);
        if let Stage::Tentative { evidence, .. } = &mut self.stage {
            *evidence += probability.ln();
        }
    }

    /// Whether the track may consist of false plots only: no transponder has replied.
    fn may_be_clutter(&self) -> bool {
        !self.identities().is_some()
    }

    /// Probability that the speed of the track does not exceed the largest speed of a target; 1 while the
    /// last plot may be an outlier, and for targets that reply.
    pub(super) fn speed_probability(&self, settings: &Settings) -> f64 {
        let [x, y] = [self.estimate.mean[VELOCITY], self.estimate.mean[VELOCITY + 1]];
        let (speed, most) = (f64::hypot(x, y), TOO_FAST * settings.max_speed);
        if speed <= most || self.fork.is_some() || !self.may_be_clutter() {
            return 1.0;
        }
        let sigma = self.estimate.velocity_covariance().form([x / speed, y / speed]).sqrt();
        0.5 * normal_two_sided((speed - most) / sigma)
    }

    /// Probability that the track belongs to a target, averaged over all its states.
    pub fn existence_probability(&self) -> f64 {
        let own = self.existence.probability();
        let Some(tree) = self.tree.as_deref() else { return own };
        let other = |leaf: &Leaf<Self>| leaf.probability * leaf.track.existence.probability();
        tree.probability * own + tree.others.iter().map(other).sum::<f64>()
    }

    /// Whether the track may refuse plots because of the identities that are known of its target.
    #[inline]
    pub fn may_refuse(&self, settings: &Settings) -> bool {
        self.known.may_refuse(settings)
    }

    /// Whether the plot has another address than the target.
    #[inline]
    pub fn refuses(&self, plot: &Measured, settings: &Settings) -> bool {
        let may_refuse = plot.identities.icao_address >= 0 || settings.has_addresses();
        may_refuse && self.known.refuses(&settings.identities(plot).0, settings)
    }

    /// Scan period of the slowest sensor that sees the target, s; that of a sensor that reports much more rarely
    /// than another one, as vessels at anchor do, does not tell how long a target may be lost.
    pub fn period(&self) -> f64 {
        self.period.min(SLOWER * self.quickest)
    }

    /// Identities of the target for its rows; an emergency code takes the place of its own code.
    pub fn shown_identities(&self) -> Identities {
        let own = self.identities();
        let is_emergency = self.emergencies >= EMERGENCY_AFTER && self.emergency >= 0;
        Identities { mode_3a: if is_emergency { self.emergency } else { own.mode_3a }, ..own }
    }

    /// Suspends or resumes the plan of the track.
    pub fn suspend_plan(&mut self, suspended: bool) {
        self.suspended = suspended;
        self.filter.suspend_plan(suspended);
        for leaf in self.alternatives_mut() {
            leaf.track.suspend_plan(suspended);
        }
    }

    /// Whether the plan of the track is suspended.
    pub fn is_suspended(&self) -> bool {
        self.suspended
    }

    /// Reads numbers in all parts of the track, so that it is loaded into the cache.
    #[inline(always)]
    pub fn touched(&self) -> f64 {
        let seen = self.beams.all().first().map_or(0.0, |expected| expected.time);
        let vertical = self.vertical.map_or(0.0, |vertical| vertical.height);
        let lean = self.lean.as_ref().map_or(0.0, |lean| lean.position(0.0)[0]);
        let innovation = self.innovation.0[0];
        self.estimate.covariance[(3, 3)]
            + self.filter.touched()
            + seen
            + vertical
            + lean
            + innovation
    }

    /// Ends the track; returns its state, from which another track continues.
    pub fn retire(&mut self) -> Self {
        let past = self.clone();
        (self.number, self.seen) = (0, f64::NEG_INFINITY);
        past
    }

    /// Takes over the number, the identities and the plan of an older track of the same target.
    pub fn go_on(&mut self, past: &Self, settings: &Settings) {
        (self.number, self.first.index) = (past.number, past.first.index);
        self.known = self.known.or(&past.known);
        self.suspended |= past.suspended;
        self.moved |= past.moved;
        let is_open = |plan: &usize| settings.plans.is_open_to(*plan, past.number);
        if let Some(plan) = past.plan().filter(is_open) {
            self.correlate(plan, settings, past.plan_status() == Status::Manual);
        }
    }
}
