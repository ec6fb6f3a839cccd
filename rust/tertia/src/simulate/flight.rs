//! A point mass that flies a route by banking, with a rate of roll, in a constant wind.

use super::wander::Wander;
use nalgebra::Complex;
use std::f64::consts::PI;

type Plane = Complex<f64>;

const GRAVITY: f64 = 9.80665;
/// Of the speed, m/s²; of the height, m/s.
const ACCELERATION: f64 = 0.5;
const CLIMB: f64 = 15.0;
/// Seconds in which a course is met, and a leg; the largest angle at which it is met.
const COURSE_TIME: f64 = 3.0;
const LEG_TIME: f64 = 20.0;
const INTERCEPT: f64 = 40.0 * PI / 180.0;
/// Share of the sharpest course at which a leg can still be met without flying through it.
const CAPTURE: f64 = 0.85;
/// Beyond, a bank is a turn.
const TURNING: f64 = 5.0 * PI / 180.0;
/// Back on the plan: metres and radians off it.
const ON_LEG: f64 = 500.0;
const ON_COURSE: f64 = 5.0 * PI / 180.0;
/// Sine of turns too small to begin them early; radii before a waypoint where a turn begins at most.
const SMALL_TURN: f64 = 0.02;
const LARGEST_LEAD: f64 = 4.0;
/// Radians off the course to a waypoint at which the turn to it has ended; radii from a waypoint
/// within which it is not headed for: it might be circled for ever.
const BESIDE: f64 = 2.0 * PI / 180.0;
const TOO_NEAR: f64 = 2.5;

/// How a waypoint is passed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Passing {
    /// The turn ends on the next leg.
    FlyBy,
    /// The turn begins at the waypoint, and the leg is met later.
    FlyOver,
    /// The next waypoint is headed for from where the turn ends.
    Direct,
}

/// What is flown: N waypoints, each with its height and how it is passed.
#[derive(Clone, Debug, PartialEq)]
pub struct Route {
    /// Metres.
    pub waypoints: Vec<Plane>,
    /// m/s, from each waypoint to the next, N − 1.
    pub speeds: Vec<f64>,
    /// Metres; nan where there are none.
    pub heights: Vec<f64>,
    /// One for each waypoint.
    pub passing: Vec<Passing>,
    /// Metres before a waypoint by which its turn begins too early.
    pub early: Vec<f64>,
    /// The waypoint at which the plan is left, and that from which on it may be met again.
    pub leave: Option<usize>,
    /// See `leave`.
    pub rejoin: Option<usize>,
    /// Seconds after which the flight ends wherever it is.
    pub longest: f64,
}

/// What differs among flights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pilot {
    /// m/s.
    pub wind: Plane,
    /// Error of the airspeed, m/s.
    pub speed_error: f64,
    /// Bank in turns, rad.
    pub bank: f64,
    /// Rate of roll, rad/s.
    pub roll: f64,
    /// Largest rate of turn, rad/s.
    pub turn_rate: f64,
}

/// A flight at an instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Metres.
    pub position: [f64; 2],
    /// Over the ground, m/s.
    pub velocity: [f64; 2],
    /// Of the course over the ground, rad/s, positive clockwise.
    pub turn_rate: f64,
    /// Whether the bank is that of a turn.
    pub is_turning: bool,
    /// Metres.
    pub height: f64,
}

/// The state of a flight. The leg that is flown is the line through `origin` in the direction `along`.
/// Where `homing`, it begins where the aircraft is, until the turn to the waypoint ahead has ended.
#[derive(Clone, Debug, PartialEq)]
pub struct Flight {
    route: Route,
    pilot: Pilot,
    step: f64,
    /// Navigation error and slow variation of the speed.
    offset: Wander,
    variation: Wander,
    time: f64,
    flying: bool,
    /// The waypoint behind.
    leg: usize,
    origin: Plane,
    along: Plane,
    homing: bool,
    steady: f64,
    speed: f64,
    /// The largest tangent of the bank: the pilot's, or that of the largest rate of turn.
    limit: f64,
    bank: f64,
    turn_rate: f64,
    height: f64,
    position: Plane,
    heading: Plane,
    velocity: Plane,
    left: f64,
    returned: f64,
}

