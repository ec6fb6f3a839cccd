//! The intensity of the jerk by maximum likelihood.

use super::smoother::{Workspace, likelihood};
use super::track::Track;

/// The jerk of a track, with its uncertainty.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JerkFit {
    /// The intensity; 0 where no jerk explains the track best, or where it cannot be determined.
    pub jerk: f64,
    /// Standard error of its logarithm, from the curvature of the likelihood; ∞ where undetermined.
    pub relative_error: f64,
}

impl JerkFit {
    /// Standard uncertainty of the intensity, to first order.
    pub fn sigma(&self) -> f64 {
        if self.relative_error.is_finite() {
            self.relative_error * self.jerk
        } else {
            f64::INFINITY
        }
    }

    const UNDETERMINED: Self = Self { jerk: 0.0, relative_error: f64::INFINITY };
}

/// Steps of the logarithm of the intensity, in which the likelihood changes slowly.
const COARSE: f64 = 4.0;
/// Relative to noise that shows within the shortest step, and within the track.
const MARGINS: [f64; 2] = [1e-6, 1e2];
/// More than this many steps towards motion that hides the noise are not made.
const MOST_STEPS: usize = 200;
/// The maximum is found to this, in the logarithm.
const SETTLED: f64 = 1e-5;
/// A gain of more is not.
const CERTAIN: f64 = 1.0;
/// A gain of less is rounding.
const GAIN: f64 = 1e-7;
const GOLDEN: f64 = 0.381_966_011_250_105_1;

/// The intensity of white jerk that makes the plots most likely. Cost: some 30 filters.
pub fn fit_jerk(track: &Track<'_>, workspace: &mut Workspace) -> JerkFit {
    search(track, None, &mut |log| likelihood(track, log.exp(), workspace).log_likelihood)
}

/// The same by any way to the likelihood of a logarithm. Near the logarithm of an intensity that has
/// been found for almost the same plots the whole range is not searched, and no error is found.
pub(crate) fn search(
    track: &Track<'_>,
    near: Option<f64>,
    value: &mut impl FnMut(f64) -> f64,
) -> JerkFit {
    let Some((low, high)) = range(track) else { return JerkFit::UNDETERMINED };
    let (below, best) = match near.and_then(|near| climb(low, near, value)) {
        Some(found) => found,
        None => {
            let (best, last) = scan(low, high, value);
            if best.0 == last {
                return JerkFit { jerk: last.exp(), relative_error: f64::INFINITY };
            }
            (f64::INFINITY, best)
        }
    };
    let (log, top) = maximum(value, best.0 - COARSE, best, best.0 + COARSE);
    // of another intensity so far below, none need not be asked
    let certain = top - below > CERTAIN;
    if !certain && top - value(f64::NEG_INFINITY) < GAIN {
        return JerkFit::UNDETERMINED;
    }
    if near.is_some() {
        return JerkFit { jerk: log.exp(), relative_error: f64::NAN };
    }
    JerkFit { jerk: log.exp(), relative_error: relative_error(log, top, value) }
}

/// The standard error of the logarithm of an intensity where the likelihood is greatest.
pub(crate) fn relative_error(log: f64, top: f64, value: &mut impl FnMut(f64) -> f64) -> f64 {
    // a step that lowers the likelihood by about 1/200 where it is a parabola
    let mut step: f64 = 0.1;
    let mut curvature = 0.0;
    for _ in 0..3 {
        curvature = (2.0 * top - value(log + step) - value(log - step)) / (step * step);
        step = (0.1 / curvature.max(1e-2).sqrt()).clamp(1e-3, 1.0);
    }
    if curvature > 1e-3 { 1.0 / curvature.sqrt() } else { f64::INFINITY }
}

/// The best step from `low` to `high`, and beyond as long as the likelihood rises; and the last.
fn scan(low: f64, high: f64, value: &mut impl FnMut(f64) -> f64) -> ((f64, f64), f64) {
    let mut best = (low, value(low));
    let (mut log, mut count) = (low, 1);
    while log < high || (best.0 == log && count < MOST_STEPS) {
        log += COARSE;
        count += 1;
        let own = (log, value(log));
        if own.1 > best.1 {
            best = own;
        }
    }
    (best, log)
}

/// The best step above its neighbours, from that nearest to `near`, after the likelihood of the one
/// below it; none at the low end.
fn climb(low: f64, near: f64, value: &mut impl FnMut(f64) -> f64) -> Option<(f64, (f64, f64))> {
    let mut at = ((near - low) / COARSE).round();
    let mut of = |at: f64| value(low + at * COARSE);
    let mut values = [of(at - 1.0), of(at), of(at + 1.0)];
    for _ in 0..MOST_STEPS {
        let [below, own, above] = values;
        if at < 1.0 || !own.is_finite() {
            return None;
        }
        if below > own {
            at -= 1.0;
            values = [of(at - 1.0), below, own];
        } else if above > own {
            at += 1.0;
            values = [own, above, of(at + 1.0)];
        } else {
            return Some((below, (low + at * COARSE, own)));
        }
    }
    None
}

/// Logarithms of intensities that show within the track but hardly, and within the shortest step.
pub(super) fn range(track: &Track<'_>) -> Option<(f64, f64)> {
    if track.measured <= track.rank() {
        return None;
    }
    let steps = track.times.windows(2).map(|pair| pair[1] - pair[0]);
    let shortest = steps.filter(|&t| t > 0.0).fold(f64::INFINITY, f64::min);
    if !shortest.is_finite() {
        return None;
    }
    let widest = track.scale.iter().fold(0.0_f64, |widest, scale| widest.max(1.0 / scale));
    let over = |t: f64| 2.0 * widest.ln() - 5.0 * t.ln();
    Some((over(track.span()) + MARGINS[0].ln(), over(shortest) + MARGINS[1].ln()))
}

/// The maximum between two points, by Brent's method: parabolas, and golden sections where they fail.
fn maximum(
    f: &mut impl FnMut(f64) -> f64,
    mut low: f64,
    mut best: (f64, f64),
    mut high: f64,
) -> (f64, f64) {
    let (mut second, mut third) = (best, best);
    let (mut step, mut before) = (0.0_f64, 0.0_f64);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if (best.0 - middle).abs() <= 2.0 * SETTLED - 0.5 * (high - low) {
            break;
        }
        let r = (best.0 - second.0) * (best.1 - third.1);
        let q = (best.0 - third.0) * (best.1 - second.1);
        let (mut p, mut q) = ((best.0 - third.0) * q - (best.0 - second.0) * r, 2.0 * (q - r));
        if q > 0.0 {
            p = -p;
        }
        q = q.abs();
        let parabola =
            p.abs() < (0.5 * q * before).abs() && p > q * (low - best.0) && p < q * (high - best.0);
        before = step;
        if parabola {
            step = p / q;
        } else {
            before = if best.0 < middle { high - best.0 } else { low - best.0 };
            step = GOLDEN * before;
        }
        let at = best.0 + if step.abs() < SETTLED { SETTLED.copysign(step) } else { step };
        let new = (at, f(at));
        if new.1 >= best.1 {
            if at < best.0 {
                high = best.0
            } else {
                low = best.0
            }
            (third, second, best) = (second, best, new);
        } else {
            if at < best.0 {
                low = at
            } else {
                high = at
            }
            if new.1 >= second.1 || second.0 == best.0 {
                (third, second) = (second, new);
            } else if new.1 >= third.1 || third.0 == best.0 || third.0 == second.0 {
                third = new;
            }
        }
    }
    best
}
