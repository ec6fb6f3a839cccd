//! Joint detection of points (single outliers) and bursts (runs of outliers on the same side).
//!
//! Collective and point anomaly detection (Fisch, Eckley, Fearnhead 2022) for a change in mean.
//! It starts with median and MAD, and is solved exactly by dynamic programming.

use super::summary::Summary;
use crate::base::angle::median;
use crate::base::error::{Result, require, require_correlation, require_sample};
use crate::base::interrupt::poll;
use crate::base::moments::Moments;
use crate::base::scratch::refill;
use pulp::{Simd, WithSimd};

/// Ratio of the standard deviation of a normal distribution to its MAD.
const MAD_TO_SIGMA: f64 = 1.4826;
/// Largest number of refits of centre and scale.
const MAX_ITERATIONS: usize = 3;
/// If fewer values than this, or than a quarter of the sample, would be left, nothing is flagged.
const MIN_KEPT: usize = 5;
/// Shorter samples get the penalties of this many values. Median and MAD of a few values are so
/// uncertain that with ln N itself one good value in twenty would be flagged.
const FEWEST_FOR_PENALTY: usize = 30;
/// Limit of the length of bursts; the table of lengths must fit into memory.
const LONGEST_BURST: usize = 100_000;
/// Largest penalty and rounding step; larger ones would overflow.
const LARGEST: f64 = 1e100;
/// Number of measurements between two checks for an interruption.
const POLLED: usize = 1024;
/// Largest score; scores are clamped so that their squares remain finite.
const MAX_SCORE: f64 = 1e150;

/// Parameters of the detection, validated.
#[derive(Clone, Debug, PartialEq)]
pub struct BurstRule {
    point_penalty: f64,
    burst_penalty: f64,
    min_length: usize,
    max_length: usize,
    rounding: f64,
    /// 1/(l φ_l) for l = max_length ..= 1, where φ_l is the variance inflation of a sum of l values.
    inverse_lengths: Vec<f64>,
}

/// Buffers that are reused from row to row.
#[derive(Clone, Debug, Default)]
pub struct BurstWorkspace {
    score: Vec<f64>,
    /// Sum of the scores from each start to the current value.
    sum: Vec<f64>,
    /// Best total before each start, relative to the best total so far.
    total: Vec<f64>,
    gain: Vec<f64>,
    /// Length of the point or burst that ends at each value in the best solution so far; 0 if none ends
    /// there.
    length: Vec<usize>,
    kept: Vec<f64>,
    /// Rounding step of the measurements, zero if unknown.
    step: f64,
}

impl BurstRule {
    /// Creates a rule with penalties in units of ln N per point and per burst, burst lengths from
    /// `min_length` to `max_length`, the lag-one `correlation` of the noise and the `rounding` step of
    /// the measurements (0: not rounded, or unknown).
    ///
    /// # Errors
    /// A parameter outside its domain.
    pub fn try_new(
        point_penalty: f64,
        burst_penalty: f64,
        (min_length, max_length): (usize, usize),
        correlation: f64,
        rounding: f64,
    ) -> Result<Self> {
        let holds = |v: f64| v > 0.0 && v <= LARGEST;
        let wanted = "a positive number, not above 1e100";
        require("point_penalty", point_penalty, holds(point_penalty), wanted)?;
        require("burst_penalty", burst_penalty, holds(burst_penalty), wanted)?;
        require("min_burst", min_length as f64, min_length >= 2, "at least 2")?;
        let holds = max_length >= min_length;
        require("max_burst", max_length as f64, holds, "at least min_burst")?;
        require_correlation(correlation)?;
        let holds = (0.0..=LARGEST).contains(&rounding);
        require("rounding", rounding, holds, "zero or a positive number, not above 1e100")?;
        let holds = max_length <= LONGEST_BURST;
        require("max_burst", max_length as f64, holds, "at most 100000")?;
        Ok(Self {
            point_penalty,
            burst_penalty,
            min_length,
            max_length,
            rounding,
            inverse_lengths: inverse_lengths(correlation, max_length),
        })
    }

