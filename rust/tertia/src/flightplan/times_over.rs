//! Times over the waypoints ahead, from the ratio of the ground speed flown so far to the planned one.

use super::correlation::Sighting;
use super::monitor::Monitor;
use super::plane::norm;
use super::route::Route;
use serde::{Deserialize, Serialize};

/// Time over which ground speeds are averaged, s.
const AVERAGING_TIME: f64 = 60.0;
/// Time in which the ground speed changes by `speed_change_sigma`, s.
const CHANGE_TIME: f64 = 60.0;

/// Average ratio of the ground speed to the planned one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SpeedHistory {
    weight: f64,
    speed: f64,
    variance: f64,
    time: f64,
    along_track: f64,
    along_variance: f64,
    leg_speed: f64,
}

/// Estimated time over a waypoint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimeOver {
    /// Time, s; nan if the waypoint has been passed.
    pub time: f64,
    /// Standard deviation of the time.
    pub sigma: f64,
}

impl SpeedHistory {
    /// Adds a sighting on a leg of a plan that is followed. The weights of earlier ground speeds decrease
    /// by the factor e per minute. The errors of the speeds are treated as fully correlated, like those
    /// of a track.
    pub fn update(&mut self, route: &Route, leg: usize, seen: &Sighting) {
        let kept = (-(seen.time - self.time).max(0.0) / AVERAGING_TIME).exp();
        let planned = route.speeds()[leg];
        self.weight = if self.weight > 0.0 { kept * self.weight + 1.0 } else { 1.0 };
        let share = 1.0 / self.weight;
        self.speed += share * (norm(seen.velocity) / planned - self.speed);
        self.variance += share * (seen.speed_variance / (planned * planned) - self.variance);
        self.time = seen.time;
        self.along_track = route.project_leg(leg, seen.position).0;
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

    /// Time over a waypoint: the planned time from the present position, scaled by the ratio of planned to
    /// flown speed. Its variance is the sum of those from the position, the mean speed, and a random
    /// walk of the speed: `σ² = σ_s²/V² + τ² (σ_r² + q τ/3)` at τ seconds ahead, with
    /// `q = speed_change_sigma²` per minute.
    pub fn time_over(&self, route: &Route, waypoint: usize, speed_change_sigma: f64) -> TimeOver {
        let planned = route.times()[waypoint] - route.time(self.along_track);
        if self.weight == 0.0 || self.speed <= 0.0 || planned < 0.0 {
            return TimeOver { time: f64::NAN, sigma: f64::NAN };
        }
        let ahead = planned / self.speed;
        let walk = speed_change_sigma * speed_change_sigma / CHANGE_TIME * ahead / 3.0;
        let here = self.along_variance / (self.leg_speed * self.speed).powi(2);
        let relative = self.variance / (self.speed * self.speed) + walk;
        TimeOver { time: self.time + ahead, sigma: (here + ahead * ahead * relative).sqrt() }
    }
}

/// Returns the speed history after each sighting of a track, which is monitored from the first sighting on.
/// Sightings that do not conform to the plan have no effect. O(1) per sighting.
pub fn speed_histories<'a>(
    route: &'a Route,
    seen: &'a [Sighting],
    update_interval: f64,
) -> impl Iterator<Item = SpeedHistory> + 'a {
    let verdicts = Monitor::follow(route, seen, update_interval);
    seen.iter().zip(verdicts).scan(SpeedHistory::default(), |history, (seen, verdict)| {
        if let Some(verdict) = verdict.filter(|verdict| verdict.conforms) {
            history.update(route, verdict.leg, seen);
        }
        Some(*history)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flight_that_is_slower_by_a_tenth_is_late() {
        let waypoints = [[0.0, 0.0], [6e4, 0.0], [6e4, 9e4]];
        let route = Route::try_new(&waypoints, &[200.0, 150.0], 0.0, &[], 0.4, 0.05).unwrap();
        let mut history = SpeedHistory::default();
        assert!(history.time_over(&route, 1, 0.04).time.is_nan() && history.speed().0.is_nan());
        for k in 0..20 {
            let (p, v) = ([900.0 * k as f64, 0.0], [180.0, 0.0]);
            let seen = Sighting::new(5.0 * k as f64, p, v, None, f64::NAN);
            history.update(&route, 0, &seen);
        }
        assert!((history.speed().0 - 180.0).abs() < 1e-9);
        for waypoint in 1..3 {
            let expected = route.times()[waypoint] / 0.9;
            let found = history.time_over(&route, waypoint, 0.04);
            assert!((found.time - expected).abs() < 1e-9 && found.sigma > 0.0);
        }
        assert!(history.time_over(&route, 0, 0.04).time.is_nan());
    }
}
