//! Correlation of tracks with plans: by identity, or by position, course, speed and time.

use super::plane::{Vector, between, dot, left, norm, unit};
use super::route::Route;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Standard deviations of flights from their plans: cross-track (m), course (rad), speed (m/s), time (s)
/// and height (m).
const OFFSET_SIGMA: f64 = 700.0;
const COURSE_SIGMA: f64 = 3.0 * PI / 180.0;
const SPEED_SIGMA: f64 = 12.0;
const TIME_SIGMA: f64 = 120.0;
const HEIGHT_SIGMA: f64 = 150.0;
/// Largest distance from its planned position, in standard deviations, at which a flight is expected.
const FARTHEST: f64 = 4.0;
/// Smallest score of a plan with the same identity as the track, and of other plans.
const LEAST_SAME: f64 = -25.0;
const LEAST: f64 = -8.0;
/// Required margin to the second-best plan, and required number of plots.
const MARGIN: f64 = 3.0;
const PLOTS: usize = 5;
/// Number of successive low scores after which a link is dropped.
const LOW_SCANS: u32 = 5;

/// State of a track at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sighting {
    /// Time, s.
    pub time: f64,
    /// Position, east and north, m.
    pub position: [f64; 2],
    /// Velocity, m/s.
    pub velocity: [f64; 2],
    /// Variances of the position along and across the course, m².
    pub position_variance: [f64; 2],
    /// Variance of the course, rad².
    pub course_variance: f64,
    /// Variance of the speed, m²/s².
    pub speed_variance: f64,
    /// Height, m; nan if it is not known.
    pub height: f64,
}

impl Sighting {
    /// Creates a sighting. The covariance of east, north and their rates is given row by row, or not at all.
    pub fn new(
        time: f64,
        position: [f64; 2],
        velocity: [f64; 2],
        covariance: Option<&[f64; 16]>,
        height: f64,
    ) -> Self {
        let course = unit(velocity).unwrap_or([0.0, 1.0]);
        let variance = |first: usize, u: Vector| {
            covariance.map_or(0.0, |p| {
                let at = |i: usize, j: usize| p[4 * (first + i) + first + j];
                let rows = [dot([at(0, 0), at(0, 1)], u), dot([at(1, 0), at(1, 1)], u)];
                dot(rows, u).max(0.0)
            })
        };
        let speed = norm(velocity);
        let aside = variance(2, left(course));
        Self {
            time,
            position,
            velocity,
            position_variance: [variance(0, course), variance(0, left(course))],
            course_variance: if speed > 0.0 { aside / (speed * speed) } else { PI * PI },
            speed_variance: variance(2, course),
            height,
        }
    }

    /// Whether there is a sighting at this instant; a track may have gaps.
    pub fn is_present(&self) -> bool {
        let numbers = [self.time, self.position[0], self.position[1]];
        numbers.iter().chain(&self.velocity).all(|x| x.is_finite())
    }
}

/// Score of a sighting for a plan, at most 0, on the leg that fits best:
/// `L = −½ [e²/(700² + P) + Δψ²/(3°² + σψ²) + ΔV²/(12² + σV²) + Δt²/120² + Δh²/150²]`, with the last term
/// only if both have a height. O(legs).
pub fn score(route: &Route, seen: &Sighting) -> f64 {
    let speed = norm(seen.velocity);
    let mut best = f64::NEG_INFINITY;
    for leg in 0..route.legs() {
        let near = route.nearest_on(leg, seen.position);
        let term =
            |error: f64, sigma: f64, variance: f64| error * error / (sigma * sigma + variance);
        let mut sum = term(near.cross_track, OFFSET_SIGMA, seen.position_variance[1]);
        let course = between(near.course, seen.velocity);
        sum += term(course, COURSE_SIGMA, seen.course_variance);
        sum += term(speed - route.speeds()[leg], SPEED_SIGMA, seen.speed_variance);
        sum += term(seen.time - route.time(near.along_track), TIME_SIGMA, 0.0);
        let height = route.height(near.along_track) - seen.height;
        if !height.is_nan() {
            sum += term(height, HEIGHT_SIGMA, 0.0);
        }
        best = best.max(-0.5 * sum);
    }
    best
}

/// Whether a flight can be under way at a time, including early and late flights.
pub fn is_due(route: &Route, time: f64) -> bool {
    let [first, .., last] = route.times() else { return false };
    (first - FARTHEST * TIME_SIGMA..=last + FARTHEST * TIME_SIGMA).contains(&time)
}