    /// Flags points and bursts. O(N · max_length).
    ///
    /// ```
    /// use tertia::screening::{BurstRule, BurstWorkspace};
    ///
    /// let mut y: Vec<f64> = (0..100).map(|i| f64::from(i * i * 7 % 97) / 28.0).collect();
    /// y[40..46].iter_mut().for_each(|value| *value += 8.0);
    /// let rule = BurstRule::try_new(2.5, 3.0, (2, 20), 0.0, 0.0)?;
    /// let mut outlier = [false; 100];
    /// rule.detect(&y, &mut outlier, &mut BurstWorkspace::default())?;
    /// assert!(outlier[40..46].iter().all(|&wrong| wrong));
    /// assert_eq!(outlier.iter().filter(|&&wrong| wrong).count(), 6);
    /// # Ok::<(), tertia::Error>(())
    /// ```
    ///
    /// # Errors
    /// Fewer than 3 values, a value that is not finite, or deviations out of range.
    ///
    /// # Panics
    /// If the slices differ in length.
    pub fn detect(
        &self,
        y: &[f64],
        outlier: &mut [bool],
        workspace: &mut BurstWorkspace,
    ) -> Result<Summary> {
        assert_eq!(y.len(), outlier.len());
        require_sample("y", y, 3)?;
        let mut kept = Moments::of("y", y)?;
        let (mut centre, mut scale) = self.start(y, workspace)?;
        let ln_n = (y.len().max(FEWEST_FOR_PENALTY) as f64).ln();
        outlier.fill(false);
        for _ in 0..MAX_ITERATIONS {
            if scale == 0.0 {
                break;
            }
            workspace.standardise(y, centre, scale);
            pulp::Arch::new().dispatch(Solve { rule: self, ln_n, workspace });
            workspace.backtrack(outlier);
            kept = workspace.refit(y, outlier)?;
            let previous = std::mem::replace(&mut centre, kept.mean());
            scale = kept.variance().sqrt().hypot(workspace.rounding_sigma());
            if centre == previous {
                break;
            }
        }
        Ok(Summary::of_moments(&kept, (self.point_penalty * ln_n).sqrt() * scale))
    }

    /// [`BurstRule::detect`] that also writes the cleaned sample (nan in place of outliers).
    ///
    /// # Errors
    /// As [`BurstRule::detect`].
    ///
    /// # Panics
    /// If the slices differ in length.
    pub fn screen(
        &self,
        y: &[f64],
        outlier: &mut [bool],
        cleaned: &mut [f64],
        workspace: &mut BurstWorkspace,
    ) -> Result<Summary> {
        assert_eq!(y.len(), cleaned.len());
        let summary = self.detect(y, outlier, workspace)?;
        for ((c, &v), &flag) in cleaned.iter_mut().zip(y).zip(&*outlier) {
            *c = if flag { f64::NAN } else { v };
        }
        Ok(summary)
    }

    /// Median and MAD, or [`BurstRule::start_of_ties`] if the MAD is zero; stores the rounding step.
    fn start(&self, y: &[f64], workspace: &mut BurstWorkspace) -> Result<(f64, f64)> {
        let n = y.len() as f64;
        let deviations = &mut workspace.kept;
        deviations.clear();
        deviations.extend_from_slice(y);
        let centre = median(deviations);
        for v in deviations.iter_mut() {
            *v = (*v - centre).abs();
        }
        let scale = MAD_TO_SIGMA * n / (n - 0.8) * median(deviations);
        workspace.step = self.rounding;
        if scale > 0.0 {
            return Ok((centre, scale.hypot(workspace.rounding_sigma())));
        }
        self.start_of_ties(y, centre, workspace)
    }