impl Flight {
    /// A flight at the first waypoint of its route, with the distance to the right of its legs by
    /// which navigation errs, and the variation of its speed.
    ///
    /// # Panics
    /// If the route has fewer than two waypoints, or columns of different lengths.
    pub fn new(route: Route, pilot: Pilot, step: f64, offset: Wander, variation: Wander) -> Self {
        let n = route.waypoints.len();
        assert!(n >= 2 && route.speeds.len() == n - 1 && route.heights.len() == n);
        assert!(route.passing.len() == n && route.early.len() == n);
        let origin = route.waypoints[0];
        let along = unit(route.waypoints[1] - origin);
        let steady = route.speeds[0] + pilot.speed_error;
        let height = route.heights[0];
        let mut flight = Self {
            route,
            pilot,
            step,
            offset,
            variation,
            time: 0.0,
            flying: true,
            leg: 0,
            origin,
            along,
            homing: false,
            steady,
            speed: steady + variation.value(),
            limit: 0.0,
            bank: 0.0,
            turn_rate: 0.0,
            height,
            // navigation takes the aircraft to be on the leg
            position: origin + Plane::I * along * offset.value(),
            heading: along,
            velocity: along,
            left: f64::NAN,
            returned: f64::NAN,
        };
        flight.limit_bank();
        flight.heading = flight.crab(along);
        flight.velocity = flight.heading * flight.speed + pilot.wind;
        flight
    }

    /// The flight now; none once it has ended.
    pub fn sample(&self) -> Option<Sample> {
        self.flying.then(|| Sample {
            position: [self.position.re, self.position.im],
            velocity: [self.velocity.re, self.velocity.im],
            turn_rate: self.turn_rate,
            is_turning: self.bank.abs() > TURNING,
            height: self.height,
        })
    }

    /// Seconds from the start at which the plan was left, and at which it was met again; nan: never.
    pub fn departure(&self) -> (f64, f64) {
        (self.left, self.returned)
    }

    /// Goes on by a step, with standard normal numbers for the speed and for navigation.
    pub fn advance(&mut self, speed: [f64; 2], navigation: [f64; 2]) {
        let Self { step, .. } = *self;
        self.pass_waypoints();
        let (wanted, reach) = (self.wanted_bank(), self.pilot.roll * step);
        let bank = self.bank + (wanted - self.bank).clamp(-reach, reach);
        let mean = 0.5 * (bank + self.bank);
        let half = Complex::cis(-0.5 * step * GRAVITY / self.speed * mean.tan());
        // along the chord of the step's arc
        self.position += (self.heading * half * self.speed + self.pilot.wind) * step;
        self.heading *= half * half;
        self.bank = bank;
        self.change_speed(speed);
        self.offset.advance(navigation);
        self.climb();
        self.time += step;
        self.velocity = self.heading * self.speed + self.pilot.wind;
        // that of the course over the ground, not of the heading
        let lift = GRAVITY * bank.tan() * (self.heading * self.velocity.conj()).re;
        self.turn_rate = lift / self.velocity.norm_sqr();
        self.flying &= self.time < self.route.longest;
    }

