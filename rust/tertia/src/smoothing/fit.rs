//! Maximum-likelihood estimation of the process noise.

use super::motion::ProcessNoise;
use super::smoother::{Workspace, likelihood};
use super::track::Track;
use crate::base::angle::median;

/// Process noise of a track, with its uncertainty.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProcessNoiseFit {
    /// The process noise; zero if that explains the track best, or if it cannot be determined.
    pub motion: ProcessNoise,
    /// Standard error of the logarithm of the intensities, from the curvature of the likelihood; ∞ if
    /// undetermined.
    pub relative_error: f64,
}

impl ProcessNoiseFit {
    /// Standard uncertainty of the jerk, to first order; ∞ if there is white acceleration or velocity.
    pub fn sigma(&self) -> f64 {
        let ProcessNoise { acceleration, velocity, .. } = self.motion;
        if self.relative_error.is_finite() && acceleration == 0.0 && velocity == 0.0 {
            self.relative_error * self.motion.jerk
        } else {
            f64::INFINITY
        }
    }

    pub(crate) const UNDETERMINED: Self = Self {
        motion: ProcessNoise { jerk: 0.0, acceleration: 0.0, velocity: 0.0, last_axis: 1.0 },
        relative_error: f64::INFINITY,
    };
}

/// Families of motions of which one intensity varies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Family {
    /// White jerk.
    Jerk,
    /// White acceleration, with a jerk that hardly shows within the track.
    Acceleration,
    /// White velocity, with a jerk that hardly shows within the track.
    Velocity,
}

impl Family {
    /// Returns the motions of this family for a track, as a function of the logarithm of the intensity.
    pub fn of(self, track: &Track<'_>) -> impl Fn(f64) -> ProcessNoise + use<> {
        let least = range(track, JERK_POWER).map_or(0.0, |(low, _)| low.exp());
        move |log: f64| match self {
            Self::Jerk => ProcessNoise::with_jerk(log.exp()),
            Self::Acceleration => {
                ProcessNoise { acceleration: log.exp(), ..ProcessNoise::with_jerk(least) }
            }
            Self::Velocity => {
                ProcessNoise { velocity: log.exp(), ..ProcessNoise::with_jerk(least) }
            }
        }
    }

    /// Power of the time with which the noise increases the variance of a position.
    pub fn power(self) -> f64 {
        match self {
            Self::Jerk => JERK_POWER,
            Self::Acceleration => 3.0,
            Self::Velocity => 1.0,
        }
    }

    /// Returns the family of a motion.
    pub fn that_has(motion: ProcessNoise) -> Self {
        if motion.velocity > 0.0 {
            Self::Velocity
        } else if motion.acceleration > 0.0 {
            Self::Acceleration
        } else {
            Self::Jerk
        }
    }

    /// Returns the family with which a fit compares this one.
    pub fn other(self) -> Self {
        match self {
            Self::Jerk => Self::Acceleration,
            Self::Acceleration | Self::Velocity => Self::Jerk,
        }
    }

    /// Returns the logarithm of the intensity of this family that fits best the plots to which another motion
    /// was fitted, if the velocity is a random walk: within 0.4 for four of five tracks of 60 to 1,000 such
    /// plots.
    pub fn like(self, motion: ProcessNoise, track: &Track<'_>) -> f64 {
        let scale = track.position_scale().iter().fold(f64::INFINITY, |least, s| least.min(*s));
        let density = (median_step(track) / (scale * scale)).ln();
        let family = Self::that_has(motion);
        // noise of this density is averaged over a time (density / intensity)^(1 / (power + 1))
        let shorter = (family.log(motion) - density) / (family.power() + 1.0);
        let more = match (family, self) {
            (Self::Jerk, Self::Acceleration) => WANDERING_SHORTER,
            (Self::Acceleration, Self::Jerk) => -WANDERING_SHORTER,
            _ => 0.0,
        };
        density + (shorter + more) * (self.power() + 1.0)
    }

    /// Returns the logarithm of the intensity that varies.
    pub fn log(self, motion: ProcessNoise) -> f64 {
        match self {
            Self::Jerk => motion.jerk.ln(),
            Self::Acceleration => motion.acceleration.ln(),
            Self::Velocity => motion.velocity.ln(),
        }
    }
}

/// Axes of which the intensities vary together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Part {
    /// All axes.
    All,
    /// All axes but the last one.
    Others,
    /// The last axis.
    Last,
}

impl Part {
    /// Returns the part whose intensity a fit describes: all axes unless the last one has an intensity of its own.
    pub fn of(motion: ProcessNoise) -> Self {
        if motion.last_axis == 1.0 { Self::All } else { Self::Others }
    }
}

