//! The recording that is fitted, and the limits of its likelihood.

use super::super::batch::Table;

/// Series of plots with the same noise and the same motion model: rows of `steps` plots, nan where
/// there is none, and the intervals before each plot but the first, or one interval for all.
#[derive(Clone, Copy, Debug)]
pub struct Recording<'a> {
    /// Plots, one row of `steps` numbers per series.
    pub z: &'a [f64],
    /// Number of steps of each series.
    pub steps: usize,
    /// Intervals between plots.
    pub dt: Table<'a>,
    /// Period at which the plots wrap.
    pub period: Option<f64>,
}

/// A limit of the parameters at which the likelihood is largest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Limit {
    /// α is infinite: only the density is determined.
    WhiteAcceleration,
    /// α is 0.
    ConstantAcceleration,
    /// There is no acceleration: σ_a is 0.
    ConstantRate,
    /// The noise is negligible compared with the motion.
    NoNoise,
}

impl Limit {
    /// Returns the name of the limit in words.
    pub fn name(self) -> &'static str {
        match self {
            Self::WhiteAcceleration => "white acceleration",
            Self::ConstantAcceleration => "constant acceleration",
            Self::ConstantRate => "constant rate",
            Self::NoNoise => "no noise",
        }
    }
}
