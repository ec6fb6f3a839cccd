//! Several models of the motion of one target, mixed by their probabilities (interacting multiple
//! models; Blom, Bar-Shalom 1988).

use super::ImmModel;
use super::estimate::{Estimate, Moments};
use super::kinematics;
use crate::base::plane::Plane;
use nalgebra::{SMatrix, SVector};
use pulp::{Arch, Simd, WithSimd};
use serde::{Deserialize, Serialize};

/// Number of models in a bank.
pub(in crate::tracker) const MODELS: usize = 3;
/// Straight flight.
pub(in crate::tracker) const STRAIGHT: usize = 0;
/// A turn at an unknown rate.
pub(in crate::tracker) const TURN: usize = 1;
/// Motion along a flight plan.
pub(in crate::tracker) const PLAN: usize = 2;
/// A change of speed: it takes the place of the plan if there is none.
pub(in crate::tracker) const SPEED: usize = PLAN;
/// A model below this probability is used neither for gates nor for scores, and is not compared with velocities.
pub(in crate::tracker) const NEGLIGIBLE: f64 = 0.005;

/// Probabilities of the changes from one model (row) to another (column).
pub(in crate::tracker) type Transition = [[f64; MODELS]; MODELS];

/// The models' estimates and probabilities.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Bank {
    pub straight: Estimate<4>,
    pub turn: Estimate<5>,
    /// Motion along a flight plan or, if there is no plan, a change of speed.
    pub plan: Estimate<4>,
    /// Probabilities of the models; they sum to the probability of the bank.
    pub probability: [f64; MODELS],
}

/// The position that a model expects, and its probability.
#[derive(Clone, Copy, Debug)]
pub(in crate::tracker) struct Component {
    pub probability: f64,
    pub position: [f64; 2],
    pub covariance: Plane,
}

impl Component {
    /// Normalised distance squared of a plot with the covariance `r`, and the covariance of the innovation.
    #[inline]
    pub fn distance(&self, z: [f64; 2], r: Plane) -> (f64, Plane) {
        let s = self.covariance.plus(r);
        let y = [z[0] - self.position[0], z[1] - self.position[1]];
        (s.inverse().form(y), s)
    }
}

impl Bank {
    /// Creates a bank for a target that has flown straight so far. With the probability `turning` it begins a
    /// turn now, at a rate with this variance.
    pub fn new(straight: Estimate<4>, turning: f64, rate_variance: f64) -> Self {
        let turn = entered(&straight, rate_variance);
        Self { straight, turn, plan: straight, probability: [1.0 - turning, turning, 0.0] }
    }

    pub fn total(&self) -> f64 {
        self.probability.iter().sum()
    }

    pub fn scale(&mut self, by: f64) {
        self.probability.iter_mut().for_each(|p| *p *= by);
    }

    /// Mixes the estimates for possible changes of the model. A turn begins with a rate of zero and
    /// the variance `rate_variance`.
    #[inline(always)]
    pub fn mix(&mut self, transition: &Transition, rate_variance: f64) {
        let before = self.probability;
        let mut after = [0.0; MODELS];
        for (j, sum) in after.iter_mut().enumerate() {
            *sum = (0..MODELS).map(|i| transition[i][j] * before[i]).sum();
        }
        let is_usual = before[PLAN] == 0.0 && after[PLAN] == 0.0;
        if is_usual && after[STRAIGHT] > 0.0 && after[TURN] > 0.0 {
            let weight = |i: usize, j: usize| transition[i][j] * before[i] / after[j];
            let straight = self.straight.blended(weight(TURN, STRAIGHT), &self.turn);
            self.begin_turn(weight(STRAIGHT, TURN), rate_variance);
            (self.straight, self.probability) = (straight, after);
            return;
        }
        self.mix_all(transition, after, rate_variance);
    }

    /// As `mix`, for any models; their probabilities become `after`.
    #[inline(never)]
    fn mix_all(&mut self, transition: &Transition, after: [f64; MODELS], rate_variance: f64) {
        let old = *self;
        let weight = |i: usize, j: usize| transition[i][j] * old.probability[i] / after[j];
        if after[STRAIGHT] > 0.0 {
            self.straight = old.mixed_straight(STRAIGHT, |i| weight(i, STRAIGHT));
        }
        if after[PLAN] > 0.0 {
            self.plan = old.mixed_straight(PLAN, |i| weight(i, PLAN));
        }
        if after[TURN] > 0.0 {
            self.turn = old.mixed_turn(|i| weight(i, TURN), rate_variance);
        }
        self.probability = after;
    }

