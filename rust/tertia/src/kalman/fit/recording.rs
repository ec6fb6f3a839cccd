//! What is fitted, and the limits of its likelihood.

use super::super::batch::Table;

/// Series of plots that share the noise and the motion: `count` rows of `steps`, nan where there is
/// none, and the intervals before each plot but the first, or one number for all.
#[derive(Clone, Copy, Debug)]
pub struct Recording<'a> {
    /// The plots.
    pub z: &'a [f64],
    /// Of each series.
    pub steps: usize,
    /// The intervals.
    pub dt: Table<'a>,
    /// Wrap of the plots.
    pub period: Option<f64>,
}

/// Where the likelihood is largest at an end of the parameters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Limit {
    /// α is infinite: only the density counts.
    WhiteAcceleration,
    /// α is 0.
    ConstantAcceleration,
    /// There is no acceleration.
    ConstantRate,
    /// Beside the motion the noise is nothing.
    NoNoise,
}

impl Limit {
    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            Self::WhiteAcceleration => "white acceleration",
            Self::ConstantAcceleration => "constant acceleration",
            Self::ConstantRate => "constant rate",
            Self::NoNoise => "no noise",
        }
    }
}
