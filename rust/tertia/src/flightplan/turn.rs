//! Fly-by turns, whose arc is tangent to both legs.

use super::plane::{Vector, along, between, dot, left, minus, norm, turned, unit};
use serde::{Deserialize, Serialize};

/// Standard gravity, m/s².
const GRAVITY: f64 = 9.80665;
/// Smallest angle of a turn, 4°; smaller ones count as straight.
pub(super) const STRAIGHT: f64 = 4.0 * std::f64::consts::PI / 180.0;
/// Angle with the longest lead, 150°. Sharper turns have the same lead, which would otherwise be unbounded.
const SHARPEST: f64 = 150.0 * std::f64::consts::PI / 180.0;
/// Largest radius, m: larger ones would be practically straight, and the limit keeps numbers finite.
const LARGEST_RADIUS: f64 = 1e9;
/// Extent of the zone before the start and after the end of the turn, in leads.
const ZONE_BEFORE: f64 = 0.7;
const ZONE_AFTER: f64 = 0.4;
/// Additional extent of the zone on both sides, in scans.
const ZONE_SCANS: f64 = 2.0;

/// A turn from one leg to the next. Its path has a coordinate s: negative before the arc, 0 to
/// [`Turn::arc`] on it, larger after it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Turn {
    /// The waypoint B.
    pub corner: [f64; 2],
    /// Direction of the leg before the turn, u₁, of length 1.
    pub inbound: [f64; 2],
    /// Direction of the leg after the turn, u₂, of length 1.
    pub outbound: [f64; 2],
    /// θ, radians, positive to the left, in (−π, π].
    pub angle: f64,
    /// Radius that results from speed, bank and rate of turn: `max(V²/(g tan bank), V/ω)`.
    pub full_radius: f64,
    /// Radius R of the arc: smaller than the full radius if the legs are too short or the turn is too sharp.
    pub radius: f64,
    /// Distance of the start and the end of the arc from the waypoint: `d = R tan(|θ|/2)`.
    pub lead: f64,
    /// Start of the arc, `B − d u₁`.
    pub start: [f64; 2],
    /// End of the arc, `B + d u₂`.
    pub end: [f64; 2],
    /// Centre of the arc.
    pub centre: [f64; 2],
}

impl Turn {
    /// Creates the turn at `corner` on the way from `before` to `after`, at this speed (m/s), with this bank
    /// (rad, positive) and at most this rate (rad/s, positive).
    ///
    /// The lead is never longer than the shorter leg, and never longer than that of a turn of 150°;
    /// a limited arc is tangent to both legs with a smaller radius. A leg of length 0 gets the direction of
    /// the other one. The result is finite for all finite arguments.
    pub fn new(
        before: [f64; 2],
        corner: [f64; 2],
        after: [f64; 2],
        speed: f64,
        bank: f64,
        turn_rate: f64,
    ) -> Self {
        let (first, second) = (minus(corner, before), minus(after, corner));
        let (inbound, outbound) = match (unit(first), unit(second)) {
            (Some(u1), Some(u2)) => (u1, u2),
            (Some(u), None) | (None, Some(u)) => (u, u),
            (None, None) => ([0.0, 1.0], [0.0, 1.0]),
        };
        let angle = between(inbound, outbound);
        // R = max(V²/(g tan bank), V/ω)
        let allowed = (speed * speed / (GRAVITY * bank.tan())).max(speed / turn_rate);
        let full_radius = allowed.min(LARGEST_RADIUS);
        let lead = full_radius * (0.5 * angle.abs().min(SHARPEST)).tan();
        let turn = Self {
            corner,
            inbound,
            outbound,
            angle,
            full_radius,
            radius: full_radius,
            lead,
            start: corner,
            end: corner,
            centre: corner,
        };
        turn.with_lead(lead.min(norm(first)).min(norm(second)))
    }

    /// Returns the same turn with an arc that starts at this distance before the waypoint.
    pub(super) fn with_lead(self, lead: f64) -> Self {
        let half = 0.5 * self.angle.abs();
        // exact if the lead is not limited
        let is_full = half <= 0.5 * SHARPEST && lead == self.full_radius * half.tan();
        let radius = if is_full { self.full_radius } else { lead / half.tan() };
        let start = along(self.corner, -lead, self.inbound);
        Self {
            lead,
            radius,
            start,
            // T₂ = B + d u₂
            end: along(self.corner, lead, self.outbound),
            // T₁ + sgn θ R n₁
            centre: along(start, self.sign() * radius, left(self.inbound)),
            ..self
        }
    }

    /// 1 to the left, −1 to the right.
    fn sign(&self) -> f64 {
        if self.angle < 0.0 { -1.0 } else { 1.0 }
    }

    /// Length of the arc, R|θ|.
    pub fn arc(&self) -> f64 {
        self.radius * self.angle.abs()
    }

    /// Position and direction at the path coordinate `s`.
    pub fn at(&self, s: f64) -> ([f64; 2], [f64; 2]) {
        let arc = self.arc();
        if s <= 0.0 {
            return (along(self.start, s, self.inbound), self.inbound);
        }
        if s >= arc {
            return (along(self.end, s - arc, self.outbound), self.outbound);
        }
        let swept = s / self.radius;
        // T₁ + R sin φ u₁ + sgn θ R (1 − cos φ) n₁
        let ahead = along(self.start, self.radius * swept.sin(), self.inbound);
        let aside = self.sign() * 2.0 * self.radius * (0.5 * swept).sin().powi(2);
        (along(ahead, aside, left(self.inbound)), turned(self.inbound, self.sign() * swept))
    }

