//! Corrects states by velocities that sensors report, in the same way as by positions.

use super::{Filter, Multiple};
use crate::tracker::motion::Motion;
use crate::tracker::motion::estimate::{Estimate, VELOCITY};
use crate::tracker::motion::imm::{Bank, NEGLIGIBLE, without_rate};
use crate::tracker::motion::velocities::Velocities;
use crate::tracker::plot::Moving;

impl Filter {
    /// Whether a velocity is in the gate of one of the models.
    pub fn expects(&self, seen: &Moving, velocities: Velocities) -> bool {
        let near = |[distance, _]: [f64; 2]| distance <= velocities.guard;
        match self {
            Self::Straight(estimate) => near(estimate.expects(seen)),
            Self::Singer(estimate) => near(estimate.expects(seen)),
            Self::Multiple(multiple) => multiple.expects(seen, near),
            Self::Window(window) => near(window.estimate().expects(seen)),
            Self::Planned(_) => true,
        }
    }

    /// Calls `each` with the probability of each model, and the state by this model.
    pub fn each_estimate(&self, mut each: impl FnMut(f64, &Estimate<4>)) {
        match self {
            Self::Multiple(multiple) => multiple.banks().for_each(|bank| {
                let [straight, turn, plan] = bank.probability;
                each(straight, &bank.straight);
                each(turn, &without_rate(&bank.turn));
                each(plan, &bank.plan);
            }),
            Self::Planned(prospects) => prospects.each_estimate(each),
            Self::Straight(_) | Self::Singer(_) | Self::Window(_) => each(1.0, &self.estimate()),
        }
    }

    /// Corrects by a velocity.
    pub fn take_velocity(&mut self, motion: &Motion, seen: &Moving, velocities: Velocities) {
        let Moving { velocity, noise } = *seen;
        match (self, motion) {
            (Self::Straight(estimate), _) => {
                estimate.correct_at::<VELOCITY>(velocity, noise);
            }
            (Self::Singer(estimate), _) => {
                estimate.correct_at::<VELOCITY>(velocity, noise);
            }
            (Self::Multiple(multiple), Motion::Imm(model)) => {
                multiple.correct::<VELOCITY>(model, velocity, noise);
            }
            (Self::Window(window), _) => window.take_velocity(*seen),
            (Self::Planned(prospects), _) => prospects.take_velocity(seen, velocities),
            _ => unreachable!("a filter is made by its motion"),
        }
    }
}

impl Multiple {
    fn expects(&self, seen: &Moving, near: impl Fn([f64; 2]) -> bool + Copy) -> bool {
        let accelerated = self.speed.as_ref().filter(|s| s.probability(&self.bank) > NEGLIGIBLE);
        self.banks().any(|bank| bank.expects(seen, near))
            || accelerated
                .is_some_and(|speed| near(speed.added_to(&self.bank.straight).expects(seen)))
    }
}

