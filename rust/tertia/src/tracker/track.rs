//! One track: its filter, its stage, its identities and its plan.

pub(super) mod correlation;
mod existence;
mod expected_times;
pub(super) mod reflections;
mod rivals;
mod suspicion;
pub(super) mod tree;

use super::clutter::Clutter;
use super::errors::delay::Delay;
use super::filter::Filter;
use super::filter::plan::Guide;
use super::filter::prospects::{Prospects, There};
use super::motion::Motion;
use super::motion::deviation::Swerve;
use super::motion::estimate::Estimate;
use super::motion::height_effect::Lean;
use super::noise::lasting::Common;
use super::noise::outliers::Stray;
use super::plot::{Measured, Source};
use super::replies::height::Vertical;
use super::replies::identity::Known;
use super::settings::association::{Association, paper_score};
use super::settings::{Confirmation, Settings};
use crate::base::exponential::exp;
use crate::base::plane::Plane;
use crate::flightplan::{Plan, Sighting, Status};
use crate::sensors::Identities;
use correlation::Correlation;
use existence::Existence;
use expected_times::{Beams, Expected};
use nalgebra::{SMatrix, SVector};
use rivals::Rivals;
use serde::{Deserialize, Serialize};
use suspicion::Suspicion;
use tree::Tree;

mod agile;
mod azimuth;
mod basis;
mod delay;
pub(super) mod fork;
mod hard_turn;
mod height;
mod life;
mod merged;
mod missed_detections;
mod reflected;
mod states;
#[cfg(test)]
mod tests;
mod unseen;
mod velocity;

use basis::Basis;

/// Motion of tentative tracks: an acceleration of 1 m/s².
static FIRST_MOTION: Motion = Motion::Cv(1.0);
/// Number of successive emergency codes after which the plan is suspended.
const EMERGENCY_AFTER: u8 = 2;
/// Shortest time between plots of the same radar, as a share of a scan.
pub(super) const SOONEST: f64 = 0.45;
/// Mean number of scans in which at most one false track is confirmed.
const SCANS_PER_FALSE_TRACK: f64 = 1000.0;
/// Whether a track is confirmed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) enum Stage {
    /// `evidence` is the log-likelihood ratio of a target against false plots, less the required one.
    Tentative {
        hits: usize,
        misses: usize,
        /// Number of plots required for confirmation.
        plots: usize,
        evidence: f64,
        /// Odds of a target below which the track is given up.
        least: f64,
    },
    Confirmed,
}

/// One track. The fields that every scan reads come first, so that they lie in one or two cache lines.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[repr(C)]
pub(super) struct Track {
    pub stage: Stage,
    /// Time before which no radar can have missed the target, s.
    due: f64,
    pub existence: Existence,
    /// Time of the estimate, s.
    pub time: f64,
    /// Time of the last plot, s.
    pub seen: f64,
    /// Scan period of the slowest radar that sees the target, s.
    pub period: f64,
    /// Scan period of the quickest sensor that sees the target, s.
    quickest: f64,
    swerve: Swerve,
    /// Whether the target has moved or has replied, or fixed echoes are not searched for.
    pub moved: bool,
    pub number: u64,
    /// The states of the track under other hypotheses.
    pub tree: Option<Box<Tree<Self>>>,
    /// The alternative state between which and the shown one the next plot decides.
    fork: Option<Box<Fork>>,
    /// Position and velocity according to the filter.
    pub estimate: Estimate<4>,
    pub filter: Filter,
    /// The first plot.
    pub first: Measured,
    /// Innovation of the last plot, and its covariance.
    pub innovation: ([f64; 2], Plane),
    /// Whether the last plot belongs to another track as well.
    pub merged: bool,
    beams: Beams,
    pub vertical: Option<Vertical>,
    /// Dependence of the estimate on the height, if plots without a height were used.
    lean: Option<Box<Lean>>,
    /// Delays of the reports of its target, by sensor.
    delays: Vec<Delay>,
    /// Variance of the error that the times of the last reports have in common, s².
    lasting: f64,
    /// Errors that the positions of the last reports have in common.
    common: Common,
    known: Known,
    pub(super) correlation: Correlation,
    /// Whether its plan is suspended.
    suspended: bool,
    /// Number of successive emergency codes, and the last one of mode 3/A; negative if there was none.
    emergencies: u8,
    emergency: i16,
    /// Plot since the last one of the track that is far from the track but may be of its target.
    pub stray: Option<Stray>,
    /// What flight plans say about the place of its first plot.
    pub there: There,
    /// Density of false plots at its first plot, as it was estimated at that time, 1/m².
    pub believed: f64,
    /// Whether its first plot is neither a second plot of a target, nor a reflection, nor a fixed echo.
    pub is_counted: bool,
    /// Whether another track had taken its first plot before.
    is_shared: bool,
    /// Its plots, until it is confirmed.
    basis: Basis,
    suspicion: Option<Box<Suspicion>>,
    /// Tracks of which it may be a reflection, where that is not known at its first plot.
    rivals: Option<Box<Rivals>>,
    /// Covariance of plots about the centre of a target that is larger than the resolution of a sensor, m².
    pub extent: Plane,
}

