//! Changes of speed: an acceleration along the course.
//!
//! As long as an acceleration is unlikely, it is estimated from the innovations of straight flight
//! alone, in which it is a bias (Friedland 1969), together with its likelihood (Willsky, Jones
//! 1976): this costs little and does not disturb straight flight. Once it is likely, it becomes a
//! model of the bank.

use super::ImmModel;
use super::estimate::Estimate;
use super::imm::{Bank, SPEED, STRAIGHT, TURN, Transition, limited};
use super::kinematics;
use crate::base::exponential::exp;
use crate::base::plane::Plane;
use pulp::{Arch, Simd, WithSimd};
use serde::{Deserialize, Serialize};

/// Probability above which a change of speed becomes a model of the bank, and probability below
/// which it no longer is one. With half or twice these values, errors and NEES change by a few per
/// cent.
const BEGINS: f64 = 0.2;
const ENDS: f64 = 0.05;
/// Probability below which a change of speed adds nothing to the covariance.
const NEGLIGIBLE: f64 = 0.005;
/// Time constant with which the acceleration fades, s.
const FADING: f64 = 5000.0;
/// Mean time of a manoeuvre until one of the other kind follows immediately, s.
const OTHER_TIME: f64 = 1000.0;
/// Limit of the logarithm of the likelihood ratio of a plot.
const LARGEST: f64 = 50.0;

/// The acceleration along the course, if the speed changes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct SpeedChange {
    /// Odds against straight flight, while the change is no model of the bank.
    odds: f64,
    acceleration: f64,
    variance: f64,
    /// Response of position and velocity to the acceleration: their covariance with it, divided by
    /// its variance.
    pub response: [f64; 4],
}

impl SpeedChange {
    /// A change of speed of which only the frequency is known.
    pub fn new(model: &ImmModel) -> Self {
        Self {
            odds: model.speed_change_time / model.steady_time,
            acceleration: 0.0,
            variance: model.acceleration_sigma.powi(2),
            response: [0.0; 4],
        }
    }

    /// Probability of a change of speed, whether or not it is a model of the bank.
    #[inline]
    pub fn probability(&self, bank: &Bank) -> f64 {
        if bank.probability[SPEED] > 0.0 {
            return bank.probability[SPEED];
        }
        let odds = self.odds * bank.probability[STRAIGHT];
        odds / (1.0 + odds)
    }

    /// Mixes the models and predicts them over the time `t`; `changes` are the probabilities of
    /// transitions between straight flight and turns.
    #[inline]
    pub fn predict(
        &mut self,
        bank: &mut Bank,
        model: &ImmModel,
        changes: &Transition,
        over: (f64, f64),
    ) {
        Arch::new().dispatch(Prediction { speed: self, bank, model, changes, over });
    }

    #[inline(always)]
    fn predict_all(
        &mut self,
        bank: &mut Bank,
        model: &ImmModel,
        changes: &Transition,
        (t, period): (f64, f64),
    ) {
        let is_model = bank.probability[SPEED] > 0.0;
        if is_model {
            self.mix(bank, model, changes, t);
        } else {
            self.begin(bank, model, changes, t);
            bank.mix(changes, model.turn_rate_sigma.powi(2));
        }
        let [x, y] = kinematics::course(self.basis(bank));
        let by = [0.5 * t * t * x, 0.5 * t * t * y, t * x, t * y];
        bank.predict(model, t, period);
        if is_model {
            self.accelerate(&mut bank.plan, by, t, model.straight_sigma.powi(2) * period);
        }
        let v = self.response;
        self.response =
            [v[0] + t * v[2] + by[0], v[1] + t * v[3] + by[1], v[2] + by[2], v[3] + by[3]];
        self.fade(model, t);
    }

    /// Lets the speed begin to change, or become steady again, while the change is no model of the
    /// bank.
    #[inline(always)]
    fn begin(&mut self, bank: &Bank, model: &ImmModel, changes: &Transition, t: f64) {
        let (begins, ends) = rates(model, t);
        let odds = self.odds * (1.0 - ends) + begins;
        let fresh = begins / odds;
        let (own, square) = (1.0 - fresh, self.acceleration.powi(2));
        let variance =
            own * self.variance + fresh * (model.acceleration_sigma.powi(2) + own * square);
        // after a turn, straight flight has no information about the acceleration
        let stays = bank.probability[STRAIGHT] * changes[STRAIGHT][STRAIGHT];
        let returns = bank.probability[TURN] * changes[TURN][STRAIGHT];
        let stays = stays / (stays + returns);
        self.odds = stays * odds / (1.0 - begins + self.odds * ends);
        let kept = stays * own * (self.variance + fresh * square) / variance;
        self.response = self.response.map(|v| v * kept);
        self.acceleration *= own;
        self.variance = variance;
    }