    /// Centre and scale if more than half of the measurements equal `centre`. If measurements are rounded,
    /// those one step away are equally good, so both values determine centre and scale. If the step is
    /// unknown, it is the distance of the nearest different measurement, and the scale is at least the
    /// mean absolute deviation.
    fn start_of_ties(
        &self,
        y: &[f64],
        centre: f64,
        workspace: &mut BurstWorkspace,
    ) -> Result<(f64, f64)> {
        let deviations = &mut workspace.kept;
        let mut floor = 0.0;
        if self.rounding == 0.0 {
            let off = deviations.iter().copied().filter(|&d| d > 0.0);
            let nearest = off.fold(f64::INFINITY, f64::min);
            workspace.step = if nearest.is_finite() { nearest } else { 0.0 };
            floor = deviations.iter().sum::<f64>() / y.len() as f64;
        }
        let within = |v: &f64| (v - centre).abs() <= 1.5 * workspace.step;
        deviations.clear();
        deviations.extend(y.iter().copied().filter(within));
        let near = Moments::of("y", deviations)?;
        let rounding = workspace.rounding_sigma();
        if workspace.kept.iter().filter(|&&v| v != centre).count() < 2 {
            return Ok((centre, rounding.max(floor)));
        }
        Ok((near.mean(), near.variance().sqrt().hypot(rounding).max(floor)))
    }

    /// Finds the best partition into normal values, points and bursts:
    /// `C[t] = max(C[t−1], C[t−1] + x_t² − β_p, max_l C[t−l] + (x_{t−l+1}+…+x_t)²/(l φ_l) − β_c)`.
    /// Of equal totals, a normal value is preferred to a point, and a point to the longest burst. Totals are
    /// relative to the latest one, so that an enormous value does not cost the later ones their digits.
    #[inline(always)]
    fn solve(&self, ln_n: f64, workspace: &mut BurstWorkspace) {
        let (point_cost, burst_cost) = (self.point_penalty * ln_n, self.burst_penalty * ln_n);
        let BurstWorkspace { score, sum, total, gain, length, .. } = workspace;
        let n = score.len();
        for (buffer, size) in [(&mut *sum, n), (&mut *total, n + 1), (&mut *gain, self.max_length)]
        {
            refill(buffer, size, 0.0);
        }
        length.clear();
        for (t, &x) in score.iter().enumerate() {
            if t % POLLED == 0 {
                poll();
            }
            // starts of the segments that may end at t
            let first = (t + 1).saturating_sub(self.max_length);
            let sums = &mut sum[first..=t];
            let weights = &self.inverse_lengths[self.max_length - sums.len()..];
            for (s, g, w, c) in izip(sums, gain, weights, &total[first..=t]) {
                *s += x;
                *g = c + *s * *s * w;
            }
            let long_enough = (t + 2 - first).saturating_sub(self.min_length);
            let best = largest(&gain[..long_enough]);
            let point = x * x - point_cost;
            let (mut rise, mut found) = if point > 0.0 { (point, 1) } else { (0.0, 0) };
            if best - burst_cost > rise {
                rise = best - burst_cost;
                let longest = gain[..long_enough].iter().position(|&g| g == best);
                found = t + 1 - (first + longest.unwrap_or(0));
            }
            length.push(found);
            if rise > 0.0 {
                for c in &mut total[first..=t] {
                    *c -= rise;
                }
            }
        }
    }
}

struct Solve<'a> {
    rule: &'a BurstRule,
    ln_n: f64,
    workspace: &'a mut BurstWorkspace,
}

impl WithSimd for Solve<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        self.rule.solve(self.ln_n, self.workspace);
    }
}

/// Largest value, −∞ if there is none; in several lanes, because a single maximum is a chain of dependent
/// steps.
#[inline(always)]
fn largest(values: &[f64]) -> f64 {
    let larger = |a: f64, b: f64| if b > a { b } else { a };
    let (chunks, rest) = values.as_chunks::<4>();
    let mut lanes = [f64::NEG_INFINITY; 4];
    for chunk in chunks {
        for (lane, &v) in lanes.iter_mut().zip(chunk) {
            *lane = larger(*lane, v);
        }
    }
    let mut best = larger(larger(lanes[0], lanes[1]), larger(lanes[2], lanes[3]));
    for &v in rest {
        best = larger(best, v);
    }
    best
}

/// Iterates over four slices in parallel.
#[inline(always)]
fn izip<'a>(
    sums: &'a mut [f64],
    gains: &'a mut [f64],
    weights: &'a [f64],
    totals: &'a [f64],
) -> impl Iterator<Item = (&'a mut f64, &'a mut f64, &'a f64, &'a f64)> {
    let pairs = sums.iter_mut().zip(gains);
    pairs.zip(weights.iter().zip(totals)).map(|((s, g), (w, c))| (s, g, w, c))
}

