//! The classical rule (M1): compares each value with the mean and variance of the whole sample.

use super::others::moments_of_cleaned;
use super::summary::Summary;
use crate::base::error::{Error, Result, require_positive, require_sample};
use crate::base::moments::Moments;

/// Replacement of an outlier.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Replacement {
    /// Mean of the nearest good values on both sides (at an end of the sample: the only one).
    Neighbours,
    /// Mean of the whole sample, including outliers.
    Mean,
    /// No replacement: the value is excluded.
    Excluded,
}

/// The k-sigma rule with its treatment of outliers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KSigmaRule {
    k: f64,
    replacement: Replacement,
}

impl KSigmaRule {
    /// Creates a rule that flags y_i if `|y_i − M| > k √D`.
    ///
    /// # Errors
    /// k ≤ 0.
    pub fn try_new(k: f64, replacement: Replacement) -> Result<Self> {
        require_positive("k", k)?;
        Ok(Self { k, replacement })
    }

    /// Screens `y`: flags outliers and writes the cleaned sample (nan for excluded values). O(N).
    ///
    /// # Errors
    /// Fewer than 2 values, a value that is not finite, deviations out of range, or too few left.
    ///
    /// # Panics
    /// If the slices differ in length.
    pub fn screen(
        &self,
        y: &[f64],
        outlier: &mut [bool],
        cleaned: &mut [f64],
        scratch: &mut Vec<f64>,
    ) -> Result<Summary> {
        assert_eq!(y.len(), outlier.len());
        require_sample("y", y, 2)?;
        let moments = Moments::of("y", y)?;
        let threshold = self.k * moments.variance().sqrt();
        cleaned.copy_from_slice(y);
        for (flag, &v) in outlier.iter_mut().zip(y) {
            *flag = moments.is_beyond(v, threshold);
        }
        if !outlier.contains(&true) {
            return Ok(Summary::of_moments(&moments, threshold));
        }
        match self.replacement {
            Replacement::Neighbours => interpolate(outlier, cleaned)?,
            Replacement::Mean => fill(outlier, cleaned, moments.mean()),
            Replacement::Excluded => fill(outlier, cleaned, f64::NAN),
        }
        let cleaned_moments = moments_of_cleaned(cleaned, scratch)?;
        Ok(Summary::of_moments(&cleaned_moments, threshold))
    }
}

fn fill(outlier: &[bool], cleaned: &mut [f64], value: f64) {
    for (v, &flag) in cleaned.iter_mut().zip(outlier) {
        if flag {
            *v = value;
        }
    }
}

/// Replaces each run of flagged values by the mean of the values on both sides of it.
fn interpolate(outlier: &[bool], cleaned: &mut [f64]) -> Result<()> {
    let n = cleaned.len();
    let mut start = 0;
    while let Some(first) = (start..n).find(|&i| outlier[i]) {
        let end = (first..n).find(|&i| !outlier[i]).unwrap_or(n);
        let before = first.checked_sub(1).map(|i| cleaned[i]);
        let after = cleaned.get(end).copied();
        let value = match (before, after) {
            (Some(a), Some(b)) => a + 0.5 * (b - a),
            (Some(v), None) | (None, Some(v)) => v,
            (None, None) => return Err(Error::TooFewLeft { kept: 0, count: n }),
        };
        cleaned[first..end].fill(value);
        start = end;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cleaned(y: &[f64], replacement: Replacement) -> Result<Vec<f64>> {
        let (mut outlier, mut cleaned) = (vec![false; y.len()], vec![0.0; y.len()]);
        let rule = KSigmaRule::try_new(1.2, replacement)?;
        rule.screen(y, &mut outlier, &mut cleaned, &mut Vec::new())?;
        Ok(cleaned)
    }

    #[test]
    fn replacements() {
        let y = [9.0, 1.0, 3.0, 9.0, 9.0, 2.0, 1.0, 2.0, 1.0, 2.0];
        let neighbours = [1.0, 1.0, 3.0, 2.5, 2.5, 2.0, 1.0, 2.0, 1.0, 2.0];
        assert_eq!(cleaned(&y, Replacement::Neighbours).unwrap(), neighbours);
        assert_eq!(cleaned(&y, Replacement::Mean).unwrap()[3], 3.9);
        assert!(cleaned(&y, Replacement::Excluded).unwrap()[3].is_nan());
    }

    #[test]
    fn nothing_left_is_an_error() {
        let rule = KSigmaRule::try_new(0.5, Replacement::Neighbours).unwrap();
        let (mut outlier, mut cleaned) = ([false; 4], [0.0; 4]);
        let result =
            rule.screen(&[-1.0, -1.0, 1.0, 1.0], &mut outlier, &mut cleaned, &mut Vec::new());
        assert_eq!(result, Err(Error::TooFewLeft { kept: 0, count: 4 }));
    }
}
