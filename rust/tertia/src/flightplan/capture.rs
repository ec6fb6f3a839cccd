//! From where an aircraft is, along an arc to the leg that it will fly next.

use super::plane::{between, cross, dot, minus, norm, unit};
use super::turn::{STRAIGHT, Turn};
use crate::distribution::normal_two_sided;

/// The radius of a capture arc, in those of the turn.
const RADII: [f64; 2] = [0.8, 1.6];
/// Less is left of no turn, radians.
const DONE: f64 = 0.01;
/// When turns start: median of the distance to the waypoint in leads, and its log-normal spread.
const START_MEDIAN: f64 = 1.0;
const START_SPREAD: f64 = 0.18;
/// Farther ahead, leads.
const FARTHEST: f64 = 9.0;
/// A turn may always start later.
const CERTAIN: f64 = 0.9;

/// An arc that ends on the leg after a turn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Capture {
    /// ω in rad/s, positive to the left; 0 where nothing is left of the turn.
    pub turn_rate: f64,
    /// The radius that is flown: the tangent one, between 0.8 and 1.6 times that of the turn.
    pub radius: f64,
    /// The radius of the arc tangent to the present course and to the leg; no bounds, any sign.
    pub tangent_radius: f64,
    /// What is left of the turn, radians, positive to the left.
    pub remaining: f64,
    /// How long the arc goes on within the next scan, seconds; it is straight after that.
    pub time: f64,
}

/// The arc from a state to the leg after the turn: `rem = c₂ − ψ`, `c = ((B − p) × u₂)/(u × u₂)`,
/// `R_c = c / tan(|rem|/2)`, `ω = sgn(rem) V/R_c`. There is none where less than 0.01 rad is left or
/// the aircraft would have to turn to the other side.
pub fn capture(turn: &Turn, position: [f64; 2], velocity: [f64; 2], period: f64) -> Capture {
    let Some(u) = unit(velocity) else {
        let radius = RADII[0] * turn.full_radius;
        return Capture {
            turn_rate: 0.0,
            radius,
            tangent_radius: radius,
            remaining: 0.0,
            time: 0.0,
        };
    };
    let remaining = between(u, turn.outbound);
    let ahead = cross(minus(turn.corner, position), turn.outbound) / cross(u, turn.outbound);
    let tangent_radius = ahead / (0.5 * remaining.abs()).tan();
    // in this order nan becomes the lower bound
    let [low, high] = RADII.map(|factor| factor * turn.full_radius);
    let radius = tangent_radius.max(low).min(high);
    let is_done = remaining.abs() < DONE || remaining * turn.angle <= 0.0 || radius <= 0.0;
    let (turn_rate, time) = if is_done {
        (0.0, 0.0)
    } else {
        let rate = norm(velocity) / radius;
        (rate.copysign(remaining), period.min(remaining.abs() / rate))
    };
    Capture { turn_rate, radius, tangent_radius, remaining, time }
}

/// Where an aircraft will be a scan later, before the waypoint, in leads:
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

/// Probability that a turn starts now, if it has not before: `h = min(0.9, 1 − F(r)/F(r before))`,
/// with F log-normal of median 1 and spread 0.18, of the ratios of [`lead_ratio`] at this scan and
/// the one before (9 at the first); 0 where at most 4° remain.
pub fn start_hazard(before: f64, now: f64, remaining: f64) -> f64 {
    if remaining.abs() <= STRAIGHT {
        return 0.0;
    }
    let not_yet = |ratio: f64| 0.5 * normal_two_sided(-(ratio / START_MEDIAN).ln() / START_SPREAD);
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
        // on the arc itself, the capture arc is the rest of it
        assert!((found.radius / turn.radius - 1.0).abs() < 1e-9);
        assert!((found.time * 200.0 / (0.8 * turn.arc()) - 1.0).abs() < 1e-9);
        assert!(found.turn_rate < 0.0);
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
        // flown with the largest radius
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
            let found = start_hazard(before, now, -1.0);
            assert!((found - expected).abs() < 1e-10, "{before}, {now}: {found}");
        }
        assert_eq!(start_hazard(1.2, 1.0, 0.06), 0.0);
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
                assert!((0.0..=0.9).contains(&start_hazard(before, now, 1.0)));
            }
        }
    }
}
