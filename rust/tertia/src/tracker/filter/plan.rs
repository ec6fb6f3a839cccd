//! A flight plan as one more hypothesis of a track's motion: it is believed as far as the plots
//! confirm it, and blocked where they do not (Glagovskiy, Lavina, Rudelson 2014, completed).
//!
//! Near a turn of the plan there are two banks of models: in one the turn is flown, in the other it
//! is not. Their probabilities follow from the plots alone. On straight legs there is a model that
//! keeps to the leg.

use crate::base::plane::Plane;
use crate::flightplan::{
    Monitor, Plan, Sighting, SpeedHistory, Turn, Verdict, capture_in_wind, hazard, lead_in_wind,
    lead_ratio,
};
use crate::tracker::motion::ImmModel;
use crate::tracker::motion::estimate::Estimate;
use crate::tracker::motion::imm::{
    Bank, PLAN, STRAIGHT, TURN, changes, entered, limited, without_rate,
};
use crate::tracker::motion::kinematics;
use crate::tracker::settings::Settings;
use nalgebra::{Matrix2, SMatrix, Vector2};
use serde::{Deserialize, Serialize};

/// Weight of the prior probability that turns are flown, in turns.
const BEFOREHAND: f64 = 2.5;
/// Largest counts of turns flown and not flown.
const REMEMBERED: [f64; 2] = [9.0, 4.0];
/// Probability of a planned turn below which the plan is blocked.
const LEAST: f64 = 0.05;
/// Median distance to the waypoint, in leads, at which a turn begins: aircraft roll in first, and bank
/// less than plans say.
const START_MEDIAN: f64 = 1.05;
/// Remaining angle below which a turn is no longer begun, rad.
const LITTLE: f64 = 4.0 * std::f64::consts::PI / 180.0;
/// Factor for turns at another rate while a planned turn is ahead.
const OTHER_TURNS: f64 = 0.3;
/// Probability of a transition from a turn at any rate to the planned turn, and back.
const TO_PLAN: f64 = 0.1;
const FROM_PLAN: f64 = 0.003;
/// Probability that a planned turn ends: before its end is due, and when it is due.
const ENDS_EARLY: f64 = 0.02;
const ENDS: f64 = 0.7;
/// Probability per scan of a transition from straight flight to keeping to the leg, and back.
const TO_LEG: f64 = 0.08;
const FROM_LEG: f64 = 0.02;
/// Standard deviation of the cross-track velocity on a leg, m/s, and its correlation time, s.
const ACROSS: f64 = 1.5;
const ACROSS_TIME: f64 = 40.0;
/// Acceleration along and across a planned turn in addition to that of wind and bank, m/s².
const ROUGHNESS: f64 = 0.3;
/// Relative uncertainty of the turn rate.
const RATE_SHARE: f64 = 0.15;
/// A change of speed appears in the along-track errors of plots: weight of a plot in their normalised
/// mean, the mean that is due to chance, the standard deviation of the acceleration per excess of the
/// mean, m/s², and its limit.
const LAG_SHARE: f64 = 0.2;
const LAG_BY_CHANCE: f64 = 0.4;
const LAG_ACCELERATION: f64 = 2.0;
const LAG_ACCELERATION_MAX: f64 = 2.0;
/// Limit of a plot's normalised error.
const LAG_LARGEST: f64 = 4.0;
/// Length of the legs of a turn where only their directions matter, m.
const LONG: f64 = 1e7;

/// The plan of a track, and its credibility.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Guide {
    /// Index of the plan.
    pub plan: usize,
    pub monitor: Monitor,
    pub conforms: bool,
    history: SpeedHistory,
    /// Turns flown, and turns not flown.
    turns: [f64; 2],
    in_zone: bool,
    /// The bank of models in which the turn is flown, while the track is in the zone of the turn.
    turning: Option<Box<Bank>>,
    /// Distance to the waypoint at the previous scan, in leads.
    ratio: f64,
    /// Mean of the normalised along-track errors of plots.
    lag: f64,
}

impl Guide {
    /// The guide of a track on a leg of a plan; `prior` is the probability that its turns are flown.
    pub fn new(plan: usize, leg: usize, prior: f64) -> Self {
        Self {
            plan,
            monitor: Monitor::new(leg),
            conforms: true,
            history: SpeedHistory::default(),
            turns: [BEFOREHAND * prior, BEFOREHAND * (1.0 - prior)],
            in_zone: false,
            turning: None,
            ratio: f64::INFINITY,
            lag: 0.0,
        }
    }

