//! Foundations of all concepts: errors, small matrices, moments, distributions, angles, vectors, orthogonal
//! polynomials, random effects, correlated and 1/f noise, rows on several threads, interruption of calls.
//!
//! `interrupt, error <- matrix, moments, distribution, angle, vector, exponential, plane, missing, mixed,
//! basis, batch <- effects, autoregression, slow_noise`

// indices are written as in the formulas
#![allow(clippy::needless_range_loop)]

pub(crate) mod angle;
pub(crate) mod autoregression;
pub(crate) mod basis;
pub mod batch;
#[cfg(test)]
pub(crate) mod checks;
pub(crate) mod distribution;
pub(crate) mod effects;
pub(crate) mod error;
pub(crate) mod exponential;
pub mod interrupt;
pub(crate) mod matrix;
pub mod missing;
pub(crate) mod mixed;
pub(crate) mod moments;
pub(crate) mod plane;
#[cfg(test)]
pub(crate) mod random;
pub(crate) mod scratch;
pub(crate) mod skyline;
pub(crate) mod slow_noise;
pub(crate) mod small;
pub(crate) mod state;
pub(crate) mod vector;
