//! Tukey's weights, and which measurements the rest of the path contradicts.

use super::found::Found;
use super::measured::{Measured, REDUNDANCY, Record};
use super::tukey::tukey;
use crate::base::distribution::normal_two_sided_quantile;

/// Chance that any measurement is left out that is no outlier.
const FALSE_ALARM: f64 = 0.01;
/// Size from which an instant agrees with the path: two-sided 1 %.
const DOUBTED: f64 = 0.01;
/// Share of a measurement that the others must determine.
const REDUNDANT: f64 = 0.1;
/// A weight that is none.
const FAINT: f64 = 0.01;
/// Size of what is not by chance, in standard errors: one-sided 5 %.
const CHANCE: f64 = 0.1;
/// Instants over which a running median tells errors that last from single faults, and the variance
/// of a median of so many normal errors, over theirs.
const RUNNING: usize = 5;
const OF_MEDIANS: f64 = 0.287;
/// Relative standard error of a median size of normal errors, times the root of their number.
const MEDIAN_ERROR: f64 = 1.17;

/// The number of standard errors that is exceeded by chance in one case of 20.
pub(super) fn chance() -> f64 {
    normal_two_sided_quantile(CHANCE)
}

/// By how much residuals are larger than their standard deviations say, at least 1: from their
/// median, less what it may be off by chance.
pub(super) fn scale(sizes: &mut [f64]) -> f64 {
    let n = sizes.len();
    let (below, &mut upper, _) = sizes.select_nth_unstable_by(n / 2, f64::total_cmp);
    let lower = below.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let median = if n % 2 == 1 { upper } else { 0.5 * (lower + upper) };
    let margin = 1.0 + chance() * MEDIAN_ERROR / (n as f64).sqrt();
    (median / normal_two_sided_quantile(0.5) / margin).max(1.0)
}

impl<const D: usize, const N: usize> Found<D, N> {
    /// The weights of the measurements by what the rest of the path says.
    ///
    /// Where an instant is located robustly, one that both the path and the other measurements of
    /// the instant contradict is left out, the worst one first: motion that the smoother does not
    /// know contradicts the path alone. With fewer degrees of freedom the others cannot decide, and
    /// the weights are Tukey's about the path.
    pub(super) fn trusted(&self, record: &Record<'_>) -> Vec<f64> {
        let mut of_path = vec![f64::NAN; self.measured.len()];
        let mut of_instant = of_path.clone();
        for t in 0..record.len() {
            let (p, c) = (&self.fixes.position[t * D..], &self.fixes.covariance[t * D * D..]);
            self.deleted(t, &p[..D], &c[..D * D], &mut of_instant);
            let c = &self.path.covariance[t * D * D..][..D * D];
            self.deleted(t, self.path.position::<D>(t), c, &mut of_path);
        }
        let mut sizes: Vec<f64> = of_path.iter().copied().filter(|size| !size.is_nan()).collect();
        if sizes.is_empty() {
            return self.trust.clone();
        }
        let scale = scale(&mut sizes);
        let limit = normal_two_sided_quantile(FALSE_ALARM / sizes.len() as f64) * scale;
        let doubted = normal_two_sided_quantile(DOUBTED) * self.fixes.tolerance;
        let mut trust = vec![1.0; self.trust.len()];
        for t in 0..record.len() {
            let own = self.measured.instant(t);
            let at = |m: usize| t * record.width() + self.measured.column[m];
            let rest = own.len() as i64 - D as i64;
            if self.fixes.is_located(t) && rest > 0 && rest < REDUNDANCY as i64 {
                for m in own {
                    let soft = tukey(of_path[m] / scale);
                    trust[at(m)] = if soft < FAINT { 0.0 } else { soft };
                }
                continue;
            }
            let doubtful = |m: usize| of_path[m] > limit && of_instant[m] > doubted;
            let fresh = own.clone().filter(|&m| doubtful(m) && self.trust[at(m)] > 0.0);
            let worst = fresh.fold(0.0_f64, |worst, m| worst.max(of_path[m]));
            for m in own {
                if doubtful(m) && (self.trust[at(m)] == 0.0 || of_path[m] == worst) {
                    trust[at(m)] = 0.0;
                }
            }
        }
        trust
    }

    /// By how much errors that last make residuals larger than stated, at instants that are located
    /// robustly; at least 1. What lasts is no fault: with limits for the noise alone, the largest of
    /// them would be left out, and the others would be taken for all that there is.
    pub(super) fn tolerance(&self, record: &Record<'_>, measured: &Measured<D>) -> f64 {
        let mut series = vec![Vec::new(); record.width()];
        let (mut count, mut rest) = (0, 0);
        for t in (0..record.len()).filter(|&t| record.robust && self.fixes.is_located(t)) {
            let own = measured.instant(t).len();
            if own < D + REDUNDANCY {
                continue;
            }
            (count, rest) = (count + own, rest + own - D);
            for (m, row) in measured.rows(t, self.path.position::<D>(t)) {
                series[measured.column[m]].push(row.residual);
            }
        }
        let windows = series.iter().flat_map(|own| own.windows(RUNNING));
        let mut sizes: Vec<f64> = windows
            .filter(|window| window.iter().all(|v| v.is_finite()))
            .map(|window| {
                let mut own: [f64; RUNNING] = std::array::from_fn(|i| window[i]);
                own.sort_unstable_by(f64::total_cmp);
                own[RUNNING / 2].abs()
            })
            .collect();
        if sizes.is_empty() {
            return 1.0;
        }
        let middle = sizes.len() / 2;
        let median = *sizes.select_nth_unstable_by(middle, f64::total_cmp).1;
        let margin = 1.0 + chance() * MEDIAN_ERROR * (RUNNING as f64 / sizes.len() as f64).sqrt();
        let size = median / normal_two_sided_quantile(0.5) / margin;
        let lasting = (size * size - OF_MEDIANS).max(0.0) * count as f64 / rest as f64;
        (1.0 + lasting).sqrt()
    }

    /// Sizes of the residuals of an instant about what follows without the measurement, over their
    /// standard deviations.
    ///
    /// With the residual r, the weight w and g = J P J' / σ²: the position without it predicts it
    /// with the error r / (1 − w g), of the variance σ² (1 + g / (1 − w g)).
    fn deleted(&self, t: usize, position: &[f64], covariance: &[f64], out: &mut [f64]) {
        let width = self.trust.len() / self.fixes.fixes.len();
        for (m, row) in self.measured.rows(t, position) {
            let mut g = 0.0;
            for i in 0..D {
                for j in 0..D {
                    g += row.gradient[i] * covariance[i * D + j] * row.gradient[j];
                }
            }
            let rest = 1.0 - self.used[t * width + self.measured.column[m]] * g;
            out[m] = if g.is_finite() && rest > REDUNDANT {
                (row.residual / rest / (1.0 + g / rest).sqrt()).abs()
            } else {
                f64::NAN
            };
        }
    }
}
