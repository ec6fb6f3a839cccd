//! A track that begins where flights are due, or with a velocity: its target may be one of these
//! flights or any other target, and the velocity may be wrong.

use crate::base::plane::Plane;
use crate::tracker::motion::estimate::{Estimate, Moments, VELOCITY};
use crate::tracker::motion::imm::Component;
use crate::tracker::motion::kinematics;
use crate::tracker::motion::velocities::Velocities;
use crate::tracker::plot::Moving;
use nalgebra::{Matrix2, Vector2};
use serde::{Deserialize, Serialize};

/// Standard deviations of the speed of a flight, m/s, and of its course, rad; standard deviation of
/// its acceleration, m/s².
const SPEED_SIGMA: f64 = 15.0;
const COURSE_SIGMA: f64 = 4.0 * std::f64::consts::PI / 180.0;
const STRAIGHT_SIGMA: f64 = 0.3;
/// Probability of flights from which a track needs one plot less for confirmation, and probability
/// of a single flight from which the track is given its plan.
const PLANNED: f64 = 0.9;
const SURE: f64 = 0.95;
/// Probability below which a flight is left out.
const LEAST: f64 = 1e-3;

/// What plans say about a place: the density of flights that are due, relative to its mean and to
/// that of false plots, and the probability that a false plot at this place is one of those along
/// routes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct There {
    pub due: f64,
    pub routed: f64,
}

impl There {
    /// Adds the values of another place with a weight; the sums are not less than 0.
    pub fn add(&mut self, other: Self, weight: f64) {
        self.due = (self.due + weight * other.due).max(0.0);
        self.routed = (self.routed + weight * other.routed).max(0.0);
    }

    pub fn fade(&mut self, kept: f64) {
        self.due *= kept;
        self.routed *= kept;
    }
}

/// What plans say about a first plot.
pub(in crate::tracker) struct Expected {
    /// Factor by which a target is likelier here than without plans.
    pub ratio: f64,
    pub there: There,
    /// Density of false plots where flights are due, relative to the mean.
    pub crowding: f64,
    pub flights: Vec<Flying>,
}

/// A flight that a first plot may be of.
pub(in crate::tracker) struct Flying {
    pub plan: usize,
    pub probability: f64,
    /// Half the squared distance from where it is due, in standard deviations.
    pub square: f64,
    pub velocity: [f64; 2],
}

/// A flight that the target may be.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Flight {
    plan: usize,
    probability: f64,
    /// Half the sum of the squared distances of its plots from where they were expected.
    squares: f64,
    estimate: Estimate<4>,
}

/// What the target of a track may be.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Prospects {
    /// A target without a plan, and its probability.
    unplanned: Estimate<4>,
    probability: f64,
    /// A target without a plan that has the velocity of the first plot, and its probability.
    moving: Option<(f64, Estimate<4>)>,
    flights: Vec<Flight>,
    crowding: f64,
}

impl Prospects {
    /// Begins with a first plot; `unplanned` is the state of a target without a plan.
    pub fn new(expected: Option<Expected>, unplanned: Estimate<4>) -> Self {
        let (flights, crowding) = expected.map_or((Vec::new(), 1.0), |e| (e.flights, e.crowding));
        let likely = flights.into_iter().filter(|flight| flight.probability > LEAST);
        let flights: Vec<_> = likely
            .map(|Flying { plan, probability, square, velocity }| {
                let estimate = flying(unplanned, velocity);
                Flight { plan, probability, squares: square, estimate }
            })
            .collect();
        let planned: f64 = flights.iter().map(|flight| flight.probability).sum();
        Self { unplanned, probability: 1.0 - planned, moving: None, flights, crowding }
    }

    /// Whether there is any prospect other than a target without a plan and without a velocity.
    pub fn are_any(&self) -> bool {
        self.moving.is_some() || !self.flights.is_empty()
    }

    /// Takes the velocity of the first plot.
    pub fn begin_moving(&mut self, seen: &Moving, velocities: Velocities) {
        let mut moving = self.unplanned;
        let density = moving.correct_at::<VELOCITY>(seen.velocity, seen.noise);
        let [right, wrong] = velocities.either(density);
        self.moving = Some((self.probability * right, moving));
        self.probability *= wrong;
        for flight in &mut self.flights {
            flight.probability *= taken(&mut flight.estimate, seen, velocities);
        }
        self.scale();
    }

    /// Takes the velocity of a later plot.
    pub fn take_velocity(&mut self, seen: &Moving, velocities: Velocities) {
        self.probability *= taken(&mut self.unplanned, seen, velocities);
        if let Some((probability, moving)) = &mut self.moving {
            *probability *= taken(moving, seen, velocities);
        }
        for flight in &mut self.flights {
            flight.probability *= taken(&mut flight.estimate, seen, velocities);
        }
        self.scale();
    }

