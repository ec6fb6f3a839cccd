//! Monitoring of whether a track follows its plan. A plan that is not followed is worse than none, so it is
//! blocked until the track has been back on one of its legs for several scans.

use super::correlation::Sighting;
use super::plane::{Vector, between, norm};
use super::route::Route;
use super::turn::Turn;
use crate::base::interrupt::poll;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Standard deviations of the distance (m) and the course (rad) by which deviations are normalised.
const OFFSET_SIGMA: f64 = 350.0;
const COURSE_SIGMA: f64 = 5.0 * PI / 180.0;
/// Tolerance in a turn: a distance (m) plus this share of the lead of the turn.
const ROOM: f64 = 500.0;
const ROOM_LEAD: f64 = 0.35;
/// Turns begin no earlier than this before their planned start: a share of the lead plus a distance (m).
const EARLY_LEAD: f64 = 0.3;
const EARLY: f64 = 600.0;
/// Deviation for a certain turn (μ = 1) where none is planned.
const UNPLANNED: f64 = 5.0;
/// Largest deviation that is added per scan, and the amount that is subtracted per scan.
const LARGEST: f64 = 20.0;
const FORGIVEN: f64 = 4.0;
/// Sum above which the plan is blocked, and largest sum after a new leg or route.
const BLOCKING: f64 = 14.0;
const FRESH: f64 = 4.0;
/// Criteria for being back on a leg: distance across track (m), deviation from its course (rad),
/// successive scans.
const BACK_OFFSET: f64 = 1200.0;
const BACK_COURSE: f64 = 6.0 * PI / 180.0;
const BACK_SCANS: u32 = 5;

/// A cumulative sum of deviations of a track from its plan.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Monitor {
    leg: usize,
    cusum: f64,
    blocked: bool,
    suspended: bool,
    /// First leg on which the track may rejoin the plan.
    least_leg: usize,
    /// Leg on which the track seems to be back, and the number of scans.
    back: Option<(usize, u32)>,
}

/// Result of the monitoring of one scan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Verdict {
    /// Whether the plan can be trusted: it is not blocked, and its end is still ahead.
    pub conforms: bool,
    /// Whether this scan blocked the plan.
    pub blocked: bool,
    /// Leg on which the track has rejoined the plan at this scan.
    pub rejoined: Option<usize>,
    /// Whether the track reached the next leg at this scan.
    pub advanced: bool,
    /// Leg of the track.
    pub leg: usize,
    /// Distance along the path, metres.
    pub along_track: f64,
    /// Distance from the path, positive to the right.
    pub cross_track: f64,
    /// Whether the track is in a zone in which the turn may be flown.
    pub in_zone: bool,
    /// The cumulative sum B.
    pub cusum: f64,
}

impl Monitor {
    /// Creates a monitor for a track on this leg.
    pub fn new(leg: usize) -> Self {
        Self { leg, cusum: 0.0, blocked: false, suspended: false, least_leg: leg, back: None }
    }

    /// Returns verdicts on the sightings of a track; the initial leg is the one nearest to the first
    /// sighting. A gap without a sighting gives `None`.
    pub fn follow(
        route: &Route,
        seen: &[Sighting],
        update_interval: f64,
    ) -> impl Iterator<Item = Option<Verdict>> {
        let mut monitor: Option<Self> = None;
        seen.iter().map(move |seen| {
            poll();
            seen.is_present().then(|| {
                let nearest = || Self::new(route.project(seen.position).leg);
                let monitor = monitor.get_or_insert_with(nearest);
                monitor.update(route, seen, 0.0, update_interval)
            })
        })
    }

    /// Leg of the track, or its leg when the plan was blocked.
    pub fn leg(&self) -> usize {
        self.leg
    }

    /// Whether the plan is blocked.
    pub fn is_blocked(&self) -> bool {
        self.blocked
    }

    /// Blocks the plan until the track is back on this leg or a later one.
    pub fn block(&mut self, least_leg: usize) {
        self.blocked = true;
        self.least_leg = least_leg;
        self.back = None;
    }

    /// Changes to another route, with the track on this leg. Past deviations are mostly forgotten, but a
    /// blocked plan remains blocked until the track is back.
    pub fn reroute(&mut self, leg: usize) {
        (self.leg, self.least_leg, self.back) = (leg, leg, None);
        self.cusum = self.cusum.min(FRESH);
    }

    /// Blocks the plan until [`Monitor::resume`], in an emergency or if the plan is wrong.
    pub fn suspend(&mut self) {
        self.block(self.leg);
        self.suspended = true;
    }

    /// Allows the plan again as soon as the track is back on it.
    pub fn resume(&mut self) {
        self.suspended = false;
    }

