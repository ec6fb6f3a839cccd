//! The levels that the robust rule knows, of a radar's noise and of the prediction's.

/// Noise variances of a radar over what it states.
pub(super) const NOISE: [f64; 5] = [0.25, 1.0, 4.0, 16.0, 64.0];
/// Those of a plot: its radar's, and a single outlier's.
pub(super) const EXCESSES: [f64; NOISE.len() + 1] = [0.25, 1.0, 4.0, 16.0, 64.0, 256.0];
/// Variances of the prediction over what the filter says.
pub(super) const MANOEUVRES: [f64; 2] = [1.0, 64.0];
