//! Whether a track follows its plan. A plan that is not followed is worse than none, so it is blocked
//! until the track is back on one of its legs for several scans.

use super::correlation::Sighting;
use super::plane::{Vector, between, norm};
use super::route::Route;
use super::turn::Turn;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Deviations that count: standard deviations of the distance (metres) and the course (radians).
const OFFSET_SIGMA: f64 = 350.0;
const COURSE_SIGMA: f64 = 5.0 * PI / 180.0;
/// Tolerance in a turn: metres, and a share of its lead.
const ROOM: f64 = 500.0;
const ROOM_LEAD: f64 = 0.35;
/// No turn begins earlier than this before its start: a share of the lead, and metres.
const EARLY_LEAD: f64 = 0.3;
const EARLY: f64 = 600.0;
/// Deviation of a certain turn where none is planned.
const UNPLANNED: f64 = 5.0;
/// Largest deviation that counts, and what is subtracted each scan.
const LARGEST: f64 = 20.0;
const FORGIVEN: f64 = 4.0;
/// The sum above which the plan is blocked, and that at a new start.
const BLOCKING: f64 = 14.0;
const FRESH: f64 = 4.0;
/// Back on a leg: metres across track, radians off its course, successive scans.
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
    /// The track may come back on this leg or a later one.
    least_leg: usize,
    /// The leg it seems to be back on, and for how many scans.
    back: Option<(usize, u32)>,
}

/// The result of a scan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Verdict {
    /// Whether the plan can be believed: it is not blocked, and its end is ahead.
    pub conforms: bool,
    /// Whether it was blocked by this scan.
    pub blocked: bool,
    /// The leg on which the plan is believed again since this scan.
    pub rejoined: Option<usize>,
    /// Whether the track came to the next leg by this scan.
    pub advanced: bool,
    /// The leg that it is on.
    pub leg: usize,
    /// Distance along the path, metres.
    pub along_track: f64,
    /// Distance from it, positive to the right.
    pub cross_track: f64,
    /// Whether the turn may be flown now.
    pub in_zone: bool,
    /// The cumulative sum B.
    pub cusum: f64,
}

impl Monitor {
    /// A monitor of a track that is on a leg.
    pub fn new(leg: usize) -> Self {
        Self { leg, cusum: 0.0, blocked: false, suspended: false, least_leg: leg, back: None }
    }

    /// Verdicts on the sightings of a track, from the leg nearest to the first one on; `None` where
    /// there is no sighting.
    pub fn follow(
        route: &Route,
        seen: &[Sighting],
        update_interval: f64,
    ) -> impl Iterator<Item = Option<Verdict>> {
        let mut monitor: Option<Self> = None;
        seen.iter().map(move |seen| {
            seen.is_present().then(|| {
                let nearest = || Self::new(route.project(seen.position).leg);
                let monitor = monitor.get_or_insert_with(nearest);
                monitor.update(route, seen, 0.0, update_interval)
            })
        })
    }

    /// The leg that the track is on, or was on when the plan was blocked.
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

    /// Goes over to another route, of which the track is on this leg. Past deviations are mostly forgotten,
    /// but a plan that is blocked stays so until the track is back.
    pub fn reroute(&mut self, leg: usize) {
        (self.leg, self.least_leg, self.back) = (leg, leg, None);
        self.cusum = self.cusum.min(FRESH);
    }

    /// Blocks the plan until [`Monitor::resume`], for an emergency or a plan that is wrong.
    pub fn suspend(&mut self) {
        self.block(self.leg);
        self.suspended = true;
    }

    /// Lets the plan be believed again once the track is back on it.
    pub fn resume(&mut self) {
        self.suspended = false;
    }

    /// Takes a scan: where the track is seen, the probability μ that it turns as no plan says, seconds
    /// since the scan before. Deviations
    /// `q = max(|e| − tolerance, 0)²/(350² + P) + course error²/(5°² + σψ²) + 5 μ²` make
    /// `B = max(0, B + min(q, 20) − 4)`, and the plan is blocked where B > 14. Where a turn may be
    /// flown, there is a tolerance; from 0.3 d + 600 m before its arc on, its courses are no errors,
    /// and μ does not count.
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

    /// The leg on which the track has been long enough, if any.
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

/// The squared deviation q from the path at a leg's end.
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

/// By how much a course is outside those of the turn.
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
        // where a turn is planned, it says nothing
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
