//! Weight matrices for several estimates of the same vector, and the cost of estimating them.
//!
//! Source: Kulyavets et al. 2005, equations (1) to (14), for K ≥ 2 sensors. `S_k` is the covariance
//! of sensor k's estimate, `C_k = S_k^-1`, `S_p = (Σ C_k)^-1` the fused covariance and
//! `W_k = S_p C_k`; vec stacks columns. Matrices are passed row by row, those of several sensors
//! one after the other.

mod convention;
mod group;
mod loss;
mod propagation;
mod solver;

pub use convention::{
    Convention, Law, least_count, require_degrees_of_freedom, simulated_factor, student_factor,
};
pub(crate) use group::{Group, Sum};
pub use solver::{Quantity, Weighing, weighing};

pub(crate) const COVARIANCES: &str = "covariances";
