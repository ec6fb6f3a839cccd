//! What is known of errors that last before anything is measured.

use super::measured::Record;
use crate::sensors::KINDS;

/// What is assumed of the lasting errors.
#[derive(Clone, Debug)]
pub struct Prior {
    /// Standard deviations, 5 K numbers: 0 of what is trusted, nan of what is to be found.
    pub sigma: Vec<f64>,
    /// Shares of their variance that drift, and the correlation times (5 K); nan: to be found.
    pub share: Vec<f64>,
    /// See `share`.
    pub time: Vec<f64>,
    /// Standard deviations of the azimuths that depend on the direction (N, K); none: 0.
    pub deviation: Option<Vec<f64>>,
}

impl Prior {
    /// Numbers of an instant that may have lasting errors, of what was measured.
    pub(super) fn columns(&self, record: &Record<'_>) -> Vec<usize> {
        let width = record.width();
        let seen = |at: &usize| record.values.iter().skip(*at).step_by(width).any(|v| !v.is_nan());
        let reference = record.reference();
        let differences = record.common_variance() > 0.0
            && (reference..reference + width / KINDS).any(|at| seen(&at));
        (0..width)
            .filter(|at| self.sigma[*at] != 0.0)
            .filter(|at| seen(at) || (differences && *at == reference))
            .collect()
    }
}

/// What is assumed of the systematic errors.
#[derive(Clone, Debug)]
pub enum Systematic {
    /// Nothing is known of constant biases of these kinds, in the order of an instant's rows; of the
    /// others there are none.
    Flat(Vec<usize>),
    /// Errors that last, of which something is known, or can be found.
    Lasting(Prior),
}

impl Systematic {
    /// Whether a number of an instant has no systematic error, of so many stations.
    pub(super) fn is_trusted(&self, column: usize, k: usize) -> bool {
        match self {
            Self::Flat(kinds) => !kinds.contains(&(column / k)),
            Self::Lasting(prior) => prior.sigma[column] == 0.0,
        }
    }
}
