//! The identity of a target by the replies of its transponder, single ones of which may be wrong.

use serde::{Deserialize, Serialize};

/// Equal replies in a row after which a track has another identity.
const CHANGED_AFTER: u8 = 3;

/// The identity of a target.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Identity {
    pub code: i64,
    /// Whether it was received at least twice.
    pub is_sure: bool,
    /// A different code, and how often in a row it was received.
    other: i64,
    times: u8,
}

impl Identity {
    pub fn new(code: i64) -> Self {
        Self { code, is_sure: false, other: code, times: 0 }
    }

    /// Processes one more reply; the code changes only after several equal ones.
    pub fn answer(&mut self, code: i64) {
        if code == self.code {
            (self.is_sure, self.times) = (true, 0);
            return;
        }
        self.times = if code == self.other { self.times + 1 } else { 1 };
        self.other = code;
        if self.times >= CHANGED_AFTER {
            *self = Self::new(code);
        }
    }
}