    /// Probability that the turn of the plan is flown; none outside its zone.
    pub fn turn_probability(&self) -> Option<f64> {
        self.turning.as_ref().map(|bank| bank.total())
    }

    pub fn turning(&self) -> Option<&Bank> {
        self.turning.as_deref()
    }

    pub fn turning_mut(&mut self) -> Option<&mut Bank> {
        self.turning.as_deref_mut()
    }

    /// Ground speed.
    pub fn speed(&self, estimate: &Estimate<4>) -> f64 {
        let (speed, _) = self.history.speed();
        if speed.is_finite() { speed } else { estimate.mean[2].hypot(estimate.mean[3]) }
    }

    /// Whether the plan takes part in the prediction of the motion.
    pub fn takes_part(&self, settings: &Settings) -> bool {
        self.is_believed(settings) || self.turning.is_some()
    }

    /// Whether the plan is believed: the track conforms to it, and plans have influence.
    fn is_believed(&self, settings: &Settings) -> bool {
        self.conforms && settings.flown_probability > 0.0
    }

    /// Compares a plot with the prediction, in order to detect changes of speed.
    pub fn compare(&mut self, bank: &Bank, z: [f64; 2], r: Plane) {
        let bank = self.turning.as_deref().unwrap_or(bank);
        let is_planned = bank.probability[PLAN] > bank.probability[STRAIGHT];
        let model = if is_planned { &bank.plan } else { &bank.straight };
        let (position, velocity) = parts(model);
        let Some(u) = Vector2::from(velocity).try_normalize(0.0) else { return };
        let s = model.position_covariance().plus(r);
        let variance = s.xx * u.x * u.x + 2.0 * s.xy * u.x * u.y + s.yy * u.y * u.y;
        let error = (z[0] - position[0]) * u.x + (z[1] - position[1]) * u.y;
        let normalised = (error / variance.sqrt()).clamp(-LAG_LARGEST, LAG_LARGEST);
        self.lag += LAG_SHARE * (normalised - self.lag);
    }

    /// Standard deviation of the acceleration along the course, m/s².
    fn speed_change(&self) -> f64 {
        let beyond = (self.lag.abs() - LAG_BY_CHANCE).max(0.0);
        (LAG_ACCELERATION * beyond).min(LAG_ACCELERATION_MAX)
    }

    /// Predicts both banks.
    pub fn predict(
        &mut self,
        bank: &mut Bank,
        estimate: &Estimate<4>,
        settings: &Settings,
        noise: &ImmModel,
        t: f64,
        period: f64,
    ) {
        let plan = &settings.plans[self.plan];
        if self.is_believed(settings) && self.in_zone && self.turning.is_none() {
            self.enter(bank);
        }
        let variance = noise.turn_rate_sigma.powi(2);
        let mut transition = changes(noise, t);
        let keeps = self.is_believed(settings) && !self.in_zone;
        if keeps {
            let scans = t / period;
            let to_leg = -(scans * (-TO_LEG).ln_1p()).exp_m1();
            let from_leg = -(scans * (-FROM_LEG).ln_1p()).exp_m1();
            let begins = transition[STRAIGHT][TURN];
            transition[STRAIGHT] = [1.0 - begins - to_leg, begins, to_leg];
            transition[PLAN] = [from_leg, begins, 1.0 - from_leg - begins];
        } else {
            fold_plan(bank);
        }
        bank.mix(&limited(transition), variance);
        bank.predict(noise, t, period);
        if keeps {
            let course = plan.route.turn(self.monitor.leg()).inbound;
            let sigma = noise.straight_sigma.hypot(self.speed_change());
            keep_to_leg(&mut bank.plan, course, t, sigma * sigma * period);
        }
        let (speed, change) = (self.speed(estimate), self.speed_change());
        if let Some(turning) = self.turning.as_deref_mut() {
            let leg = self.monitor.leg();
            let course = plan.route.turn(leg).inbound;
            let air = Vector2::from(course) * speed - Vector2::from(settings.wind);
            let turn = plan.turn(leg, air.norm());
            let flown =
                Flown { turn, change, wind: settings.wind, wind_sigma: settings.wind_sigma };
            self.ratio = predict_turning(turning, &flown, noise, self.ratio, t, period);
        }
    }