    fn scale(&mut self) {
        let scale = self.probabilities().sum::<f64>().recip();
        self.probability *= scale;
        if let Some((probability, _)) = &mut self.moving {
            *probability *= scale;
        }
        self.flights.iter_mut().for_each(|flight| flight.probability *= scale);
    }

    fn probabilities(&self) -> impl Iterator<Item = f64> {
        let moving = self.moving.as_ref().map(|moving| moving.0);
        let flights = self.flights.iter().map(|flight| flight.probability);
        std::iter::once(self.probability).chain(moving).chain(flights)
    }

    /// State of a target without a plan.
    pub fn unplanned(&self) -> &Estimate<4> {
        &self.unplanned
    }

    /// State of a target without a plan, whether the velocity of its first plot is right or wrong.
    pub fn shown(&self) -> Estimate<4> {
        let Some((probability, moving)) = &self.moving else { return self.unplanned };
        self.unplanned.merged(self.probability, moving, *probability)
    }

    /// Whether the target is likely to be one of the flights.
    fn is_planned(&self) -> bool {
        self.flights.iter().map(|flight| flight.probability).sum::<f64>() > PLANNED
    }

    /// Evidence that two plots may lack if they are likely to be of a flight. With half the sum s
    /// of the squared distances and the largest possible evidence M, the probability of false plots
    /// at least as near to where the flight is expected, `e^(s - M) s²/2`, is less than the bound
    /// `e^(s - M)`.
    pub fn allowance(&self) -> Option<f64> {
        let best = |a: &&Flight, b: &&Flight| a.probability.total_cmp(&b.probability);
        let flight = self.flights.iter().max_by(best).filter(|_| self.is_planned())?;
        let s = flight.squares;
        Some(if self.moving.is_some() { 0.0 } else { s - (0.5 * s * s).ln() })
    }

    /// The mean of all states that the target may have, and the plan of the flight that it
    /// certainly is, if any.
    pub fn decide(&self) -> (Estimate<4>, Option<usize>) {
        let mut moments = Moments::about(self.unplanned.mean);
        moments.add(self.probability, &self.unplanned);
        if let Some((probability, moving)) = &self.moving {
            moments.add(*probability, moving);
        }
        self.flights.iter().for_each(|flight| moments.add(flight.probability, &flight.estimate));
        let sure = self.flights.iter().find(|flight| flight.probability > SURE);
        (moments.estimate(), sure.map(|flight| flight.plan))
    }

    /// Calls `each` with each state that the target may have, and its probability.
    pub fn each_estimate(&self, mut each: impl FnMut(f64, &Estimate<4>)) {
        each(self.probability, &self.unplanned);
        if let Some((probability, moving)) = &self.moving {
            each(*probability, moving);
        }
        self.flights.iter().for_each(|flight| each(flight.probability, &flight.estimate));
    }

    /// Calls `each` with the position that each prospect expects, and its probability. Plots of
    /// flights count less, as there are more false plots where flights are due.
    pub fn components(&self, mut each: impl FnMut(Component)) {
        let mut one = |probability, e: &Estimate<4>| {
            let (position, covariance) = (e.position(), e.position_covariance());
            each(Component { probability, position, covariance });
        };
        one(self.probability, &self.unplanned);
        if let Some((probability, moving)) = &self.moving {
            one(*probability, moving);
        }
        for flight in &self.flights {
            one(flight.probability / self.crowding, &flight.estimate);
        }
    }

    /// Predicts over the time `t`; the accelerations are those of a target without a plan, and of
    /// one whose velocity is known, m/s².
    pub fn predict(&mut self, [sigma, moving_sigma]: [f64; 2], t: f64, period: f64) {
        kinematics::straight(&mut self.unplanned, t, sigma * sigma * period);
        if let Some((_, moving)) = &mut self.moving {
            kinematics::straight(moving, t, moving_sigma * moving_sigma * period);
        }
        for flight in &mut self.flights {
            let q = STRAIGHT_SIGMA * STRAIGHT_SIGMA * period;
            kinematics::straight(&mut flight.estimate, t, q);
        }
    }

    /// Corrects by a plot.
    pub fn correct(&mut self, z: [f64; 2], r: Plane) {
        let any = self.probability * self.unplanned.correct(z, r);
        let moving =
            self.moving.as_mut().map(|(probability, own)| *probability * own.correct(z, r));
        let each: Vec<_> = self
            .flights
            .iter_mut()
            .map(|flight| {
                let s = flight.estimate.position_covariance().plus(r);
                let y = [0, 1].map(|i| z[i] - flight.estimate.mean[i]);
                flight.squares += 0.5 * s.inverse().form(y);
                flight.probability * flight.estimate.correct(z, r) / self.crowding
            })
            .collect();
        let total = any + moving.unwrap_or(0.0) + each.iter().sum::<f64>();
        if total == 0.0 {
            // all prospects exclude the plot, so it says nothing
            return;
        }
        self.probability = any / total;
        if let (Some((probability, _)), Some(own)) = (&mut self.moving, moving) {
            *probability = own / total;
        }
        for (flight, own) in self.flights.iter_mut().zip(each) {
            flight.probability = own / total;
        }
    }

