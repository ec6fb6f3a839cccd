//! Capture arcs, from the position of an aircraft to the leg that it will fly next.

use super::plane::{along, between, cross, dot, minus, norm, turned, unit};
use super::turn::{STRAIGHT, Turn};
use crate::base::distribution::normal_two_sided;

/// Smallest and largest radius of a capture arc, relative to the radius of the turn.
const RADII: [f64; 2] = [0.8, 1.6];
/// A turn with a smaller remaining angle than this is finished, radians.
const DONE: f64 = 0.01;
/// Sigma of the log-normal distribution of the distance to the waypoint at which turns start.
const START_SPREAD: f64 = 0.18;
/// Smallest and largest lead in wind, relative to the lead without wind.
const LEADS: [f64; 2] = [0.3, 3.0];
/// Largest lead ratio.
const FARTHEST: f64 = 9.0;
/// Largest probability that a turn starts now; it may always start later.
const CERTAIN: f64 = 0.9;

/// A circular arc that ends on the leg after a turn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Capture {
    /// ω in rad/s, positive to the left; 0 if the turn is finished.
    pub turn_rate: f64,
    /// Radius of the arc: the tangent radius, limited to 0.8 to 1.6 times that of the turn.
    pub radius: f64,
    /// Radius of the arc that is tangent to the present course and to the leg; without limits, of either
    /// sign.
    pub tangent_radius: f64,
    /// Remaining angle of the turn, radians, positive to the left.
    pub remaining: f64,
    /// Duration of the arc within the next scan, seconds; after that the path is straight.
    pub time: f64,
}

/// The arc from a state to the leg after the turn: `rem = c₂ − ψ`, `c = ((B − p) × u₂)/(u × u₂)`,
/// `R_c = c / tan(|rem|/2)`, `ω = sgn(rem) V/R_c`. There is no arc if less than 0.01 rad remains or if
/// the aircraft would have to turn to the other side.
pub fn capture(turn: &Turn, position: [f64; 2], velocity: [f64; 2], period: f64) -> Capture {
    capture_in_wind(turn, position, velocity, [0.0; 2], period)
}

/// The arc of [`capture`] in wind: the aircraft turns relative to the air, until its course over the
/// ground is that of the leg. The given velocity is that over the ground; radii and rates are those in the
/// air: `R_c = ((B − p) × u₂)/(D × u₂)`, where D is the path over the ground in radii,
/// `D = 2 sin(|rem|/2) u(rem/2) + |rem| w/V`.
pub fn capture_in_wind(
    turn: &Turn,
    position: [f64; 2],
    velocity: [f64; 2],
    wind: [f64; 2],
    period: f64,
) -> Capture {
    let air = minus(velocity, wind);
    let speed = norm(air);
    let Some(u) = unit(air) else {
        let radius = RADII[0] * turn.full_radius;
        return Capture {
            turn_rate: 0.0,
            radius,
            tangent_radius: radius,
            remaining: 0.0,
            time: 0.0,
        };
    };
    let remaining = between(u, heading(turn.outbound, wind, speed));
    let way = way(u, remaining, wind, speed);
    let ahead = cross(minus(turn.corner, position), turn.outbound);
    let tangent_radius = ahead / cross(way, turn.outbound);
    // in this order of the operations, nan becomes the lower bound
    let [low, high] = RADII.map(|factor| factor * turn.full_radius);
    let radius = tangent_radius.max(low).min(high);
    let is_done = remaining.abs() < DONE || remaining * turn.angle <= 0.0 || radius <= 0.0;
    let (turn_rate, time) = if is_done {
        (0.0, 0.0)
    } else {
        let rate = speed / radius;
        (rate.copysign(remaining), period.min(remaining.abs() / rate))
    };
    Capture { turn_rate, radius, tangent_radius, remaining, time }
}

/// Heading for a course over the ground in wind; the course itself if the wind is too strong for it.
fn heading(course: [f64; 2], wind: [f64; 2], speed: f64) -> [f64; 2] {
    let across = cross(course, wind) / speed;
    if across.abs() < 1.0 { turned(course, -across.asin()) } else { course }
}

