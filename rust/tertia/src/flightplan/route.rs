//! The complete path of a plan: straight legs, arcs between them, and the times over its points.

use super::plane::{Vector, along, between, dot, left, minus, norm};
use super::turn::Turn;
use crate::base::error::{Error, Result, require, require_count, require_each, require_positive};
use serde::{Deserialize, Serialize};
use std::f64::consts::{FRAC_PI_2, PI};

/// Largest coordinate (m) and time (s): beyond it, rounding would matter.
const FARTHEST: f64 = 1e9;
/// A track is on the next leg if it is within this angle of its course (rad) and this distance of its
/// line (m).
const NEXT_COURSE: f64 = 4.0 * PI / 180.0;
const NEXT_OFFSET: f64 = 1500.0;
/// Largest number of iterations for the speeds that meet given times, and the relative change at which
/// they end.
const SPEED_STEPS: usize = 400;
const SPEED_TOLERANCE: f64 = 1e-13;
/// Longest step towards the speed that a leg needs, and the factors of the next step if the speed oscillates
/// and if it does not.
const LONGEST_STEP: f64 = 0.5;
const SHORTER: f64 = 0.5;
const LONGER: f64 = 1.2;

/// A flight plan: N waypoints, N − 1 legs, and the speed on each.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Route {
    turns: Vec<Turn>,
    lengths: Vec<f64>,
    /// Path distance at the start of each turn.
    starts: Vec<f64>,
    /// Path distance at which each waypoint is passed, on the bisector of its turn.
    marks: Vec<f64>,
    times: Vec<f64>,
    speeds: Vec<f64>,
    heights: Vec<f64>,
}

/// The point of a route nearest to a position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Projection {
    /// Path distance of the point from the first waypoint, m; negative before it.
    pub along_track: f64,
    /// Distance of the position from the point, positive to the right of the course.
    pub cross_track: f64,
    /// Direction of the path at the point, of length 1.
    pub course: [f64; 2],
    /// Leg of the point.
    pub leg: usize,
}

impl Route {
    /// Creates the route through waypoints (m), with these speeds (m/s) on the legs, this bank (rad) and at
    /// most this rate of turn (rad/s). `heights` has one height for each waypoint, nan if unknown, or is
    /// empty.
    ///
    /// The radius of a turn results from the speed on the leg before it. If two turns need more than the
    /// length of the leg between them, both are shortened in proportion.
    ///
    /// # Errors
    /// Fewer than two waypoints, equal successive waypoints, or numbers outside their domains.
    pub fn try_new(
        waypoints: &[[f64; 2]],
        speeds: &[f64],
        start_time: f64,
        heights: &[f64],
        bank: f64,
        turn_rate: f64,
    ) -> Result<Self> {
        check_waypoints(waypoints)?;
        let legs = waypoints.len() - 1;
        check_count("speeds", speeds.len(), legs)?;
        let positive = |value: f64| value > 0.0 && value <= FARTHEST;
        require_each("speeds", speeds, positive, "it must be a positive number, not above 1e9")?;
        if !heights.is_empty() {
            check_count("heights", heights.len(), legs + 1)?;
            let holds = |height: f64| !height.is_infinite();
            require_each("heights", heights, holds, "it must be finite, or nan where unknown")?;
        }
        let holds = start_time.abs() <= 1e6 * FARTHEST;
        require("start_time", start_time, holds, "a number of at most 1e15 in size")?;
        require("bank", bank, bank > 0.0 && bank < FRAC_PI_2, "between 0 and pi/2")?;
        require_positive("turn_rate", turn_rate)?;
        let mut route = Self {
            turns: fly_by(waypoints, speeds, bank, turn_rate),
            lengths: waypoints.windows(2).map(|w| norm(minus(w[1], w[0]))).collect(),
            starts: Vec::with_capacity(legs),
            marks: vec![0.0; legs + 1],
            times: vec![start_time; legs + 1],
            speeds: speeds.to_vec(),
            heights: heights.to_vec(),
        };
        route.measure();
        Ok(route)
    }