    /// Changes the states of all prospects.
    pub fn each(&mut self, change: impl Fn(&mut Estimate<4>)) {
        change(&mut self.unplanned);
        if let Some((_, moving)) = &mut self.moving {
            change(moving);
        }
        self.flights.iter_mut().for_each(|flight| change(&mut flight.estimate));
    }
}

/// Corrects by a velocity, unless it is outside the guard gate; returns its density as that of a
/// right or wrong velocity.
fn taken(estimate: &mut Estimate<4>, seen: &Moving, velocities: Velocities) -> f64 {
    let [distance, density] = estimate.expects(seen);
    let [right, wrong] = velocities.either(density);
    if distance > velocities.guard {
        return wrong;
    }
    estimate.correct_at::<VELOCITY>(seen.velocity, seen.noise);
    right
}

/// The state of a flight with this velocity at the place of the estimate.
fn flying(mut estimate: Estimate<4>, velocity: [f64; 2]) -> Estimate<4> {
    let v = Vector2::from(velocity);
    let across = v.dot(&v) * COURSE_SIGMA.powi(2);
    let u = v.try_normalize(0.0).unwrap_or(Vector2::x());
    let along = u * u.transpose();
    let covariance = along * SPEED_SIGMA.powi(2) + (Matrix2::identity() - along) * across;
    estimate.mean.fixed_rows_mut::<2>(2).copy_from(&v);
    estimate.covariance.fixed_view_mut::<2, 2>(2, 2).copy_from(&covariance);
    estimate
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_within;
    use nalgebra::{SMatrix, SVector};

    fn prospects(crowding: f64) -> Prospects {
        let diagonal = SVector::from([1e4, 1e4, 175.0 * 175.0, 175.0 * 175.0]);
        let start =
            Estimate { mean: SVector::zeros(), covariance: SMatrix::from_diagonal(&diagonal) };
        let due = [(4, 0.4, [0.0, 200.0]), (7, 0.1, [200.0, 0.0]), (9, 1e-4, [0.0; 2])];
        let flights = due.map(|(plan, probability, velocity)| Flying {
            plan,
            probability,
            square: 0.5,
            velocity,
        });
        let flights = flights.into();
        let expected = Expected { ratio: 2.0, there: There::default(), crowding, flights };
        Prospects::new(Some(expected), start)
    }

    #[test]
    fn a_plot_where_a_flight_is_expected_makes_it_sure() {
        let r = Plane { xx: 1e4, xy: 0.0, yy: 1e4 };
        let mut own = prospects(1.0);
        assert_eq!(own.flights.len(), 2);
        assert!(own.allowance().is_none());
        own.predict([1.0; 2], 10.0, 10.0);
        let mut densities = Vec::new();
        own.components(|one| {
            let (s, [x, y]) = (one.covariance.plus(r), one.position);
            let d = s.inverse().form([-x, 2000.0 - y]);
            densities.push(one.probability * (-0.5 * d).exp() / s.determinant().sqrt());
        });
        own.correct([0.0, 2000.0], r);
        let total: f64 = densities.iter().sum();
        assert!((own.flights[0].probability - densities[1] / total).abs() < 1e-12);
        assert!(own.is_planned() && own.decide().1 == Some(4));
        // half a squared distance of 0.5 from where the flight was due, and of 0 from where it was
        // expected then
        assert_within(1e-9, own.allowance().unwrap(), 0.5 - 0.125_f64.ln());
        // with ten times as many false plots, the flight is less likely
        let mut other = prospects(10.0);
        other.predict([1.0; 2], 10.0, 10.0);
        other.correct([0.0, 2000.0], r);
        let odds = |of: &Prospects| of.flights[0].probability / of.probability;
        assert!((odds(&own) / odds(&other) - 10.0).abs() < 1e-9);
    }

    #[test]
    fn a_target_that_flies_elsewhere_is_any() {
        let mut own = prospects(1.0);
        own.predict([1.0; 2], 10.0, 10.0);
        own.correct([-1500.0, -1500.0], Plane { xx: 1e4, xy: 0.0, yy: 1e4 });
        assert!(own.probability > 0.999);
        let (estimate, plan) = own.decide();
        assert_eq!(plan, None);
        assert!((estimate.mean - own.unplanned.mean).amax() < 1.0);
    }
}