    /// Updates the sum with a scan: the sighting, the probability μ of a turn that is not planned, and the
    /// seconds since the previous scan. The deviation
    /// `q = max(|e| − tolerance, 0)²/(350² + P) + course error²/(5°² + σψ²) + 5 μ²` changes the sum to
    /// `B = max(0, B + min(q, 20) − 4)`, and the plan is blocked if B > 14. The tolerance applies where a
    /// turn may be flown. From 0.3 d + 600 m before the arc of the turn on, all its courses are allowed, and
    /// μ is ignored.
    pub fn update(
        &mut self,
        route: &Route,
        seen: &Sighting,
        turning: f64,
        update_interval: f64,
    ) -> Verdict {
        let Sighting { position, velocity, .. } = *seen;
        let (mut advanced, mut blocked, mut rejoined) = (false, false, None);
        if self.blocked {
            rejoined = self.come_back(route, position, velocity);
        } else {
            while route.is_on_next(self.leg, position, velocity, update_interval) {
                self.leg += 1;
                self.cusum = self.cusum.min(FRESH);
                advanced = true;
            }
        }
        let turn = route.turn(self.leg);
        let (s, cross_track) = turn.project(position);
        let in_zone = turn.in_zone(s, norm(velocity), update_interval);
        if !self.blocked && rejoined.is_none() {
            let q = deviation(turn, [s, cross_track], seen, turning, in_zone);
            self.cusum = (self.cusum + q.min(LARGEST) - FORGIVEN).max(0.0);
            if self.cusum > BLOCKING {
                self.block(self.leg);
                blocked = true;
            }
        }
        let has_ended = self.leg + 1 == route.legs() && s > 0.0;
        Verdict {
            conforms: !self.blocked && !has_ended,
            blocked,
            rejoined,
            advanced,
            leg: self.leg,
            along_track: route.turn_start(self.leg) + s,
            cross_track,
            in_zone,
            cusum: self.cusum,
        }
    }

    /// Returns the leg on which the track has been back for enough scans, if any.
    fn come_back(&mut self, route: &Route, p: Vector, velocity: Vector) -> Option<usize> {
        if self.suspended {
            self.back = None;
            return None;
        }
        let is_back = |&leg: &usize| {
            let (along, aside, length) = route.on_leg(leg, p);
            let course = between(route.turn(leg).inbound, velocity).abs();
            aside.abs() < BACK_OFFSET && course < BACK_COURSE && 0.0 < along && along < length
        };
        let before = self.back;
        let leg = before
            .map(|(leg, _)| leg)
            .filter(is_back)
            .or_else(|| (self.least_leg..route.legs()).find(is_back));
        self.back = leg.map(|leg| match before {
            Some((same, scans)) if same == leg => (leg, scans + 1),
            _ => (leg, 1),
        });
        let (leg, _) = self.back.filter(|&(_, scans)| scans >= BACK_SCANS)?;
        *self = Self { cusum: FRESH, ..Self::new(leg) };
        Some(leg)
    }
}

/// Squared deviation q from the path, on a leg with this turn at its end.
fn deviation(
    turn: &Turn,
    [s, cross_track]: [f64; 2],
    seen: &Sighting,
    turning: f64,
    in_zone: bool,
) -> f64 {
    let room = ROOM + ROOM_LEAD * turn.lead * turn.angle.abs().min(1.0);
    let far = (cross_track.abs() - if in_zone { room } else { 0.0 }).max(0.0);
    let far = far * far / (OFFSET_SIGMA * OFFSET_SIGMA + seen.position_variance[1]);
    let off_course = |course: f64| course * course / (COURSE_SIGMA.powi(2) + seen.course_variance);
    if in_zone && s > -(EARLY_LEAD * turn.lead + EARLY) {
        return far + off_course(outside(turn, seen.velocity));
    }
    far + off_course(between(turn.at(s).1, seen.velocity)) + UNPLANNED * turning * turning
}

/// Angle by which a course is outside the courses of the turn.
fn outside(turn: &Turn, velocity: Vector) -> f64 {
    let since = between(turn.inbound, velocity);
    let until = between(velocity, turn.outbound);
    let is_within = since * turn.angle >= 0.0 && since.abs() <= turn.angle.abs();
    if is_within { 0.0 } else { since.abs().min(until.abs()) }
}

#[cfg(test)]
mod tests {
    use super::super::plane::along;
    use super::*;

    const SPEED: f64 = 200.0;
    const INTERVAL: f64 = 5.0;