    /// Creates the route that passes each waypoint at its time, with constant speed from one to the next.
    /// As the speeds change the radii and the radii the length of the path, the speeds are found by
    /// iteration.
    ///
    /// # Errors
    /// As [`Route::try_new`], or times that do not increase.
    pub fn through(
        waypoints: &[[f64; 2]],
        times: &[f64],
        heights: &[f64],
        bank: f64,
        turn_rate: f64,
    ) -> Result<Self> {
        check_waypoints(waypoints)?;
        check_count("times", times.len(), waypoints.len())?;
        require_each("times", times, f64::is_finite, "it must be a finite number")?;
        if let Some(at) = times.windows(2).position(|w| w[1] <= w[0]) {
            let (argument, requirement) = ("times", "it must be later than the one before");
            let (index, value) = (at + 1, times[at + 1]);
            return Err(Error::InvalidMeasurement { argument, index, value, requirement });
        }
        let mut speeds: Vec<f64> = waypoints
            .windows(2)
            .zip(times.windows(2))
            .map(|(w, t)| norm(minus(w[1], w[0])) / (t[1] - t[0]))
            .collect();
        // step of each leg, and what its speed missed before
        let mut steps = vec![(LONGEST_STEP, 0.0); speeds.len()];
        let mut change = f64::INFINITY;
        for _ in 0..SPEED_STEPS {
            let route = Self::try_new(waypoints, &speeds, times[0], heights, bank, turn_rate)?;
            if change < SPEED_TOLERANCE {
                return Ok(route);
            }
            change = 0.0;
            for (j, (speed, (step, before))) in speeds.iter_mut().zip(&mut steps).enumerate() {
                let needed = (route.marks[j + 1] - route.marks[j]) / (times[j + 1] - times[j]);
                let missing = needed - *speed;
                change = change.max((missing / *speed).abs());
                // full steps may oscillate if legs are short, and half steps if turns are sharp as well
                let oscillates = missing * *before < 0.0;
                *step = if oscillates { SHORTER * *step } else { LONGEST_STEP.min(LONGER * *step) };
                *speed += *step * missing;
                *before = missing;
            }
        }
        Self::try_new(waypoints, &speeds, times[0], heights, bank, turn_rate)
    }

    /// Computes path distances and times.
    fn measure(&mut self) {
        let (mut distance, mut behind) = (0.0, 0.0);
        for j in 0..self.legs() {
            let turn = &self.turns[j];
            distance += (self.lengths[j] - behind - turn.lead).max(0.0);
            self.starts.push(distance);
            self.marks[j + 1] = distance + 0.5 * turn.arc();
            let flown = self.marks[j + 1] - self.marks[j];
            self.times[j + 1] = self.times[j] + flown / self.speeds[j];
            distance += turn.arc();
            behind = turn.lead;
        }
    }

    /// Number of legs.
    pub fn legs(&self) -> usize {
        self.turns.len()
    }

    /// The turn at the end of a leg; that of the last leg continues straight ahead.
    ///
    /// # Panics
    /// If there is no such leg.
    pub fn turn(&self, leg: usize) -> &Turn {
        &self.turns[leg]
    }

    /// Path distance at the start of a turn.
    pub(super) fn turn_start(&self, leg: usize) -> f64 {
        self.starts[leg]
    }

    /// Turns, one for each leg.
    pub fn turns(&self) -> &[Turn] {
        &self.turns
    }

    /// Whether the other route has the same waypoints.
    pub fn is_along(&self, other: &Self) -> bool {
        let ends = |route: &Self| -> Vec<_> {
            route.turns.iter().map(|turn| (turn.corner, turn.inbound)).collect()
        };
        self.lengths == other.lengths && ends(self) == ends(other)
    }

    /// Length of the path, arcs included.
    pub fn length(&self) -> f64 {
        self.marks[self.legs()]
    }

    /// Path distances at which the waypoints are passed.
    pub fn marks(&self) -> &[f64] {
        &self.marks
    }

    /// Times at which the waypoints are passed. The flown distances are the lengths of the legs, reduced
    /// by the shortening of the preceding turns and by half of that of the waypoint's own turn.
    pub fn times(&self) -> &[f64] {
        &self.times
    }

    /// Speeds, one for each leg.
    pub fn speeds(&self) -> &[f64] {
        &self.speeds
    }

    /// Leg that contains a path distance.
    pub fn leg_at(&self, distance: f64) -> usize {
        self.marks[1..self.legs()].partition_point(|&mark| mark <= distance)
    }

    /// Position and direction at a path distance; straight extensions before the start and after the end.
    pub fn path(&self, distance: f64) -> ([f64; 2], [f64; 2]) {
        let leg = self.leg_at(distance);
        if leg > 0 && distance < self.starts[leg - 1] + self.turns[leg - 1].arc() {
            return self.turns[leg - 1].at(distance - self.starts[leg - 1]);
        }
        self.turns[leg].at(distance - self.starts[leg])
    }

    /// Path distance of the planned position at a time.
    pub fn distance(&self, time: f64) -> f64 {
        let leg = self.times[1..self.legs()].partition_point(|&t| t <= time);
        self.marks[leg] + self.speeds[leg] * (time - self.times[leg])
    }

    /// Planned time at a path distance.
    pub fn time(&self, distance: f64) -> f64 {
        let leg = self.leg_at(distance);
        self.times[leg] + (distance - self.marks[leg]) / self.speeds[leg]
    }