    /// Begins the second bank, in which the turn is flown.
    fn enter(&mut self, bank: &mut Bank) {
        fold_plan(bank);
        let [flown, not] = self.turns;
        let prior = flown / (flown + not);
        let mut turning = *bank;
        turning.plan = turning.straight;
        turning.scale(prior);
        bank.scale(1.0 - prior);
        self.turning = Some(Box::new(turning));
        self.ratio = f64::INFINITY;
    }

    /// Changes to a plan that replaces this one and on whose leg `leg` the track is; a second bank
    /// must have been left before.
    pub fn reroute(&mut self, leg: usize) {
        self.monitor.reroute(leg);
        self.history = SpeedHistory::default();
        self.in_zone = false;
    }

    /// Suspends the plan; a second bank must have been left before.
    pub fn suspend(&mut self) {
        self.monitor.suspend();
        self.conforms = false;
        self.in_zone = false;
    }

    /// Resumes the plan: it has influence again once the track is back on it.
    pub fn resume(&mut self) {
        self.monitor.resume();
    }

    /// Merges the second bank into the first. If `counts`, the turn is counted as flown or not
    /// flown.
    pub fn leave(&mut self, bank: &mut Bank, counts: bool) {
        let Some(turning) = self.turning.take() else { return };
        if counts {
            let flown = usize::from(turning.total() <= 0.5);
            self.turns[flown] = (self.turns[flown] + 1.0).min(REMEMBERED[flown]);
        }
        merge(bank, *turning);
    }

    /// Follows the track along the plan after a scan.
    pub fn follow(
        &mut self,
        bank: &mut Bank,
        estimate: &Estimate<4>,
        settings: &Settings,
        time: f64,
        period: f64,
    ) {
        let route = &settings.plans[self.plan].route;
        let leg = self.monitor.leg();
        if self.turning.as_ref().is_some_and(|turning| turning.total() < LEAST) {
            self.turns[1] = (self.turns[1] + 1.0).min(REMEMBERED[1]);
            // a turn that was not flown says nothing about where the target is
            self.turning = None;
            bank.scale(bank.total().recip());
            self.monitor.block((leg + 1).min(route.legs() - 1));
        }
        let turning = bank.probability[TURN] / bank.total();
        let verdict = self.watch(estimate, turning, settings, time, period);
        if verdict.advanced || !verdict.in_zone || !verdict.conforms {
            self.leave(bank, verdict.conforms);
        }
    }

    /// Locates the track along the plan, and checks whether the track follows the plan. `turning`
    /// is the probability of a turn other than the planned one.
    pub fn watch(
        &mut self,
        estimate: &Estimate<4>,
        turning: f64,
        settings: &Settings,
        time: f64,
        period: f64,
    ) -> Verdict {
        let route = &settings.plans[self.plan].route;
        let (position, velocity) = parts(estimate);
        let covariance: [f64; 16] = std::array::from_fn(|k| estimate.covariance[(k / 4, k % 4)]);
        let seen = Sighting::new(time, position, velocity, Some(&covariance), f64::NAN);
        let verdict = self.monitor.update(route, &seen, turning, period);
        self.conforms = verdict.conforms;
        self.in_zone = verdict.in_zone;
        if self.conforms {
            self.history.update(route, verdict.leg, &seen);
        }
        verdict
    }

    /// The turn in whose zone the track is; none if the plan is not believed.
    pub fn near_turn(&self, estimate: &Estimate<4>, settings: &Settings) -> Option<Turn> {
        let is_near = self.in_zone && self.is_believed(settings);
        let leg = self.monitor.leg();
        is_near.then(|| settings.plans[self.plan].turn(leg, self.speed(estimate)))
    }

    /// Where the target will be if it follows its plan; none if the plan is not believed.
    pub fn extrapolate(
        &self,
        estimate: &Estimate<4>,
        settings: &Settings,
        t: f64,
    ) -> Option<[f64; 2]> {
        let believed = self.is_believed(settings);
        if !believed || self.turn_probability().is_some_and(|p| p < 0.5) {
            return None;
        }
        let route = &settings.plans[self.plan].route;
        let (distance, _) = route.project_leg(self.monitor.leg(), estimate.position());
        Some(route.path(distance + t * self.speed(estimate)).0)
    }
}

