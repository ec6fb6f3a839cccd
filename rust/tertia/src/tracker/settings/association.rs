//! Methods by which plots are assigned to tracks.

use super::mht::Mht;
use crate::association::score;
use crate::base::error::Result;
use crate::base::plane::Plane;
use crate::tracker::motion::estimate::Estimate;
use serde::{Deserialize, Serialize};

/// The method by which plots are assigned to tracks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub enum Association {
    /// The largest likelihood ratio against false plots (global nearest neighbour).
    #[default]
    Gnn,
    /// The score of the source (Glagovskiy, Lavina, Rudelson 2014) with this ratio Q. It depends neither on
    /// the size of covariances nor on the density of false plots, and M plots within N scans confirm a track,
    /// however unlikely.
    Paper(f64),
    /// As `Gnn`, but with several hypotheses if an assignment is uncertain (multiple-hypothesis tracking).
    Mht(Mht),
}

impl Association {
    /// # Errors
    /// A ratio that is not above 1.
    pub(in crate::tracker) fn check(self) -> Result<()> {
        match self {
            Self::Gnn => Ok(()),
            Self::Mht(limits) => limits.check(),
            Self::Paper(q) => score::paper(0.0, q, 2).map(|_| ()),
        }
    }
}

/// The score of the source, minus its value at the gate, for a plot at `z` with the covariance `r`:
/// `½ (1 − 1/Q) (gate − d²)`; none outside the gate.
pub(in crate::tracker) fn paper_score(
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
