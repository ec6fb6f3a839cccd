//! The filter of a track, of the kind that its motion model requires.

pub(super) mod azimuth;
pub(super) mod follower;
pub(super) mod plan;
pub(super) mod prospects;
pub(super) mod resolution;
mod velocity;
mod window;

use super::motion::agility::Agility;
use super::motion::deviation::Swerve;
use super::motion::estimate::{Estimate, Moments, POSITION};
use super::motion::imm::{Bank, Component, PLAN, SPEED, TURN, changes};
use super::motion::kinematics;
use super::motion::speed_change::SpeedChange;
use super::motion::tight_turns::Circles;
use super::motion::{ImmModel, Motion};
use super::settings::Settings;
use crate::base::plane::Plane;
use crate::kalman::Singer;
use nalgebra::{SMatrix, SVector};
use plan::{Guide, fold_plan};
use prospects::Prospects;
use serde::{Deserialize, Serialize};
use window::Window;

/// If the density of a plot by all models is less than this, all models exclude it, and it does not change
/// their probabilities.
pub(super) const LEAST_DENSITY: f64 = 1e-300;
/// Standard deviation of the rate of a sharp turn, rad/s.
const SHARP_RATE: f64 = 0.1;

/// Models of straight flight, turns and changes of speed, and the flight plan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Multiple {
    pub bank: Bank,
    pub guide: Option<Guide>,
    /// The model of a change of speed; none while the target follows its plan.
    pub speed: Option<SpeedChange>,
    agility: Agility,
    /// Sharper turns; none while the plots fit the models.
    circles: Option<Box<Circles>>,
}

/// Probability that a target turns when its track begins, more than later, as many sensors stand where targets
/// turn; and the sigma of the rate of such a turn, which may have begun long ago, in those of turns that begin.
const FIRST_TURNING: f64 = 0.25;
const FIRST_RATES: f64 = 2.0;
/// Acceleration by which the velocity of a target in a sharp turn may be wrong, m/s².
const ACCELERATION: f64 = 5.0;
/// Largest turn in a scan period that a new track can follow, rad.
const LARGEST_TURN: f64 = 0.6;

/// State of a target, by the model of its motion.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) enum Filter {
    Straight(Estimate<4>),
    Singer(Box<Estimate<6>>),
    Multiple(Box<Multiple>),
    Window(Box<Window>),
    /// A track that is not confirmed and began where flights are due, or with a velocity.
    Planned(Box<Prospects>),
}

impl Filter {
    /// Creates a filter from an initial position and velocity.
    pub fn new(motion: &Motion, start: Estimate<4>) -> Self {
        match motion {
            Motion::Cv(_) => Self::Straight(start),
            Motion::Singer(model) => Self::Singer(Box::new(with_acceleration(&start, model))),
            Motion::Imm(noise) => {
                let turning = noise.turn_time / (noise.turn_time + noise.straight_time);
                Self::multiple(noise, Bank::new(start, turning, noise.turn_rate_sigma.powi(2)))
            }
            Motion::Window(_) => Self::Window(Box::new(Window::new(start))),
        }
    }

    /// The same for a target that has just appeared: it may have turned for long, unless it would then turn by
    /// more in a scan period than can be followed.
    pub fn appearing(motion: &Motion, start: Estimate<4>, period: f64) -> Self {
        match motion {
            Motion::Imm(noise) if FIRST_RATES * noise.turn_rate_sigma * period < LARGEST_TURN => {
                let rate_sigma = FIRST_RATES * noise.turn_rate_sigma;
                Self::multiple(noise, Bank::new(start, FIRST_TURNING, rate_sigma.powi(2)))
            }
            _ => Self::new(motion, start),
        }
    }

    fn multiple(noise: &ImmModel, bank: Bank) -> Self {
        let (guide, speed, circles) = (None, Some(SpeedChange::new(noise)), None);
        let agility = Agility::default();
        Self::Multiple(Box::new(Multiple { bank, guide, speed, agility, circles }))
    }

    /// Predicts over the time `t`; `period` is the scan period of the radar.
    pub fn predict(&mut self, settings: &Settings, motion: &Motion, t: f64, period: f64) {
        match (self, motion) {
            (Self::Straight(estimate), Motion::Cv(sigma)) => {
                kinematics::straight(estimate, t, sigma * sigma * period);
            }
            (Self::Singer(estimate), Motion::Singer(model)) => singer(estimate, model, t),
            (Self::Multiple(multiple), Motion::Imm(noise)) => {
                multiple.predict(settings, noise, t, period);
            }
            (Self::Window(window), Motion::Window(_)) => window.predict(settings, t, period),
            (Self::Planned(prospects), Motion::Cv(sigma)) => {
                prospects.predict([*sigma, settings.motion.largest_sigma()], t, period);
            }
            _ => unreachable!("a filter is made by its motion"),
        }
    }

