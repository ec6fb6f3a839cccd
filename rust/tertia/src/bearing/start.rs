//! Start values of the search for modes: centre and scale that remain useful with 40 % of bad
//! measurements, and modes of the scores.

use super::modes::{MOST_BAD, Mode, Modes, Shape};
use crate::base::angle::median;
use std::f64::consts::SQRT_2;

/// Probability outside two sigmas of a normal variable.
pub(super) const OUTSIDE: f64 = 0.0455;
/// Standard deviation of the normal distribution divided by its MAD.
pub(super) const MAD_TO_SIGMA: f64 = 1.4826;
/// Length of the shorth of the normal distribution divided by its standard deviation.
const SHORTH_TO_SIGMA: f64 = 2.0 * 0.6745;
/// Smallest scale relative to the MAD: the shorth of a few values can be far too short.
const LEAST_SHARE_OF_MAD: f64 = 0.3;
/// Readings that differ by less than this share of their median plus interquartile range are equal
/// except for the rounding of doubles.
const SAME: f64 = 1e-13;
/// Intervals whose lengths differ by less than this share count as equally long.
const SAME_LENGTH: f64 = 1e-9;

/// Scores beyond these distances count as bad at the start: for one kind and for two kinds of bad values.
const FAR: f64 = 2.5;
const FAR_OF_TWO: f64 = 2.2;
/// Offset, and widths with one and two kinds, of a bad mode at the start.
const OFFSET: f64 = 4.0;
const WIDTH: f64 = 1.5;
const WIDTH_OF_TWO: f64 = 1.2;
const LARGEST_START: f64 = 0.45;
const LARGEST_START_OF_TWO: f64 = 0.4;

/// Centre, scale and rounding step of a record.
#[derive(Clone, Copy, Debug)]
pub(super) struct Start {
    pub centre: f64,
    pub scale: f64,
    /// Rounding step; zero if unknown.
    pub step: f64,
}

/// Returns centre, scale and rounding step; `None` if all values are equal. The centre is the mean of
/// the shorth, the shortest interval with half of the values. The scale comes from the length of the
/// shorth or the median difference of successive values, whichever is smaller, limited to between
/// 0.3 MAD and MAD, and includes the standard deviation of rounding. O(N log N).
pub(super) fn start(y: &[f64], rounding: f64, sorted: &mut Vec<f64>) -> Option<Start> {
    sorted.clear();
    sorted.extend_from_slice(y);
    sorted.sort_unstable_by(f64::total_cmp);
    let n = sorted.len();
    let spread = sorted[n - 1] - sorted[0];
    let different = differs(sorted);
    if spread == 0.0 || !different(spread) {
        return None;
    }
    let step = if rounding > 0.0 { rounding } else { seen_step(sorted, different) };
    let half = n / 2 + 1;
    let length = |k: usize| sorted[k + half - 1] - sorted[k];
    // the first of intervals that are equally long, even if they differ by rounding
    let shorter = |k: usize, best: usize| length(k) < length(best) * (1.0 - SAME_LENGTH);
    let first = (0..=n - half).fold(0, |best, k| if shorter(k, best) { k } else { best });
    let shortest = length(first) / SHORTH_TO_SIGMA;
    let origin = sorted[first];
    let shorth = &sorted[first..first + half];
    let centre = origin + shorth.iter().map(|v| v - origin).sum::<f64>() / half as f64;
    let middle = sorted[(n - 1) / 2] + 0.5 * (sorted[n / 2] - sorted[(n - 1) / 2]);
    for v in sorted.iter_mut() {
        *v = (*v - middle).abs();
    }
    let mad = MAD_TO_SIGMA * median(sorted);
    for (d, pair) in sorted.iter_mut().zip(y.windows(2)) {
        *d = (pair[1] - pair[0]).abs();
    }
    let of_differences = MAD_TO_SIGMA * median(&mut sorted[..n - 1]) / SQRT_2;
    let scale = shortest
        .min(of_differences)
        .max(LEAST_SHARE_OF_MAD * mad)
        .min(mad)
        .hypot(rounding_sigma(step));
    // more than half of the readings are equal, and not rounded: a small scale from the range of all
    let least = 0.1 * spread / n as f64;
    Some(Start { centre, scale: if scale > 0.0 { scale } else { least }, step })
}

