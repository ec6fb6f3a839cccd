//! Detection of radars that repeat their last plot.
//!
//! A radar that is stuck, or whose software reports the last plot again, gives the same number. Noise of
//! standard deviation σ that is recorded in steps of d gives equal plots with a probability of at most
//! d / (2 √π σ): d times the density of the difference of two plots at zero. A motion v per step lowers it by
//! the factor exp(−v²/4σ²). Whether a radar is stuck is a Markov chain of two states; a plot that differs
//! from the last shows that the radar works. Steps may be so coarse that equal plots prove nothing; v is then
//! how far the target has moved, according to the filters of the other radars, since the number came first.

use crate::kalman::{Filter, Innovation, residual};
use std::f64::consts::{PI, SQRT_2};

/// Smallest ratio of the actual to the stated standard deviation of a radar that is assumed.
const ACCURATE: f64 = 0.5;
/// If the probability of equal plots is larger, the steps are so coarse that repetitions prove nothing.
const COARSE: f64 = 0.25;
/// Noise alone makes a move longer than this, in standard deviations, less often than once in 700 plots.
const SURE: f64 = 3.0;
/// The same for the difference of two predictions of the other radars.
const APART: f64 = 2.5;
/// Largest normalised innovation squared after which a radar's own filter is trusted.
const EXPECTED: f64 = 9.0;
/// Number of plots from which the step of a record is determined.
const PLOTS: usize = 16;
/// Smallest probability of equal plots while the step comes from few plots or from other radars.
const UNSURE: f64 = 0.05;
/// Differences below this share of the plots are rounding errors of the arithmetic.
const NO_STEP: f64 = 1e-12;
/// The same limit for the common divisor of differences.
const NO_GRID: f64 = 1e-9;
/// Upper limit of the odds: beyond any doubt.
const CERTAIN: f64 = 1e100;

#[derive(Clone, Debug)]
struct Radar {
    /// The last different plots, the latest first.
    plots: Vec<f64>,
    /// Smallest difference between two of these plots so far: an upper bound of the step of the record.
    step: f64,
    /// Odds that the radar is stuck.
    odds: f64,
    /// Predictions of the other radars when the last different plot came; empty in fine steps.
    elsewhere: Vec<f64>,
}

/// Prediction of a radar's own filter for this step.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seen {
    /// The predicted angle; nan if it is unknown or the last innovation was too large.
    pub angle: f64,
    pub variance: f64,
}

impl Seen {
    /// Of a filter whose last innovation was this one.
    pub fn by(filter: &Filter, innovation: Option<Innovation>) -> Self {
        let expected = |new: Innovation| new.value.powi(2) <= EXPECTED * new.variance;
        let trusted = filter.is_known() && innovation.is_none_or(expected);
        let state = filter.state();
        Self {
            angle: if trusted { state.mean[0] } else { f64::NAN },
            variance: state.covariance[0],
        }
    }
}

/// Repetitions of all radars so far.
#[derive(Clone, Debug)]
pub(super) struct Repeats {
    radars: Vec<Radar>,
    /// Probability that a radar gets stuck at a plot.
    sticks: f64,
}

impl Repeats {
    pub fn new(radars: usize, sticks: f64) -> Self {
        let unknown =
            Radar { plots: Vec::new(), step: f64::INFINITY, odds: 0.0, elsewhere: Vec::new() };
        Self { radars: vec![unknown; radars], sticks }
    }

    /// Whether the last plot of a radar is more probably a repetition than a measurement.
    pub fn repeats(&self, radar: usize) -> bool {
        self.radars[radar].odds > 1.0
    }