    /// As `begin`, if the change is a model of the bank; also mixes the models.
    #[inline(never)]
    fn mix(&mut self, bank: &mut Bank, model: &ImmModel, changes: &Transition, t: f64) {
        let (begins, ends) = rates(model, t);
        let other = -(-t / OTHER_TIME).exp_m1();
        let [straight, turn] = [changes[STRAIGHT], changes[TURN]];
        let changes = limited([
            [straight[STRAIGHT] - begins, straight[TURN], begins],
            [turn[STRAIGHT], turn[TURN] - other, other],
            [ends, other, 1.0 - ends - other],
        ]);
        let (before, own) = (bank.plan.mean, bank.probability[SPEED] * changes[SPEED][SPEED]);
        bank.mix(&changes, model.turn_rate_sigma.powi(2));
        let own = own / bank.probability[SPEED];
        let (fresh, square) = (1.0 - own, self.acceleration.powi(2));
        let variance =
            own * self.variance + fresh * (model.acceleration_sigma.powi(2) + own * square);
        // the other models have no acceleration, whatever their states
        let moved = before - bank.plan.mean;
        for (i, v) in self.response.iter_mut().enumerate() {
            *v = own * (*v * self.variance + moved[i] * self.acceleration) / variance;
        }
        self.acceleration *= own;
        self.variance = variance;
    }

    /// Predicts the model of the bank, whose state moves by `by` per unit of acceleration.
    fn accelerate(&self, estimate: &mut Estimate<4>, by: [f64; 4], t: f64, q: f64) {
        kinematics::straight(estimate, t, q);
        let v = self.response;
        let before = [v[0] + t * v[2], v[1] + t * v[3], v[2], v[3]];
        let columns = &mut estimate.covariance.data.0;
        for j in 0..4 {
            estimate.mean[j] += self.acceleration * by[j];
            for i in 0..4 {
                let both = before[i] * by[j] + by[i] * before[j] + by[i] * by[j];
                columns[j][i] += self.variance * both;
            }
        }
    }

    /// Lets the acceleration fade towards its distribution at the beginning of a change.
    #[inline(always)]
    fn fade(&mut self, model: &ImmModel, t: f64) {
        let left = exp(-t / FADING);
        let stays = left * left * self.variance;
        let variance = stays + model.acceleration_sigma.powi(2) * (1.0 - left * left);
        let kept = left * self.variance / variance;
        self.response = self.response.map(|v| v * kept);
        self.acceleration *= left;
        self.variance = variance;
    }

    /// Corrects by a position or a velocity, before the bank is corrected.
    #[inline]
    pub fn correct<const AT: usize>(&mut self, bank: &Bank, z: [f64; 2], r: Plane) {
        let estimate = self.basis(bank);
        let y = [z[0] - estimate.mean[AT], z[1] - estimate.mean[AT + 1]];
        let inverse = estimate.block::<AT>().plus(r).inverse();
        let (a, b) = (self.response[AT], self.response[AT + 1]);
        let by = [inverse.xx * a + inverse.xy * b, inverse.xy * a + inverse.yy * b];
        let (information, seen) = (a * by[0] + b * by[1], y[0] * by[0] + y[1] * by[1]);
        let columns = &estimate.covariance.data.0;
        let gains = std::array::from_fn(|i| columns[AT][i] * by[0] + columns[AT + 1][i] * by[1]);
        self.learn(bank, information, seen, &gains);
    }

    /// Forgets the response to the acceleration: position and velocity were corrected in another
    /// way.
    pub fn forget(&mut self) {
        self.response = [0.0; 4];
    }

