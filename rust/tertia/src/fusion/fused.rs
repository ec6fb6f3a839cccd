//! What is fused, how, and what comes of it.

/// How estimates are weighed.
#[derive(Clone, Debug, PartialEq)]
pub enum Weighting {
    /// Equal weights.
    Equal,
    /// In proportion to these numbers, one for each sensor.
    Static(Vec<f64>),
    /// Component by component by the inverse variances.
    Posterior,
    /// Component by component by 1/Y² of the corrections (1) to (13).
    Paper,
    /// The best linear combination.
    Matrix,
    /// The best linear combination where systematic errors are found from contradictions.
    RandomEffects,
    /// Covariance intersection, which needs no correlations.
    Intersection,
}

/// Estimates (K, m) of one vector, nan throughout where a sensor has none, and their covariances
/// (K, m, m); those between sensors (K, K, m, m), whose diagonal blocks are not read, or none for
/// independent errors. What belongs to a sensor without an estimate is not read.
#[derive(Clone, Copy, Debug)]
pub struct Estimates<'a> {
    /// x_k.
    pub values: &'a [f64],
    /// S_k.
    pub covariances: &'a [f64],
    /// S_jk.
    pub cross: Option<&'a [f64]>,
    /// Y_k (K, m), by which the last measurements moved the estimates; read by the paper's rule only,
    /// which cannot do without. Where all are zero, weights are equal.
    pub corrections: Option<&'a [f64]>,
}

/// Where a fused estimate goes.
#[derive(Debug)]
pub struct FusedEstimate<'a> {
    /// x̂ (m).
    pub mean: &'a mut [f64],
    /// Its covariance (m, m), or the bound of it.
    pub covariance: &'a mut [f64],
    /// W_k (K, m, m), or the gain of a scalar (m).
    pub weights: &'a mut [f64],
    /// Standard deviation of the systematic errors that were found (m); 0 where none are sought.
    pub bias_sigma: &'a mut [f64],
}

/// Whether estimates agree within their covariances.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Agreement {
    /// `Δ^T cov(Δ)^-1 Δ` of all differences Δ; nan where the rule does not find it.
    pub statistic: f64,
    /// Probability of a larger one where the covariances are right; nan likewise.
    pub pvalue: f64,
    /// Of the chi-square distribution that the statistic has where the covariances are right.
    pub degrees_of_freedom: usize,
}

impl Agreement {
    /// Without a statistic.
    pub(super) const UNKNOWN: Self =
        Self { statistic: f64::NAN, degrees_of_freedom: 0, pvalue: f64::NAN };
}
