//! Result of the estimation from a sample.

/// A bearing with its standard deviation, and figures about their quality.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Estimate {
    /// The bearing.
    pub value: f64,
    /// Standard deviation of the bearing.
    pub sigma: f64,
    /// Polarity `(N₊ − N₋)/N` of the outliers.
    pub polarity: f64,
    /// p-value of the agreement of the blocks; nan if they cannot be compared.
    pub pvalue: f64,
    /// Correlation of successive measurements, given or estimated.
    pub correlation: f64,
    /// Number of independent measurements with the same information.
    pub effective_number: f64,
    /// Standard deviation of the systematic errors of groups, given or estimated; nan if they are not
    /// included.
    pub bias_sigma: f64,
    /// Estimated noise divided by the stated noise, at least 1; nan if no noise is stated.
    pub noise_factor: f64,
}