impl Family {
    /// As [`Self::of`], for a part of the axes: the others keep the intensities of a motion.
    pub fn part(
        self,
        part: Part,
        track: &Track<'_>,
        motion: ProcessNoise,
    ) -> impl Fn(f64) -> ProcessNoise + use<> {
        let of = self.of(track);
        let (others, last) = (self.log(motion), self.log_of(Part::Last, motion));
        move |log: f64| match part {
            Part::All => ProcessNoise { last_axis: motion.last_axis, ..of(log) },
            Part::Others => ProcessNoise { last_axis: (last - log).exp(), ..of(log) },
            Part::Last => ProcessNoise { last_axis: (log - others).exp(), ..motion },
        }
    }

    /// Returns the logarithm of the intensity of a part.
    pub fn log_of(self, part: Part, motion: ProcessNoise) -> f64 {
        match part {
            Part::All | Part::Others => self.log(motion),
            Part::Last => self.log(motion) + motion.last_axis.ln(),
        }
    }
}

const JERK_POWER: f64 = 5.0;
/// Logarithm of the ratio of the times over which the fits of jerk and of acceleration average, if the
/// velocity is a random walk.
const WANDERING_SHORTER: f64 = 0.3;
/// Step of the logarithm of the intensity within which the likelihood changes slowly.
const COARSE: f64 = 4.0;
/// Lowest intensity relative to noise that shows within the track, and highest intensity relative to noise
/// that shows within the shortest step.
const MARGINS: [f64; 2] = [1e-6, 1e2];
/// Largest number of steps, towards motion that hides the noise or in a climb.
const MOST_STEPS: usize = 200;
/// Accuracy of the maximum, in the logarithm.
const SETTLED: f64 = 1e-5;
/// Least gain of the log-likelihood that is not due to chance.
const CERTAIN: f64 = 1.0;
/// Gain of the log-likelihood below which it is rounding.
const GAIN: f64 = 1e-7;
const GOLDEN: f64 = 0.381_966_011_250_105_1;

/// A motion with its log-likelihood.
pub(super) type Likely = (ProcessNoiseFit, f64);

/// Returns the motion that makes the plots most likely, with white jerk or with white acceleration. Cost:
/// about 20 filters for each of the two families that is searched.
pub fn fit_process_noise(track: &Track<'_>, workspace: &mut Workspace) -> ProcessNoiseFit {
    fit_both_families(track, workspace).0
}

/// As [`fit_process_noise`]; also returns the likeliest motion with white acceleration, if that was searched
/// and was not chosen.
pub(super) fn fit_both_families(
    track: &Track<'_>,
    workspace: &mut Workspace,
) -> (ProcessNoiseFit, Option<Likely>) {
    let mut value = |motion| likelihood(track, motion, workspace).log_likelihood;
    compare_families(track, None, &mut value)
}

/// As [`fit_process_noise`], with any function that computes the likelihood. The search starts near another
/// motion if one is given: in its family, or in the other one if that is likelier with an intensity that
/// smooths as much.
pub(crate) fn likeliest(
    track: &Track<'_>,
    near: Option<ProcessNoise>,
    value: &mut impl FnMut(ProcessNoise) -> f64,
) -> ProcessNoiseFit {
    compare_families(track, near, value).0
}

/// As [`likeliest`]; also returns the motion of the other family, if that was searched and was not chosen.
fn compare_families(
    track: &Track<'_>,
    near: Option<ProcessNoise>,
    value: &mut impl FnMut(ProcessNoise) -> f64,
) -> (ProcessNoiseFit, Option<Likely>) {
    let family = near.map_or(Family::Jerk, Family::that_has);
    let log = near.map(|motion| family.log(motion)).filter(|log| log.is_finite());
    let (fit, top) = search(track, family, log, value);
    // white jerk is given up only for a family that is likelier by more than chance, and is always compared
    let (least, gain) = match family {
        Family::Jerk => (top, CERTAIN),
        Family::Acceleration | Family::Velocity => (f64::NEG_INFINITY, -CERTAIN),
    };
    match likeliest_other(track, fit.motion, least, value) {
        Some((other, higher)) if higher > top + gain => (other, None),
        other => (fit, other),
    }
}

/// Returns the likeliest motion of the other family with its log-likelihood, if the intensity that
/// corresponds to the given motion has at least this log-likelihood. The error is not determined.
pub(crate) fn likeliest_other(
    track: &Track<'_>,
    motion: ProcessNoise,
    least: f64,
    value: &mut impl FnMut(ProcessNoise) -> f64,
) -> Option<Likely> {
    likeliest_of(Family::that_has(motion).other(), track, motion, least, value)
}

/// As [`likeliest_other`], of any family.
pub(crate) fn likeliest_of(
    family: Family,
    track: &Track<'_>,
    motion: ProcessNoise,
    least: f64,
    value: &mut impl FnMut(ProcessNoise) -> f64,
) -> Option<(ProcessNoiseFit, f64)> {
    let like = family.like(motion, track);
    let is_likely = like.is_finite() && value(family.of(track)(like)) >= least;
    is_likely.then(|| search(track, family, Some(like), value))
}