    fn seen(position: Vector, velocity: Vector) -> Sighting {
        let seen = Sighting::new(0.0, position, velocity, None, f64::NAN);
        Sighting { position_variance: [1e4; 2], ..seen }
    }

    fn route() -> Route {
        let waypoints = [[0.0, 0.0], [0.0, 6e4], [5e4, 9e4], [5e4, 1.5e5]];
        Route::try_new(&waypoints, &[SPEED; 3], 0.0, &[], 0.4, 0.05).unwrap()
    }

    #[test]
    fn a_track_on_the_path_conforms_to_the_end() {
        let (route, mut monitor) = (route(), Monitor::new(0));
        for k in 0..(route.length() / SPEED / INTERVAL) as usize {
            let (p, v) = route.at(k as f64 * INTERVAL);
            let verdict = monitor.update(&route, &seen(p, v), 0.0, INTERVAL);
            assert!(verdict.conforms && verdict.cusum == 0.0, "{k}: {verdict:?}");
        }
        assert_eq!(monitor.leg(), 2);
        let (p, v) = route.at(1e4);
        assert!(!monitor.update(&route, &seen(p, v), 0.0, INTERVAL).conforms);
    }

    #[test]
    fn a_turn_that_is_not_flown_blocks_and_a_later_leg_unblocks() {
        let (route, mut monitor) = (route(), Monitor::new(0));
        let mut blocked_at = None;
        for k in 0..120 {
            let p = [0.0, k as f64 * SPEED * INTERVAL];
            let verdict = monitor.update(&route, &seen(p, [0.0, SPEED]), 0.0, INTERVAL);
            if verdict.blocked {
                blocked_at = Some(k);
            }
        }
        let late = blocked_at.unwrap() as f64 * SPEED * INTERVAL - 6e4;
        assert!((0.0..15e3).contains(&late), "{late}");
        for k in 1..=6 {
            let p = along([5e4, 1e5], k as f64 * SPEED * INTERVAL, [0.0, 1.0]);
            let verdict = monitor.update(&route, &seen(p, [0.0, SPEED]), 0.0, INTERVAL);
            assert_eq!(verdict.rejoined, (k == 5).then_some(2));
            assert_eq!(verdict.conforms, k >= 5);
        }
    }

    #[test]
    fn a_turn_that_no_plan_says_blocks_sooner() {
        let (route, start) = (route(), Monitor::new(0));
        let scans = |turning: f64| {
            let mut monitor = start;
            (1..100).find(|&k| {
                let course = (0.06 * k as f64).sin_cos();
                let velocity = [SPEED * course.0, SPEED * course.1];
                !monitor.update(&route, &seen([0.0, 1e4], velocity), turning, INTERVAL).conforms
            })
        };
        assert!(scans(1.0) < scans(0.0), "{:?} {:?}", scans(1.0), scans(0.0));
        // where a turn is planned, μ has no effect
        let mut monitor = start;
        let (p, v) = route.turn(0).at(0.5 * route.turn(0).arc());
        let velocity = [SPEED * v[0], SPEED * v[1]];
        assert_eq!(monitor.update(&route, &seen(p, velocity), 1.0, INTERVAL).cusum, 0.0);
    }

    #[test]
    fn what_was_off_one_leg_is_mostly_forgotten_on_the_next() {
        let (route, mut monitor) = (route(), Monitor::new(0));
        let aside = 8.0_f64.sqrt() * OFFSET_SIGMA.hypot(1e2);
        let mut last = 0.0;
        for k in 1..=2 {
            let p = [aside, 1e4 + k as f64 * SPEED * INTERVAL];
            last = monitor.update(&route, &seen(p, [0.0, SPEED]), 0.0, INTERVAL).cusum;
        }
        assert!((last - 8.0).abs() < 1e-9, "{last}");
        let (p, v) = route.at(445.0);
        let verdict = monitor.update(&route, &seen(p, v), 0.0, INTERVAL);
        assert!(verdict.advanced && verdict.leg == 1);
        assert!((verdict.cusum - (FRESH - FORGIVEN)).abs() < 1e-9, "{verdict:?}");
    }

    #[test]
    fn a_suspended_plan_stays_blocked() {
        let (route, mut monitor) = (route(), Monitor::new(0));
        monitor.suspend();
        let scan = |monitor: &mut Monitor, k: usize| {
            let (p, v) = route.at(k as f64 * INTERVAL);
            monitor.update(&route, &seen(p, v), 0.0, INTERVAL).conforms
        };
        assert!((0..30).all(|k| !scan(&mut monitor, k)));
        monitor.resume();
        assert!(!(30..34).any(|k| scan(&mut monitor, k)));
        assert!(scan(&mut monitor, 34));
    }
}
