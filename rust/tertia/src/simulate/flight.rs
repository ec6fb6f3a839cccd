//! A point mass that flies a route by banking, with a finite rate of roll, in a constant wind.

use super::wander::Wander;
use nalgebra::Complex;
use std::f64::consts::PI;

type Plane = Complex<f64>;

const GRAVITY: f64 = 9.80665;
/// Rate of change of the speed, m/s², and of the height, m/s.
const ACCELERATION: f64 = 0.5;
const CLIMB: f64 = 15.0;
/// Times in which a course and a leg are captured, s, and largest angle at which a leg is intercepted.
const COURSE_TIME: f64 = 3.0;
const LEG_TIME: f64 = 20.0;
const INTERCEPT: f64 = 40.0 * PI / 180.0;
/// Share of the steepest course on which a leg can still be captured without overshoot.
const CAPTURE: f64 = 0.85;
/// Smallest bank that counts as a turn.
const TURNING: f64 = 5.0 * PI / 180.0;
/// Largest distance, m, and course error, rad, at which the flight is back on its plan.
const ON_LEG: f64 = 500.0;
const ON_COURSE: f64 = 5.0 * PI / 180.0;
/// Sine of the largest turn that does not begin early; largest lead of a turn, in radii.
const SMALL_TURN: f64 = 0.02;
const LARGEST_LEAD: f64 = 4.0;
/// Largest course error, rad, at which the turn to a waypoint has ended; smallest distance, in radii, from
/// which an aircraft heads for a waypoint, because it might circle a closer one forever.
const BESIDE: f64 = 2.0 * PI / 180.0;
const TOO_NEAR: f64 = 2.5;

/// How a flight passes a waypoint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Passing {
    /// The turn ends on the next leg.
    FlyBy,
    /// The turn begins at the waypoint, and the next leg is intercepted later.
    FlyOver,
    /// At the end of the turn, the flight proceeds directly to the next waypoint.
    Direct,
}

/// A route to be flown: N waypoints, each with its height and the way in which it is passed.
#[derive(Clone, Debug, PartialEq)]
pub struct Route {
    /// East and north, m.
    pub waypoints: Vec<Plane>,
    /// Speed from each waypoint to the next, m/s (N − 1).
    pub speeds: Vec<f64>,
    /// Height at each waypoint, m; nan if there are none.
    pub heights: Vec<f64>,
    /// How each waypoint is passed.
    pub passing: Vec<Passing>,
    /// Distance, m, by which the turn at each waypoint begins too early.
    pub early: Vec<f64>,
    /// Waypoint at which the flight leaves its plan.
    pub leave: Option<usize>,
    /// Waypoint from which on the flight may be back on its plan.
    pub rejoin: Option<usize>,
    /// Time after which the flight ends at the latest, s.
    pub longest: f64,
}

/// Parameters that differ between flights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pilot {
    /// Wind, m/s.
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

/// State of a flight at one instant, for output.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// East and north, m.
    pub position: [f64; 2],
    /// Velocity over the ground, m/s.
    pub velocity: [f64; 2],
    /// Rate of turn of the course over the ground, rad/s, positive clockwise.
    pub turn_rate: f64,
    /// Whether the bank is large enough for a turn.
    pub is_turning: bool,
    /// Height, m.
    pub height: f64,
}

/// The state of a flight. The current leg is the line through `origin` in the direction `along`. If `homing`
/// is set, the leg begins at the aircraft, until the turn to the waypoint ahead has ended.
#[derive(Clone, Debug, PartialEq)]
pub struct Flight {
    route: Route,
    pilot: Pilot,
    step: f64,
    /// Cross-track navigation error; below, slow variation of the speed.
    offset: Wander,
    variation: Wander,
    time: f64,
    flying: bool,
    /// Index of the waypoint behind.
    leg: usize,
    origin: Plane,
    along: Plane,
    homing: bool,
    steady: f64,
    speed: f64,
    /// Largest tangent of the bank, from the pilot's bank or from the largest rate of turn.
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
    /// Creates a flight at the first waypoint of its route. `offset` is the navigation error to the right of
    /// the legs, and `variation` that of the speed.
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
            // according to its navigation, the aircraft is on the leg
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

    /// Returns the present state; `None` after the end of the flight.
    pub fn sample(&self) -> Option<Sample> {
        self.flying.then(|| Sample {
            position: [self.position.re, self.position.im],
            velocity: [self.velocity.re, self.velocity.im],
            turn_rate: self.turn_rate,
            is_turning: self.bank.abs() > TURNING,
            height: self.height,
        })
    }

    /// Times since the start at which the flight left its plan and at which it was back, s; nan if it
    /// never did.
    pub fn departure(&self) -> (f64, f64) {
        (self.left, self.returned)
    }