impl Plan {
    /// The turn at the end of a leg, flown at this speed.
    pub(in crate::tracker) fn turn(&self, leg: usize, speed: f64) -> Turn {
        let Turn { corner, inbound, outbound, .. } = *self.route.turn(leg);
        let before = [corner[0] - LONG * inbound[0], corner[1] - LONG * inbound[1]];
        let after = [corner[0] + LONG * outbound[0], corner[1] + LONG * outbound[1]];
        Turn::new(before, corner, after, speed, self.bank, self.turn_rate)
    }
}

/// Position and velocity.
fn parts(estimate: &Estimate<4>) -> ([f64; 2], [f64; 2]) {
    (estimate.position(), [estimate.mean[2], estimate.mean[3]])
}

/// A turn, and the uncertainty of how it will be flown.
struct Flown {
    turn: Turn,
    /// Standard deviation of the acceleration along the course, m/s².
    change: f64,
    wind: [f64; 2],
    wind_sigma: f64,
}

impl Flown {
    /// Remaining angle of the turn, rad.
    fn remaining(&self, position: [f64; 2], velocity: [f64; 2], t: f64) -> f64 {
        capture_in_wind(&self.turn, position, velocity, self.wind, t).remaining
    }

    /// Airspeed.
    fn speed(&self, velocity: [f64; 2]) -> f64 {
        (velocity[0] - self.wind[0]).hypot(velocity[1] - self.wind[1])
    }
}

/// Predicts the bank in which the turn is flown; returns the distance to the waypoint, in leads.
fn predict_turning(
    bank: &mut Bank,
    flown: &Flown,
    noise: &ImmModel,
    before: f64,
    t: f64,
    period: f64,
) -> f64 {
    let turn = &flown.turn;
    let (position, velocity) = parts(&bank.straight);
    let lead = lead_in_wind(turn, flown.wind, flown.speed(velocity));
    let ground = velocity[0].hypot(velocity[1]);
    let ratio = lead_ratio(&Turn { lead, ..*turn }, position, ground, t);
    let remaining = flown.remaining(position, velocity, t);
    let starts = hazard(before, ratio, remaining, START_MEDIAN);
    let mut transition = changes(noise, t);
    let begins = OTHER_TURNS * transition[STRAIGHT][TURN] * (1.0 - starts);
    transition[STRAIGHT] = [1.0 - starts - begins, begins, starts];
    let rate = bank.turn.mean[4];
    let (position, velocity) = (bank.turn.position(), [bank.turn.mean[2], bank.turn.mean[3]]);
    let left = flown.remaining(position, velocity, t);
    if rate * turn.angle > 0.0 && left.abs() > LITTLE {
        transition[TURN][TURN] -= TO_PLAN;
        transition[TURN][PLAN] = TO_PLAN;
    }
    let (position, velocity) = parts(&bank.plan);
    let left = flown.remaining(position, velocity, t).abs();
    let due = left * turn.full_radius / flown.speed(velocity).max(1.0) <= t;
    let ends = if due { ENDS } else { ENDS_EARLY };
    transition[PLAN] = [ends, FROM_PLAN, 1.0 - ends - FROM_PLAN];
    bank.mix(&limited(transition), noise.turn_rate_sigma.powi(2));
    bank.predict(noise, t, period);
    accelerate_along(&mut bank.straight, turn.inbound, flown.change.powi(2) * period, t);
    fly_turn(&mut bank.plan, flown, t, period);
    ratio
}

/// Adds white acceleration of the density `q` (m²/s³) along a course.
fn accelerate_along(estimate: &mut Estimate<4>, [x, y]: [f64; 2], q: f64, t: f64) {
    estimate.accelerate(Plane { xx: q * x * x, xy: q * x * y, yy: q * y * y }, t);
}

