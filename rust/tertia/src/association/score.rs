//! Scores of a plot for a track.

use crate::base::error::{Result, require};

const LN_TWO_PI: f64 = 1.837_877_066_409_345_3;

/// `S = ½ (1/Q − 1) d² + m/2 ln Q`: the log-likelihood ratio of a true to a false association,
/// if the covariance of false associations is Q Σ. It ignores ln |Σ|.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PaperScore {
    slope: f64,
    largest: f64,
}

impl PaperScore {
    /// Creates the score with the ratio Q for m components.
    ///
    /// # Errors
    /// A ratio that is not above 1.
    pub fn new(q: f64, m: usize) -> Result<Self> {
        require_ratio(q)?;
        Ok(Self { slope: 0.5 * (1.0 / q - 1.0), largest: 0.5 * m as f64 * q.ln() })
    }

    /// Returns the score for a d².
    #[inline]
    #[must_use]
    pub fn of(&self, d2: f64) -> f64 {
        self.slope * d2 + self.largest
    }
}

/// The [`PaperScore`] of one plot.
///
/// # Errors
/// A ratio that is not above 1.
pub fn paper(d2: f64, q: f64, m: usize) -> Result<f64> {
    Ok(PaperScore::new(q, m)?.of(d2))
}

fn require_ratio(q: f64) -> Result<()> {
    require("q", q, q > 1.0 && q.is_finite(), "above 1")
}

/// `ln N(ΔZ; 0, Σ) = −½ d² − ½ ln |Σ| − m/2 ln 2π`.
#[inline]
#[must_use]
pub fn log_density(d2: f64, ln_determinant: f64, m: usize) -> f64 {
    -0.5 * (d2 + ln_determinant + m as f64 * LN_TWO_PI)
}

/// Conditions of detection: probability of detection and clutter density.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surroundings {
    ln_ratio: f64,
    ln_missed: f64,
}

impl Surroundings {
    /// Conditions with the probability of detection in a scan, and the number of false plots per scan and
    /// area (m = 2) or volume (m = 3).
    ///
    /// # Errors
    /// A probability or density outside its domain.
    pub fn new(detection_probability: f64, clutter_density: f64) -> Result<Self> {
        let (pd, beta) = (detection_probability, clutter_density);
        let requirement = "between 0 and 1 (exclusive)";
        require("detection_probability", pd, pd > 0.0 && pd < 1.0, requirement)?;
        let holds = beta >= f64::MIN_POSITIVE && beta.is_finite();
        require("clutter_density", beta, holds, "a positive number")?;
        Ok(Self { ln_ratio: pd.ln() - beta.ln(), ln_missed: (-pd).ln_1p() })
    }

    /// `ln(Pd N / β)`: the log-likelihood ratio of a plot of the target to a false plot.
    #[inline]
    #[must_use]
    pub fn likelihood(&self, log_density: f64) -> f64 {
        log_density + self.ln_ratio
    }

    /// `ln(1 − Pd)`: the log-likelihood of a missed detection.
    #[inline]
    #[must_use]
    pub fn missed(&self) -> f64 {
        self.ln_missed
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_within;

    #[test]
    fn vectors_of_the_paper() {
        let d2 = 3.114285714286;
        for (q, score, zero) in [
            (4.0, 0.218437218263, 3.696784962986),
            (10.0, 0.901156521565, 5.116855762209),
            (100.0, 3.063598757417, 9.303374113107),
        ] {
            assert_within(1e-11, paper(d2, q, 2).unwrap(), score);
            assert_within(1e-11, 2.0 * q * q.ln() / (q - 1.0), zero);
            assert!(paper(zero, q, 2).unwrap().abs() < 1e-11);
        }
        assert_within(1e-11, paper(5.0, 10.0, 3).unwrap(), 1.203877639491);
    }

    #[test]
    fn likelihoods() {
        assert_within(1e-11, log_density(0.0, 0.0, 2), -(std::f64::consts::TAU.ln()));
        let around = Surroundings::new(0.9, 1e-8).unwrap();
        assert_within(1e-11, around.likelihood(-13.0), (0.9_f64 / 1e-8).ln() - 13.0);
        assert_within(1e-11, around.missed(), 0.1_f64.ln());
        for (pd, beta) in [(0.0, 1.0), (1.0, 1.0), (0.5, 0.0), (0.5, f64::NAN), (f64::NAN, 1.0)] {
            assert!(Surroundings::new(pd, beta).is_err());
        }
        for q in [1.0, 0.5, f64::INFINITY, f64::NAN] {
            assert!(paper(1.0, q, 2).is_err());
        }
    }
}
