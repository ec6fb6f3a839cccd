//! Bindings of `tertia::fusion`.

mod estimates;
mod live;
mod series;

pub use estimates::{fuse, fuse_scalar};
pub use live::AngleFusion;
pub use series::fuse_series;

use crate::screening::unknown;
use pyo3::prelude::*;
use tertia::fusion::Rule;

const VARIANCE: &str = "measurement_variance";
/// What it must be.
const POSITIVE: &str = "it must be a positive number from 1e-100 to 1e100";

fn rule(name: &str) -> PyResult<Rule> {
    Ok(match name {
        "equal" => Rule::Equal,
        "static" => Rule::Static,
        "paper" => Rule::Paper,
        "ewma" => Rule::Ewma,
        "posterior" => Rule::Posterior,
        "adaptive" => Rule::Adaptive,
        "adaptive-matrix" => Rule::AdaptiveMatrix,
        "matrix" => Rule::Matrix,
        "covariance-intersection" => Rule::CovarianceIntersection,
        "central" => Rule::Central,
        "robust" => Rule::Robust,
        other => {
            let choices = "'robust', 'adaptive', 'adaptive-matrix', 'central', 'posterior', 'matrix', \
                           'covariance-intersection', 'ewma', 'static', 'equal' or 'paper'";
            return Err(unknown("method", other, choices));
        }
    })
}