    /// Replaces repeated plots among the plots z (nan: no plot), of variances r, by nan; `seen` is what the radars
    /// expect. Cost O(K); O(K²) while radars have given only one number, and in coarse steps.
    pub fn leave_out(&mut self, z: &mut [f64], r: &[f64], seen: &[Seen], period: Option<f64>) {
        let again: Vec<bool> = self
            .radars
            .iter_mut()
            .zip(&*z)
            .map(|(radar, plot)| radar.take(*plot, period))
            .collect();
        for radar in 0..z.len() {
            if z[radar].is_nan() {
                continue;
            }
            let sigma = r[radar].sqrt();
            if !again[radar] {
                self.radars[radar].look(sigma, seen);
                continue;
            }
            let chance = self.chance(radar, sigma, period);
            let coarse = chance > COARSE;
            let stays = coarse.then(|| self.stays(radar, sigma, seen, period));
            let odds = &mut self.radars[radar].odds;
            *odds = match stays {
                Some(1.0) => 0.0,
                factor => ((*odds + self.sticks) / (chance * factor.unwrap_or(1.0))).min(CERTAIN),
            };
            if self.repeats(radar) {
                z[radar] = f64::NAN;
            }
        }
    }

    /// Factor by which a motion that the other radars see lowers the probability of equal plots.
    fn stays(&self, radar: usize, sigma: f64, seen: &[Seen], period: Option<f64>) -> f64 {
        let (mut moved, mut information) = (0.0, 0.0);
        for (other, (then, now)) in self.radars[radar].elsewhere.iter().zip(seen).enumerate() {
            let away = residual(now.angle, *then, period);
            if other != radar && !self.repeats(other) && !away.is_nan() {
                moved += away / now.variance;
                information += 1.0 / now.variance;
            }
        }
        if information == 0.0 {
            return 1.0;
        }
        let moved = (moved / information).abs() - APART * (2.0 / information).sqrt();
        (-(moved.max(0.0) / (2.0 * sigma)).powi(2)).exp().max(f64::MIN_POSITIVE)
    }

    /// Largest probability that a radar that works gives its last plot again. Until the radar has given
    /// many plots, the step of its record is assumed to be a common divisor of the differences of a few
    /// plots, also of other radars.
    fn chance(&self, radar: usize, sigma: f64, period: Option<f64>) -> f64 {
        let own = &self.radars[radar];
        let of_step = |step: f64| same(step, sigma);
        let mut same = of_step(own.step);
        if own.plots.len() < PLOTS {
            let grids = self.radars.iter().map(|radar| radar.grid(period));
            same = same.min(of_step(grids.fold(f64::INFINITY, f64::min)).max(UNSURE));
        }
        let [last, before @ ..] = &own.plots[..] else { return same };
        // the target has not moved with a plot in between, which was an outlier
        let moves = before.iter().take(2).map(|plot| residual(*last, *plot, period).abs());
        let moved = moves.reduce(f64::min).unwrap_or(0.0) - SURE * SQRT_2 * sigma;
        same * (-(moved.max(0.0) / (2.0 * sigma)).powi(2)).exp().max(f64::MIN_POSITIVE)
    }

    /// Returns the complete state as lists of numbers.
    pub fn saved(&self) -> impl Iterator<Item = Vec<f64>> {
        let of = |radar: &Radar| {
            let plots = [&[radar.step, radar.odds], &radar.plots[..]].concat();
            [&plots[..], &[f64::NAN], &radar.elsewhere[..]].concat()
        };
        self.radars.iter().map(of)
    }

    /// Restores the state from saved lists.
    pub fn restore<'a>(&mut self, lists: &mut impl Iterator<Item = &'a Vec<f64>>) -> Option<()> {
        for radar in &mut self.radars {
            let [step, odds, rest @ ..] = &lists.next()?[..] else { return None };
            // older saved states end with the plots
            let mut parts = rest.splitn(2, |plot| plot.is_nan()).map(<[f64]>::to_vec);
            let [plots, elsewhere] = [(); 2].map(|()| parts.next().unwrap_or_default());
            *radar = Radar { plots, step: *step, odds: *odds, elsewhere };
        }
        Some(())
    }
}

/// Largest probability of equal plots in steps of this size.
fn same(step: f64, sigma: f64) -> f64 {
    (step / (2.0 * PI.sqrt() * ACCURATE * sigma)).min(1.0)
}

impl Radar {
    /// Stores where the radars see the target, if equal plots alone do not show that this one is stuck.
    fn look(&mut self, sigma: f64, seen: &[Seen]) {
        self.elsewhere.clear();
        if same(self.step, sigma) > COARSE {
            self.elsewhere.extend(seen.iter().map(|seen| seen.angle));
        }
    }

