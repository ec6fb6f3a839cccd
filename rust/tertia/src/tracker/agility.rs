//! How much more than usual a target manoeuvres, by its own innovations.
//!
//! Innovations of a filter whose models fit are not correlated, whatever the noise of plots is (Mehra 1970).
//! Where a target manoeuvres more often or more sharply than the models expect, each one points the same way
//! as those before it: the models are then adapted until that is no longer so.

use super::motion::ImmModel;
use crate::base::exponential::exp;
use crate::base::plane::Plane;
use serde::{Deserialize, Serialize};

/// Share of the newest innovation, and of the newest interval, in their running means.
const MEMORY: f64 = 0.5;
/// By how much the level follows the product of an innovation and the mean of those before it, in a scan,
/// the product that keeps it, and the largest one that counts.
const GAIN: f64 = 0.6;
const KEPT: f64 = 0.02;
const LARGEST: f64 = 4.0;
/// Share of the newest square of an innovation in their running mean, and the largest one that counts.
const SCATTER: f64 = 0.1;
const FAR: f64 = 8.0;
/// Levels from which manoeuvres are more frequent, and from which they are sharper, than usual; noise
/// alone seldom reaches the first one.
const FREQUENT: f64 = 1.0;
const SHARP: f64 = 2.0;
/// The highest level: variances in manoeuvres are a hundred times the usual one.
const HIGHEST: f64 = 6.6;
/// Variance of a velocity by an acceleration that has not been noticed yet, over that by one that has lasted
/// for such a time.
const UNNOTICED: f64 = 1.3;
/// The level of a target: 0 where it manoeuvres no more than usual.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Agility {
    level: f64,
    /// Running mean of innovations, m.
    lag: [f64; 2],
    /// Running mean of their normalised squares, over what is expected: less than 1 where noise is less than
    /// stated.
    scatter: f64,
    /// Seconds and scans since the last plot, and running means of them.
    since: [f64; 2],
    interval: [f64; 2],
    /// Standard deviation of the usual acceleration in turns, m/s².
    sigma: f64,
}

impl Default for Agility {
    fn default() -> Self {
        let [since, interval] = [[0.0; 2]; 2];
        Self { level: 0.0, lag: [0.0; 2], scatter: 1.0, since, interval, sigma: 0.0 }
    }
}

impl Agility {
    /// Sees an innovation of covariance `s`. Cost O(1).
    #[inline]
    pub fn saw(&mut self, [x, y]: [f64; 2], s: Plane) {
        let inverse = s.inverse();
        let [a, b] = self.lag;
        let product = inverse.xx * x * a + inverse.xy * (x * b + y * a) + inverse.yy * y * b;
        let step = (0.5 * product).clamp(-LARGEST, LARGEST) - KEPT;
        self.scatter += SCATTER * ((0.5 * inverse.form([x, y])).min(FAR) - self.scatter);
        // of several radars each plot tells less that is new
        let share = self.since[1].min(1.0);
        self.level = (self.level + GAIN * share * step).clamp(0.0, HIGHEST);
        self.lag = [a + MEMORY * (x - a), b + MEMORY * (y - b)];
        for (mean, since) in self.interval.iter_mut().zip(&mut self.since) {
            *mean += MEMORY * (*since - *mean);
            *since = 0.0;
        }
    }

    /// How the target moves in the next seconds, where targets usually move as the model says; `period` is
    /// that of the scans.
    #[inline]
    pub fn adapted(&mut self, usual: &ImmModel, seconds: f64, period: f64) -> ImmModel {
        self.since[0] += seconds;
        self.since[1] += seconds / period;
        self.sigma = usual.turn_sigma;
        self.model(usual)
    }

    /// How the target moves where targets usually move so.
    #[inline]
    pub fn model(&self, usual: &ImmModel) -> ImmModel {
        if self.level <= FREQUENT {
            return *usual;
        }
        let often = exp(0.5 * (self.level - FREQUENT));
        let shorter = |mean: f64, least: f64| (mean / often).max(mean.min(least));
        ImmModel {
            straight_time: shorter(usual.straight_time, usual.turn_time),
            steady_time: shorter(usual.steady_time, usual.speed_change_time),
            turn_rate_sigma: usual.turn_rate_sigma * often.sqrt(),
            turn_sigma: usual.turn_sigma * exp(0.5 * (self.level - SHARP).max(0.0)),
            ..*usual
        }
    }