impl Bank {
    fn expects(&self, seen: &Moving, near: impl Fn([f64; 2]) -> bool) -> bool {
        let [straight, turn, plan] = self.probability.map(|probability| probability > NEGLIGIBLE);
        straight && near(self.straight.expects(seen))
            || turn && near(self.turn.expects(seen))
            || plan && near(self.plan.expects(seen))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_within;
    use crate::base::plane::Plane;
    use crate::tracker::filter::prospects::Prospects;
    use crate::tracker::motion::ImmModel;
    use nalgebra::{SMatrix, SVector};

    const ALL: Velocities = Velocities { guard: 12.4, max_speed: 350.0 };

    fn start() -> Estimate<4> {
        let root = SMatrix::<f64, 4, 4>::new(
            30.0, 1.0, 2.0, -3.0, 0.0, 20.0, 5.0, 1.0, 4.0, 0.0, 9.0, 0.2, 0.1, 0.3, 0.0, 7.5,
        );
        let mean = SVector::from([3e4, -4e4, 200.0, 50.0]);
        Estimate { mean, covariance: root * root.transpose() }
    }

    fn seen(velocity: [f64; 2]) -> Moving {
        Moving { velocity, noise: Plane { xx: 4.0, xy: -1.0, yy: 2.0 } }
    }

    #[test]
    fn a_velocity_is_a_position_where_states_change_places() {
        let seen = seen([205.0, 47.0]);
        let mut swap = SMatrix::<f64, 4, 4>::zeros();
        (0..4).for_each(|i| swap[(i, (i + 2) % 4)] = 1.0);
        let mut other = Estimate {
            mean: swap * start().mean,
            covariance: swap * start().covariance * swap.transpose(),
        };
        let expected = other.correct(seen.velocity, seen.noise);
        let mut own = start();
        assert_within(1e-13, own.expects(&seen)[1], expected);
        own.correct_at::<VELOCITY>(seen.velocity, seen.noise);
        assert!((own.mean - swap * other.mean).amax() < 1e-9);
        assert!((own.covariance - swap * other.covariance * swap.transpose()).amax() < 1e-10);
    }

    #[test]
    fn models_are_weighed_by_velocities_as_by_positions() {
        let motion = Motion::Imm(ImmModel::default());
        let mut filter = Filter::new(&motion, start());
        let Filter::Multiple(multiple) = &mut filter else { unreachable!() };
        multiple.bank.probability = [0.9, 0.1, 0.0];
        // the model of the turn is that of a target that has turned in the meantime
        (multiple.bank.turn.mean[2], multiple.bank.turn.mean[3]) = (150.0, 140.0);
        let (straight, turn) = (multiple.bank.straight, multiple.bank.turn);
        let turned = seen([152.0, 139.0]);
        assert!(filter.expects(&turned, ALL) && !filter.expects(&seen([0.0, 300.0]), ALL));
        let weights = [0.9 * straight.expects(&turned)[1], 0.1 * turn.expects(&turned)[1]];
        filter.take_velocity(&motion, &turned, ALL);
        let expected = weights[1] / (weights[0] + weights[1]);
        assert!(expected > 0.999);
        assert_within(1e-9, filter.turn_probability(), expected);
        let (mut total, mut sum) = (0.0, [0.0; 2]);
        filter.each_estimate(|probability, estimate| {
            total += probability;
            (0..2).for_each(|i| sum[i] += probability * estimate.mean[2 + i]);
        });
        assert_within(1e-12, total, 1.0);
        let estimate = filter.estimate();
        (0..2).for_each(|i| assert_within(1e-9, sum[i], estimate.mean[2 + i]));
    }

    #[test]
    fn a_track_begins_with_its_velocity_unless_that_is_wrong() {
        let diagonal = SVector::from([1e4, 1e4, 175.0 * 175.0, 175.0 * 175.0]);
        let first =
            Estimate { mean: SVector::zeros(), covariance: SMatrix::from_diagonal(&diagonal) };
        let begun = || {
            let mut prospects = Prospects::new(None, first);
            prospects.begin_moving(&seen([200.0, 0.0]), ALL);
            prospects.predict([1.0; 2], 4.0, 4.0);
            prospects
        };
        let r = Plane { xx: 100.0, xy: 0.0, yy: 100.0 };
        let mut right = begun();
        right.correct([800.0, 0.0], r);
        let shown = right.shown();
        assert!((shown.mean[2] - 200.0).abs() < 1.0 && shown.covariance[(2, 2)] < 40.0);
        // the target flies the other way, so the first velocity was wrong
        let mut wrong = begun();
        wrong.correct([-800.0, 0.0], r);
        let shown = wrong.shown();
        assert!((shown.mean[2] + 200.0).abs() < 10.0, "{}", shown.mean[2]);
        // later velocities of this kind are wrong again
        wrong.take_velocity(&seen([200.0, 0.0]), ALL);
        assert!((wrong.shown().mean[2] - shown.mean[2]).abs() < 1e-6);
        right.take_velocity(&seen([200.0, 0.0]), ALL);
        assert!(right.shown().covariance[(2, 2)] < 4.0);
    }
}