    /// The estimate to which the response belongs.
    #[inline(always)]
    pub fn basis<'a>(&self, bank: &'a Bank) -> &'a Estimate<4> {
        if bank.probability[SPEED] > 0.0 { &bank.plan } else { &bank.straight }
    }

    /// Corrects by what a measurement says about the acceleration: its information, and what was
    /// `seen` of the acceleration, both weighted with the inverse covariance of the innovation;
    /// `gains` is the change of the response with that of the estimate.
    #[inline]
    pub fn learn(&mut self, bank: &Bank, information: f64, seen: f64, gains: &[f64; 4]) {
        let is_model = bank.probability[SPEED] > 0.0;
        let p = self.variance;
        let (variance, gain) = if is_model {
            // the covariance of the innovation includes that of the acceleration
            (p * (1.0 - p * information).max(f64::EPSILON), p * seen)
        } else {
            let rest = seen - information * self.acceleration;
            let variance = p / (1.0 + p * information);
            let ratio = self.acceleration * (seen - 0.5 * information * self.acceleration)
                + 0.5 * rest * rest * variance;
            self.odds *= exp(ratio.min(LARGEST)) * (variance / p).sqrt();
            (variance, variance * rest)
        };
        let scale = if is_model { p / variance } else { 1.0 };
        for (v, gain) in self.response.iter_mut().zip(gains) {
            *v = scale * (*v - gain);
        }
        self.acceleration += gain;
        self.variance = variance;
    }

    /// Makes the change a model of the bank once it is likely, and removes this model once it is
    /// unlikely.
    #[inline]
    pub fn decide(&mut self, bank: &mut Bank, model: &ImmModel) {
        let probability = self.probability(bank);
        if bank.probability[SPEED] > 0.0 {
            if probability < ENDS {
                bank.probability[SPEED] = 0.0;
                bank.scale((1.0 - probability).recip());
                *self = Self::new(model);
            }
        } else if probability > BEGINS {
            bank.plan = self.added_to(&bank.straight);
            bank.scale(1.0 - probability);
            bank.probability[SPEED] = probability;
        }
    }

    /// Position and velocity if the speed changes, computed from those of straight flight.
    #[inline]
    pub fn added_to(&self, straight: &Estimate<4>) -> Estimate<4> {
        let mut with = *straight;
        for (x, v) in with.mean.iter_mut().zip(self.response) {
            *x += self.acceleration * v;
        }
        self.spread(&mut with, self.variance);
        with
    }

    /// Position and velocity of a bank. If the change is no model of the bank, the mean is that of
    /// the bank, and the covariance includes what an acceleration would add.
    #[inline]
    pub fn estimate(&self, bank: &Bank) -> Estimate<4> {
        let mut estimate = bank.estimate();
        let probability = self.probability(bank);
        if probability > NEGLIGIBLE && bank.probability[SPEED] == 0.0 {
            let square = probability * (self.variance + self.acceleration.powi(2));
            self.spread(&mut estimate, square);
        }
        estimate
    }

    /// Adds the effect of an acceleration with this second moment to a covariance.
    #[inline]
    fn spread(&self, estimate: &mut Estimate<4>, square: f64) {
        let v = self.response;
        for (j, column) in estimate.covariance.data.0.iter_mut().enumerate() {
            let of_column = square * v[j];
            for (entry, v) in column.iter_mut().zip(v) {
                *entry += of_column * v;
            }
        }
    }
}

/// A prediction of all models, in vectors as wide as those of the processor.
struct Prediction<'a> {
    speed: &'a mut SpeedChange,
    bank: &'a mut Bank,
    model: &'a ImmModel,
    changes: &'a Transition,
    over: (f64, f64),
}

impl WithSimd for Prediction<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { speed, bank, model, changes, over } = self;
        speed.predict_all(bank, model, changes, over);
    }
}