/// Flies the capture arc through the air for as long as it lasts, then straight on.
fn fly_turn(estimate: &mut Estimate<4>, flown: &Flown, t: f64, period: f64) {
    let Flown { turn, change, wind, wind_sigma } = flown;
    let (position, velocity) = parts(estimate);
    let arc = capture_in_wind(turn, position, velocity, *wind, t);
    let rate = arc.turn_rate;
    let mut rated = entered(estimate, 0.0);
    rated.mean[2] -= wind[0];
    rated.mean[3] -= wind[1];
    let mut turned = Estimate { mean: rated.mean, covariance: rated.covariance };
    turned.mean[4] = rate;
    kinematics::turn(&mut turned, arc.time, 0.0, 0.0);
    *estimate = without_rate(&turned);
    for (i, w) in wind.iter().enumerate() {
        estimate.mean[i] += arc.time * w;
        estimate.mean[i + 2] += w;
    }
    kinematics::coast(estimate, t - arc.time);
    let speed = velocity[0].hypot(velocity[1]);
    let wind_change = wind_sigma * rate;
    let along = (ROUGHNESS.powi(2) + wind_change.powi(2) + change * change) * period;
    let across = (ROUGHNESS.powi(2) + (RATE_SHARE * speed * rate).powi(2)) * period;
    // noise across and along the course in the middle of the prediction
    let (_, now) = parts(estimate);
    let u = Vector2::new(velocity[0] + now[0], velocity[1] + now[1]);
    let u = u.try_normalize(0.0).unwrap_or(Vector2::x());
    let noise = Plane {
        xx: along * u.x * u.x + across * u.y * u.y,
        xy: (along - across) * u.x * u.y,
        yy: along * u.y * u.y + across * u.x * u.x,
    };
    estimate.accelerate(noise, t);
}

/// Predicts straight flight along a leg; the velocity across the leg returns to zero.
fn keep_to_leg(estimate: &mut Estimate<4>, course: [f64; 2], t: f64, q: f64) {
    let u = Vector2::from(course);
    let (along, across) = (u * u.transpose(), Matrix2::identity() - u * u.transpose());
    let a = t / ACROSS_TIME;
    let gone = -(-a).exp_m1();
    let mut f = SMatrix::<f64, 4, 4>::identity();
    f.fixed_view_mut::<2, 2>(0, 2).copy_from(&(along * t + across * (ACROSS_TIME * gone)));
    f.fixed_view_mut::<2, 2>(2, 2).copy_from(&(along + across * (1.0 - gone)));
    estimate.mean = f * estimate.mean;
    let predicted = f * estimate.covariance * f.transpose();
    let s = ACROSS * ACROSS;
    // 2a − 3 + 4 e^−a − e^−2a, without cancellation for short times
    let position =
        if a < 0.05 { 2.0 * a.powi(3) / 3.0 } else { 2.0 * a - 2.0 * gone - gone * gone };
    let noise = [
        along * (q * t * t * t / 3.0) + across * (s * ACROSS_TIME * ACROSS_TIME * position),
        along * (q * t * t / 2.0) + across * (s * ACROSS_TIME * gone * gone),
        along * (q * t) + across * (s * gone * (2.0 - gone)),
    ];
    let mut p = 0.5 * (predicted + predicted.transpose());
    for (i, j, block) in [(0, 0, 0), (0, 2, 1), (2, 0, 1), (2, 2, 2)] {
        let mut view = p.fixed_view_mut::<2, 2>(i, j);
        view += noise[block];
    }
    estimate.covariance = p;
}

/// Merges the plan's model of a bank, or that of a change of speed, into straight flight.
pub(in crate::tracker) fn fold_plan(bank: &mut Bank) {
    let [straight, _, plan] = bank.probability;
    if plan > 0.0 {
        bank.straight = bank.straight.merged(straight, &bank.plan, plan);
        bank.probability[STRAIGHT] += plan;
        bank.probability[PLAN] = 0.0;
    }
}

/// Merges another bank into this one, model by model.
fn merge(bank: &mut Bank, mut other: Bank) {
    fold_plan(&mut other);
    let ([straight, turn, _], [others_straight, others_turn, _]) =
        (bank.probability, other.probability);
    if others_straight > 0.0 {
        bank.straight = bank.straight.merged(straight, &other.straight, others_straight);
    }
    if others_turn > 0.0 {
        bank.turn = bank.turn.merged(turn, &other.turn, others_turn);
    }
    bank.probability = [straight + others_straight, turn + others_turn, 0.0];
}
