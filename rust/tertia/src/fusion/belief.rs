//! Estimates of the noise of a radar from its innovations.

use super::rules::Beliefs;
use crate::base::angle::median;
use crate::kalman::Innovation;

/// Largest normalised innovation squared that is used; larger values count as this one.
const LARGEST_NIS: f64 = 100.0;

/// Running means of the innovations of a radar, from which its noise is estimated.
#[derive(Clone, Copy, Debug)]
pub(super) struct Belief {
    /// EWMA of ν²/S.
    pub q: f64,
    /// EWMA of ν² − S.
    pub d: f64,
    /// EWMA of ν² alone; nan before the first innovation.
    pub mean_square: f64,
    /// ν²/S of the plot of this step; `None` without a plot.
    pub nis: Option<f64>,
}

impl Belief {
    pub const NEW: Self = Self { q: 1.0, d: 0.0, mean_square: f64::NAN, nis: None };

    /// Updates the means with the innovation of this step, if there is one.
    pub fn update(&mut self, innovation: Option<Innovation>, beta: f64) {
        self.nis = innovation.map(|new| new.value * new.value / new.variance);
        if let (Some(new), Some(nis)) = (innovation, self.nis) {
            let square = new.value * new.value;
            self.q += beta * (nis.min(LARGEST_NIS) - self.q);
            let excess = (square - new.variance).min((LARGEST_NIS - 1.0) * new.variance);
            self.d += beta * (excess - self.d);
            let start = if self.mean_square.is_nan() { new.variance } else { self.mean_square };
            self.mean_square = start + beta * (square - start);
        }
    }
}

/// Returns the estimated variance of the noise of radar i, and whether its plot is a single outlier.
///
/// A radar is compared with the median of the other radars, because a manoeuvre raises the q of all radars.
pub(super) fn believed_noise(
    beliefs: &[Option<Belief>],
    i: usize,
    nominal: f64,
    innovation: Option<Innovation>,
    rule: &Beliefs,
    scratch: &mut Vec<f64>,
) -> (f64, bool) {
    let Some(own) = &beliefs[i] else { return (nominal, false) };
    let mut of_others = |value: fn(&Belief) -> f64| {
        scratch.clear();
        let others = beliefs.iter().enumerate().filter(|(j, _)| *j != i);
        scratch.extend(others.filter_map(|(_, belief)| belief.as_ref().map(value)));
        if scratch.is_empty() { 1.0 } else { median(scratch).max(1.0) }
    };
    let reference = of_others(|belief| belief.q);
    let mut noise = nominal;
    if own.q > rule.threshold * reference {
        noise = noise.max((nominal + own.d) / reference);
    }
    let mut outlier = false;
    if let (Some(new), Some(nis)) = (innovation, own.nis) {
        let calm = of_others(|belief| belief.nis.unwrap_or(belief.q));
        outlier = nis > rule.outlier_gate * calm;
        if outlier {
            noise = noise.max(new.value * new.value);
        }
    }
    (noise, outlier)
}