    /// Path coordinate of a point, and its distance from the path, positive to the right. Before the
    /// bisector, the path is the first leg and the arc; after it, the arc and the second leg.
    pub fn project(&self, p: [f64; 2]) -> (f64, f64) {
        let s = self.coordinate(p);
        let (position, course) = self.at(s);
        (s, -dot(minus(p, position), left(course)))
    }

    fn coordinate(&self, p: Vector) -> f64 {
        let arc = self.arc();
        let swept = || {
            // angle at the centre, from the start of the arc
            let angle = between(minus(self.start, self.centre), minus(p, self.centre));
            (self.radius * self.sign() * angle).clamp(0.0, arc)
        };
        if self.is_before(p) {
            let ahead = dot(minus(p, self.start), self.inbound);
            if ahead < 0.0 { ahead } else { swept() }
        } else {
            let ahead = dot(minus(p, self.end), self.outbound);
            if ahead > 0.0 { arc + ahead } else { swept() }
        }
    }

    /// Whether a point is before the bisector, `(p − B)·(u₁ + u₂) < 0`.
    pub(super) fn is_before(&self, p: Vector) -> bool {
        dot(minus(p, self.corner), turned(self.inbound, 0.5 * self.angle)) < 0.0
    }

    /// Whether an aircraft at `s`, with this speed and seen once per `update_interval`, is in the zone of a
    /// turn of more than 4°: `−(0.7 d + 2VT) < s < R|θ| + 0.4 d + 2VT`.
    pub fn in_zone(&self, s: f64, speed: f64, update_interval: f64) -> bool {
        let begin = -(ZONE_BEFORE * self.lead + ZONE_SCANS * speed * update_interval);
        self.angle.abs() > STRAIGHT && begin < s && s < self.zone_end(speed, update_interval)
    }

    /// End of the zone.
    pub(super) fn zone_end(&self, speed: f64, update_interval: f64) -> f64 {
        self.arc() + ZONE_AFTER * self.lead + ZONE_SCANS * speed * update_interval
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BANK: f64 = 25.0 * std::f64::consts::PI / 180.0;
    const RATE: f64 = 3.0 * std::f64::consts::PI / 180.0;

    fn turn(corner: Vector, after: Vector) -> Turn {
        Turn::new([0.0, 0.0], corner, after, 220.0, BANK, RATE)
    }

    /// Properties of every turn: it is tangent to both legs and continuous, and its points project to
    /// themselves.
    fn check(turn: &Turn) {
        let numbers = [turn.angle, turn.radius, turn.lead, turn.arc()];
        assert!(numbers.iter().all(|x| x.is_finite()), "{turn:?}");
        assert!(turn.radius <= turn.full_radius * (1.0 + 1e-12), "{turn:?}");
        let (a, b) = (turn.at(0.0).0, turn.at(1e-9).0);
        assert!(norm(minus(a, b)) < 1e-6, "{turn:?}");
        let (a, b) = (turn.at(turn.arc()).0, turn.at(turn.arc() - 1e-9).0);
        assert!(norm(minus(a, b)) < 1e-6, "{turn:?}");
        for s in [-500.0, 0.0, 0.3 * turn.arc(), 0.9 * turn.arc(), turn.arc() + 500.0] {
            let (p, course) = turn.at(s);
            assert!((norm(course) - 1.0).abs() < 1e-12);
            let (found, offset) = turn.project(p);
            assert!(offset.abs() < 1e-6, "{turn:?}: {offset}");
            // both legs of a hairpin lie on the same line
            if turn.angle.abs() < 3.0 {
                assert!((found - s).abs() < 1e-6, "{turn:?}: {found} is not {s}");
            }
        }
    }

    #[test]
    fn turns_of_every_kind() {
        for degrees in [0.0_f64, 1e-7, 0.5, -5.0, 60.0, -90.0, 135.0, -149.0, 155.0, 179.0, 180.0] {
            for length in [1.0, 2000.0, 40_000.0, 1e6] {
                let (sine, cosine) = degrees.to_radians().sin_cos();
                check(&turn([0.0, 30_000.0], [-length * sine, 30_000.0 + length * cosine]));
            }
        }
        check(&turn([0.0, 0.0], [0.0, 0.0]));
        check(&turn([0.0, 0.0], [1000.0, 0.0]));
        check(&turn([1000.0, 0.0], [1000.0, 0.0]));
        check(&Turn::new([0.0, 0.0], [0.0, 1e4], [1e4, 1e4], 0.0, BANK, RATE));
        check(&Turn::new([0.0, 0.0], [0.0, 1e4], [1e4, 1e4], 200.0, 1e-12, RATE));
    }

    #[test]
    fn short_legs_make_the_arc_smaller() {
        let short = turn([0.0, 3000.0], [10_000.0, 3000.0]);
        assert_eq!(short.lead, 3000.0);
        assert!((short.radius - 3000.0).abs() < 1e-9 && short.full_radius > 10_000.0);
    }
}
