//! Search for the maximum of the likelihood of a recording.

use super::likelihood::{DIFFERENCE, INFINITE_ALPHA, Likelihood};
use crate::base::error::Result;
use nalgebra::{Matrix2, Vector2};

/// Curvature below which a coordinate is not determined.
pub(super) const FLAT: f64 = 1e-3;
/// Largest number of peaks of the grid from which the search climbs.
const STARTS: usize = 3;
/// Number of times that are tried as the memory of a filter, after which it forgets a plot.
const MEMORIES: usize = 20;
const ITERATIONS: usize = 60;
const LONGEST_STEP: f64 = 2.0;
const SHORTER_STEPS: usize = 15;
/// Gain of a step below which a rough climb ends.
const ROUGHLY_SETTLED: f64 = 1.0;
/// Gain below which steps are taken without a comparison of likelihoods: their differences would soon
/// be rounding errors, and the peak must not depend on those of the machine.
const NEAR: f64 = 1e-6;
/// Gain of a step below which it is the last one: each step squares the error, so nothing is left to be
/// gained.
const SETTLED: f64 = 1e-10;
const POLISHING_STEPS: usize = 3;
/// Loss of likelihood in a step near the peak that may be due to rounding.
const LOSS: f64 = 1e-9;
/// Distance from a higher peak below which a climb is given up.
const BESIDE: f64 = 0.5;
/// Difference in log likelihood from the peak beyond which a limit is not climbed.
const HOPELESS: f64 = 10.0;
/// A limit is taken if its log likelihood is at most this much lower than that of the peak.
const AS_LIKELY: f64 = 1e-8;

/// A point of largest likelihood; `free` marks the coordinates that are not at a limit. `value` is the
/// log likelihood.
#[derive(Clone, Copy, Debug)]
pub(super) struct Peak {
    value: f64,
    pub at: [f64; 2],
    pub free: [bool; 2],
}

/// Returns the highest peak, or a limit that is as likely.
pub(super) fn highest_peak(likelihood: &mut Likelihood<'_>) -> Result<Peak> {
    let mut peaks = Vec::new();
    for start in starts(likelihood)? {
        peaks.push(climb(likelihood, start, [true, true], &peaks)?);
    }
    let highest =
        peaks.into_iter().reduce(|best, peak| if peak.value > best.value { peak } else { best });
    peak_or_limit(
        likelihood,
        highest.unwrap_or(Peak {
            value: f64::NEG_INFINITY,
            at: [f64::NEG_INFINITY; 2],
            free: [false; 2],
        }),
    )
}

/// Returns the highest peaks among the best points for each α of a grid, the highest first.
fn starts(likelihood: &mut Likelihood<'_>) -> Result<Vec<[f64; 2]>> {
    let [alphas, motions] = likelihood.grid().map(points);
    let mut ridge = Vec::new();
    for &x in &alphas {
        let mut best = (f64::NEG_INFINITY, [x, motions[0]]);
        for &y in &motions {
            let value = likelihood.at([x, y])?.0;
            if value > best.0 {
                best = (value, [x, y]);
            }
        }
        ridge.push(climb_roughly(likelihood, best.1)?);
    }
    let value = |i: usize| ridge.get(i).map_or(f64::NEG_INFINITY, |peak| peak.value);
    let is_peak = |i: usize| value(i) >= value(i.wrapping_sub(1)) && value(i) >= value(i + 1);
    let mut peaks: Vec<Peak> = (0..ridge.len()).filter(|&i| is_peak(i)).map(|i| ridge[i]).collect();
    peaks.sort_by(|a, b| b.value.total_cmp(&a.value));
    peaks.truncate(STARTS);
    Ok(straightened(likelihood, &peaks))
}

/// Returns equally spaced points between the ends, with a distance of about `step` at most.
fn points([low, high, step]: [f64; 3]) -> Vec<f64> {
    let last = 1 + ((high - low) / step) as usize;
    (0..=last).map(|i| low + (high - low) * i as f64 / last as f64).collect()
}

