//! Limits of multiple-hypothesis tracking, with joint hypotheses of which plot belongs to which track (Reid
//! 1979; Blackman 2004).
//!
//! A track whose plots are certain has one state, as without hypotheses. Otherwise it has a tree: the state
//! that is shown, and the other states that it would have with other plots. Tracks that compete for plots are
//! members of a cluster: each of its hypotheses consists of one state of each member and a probability.
//! Hypotheses share states: K of them need no more than K states of a track.

use crate::base::error::{Result, require};
use serde::{Deserialize, Serialize};

/// How many hypotheses are kept, and for how long.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Mht {
    /// Largest number of hypotheses of tracks that compete.
    pub max_hypotheses: usize,
    /// Scans after which a choice is final.
    pub scans: usize,
    /// Logarithm of the largest ratio of the probability of the best hypothesis to that of another one that
    /// is kept.
    pub cut: f64,
}

impl Default for Mht {
    fn default() -> Self {
        Self { max_hypotheses: 32, scans: 15, cut: 7.0 }
    }
}

impl Mht {
    /// One hypothesis: the best joint event of each scan.
    pub(in crate::tracker) const SINGLE: Self = Self { max_hypotheses: 1, scans: 1, cut: 0.0 };

    /// # Errors
    /// A number outside its domain.
    pub(in crate::tracker) fn check(&self) -> Result<()> {
        let Self { max_hypotheses, scans, cut } = *self;
        let hypotheses = max_hypotheses as f64;
        require("max_hypotheses", hypotheses, max_hypotheses > 0, "1 or more")?;
        require("scans", scans as f64, scans > 0, "1 or more")?;
        require("cut", cut, cut >= 0.0 && cut.is_finite(), "0 or a positive number")
    }
}