/// Returns the standard deviation of rounding.
pub(super) fn rounding_sigma(step: f64) -> f64 {
    step / 12_f64.sqrt()
}

/// Returns a test of whether a difference of two readings is larger than the rounding of doubles.
fn differs(sorted: &[f64]) -> impl Fn(f64) -> bool + use<> {
    let n = sorted.len();
    let tolerance = SAME * (sorted[n / 2].abs() + sorted[3 * n / 4] - sorted[n / 4]);
    move |d| d > tolerance
}

/// Returns the rounding step of sorted readings if it can be seen and is at most `largest`, otherwise
/// zero.
pub(super) fn step_within(sorted: &[f64], largest: f64) -> f64 {
    let step = seen_step(sorted, differs(sorted));
    if step <= largest { step } else { 0.0 }
}

/// Returns the number of different values of sorted readings.
pub(super) fn different(sorted: &[f64]) -> usize {
    let different = differs(sorted);
    sorted.chunk_by(|a, b| !different(b - a)).count()
}

/// Returns the smallest difference of two readings if some readings are equal, otherwise zero.
fn seen_step(sorted: &[f64], different: impl Fn(f64) -> bool) -> f64 {
    let gaps = || sorted.windows(2).map(|pair| pair[1] - pair[0]);
    if gaps().all(&different) {
        return 0.0;
    }
    gaps().filter(|&d| different(d)).fold(f64::INFINITY, f64::min)
}

/// Returns number, sum and sum of squares of the values beyond a limit on one side (±1) or on both (0).
fn beyond(y: &[f64], limit: f64, side: f64) -> (f64, f64, f64) {
    let hit = |v: &&f64| if side == 0.0 { v.abs() > limit } else { *v * side > limit };
    let add = |(n, s, q): (f64, f64, f64), v: &f64| (n + 1.0, s + v, q + v * v);
    y.iter().filter(hit).fold((0.0, 0.0, 0.0), add)
}

fn modes(shape: Shape, bad: [Mode; MOST_BAD]) -> Modes {
    Modes { shape, centre: 0.0, width: 1.0, bad, persistence: 0.0 }
}

fn offset(count: f64, sum: f64, side: f64) -> f64 {
    if count > 0.0 { sum / count } else { side * OFFSET }
}

/// Returns a mixture with bad values on one side (±1).
pub(super) fn one_sided(y: &[f64], side: f64) -> Modes {
    let n = y.len() as f64;
    let (count, sum, _) = beyond(y, FAR, side);
    let share = (count / n).clamp(1.0 / n, LARGEST_START);
    let bad = Mode { offset: offset(count, sum, side), width: WIDTH, share };
    modes(Shape::OneSided, [bad, Mode::default()])
}

/// Returns a mixture with a wide mode of bad values.
pub(super) fn wide(y: &[f64]) -> Modes {
    let n = y.len() as f64;
    let (count, _, squares) = beyond(y, FAR, 0.0);
    let share = (count / n).clamp(1.0 / n, LARGEST_START);
    let width = (squares / count.max(1.0)).sqrt().max(OFFSET);
    modes(Shape::Wide, [Mode { offset: 0.0, width, share }, Mode::default()])
}

/// Returns a mixture with bad values on both sides.
pub(super) fn two_sided(y: &[f64]) -> Modes {
    let n = y.len() as f64;
    let bad = [1.0, -1.0].map(|side| {
        let (count, sum, _) = beyond(y, FAR_OF_TWO, side);
        let share = (count / n).clamp(0.5 / n, LARGEST_START_OF_TWO);
        Mode { offset: offset(count, sum, side), width: WIDTH_OF_TWO, share }
    });
    modes(Shape::TwoSided, bad)
}