    /// Calls `each` with the position that each model expects, and its probability.
    #[inline]
    pub fn components(&self, mut each: impl FnMut(Component)) {
        let one = |position, covariance| Component { probability: 1.0, position, covariance };
        match self {
            Self::Straight(e) => each(one(e.position(), e.position_covariance())),
            Self::Singer(e) => each(one(e.position(), e.position_covariance())),
            Self::Multiple(multiple) => {
                multiple.banks().for_each(|bank| bank.components(&mut each))
            }
            Self::Window(window) => {
                let e = window.estimate();
                each(one(e.position(), e.position_covariance()));
            }
            Self::Planned(prospects) => prospects.components(each),
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
            (Self::Multiple(multiple), Motion::Imm(noise)) => {
                multiple.correct::<POSITION>(noise, z, r);
            }
            (Self::Window(window), Motion::Window(model)) => window.correct(model, z, r),
            (Self::Planned(prospects), _) => prospects.correct(z, r),
            _ => unreachable!("a filter is made by its motion"),
        }
    }

    /// Learns from an innovation of covariance `s` how agile the target is; it has left a share of the variance of
    /// the position.
    #[inline]
    pub fn saw(&mut self, innovation: [f64; 2], s: Plane, left: f64) {
        if let Self::Multiple(multiple) = self {
            multiple.agility.saw(innovation, s);
            multiple.agility.left = left;
            multiple.begin_circles();
        }
    }