    /// Position and velocity at a time.
    pub fn at(&self, time: f64) -> ([f64; 2], [f64; 2]) {
        let distance = self.distance(time);
        let (position, course) = self.path(distance);
        let speed = self.speeds[self.leg_at(distance)];
        (position, [speed * course[0], speed * course[1]])
    }

    /// Height at a path distance, interpolated between the waypoints; nan if the plan has none.
    pub fn height(&self, distance: f64) -> f64 {
        if self.heights.is_empty() {
            return f64::NAN;
        }
        let leg = self.leg_at(distance);
        let (begin, end) = (self.marks[leg], self.marks[leg + 1]);
        let share =
            if end > begin { ((distance - begin) / (end - begin)).clamp(0.0, 1.0) } else { 1.0 };
        self.heights[leg] + share * (self.heights[leg + 1] - self.heights[leg])
    }

    /// Point of the path nearest to a position. The first leg is extended backwards and the last one
    /// forwards.
    pub fn project(&self, p: [f64; 2]) -> Projection {
        let mut best = self.nearest_on(0, p);
        for leg in 1..self.legs() {
            let other = self.nearest_on(leg, p);
            if other.cross_track.abs() < best.cross_track.abs() {
                best = other;
            }
        }
        best
    }

    /// Point nearest to a position between the waypoints of a leg.
    pub fn nearest_on(&self, leg: usize, p: [f64; 2]) -> Projection {
        let (turn, last) = (&self.turns[leg], leg + 1 == self.legs());
        // metres to the start of the turn
        let ahead = -dot(minus(p, turn.start), turn.inbound);
        let mut distance = self.starts[leg] - if last { ahead } else { ahead.max(0.0) };
        if leg > 0 {
            let before = self.starts[leg - 1] + self.turns[leg - 1].arc();
            distance = distance.max(before);
        }
        let mut best = self.seen_from(p, distance, leg);
        let arcs = [(leg > 0).then(|| (leg - 1, false)), (!last).then_some((leg, true))];
        for (at, is_before) in arcs.into_iter().flatten() {
            let arc = &self.turns[at];
            // the half of the arc that belongs to this leg
            if arc.arc() > 0.0 && arc.is_before(p) == is_before {
                let (s, _) = arc.project(p);
                if s >= 0.0 && s <= arc.arc() {
                    let other = self.seen_from(p, self.starts[at] + s, leg);
                    if other.cross_track.abs() < best.cross_track.abs() {
                        best = other;
                    }
                }
            }
        }
        best
    }

    fn seen_from(&self, p: Vector, distance: f64, leg: usize) -> Projection {
        let (position, course) = self.path(distance);
        let aside = minus(p, position);
        let cross_track = norm(aside).copysign(-dot(aside, left(course)));
        Projection { along_track: distance, cross_track, course, leg }
    }

    /// Path distance and offset (positive to the right) of a position relative to a leg and the turn at its
    /// end, regardless of the rest of the path.
    pub fn project_leg(&self, leg: usize, p: [f64; 2]) -> (f64, f64) {
        let (s, offset) = self.turns[leg].project(p);
        (self.starts[leg] + s, offset)
    }

    /// Whether an aircraft on a leg, seen once per `update_interval`, has reached the next leg: after the
    /// arc, within 4° of its course and 1500 m of its line, or after the zone of the turn.
    pub fn is_on_next(
        &self,
        leg: usize,
        p: [f64; 2],
        velocity: [f64; 2],
        update_interval: f64,
    ) -> bool {
        if leg + 1 >= self.legs() {
            return false;
        }
        let turn = &self.turns[leg];
        let (s, offset) = turn.project(p);
        let has_turned = between(turn.outbound, velocity).abs() < NEXT_COURSE;
        (s > turn.arc() && has_turned && offset.abs() < NEXT_OFFSET)
            || s > turn.zone_end(norm(velocity), update_interval)
    }

    /// Distance along a leg, distance from its line (positive to the right), and its length.
    pub(super) fn on_leg(&self, leg: usize, p: Vector) -> (f64, f64, f64) {
        let (turn, length) = (&self.turns[leg], self.lengths[leg]);
        let since = minus(p, along(turn.corner, -length, turn.inbound));
        (dot(since, turn.inbound), -dot(since, left(turn.inbound)), length)
    }
}

