//! Confidence intervals of figures of a record that is worth an uncertain number of independent values.

use crate::base::distribution::{chi_square_upper_real, normal_two_sided, student_two_sided};
use crate::base::error::{Result, require};

/// Number of bisections: more than the bits of a double.
const HALVINGS: usize = 60;
/// Models with a smaller probability than this do not change any printed digit.
const NEGLIGIBLE: f64 = 1e-9;

/// Distribution of the number of independent values that a record is worth.
pub struct Worth<'a> {
    /// Possible numbers of values.
    pub number: &'a [f64],
    /// Probabilities of these numbers.
    pub probability: &'a [f64],
    /// Degrees of freedom of the variance from which the numbers result; infinite if it is integrated out.
    pub degrees_of_freedom: f64,
}

impl Worth<'_> {
    fn check(&self, confidence_level: f64) -> Result<()> {
        let holds = confidence_level > 0.0 && confidence_level < 1.0;
        require("confidence_level", confidence_level, holds, "between 0 and 1 (exclusive)")?;
        let count = self.number.len() as f64;
        let fit = !self.number.is_empty() && self.number.len() == self.probability.len();
        require("number", count, fit, "as many as probabilities, and at least one")
    }

    /// Mean of a function of the number over its distribution.
    fn mean(&self, of: impl Fn(f64) -> f64) -> f64 {
        let models = self.number.iter().zip(self.probability);
        models.filter(|(_, p)| **p > NEGLIGIBLE).map(|(n, p)| p * of(*n)).sum()
    }

    /// `P(T ≤ t)` of a standard normal variable, or of Student's distribution if the degrees of freedom
    /// are finite.
    fn lower(&self, t: f64) -> f64 {
        let outside = if self.degrees_of_freedom.is_finite() {
            student_two_sided(t.abs(), self.degrees_of_freedom)
        } else {
            normal_two_sided(t.abs())
        };
        if t < 0.0 { 0.5 * outside } else { 1.0 - 0.5 * outside }
    }

    /// `P(T ≤ t √n)`, averaged over the numbers n.
    fn lower_of_mean(&self, t: f64) -> f64 {
        if t == 0.0 {
            return 0.5;
        }
        self.mean(|n| self.lower(t * n.sqrt()))
    }
}

/// Interval of the expectation of positive values with this mean and this ratio of their variance to
/// the square of their mean (2/m for chi-square with m degrees of freedom).
///
/// The mean of n values is treated as that of chi-square with `2 n / ratio` degrees of freedom. If the
/// degrees of freedom of `worth` are finite, its logarithm has Student's distribution.
///
/// # Errors
/// An invalid confidence level, or numbers and probabilities that do not match.
pub fn mean_interval(
    mean: f64,
    ratio: f64,
    worth: &Worth,
    confidence_level: f64,
) -> Result<[f64; 2]> {
    worth.check(confidence_level)?;
    let outside = 0.5 * (1.0 - confidence_level);
    // P(expectation < mean e^x)
    let below = |x: f64| {
        if worth.degrees_of_freedom.is_finite() {
            return worth.lower_of_mean(x / ratio.sqrt());
        }
        worth.mean(|n| {
            let nu = 2.0 * n / ratio;
            chi_square_upper_real(nu * (-x).exp(), nu)
        })
    };
    Ok([outside, 1.0 - outside].map(|p| mean * crossing(below, p, [-30.0, 30.0]).exp()))
}

/// Interval of a probability from an observed share, by Wilson's method (1927), averaged over the numbers.
///
/// # Errors
/// An invalid confidence level, or numbers and probabilities that do not match.
pub fn share_interval(share: f64, worth: &Worth, confidence_level: f64) -> Result<[f64; 2]> {
    worth.check(confidence_level)?;
    let outside = 0.5 * (1.0 - confidence_level);
    let below = |p: f64| worth.lower_of_mean((p - share) / (p * (1.0 - p)).sqrt());
    Ok([outside, 1.0 - outside].map(|p| crossing(below, p, [0.0, 1.0])))
}

/// Range of shares that may be observed for an event of this probability. The quantile of this probability
/// lies between the order statistics at these shares (Woodruff 1952). The shares are not limited to 0…1:
/// beyond this range, the quantile is unbounded.
///
/// # Errors
/// An invalid confidence level, or numbers and probabilities that do not match.
pub fn rank_interval(probability: f64, worth: &Worth, confidence_level: f64) -> Result<[f64; 2]> {
    worth.check(confidence_level)?;
    let holds = probability > 0.0 && probability < 1.0;
    require("probability", probability, holds, "between 0 and 1 (exclusive)")?;
    let outside = 0.5 * (1.0 - confidence_level);
    let scale = (probability * (1.0 - probability)).sqrt();
    let below = |share: f64| worth.lower_of_mean((share - probability) / scale);
    let bounds = [probability - 60.0 * scale, probability + 60.0 * scale];
    Ok([outside, 1.0 - outside].map(|p| crossing(below, p, bounds)))
}

/// Finds where an increasing function has a value, by bisection.
fn crossing(rising: impl Fn(f64) -> f64, value: f64, [mut low, mut high]: [f64; 2]) -> f64 {
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if rising(middle) < value { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_within;

    const WORTH: Worth =
        Worth { number: &[50.0], probability: &[1.0], degrees_of_freedom: f64::INFINITY };

    /// Wilson's interval for 45 of 50, in closed form.
    #[test]
    fn wilson() {
        let [low, high] = share_interval(0.9, &WORTH, 0.95).unwrap();
        assert_within(1e-12, low, 0.7863976856252035);
        assert_within(1e-12, high, 0.9565242350681096);
    }

    /// The interval of a share and the ranks of its bounds are inverse to each other.
    #[test]
    fn ranks_invert_shares() {
        let [_, high] = share_interval(0.9, &WORTH, 0.95).unwrap();
        let [low, _] = rank_interval(high, &WORTH, 0.95).unwrap();
        assert_within(1e-9, low, 0.9);
    }
}
