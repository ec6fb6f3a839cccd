//! Plots that repeat the one before, as from a sensor that is stuck, or from a program that reports the last
//! plot at every instant.
//!
//! Noise with the standard deviation σ that is recorded in steps of d gives the same number again with a
//! probability of at most d / (2 √π σ), which is the density of the difference of two plots at zero times d.
//! A motion v per step lowers it by exp(−v²/4σ²). The standard deviation of noise that is correlated in time
//! is unknown; if successive numbers that differ are typically m steps apart, the probability is at most
//! 1 / (2 m). Whether a sensor is stuck is a Markov chain; a plot that differs from the one before shows that
//! it is not stuck.

use super::whitener::Noise;
use crate::base::angle::median;
use std::f64::consts::{PI, SQRT_2};

/// Least ratio of the true to the stated standard deviation of a sensor.
const ACCURATE: f64 = 0.5;
/// Probability above which steps are so coarse that repetitions show nothing: numbers that differ are then
/// typically less than four steps apart.
const COARSE: f64 = 0.125;
/// Standard deviations by which the last move is shortened: the noise alone exceeds them less than once in
/// 700 times.
const SURE: f64 = 3.0;
/// Probability that a sensor sticks at a plot, unless more than `FEW` plots repeat the one before.
const STICKS: f64 = 0.005;
const FEW: usize = 2;
/// Upper bound of the odds, beyond any doubt.
const CERTAIN: f64 = 1e100;
/// Differences of readings below this share of a typical one, and remainders below `ROUNDED` of a step, are no
/// steps: last digits may be rounded in two ways. More than `MANY` steps are too inaccurate to be divided.
const NEGLIGIBLE: f64 = 0.01;
const ROUNDED: f64 = 0.1;
const MANY: f64 = 20.0;
/// Share of the differences that may be no multiples of the step.
const EXCEPTIONS: f64 = 0.1;
/// Differences below this share of the numbers are rounding errors.
const NO_STEP: f64 = 1e-12;

/// Returns which plots (N, D; nan where a component is missing) are more probably repetitions than
/// measurements. O(N log N).
pub fn repeated(dimension: usize, y: &[f64], noise: Noise<'_>) -> Vec<bool> {
    repetitions(dimension, y, noise, false)
}

/// Returns which readings (N; nan where one is missing) are more probably repetitions than measurements, as
/// [`repeated`] does for plots. Readings are recorded as they are, so that equal ones remain equal and all
/// differences are multiples of the step, even if those of successive readings of a moving target are all large.
/// The last move says nothing, as it may be that of an outlier. O(N log N).
pub fn repeated_readings(y: &[f64], noise: Noise<'_>) -> Vec<bool> {
    repetitions(1, y, noise, true)
}

fn repetitions(dimension: usize, y: &[f64], noise: Noise<'_>, as_read: bool) -> Vec<bool> {
    let plots: Vec<&[f64]> = y.chunks_exact(dimension.max(1)).collect();
    let mut found = vec![false; plots.len()];
    let known = |plot: &[f64]| !plot.iter().any(|y| y.is_nan());
    let whole: Vec<usize> = (0..plots.len()).filter(|&at| known(plots[at])).collect();
    let pairs: Vec<(usize, usize)> = whole.windows(2).map(|pair| (pair[0], pair[1])).collect();
    let again = pairs.iter().filter(|(a, b)| plots[*a] == plots[*b]).count();
    let steps: Vec<Step> =
        (0..dimension).map(|axis| Step::of(&plots, &pairs, axis, as_read)).collect();
    if again == 0 || steps.iter().any(|step| step.least == f64::INFINITY) {
        return found;
    }
    let chance = |at: usize, moved: &[f64]| -> f64 {
        let deviation = |axis| variance(noise, dimension, at, axis).sqrt();
        let of_axis = |axis: usize| steps[axis].chance(deviation(axis), moved[axis]);
        (0..dimension).map(of_axis).product::<f64>().max(f64::MIN_POSITIVE)
    };
    let share = again as f64 / pairs.len() as f64;
    let (mut odds, mut moved) = (0.0_f64, vec![0.0; dimension]);
    for &(before, at) in &pairs {
        let chance = chance(at, &moved);
        if plots[before] != plots[at] {
            odds = 0.0;
            let pairs = plots[at].iter().zip(plots[before]);
            moved = pairs.map(|(now, before)| (now - before).abs()).collect();
        } else if chance <= COARSE {
            let sticks = if again > FEW { STICKS.max(share - chance) } else { STICKS };
            odds = ((odds + sticks) / chance).min(CERTAIN);
        }
        found[at] = odds > 1.0;
    }
    // the sensor has been stuck since the first repetition
    for pair in pairs.windows(2).rev() {
        let ((before, at), (_, next)) = (pair[0], pair[1]);
        found[at] |= found[next] && plots[before] == plots[at] && plots[at] == plots[next];
    }
    found
}

