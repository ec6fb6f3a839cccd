//! Input of a fusion, its weighting, and its result.

/// How estimates are weighted.
#[derive(Clone, Debug, PartialEq)]
pub enum Weighting {
    /// Equal weights.
    Equal,
    /// In proportion to these numbers, one for each sensor.
    Static(Vec<f64>),
    /// Component by component with the inverse variances.
    Posterior,
    /// Component by component with 1/Y², where Y are the corrections (1) to (13).
    Paper,
    /// The best linear combination.
    Matrix,
    /// The best linear combination with systematic errors that are estimated from contradictions.
    RandomEffects,
    /// Covariance intersection, which does not require the correlations.
    Intersection,
}

/// Estimates (K, m) of one vector, with nan in all components if a sensor has no estimate, and their
/// covariances (K, m, m). Cross covariances between sensors (K, K, m, m) are optional; without them errors
/// are independent. The diagonal blocks of the cross covariances are not read, and neither are any other
/// data of a sensor without an estimate.
#[derive(Clone, Copy, Debug)]
pub struct Estimates<'a> {
    /// x_k.
    pub values: &'a [f64],
    /// S_k.
    pub covariances: &'a [f64],
    /// S_jk.
    pub cross: Option<&'a [f64]>,
    /// Y_k (K, m): corrections of the estimates by the last measurements. Only the rule of the paper reads
    /// and requires them. If all are zero, the weights are equal.
    pub corrections: Option<&'a [f64]>,
}

/// Output of a fusion.
#[derive(Debug)]
pub struct FusedEstimate<'a> {
    /// x̂ (m).
    pub mean: &'a mut [f64],
    /// Covariance of x̂ (m, m), or its bound.
    pub covariance: &'a mut [f64],
    /// W_k (K, m, m), or the gain of a scalar (m).
    pub weights: &'a mut [f64],
    /// Standard deviation of the estimated systematic errors (m); 0 if the rule does not estimate them.
    pub bias_sigma: &'a mut [f64],
}

/// Test whether estimates agree within their covariances.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Agreement {
    /// `Δ^T cov(Δ)^-1 Δ` of all differences Δ; nan if the rule does not compute it.
    pub statistic: f64,
    /// Probability of a larger statistic if the covariances are correct; nan if there is no statistic.
    pub pvalue: f64,
    /// Degrees of freedom of the chi-square distribution of the statistic if the covariances are correct.
    pub degrees_of_freedom: usize,
}

impl Agreement {
    /// Agreement without a statistic.
    pub(super) const UNKNOWN: Self =
        Self { statistic: f64::NAN, degrees_of_freedom: 0, pvalue: f64::NAN };
}
