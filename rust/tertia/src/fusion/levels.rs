//! Noise levels of the robust rule, for the plots of a radar and for the prediction.

/// Noise variances of a radar relative to the stated one.
pub(super) const NOISE: [f64; 5] = [0.25, 1.0, 4.0, 16.0, 64.0];
/// Noise variances of a plot: those of its radar, and those of a single outlier, which may be anywhere.
pub(super) const EXCESSES: [f64; NOISE.len() + OUTLIERS.len()] =
    [0.25, 1.0, 4.0, 16.0, 64.0, 256.0, 65_536.0];
/// Shares of the outliers that have each of these variances.
pub(super) const OUTLIERS: [f64; 2] = [0.875, 0.125];
/// Variances of the prediction relative to that of the filter.
pub(super) const MANOEUVRES: [f64; 2] = [1.0, 64.0];