/// Variance of a component; with an infinite one, only the steps of the record count.
fn variance(noise: Noise<'_>, dimension: usize, at: usize, axis: usize) -> f64 {
    let place = axis * (dimension + 1);
    match noise {
        Noise::Same(matrix) => matrix[place],
        Noise::Each(matrices) => matrices[at * dimension * dimension + place],
    }
}

/// Differences between successive numbers of an axis, where these differ.
struct Step {
    /// The smallest difference of any two numbers, which is at least the step of the record; of readings, the
    /// step.
    any: f64,
    /// The smallest difference of successive numbers, and a typical one.
    least: f64,
    typical: f64,
    as_read: bool,
}

impl Step {
    fn of(plots: &[&[f64]], pairs: &[(usize, usize)], axis: usize, as_read: bool) -> Self {
        let of_pair = |a: f64, b: f64| {
            let step = (b - a).abs();
            (step > NO_STEP * (a.abs() + b.abs())).then_some(step)
        };
        let difference = |&(a, b): &(usize, usize)| of_pair(plots[a][axis], plots[b][axis]);
        let mut steps: Vec<f64> = pairs.iter().filter_map(difference).collect();
        let least = steps.iter().copied().fold(f64::INFINITY, f64::min);
        let typical = if steps.is_empty() { least } else { median(&mut steps) };
        let ends =
            pairs.first().map(|pair| pair.0).into_iter().chain(pairs.iter().map(|pair| pair.1));
        let mut all: Vec<f64> = ends.map(|at| plots[at][axis]).collect();
        all.sort_by(f64::total_cmp);
        let mut gaps: Vec<f64> =
            all.windows(2).filter_map(|pair| of_pair(pair[0], pair[1])).collect();
        if as_read {
            gaps.sort_by(f64::total_cmp);
            let step = step_of(&gaps[gaps.partition_point(|gap| *gap < NEGLIGIBLE * typical)..]);
            return Self { any: step, least: step, typical, as_read };
        }
        Self { any: gaps.into_iter().fold(f64::INFINITY, f64::min), least, typical, as_read }
    }

    /// Largest probability that a number with this standard deviation occurs again after a move of this
    /// length.
    fn chance(&self, deviation: f64, moved: f64) -> f64 {
        let white = self.any / (2.0 * PI.sqrt() * ACCURATE * deviation);
        let same = white.max(0.5 * self.least / self.typical).min(1.0);
        if self.as_read {
            return same;
        }
        let moved = (moved - SURE * SQRT_2 * deviation).max(0.0);
        same * (-(moved / (2.0 * deviation)).powi(2)).exp()
    }
}

/// Returns the step of which differences (in ascending order) are multiples, but for a few: the smallest of
/// them, or else their greatest common divisor. O(N log N).
fn step_of(gaps: &[f64]) -> f64 {
    let few = |count: usize| (EXCEPTIONS * count as f64) as usize;
    let mut tried = 0.0;
    for &step in &gaps[..gaps.len().min(few(gaps.len()) + 1)] {
        if step > (1.0 + ROUNDED) * tried {
            tried = step;
            let near = &gaps[..gaps.partition_point(|gap| *gap <= MANY * step)];
            let others = near.iter().filter(|gap| remainder(**gap, step) > ROUNDED * step).count();
            if others <= few(near.len()) {
                return step;
            }
        }
    }
    gaps.iter().copied().fold(f64::INFINITY, common_divisor)
}

