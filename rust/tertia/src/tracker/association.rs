//! By what plots are given to tracks.

use super::estimate::Estimate;
use super::mht::Mht;
use crate::association::score;
use crate::base::error::Result;
use crate::base::plane::Plane;
use serde::{Deserialize, Serialize};

/// By what plots are given to tracks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub enum Association {
    /// The largest likelihood ratio against false plots (global nearest neighbour).
    #[default]
    Gnn,
    /// The score of the source with this ratio Q: neither the size of covariances nor the density of
    /// false plots counts, and M plots in N scans confirm a track whatever they are.
    Paper(f64),
    /// As the first, with several hypotheses where plots are not certain.
    Mht(Mht),
}

impl Association {
    /// # Errors
    /// A ratio that is not above 1.
    pub(super) fn check(self) -> Result<()> {
        match self {
            Self::Gnn => Ok(()),
            Self::Mht(limits) => limits.check(),
            Self::Paper(q) => score::paper(0.0, q, 2).map(|_| ()),
        }
    }
}

/// The score of the source for a plot at `z` with the covariance `r`, less that at the gate:
/// `½ (1 − 1/Q) (gate − d²)`; none outside the gate.
pub(super) fn paper_score(
    estimate: &Estimate<4>,
    z: [f64; 2],
    r: Plane,
    q: f64,
    gate: f64,
) -> Option<f64> {
    let y = [z[0] - estimate.mean[0], z[1] - estimate.mean[1]];
    let d = estimate.position_covariance().plus(r).inverse().form(y);
    (d <= gate).then(|| 0.5 * (1.0 - 1.0 / q) * (gate - d))
}
