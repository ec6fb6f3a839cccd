//! Outliers of a series that changes with time: compares each measurement with a polynomial through its
//! neighbours.

use super::summary::Summary;
use crate::base::angle::{median, nearest, require_angles, require_period, unwrap_about_median};
use crate::base::basis::Basis;
use crate::base::error::{Result, require, require_each, require_times};
use crate::base::interrupt::poll;
use crate::base::moments::Moments;
use crate::base::scratch::refill;

/// Ratio of the standard deviation of a normal distribution to its MAD.
const MAD_TO_SIGMA: f64 = 1.4826;
const PASSES: usize = 3;
/// A measurement is flagged only if no other within this distance deviates more, because an outlier also
/// makes its neighbours deviate.
const NEAR: usize = 2;
/// Number of neighbours that a polynomial requires in addition to its degree.
const SPARE: usize = 3;
const HIGHEST: usize = 9;
/// Deviations below this share of the largest measurement are rounding errors.
const SAME: f64 = 1e-13;
/// Largest measurement; squares of larger numbers would overflow.
const LARGEST: f64 = 1e140;

/// Parameters of the rule, validated.
#[derive(Clone, Debug, PartialEq)]
pub struct MovingRule {
    window: usize,
    degree: usize,
    k: f64,
    period: Option<f64>,
}

/// Buffers that are reused from row to row.
#[derive(Clone, Debug, Default)]
pub struct MovingWorkspace {
    /// Whether a measurement is present and not an outlier.
    kept: Vec<bool>,
    /// Value expected from the neighbours; nan if they are too few.
    expected: Vec<f64>,
    /// Deviation divided by `√(1 + h)`; nan if there is none.
    score: Vec<f64>,
    scratch: Vec<f64>,
    neighbours: Neighbours,
}

/// The polynomial through the neighbours of a measurement; its value at the measurement is `Σ c_j y_j`.
#[derive(Clone, Debug, Default)]
struct Neighbours {
    index: Vec<usize>,
    /// Times of the neighbours minus that of the measurement.
    at: Vec<f64>,
    value: Vec<f64>,
    unwrapped: Vec<f64>,
    scratch: Vec<f64>,
    basis: Basis,
    weight: Vec<f64>,
    ones: Vec<f64>,
    /// Times for which the weights were computed.
    weighed: Vec<f64>,
}

impl MovingRule {
    /// Creates a rule.
    ///
    /// # Errors
    /// An even window, a degree that is too high for it, or a threshold or period that is not positive.
    pub fn try_new(window: usize, degree: usize, k: f64, period: Option<f64>) -> Result<Self> {
        require("window", window as f64, window % 2 == 1, "an odd number")?;
        let holds = degree + SPARE < window && degree <= HIGHEST;
        require("degree", degree as f64, holds, "less than window - 3, and not above 9")?;
        require("k", k, k > 0.0 && k.is_finite(), "a positive number")?;
        period.map_or(Ok(()), require_period)?;
        Ok(Self { window, degree, k, period })
    }

    /// Flags measurements that deviate by more than `k σ √(1 + h)` from the least-squares polynomial
    /// through the others of their window, where `h σ²` is the variance of that polynomial,
    /// `σ = 1.4826 median |z|` and `z = e/√(1 + h)`. Each of up to three passes flags the largest
    /// deviations within two places, and releases flagged measurements that agree with the remaining
    /// ones. Measurements that are nan are missing. `cleaned` contains the polynomials in place of
    /// outliers. O(N window degree) per pass.
    ///
    /// # Errors
    /// A measurement that is infinite, times that decrease, or deviations that cannot be squared.
    ///
    /// # Panics
    /// If the slices differ in length.
    pub fn screen(
        &self,
        y: &[f64],
        time: &[f64],
        outlier: &mut [bool],
        cleaned: &mut [f64],
        workspace: &mut MovingWorkspace,
    ) -> Result<Summary> {
        let n = y.len();
        assert!(time.len() == n && outlier.len() == n && cleaned.len() == n);
        let requirement = "a measurement must be a finite number, or nan for none";
        require_each("y", y, |y| y.is_nan() || y.abs() <= LARGEST, requirement)?;
        self.period.map_or(Ok(()), |period| require_angles("y", y, period))?;
        require_times(time, LARGEST)?;
        let MovingWorkspace { kept, expected, score, scratch, neighbours } = workspace;
        outlier.fill(false);
        kept.clear();
        kept.extend(y.iter().map(|v| !v.is_nan()));
        neighbours.weighed.clear();
        let largest = y.iter().filter(|v| !v.is_nan()).fold(0.0, |l: f64, v| l.max(v.abs()));
        let mut sigma = f64::NAN;
        for pass in 0..=PASSES {
            expected.clear();
            score.clear();
            for i in 0..n {
                poll();
                let (value, h) = neighbours.expect(self, y, time, kept, i)?;
                expected.push(value);
                score.push(self.deviation(y[i], value).abs() / (1.0 + h).sqrt());
            }
            scratch.clear();
            scratch.extend((0..n).filter(|&i| kept[i] && !score[i].is_nan()).map(|i| score[i]));
            if scratch.is_empty() {
                break;
            }
            sigma = (MAD_TO_SIGMA * median(scratch)).max(SAME * largest);
            let is_released = release(score, self.k * sigma, kept, outlier);
            if pass == PASSES || !(flag(score, self.k * sigma, kept, outlier) || is_released) {
                break;
            }
        }
        for i in 0..n {
            let replaced = self.period.map_or(expected[i], |p| nearest(expected[i], y[i], p));
            cleaned[i] = if outlier[i] { replaced } else { y[i] };
        }
        let mean = mean_of(cleaned, scratch)?;
        Ok(Summary { mean, variance: sigma * sigma, threshold: self.k * sigma })
    }