/// `1/(l φ_l)` for l = longest ..= 1, where `φ_l = 1 + 2 Σ_{j<l} (1 − j/l) ρ^j` is the ratio of the variance
/// of the mean of l values of an AR(1) process to that for white noise. O(longest).
fn inverse_lengths(correlation: f64, longest: usize) -> Vec<f64> {
    // Σ ρ^j and Σ j ρ^j over j < l
    let (mut sum, mut first_moment, mut power) = (0.0, 0.0, 1.0);
    let mut inverse = Vec::with_capacity(longest);
    for length in 1..=longest {
        let l = length as f64;
        inverse.push(1.0 / (l + 2.0 * (l * sum - first_moment)));
        power *= correlation;
        sum += power;
        first_moment += l * power;
    }
    inverse.reverse();
    inverse
}

impl BurstWorkspace {
    /// Standard deviation of the rounding errors of the measurements.
    fn rounding_sigma(&self) -> f64 {
        self.step / 12_f64.sqrt()
    }

    fn standardise(&mut self, y: &[f64], centre: f64, scale: f64) {
        let score = |v: &f64| ((v - centre) / scale).clamp(-MAX_SCORE, MAX_SCORE);
        self.score.clear();
        self.score.extend(y.iter().map(score));
    }

    fn backtrack(&self, outlier: &mut [bool]) {
        outlier.fill(false);
        let mut end = self.length.len();
        while end > 0 {
            let length = self.length[end - 1];
            outlier[end - length..end].fill(true);
            end -= length.max(1);
        }
    }

    /// Moments of the values that are not flagged. If too few are left, removes all flags and uses all
    /// values.
    fn refit(&mut self, y: &[f64], outlier: &mut [bool]) -> Result<Moments> {
        self.kept.clear();
        let pairs = y.iter().zip(&*outlier);
        self.kept.extend(pairs.filter(|(_, flag)| !**flag).map(|(v, _)| v));
        if self.kept.len() < MIN_KEPT.max(y.len().div_ceil(4)) {
            outlier.fill(false);
            return Moments::of("y", y);
        }
        Moments::of("y", &self.kept)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::noise;

    fn rule(correlation: f64) -> BurstRule {
        BurstRule::try_new(2.5, 3.0, (2, 10), correlation, 0.0).unwrap()
    }

    fn found(rule: &BurstRule, y: &[f64]) -> Vec<usize> {
        let mut outlier = vec![false; y.len()];
        rule.detect(y, &mut outlier, &mut BurstWorkspace::default()).unwrap();
        (0..y.len()).filter(|&i| outlier[i]).collect()
    }

    #[test]
    fn points_and_bursts_are_found_beside_an_enormous_value() {
        let mut y: Vec<f64> = (0..60).map(noise).collect();
        y[30..34].fill(6.0);
        y[50] = -9.0;
        y[5] = 1e140;
        assert_eq!(found(&rule(0.0), &y), [5, 30, 31, 32, 33, 50]);
    }

    #[test]
    fn a_majority_is_never_flagged() {
        let y: Vec<f64> =
            (0..20).map(|i| if i % 4 == 0 { noise(i) * 1e-3 } else { 50.0 }).collect();
        let flagged = found(&rule(0.0), &y).len();
        assert!(flagged <= 15, "{flagged}");
    }

    /// Sums `1 + 2 Σ (1 − j/l) ρ^j` directly.
    #[test]
    fn inflation_of_correlated_means() {
        for rho in [-0.5, 0.0, 0.3, 0.9] {
            for length in [1, 2, 7, 50] {
                let l = length as f64;
                let direct: f64 = (1..length)
                    .map(|j| 2.0 * (1.0 - j as f64 / l) * f64::powi(rho, j as i32))
                    .sum();
                let stored = 1.0 / (inverse_lengths(rho, 50)[50 - length] * l);
                assert!((stored - 1.0 - direct).abs() < 1e-12);
            }
        }
    }
}
