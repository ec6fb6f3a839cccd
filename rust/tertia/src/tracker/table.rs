//! A table of tracks, column by column, filled while the tracker runs: nothing is copied in the end.

use super::columns::{COLUMNS, Column, Values};
use super::row::{Row, Rows};
use crate::base::batch::for_each_row;
use std::num::NonZero;
use std::ops::Range;

/// Rows that are read column by column while they are in the cache.
const AT_ONCE: usize = 64;
/// Numbers of the widest column.
const WIDEST: usize = 10;
/// Cost of leaving out the others of so many numbers, each.
const KEEP_NS: f64 = 1.0;

/// The values of a column, row after row.
#[derive(Clone, Debug, PartialEq)]
pub enum Data {
    /// Numbers, as many in a row as the column is wide.
    Numbers(Vec<f64>),
    /// Integers.
    Integers(Vec<i64>),
    /// Flags.
    Flags(Vec<bool>),
}

impl Data {
    /// Leaves out the values of the rows from this one on, of so many each.
    fn truncate(&mut self, rows: usize, width: usize) {
        match self {
            Self::Numbers(values) => values.truncate(rows * width),
            Self::Integers(values) => values.truncate(rows),
            Self::Flags(values) => values.truncate(rows),
        }
    }
}

/// The rows of a scan or of a recording.
#[derive(Clone, Debug)]
pub struct Table {
    /// Symmetric matrices without what is below the diagonal.
    columns: Vec<Data>,
    /// Rows that are not in the columns yet.
    last: Vec<Row>,
    /// Whether rows of tracks that are not confirmed yet are kept as well.
    tentative: bool,
}

impl Rows for Table {
    fn wants(&self, confirmed: bool) -> bool {
        self.tentative || confirmed
    }

    fn push(&mut self, row: &Row) {
        self.last.push(*row);
        if self.last.len() == AT_ONCE {
            self.flush();
        }
    }
}

impl Table {
    /// A table for rows of confirmed tracks, or of all, with room for so many, as far as there is that
    /// much memory: what is not used of it takes none.
    pub fn new(tentative: bool, rows: usize) -> Self {
        let empty = |column: &Column| match column.values {
            Values::Numbers(_) | Values::Symmetric(_) => {
                Data::Numbers(room(rows * column.stored()))
            }
            Values::Integers(_) | Values::Callsigns(_) => Data::Integers(room(rows)),
            Values::Flags(_) => Data::Flags(room(rows)),
        };
        let columns = COLUMNS.iter().map(empty).collect();
        Self { columns, last: Vec::new(), tentative }
    }

    /// Of all columns, as [`Table::into_columns`] returns them, for more rows of confirmed tracks or of all.
    pub fn of(columns: Vec<Data>, tentative: bool) -> Self {
        Self { columns, last: Vec::new(), tentative }
    }

    /// Leaves out the rows from this one on.
    pub fn truncate(&mut self, rows: usize) {
        self.flush();
        for (data, column) in self.columns.iter_mut().zip(&COLUMNS) {
            data.truncate(rows, column.stored());
        }
    }

    /// Moves the last rows into the columns.
    fn flush(&mut self) {
        for (data, column) in self.columns.iter_mut().zip(&COLUMNS) {
            match (data, column.values) {
                (Data::Numbers(kept), Values::Numbers(write) | Values::Symmetric(write)) => {
                    let mut room = [0.0; WIDEST];
                    let room = &mut room[..column.stored()];
                    for row in &self.last {
                        write(row, room);
                        kept.extend_from_slice(room);
                    }
                }
                (Data::Integers(kept), Values::Integers(read) | Values::Callsigns(read)) => {
                    kept.extend(self.last.iter().map(read));
                }
                (Data::Flags(kept), Values::Flags(read)) => {
                    kept.extend(self.last.iter().map(read));
                }
                _ => unreachable!("a column keeps its type"),
            }
        }
        self.last.clear();
    }

    /// Leaves out the rows of tracks that were never confirmed. Cost O(rows).
    pub fn keep_confirmed(&mut self, n_threads: Option<NonZero<usize>>) {
        self.flush();
        let column = |name| COLUMNS.iter().position(|column| column.name == name).expect("it is");
        let (tracks, flags) = (column("track"), column("confirmed"));
        let (Data::Integers(tracks), Data::Flags(flags)) =
            (&self.columns[tracks], &self.columns[flags])
        else {
            unreachable!("numbers of tracks are integers")
        };
        let first = tracks.iter().copied().min().unwrap_or(0);
        let place = |track: i64| (track - first) as usize;
        let count = tracks.iter().copied().max().map_or(0, |last| place(last) + 1);
        let mut confirmed = vec![false; count];
        for (&track, _) in tracks.iter().zip(flags).filter(|(_, flag)| **flag) {
            confirmed[place(track)] = true;
        }
        let rows = tracks.len();
        let kept = runs(tracks.iter().map(|&track| confirmed[place(track)]));
        let numbers: usize = COLUMNS.iter().map(|column| column.stored()).sum();
        let nanoseconds = KEEP_NS * (numbers * rows) as f64;
        let columns = self.columns.iter_mut().zip(&COLUMNS);
        let done = for_each_row(
            columns,
            nanoseconds,
            n_threads,
            || (),
            |(), (data, column)| {
                match data {
                    Data::Numbers(values) => keep(values, column.stored(), &kept),
                    Data::Integers(values) => keep(values, 1, &kept),
                    Data::Flags(values) => keep(values, 1, &kept),
                }
                Ok(())
            },
        );
        done.expect("nothing fails");
    }

    /// The columns, symmetric matrices without what is below the diagonal:
    /// [`Column::completed`] adds it.
    pub fn into_columns(mut self) -> Vec<Data> {
        self.flush();
        self.columns
    }
}

impl Column {
    /// The values with symmetric matrices completed.
    pub fn completed(&self, data: Data) -> Data {
        match (data, self.values) {
            (Data::Numbers(upper), Values::Symmetric(_)) => {
                Data::Numbers(completed(&upper, self.shape[0]))
            }
            (data, _) => data,
        }
    }
}

/// Room for so many values, if there is.
fn room<T>(values: usize) -> Vec<T> {
    let mut room = Vec::new();
    // without it, the room grows as it is needed
    let _ = room.try_reserve_exact(values);
    room
}

/// The ranges of successive rows that are kept.
fn runs(kept: impl Iterator<Item = bool>) -> Vec<Range<usize>> {
    let mut runs: Vec<Range<usize>> = Vec::new();
    for (row, _) in kept.enumerate().filter(|(_, kept)| *kept) {
        match runs.last_mut().filter(|run| run.end == row) {
            Some(run) => run.end += 1,
            None => runs.push(row..row + 1),
        }
    }
    runs
}

/// Keeps some of the rows, of so many values each.
fn keep<T: Copy>(values: &mut Vec<T>, width: usize, kept: &[Range<usize>]) {
    let mut end = 0;
    for run in kept {
        values.copy_within(run.start * width..run.end * width, end);
        end += width * run.len();
    }
    values.truncate(end);
    values.shrink_to_fit();
}

/// Symmetric matrices of this order, from their upper halves.
fn completed(upper: &[f64], order: usize) -> Vec<f64> {
    let half = order * (order + 1) / 2;
    let mut whole = Vec::with_capacity(upper.len() / half * order * order);
    for upper in upper.chunks_exact(half) {
        for i in 0..order {
            whole.extend((0..order).map(|j| {
                let (i, j) = (i.min(j), i.max(j));
                upper[i * order + j - i * (i + 1) / 2]
            }));
        }
    }
    whole
}