    /// Whether a plot repeats the last one; a plot that does not is stored.
    fn take(&mut self, plot: f64, period: Option<f64>) -> bool {
        if plot.is_nan() || self.plots.first() == Some(&plot) {
            return !plot.is_nan();
        }
        for other in &self.plots {
            let step = residual(plot, *other, period).abs();
            if step > NO_STEP * (plot.abs() + other.abs() + period.unwrap_or(0.0)) {
                self.step = self.step.min(step);
            }
        }
        self.plots.truncate(PLOTS - 1);
        self.plots.insert(0, plot);
        self.odds = 0.0;
        false
    }

    /// Greatest common divisor of the differences of the last plots, by Euclid's algorithm; infinite for
    /// fewer than two differences.
    fn grid(&self, period: Option<f64>) -> f64 {
        if self.plots.len() < 3 {
            return f64::INFINITY;
        }
        let least = NO_GRID * (self.plots[0].abs() + period.unwrap_or(0.0));
        self.plots.windows(2).fold(0.0, |grid, pair| {
            let (mut a, mut b) = (residual(pair[0], pair[1], period).abs(), grid);
            while b > least {
                (a, b) = (b, a % b);
            }
            a
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const UNSEEN: Seen = Seen { angle: f64::NAN, variance: f64::NAN };

    /// Returns which plots of a radar are left out; the noise of the radar is as stated.
    fn left_out(plots: &[f64]) -> Vec<bool> {
        let mut repeats = Repeats::new(1, 0.005);
        let left_out = |&plot: &f64| {
            let mut z = [plot];
            repeats.leave_out(&mut z, &[1.0], &[UNSEEN], None);
            z[0].is_nan() && !plot.is_nan()
        };
        plots.iter().map(left_out).collect()
    }

    #[test]
    fn a_number_that_comes_again_is_left_out_until_another_comes() {
        let found = left_out(&[1.27, 0.4, 0.43, -0.8, -0.8, -0.8, f64::NAN, -0.8, 0.3, -0.8]);
        let expected = [false, false, false, false, false, true, false, true, false, false];
        assert_eq!(found, expected);
    }

    /// A target that moves ten standard deviations per step is not expected at the same place again.
    #[test]
    fn a_fast_target_does_not_stay() {
        let mut plots: Vec<f64> = (0..4).map(|step| 10.0 * f64::from(step)).collect();
        plots.extend([30.0; 2]);
        assert_eq!(left_out(&plots), [false, false, false, false, true, true]);
    }

    /// In steps of a standard deviation or more, equal plots are expected.
    #[test]
    fn coarse_steps_repeat() {
        let mut plots = vec![1.0, 2.0, 1.0];
        plots.extend([1.0; 100]);
        assert!(!left_out(&plots).contains(&true));
    }

    /// Equal plots in coarse steps, while another radar sees the target move on, and come back.
    #[test]
    fn coarse_steps_repeat_only_while_the_target_stays() {
        let mut repeats = Repeats::new(2, 0.005);
        let angles = [0.0, 1.0, 0.0, 0.5, 2.0, 5.0, 8.0, 9.0, 8.0, 5.0, 0.5];
        let plots = [0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        let left_out = angles.iter().zip(plots).map(|(&angle, plot)| {
            let mut z = [plot, f64::NAN];
            let seen = [UNSEEN, Seen { angle, variance: 0.1 }];
            repeats.leave_out(&mut z, &[1.0; 2], &seen, None);
            z[0].is_nan()
        });
        let found: Vec<usize> =
            left_out.enumerate().filter(|(_, out)| *out).map(|(k, _)| k).collect();
        assert_eq!(found, [5, 6, 7, 8, 9]);
    }

    /// A radar that has never given another number is compared with the steps of the other radars.
    #[test]
    fn stuck_from_the_start() {
        let mut repeats = Repeats::new(2, 0.005);
        for (other, expected) in [(0.31, false), (0.34, false), (-1.0, false), (0.2, true)] {
            let mut z = [5.0, other];
            repeats.leave_out(&mut z, &[1.0; 2], &[UNSEEN; 2], None);
            assert_eq!((z[0].is_nan(), z[1]), (expected, other));
        }
    }
}