/// Distance of a number from the nearest multiple of a step.
fn remainder(number: f64, step: f64) -> f64 {
    let rest = number % step;
    rest.min(step - rest)
}

/// Greatest common divisor of two differences, by Euclid's algorithm.
fn common_divisor(a: f64, b: f64) -> f64 {
    let (mut large, mut small) = (a.max(b), a.min(b));
    while large <= MANY * small {
        let rest = remainder(large, small);
        if rest <= ROUNDED * small {
            break;
        }
        (large, small) = (small, rest);
    }
    small
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOISE: Noise<'static> = Noise::Same(&[1.0]);

    /// Numbers that differ by arbitrary steps.
    fn plots(count: i32) -> Vec<f64> {
        (0..count).map(|k| 2.0 * f64::from(k * k).sin()).collect()
    }

    #[test]
    fn a_plot_that_stays_is_repeated() {
        let mut y = plots(40);
        y.extend([y[39]; 5]);
        y.extend(plots(40));
        let found = repeated(1, &y, NOISE);
        assert!((0..y.len()).all(|at| found[at] == (40..45).contains(&at)), "{found:?}");
    }

    /// Every plot occurs at two instants, between which one is missing.
    #[test]
    fn a_plot_that_is_held_is_repeated() {
        let y: Vec<f64> = plots(40).iter().flat_map(|y| [*y, f64::NAN, *y]).collect();
        let found = repeated(1, &y, NOISE);
        assert!((0..y.len()).all(|at| found[at] == (at % 3 == 2)), "{found:?}");
    }

    /// If numbers are recorded in steps of a standard deviation, or of the usual difference of plots, equal
    /// plots are no surprise.
    #[test]
    fn coarse_steps_repeat() {
        let coarse: Vec<f64> = plots(40).iter().flat_map(|y| [y.round(), y.round()]).collect();
        assert!(!repeated(1, &coarse, NOISE).contains(&true));
        assert!(!repeated(1, &coarse, Noise::Same(&[1e6])).contains(&true));
        assert!(!repeated(1, &[3.0; 20], NOISE).contains(&true));
    }

    /// Readings of a target that moves steadily are far apart, and in no coarse steps.
    #[test]
    fn readings_of_a_moving_target_that_are_held_are_repeated() {
        let y: Vec<f64> = (0..40).map(|k| f64::from(k * 3) + plots(40)[k as usize]).collect();
        let held: Vec<f64> = y.iter().flat_map(|y| [*y, *y]).collect();
        let found = repeated_readings(&held, NOISE);
        assert!((0..held.len()).all(|at| found[at] == (at % 2 == 1)), "{found:?}");
        let coarse: Vec<f64> = held.iter().map(|y| 5.0 * (y / 5.0).round()).collect();
        assert!(!repeated_readings(&coarse, NOISE).contains(&true));
    }

    #[test]
    fn the_step_is_that_of_which_differences_are_multiples() {
        let near = |a: f64, b: f64| (a - b).abs() < 1e-3 * b;
        assert!(near(step_of(&[0.4, 0.6, 1.0, 1.4]), 0.2));
        // last digits rounded in two ways, and a number between two steps
        let rounded: Vec<f64> = (1..20).map(|k| f64::from(k) + 0.002 * f64::from(k % 2)).collect();
        assert!(near(step_of(&rounded), 1.002));
        let between: Vec<f64> = [0.3].into_iter().chain((1..20).map(f64::from)).collect();
        assert!(near(step_of(&between), 1.0));
        // no common step
        assert!(step_of(&[10.0, 23.7, 31.3, 48.9, 77.1]) < 0.2);
        assert_eq!(step_of(&[]), f64::INFINITY);
    }

    /// A target that moves by ten standard deviations a step is not where it was.
    #[test]
    fn a_fast_target_does_not_stay() {
        let found = repeated(1, &[0.0, 10.0, 20.0, 30.0, 30.0, 30.0], NOISE);
        assert_eq!(found, [false, false, false, false, true, true]);
    }
}