/// Path over the ground in a turn by an angle from a heading, in radii.
fn way(from: [f64; 2], angle: f64, wind: [f64; 2], speed: f64) -> [f64; 2] {
    let drift = angle.abs() / speed;
    let chord = 2.0 * (0.5 * angle.abs()).sin();
    along([drift * wind[0], drift * wind[1]], chord, turned(from, 0.5 * angle))
}

/// Distance before the waypoint at which a turn must begin to end on the next leg, in wind, at this
/// airspeed: `R (D × u₂)/(u₁ × u₂)`, see [`capture_in_wind`]. Without wind it is the lead of the turn;
/// in wind it is limited to between 0.3 and 3 times this lead.
pub fn lead_in_wind(turn: &Turn, wind: [f64; 2], speed: f64) -> f64 {
    if wind == [0.0; 2] || speed <= norm(wind) {
        return turn.lead;
    }
    let first = heading(turn.inbound, wind, speed);
    let angle = between(first, heading(turn.outbound, wind, speed));
    let way = way(first, angle, wind, speed);
    let lead = turn.radius * cross(way, turn.outbound) / cross(turn.inbound, turn.outbound);
    // in this order of the operations, nan (legs in line) becomes the lower bound
    lead.max(LEADS[0] * turn.lead).min(LEADS[1] * turn.lead)
}

/// Distance before the waypoint at which an aircraft will be one scan later, in leads:
/// `((B − p)·u₁ − V T)/d`, from 0 to 9.
pub fn lead_ratio(turn: &Turn, position: [f64; 2], speed: f64, period: f64) -> f64 {
    let ahead = dot(minus(turn.corner, position), turn.inbound) - speed * period;
    if turn.lead > 0.0 {
        (ahead / turn.lead).clamp(0.0, FARTHEST)
    } else if ahead > 0.0 {
        FARTHEST
    } else {
        0.0
    }
}