/// Returns the points in coordinates in which p refers to the time after which a filter forgets a plot;
/// in these, the ridges of the likelihood are straight. It is the time within which the motion at the
/// first point is as large as the error of the mean of the plots.
fn straightened(likelihood: &mut Likelihood<'_>, peaks: &[Peak]) -> Vec<[f64; 2]> {
    let ratio = |likelihood: &Likelihood<'_>, [x, y]: [f64; 2]| y + likelihood.acceleration(x);
    let ratios: Vec<f64> = peaks.iter().map(|peak| ratio(likelihood, peak.at)).collect();
    let moved = |likelihood: &Likelihood<'_>, i: usize| {
        let x = peaks[i].at[0];
        [x, ratios[i] - likelihood.acceleration(x)]
    };
    for i in 0..MEMORIES {
        let time = likelihood.length().powf(i as f64 / (MEMORIES - 1) as f64);
        likelihood.remember(time);
        if 2.0 * moved(likelihood, 0)[1] > -time.ln() {
            break;
        }
    }
    (0..peaks.len()).map(|i| moved(likelihood, i)).collect()
}

/// Climbs along y, far enough for a comparison.
fn climb_roughly(likelihood: &mut Likelihood<'_>, start: [f64; 2]) -> Result<Peak> {
    let free = [false, true];
    let mut peak = Peak { value: likelihood.at(start)?.0, at: start, free };
    for _ in 0..ITERATIONS {
        let step = Step::new(likelihood, &peak)?;
        let Some(next) = step.uphill(likelihood, &peak)? else { break };
        peak = next;
        if step.gain < ROUGHLY_SETTLED {
            break;
        }
    }
    Ok(peak)
}

/// Climbs by Newton's method in the free coordinates, within the bounds. The climb stops beside a
/// higher peak that has been found before.
fn climb(
    likelihood: &mut Likelihood<'_>,
    start: [f64; 2],
    free: [bool; 2],
    climbed: &[Peak],
) -> Result<Peak> {
    let mut peak = Peak { value: likelihood.at(start)?.0, at: start, free };
    let mut polished = 0;
    for _ in 0..ITERATIONS {
        let step = Step::new(likelihood, &peak)?;
        if step.gain >= NEAR {
            let Some(next) = step.uphill(likelihood, &peak)? else { break };
            peak = next;
            let is_beside = |other: &Peak| {
                let near = |i: usize| (peak.at[i] - other.at[i]).abs() < BESIDE;
                peak.value < other.value && near(0) && near(1)
            };
            if climbed.iter().any(is_beside) {
                break;
            }
            continue;
        }
        let next = step.taken(likelihood, &peak, 1.0)?;
        polished += 1;
        if next.value < peak.value - LOSS {
            break;
        }
        peak = next;
        if step.gain < SETTLED || polished == POLISHING_STEPS {
            break;
        }
    }
    Ok(peak)
}

/// A Newton step from a point.
struct Step {
    by: Vector2<f64>,
    /// Gain of the likelihood to first order, without the curvature.
    gain: f64,
    bounds: [[f64; 2]; 2],
}

impl Step {
    fn new(likelihood: &mut Likelihood<'_>, peak: &Peak) -> Result<Self> {
        let (gradient, second) = differences(likelihood, peak.at, peak.free)?;
        let bounds = likelihood.bounds();
        let free = [0, 1].map(|i| {
            let ([lowest, highest], at) = (bounds[i], peak.at[i]);
            let outward = if gradient[i] > 0.0 { at >= highest } else { at <= lowest };
            peak.free[i] && !outward
        });
        let by = newton(gradient, second, free);
        Ok(Self { by, gain: gradient.dot(&by), bounds })
    }

    /// Returns the point after a share of the step, within the bounds.
    fn taken(&self, likelihood: &mut Likelihood<'_>, peak: &Peak, share: f64) -> Result<Peak> {
        let mut at = peak.at;
        for i in (0..2).filter(|&i| peak.free[i]) {
            let [lowest, highest] = self.bounds[i];
            at[i] = (at[i] + share * self.by[i]).max(lowest).min(highest);
        }
        Ok(Peak { value: likelihood.at(at)?.0, at, ..*peak })
    }

