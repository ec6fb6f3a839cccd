//! Limits of several joint hypotheses of which plot is whose (Reid 1979; Blackman 2004).
//!
//! A track whose plots are certain has one state, as without hypotheses. Otherwise it has a tree: the
//! state that is shown, and others that it would have by other plots. Tracks that compete for plots are
//! members of a cluster: its hypotheses say which state of each member they hold, and how likely they
//! are. Hypotheses share states: K of them need no more than K states of a track.

use crate::base::error::{Result, require};
use serde::{Deserialize, Serialize};

/// How many hypotheses are kept, and for how long.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Mht {
    /// Hypotheses of tracks that compete, at most.
    pub max_hypotheses: usize,
    /// Scans after which a choice is final.
    pub scans: usize,
    /// How much less likely than the best a hypothesis may be: logarithm of the ratio.
    pub cut: f64,
}

impl Default for Mht {
    fn default() -> Self {
        Self { max_hypotheses: 32, scans: 15, cut: 7.0 }
    }
}

impl Mht {
    /// One hypothesis: the best joint event of each scan.
    pub(super) const SINGLE: Self = Self { max_hypotheses: 1, scans: 1, cut: 0.0 };

    /// # Errors
    /// A number outside its domain.
    pub(super) fn check(&self) -> Result<()> {
        let Self { max_hypotheses, scans, cut } = *self;
        let hypotheses = max_hypotheses as f64;
        require("max_hypotheses", hypotheses, max_hypotheses > 0, "1 or more")?;
        require("scans", scans as f64, scans > 0, "1 or more")?;
        require("cut", cut, cut >= 0.0 && cut.is_finite(), "0 or a positive number")
    }
}
