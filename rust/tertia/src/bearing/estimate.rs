//! What is estimated of a sample.

/// A bearing, its standard deviation, and what they rest on.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Estimate {
    /// The bearing.
    pub value: f64,
    /// Its standard deviation.
    pub sigma: f64,
    /// `(N₊ − N₋)/N` over the outliers.
    pub polarity: f64,
    /// p-value of the agreement of the blocks; nan where nothing can tell.
    pub pvalue: f64,
    /// Correlation of successive measurements, given or found.
    pub correlation: f64,
    /// Independent measurements that would be worth as much.
    pub effective_number: f64,
    /// Standard deviation of the systematic errors of groups, given or found; nan: not included.
    pub bias_sigma: f64,
    /// Noise over what is stated, at least 1; nan: nothing is stated.
    pub noise_factor: f64,
}