    /// Additional variances of position and velocity, along any axis, by manoeuvres that the models do not
    /// describe or that have not been noticed yet.
    pub fn unnoticed(&self) -> [f64; 2] {
        let Self::Multiple(multiple) = self else { return [0.0; 2] };
        let [position, velocity] = multiple.agility.unmodelled();
        [position, velocity + multiple.agility.unnoticed()]
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
            Self::Multiple(multiple) => multiple.estimate(),
            Self::Window(window) => window.estimate(),
            Self::Planned(prospects) => *prospects.unplanned(),
        }
    }

    /// Returns how far the sharpest of the models leads from straight flight, as a function of time; `period`
    /// is the scan period.
    #[inline]
    pub fn swerve(&self, motion: &Motion, period: f64) -> Swerve {
        let (Self::Multiple(multiple), Motion::Imm(usual)) = (self, motion) else {
            return Swerve::white(motion.largest_sigma(), period);
        };
        let model = multiple.agility.model(usual);
        let begins = (period / model.straight_time).min(1.0);
        Swerve::turning(&model, &multiple.bank.turn, begins, period)
    }

    /// Reads numbers from all parts of the filter, so that it is in the cache.
    #[inline(always)]
    pub fn touched(&self) -> f64 {
        let Self::Multiple(multiple) = self else { return 0.0 };
        let Bank { straight, turn, probability, .. } = &multiple.bank;
        straight.covariance[(0, 2)] + turn.mean[0] + turn.covariance[(4, 2)] + probability[0]
    }

    /// The flights that the target of a tentative track may be; none for other filters.
    pub fn prospects(&self) -> Option<&Prospects> {
        match self {
            Self::Planned(prospects) => Some(prospects),
            _ => None,
        }
    }

    /// Probability that the target turns.
    pub fn turn_probability(&self) -> f64 {
        match self {
            Self::Multiple(multiple) => multiple.turn_probability(),
            Self::Window(window) => f64::from(u8::from(window.turns())),
            Self::Straight(_) | Self::Singer(_) | Self::Planned(_) => 0.0,
        }
    }

    /// Probability that the speed of the target changes.
    pub fn speed_change_probability(&self) -> f64 {
        match self {
            Self::Multiple(multiple) => multiple.speed_change_probability(),
            _ => 0.0,
        }
    }

    /// The plan of the track, which the target follows or once followed.
    pub fn guide(&self) -> Option<&Guide> {
        match self {
            Self::Multiple(multiple) => multiple.guide.as_ref(),
            Self::Window(window) => window.guide.as_ref(),
            Self::Straight(_) | Self::Singer(_) | Self::Planned(_) => None,
        }
    }

    /// Sets the plan of the track, if the motion model can use plans, or removes it.
    pub fn set_guide(&mut self, guide: Option<Guide>) {
        match self {
            Self::Multiple(multiple) => {
                multiple.leave_plan();
                multiple.guide = guide;
            }
            Self::Window(window) => window.guide = guide,
            Self::Straight(_) | Self::Singer(_) | Self::Planned(_) => {}
        }
    }

    /// Changes to a plan that replaces the present one; `leg` is the leg of the new plan on which the target
    /// is.
    pub fn reroute(&mut self, leg: usize) {
        self.leave_plan();
        if let Some(guide) = self.guide_mut() {
            guide.reroute(leg);
        }
    }

    /// Suspends the plan of the track, or resumes it.
    pub fn suspend_plan(&mut self, suspended: bool) {
        if suspended {
            self.leave_plan();
        }
        match self.guide_mut() {
            Some(guide) if suspended => guide.suspend(),
            Some(guide) => guide.resume(),
            None => {}
        }
    }

    /// Merges the models of the plan into the others.
    fn leave_plan(&mut self) {
        match self {
            Self::Multiple(multiple) => multiple.leave_plan(),
            Self::Window(window) => window.leave_plan(),
            Self::Straight(_) | Self::Singer(_) | Self::Planned(_) => {}
        }
    }

    fn guide_mut(&mut self) -> Option<&mut Guide> {
        match self {
            Self::Multiple(multiple) => multiple.guide.as_mut(),
            Self::Window(window) => window.guide.as_mut(),
            Self::Straight(_) | Self::Singer(_) | Self::Planned(_) => None,
        }
    }

    /// Follows the track along its plan after a scan.
    pub fn follow(&mut self, settings: &Settings, time: f64, period: f64) {
        match self {
            Self::Multiple(multiple) => {
                let estimate = multiple.estimate();
                let Multiple { bank, guide, .. } = &mut **multiple;
                if let Some(guide) = guide {
                    guide.follow(bank, &estimate, settings, time, period);
                }
            }
            Self::Window(window) => window.follow(settings, time, period),
            Self::Straight(_) | Self::Singer(_) | Self::Planned(_) => {}
        }
    }

    /// Shifts position and velocity of all models.
    pub fn shift(&mut self, by: &SVector<f64, 4>) {
        match self {
            Self::Straight(estimate) => estimate.mean += by,
            Self::Singer(estimate) => {
                let mut part = estimate.mean.fixed_rows_mut::<4>(0);
                part += by;
            }
            Self::Multiple(multiple) => multiple.banks_mut().for_each(|bank| bank.shift(by)),
            Self::Window(window) => window.shift(by),
            Self::Planned(prospects) => prospects.each(|estimate| estimate.mean += by),
        }
    }

    /// Lets turns be as sharp as those of fighters.
    pub fn free_turns(&mut self) {
        if let Self::Multiple(multiple) = self {
            multiple
                .banks_mut()
                .for_each(|bank| bank.turn.covariance[(4, 4)] += SHARP_RATE.powi(2));
        }
    }

    /// Widens the covariance as if the target had, with this probability, accelerated unnoticed by `sigma`
    /// (m/s²) for `gap` seconds. If the probability is a half or more, a turn becomes at least as likely as
    /// all other models.
    pub fn widen(&mut self, sigma: f64, gap: f64, probability: f64) {
        let extra = kinematics::unnoticed(sigma, gap) * probability;
        match self {
            Self::Straight(estimate) => estimate.covariance += extra,
            Self::Singer(estimate) => {
                let mut block = estimate.covariance.fixed_view_mut::<4, 4>(0, 0);
                block += extra;
            }
            Self::Multiple(multiple) => multiple.banks_mut().for_each(|bank| {
                bank.widen(&extra);
                if probability >= 0.5 {
                    bank.expect_turn();
                }
            }),
            Self::Window(window) => window.widen(&extra),
            Self::Planned(prospects) => prospects.each(|estimate| estimate.covariance += extra),
        }
    }
}

impl Multiple {
    /// The bank of straight flight and free turns and, near a planned turn, the bank in which this turn is
    /// flown.
    pub(super) fn banks(&self) -> impl Iterator<Item = &Bank> {
        std::iter::once(&self.bank).chain(self.guide.as_ref().and_then(Guide::turning))
    }

    pub(super) fn banks_mut(&mut self) -> impl Iterator<Item = &mut Bank> {
        let second = self.guide.as_mut().and_then(Guide::turning_mut);
        std::iter::once(&mut self.bank).chain(second)
    }

