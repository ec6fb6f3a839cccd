//! Joint events: the column of each row, and the gain.

/// A joint event.
#[derive(Clone, Debug, PartialEq)]
pub struct Event {
    /// Sum of the gains relative to the event in which no row has a column.
    pub gain: f64,
    /// The column of each row.
    pub columns: Vec<Option<u32>>,
}

/// Two rows that the sensor may not have resolved, `first < second`. The reference of the gains is that
/// the rows are resolved with certainty and have no columns.
#[derive(Clone, Debug, PartialEq)]
pub struct Unresolved {
    /// The first row.
    pub first: u32,
    /// The second row.
    pub second: u32,
    /// Gain if the rows were resolved.
    pub resolved: f64,
    /// Gain if neither row has a column.
    pub missed: f64,
    /// Columns that both rows may share, and their gains.
    pub shared: Vec<(u32, f64)>,
}

/// Limits on the events that are returned.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Largest number of events.
    pub count: usize,
    /// Largest difference of the gain from that of the best event.
    pub cut: f64,
}

/// Sorts events, best first; equal gains are sorted by the columns.
pub(super) fn sort(events: &mut [Event]) {
    let order = |column: &Option<u32>| column.map_or(u32::MAX, |column| column);
    events.sort_by(|a, b| {
        let columns = || a.columns.iter().map(order).cmp(b.columns.iter().map(order));
        b.gain.total_cmp(&a.gain).then_with(columns)
    });
}
