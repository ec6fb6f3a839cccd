//! Turns that are so sharp that no model follows them, such as those of gliders in thermals.
//!
//! If plots do not fit the models of a track, turns at several rates are followed beside them. Once the plots are
//! much likelier in one of these turns, it becomes the turn of the models.

use super::ImmModel;
use super::estimate::Estimate;
use super::imm::{Bank, TURN, entered};
use super::kinematics;
use crate::base::plane::Plane;
use serde::{Deserialize, Serialize};

/// Largest rates that are followed, rad/s, and largest turns from plot to plot, rad; standard deviation of a rate,
/// relative to the largest one.
const RATES: [f64; 2] = [0.19, 0.31];
const ANGLES: [f64; 2] = [0.76, 1.25];
const SPREAD: f64 = 0.35;
/// Random walk of the rate, relative to the usual one.
const WALK: f64 = 5.0;
/// Logarithm of the likelihood ratio of a turn and the models from which on the turn is believed, and below which
/// it is given up.
const SURE: f64 = 8.0;
const LOST: f64 = -8.0;
/// Least probability of the turn, if it is believed.
const BELIEVED: f64 = 0.9;
/// Least and largest logarithm of the likelihood ratio of a plot: a single one, which may be an outlier, proves
/// nothing.
const OF_PLOT: [f64; 2] = [-8.0, 3.0];

/// Turns at several rates, and logarithms of their likelihood ratios.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Circles([(Estimate<5>, f64); 4]);

impl Circles {
    /// Begins turns from this state, for plots at this interval, s; the velocity has an error of `sigma`, m/s, in
    /// addition.
    pub fn new(start: &Estimate<4>, interval: f64, sigma: f64) -> Self {
        let begin = |k: usize| {
            let rate = RATES[k / 2].min(ANGLES[k / 2] / interval);
            let mut turn = entered(start, (SPREAD * rate).powi(2));
            turn.mean[4] = [rate, -rate][k % 2];
            (2..4).for_each(|i| turn.covariance[(i, i)] += sigma * sigma);
            (turn, 0.0)
        };
        Self(std::array::from_fn(begin))
    }

    pub fn predict(&mut self, model: &ImmModel, t: f64, period: f64) {
        let (q, walk) = (model.turn_sigma.powi(2) * period, WALK * model.turn_rate_walk);
        self.0.iter_mut().for_each(|(turn, _)| kinematics::turn(turn, t, q, walk));
    }

    /// Corrects the turns by a position or a velocity, which has this `density` by the models.
    pub fn correct<const AT: usize>(&mut self, z: [f64; 2], r: Plane, density: f64) {
        for (turn, odds) in &mut self.0 {
            let ratio = turn.correct_at::<AT>(z, r) / density;
            *odds += ratio.ln().clamp(OF_PLOT[0], OF_PLOT[1]);
        }
    }

    /// Puts the likeliest turn into the bank, if it is much likelier than the bank. Returns whether to go on.
    pub fn decide(&self, bank: &mut Bank) -> bool {
        let mut all = self.0.iter();
        let Some(first) = all.next() else { return false };
        let (turn, odds) = all.fold(first, |best, own| if own.1 > best.1 { own } else { best });
        if *odds > SURE {
            let total = bank.total();
            let others = total - bank.probability[TURN];
            let left = others.min((1.0 - BELIEVED) * total);
            let shrink = if others > 0.0 { left / others } else { 0.0 };
            bank.probability.iter_mut().for_each(|p| *p *= shrink);
            bank.probability[TURN] = total - left;
            bank.turn = *turn;
            return false;
        }
        *odds > LOST
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tracker::motion::imm::changes;
    use nalgebra::{SMatrix, SVector};

    /// The bank after twelve plots, 4 s apart, of a target that turns at this rate with 25 m/s.
    fn after(rate: f64) -> Bank {
        let (model, r) = (ImmModel::default(), Plane { xx: 900.0, xy: 0.0, yy: 900.0 });
        let seen = |k: u32| {
            let (time, off) = (4.0 * f64::from(k), 20.0 * f64::from(k % 3));
            let arc = kinematics::Arc::new(rate, time);
            [25.0 * arc.along + off - 20.0, 25.0 * arc.across - off + 20.0]
        };
        let start = Estimate {
            mean: SVector::from([0.0, 0.0, if rate == 0.0 { 25.0 } else { 0.0 }, 0.0]),
            covariance: SMatrix::from_diagonal(&SVector::from([900.0, 900.0, 25.0, 25.0])),
        };
        let mut bank = Bank::new(start, 0.1, 4e-4);
        let mut circles = Some(Circles::new(&start, 4.0, 20.0));
        for k in 1..=12 {
            bank.mix(&changes(&model, 4.0), model.turn_rate_sigma.powi(2));
            bank.predict(&model, 4.0, 4.0);
            bank.correct::<0>(seen(k), r);
            let density = bank.total();
            bank.scale(density.recip());
            if let Some(own) = &mut circles {
                own.predict(&model, 4.0, 4.0);
                own.correct::<0>(seen(k), r, density);
                if !own.decide(&mut bank) {
                    circles = None;
                }
            }
        }
        assert!((bank.total() - 1.0).abs() < 1e-12);
        bank
    }

    #[test]
    fn circles_are_found_where_there_are_any() {
        for rate in [-0.3, -0.2, 0.25, 0.35] {
            let bank = after(rate);
            assert!(bank.probability[TURN] > 0.6, "{rate} {:?}", bank.probability);
            assert!((bank.turn.mean[4] - rate).abs() < 0.05, "{rate} {}", bank.turn.mean[4]);
        }
        let straight = after(0.0);
        assert!(straight.probability[TURN] < 0.3 && straight.turn.mean[4].abs() < 0.03);
    }
}