    /// Returns the first point that is higher, with ever shorter steps.
    fn uphill(&self, likelihood: &mut Likelihood<'_>, peak: &Peak) -> Result<Option<Peak>> {
        let mut share = 1.0;
        for _ in 0..SHORTER_STEPS {
            let next = self.taken(likelihood, peak, share)?;
            if next.value > peak.value {
                return Ok(Some(next));
            }
            share /= 3.0;
        }
        Ok(None)
    }
}

/// Returns Newton's step in the free coordinates, uphill and of limited length. A direction that curves
/// upward is treated as if it curved downward.
fn newton(gradient: Vector2<f64>, second: Matrix2<f64>, free: [bool; 2]) -> Vector2<f64> {
    let along = |slope: f64, curvature: f64| slope / curvature.abs().max(FLAT);
    let step = if free == [true, true] {
        let eigen = second.symmetric_eigen();
        let slopes = eigen.eigenvectors.transpose() * gradient;
        eigen.eigenvectors * slopes.zip_map(&eigen.eigenvalues, along)
    } else {
        let one = |i: usize| if free[i] { along(gradient[i], second[(i, i)]) } else { 0.0 };
        Vector2::new(one(0), one(1))
    };
    step / 1.0_f64.max(step.amax() / LONGEST_STEP)
}

/// Returns gradient and second derivatives by central differences; 0 for coordinates that are not free.
pub(super) fn differences(
    likelihood: &mut Likelihood<'_>,
    at: [f64; 2],
    free: [bool; 2],
) -> Result<(Vector2<f64>, Matrix2<f64>)> {
    let h = DIFFERENCE;
    let middle = likelihood.at(at)?.0;
    let (mut gradient, mut second) = (Vector2::zeros(), Matrix2::zeros());
    for i in (0..2).filter(|&i| free[i]) {
        let mut beside = |h: f64| {
            let mut at = at;
            at[i] += h;
            likelihood.at(at).map(|(value, _)| value)
        };
        let (up, down) = (beside(h)?, beside(-h)?);
        gradient[i] = (up - down) / (2.0 * h);
        second[(i, i)] = (up - 2.0 * middle + down) / (h * h);
    }
    if free == [true, true] {
        let mut diagonal = |h: f64| likelihood.at(at.map(|x| x + h)).map(|(value, _)| value);
        let both = (diagonal(h)? - 2.0 * middle + diagonal(-h)?) / (h * h);
        second[(0, 1)] = 0.5 * (both - second.trace());
        second[(1, 0)] = second[(0, 1)];
    }
    Ok((gradient, second))
}

/// Returns the peak, or a limit that is as likely, including limits of limits.
fn peak_or_limit(likelihood: &mut Likelihood<'_>, peak: Peak) -> Result<Peak> {
    let mut best = None;
    for (start, free) in limits_beside(likelihood, &peak) {
        if likelihood.at(start)?.0 > peak.value - HOPELESS {
            let limit = climb(likelihood, start, free, &[])?;
            if limit.value > best.unwrap_or(peak).value - AS_LIKELY {
                best = Some(limit);
            }
        }
    }
    best.map_or(Ok(peak), |best| peak_or_limit(likelihood, best))
}

/// Returns points at limits, each with the coordinates that remain free there.
fn limits_beside(likelihood: &Likelihood<'_>, peak: &Peak) -> Vec<([f64; 2], [bool; 2])> {
    let ([x, y], [first, second], none) = (peak.at, peak.free, f64::NEG_INFINITY);
    let mut limits = Vec::new();
    if first {
        limits.extend([none, INFINITE_ALPHA].map(|end| ([end, y], [false, second])));
    }
    if second {
        limits.push(([x, likelihood.infinite_motion()], [first, false]));
        limits.push(([none; 2], [false; 2]));
    }
    limits
}