/// Probability that a turn starts now if it has not started before: `h = min(0.9, 1 − F(r)/F(r before))`.
/// F is log-normal with this median and spread 0.18; the arguments are the [`lead_ratio`] at this scan and
/// at the one before (9 at the first scan). The probability is 0 if at most 4° remain.
pub(crate) fn hazard(before: f64, now: f64, remaining: f64, median: f64) -> f64 {
    if remaining.abs() <= STRAIGHT {
        return 0.0;
    }
    let not_yet = |ratio: f64| 0.5 * normal_two_sided(-(ratio / median).ln() / START_SPREAD);
    let (earlier, later) = (not_yet(before), not_yet(now));
    if earlier > 0.0 { (1.0 - later / earlier).clamp(0.0, CERTAIN) } else { CERTAIN }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_arc_ends_on_the_leg() {
        let turn = Turn::new([0.0, 0.0], [0.0, 5e4], [9e4, 1e5], 200.0, 0.4, 0.05);
        let (p, course) = turn.at(0.2 * turn.arc());
        let v = [200.0 * course[0], 200.0 * course[1]];
        let found = capture(&turn, p, v, 1e4);
        // on the arc of the turn, the capture arc is the rest of this arc
        assert!((found.radius / turn.radius - 1.0).abs() < 1e-9);
        assert!((found.time * 200.0 / (0.8 * turn.arc()) - 1.0).abs() < 1e-9);
        assert!(found.turn_rate < 0.0);
    }

    #[test]
    fn the_arc_in_the_wind_ends_on_the_leg() {
        let turn = Turn::new([0.0, 0.0], [0.0, 5e4], [9e4, 1e5], 200.0, 0.4, 0.05);
        for wind in [[0.0; 2], [30.0, -10.0], [-25.0, 20.0]] {
            let fly = |from: [f64; 2], air: [f64; 2], rate: f64, time: f64| {
                let (mut p, steps) = (from, 20_000);
                let h = time / f64::from(steps);
                for k in 0..steps {
                    let v = turned(air, rate * h * (f64::from(k) + 0.5));
                    p = along(along(p, h, v), h, wind);
                }
                (p, along(turned(air, rate * time), 1.0, wind))
            };
            // from the point at which a turn with the radius of the plan begins, along the leg
            let air = [-wind[0], (200.0_f64.powi(2) - wind[0] * wind[0]).sqrt()];
            let lead = lead_in_wind(&turn, wind, 200.0);
            let p = along(turn.corner, -lead, turn.inbound);
            let found = capture_in_wind(&turn, p, along(air, 1.0, wind), wind, 1e4);
            assert!((found.radius / turn.radius - 1.0).abs() < 1e-9, "{wind:?}: {found:?}");
            let (end, course) = fly(p, air, found.turn_rate, found.time);
            let aside = cross(minus(end, turn.corner), turn.outbound);
            assert!(aside.abs() < 1e-3, "{wind:?}: {aside}");
            assert!(between(course, turn.outbound).abs() < 1e-9);
        }
        assert_eq!(lead_in_wind(&turn, [0.0; 2], 200.0), turn.lead);
        let straight = Turn::new([0.0, 0.0], [0.0, 5e4], [0.0, 9e4], 200.0, 0.4, 0.05);
        assert!(lead_in_wind(&straight, [20.0, 0.0], 200.0).is_finite());
        let becalmed = capture_in_wind(&turn, [0.0; 2], [20.0, 0.0], [20.0, 0.0], 4.0);
        assert!(becalmed.turn_rate == 0.0 && becalmed.radius.is_finite());
    }

    #[test]
    fn vectors() {
        let bearing = |degrees: f64| [degrees.to_radians().sin(), degrees.to_radians().cos()];
        let [east, north] = bearing(60.0);
        let after = [9e4 * east, 5e4 + 9e4 * north];
        let (bank, rate) = (25_f64.to_radians(), 3_f64.to_radians());
        let turn = Turn::new([0.0, 0.0], [0.0, 5e4], after, 220.0, bank, rate);
        let [east, north] = bearing(10.0);
        let found = capture(&turn, [500.0, 4e4], [220.0 * east, 220.0 * north], 4.0);
        assert!((found.tangent_radius - 24_943.854_915_070_2).abs() < 1e-8);
        let tangent_rate = (220.0 / found.tangent_radius).to_degrees();
        assert!((tangent_rate - 0.505_337_748_9).abs() < 1e-10);
        // the turn is flown with the largest radius
        assert_eq!(found.radius, 1.6 * turn.full_radius);
        assert!((found.turn_rate + 220.0 / found.radius).abs() < 1e-15);
        let hazards = [
            (9.0, 1.4, 0.030_791_225_2),
            (1.4, 1.2, 0.128_726_988_8),
            (1.2, 1.0, 0.407_895_440_3),
            (1.0, 0.8, 0.784_908_589_2),
            (0.8, 0.6, 0.9),
        ];
        for (before, now, expected) in hazards {
            let found = hazard(before, now, -1.0, 1.0);
            assert!((found - expected).abs() < 1e-10, "{before}, {now}: {found}");
        }
        assert_eq!(hazard(1.2, 1.0, 0.06, 1.0), 0.0);
        let ratio = lead_ratio(&turn, [0.0, 4e4], 220.0, 4.0);
        assert!((ratio - (1e4 - 880.0) / turn.lead).abs() < 1e-12);
    }

    #[test]
    fn nothing_is_nan() {
        let turn = Turn::new([0.0, 0.0], [0.0, 5e4], [0.0, 0.0], 200.0, 0.4, 0.05);
        for velocity in [[0.0, 0.0], [0.0, 200.0], [0.0, -200.0], [200.0, 0.0]] {
            for position in [[0.0, 0.0], [0.0, 5e4], [100.0, 6e4]] {
                let c = capture(&turn, position, velocity, 4.0);
                assert!(c.turn_rate.is_finite() && c.radius.is_finite() && c.time >= 0.0);
                let r = lead_ratio(&turn, position, 200.0, 4.0);
                assert!((0.0..=9.0).contains(&r));
            }
        }
        for before in [0.0, 1e-9, 1.0, 9.0] {
            for now in [0.0, 1e-9, 1.0, 9.0] {
                assert!((0.0..=0.9).contains(&hazard(before, now, 1.0, 1.0)));
            }
        }
    }
}
