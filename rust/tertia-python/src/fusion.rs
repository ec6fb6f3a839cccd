//! Bindings of `tertia::fusion`.

mod estimates;
mod live;
mod series;

pub use estimates::{fuse, fuse_scalar};
pub use live::AngleFusion;
pub use series::{fuse_series, series_biases};

use crate::arrays::{choice, room_for};
use pyo3::prelude::*;
use tertia::fusion::Rule;

const VARIANCE: &str = "measurement_variance";
/// Requirement for variances.
const POSITIVE: &str = "it must be a positive number from 1e-100 to 1e100";

/// Number of matrices that the kernels keep for every pair of sensors.
const MATRICES: usize = 4;
/// Number of elements of a matrix of angle, rate and acceleration.
const ELEMENTS: usize = 9;

/// Returns an error unless there is memory for the matrices of all pairs of radars.
fn require_room(radars: usize) -> PyResult<()> {
    let pairs = radars.saturating_mul(radars);
    room_for::<f64>(pairs.saturating_mul(MATRICES * ELEMENTS)).map(|_| ())
}

fn rule(name: &str) -> PyResult<Rule> {
    let choices = [
        ("robust", Rule::Robust),
        ("adaptive", Rule::Adaptive),
        ("adaptive-matrix", Rule::AdaptiveMatrix),
        ("central", Rule::Central),
        ("posterior", Rule::Posterior),
        ("matrix", Rule::Matrix),
        ("covariance-intersection", Rule::CovarianceIntersection),
        ("ewma", Rule::Ewma),
        ("static", Rule::Static),
        ("equal", Rule::Equal),
        ("paper", Rule::Paper),
    ];
    choice("method", name, &choices)
}
