//! How many plots of targets with a known identity have none.

use serde::{Deserialize, Serialize};

/// Number of plots over which the share of those without an identity is taken, number of such plots that are
/// assumed at first, and least share.
const REMEMBERED: f64 = 2000.0;
const AT_FIRST: f64 = 4.0;
const LEAST_SHARE: f64 = 0.01;

/// How many plots of targets with a known identity have none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Unidentified {
    plots: f64,
    count: f64,
}

impl Unidentified {
    pub fn saw(&mut self, is_one: bool) {
        self.plots = (1.0 - 1.0 / REMEMBERED) * self.plots + 1.0;
        self.count = (1.0 - 1.0 / REMEMBERED) * self.count + f64::from(u8::from(is_one));
    }

    /// Their share.
    pub fn share(&self) -> f64 {
        ((self.count + AT_FIRST) / (self.plots + AT_FIRST)).max(LEAST_SHARE)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_within;

    #[test]
    fn few_plots_of_targets_that_reply_have_no_identity() {
        let mut found = Unidentified::default();
        assert_eq!(found.share(), 1.0);
        (0..10_000).for_each(|plot| found.saw(plot % 20 == 0));
        assert_within(0.05, found.share(), 0.05);
        (0..20_000).for_each(|_| found.saw(false));
        assert_eq!(found.share(), LEAST_SHARE);
    }
}
