//! What every concept stands on: errors, small matrices, moments, distributions, angles, vectors,
//! rows on threads.
//!
//! `error <- matrix, moments, distribution, angle, vector, missing, batch`

// indices are those of the formulas
#![allow(clippy::needless_range_loop)]

pub(crate) mod angle;
pub mod batch;
#[cfg(test)]
pub(crate) mod checks;
pub(crate) mod distribution;
pub(crate) mod error;
pub(crate) mod matrix;
pub mod missing;
pub(crate) mod moments;
#[cfg(test)]
pub(crate) mod random;
pub(crate) mod small;
pub(crate) mod vector;
