//! When each radar should see a target next.

use serde::{Deserialize, Serialize};

/// When a radar should see a target next.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Expected {
    pub radar: usize,
    pub time: f64,
    /// Time of the last plot.
    pub seen: f64,
}

/// Number of radars for which there is room in the track itself.
const FEW: usize = 4;

/// When each radar should see a target next.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Beams {
    few: [Expected; FEW],
    count: usize,
    /// All radars, if there are more than a few.
    many: Vec<Expected>,
}

impl Beams {
    #[inline]
    pub fn all(&self) -> &[Expected] {
        if self.count <= FEW { &self.few[..self.count] } else { &self.many }
    }

    #[inline]
    pub fn all_mut(&mut self) -> &mut [Expected] {
        if self.count <= FEW { &mut self.few[..self.count] } else { &mut self.many }
    }

    pub fn push(&mut self, expected: Expected) {
        if self.count < FEW {
            self.few[self.count] = expected;
        } else {
            if self.count == FEW {
                self.many.extend_from_slice(&self.few);
            }
            self.many.push(expected);
        }
        self.count += 1;
    }
}