    fn deviation(&self, y: f64, expected: f64) -> f64 {
        match self.period {
            Some(period) => nearest(y, expected, period) - expected,
            None => y - expected,
        }
    }
}

/// Releases flagged measurements that agree with the remaining ones, because a large outlier also makes its
/// neighbours deviate. Returns whether there were any.
fn release(score: &[f64], limit: f64, kept: &mut [bool], outlier: &mut [bool]) -> bool {
    let mut found = false;
    for i in 0..score.len() {
        if outlier[i] && score[i] <= limit {
            (kept[i], outlier[i], found) = (true, false, true);
        }
    }
    found
}

/// Flags the scores above the limit that are the largest nearby; returns whether there were any.
fn flag(score: &[f64], limit: f64, kept: &mut [bool], outlier: &mut [bool]) -> bool {
    let of = |kept: &[bool], i: usize| if kept[i] && score[i] > limit { score[i] } else { 0.0 };
    let mut found = false;
    let before = kept.to_vec();
    for i in 0..score.len() {
        let own = of(&before, i);
        let near = i.saturating_sub(NEAR)..(i + NEAR + 1).min(score.len());
        // of equal scores, only the first counts
        let largest =
            near.clone().all(|j| if j < i { of(&before, j) < own } else { of(&before, j) <= own });
        if own > 0.0 && largest {
            (kept[i], outlier[i], found) = (false, true, true);
        }
    }
    found
}

fn mean_of(cleaned: &[f64], scratch: &mut Vec<f64>) -> Result<f64> {
    scratch.clear();
    scratch.extend(cleaned.iter().copied().filter(|v| !v.is_nan()));
    if scratch.is_empty() { Ok(f64::NAN) } else { Ok(Moments::of("y", scratch)?.mean()) }
}

impl Neighbours {
    /// Returns the value at `i` expected from the others in its window, and the ratio of its variance to
    /// σ²; nan if they are too few. Near the ends the window is the first or the last one.
    fn expect(
        &mut self,
        rule: &MovingRule,
        y: &[f64],
        time: &[f64],
        kept: &[bool],
        i: usize,
    ) -> Result<(f64, f64)> {
        let window = rule.window.min(y.len());
        let start = i.saturating_sub(rule.window / 2).min(y.len() - window);
        self.index.clear();
        self.index.extend((start..start + window).filter(|&j| j != i && kept[j]));
        self.at.clear();
        self.at.extend(self.index.iter().map(|&j| time[j] - time[i]));
        let different = 1 + self.at.windows(2).filter(|pair| pair[1] > pair[0]).count();
        if self.index.len() < rule.degree + SPARE || different <= rule.degree {
            return Ok((f64::NAN, f64::NAN));
        }
        if self.at != self.weighed {
            self.weigh(rule.degree);
        }
        self.value.clear();
        self.value.extend(self.index.iter().map(|&j| y[j]));
        if let Some(period) = rule.period {
            self.unwrapped.resize(self.value.len(), 0.0);
            unwrap_about_median(&self.value, period, &mut self.unwrapped, &mut self.scratch)?;
            std::mem::swap(&mut self.value, &mut self.unwrapped);
        }
        let origin = self.value[0];
        let sum: f64 = self.weight.iter().zip(&self.value).map(|(c, v)| c * (v - origin)).sum();
        Ok((origin + sum, self.weight.iter().map(|c| c * c).sum()))
    }

    /// `c_j = Σ_p φ_p(0) φ_p(t_j)` with polynomials φ that are orthonormal on the times t.
    fn weigh(&mut self, degree: usize) {
        self.weighed.clone_from(&self.at);
        let scale = self.at.iter().fold(0.0, |l: f64, t| l.max(t.abs()));
        let x: Vec<f64> = self.at.iter().map(|t| t / scale).collect();
        self.ones.resize(x.len(), 1.0);
        self.basis.build(degree, &x, &self.ones);
        let mut at_zero = Vec::new();
        self.basis.derivatives(0, 0.0, &mut at_zero);
        refill(&mut self.weight, x.len(), 0.0);
        for (p, factor) in at_zero.iter().enumerate() {
            let row = self.basis.row(p);
            self.weight.iter_mut().zip(row).for_each(|(c, phi)| *c += factor * phi);
        }
    }
}
