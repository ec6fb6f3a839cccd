//! Passing times by what has been flown so far: the ground speed of the last minute against that of
//! the plan.

use super::correlation::Sighting;
use super::plane::norm;
use super::route::Route;
use serde::{Deserialize, Serialize};

/// Seconds over which ground speeds are averaged.
const MEMORY: f64 = 60.0;
/// Seconds to which a drift belongs.
const DRIFT_TIME: f64 = 60.0;

/// Averages of the ground speed, in those of the plan.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Refinement {
    drift: f64,
    weight: f64,
    speed: f64,
    variance: f64,
    time: f64,
    distance: f64,
    along_variance: f64,
    leg_speed: f64,
}

/// When a waypoint will be passed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Passing {
    /// Seconds; nan where it was passed already.
    pub time: f64,
    /// Its standard deviation.
    pub sigma: f64,
}

impl Refinement {
    /// Nothing seen yet. `drift` is the standard deviation by which the speed changes in a minute,
    /// relative to that of the plan: wind, and what the crew does. A random walk.
    pub fn new(drift: f64) -> Self {
        Self {
            drift,
            weight: 0.0,
            speed: 0.0,
            variance: 0.0,
            time: 0.0,
            distance: 0.0,
            along_variance: 0.0,
            leg_speed: 0.0,
        }
    }

    /// Takes a sighting on a leg of a plan that is followed. Weights of ground speeds fall by e in a
    /// minute; the errors of the speeds are taken as common, because those of a track are.
    pub fn update(&mut self, route: &Route, leg: usize, seen: &Sighting) {
        let kept = (-(seen.time - self.time).max(0.0) / MEMORY).exp();
        let planned = route.speeds()[leg];
        self.weight = if self.weight > 0.0 { kept * self.weight + 1.0 } else { 1.0 };
        let share = 1.0 / self.weight;
        self.speed += share * (norm(seen.velocity) / planned - self.speed);
        self.variance += share * (seen.speed_variance / (planned * planned) - self.variance);
        self.time = seen.time;
        self.distance = route.project_leg(leg, seen.position).0;
        self.along_variance = seen.position_variance[0];
        self.leg_speed = planned;
    }

    /// Ground speed and its standard deviation, m/s; nan before the first sighting.
    pub fn speed(&self) -> (f64, f64) {
        if self.weight == 0.0 {
            return (f64::NAN, f64::NAN);
        }
        (self.leg_speed * self.speed, self.leg_speed * self.variance.sqrt())
    }

    /// When a waypoint will be passed: the plan's time from here to there, at the speed flown so far
    /// in those of the plan. Its error is that of the position, that of the speed, and what the speed
    /// will change: `σ² = σ_s²/V² + τ² (σ_r² + q τ/3)` after τ, with q = drift² a minute.
    pub fn passing(&self, route: &Route, waypoint: usize) -> Passing {
        let planned = route.times()[waypoint] - route.time(self.distance);
        if self.weight == 0.0 || self.speed <= 0.0 || planned < 0.0 {
            return Passing { time: f64::NAN, sigma: f64::NAN };
        }
        let ahead = planned / self.speed;
        let drift = self.drift * self.drift / DRIFT_TIME * ahead / 3.0;
        let here = self.along_variance / (self.leg_speed * self.speed).powi(2);
        let relative = self.variance / (self.speed * self.speed) + drift;
        Passing { time: self.time + ahead, sigma: (here + ahead * ahead * relative).sqrt() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flight_that_is_slower_by_a_tenth_is_late() {
        let waypoints = [[0.0, 0.0], [6e4, 0.0], [6e4, 9e4]];
        let route = Route::try_new(&waypoints, &[200.0, 150.0], 0.0, &[], 0.4, 0.05).unwrap();
        let mut refinement = Refinement::new(0.04);
        assert!(refinement.passing(&route, 1).time.is_nan() && refinement.speed().0.is_nan());
        for k in 0..20 {
            let (p, v) = ([900.0 * k as f64, 0.0], [180.0, 0.0]);
            let seen = Sighting::new(5.0 * k as f64, p, v, None, f64::NAN);
            refinement.update(&route, 0, &seen);
        }
        assert!((refinement.speed().0 - 180.0).abs() < 1e-9);
        for waypoint in 1..3 {
            let expected = route.times()[waypoint] / 0.9;
            let found = refinement.passing(&route, waypoint);
            assert!((found.time - expected).abs() < 1e-9 && found.sigma > 0.0);
        }
        assert!(refinement.passing(&route, 0).time.is_nan());
    }
}