    /// Mixes the turn with one that begins now from straight flight, which has this weight.
    #[inline(always)]
    fn begin_turn(&mut self, weight: f64, rate_variance: f64) {
        let (own, spread) = (1.0 - weight, weight * (1.0 - weight));
        let (mean, straight) = (&mut self.turn.mean.data.0[0], &self.straight.mean.data.0[0]);
        let rate = mean[4];
        let mut d = [0.0; 4];
        for i in 0..4 {
            d[i] = straight[i] - mean[i];
            mean[i] += weight * d[i];
        }
        mean[4] = own * rate;
        let p = &mut self.turn.covariance.data.0;
        let columns = &self.straight.covariance.data.0;
        for j in 0..4 {
            let of_column = spread * d[j];
            for i in 0..4 {
                p[j][i] = own * p[j][i] + weight * columns[j][i] + of_column * d[i];
            }
            p[j][4] = own * p[j][4] - of_column * rate;
            p[4][j] = p[j][4];
        }
        p[4][4] = own * p[4][4] + weight * rate_variance + spread * rate * rate;
    }

    /// The mixed initial estimate of a model without a turn rate.
    #[inline]
    fn mixed_straight(&self, into: usize, weight: impl Fn(usize) -> f64) -> Estimate<4> {
        let origin = if into == PLAN && self.probability[PLAN] > 0.0 {
            self.plan.mean
        } else {
            self.straight.mean
        };
        let mut moments = Moments::about(origin);
        self.add_weighted(&mut moments, [weight(STRAIGHT), weight(TURN), weight(PLAN)]);
        moments.estimate()
    }

    /// The mixed initial estimate of the turn.
    #[inline]
    fn mixed_turn(&self, weight: impl Fn(usize) -> f64, rate_variance: f64) -> Estimate<5> {
        let mut moments = Moments::about(self.turn.mean);
        if weight(STRAIGHT) > 0.0 {
            moments.add(weight(STRAIGHT), &entered(&self.straight, rate_variance));
        }
        if weight(TURN) > 0.0 {
            moments.add(weight(TURN), &self.turn);
        }
        if weight(PLAN) > 0.0 {
            moments.add(weight(PLAN), &entered(&self.plan, rate_variance));
        }
        moments.estimate()
    }

    /// Where each model expects the target.
    pub fn models(&self) -> [Component; MODELS] {
        let places = [
            (self.straight.position(), self.straight.position_covariance()),
            (self.turn.position(), self.turn.position_covariance()),
            (self.plan.position(), self.plan.position_covariance()),
        ];
        std::array::from_fn(|i| {
            let (position, covariance) = places[i];
            Component { probability: self.probability[i], position, covariance }
        })
    }

    /// Calls `each` with the expected plot of every model that is not negligible.
    #[inline]
    pub fn components(&self, each: &mut impl FnMut(Component)) {
        for model in self.models() {
            if model.probability > NEGLIGIBLE {
                each(model);
            }
        }
    }

    /// Predicts straight flight and turn.
    #[inline(always)]
    pub fn predict(&mut self, model: &ImmModel, t: f64, period: f64) {
        kinematics::straight(&mut self.straight, t, model.straight_sigma.powi(2) * period);
        kinematics::turn(
            &mut self.turn,
            t,
            model.turn_sigma.powi(2) * period,
            model.turn_rate_walk,
        );
    }

    /// Corrects all models by a position or a velocity, and multiplies the probability of each model by the
    /// density of the measurement under that model.
    #[inline]
    pub fn correct<const AT: usize>(&mut self, z: [f64; 2], r: Plane) {
        Arch::new().dispatch(Correction::<AT> { bank: self, z, r });
    }

    /// Position and velocity by all models, if their probabilities sum to one.
    #[inline(always)]
    pub fn estimate(&self) -> Estimate<4> {
        if self.probability[PLAN] == 0.0 {
            return self.straight.blended(self.probability[TURN], &self.turn);
        }
        let mut moments = Moments::about(self.straight.mean);
        self.add_to(&mut moments);
        moments.estimate()
    }

    /// Adds position and velocity of all models, weighted by their probabilities.
    #[inline]
    pub fn add_to(&self, moments: &mut Moments<4>) {
        self.add_weighted(moments, self.probability);
    }

    #[inline]
    fn add_weighted(&self, moments: &mut Moments<4>, [straight, turn, plan]: [f64; MODELS]) {
        if straight > 0.0 {
            moments.add(straight, &self.straight);
        }
        if turn > 0.0 {
            moments.add(turn, &self.turn);
        }
        if plan > 0.0 {
            moments.add(plan, &self.plan);
        }
    }

    /// Makes a turn at least as likely as all other models.
    pub fn expect_turn(&mut self) {
        let total = self.total();
        let others = total - self.probability[TURN];
        if others > 0.5 * total {
            let shrink = 0.5 * total / others;
            self.probability[STRAIGHT] *= shrink;
            self.probability[PLAN] *= shrink;
            self.probability[TURN] = 0.5 * total;
        }
    }

    /// Shifts position and velocity of all models.
    pub fn shift(&mut self, by: &SVector<f64, 4>) {
        self.straight.mean += by;
        self.plan.mean += by;
        let mut part = self.turn.mean.fixed_rows_mut::<4>(0);
        part += by;
    }