    /// Takes the next leg where the turn to it is due, and ends where there is none.
    fn pass_waypoints(&mut self) {
        let (ahead, last) = (self.leg + 1, self.route.waypoints.len() - 1);
        let corner = self.route.waypoints[ahead];
        let following = unit(self.route.waypoints[(ahead + 1).min(last)] - corner);
        let (ends, passing) = (ahead >= last, self.route.passing[ahead]);
        let lead = if passing == Passing::FlyBy && !ends { self.lead(following) } else { 0.0 };
        let closing = (self.velocity * self.along.conj()).re;
        // a turn begins with a step: half a step early or late on average
        let is_near =
            ((corner - self.position) * self.along.conj()).re <= lead + 0.5 * self.step * closing;
        if is_near && self.flying && !self.homing {
            if ends {
                // a flight has two samples at least
                self.flying = self.time == 0.0;
            } else {
                self.leg = ahead;
                if self.route.leave == Some(ahead) {
                    self.left = self.time;
                }
                if passing == Passing::Direct {
                    self.homing = true;
                } else {
                    (self.origin, self.along) = (corner, following);
                }
            }
        }
        self.look_for_plan();
    }

    /// How far before the waypoint ahead the turn to the following leg begins. The air turns the
    /// aircraft along an arc, and the wind carries that: the turn's end has to lie on the following
    /// leg. Half of the roll is lost on each side of the arc.
    fn lead(&self, following: Plane) -> f64 {
        let sine = (self.along.conj() * following).im;
        if sine.abs() <= SMALL_TURN {
            return 0.0;
        }
        let (first, second) = (self.crab(self.along), self.crab(following));
        let turn = -(second * first.conj()).arg();
        let rate = GRAVITY * self.limit / self.speed;
        let radius = self.speed / rate;
        let side = if turn == 0.0 { 0.0 } else { turn.signum() };
        let way =
            -Plane::I * side * radius * (first - second) + self.pilot.wind * turn.abs() / rate;
        let roll = self.limit.atan() / self.pilot.roll;
        let lost = 0.5 * roll * (self.velocity * self.along.conj()).re;
        let lead = (way.conj() * following).im / sine + lost + self.route.early[self.leg + 1];
        lead.clamp(0.0, LARGEST_LEAD * radius)
    }

    /// Notes when the flight is back on its plan.
    fn look_for_plan(&mut self) {
        let is_after = self.route.rejoin.is_some_and(|rejoin| self.leg >= rejoin);
        if is_after && self.flying && self.returned.is_nan() {
            let across = ((self.position - self.origin) * self.along.conj()).im;
            let course = (self.velocity * self.along.conj()).arg();
            if across.abs() < ON_LEG && course.abs() < ON_COURSE {
                self.returned = self.time;
            }
        }
    }

    /// The bank that brings the aircraft to its leg, and holds it there.
    fn wanted_bank(&mut self) -> f64 {
        self.home();
        let (speed, limit) = (self.speed, self.limit);
        // to the right of the leg, as navigation has it
        let off = ((self.position - self.origin) * self.along.conj()).im;
        let across = self.offset.value() - off;
        let (distance, ground) = (across.abs(), self.velocity.norm());
        // the angle at which to meet the leg: in proportion, and so that the turn to it fits
        let sharpest = (2.0 * distance * GRAVITY * limit).sqrt() / ground;
        let angle = (distance / (ground * LEG_TIME)).min(INTERCEPT).min(CAPTURE * sharpest);
        let course = self.along * Complex::cis(angle.copysign(across));
        let error = -(self.crab(course) * self.heading.conj()).arg();
        let size = error.abs();
        self.homing &= size > BESIDE;
        let bank = (size * speed / (COURSE_TIME * GRAVITY)).min(limit).atan();
        // rolling out takes the heading no farther: g / (V roll) ln(1 / cos(bank))
        let out = (-size * speed * self.pilot.roll / GRAVITY).exp().acos();
        bank.min(out).copysign(error)
    }

    /// Lets the leg of one that heads for a waypoint begin where it believes to be.
    fn home(&mut self) {
        if !self.homing {
            return;
        }
        let begin = self.position - Plane::I * self.along * self.offset.value();
        let way = self.route.waypoints[self.leg + 1] - begin;
        (self.origin, self.along) = (begin, unit(way));
        let radius = self.speed * self.speed / (GRAVITY * self.limit);
        self.homing = way.norm() > TOO_NEAR * radius;
    }