/// Probabilities that the speed begins to change within the time `t`, and that it becomes steady
/// again.
#[inline(always)]
fn rates(model: &ImmModel, t: f64) -> (f64, f64) {
    (1.0 - exp(-t / model.steady_time), 1.0 - exp(-t / model.speed_change_time))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_within;
    use crate::base::random::Random;
    use crate::sensors::radar_of;
    use crate::tracker::filter::Filter;
    use crate::tracker::motion::Motion;
    use crate::tracker::motion::estimate::{POSITION, VELOCITY};
    use crate::tracker::motion::imm::changes;
    use crate::tracker::settings::Settings;
    use nalgebra::{Matrix2, Matrix2x5, Matrix5, SMatrix, SVector, Vector2, Vector5};

    const R: Plane = Plane { xx: 2500.0, xy: 900.0, yy: 6400.0 };
    const PERIOD: f64 = 4.0;

    fn start() -> Estimate<4> {
        let covariance = SMatrix::from_diagonal(&SVector::from([4e3, 5e3, 200.0, 300.0]));
        Estimate { mean: SVector::from([1e3, 2e3, 180.0, 90.0]), covariance }
    }

    /// Corrects the filter with five states; returns the density of the plot.
    fn correct<const AT: usize>(
        x: &mut Vector5<f64>,
        p: &mut Matrix5<f64>,
        z: [f64; 2],
        r: Plane,
    ) -> f64 {
        let mut h = Matrix2x5::zeros();
        (h[(0, AT)], h[(1, AT + 1)]) = (1.0, 1.0);
        let s = h * *p * h.transpose() + Matrix2::new(r.xx, r.xy, r.xy, r.yy);
        let inverse = s.try_inverse().unwrap();
        let y = Vector2::from(z) - h * *x;
        let gain = *p * h.transpose() * inverse;
        *x += gain * y;
        *p -= gain * h * *p;
        (-0.5 * (y.transpose() * inverse * y)[0]).exp()
            / (std::f64::consts::TAU * s.determinant().sqrt())
    }

    /// No model changes by itself, so that the change of speed is one filter with five states:
    /// exactly so if it is a model of the bank, and otherwise except for what the acceleration has
    /// lost by fading.
    #[test]
    fn a_change_of_speed_is_a_filter_with_one_more_state() {
        let never = 1e18;
        let model = ImmModel {
            straight_time: never,
            steady_time: never,
            speed_change_time: never,
            ..ImmModel::default()
        };
        for is_model in [false, true] {
            let mut bank = Bank::new(start(), 0.0, 1e-4);
            let mut speed = SpeedChange::new(&model);
            if is_model {
                bank.probability = [0.5, 0.0, 0.5];
            }
            let mut x = Vector5::from([1e3, 2e3, 180.0, 90.0, 0.0]);
            let mut p = Matrix5::from_diagonal(&Vector5::from([4e3, 5e3, 200.0, 300.0, 0.25]));
            for k in 0..12 {
                let basis = if is_model { bank.plan.mean } else { bank.straight.mean };
                let u = Vector2::new(basis[2], basis[3]).normalize();
                // otherwise the change of speed would end in a turn at some time
                speed.predict(&mut bank, &model, &changes(&model, PERIOD), (PERIOD, PERIOD));
                if is_model {
                    bank.probability = [0.5, 0.0, 0.5];
                }
                let mut f = Matrix5::identity();
                for i in 0..2 {
                    f[(i, i + 2)] = PERIOD;
                    f[(i, 4)] = 0.5 * PERIOD * PERIOD * u[i];
                    f[(i + 2, 4)] = PERIOD * u[i];
                }
                f[(4, 4)] = (-PERIOD / FADING).exp();
                x = f * x;
                p = f * p * f.transpose();
                p[(4, 4)] += 0.25 * (1.0 - f[(4, 4)].powi(2));
                let mut wide = Estimate { mean: x, covariance: p };
                let q = model.straight_sigma.powi(2) * PERIOD;
                wide.accelerate(Plane { xx: q, xy: 0.0, yy: q }, PERIOD);
                p = wide.covariance;
                let t = PERIOD * f64::from(k + 1);
                let z = [1e3 + 170.0 * t, 2e3 + 85.0 * t - 0.2 * t * t];
                let tolerance =
                    if is_model { 1e-6 } else { 3e-5 * f64::from((k + 1) * (k + 1) * (k + 1)) };
                let odds = speed.odds;
                speed.correct::<POSITION>(&bank, z, R);
                let before = bank.straight;
                bank.correct::<POSITION>(z, R);
                let density = correct::<POSITION>(&mut x, &mut p, z, R);
                if !is_model {
                    let mut straight = before;
                    assert_within(tolerance, speed.odds / odds, density / straight.correct(z, R));
                }
                if k % 4 == 3 {
                    let (v, r) = ([171.0, 85.0 - 0.4 * t], R.scaled(0.01));
                    speed.correct::<VELOCITY>(&bank, v, r);
                    bank.correct::<VELOCITY>(v, r);
                    correct::<VELOCITY>(&mut x, &mut p, v, r);
                }
                let found = if is_model { bank.plan } else { speed.added_to(&bank.straight) };
                let sigmas = p.diagonal().map(f64::sqrt);
                for i in 0..4 {
                    assert!((found.mean[i] - x[i]).abs() < tolerance * sigmas[i], "{k} {i}");
                    let both = speed.response[i] * speed.variance;
                    assert!(
                        (both - p[(i, 4)]).abs() < tolerance * sigmas[i] * sigmas[4],
                        "{k} {i}"
                    );
                    for j in 0..4 {
                        let off = (found.covariance[(i, j)] - p[(i, j)]).abs();
                        assert!(off < tolerance * sigmas[i] * sigmas[j], "{k} {i} {j}");
                    }
                }
                assert!((speed.acceleration - x[4]).abs() < tolerance * sigmas[4]);
                assert_within(tolerance, speed.variance, p[(4, 4)]);
            }
        }
    }

    /// Mean error along the course and mean NEES per axis of velocities, in the last 40 s of a minute of
    /// braking by 0.5 m/s² and in the two minutes before it.
    fn braking(model: ImmModel) -> [[f64; 2]; 2] {
        let motion = Motion::Imm(model);
        let settings = Settings::new(vec![radar_of([50.0, 1e-3])], motion);
        let mut random = Random::new(12);
        let r = Plane { xx: 50.0 * 50.0, xy: 0.0, yy: 60.0 * 60.0 };
        let mut normal = || {
            let (size, angle) = (1.0 - random.uniform(), std::f64::consts::TAU * random.uniform());
            (-2.0 * size.ln()).sqrt() * angle.cos()
        };
        let mut sums = [[0.0; 3]; 2];
        for _ in 0..60 {
            let covariance = SMatrix::from_diagonal(&SVector::from([r.xx, r.yy, 100.0, 100.0]));
            let mean =
                SVector::from([50.0 * normal(), 60.0 * normal(), 220.0 + 10.0 * normal(), 0.0]);
            let mut filter = Filter::new(&motion, Estimate { mean, covariance });
            for scan in 1..=60 {
                let t = PERIOD * f64::from(scan);
                let since = (t - 180.0).max(0.0);
                let [way, speed] = [220.0 * t - 0.25 * since * since, 220.0 - 0.5 * since];
                filter.predict(&settings, &motion, PERIOD, PERIOD);
                filter.correct(&motion, [way + 50.0 * normal(), 60.0 * normal()], r);
                let e = filter.estimate();
                let own = e.covariance.fixed_view::<2, 2>(2, 2).try_inverse().unwrap();
                let off = Vector2::new(e.mean[2] - speed, e.mean[3]);
                let when = usize::from(t > 200.0);
                if t > 60.0 && !(180.0..=200.0).contains(&t) {
                    let nees = 0.5 * (off.transpose() * own * off)[0];
                    let of = &mut sums[when];
                    *of = [of[0] + off.x, of[1] + nees, of[2] + 1.0];
                }
            }
        }
        sums.map(|[off, nees, count]| [off / count, nees / count])
    }

    #[test]
    fn a_target_that_brakes_is_followed() {
        let [straight, brakes] = braking(ImmModel::default());
        // without the model of changes of speed
        let [_, lags] = braking(ImmModel { steady_time: 1e12, ..ImmModel::default() });
        assert!(straight[0].abs() < 0.3 && straight[1] < 1.0, "{straight:?}");
        assert!(brakes[0] < 3.0 && brakes[1] < 3.0, "{brakes:?}");
        assert!(lags[0] > 6.0 && lags[1] > 6.0, "{lags:?}");
    }

    #[test]
    fn a_change_that_has_become_unlikely_is_forgotten() {
        let model = ImmModel::default();
        let mut bank = Bank::new(start(), 0.1, 1e-4);
        let mut speed = SpeedChange::new(&model);
        speed.odds = 1.0;
        speed.response = [50.0, 20.0, 10.0, 5.0];
        speed.decide(&mut bank, &model);
        assert_within(1e-12, bank.total(), 1.0);
        // odds against straight flight, which had nine tenths
        assert_within(1e-12, bank.probability[SPEED], 0.9 / 1.9);
        let rises = bank.plan.covariance - bank.straight.covariance;
        assert_within(1e-9, rises[(0, 2)], 0.25 * 50.0 * 10.0);
        bank.probability = [0.9, 0.06, 0.04];
        speed.decide(&mut bank, &model);
        assert_within(1e-12, bank.total(), 1.0);
        assert_eq!((bank.probability[SPEED], speed), (0.0, SpeedChange::new(&model)));
    }
}
