//! The rules by which the states of the radars are weighted.

use crate::base::error::{Result, require};

/// How the states of the radars are fused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rule {
    /// Equal weights.
    Equal,
    /// Weights 1/R by the nominal noise of the plots.
    Static,
    /// Weights 1/Y², component by component, with Y = K ν of this step (1)–(13); radars without a plot
    /// are left out.
    Paper,
    /// [`Rule::Paper`] as printed: a radar without a plot has Y = 0 and therefore all the weight.
    PaperPrinted,
    /// Weights by the inverse of the running mean of ν².
    Ewma,
    /// Weights 1/P, component by component, of the radars' own filters.
    Posterior,
    /// Weights 1/P, component by component, of the radars' tracks with their estimated noise.
    Adaptive,
    /// The best linear combination with cross covariances and the estimated noise.
    AdaptiveMatrix,
    /// The best linear combination with cross covariances and the stated noise (Bar-Shalom, Campo 1986).
    Matrix,
    /// Covariance intersection of the radars' own filters.
    CovarianceIntersection,
    /// One filter for all plots.
    Central,
    /// One filter for all plots; the noise of plots and prediction is estimated.
    Robust,
}

impl Rule {
    /// Whether the rule uses covariances with the estimated noise.
    pub(super) fn believes(self) -> bool {
        matches!(self, Self::Adaptive | Self::AdaptiveMatrix)
    }

    /// Whether the rule finds radars whose noise is larger than stated.
    pub(super) fn finds_faults(self) -> bool {
        self.believes() || self == Self::Robust
    }
}

/// How quickly and how easily the noise of a radar is assumed to be larger than stated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Beliefs {
    /// Weight of the past in the running means, per plot.
    pub forgetting_factor: f64,
    /// Mean normalised innovation squared, relative to the other radars, above which more noise is assumed.
    pub threshold: f64,
    /// Normalised innovation squared, relative to the other radars, above which a plot is an outlier.
    pub outlier_gate: f64,
    /// For [`Rule::Robust`]: probability that the noise of a radar changes from one plot to the next, and
    /// probability that a plot is an outlier.
    pub change_probability: f64,
}

impl Beliefs {
    /// Returns the validated parameters.
    ///
    /// # Errors
    /// A parameter outside its domain.
    pub fn try_new(
        forgetting_factor: f64,
        threshold: f64,
        outlier_gate: f64,
        change_probability: f64,
    ) -> Result<Self> {
        let (factor, change) = (forgetting_factor, change_probability);
        require(
            "forgetting_factor",
            factor,
            (0.0..1.0).contains(&factor),
            "at least 0 and below 1",
        )?;
        require("threshold", threshold, threshold >= 1.0, "at least 1")?;
        require("outlier_gate", outlier_gate, outlier_gate >= 1.0, "at least 1")?;
        require("change_probability", change, change > 0.0 && change < 1.0, "above 0 and below 1")?;
        Ok(Self { forgetting_factor, threshold, outlier_gate, change_probability })
    }
}

/// Returns precisions as shares of their sum. Infinite precisions divide the whole sum among themselves;
/// if all are zero, the shares are equal.
pub(super) fn shares(precision: impl Iterator<Item = f64> + Clone) -> impl Iterator<Item = f64> {
    let largest = precision.clone().fold(0.0, f64::max);
    let relative = move |value: f64| match value {
        _ if largest == 0.0 => 1.0,
        _ if largest == f64::INFINITY => f64::from(u8::from(value == largest)),
        _ => value / largest,
    };
    let sum: f64 = precision.clone().map(relative).sum();
    precision.map(move |value| relative(value) / sum)
}