/// The turns at the ends of the legs, shortened such that the turns at both ends of a leg fit into it.
fn fly_by(waypoints: &[Vector], speeds: &[f64], bank: f64, turn_rate: f64) -> Vec<Turn> {
    let legs = waypoints.len() - 1;
    let turns: Vec<Turn> = (0..legs)
        .map(|j| {
            let (before, corner) = (waypoints[j], waypoints[j + 1]);
            let after = waypoints.get(j + 2).copied().unwrap_or(corner);
            Turn::new(before, corner, after, speeds[j], bank, turn_rate)
        })
        .collect();
    let share = |leg: usize| {
        let needed = turns[leg].lead + leg.checked_sub(1).map_or(0.0, |before| turns[before].lead);
        let length = norm(minus(waypoints[leg + 1], waypoints[leg]));
        if needed > length { length / needed } else { 1.0 }
    };
    (0..legs)
        .map(|j| {
            let part = share(j).min(if j + 1 < legs { share(j + 1) } else { 1.0 });
            if part < 1.0 { turns[j].with_lead(part * turns[j].lead) } else { turns[j] }
        })
        .collect()
}

fn check_waypoints(waypoints: &[Vector]) -> Result<()> {
    require_count("waypoints", waypoints.len(), 2)?;
    for (at, w) in waypoints.iter().enumerate() {
        let refuse = |axis: usize, requirement| {
            let (argument, index, value) = ("waypoints", vec![at, axis], w[axis]);
            Err(Error::InvalidElement { argument, index, value, requirement })
        };
        if let Some(axis) = w.iter().position(|x| x.is_nan() || x.abs() > FARTHEST) {
            return refuse(axis, "it must be a number of at most 1e9 in size");
        }
        if at > 0 && norm(minus(*w, waypoints[at - 1])) == 0.0 {
            return refuse(0, "a waypoint must not be where the one before it is");
        }
    }
    Ok(())
}

fn check_count(argument: &'static str, count: usize, needed: usize) -> Result<()> {
    let requirement = match argument {
        "speeds" => "one for each leg",
        _ => "one for each waypoint",
    };
    require(argument, count as f64, count == needed, requirement)
}

#[cfg(test)]
mod tests {
    use super::*;

    const BANK: f64 = 0.4;

    fn route() -> Route {
        let waypoints =
            [[0.0, 0.0], [0.0, 6e4], [5e4, 9e4], [5.2e4, 1.2e5], [-1e4, 1.3e5], [-1e4, 3e4]];
        let speeds = [220.0, 200.0, 210.0, 150.0, 180.0];
        Route::try_new(&waypoints, &speeds, 100.0, &[], BANK, 0.05).unwrap()
    }

    #[test]
    fn the_path_is_continuous_and_projects_on_itself() {
        let route = route();
        let (mut before, mut course) = route.path(-1000.0);
        let step = 50.0;
        for i in 1..=((route.length() + 2000.0) / step) as usize {
            let distance = i as f64 * step - 1000.0;
            let (p, u) = route.path(distance);
            let moved = norm(minus(p, before));
            assert!(moved <= step * (1.0 + 1e-9) && moved > 0.99 * step, "{distance}: {moved}");
            assert!(between(course, u).abs() < step / 1000.0, "{distance}");
            let found = route.project(p);
            assert!(found.cross_track.abs() < 1e-6, "{distance}: {found:?}");
            // the path crosses itself
            assert!(
                (found.along_track - distance).abs() < 1e-6
                    || norm(minus(route.path(found.along_track).0, p)) < 1e-6
            );
            assert!((route.distance(route.time(distance)) - distance).abs() < 1e-6);
            (before, course) = (p, u);
        }
    }

    #[test]
    fn times_are_kept() {
        let waypoints = [[0.0, 0.0], [0.0, 6e4], [3e4, 6.5e4], [3.2e4, 6.9e4], [9e4, 1e5]];
        assert_kept(&waypoints, &[50.0, 320.0, 480.0, 500.0, 820.0]);
    }

    fn assert_kept(waypoints: &[[f64; 2]], times: &[f64]) {
        let route = Route::through(waypoints, times, &[], BANK, 0.05).unwrap();
        for (a, b) in route.times().iter().zip(times) {
            assert!((a - b).abs() < 1e-9 * b, "{a} is not {b}");
        }
    }

    /// The sharper a turn at the end of a short leg, the more the way depends on the speed.
    #[test]
    fn times_are_kept_in_sharp_turns_after_short_legs() {
        let waypoints = [[0.0, 0.0], [0.0, 3e3], [500.0, 100.0]];
        assert_kept(&waypoints, &[50.0, 65.0, 80.0]);
    }

    #[test]
    fn neighbours_share_their_leg() {
        let waypoints = [[0.0, 0.0], [0.0, 3e4], [1e4, 3e4], [1e4, 6e4]];
        let route = Route::try_new(&waypoints, &[250.0; 3], 0.0, &[], BANK, 0.05).unwrap();
        assert!((route.turn(0).lead - 5000.0).abs() < 1e-6);
        assert!((route.turn(1).lead - 5000.0).abs() < 1e-6);
        let way = 2.5e4 + 2.0 * route.turn(0).arc() + 2.5e4;
        assert!((route.length() - way).abs() < 1e-6);
    }
}
