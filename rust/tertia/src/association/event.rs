//! A joint event: what each row has, and its gain.

/// The column of each row, and the sum of the gains.
#[derive(Clone, Debug, PartialEq)]
pub struct Event {
    /// Sum of the gains against 'none has a column'.
    pub gain: f64,
    /// The column of each row.
    pub columns: Vec<Option<u32>>,
}

/// Two rows that may not have been resolved, `first < second`. Gains are those against two rows without
/// columns that are always resolved.
#[derive(Clone, Debug, PartialEq)]
pub struct Unresolved {
    /// A row.
    pub first: u32,
    /// A later row.
    pub second: u32,
    /// Gain of having been resolved.
    pub resolved: f64,
    /// Gain where neither has a column.
    pub missed: f64,
    /// Columns that may be of both, and their gains.
    pub shared: Vec<(u32, f64)>,
}

/// What is looked for.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Events at most.
    pub count: usize,
    /// How much less than that of the best the gain may be.
    pub cut: f64,
}

/// Sorts events, best first; of equal ones first that of the first columns.
pub(super) fn sort(events: &mut [Event]) {
    let order = |column: &Option<u32>| column.map_or(u32::MAX, |column| column);
    events.sort_by(|a, b| {
        let columns = || a.columns.iter().map(order).cmp(b.columns.iter().map(order));
        b.gain.total_cmp(&a.gain).then_with(columns)
    });
}