/// Expectation of a flight at a time and a position.
pub struct Due {
    /// Probability density of the flight at this position, 1/m².
    pub density: f64,
    /// Half the squared distance from the planned position, in standard deviations.
    pub square: f64,
    pub velocity: Vector,
}

/// Returns the expectation of a flight at a time and a position, with sigmas of 700 m across its route and
/// 120 s along it; `None` far from the flight. O(legs).
pub fn expected(route: &Route, time: f64, position: Vector) -> Option<Due> {
    let due = route.distance(time);
    let (place, _) = route.path(due);
    let along_sigma = TIME_SIGMA * route.speeds()[route.leg_at(due)];
    let away = norm([position[0] - place[0], position[1] - place[1]]);
    if away > FARTHEST * (along_sigma + OFFSET_SIGMA) {
        return None;
    }
    let near = route.project(position);
    let along = (near.along_track - due) / along_sigma;
    let aside = near.cross_track / OFFSET_SIGMA;
    if along.abs() > FARTHEST || aside.abs() > FARTHEST {
        return None;
    }
    let speed = route.speeds()[near.leg];
    let square = 0.5 * (along * along + aside * aside);
    let density = (-square).exp() / (2.0 * PI * along_sigma * OFFSET_SIGMA);
    Some(Due { density, square, velocity: near.course.map(|part| speed * part) })
}

/// Density (1/m²) at a position for a flight anywhere along a route, with a sigma of 700 m across it.
/// O(legs).
pub fn along(route: &Route, position: Vector) -> f64 {
    let near = route.project(position);
    let aside = near.cross_track / OFFSET_SIGMA;
    if !(0.0..=route.length()).contains(&near.along_track) || aside.abs() > FARTHEST {
        return 0.0;
    }
    (-0.5 * aside * aside).exp() / ((2.0 * PI).sqrt() * OFFSET_SIGMA * route.length())
}

/// Computes the mean scores of plans over the sightings that are present (nan if there are none), and returns
/// the number of these sightings.
///
/// # Panics
/// If there is not one score for each route.
pub fn mean_scores(routes: &[&Route], seen: &[Sighting], scores: &mut [f64]) -> usize {
    let present = || seen.iter().filter(|seen| seen.is_present());
    let count = present().count();
    for (route, mean) in routes.iter().zip(scores) {
        *mean = present().map(|seen| score(route, seen)).sum::<f64>() / count as f64;
    }
    count
}

/// Reason for the plan of a track.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Status {
    /// No plan fits.
    None = 0,
    /// More than one plan fits, or the track is too short for a decision.
    Ambiguous = 1,
    /// One plan fits, and no other fits nearly as well.
    Accepted = 2,
    /// A plan has the same identity and fits well enough.
    Linked = 3,
    /// A controller chose the plan.
    Manual = 4,
}

/// Decision on the plan of a track.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Decision {
    /// Index of the plan, if accepted or linked.
    pub plan: Option<usize>,
    /// Reason for the decision.
    pub status: Status,
}

/// Decides by the mean scores of plans over this number of plots, and by which plans have the identity of
/// the track. Such a plan is linked if its score exceeds −25. Otherwise the best plan is accepted if its
/// score exceeds −8 and that of the second best by at least 3, with 5 plots or more.
pub fn decide(scores: &[f64], is_same: impl Fn(usize) -> bool, plots: usize) -> Decision {
    let best_of = |allowed: &dyn Fn(usize) -> bool| {
        (0..scores.len())
            .filter(|&i| allowed(i) && !scores[i].is_nan())
            .max_by(|&a, &b| scores[a].total_cmp(&scores[b]))
    };
    if let Some(plan) = best_of(&is_same).filter(|&plan| scores[plan] > LEAST_SAME) {
        return Decision { plan: Some(plan), status: Status::Linked };
    }
    let Some(best) = best_of(&|_| true).filter(|&plan| scores[plan] > LEAST) else {
        return Decision { plan: None, status: Status::None };
    };
    let next = best_of(&|i| i != best).map_or(f64::NEG_INFINITY, |plan| scores[plan]);
    if plots >= PLOTS && scores[best] - next >= MARGIN {
        Decision { plan: Some(best), status: Status::Accepted }
    } else {
        Decision { plan: None, status: Status::Ambiguous }
    }
}

/// Checks whether the link of a track to its plan still holds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Link {
    low: u32,
}