    /// Advances by one step, with standard normal numbers for the speed and for navigation.
    pub fn advance(&mut self, speed: [f64; 2], navigation: [f64; 2]) {
        let Self { step, .. } = *self;
        self.pass_waypoints();
        let (wanted, reach) = (self.wanted_bank(), self.pilot.roll * step);
        let bank = self.bank + (wanted - self.bank).clamp(-reach, reach);
        let mean = 0.5 * (bank + self.bank);
        let half = Complex::cis(-0.5 * step * GRAVITY / self.speed * mean.tan());
        // along the chord of the arc of this step
        self.position += (self.heading * half * self.speed + self.pilot.wind) * step;
        self.heading *= half * half;
        self.bank = bank;
        self.change_speed(speed);
        self.offset.advance(navigation);
        self.climb();
        self.time += step;
        self.velocity = self.heading * self.speed + self.pilot.wind;
        // the rate of the course over the ground, not of the heading
        let lift = GRAVITY * bank.tan() * (self.heading * self.velocity.conj()).re;
        self.turn_rate = lift / self.velocity.norm_sqr();
        self.flying &= self.time < self.route.longest;
    }

    /// Changes to the next leg if the turn to it is due, and ends the flight if there is none.
    fn pass_waypoints(&mut self) {
        let (ahead, last) = (self.leg + 1, self.route.waypoints.len() - 1);
        let corner = self.route.waypoints[ahead];
        let following = unit(self.route.waypoints[(ahead + 1).min(last)] - corner);
        let (ends, passing) = (ahead >= last, self.route.passing[ahead]);
        let lead = if passing == Passing::FlyBy && !ends { self.lead(following) } else { 0.0 };
        let closing = (self.velocity * self.along.conj()).re;
        // turns begin at the start of a step: half a step early or late on average
        let is_near =
            ((corner - self.position) * self.along.conj()).re <= lead + 0.5 * self.step * closing;
        if is_near && self.flying && !self.homing {
            if ends {
                // a flight has at least two samples
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

    /// Distance before the waypoint ahead at which the turn to the following leg begins. The aircraft
    /// flies an arc relative to the air, which the wind carries along; the end of the turn must be on the
    /// following leg. Half of the time to roll is lost at each end of the arc.
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

    /// Records the time at which the flight is back on its plan.
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

    /// Bank that brings the aircraft to its leg and holds it there.
    fn wanted_bank(&mut self) -> f64 {
        self.home();
        let (speed, limit) = (self.speed, self.limit);
        // distance to the right of the leg, according to navigation
        let off = ((self.position - self.origin) * self.along.conj()).im;
        let across = self.offset.value() - off;
        let (distance, ground) = (across.abs(), self.velocity.norm());
        // intercept angle: proportional to the distance, and small enough for the turn onto the leg
        let sharpest = (2.0 * distance * GRAVITY * limit).sqrt() / ground;
        let angle = (distance / (ground * LEG_TIME)).min(INTERCEPT).min(CAPTURE * sharpest);
        let course = self.along * Complex::cis(angle.copysign(across));
        let error = -(self.crab(course) * self.heading.conj()).arg();
        let size = error.abs();
        self.homing &= size > BESIDE;
        let bank = (size * speed / (COURSE_TIME * GRAVITY)).min(limit).atan();
        // the heading change during the roll-out must not exceed the error: g / (V roll) ln(1 / cos(bank))
        let out = (-size * speed * self.pilot.roll / GRAVITY).exp().acos();
        bank.min(out).copysign(error)
    }

    /// While homing on a waypoint, lets the leg begin at the position according to navigation.
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

    /// Changes the speed towards that of the leg.
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

    /// Changes the height towards that of the route.
    fn climb(&mut self) {
        let (first, second) = (self.route.waypoints[self.leg], self.route.waypoints[self.leg + 1]);
        let way = second - first;
        let share = ((self.position - first) * way.conj()).re / way.norm_sqr().max(1.0);
        let (low, high) = (self.route.heights[self.leg], self.route.heights[self.leg + 1]);
        let wanted = low + share.clamp(0.0, 1.0) * (high - low);
        let reach = CLIMB * self.step;
        self.height += (wanted - self.height).clamp(-reach, reach);
    }

    /// Heading that holds a course in the wind.
    fn crab(&self, course: Plane) -> Plane {
        let across = (self.pilot.wind * course.conj()).im;
        let along = (self.speed * self.speed - across * across).sqrt();
        course * Complex::new(along, -across) / self.speed
    }
}

/// Direction of a vector; zero after the last waypoint, which has no leg.
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
