//! The medium of the signals: their speed and the wind, which depend on each other.
//!
//! Each of the two is estimated with the other as found last, until the speed no longer changes. The
//! variance of each then grows by the uncertainty of the other: if b is the derivative of the wind with
//! respect to the relative difference of the speed, the information about this difference decreases by
//! `bᵀ Σ⁻¹ b`, and the covariance Σ of the wind increases by `b bᵀ` times the variance of the
//! difference.

mod side;
pub(super) mod speed;
mod steady;
pub(super) mod wind;

use super::search::fix::Instant;
use super::solver::{Locator, Workspace};
use crate::base::small::{Factor, dot};
use crate::sensors::KINDS;
use speed::Speed;
use steady::WRONG;
use wind::Wind;

/// Largest number of rounds.
const ROUNDS: usize = 20;
/// Change of the speed, in its standard deviations, below which the rounds end.
const SETTLED: f64 = 0.02;

/// Measurements and their standard deviations, 5 K numbers of each instant.
#[derive(Clone)]
struct Measured {
    receivers: usize,
    values: Vec<f64>,
    sigmas: Vec<f64>,
}

/// Speed and wind, and the measurements as they would be in still air at this speed.
#[derive(Clone, Debug)]
pub struct Medium {
    /// Speed of the signals.
    pub speed: Speed,
    /// Wind; `None` if no wind is assumed.
    pub wind: Option<Wind>,
    /// Measurements in still air, 5 K numbers of each instant.
    pub values: Vec<f64>,
    /// Standard deviations of these measurements.
    pub sigmas: Vec<f64>,
}

impl Medium {
    /// Returns the measurements in still air and their standard deviations.
    fn still(&self) -> (&[f64], &[f64]) {
        (&self.values, &self.sigmas)
    }
}

impl Measured {
    fn of(instants: &[Instant<'_>]) -> Self {
        let receivers = instants.first().map_or(1, |one| one.values.len() / KINDS);
        let all = |of: for<'a> fn(&Instant<'a>) -> &'a [f64]| {
            instants.iter().flat_map(|one| of(one).to_vec()).collect()
        };
        Self { receivers, values: all(|one| one.values), sigmas: all(|one| one.sigmas) }
    }

    /// Returns the measurements if the signals are faster by this share.
    fn faster(&self, share: f64) -> Self {
        let mut all = self.clone();
        let speed = Speed { share, ..Speed::EXACT };
        speed.apply(&mut all.values, self.receivers);
        speed.apply(&mut all.sigmas, self.receivers);
        all
    }

    fn instants<'a>(&'a self, like: &[Instant<'a>]) -> Vec<Instant<'a>> {
        let size = KINDS * self.receivers;
        let own = self.values.chunks(size).zip(self.sigmas.chunks(size));
        like.iter()
            .zip(own)
            .map(|(one, (values, sigmas))| Instant { values, sigmas, ..*one })
            .collect()
    }
}

