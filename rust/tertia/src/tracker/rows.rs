//! Results: rows of tracks, and tables of them.

pub(super) mod columns;
pub(super) mod row;
pub(super) mod table;
