//! The rules by which states are weighed.

use crate::base::error::{Result, require};

/// How the states of the radars are fused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rule {
    /// Equal weights.
    Equal,
    /// By the nominal noise of the plots, 1/R.
    Static,
    /// Component by component by 1/Y², Y = K ν of this step (1)–(13); radars without a plot are
    /// left out.
    Paper,
    /// The same as printed: a radar without a plot has Y = 0, and all the weight.
    PaperPrinted,
    /// By the running mean of ν².
    Ewma,
    /// Component by component by 1/P of the radars' own filters.
    Posterior,
    /// Component by component by 1/P of the radars' tracks with their estimated noise.
    Adaptive,
    /// The best linear combination with cross-covariances, with the estimated noise.
    AdaptiveMatrix,
    /// The same with the noise as stated (Bar-Shalom, Campo 1986).
    Matrix,
    /// Covariance intersection of the radars' own filters.
    CovarianceIntersection,
    /// One filter for all plots.
    Central,
    /// The same, with the noise of plots and prediction estimated.
    Robust,
}

impl Rule {
    /// Whether the covariances are those of the estimated noise.
    pub(super) fn believes(self) -> bool {
        matches!(self, Self::Adaptive | Self::AdaptiveMatrix)
    }

    /// Whether radars that are worse than they state are found.
    pub(super) fn finds_faults(self) -> bool {
        self.believes() || self == Self::Robust
    }
}

/// How quickly and how easily a radar is treated as worse than stated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Beliefs {
    /// Weight of the past in the running means, per plot.
    pub forgetting_factor: f64,
    /// Mean normalised innovation, in units of the others', above which more noise is assumed.
    pub threshold: f64,
    /// Normalised square of a single innovation, likewise, above which it is an outlier.
    pub outlier_gate: f64,
    /// For [`Rule::Robust`]: probability that a radar's noise changes from one plot to the next, and
    /// that a plot is an outlier.
    pub change_probability: f64,
}

impl Beliefs {
    /// The parameters, validated.
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

/// Precisions as shares of their sum; those that are infinite share everything, and all share
/// alike where all are zero.
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