    /// Approaches the speed of the leg.
    fn change_speed(&mut self, push: [f64; 2]) {
        let leg = self.leg.min(self.route.speeds.len() - 1);
        let target = self.route.speeds[leg] + self.pilot.speed_error;
        let reach = ACCELERATION * self.step;
        self.steady += (target - self.steady).clamp(-reach, reach);
        self.variation.advance(push);
        self.speed = self.steady + self.variation.value();
        self.limit_bank();
    }

    fn limit_bank(&mut self) {
        self.limit = self.pilot.bank.tan().min(self.pilot.turn_rate * self.speed / GRAVITY);
    }

    /// Approaches the height of the route.
    fn climb(&mut self) {
        let (first, second) = (self.route.waypoints[self.leg], self.route.waypoints[self.leg + 1]);
        let way = second - first;
        let share = ((self.position - first) * way.conj()).re / way.norm_sqr().max(1.0);
        let (low, high) = (self.route.heights[self.leg], self.route.heights[self.leg + 1]);
        let wanted = low + share.clamp(0.0, 1.0) * (high - low);
        let reach = CLIMB * self.step;
        self.height += (wanted - self.height).clamp(-reach, reach);
    }

    /// The heading that holds a course in the wind.
    fn crab(&self, course: Plane) -> Plane {
        let across = (self.pilot.wind * course.conj()).im;
        let along = (self.speed * self.speed - across * across).sqrt();
        course * Complex::new(along, -across) / self.speed
    }
}

/// The direction of a vector; the last waypoint has no leg.
fn unit(vector: Plane) -> Plane {
    vector / vector.norm().max(1e-9)
}

#[cfg(test)]
mod tests {
    use super::super::wander::Process;
    use super::*;

    fn flight(passing: Passing) -> Flight {
        let waypoints = [[0.0, 0.0], [0.0, 3e4], [4e4, 3e4]].map(|[x, y]| Complex::new(x, y));
        let route = Route {
            waypoints: waypoints.to_vec(),
            speeds: vec![200.0; 2],
            heights: vec![3000.0, 3000.0, 5000.0],
            passing: vec![passing; 3],
            early: vec![0.0; 3],
            leave: None,
            rejoin: None,
            longest: 1000.0,
        };
        let wind = Complex::new(15.0, -10.0);
        let pilot = Pilot { wind, speed_error: 0.0, bank: 0.4, roll: 0.09, turn_rate: 0.05 };
        let still =
            Wander::new(Process { transition: [[0.0; 2]; 2], root: [[0.0; 2]; 2] }, [0.0; 2]);
        Flight::new(route, pilot, 1.0, still, still)
    }

    fn flown(mut flight: Flight) -> Vec<Sample> {
        let mut samples = Vec::new();
        while let Some(sample) = flight.sample() {
            samples.push(sample);
            flight.advance([0.0; 2], [0.0; 2]);
        }
        samples
    }

    #[test]
    fn legs_are_held_in_the_wind_and_turns_end_on_the_next() {
        let samples = flown(flight(Passing::FlyBy));
        assert!(samples[..100].iter().all(|sample| sample.position[0].abs() < 1e-6));
        let last = samples[samples.len() - 1];
        assert!((last.position[0] - 4e4).abs() < 200.0 && (last.position[1] - 3e4).abs() < 20.0);
        assert!((last.height - 5000.0).abs() < 20.0);
        let most = samples.iter().map(|s| s.position[1]).fold(0.0, f64::max);
        assert!(most < 3e4 + 150.0, "{most}");
        let turning = samples.iter().filter(|sample| sample.is_turning).count();
        assert!((60..110).contains(&turning), "{turning}");
    }

    #[test]
    fn a_turn_over_a_waypoint_is_wide() {
        let samples = flown(flight(Passing::FlyOver));
        let most = samples.iter().map(|s| s.position[1]).fold(0.0, f64::max);
        assert!(most > 3.3e4, "{most}");
    }
}