    /// Widens all models, as if the target had accelerated unnoticed.
    pub fn widen(&mut self, extra: &SMatrix<f64, 4, 4>) {
        self.straight.covariance += extra;
        self.plan.covariance += extra;
        let mut block = self.turn.covariance.fixed_view_mut::<4, 4>(0, 0);
        block += extra;
    }
}

/// A correction of all models, compiled for the widest vectors that the processor has.
struct Correction<'a, const AT: usize> {
    bank: &'a mut Bank,
    z: [f64; 2],
    r: Plane,
}

impl<const AT: usize> WithSimd for Correction<'_, AT> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { bank, z, r } = self;
        let [straight, turn, plan] = &mut bank.probability;
        if *straight > 0.0 {
            *straight *= bank.straight.correct_at::<AT>(z, r);
        }
        if *turn > 0.0 {
            *turn *= bank.turn.correct_at::<AT>(z, r);
        }
        if *plan > 0.0 {
            *plan *= bank.plan.correct_at::<AT>(z, r);
        }
    }
}

/// Probabilities of the changes between straight flight and turns in the time `t`.
pub(in crate::tracker) fn changes(model: &ImmModel, t: f64) -> Transition {
    let mut transition = [[0.0; 3]; 3];
    let begins = -(-t / model.straight_time).exp_m1();
    let ends = -(-t / model.turn_time).exp_m1();
    transition[STRAIGHT] = [1.0 - begins, begins, 0.0];
    transition[TURN] = [ends, 1.0 - ends, 0.0];
    transition
}

/// Limits probabilities of changes that were added as if each were rare: over a long time, those of a model
/// may add up to more than 1, and their sum is then 1.
#[inline(always)]
pub(in crate::tracker) fn limited(mut transition: Transition) -> Transition {
    for (i, row) in transition.iter_mut().enumerate() {
        if row[i] < 0.0 {
            let changes = 1.0 - row[i];
            row[i] = 0.0;
            row.iter_mut().for_each(|p| *p /= changes);
        }
    }
    transition
}

/// The state of a turn that begins from straight flight: its rate is 0 with the variance `rate_variance`.
#[inline]
pub(in crate::tracker) fn entered(straight: &Estimate<4>, rate_variance: f64) -> Estimate<5> {
    let (mut mean, mut covariance) = ([0.0; 5], [[0.0; 5]; 5]);
    mean[..4].copy_from_slice(&straight.mean.data.0[0]);
    for (column, of) in covariance.iter_mut().zip(&straight.covariance.data.0) {
        column[..4].copy_from_slice(of);
    }
    covariance[4][4] = rate_variance;
    Estimate { mean: SVector::from(mean), covariance: SMatrix::from(covariance) }
}

/// Position and velocity of a turn.
#[inline]
pub(in crate::tracker) fn without_rate(turn: &Estimate<5>) -> Estimate<4> {
    let (mut mean, mut covariance) = ([0.0; 4], [[0.0; 4]; 4]);
    mean.copy_from_slice(&turn.mean.data.0[0][..4]);
    for (column, of) in covariance.iter_mut().zip(&turn.covariance.data.0) {
        column.copy_from_slice(&of[..4]);
    }
    Estimate { mean: SVector::from(mean), covariance: SMatrix::from(covariance) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tracker::motion::speed_change::SpeedChange;

    #[test]
    fn changes_stay_probabilities() {
        let rare = [[0.9, 0.06, 0.04], [0.2, 0.5, 0.3], [0.0; MODELS]];
        assert_eq!(limited(rare), rare);
        let often = limited([[-0.25, 0.75, 0.5], [0.95, -0.05, 0.1], [0.7, 0.3, 0.0]]);
        for (i, row) in often.iter().enumerate() {
            assert!((row.iter().sum::<f64>() - 1.0).abs() < 1e-15, "{row:?}");
            assert_eq!(row[i], 0.0);
        }
        assert!((often[STRAIGHT][TURN] - 0.6).abs() < 1e-15);
    }

    /// A drone that is seen every 30 s changes its motion several times in between.
    #[test]
    fn predictions_over_long_times() {
        let model = ImmModel {
            straight_time: 20.0,
            turn_time: 5.0,
            steady_time: 30.0,
            speed_change_time: 5.0,
            ..ImmModel::default()
        };
        let start = Estimate { mean: SVector::zeros(), covariance: SMatrix::identity() };
        let mut bank = Bank { probability: [0.9, 0.04, 0.06], ..Bank::new(start, 0.0, 1e-4) };
        let mut speed = SpeedChange::new(&model);
        speed.predict(&mut bank, &model, &changes(&model, 30.0), (30.0, 30.0));
        assert!(bank.probability.iter().all(|p| *p > 0.0), "{:?}", bank.probability);
        assert!((bank.total() - 1.0).abs() < 1e-12, "{:?}", bank.probability);
    }
}