    /// Variance of the velocity, along any axis, by a manoeuvre that has not been noticed yet: how long that
    /// takes lies between the interval of plots and a scan, and is less where noise is less than stated.
    #[inline]
    pub fn unnoticed(&self) -> f64 {
        let [interval, scans] = self.interval;
        if self.level <= SHARP || scans == 0.0 {
            return 0.0;
        }
        let more = exp(self.level - SHARP) - 1.0;
        let (plots, noise) = ((self.sigma * interval).powi(2) / scans, self.scatter.min(1.0));
        UNNOTICED * more * plots * noise * noise
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_within;
    use crate::base::random::Random;

    const S: Plane = Plane { xx: 9000.0, xy: 2000.0, yy: 6000.0 };

    /// After plots whose innovations have this mean and so many times the stated noise.
    fn after(start: Agility, plots: usize, mean: [f64; 2], noise: f64) -> Agility {
        let (mut found, mut random) = (start, Random::new(3));
        let usual = ImmModel::default();
        for _ in 0..plots {
            let (size, angle) = (1.0 - random.uniform(), std::f64::consts::TAU * random.uniform());
            let radius = noise * (-2.0 * size.ln()).sqrt();
            let [a, b] = [radius * angle.cos(), radius * angle.sin()];
            let y = [S.xx.sqrt() * a, S.xy / S.xx.sqrt() * a + (S.determinant() / S.xx).sqrt() * b];
            found.adapted(&usual, 4.0, 4.0);
            found.saw([mean[0] + y[0], mean[1] + y[1]], S);
        }
        found
    }

    #[test]
    fn noise_is_no_manoeuvre() {
        let usual = ImmModel::default();
        let found = after(Agility::default(), 400, [0.0; 2], 0.5);
        assert!(found.level < FREQUENT, "{found:?}");
        let mut quiet =
            Agility { level: FREQUENT, sigma: 0.8, interval: [4.0, 1.0], ..Agility::default() };
        assert_eq!((quiet.adapted(&usual, 4.0, 4.0), quiet.unnoticed()), (usual, 0.0));
    }

    #[test]
    fn innovations_that_point_the_same_way_are_manoeuvres() {
        let usual = ImmModel::default();
        let mut agile = after(Agility::default(), 12, [200.0, -100.0], 0.5);
        assert!(agile.level > SHARP, "{agile:?}");
        let found = agile.adapted(&usual, 4.0, 4.0);
        assert!(
            found.turn_sigma > usual.turn_sigma && found.turn_rate_sigma > usual.turn_rate_sigma
        );
        assert!(found.straight_time < usual.straight_time && found.steady_time < usual.steady_time);
        // but no shorter than manoeuvres are
        let mut most = Agility { level: HIGHEST, ..agile };
        let found = most.adapted(&ImmModel { straight_time: 60.0, ..usual }, 4.0, 4.0);
        assert_eq!(found.straight_time, usual.turn_time);
        assert_eq!(found.steady_time, usual.speed_change_time);
        assert_within(1e-12, found.turn_sigma, usual.turn_sigma * (0.5 * (HIGHEST - SHARP)).exp());
        let noise = most.scatter.min(1.0).powi(2);
        let variance =
            UNNOTICED * noise * ((HIGHEST - SHARP).exp() - 1.0) * (0.8 * 4.0_f64).powi(2);
        assert_within(1e-3, most.unnoticed(), variance);
        // each innovation against the one before: the models expect more than happens
        for k in 0..40 {
            let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
            agile.adapted(&usual, 4.0, 4.0);
            agile.saw([180.0 * sign, 120.0 * sign], S);
        }
        assert_eq!(agile.level, 0.0);
    }
}