/// The other explanation of a plot far from the track: an acceleration instead of an outlier, or the reverse.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Fork {
    pub state: Track,
    /// Logarithm of the odds of this state against the shown one; bounded, as a few plots outweigh any odds.
    log_odds: f64,
    /// Whether the far plot is an outlier if this state is the right one, and the radar of that plot.
    is_outlier: bool,
    radar: usize,
}

impl Track {
    /// Begins a track with one plot, of any velocity up to about `max_speed`. To be confirmed, the track must
    /// be likelier than the chains of false plots that `false_plots` per scan would form.
    pub fn new(number: u64, plot: &Measured, false_plots: f64, settings: &Settings) -> Self {
        let (r, vertical, lean) = Self::first(plot, settings);
        let v = (0.5 * settings.max_speed).powi(2);
        let [x, y] = plot.position;
        let covariance = SMatrix::from([
            [r.xx, r.xy, 0.0, 0.0],
            [r.xy, r.yy, 0.0, 0.0],
            [0.0, 0.0, v, 0.0],
            [0.0, 0.0, 0.0, v],
        ]);
        let estimate = Estimate { mean: SVector::from([x, y, 0.0, 0.0]), covariance };
        let existence = Existence::of_first(false_plots);
        let mut track = Self {
            number,
            stage: Stage::Tentative {
                hits: 0,
                misses: 0,
                plots: settings.confirmation.plots(),
                evidence: -(SCANS_PER_FALSE_TRACK * false_plots.max(1.0)).ln(),
                least: existence.hopeless(),
            },
            existence,
            time: plot.time,
            seen: plot.time,
            first: *plot,
            filter: Filter::Straight(estimate),
            estimate,
            innovation: ([0.0; 2], r),
            merged: false,
            beams: Beams::default(),
            due: f64::NEG_INFINITY,
            period: 0.0,
            quickest: f64::INFINITY,
            swerve: Swerve::default(),
            moved: !plot.is_bare() || !Clutter::knows_fixed(settings, plot.radar),
            vertical,
            lean,
            delays: Vec::new(),
            lasting: 0.0,
            common: Common::default(),
            known: Known::new(),
            correlation: Correlation::default(),
            suspended: false,
            emergencies: 0,
            emergency: -1,
            tree: None,
            fork: None,
            stray: None,
            there: There::default(),
            believed: f64::INFINITY,
            is_counted: false,
            is_shared: false,
            basis: Basis::default(),
            suspicion: None,
            rivals: None,
            extent: Plane::default(),
        };
        if matches!(plot.source, Source::Moving(..)) {
            track.begin(None, settings);
        }
        track.take(plot, settings);
        track.set_swerve(settings);
        track
    }

    #[inline]
    pub fn is_confirmed(&self) -> bool {
        matches!(self.stage, Stage::Confirmed)
    }

    /// The identities in the replies of the transponder.
    pub fn identities(&self) -> Identities {
        self.known.identities()
    }