/// Returns the motion with the likeliest intensities of one part of the axes, near those that it has, and its
/// log-likelihood; the others do not change.
pub(crate) fn likeliest_part(
    track: &Track<'_>,
    motion: ProcessNoise,
    part: Part,
    value: &mut impl FnMut(ProcessNoise) -> f64,
) -> Option<(ProcessNoise, f64)> {
    let family = Family::that_has(motion);
    let (low, _) = range(track, family.power())?;
    let of = family.part(part, track, motion);
    let value = &mut |log: f64| value(of(log));
    let best = match climb(low, family.log_of(part, motion), value) {
        Some((_, best)) => best,
        None => (low, value(low)),
    };
    let (log, top) = maximum(value, best.0 - COARSE, best, best.0 + COARSE);
    Some((of(log), top))
}

/// Returns the likeliest motion of a family with its log-likelihood. If the logarithm of an intensity is
/// given that was found for almost the same plots, only its neighbourhood is searched, and the error is not
/// determined.
fn search(
    track: &Track<'_>,
    family: Family,
    near: Option<f64>,
    value: &mut impl FnMut(ProcessNoise) -> f64,
) -> (ProcessNoiseFit, f64) {
    let Some((low, high)) = range(track, family.power()) else {
        return (ProcessNoiseFit::UNDETERMINED, f64::NAN);
    };
    let of = family.of(track);
    let value = &mut |log: f64| value(of(log));
    let (below, best) = match near.and_then(|near| climb(low, near, value)) {
        Some(found) => found,
        None => {
            let (best, last) = scan(low, high, value);
            // the likelihood is linear in an intensity as low as this, and falls
            if best.0 == low && value(f64::NEG_INFINITY) >= best.1 {
                return (ProcessNoiseFit::UNDETERMINED, best.1);
            }
            if best.0 == last {
                return (
                    ProcessNoiseFit { motion: of(last), relative_error: f64::INFINITY },
                    best.1,
                );
            }
            (f64::INFINITY, best)
        }
    };
    let (log, top) = maximum(value, best.0 - COARSE, best, best.0 + COARSE);
    // if a lower intensity is so much less likely, no noise at all need not be tried
    let certain = top - below > CERTAIN;
    if !certain && top - value(f64::NEG_INFINITY) < GAIN {
        return (ProcessNoiseFit::UNDETERMINED, top);
    }
    let relative_error = if near.is_some() { f64::NAN } else { relative_error(log, top, value) };
    (ProcessNoiseFit { motion: of(log), relative_error }, top)
}

/// Standard error of the logarithm of an intensity at the maximum of the likelihood.
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

/// Returns the best step from `low` to `high`, and beyond as long as the likelihood rises; and the last step.
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

/// Climbs to a step that is better than its neighbours, from that nearest to `near`. Returns the likelihood
/// of the step below it, and the step; none at the low end.
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

pub(super) fn median_step(track: &Track<'_>) -> f64 {
    let steps = track.times.windows(2).map(|pair| pair[1] - pair[0]);
    let mut steps: Vec<f64> = steps.filter(|&t| t > 0.0).collect();
    if steps.is_empty() { 1.0 } else { median(&mut steps) }
}

/// Returns the logarithms of an intensity that hardly shows within the track, and of one that shows within
/// the shortest step. The variance of a position grows with this power of the time, that of a velocity with a
/// power that is less by two.
pub(super) fn range(track: &Track<'_>, power: f64) -> Option<(f64, f64)> {
    if track.measured <= track.rank() {
        return None;
    }
    let steps = track.times.windows(2).map(|pair| pair[1] - pair[0]);
    let shortest = steps.filter(|&t| t > 0.0).fold(f64::INFINITY, f64::min);
    if !shortest.is_finite() {
        return None;
    }
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for (scales, power) in [(track.position_scale(), power), (track.velocity_scale(), power - 2.0)]
    {
        let scales = scales.iter().filter(|scale| **scale > 0.0);
        let widest = scales.fold(0.0_f64, |widest, scale| widest.max(1.0 / scale));
        if widest == 0.0 {
            continue;
        }
        let over = |t: f64| 2.0 * widest.ln() - power * t.ln();
        (low, high) = (low.min(over(track.span())), high.max(over(shortest)));
    }
    Some((low + MARGINS[0].ln(), high + MARGINS[1].ln()))
}

/// Returns the maximum between two points, by Brent's method: parabolas, and golden sections where they fail.
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
            // next to a bound, the other side of the best point is left
            let at = best.0 + step;
            if at - low < 2.0 * SETTLED || high - at < 2.0 * SETTLED {
                step = SETTLED.copysign(middle - best.0);
            }
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
