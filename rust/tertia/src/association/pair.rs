//! Pairs of a row and a column that may be assigned to each other.

/// A row and a column that may be assigned to each other, with the gain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pair {
    /// Index of the row.
    pub row: u32,
    /// Index of the column.
    pub column: u32,
    /// Gain of the assignment; a pair without a positive, finite gain is ignored.
    pub gain: f64,
}

impl Pair {
    /// Whether the pair is considered.
    pub(super) fn counts(&self) -> bool {
        self.gain > 0.0 && self.gain.is_finite()
    }
}