    fn motion<'a>(&self, settings: &'a Settings) -> &'a Motion {
        let is_first = matches!(self.filter, Filter::Straight(_) | Filter::Planned(_));
        if is_first && !self.is_confirmed() { &FIRST_MOTION } else { &settings.motion }
    }

    /// Returns the position and its covariance at a time close to that of the estimate.
    #[inline]
    pub fn position_at(&self, time: f64) -> ([f64; 2], Plane) {
        let t = time - self.time;
        let (x, p) = (&self.estimate.mean, &self.estimate.covariance);
        let variance = |i: usize| p[(i, i)] + t * (2.0 * p[(i, i + 2)] + t * p[(i + 2, i + 2)]);
        let covariance = Plane { xx: variance(0), xy: 0.0, yy: variance(1) };
        ([x[0] + t * x[2], x[1] + t * x[3]], covariance)
    }

    /// Predicts the track to a time.
    pub fn predict(&mut self, time: f64, period: f64, settings: &Settings) {
        if time > self.time {
            let motion = self.motion(settings);
            self.filter.predict(settings, motion, time - self.time, period);
            self.existence.wait(time - self.time, period);
            if let Some(lean) = &mut self.lean {
                lean.predict(time - self.time);
            }
            self.delays.iter_mut().for_each(|own| own.predict(time - self.time));
            self.time = time;
            self.estimate = self.filter.estimate();
            if let Some(fork) = &mut self.fork {
                fork.state.predict(time, period, settings);
            }
        }
    }

    /// Log-likelihood ratio of the plot: this target against any other source, with the `odds` of the plot's
    /// radar; none outside the gate.
    #[inline]
    pub fn score(&self, plot: &Measured, odds: f64, settings: &Settings) -> Option<f64> {
        let here = self.brought_here(plot, settings);
        if let Association::Paper(q) = settings.association {
            let (z, r) = (here.position, here.covariance());
            let score = paper_score(&self.estimate, z, r, q, settings.guard)?;
            return Some(score + self.also_moving(plot, settings).ln());
        }
        let (z, r) = (here.position, here.covariance());
        let is_near = self.nearest(z, r) <= settings.guard;
        is_near.then(|| odds + (self.density(z, r) * self.also_moving(plot, settings)).ln())
    }

    /// Returns what a plot adds to the evidence: the `gain` with which it was taken. The score of the paper is
    /// replaced by the log-likelihood ratio against a density of `others` per square metre.
    #[inline]
    pub fn evidence_of(&self, plot: &Measured, gain: f64, others: f64, settings: &Settings) -> f64 {
        if !matches!(settings.association, Association::Paper(_)) {
            return gain;
        }
        let here = self.brought_here(plot, settings);
        let density = self.density(here.position, here.covariance());
        settings.odds(plot.radar, others) + (density * self.also_moving(plot, settings)).ln()
    }

    /// 2π times the probability density of a plot of this target.
    #[inline]
    fn density(&self, z: [f64; 2], r: Plane) -> f64 {
        let mut density = 0.0;
        self.filter.components(|component| {
            let (d, s) = component.distance(z, r);
            density += component.probability * exp(-0.5 * d) / s.determinant().sqrt();
        });
        density
    }

    /// Smallest squared normalised distance of a plot from the models of the filter.
    #[inline]
    fn nearest(&self, z: [f64; 2], r: Plane) -> f64 {
        let mut nearest = f64::INFINITY;
        self.filter.components(|component| nearest = nearest.min(component.distance(z, r).0));
        nearest
    }

    /// Adds the score of a plot against a missed detection to the evidence, less `others`: the logarithm of
    /// the factor by which second plots and outliers of targets increase the density of false plots.
    pub fn credit(&mut self, gain: f64, others: f64, radar: usize, settings: &Settings) {
        self.existence.see(gain - others, radar, settings);
        if let Stage::Tentative { evidence, .. } = &mut self.stage {
            // here the ratio is that against a false plot
            *evidence += gain + (1.0 - settings.radars[radar].detection_probability).ln() - others;
        }
    }

    /// Corrects by a plot, without regard to what the plot says about the agility of the target.
    fn correct_by(&mut self, plot: &Measured, settings: &Settings) {
        self.predict(plot.time, settings.pace(plot.radar), settings);
        if self.lean.is_some() {
            self.take_height(plot);
        }
        let mut here = self.brought_here(plot, settings);
        let [east, north] = here.position;
        let y = [east - self.estimate.mean[0], north - self.estimate.mean[1]];
        self.innovation = (y, self.estimate.position_covariance().plus(here.covariance()));
        if self.infer_height(plot, &here, y) {
            here = self.brought_here(plot, settings);
        }
        if !settings.delays.is_empty() && self.learn_delays(plot, settings) {
            here = self.brought_here(plot, settings);
        }
        let motion = self.motion(settings);
        self.filter.correct(motion, here.position, here.noise);
        self.merged = false;
        self.estimate = self.filter.estimate();
        self.common.moved(plot, [here.noise, self.innovation.1], settings);
        self.lean_by(plot, &here);
        self.lean_by_delays(plot, &here);
        if let Source::Moving(_, seen) = plot.source {
            self.take_velocity(plot, seen, settings);
        }
        self.seen = self.seen.max(plot.time);
        self.take(plot, settings);
        self.follow(settings.radars[plot.radar].scan_period, settings);
    }

    /// Follows the plan, or searches for one.
    fn follow(&mut self, period: f64, settings: &Settings) {
        if settings.plans.is_empty() || !self.is_confirmed() {
            return;
        }
        if self.filter.guide().is_some() {
            self.filter.follow(settings, self.time, period);
            self.estimate = self.filter.estimate();
        }
        let (seen, own) = (self.sighting(), self.identities());
        match self.filter.guide() {
            Some(guide) => {
                if !self.correlation.holds(guide, settings, &seen, &own) {
                    self.decorrelate(None);
                }
            }
            None => {
                if let Some(plan) = self.correlation.search(settings, &seen, &own) {
                    self.correlate(plan, settings, false);
                }
            }
        }
    }

    /// Assigns a plan to the track, by hand or because the target flies the plan.
    pub fn correlate(&mut self, plan: usize, settings: &Settings, by_hand: bool) {
        let leg = settings.plans[plan].route.project(self.estimate.position()).leg;
        self.fork = None;
        self.filter.set_guide(Some(Guide::new(plan, leg, settings.flown_probability)));
        self.filter.suspend_plan(self.suspended);
        if by_hand {
            // the previous plan may have influenced the estimate
            self.estimate = self.filter.estimate();
        }
        self.correlation.begin(self.identities(), by_hand);
    }

    /// Removes the plan of the track, or the results of the search for one. A plan that was `taken` from the
    /// track by hand is not found again.
    pub fn decorrelate(&mut self, taken: Option<usize>) {
        self.filter.set_guide(None);
        self.estimate = self.filter.estimate();
        self.correlation.end(taken);
    }

    /// The number of its plan.
    pub fn plan(&self) -> Option<usize> {
        self.filter.guide().map(|guide| guide.plan)
    }

    /// How the plan was assigned to the track, or why the track has none.
    pub fn plan_status(&self) -> Status {
        self.correlation.status()
    }

    /// Replaces the plan of this number by a new one, if the track has it; removes it if there is no new one.
    pub fn change_plan(&mut self, number: usize, old: &Plan, new: Option<&Plan>) {
        if self.plan() != Some(number) {
            return self.correlation.restart(number);
        }
        match new.filter(|new| self.correlation.accepts(new, &self.identities())) {
            None => self.decorrelate(None),
            Some(new) if new.has_path_of(old) => {}
            Some(new) => {
                self.filter.reroute(new.route.project(self.estimate.position()).leg);
                self.estimate = self.filter.estimate();
            }
        }
    }

    /// The track in the form in which it is compared with plans.
    fn sighting(&self) -> Sighting {
        let (x, p) = (&self.estimate.mean, &self.estimate.covariance);
        let covariance: [f64; 16] = std::array::from_fn(|k| p[(k / 4, k % 4)]);
        let height = self.height();
        Sighting::new(self.time, [x[0], x[1]], [x[2], x[3]], Some(&covariance), height)
    }

    /// Takes over the height and the identities of a plot; updates the stage, and when the radar should see
    /// the target next.
    fn take(&mut self, plot: &Measured, settings: &Settings) {
        if self.lean.is_none() {
            self.take_height(plot);
        }
        let (reply, emergency) = settings.identities(plot);
        if emergency >= 0 {
            self.emergencies = self.emergencies.saturating_add(1);
            self.emergency = plot.identities.mode_3a;
            if self.emergencies == EMERGENCY_AFTER {
                self.suspend_plan(true);
            }
        } else if reply.mode_3a >= 0 || reply.identity >= 0 {
            self.emergencies = 0;
        }
        self.known.answer(&reply);
        self.lasting += 0.5 * (settings.quality(plot.radar).lasting - self.lasting);
        let period = settings.radars[plot.radar].scan_period;
        let next = plot.time + period;
        self.period = self.period.max(period);
        self.quickest = self.quickest.min(period);
        // several reports within one interval count as one: otherwise copies of a false plot would
        // confirm a track
        let counts = self.is_due(plot, &settings.radars[plot.radar]);
        self.allow_turns(settings);
        match self.beams.all_mut().iter_mut().find(|expected| expected.radar == plot.radar) {
            Some(expected) => {
                expected.time = next;
                if counts {
                    expected.seen = plot.time;
                }
            }
            None => self.beams.push(Expected { radar: plot.radar, time: next, seen: plot.time }),
        }
        self.set_due(settings);
        let allowance = self.filter.prospects().and_then(Prospects::allowance);
        let speed = self.speed_probability(settings);
        let is_reflection = self.is_reflection();
        if let Stage::Tentative { hits, plots, evidence, .. } = &mut self.stage {
            *hits += usize::from(counts);
            // only at the second plot
            let less = if *hits == 2 { allowance.unwrap_or(0.0) } else { 0.0 };
            let is_likely = match settings.confirmation {
                _ if matches!(settings.association, Association::Paper(_)) => true,
                Confirmation::Plots(..) => *evidence + speed.ln() >= -less,
                Confirmation::Existence(least) => self.existence.probability() * speed >= least,
            };
            let held = |e: &Expected| settings.held.get(e.radar) == Some(&true);
            let enough = *hits + usize::from(allowance.is_some()) >= *plots;
            if enough && is_likely && !is_reflection && !self.beams.all().iter().any(held) {
                self.confirm(settings);
            }
        }
    }
}
