//! Estimates from its innovations how much more than usual a target manoeuvres.
//!
//! The innovations of a filter whose models fit are not correlated, whatever the size of the noise (Mehra
//! 1970). If a target manoeuvres more often or more sharply than the models expect, successive innovations
//! point the same way: the models are then adapted until they no longer do.

use super::ImmModel;
use crate::base::exponential::exp;
use crate::base::plane::Plane;
use serde::{Deserialize, Serialize};

/// Weight of the newest innovation, and of the newest interval, in their running means.
const MEMORY: f64 = 0.5;
/// The level follows the normalised product of each innovation and the mean of earlier ones: gain per scan,
/// product at which the level does not change, and largest product that counts.
const GAIN: f64 = 0.6;
const KEPT: f64 = 0.02;
const LARGEST: f64 = 4.0;
/// Weight of the newest normalised squared innovation in its running mean, and the largest one that counts.
const SCATTER: f64 = 0.1;
const FAR: f64 = 8.0;
/// Running mean from which on plots do not fit the models.
const SCATTERED: f64 = 1.6;
/// Levels above which manoeuvres are more frequent, and above which they are also sharper, than usual; noise
/// alone seldom exceeds the first one.
const FREQUENT: f64 = 1.0;
const SHARP: f64 = 2.0;
/// Highest level: variances in manoeuvres are a hundred times the usual ones.
const HIGHEST: f64 = 6.6;
/// Ratio of the variance of the velocity by an unnoticed acceleration to that by an acceleration that has
/// lasted for the whole time until it is noticed.
const UNNOTICED: f64 = 1.3;
/// Weight of the newest normalised squared innovation in the longer mean, and the mean from which on the target
/// moves about its track in a way that no model describes.
const LONGER: f64 = 0.04;
const MISFIT: f64 = 1.4;
/// Fastest rate of such a motion, rad/s, and its largest angle from plot to plot, rad.
const FASTEST: f64 = 0.35;
const ANGLE: f64 = std::f64::consts::PI;

/// Rate of a motion that plots at this interval, s, do not resolve, rad/s: velocities are displacements times it.
pub(in crate::tracker) fn rate_of_misfit(interval: f64) -> f64 {
    FASTEST.min(ANGLE / interval)
}

/// How agile a target is: its level is 0 if it manoeuvres no more than usual.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Agility {
    level: f64,
    /// Running mean of the innovations, m.
    lag: [f64; 2],
    /// Running mean of the normalised squared innovations over the expected value: less than 1 if the noise
    /// is less than stated.
    scatter: f64,
    /// The same over a longer time, the variance of the last innovation, m², and the share of the variance of the
    /// position that it has left.
    misfit: f64,
    size: f64,
    pub left: f64,
    /// Seconds and scans since the last plot, and (`interval`) running means of both.
    since: [f64; 2],
    interval: [f64; 2],
    /// Standard deviation of the usual acceleration in turns, m/s².
    sigma: f64,
}

impl Default for Agility {
    fn default() -> Self {
        let [since, interval] = [[0.0; 2]; 2];
        let [scatter, misfit, left] = [1.0; 3];
        let [level, size, sigma] = [0.0; 3];
        Self { level, lag: [0.0; 2], scatter, misfit, size, left, since, interval, sigma }
    }
}

impl Agility {
    /// Updates the level by an innovation of covariance `s`. Cost O(1).
    #[inline]
    pub fn saw(&mut self, [x, y]: [f64; 2], s: Plane) {
        let inverse = s.inverse();
        let [a, b] = self.lag;
        let product = inverse.xx * x * a + inverse.xy * (x * b + y * a) + inverse.yy * y * b;
        let step = (0.5 * product).clamp(-LARGEST, LARGEST) - KEPT;
        let square = (0.5 * inverse.form([x, y])).min(FAR);
        self.scatter += SCATTER * (square - self.scatter);
        self.misfit += LONGER * (square - self.misfit);
        self.size = 0.5 * (s.xx + s.yy);
        // with several radars, each plot contains less new information
        let share = self.since[1].min(1.0);
        self.level = (self.level + GAIN * share * step).clamp(0.0, HIGHEST);
        self.lag = [a + MEMORY * (x - a), b + MEMORY * (y - b)];
        for (mean, since) in self.interval.iter_mut().zip(&mut self.since) {
            *mean += MEMORY * (*since - *mean);
            *since = 0.0;
        }
    }

    /// Returns the model of the target for a prediction over some `seconds`, adapted from the `usual` model
    /// of targets; `period` is the scan period.
    #[inline]
    pub fn adapted(&mut self, usual: &ImmModel, seconds: f64, period: f64) -> ImmModel {
        self.since[0] += seconds;
        self.since[1] += seconds / period;
        self.sigma = usual.turn_sigma;
        self.model(usual)
    }

    /// Returns the model of the target at its present level, adapted from the `usual` model of targets.
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

    /// Whether the plots do not fit the models.
    #[inline]
    pub fn is_restless(&self) -> bool {
        self.level > FREQUENT || self.scatter > SCATTERED
    }

    /// Mean time between plots, s.
    pub fn interval(&self) -> f64 {
        self.interval[0]
    }

    /// Variances of the position, m², and of the velocity, along any axis, by motion about the track that no
    /// model describes.
    #[inline]
    pub fn unmodelled(&self) -> [f64; 2] {
        if self.misfit <= MISFIT {
            return [0.0; 2];
        }
        let about = (self.misfit - 1.0) * self.size;
        [about * self.left, about * rate_of_misfit(self.interval[0]).powi(2)]
    }

    /// Additional variance of the velocity, along any axis, by a manoeuvre that has not been noticed yet. The
    /// time until a manoeuvre is noticed lies between the interval of plots and a scan; the variance is less
    /// if the noise is less than stated.
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

    /// The agility after plots whose innovations have this mean and `noise` times the stated noise.
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
        // but the times between manoeuvres are no shorter than manoeuvres
        let mut most = Agility { level: HIGHEST, ..agile };
        let found = most.adapted(&ImmModel { straight_time: 60.0, ..usual }, 4.0, 4.0);
        assert_eq!(found.straight_time, usual.turn_time);
        assert_eq!(found.steady_time, usual.speed_change_time);
        assert_within(1e-12, found.turn_sigma, usual.turn_sigma * (0.5 * (HIGHEST - SHARP)).exp());
        let noise = most.scatter.min(1.0).powi(2);
        let variance =
            UNNOTICED * noise * ((HIGHEST - SHARP).exp() - 1.0) * (0.8 * 4.0_f64).powi(2);
        assert_within(1e-3, most.unnoticed(), variance);
        // each innovation points against the one before: the models expect more than happens
        for k in 0..40 {
            let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
            agile.adapted(&usual, 4.0, 4.0);
            agile.saw([180.0 * sign, 120.0 * sign], S);
        }
        assert_eq!(agile.level, 0.0);
    }
}