    fn predict(&mut self, settings: &Settings, noise: &ImmModel, t: f64, period: f64) {
        let estimate = self.guide.is_some().then(|| self.estimate());
        let Self { bank, guide, speed, agility, circles } = self;
        let agile = agility.adapted(noise, t, period);
        if let Some(circles) = circles {
            circles.predict(noise, t, period);
        }
        if let (Some(guide), Some(estimate)) = (guide, estimate)
            && guide.takes_part(settings)
        {
            if speed.take().is_some() {
                fold_plan(bank);
            }
            return guide.predict(bank, &estimate, settings, noise, t, period);
        }
        let noise = &agile;
        let speed = speed.get_or_insert_with(|| {
            fold_plan(bank);
            SpeedChange::new(noise)
        });
        speed.predict(bank, noise, &changes(noise, t), (t, period));
    }

    /// Begins to follow sharper turns if the plots do not fit the models of a target without a plan.
    #[inline]
    fn begin_circles(&mut self) {
        if !self.agility.is_restless() {
            self.circles = None;
        } else if self.circles.is_none() && self.guide.is_none() {
            let interval = self.agility.interval();
            let circles = Circles::new(&self.estimate(), interval, ACCELERATION * interval);
            self.circles = Some(Box::new(circles));
        }
    }

    /// Merges the models of the plan into the others.
    fn leave_plan(&mut self) {
        if let Some(guide) = &mut self.guide {
            guide.leave(&mut self.bank, false);
        }
        if self.speed.is_none() {
            fold_plan(&mut self.bank);
        }
    }

    /// Corrects all models by a position or a velocity.
    #[inline]
    pub(super) fn correct<const AT: usize>(&mut self, noise: &ImmModel, z: [f64; 2], r: Plane) {
        let mut total = 0.0;
        let mut before = [[0.0; 3]; 2];
        if let Some(guide) = self.guide.as_mut().filter(|_| AT == POSITION) {
            guide.compare(&self.bank, z, r);
        }
        if let Some(speed) = &mut self.speed {
            speed.correct::<AT>(&self.bank, z, r);
        }
        for (bank, before) in self.banks_mut().zip(&mut before) {
            *before = bank.probability;
            bank.correct::<AT>(z, r);
            total += bank.total();
        }
        for (bank, before) in self.banks_mut().zip(before) {
            if total > LEAST_DENSITY {
                bank.scale(total.recip());
            } else {
                bank.probability = before;
            }
        }
        if let Some(circles) = &mut self.circles {
            circles.correct::<AT>(z, r, total.max(LEAST_DENSITY));
            if !circles.decide(&mut self.bank) {
                self.circles = None;
            }
        }
        if let Some(speed) = &mut self.speed {
            speed.decide(&mut self.bank, noise);
        }
    }

    fn estimate(&self) -> Estimate<4> {
        let Some(turning) = self.guide.as_ref().and_then(Guide::turning) else {
            let by_speed = self.speed.as_ref().map(|speed| speed.estimate(&self.bank));
            return by_speed.unwrap_or_else(|| self.bank.estimate());
        };
        let mut moments = Moments::about(self.bank.straight.mean);
        [&self.bank, turning].into_iter().for_each(|bank| bank.add_to(&mut moments));
        moments.estimate()
    }

    /// Probability of turns, planned ones included.
    fn turn_probability(&self) -> f64 {
        let mut free: f64 = self.banks().map(|bank| bank.probability[TURN]).sum();
        if self.bank.probability[SPEED] == 0.0 {
            free *= 1.0 - self.speed_change_probability();
        }
        let planned = self.guide.as_ref().and_then(Guide::turning);
        free + planned.map_or(0.0, |bank| bank.probability[PLAN])
    }

    /// Probability that the speed changes; 0 while the target follows the plan.
    fn speed_change_probability(&self) -> f64 {
        self.speed.as_ref().map_or(0.0, |speed| speed.probability(&self.bank))
    }
}

/// Adds an acceleration of zero, with its variance, to position and velocity.
fn with_acceleration(start: &Estimate<4>, model: &Singer) -> Estimate<6> {
    let mut mean = SVector::<f64, 6>::zeros();
    let mut covariance = SMatrix::<f64, 6, 6>::zeros();
    mean.fixed_rows_mut::<4>(0).copy_from(&start.mean);
    covariance.fixed_view_mut::<4, 4>(0, 0).copy_from(&start.covariance);
    covariance[(4, 4)] = model.acceleration_variance();
    covariance[(5, 5)] = model.acceleration_variance();
    Estimate { mean, covariance }
}

/// Predicts one step of Singer's model, east and north; the states are positions, velocities and
/// accelerations.
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
    let predicted = f * estimate.covariance * f.transpose() + q;
    estimate.covariance = 0.5 * (predicted + predicted.transpose());
}