impl Locator {
    /// As [`Self::medium`], but with the stated speed, or in still air, where this is `as_stated` unless the
    /// instants contradict it.
    pub fn medium_as_stated<const D: usize>(
        &self,
        instants: &[Instant<'_>],
        sigmas: (f64, f64),
        as_stated: (bool, bool),
        workspace: &mut Workspace<D>,
    ) -> Medium {
        let known = kept(sigmas, (!as_stated.0, !as_stated.1));
        let doubted = kept(sigmas, as_stated);
        if instants.len() < 2 {
            return self.medium(instants, known, workspace);
        }
        let (speed, wind) = self.may_have_other_medium(instants, doubted, workspace);
        // the wind alone is found fastest; the speed alone may look like a wind
        if wind {
            let own = kept(sigmas, (!as_stated.0, true));
            let found = self.medium(instants, own, workspace);
            if self.is_blown(
                instants,
                found.still(),
                found.wind.as_ref(),
                (doubted.0, sigmas.1),
                workspace,
            ) {
                return found;
            }
        }
        if speed && wind {
            let found = self.medium(instants, sigmas, workspace);
            if is_other(found.speed)
                && self.is_blown(
                    instants,
                    found.still(),
                    found.wind.as_ref(),
                    (0.0, sigmas.1),
                    workspace,
                )
            {
                return found;
            }
        }
        if speed {
            let own = kept(sigmas, (true, !as_stated.1));
            let found = self.medium(instants, own, workspace);
            if is_other(found.speed) {
                return found;
            }
        }
        self.medium(instants, known, workspace)
    }

    /// Estimates the medium. The arguments are the standard deviations of the relative difference of
    /// the speed and of the wind in units of the speed, 0 for what is known. O(N M).
    pub fn medium<const D: usize>(
        &self,
        instants: &[Instant<'_>],
        (speed_sigma, wind_sigma): (f64, f64),
        workspace: &mut Workspace<D>,
    ) -> Medium {
        let raw = Measured::of(instants);
        let (mut still, mut speed, mut wind) = (raw.clone(), Speed::EXACT, None);
        for _ in 0..ROUNDS {
            let before = speed;
            if speed_sigma > 0.0 {
                speed = self.speed(&still.instants(instants), speed_sigma, workspace);
            }
            if wind_sigma > 0.0 {
                let moved = raw.faster(speed.share);
                let moved = moved.instants(instants);
                let found = self.wind(&moved, wind_sigma, workspace);
                let values = self.in_still_air(&moved, &found, workspace);
                still = Measured { values, ..raw.faster(speed.share) };
                still = still.faster((1.0 + speed.share).recip() - 1.0);
                wind = Some(found);
            }
            let change = (speed.share - before.share).abs();
            if wind.is_none() || change <= SETTLED * speed.sigma {
                break;
            }
        }
        let found = still.faster(speed.share);
        if let Some(wind) = wind.as_mut().filter(|_| speed_sigma > 0.0) {
            let slope = [-1.0, 1.0].map(|sign| {
                let moved = raw.faster(speed.share + sign * speed.sigma);
                self.wind(&moved.instants(instants), wind_sigma, workspace).mean
            });
            let slope = [0, 1].map(|a| (slope[1][a] - slope[0][a]) / (2.0 * speed.sigma));
            speed = widened(speed, speed_sigma, wind, slope);
        }
        let Measured { values, sigmas, .. } = found;
        Medium { speed, wind, values, sigmas }
    }
}

/// Whether it is surely another speed than the stated one.
fn is_other(speed: Speed) -> bool {
    speed.share.abs() > WRONG * speed.sigma
}

/// Returns these standard deviations, 0 for what is not marked.
fn kept((speed, wind): (f64, f64), marks: (bool, bool)) -> (f64, f64) {
    (if marks.0 { speed } else { 0.0 }, if marks.1 { wind } else { 0.0 })
}

/// Returns the speed with the uncertainty due to the wind, and adds the uncertainty due to the speed to
/// the wind.
fn widened(speed: Speed, prior: f64, wind: &mut Wind, slope: [f64; 2]) -> Speed {
    let Some(factor) = Factor::try_new(&wind.covariance, 0.0) else { return speed };
    let least = prior.powi(-2);
    let information = (speed.sigma.powi(-2) - dot(&slope, &factor.solve(&slope))).max(least);
    for i in 0..2 {
        for j in 0..2 {
            wind.covariance[i][j] += slope[i] * slope[j] / information;
        }
    }
    Speed { sigma: information.sqrt().recip(), ..speed }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_within;

    /// With a joint information matrix, conditional variances become marginal ones.
    #[test]
    fn variances_are_those_of_both_together() {
        // share, and wind east and north: information 4, 2 and 2, and −1 between share and east
        let mut wind = Wind { mean: [0.0; 2], covariance: [[0.5, 0.0], [0.0, 0.5]] };
        let speed = Speed { share: 0.0, sigma: 0.5, alone: 0.5 };
        let found = widened(speed, 10.0, &mut wind, [0.5, 0.0]);
        assert_within(1e-14, found.sigma.powi(2), 1.0 / 3.5);
        assert_within(1e-14, wind.covariance[0][0], 4.0 / 7.0);
        assert_eq!(wind.covariance[1], [0.0, 0.5]);
        // the variance is not larger than that of the prior
        let found = widened(speed, 0.5, &mut wind, [9.0, 0.0]);
        assert_within(1e-14, found.sigma, 0.5);
    }
}