impl Link {
    /// Adds the score of a scan. Returns false if the identity of the track has changed, or if the score was
    /// below −25 for 5 successive scans.
    pub fn holds(&mut self, score: f64, has_changed: bool) -> bool {
        self.low = if score < LEAST_SAME { self.low + 1 } else { 0 };
        !has_changed && self.low < LOW_SCANS
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn route(north: f64) -> Route {
        let waypoints = [[0.0, north], [1e5, north]];
        Route::try_new(&waypoints, &[200.0], 0.0, &[9000.0; 2], 0.4, 0.05).unwrap()
    }

    #[test]
    fn the_score_by_hand() {
        let seen = Sighting::new(160.0, [2e4, 1400.0], [224.0, 0.0], None, 9150.0);
        // 1400/700, 0, 24/12, 60/120, 150/150
        let expected = -0.5 * (4.0 + 4.0 + 0.25 + 1.0);
        assert!((score(&route(0.0), &seen) - expected).abs() < 1e-12);
        let p = [4e4, 0.0, 0.0, 0.0, 0.0, 7e5, 0.0, 0.0, 0.0, 0.0, 9.0, 0.0, 0.0, 0.0, 0.0, 50.0];
        let seen = Sighting::new(100.0, [2e4, 1400.0], [200.0, 0.0], Some(&p), f64::NAN);
        assert_eq!(seen.position_variance, [4e4, 7e5]);
        assert_eq!((seen.speed_variance, seen.course_variance), (9.0, 50.0 / 4e4));
        let expected = -0.5 * 1400.0_f64.powi(2) / (700.0_f64.powi(2) + 7e5);
        assert!((score(&route(0.0), &seen) - expected).abs() < 1e-12);
    }

    #[test]
    fn a_flight_is_expected_about_where_it_is_due() {
        let route = route(0.0);
        let Due { density, square, velocity } =
            expected(&route, 100.0, [2e4 + 24e3, -700.0]).unwrap();
        assert!((square - 1.0).abs() < 1e-12);
        assert!((velocity[0] - 200.0).abs() < 1e-9 && velocity[1].abs() < 1e-9);
        let highest = 1.0 / (2.0 * PI * 700.0 * 24e3);
        assert!((density / highest - (-1.0_f64).exp()).abs() < 1e-12);
        assert!(expected(&route, 100.0, [2e4, 2900.0]).is_none());
        assert!(expected(&route, 100.0, [12e4, 0.0]).is_none());
        let steps = |n: i32, size: f64| (-n..=n).map(move |k| f64::from(k) * size);
        let total: f64 = steps(50, 2000.0)
            .flat_map(|x| steps(60, 50.0).map(move |y| [5e4 + x, y]))
            .filter_map(|z| expected(&route, 250.0, z))
            .map(|due| due.density * 1e5)
            .sum();
        assert!((total - 1.0).abs() < 1e-3, "{total}");
        let total: f64 = steps(60, 2000.0)
            .flat_map(|x| steps(60, 50.0).map(move |y| [5e4 + x, y]))
            .map(|z| along(&route, z) * 1e5)
            .sum();
        assert!((total - 1.0).abs() < 0.03, "{total}");
        assert!(is_due(&route, -480.0) && is_due(&route, 980.0) && !is_due(&route, 981.0));
    }

    #[test]
    fn decisions() {
        let decided = |scores: &[f64], same: &[usize], plots| {
            let found = decide(scores, |i| same.contains(&i), plots);
            (found.plan, found.status)
        };
        assert_eq!(decided(&[-1.0, -4.1], &[], 5), (Some(0), Status::Accepted));
        assert_eq!(decided(&[-1.0, -4.1], &[], 4), (None, Status::Ambiguous));
        assert_eq!(decided(&[-1.0, -3.9], &[], 5), (None, Status::Ambiguous));
        assert_eq!(decided(&[-8.1, -30.0], &[], 9), (None, Status::None));
        assert_eq!(decided(&[-1.0, -24.9], &[1], 1), (Some(1), Status::Linked));
        assert_eq!(decided(&[-1.0, -25.1], &[1], 5), (Some(0), Status::Accepted));
        assert_eq!(decided(&[], &[], 5), (None, Status::None));
        assert_eq!(decided(&[-1.0], &[], 5), (Some(0), Status::Accepted));
        assert_eq!(decided(&[f64::NAN], &[0], 5), (None, Status::None));
    }

    #[test]
    fn links() {
        let mut link = Link::default();
        assert!(link.holds(-30.0, false) && link.holds(-1.0, false));
        assert!((0..4).all(|_| link.holds(-30.0, false)));
        assert!(!link.holds(-30.0, false));
        assert!(!Link::default().holds(0.0, true));
    }
}
