//! A row and a column that compete.

/// A row and a column that may be assigned to each other, and the gain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pair {
    /// Index of the row.
    pub row: u32,
    /// Index of the column.
    pub column: u32,
    /// The gain; a pair without a positive, finite gain is ignored.
    pub gain: f64,
}

impl Pair {
    /// Whether it is to be considered.
    pub(super) fn counts(&self) -> bool {
        self.gain > 0.0 && self.gain.is_finite()
    }
}
