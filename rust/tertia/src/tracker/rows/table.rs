//! A table of tracks, stored by columns and filled while the tracker runs, so that nothing is
//! copied in the end.

use super::columns::{COLUMNS, Column, Values};
use super::row::{Resumed, Row, Rows};
use crate::base::batch::for_each_row;
use std::collections::BTreeMap;
use std::num::NonZero;
use std::ops::{Range, RangeInclusive};

/// Number of rows that are read column by column while they are in the cache.
const AT_ONCE: usize = 64;
/// Computing time per number when rows of tracks that were never confirmed are removed, ns.
const KEEP_NS: f64 = 1.0;

/// The values of a column, row after row.
#[derive(Clone, Debug, PartialEq)]
pub enum Data {
    /// Numbers, several per row if the column is wider than one.
    Numbers(Vec<f64>),
    /// Integers.
    Integers(Vec<i64>),
    /// Flags.
    Flags(Vec<bool>),
}

impl Data {
    /// Removes the rows from index `rows` on; each row has `width` values.
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
    /// The columns; of symmetric matrices only the upper triangle.
    columns: Vec<Data>,
    /// Rows that have not been moved into the columns yet.
    last: Vec<Row>,
    /// Whether rows of tentative tracks are kept as well.
    tentative: bool,
    /// Tracks that were resumed, if rows of tentative tracks are kept.
    resumed: Vec<Resumed>,
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

    fn resume(&mut self, one: Resumed) {
        if self.tentative {
            self.resumed.push(one);
        }
    }
}

impl Table {
    /// A table for rows of confirmed tracks, or of all tracks if `tentative` is set. Room for
    /// `rows` rows is reserved if there is enough memory; room that is not used takes none.
    pub fn new(tentative: bool, rows: usize) -> Self {
        let empty = |column: &Column| match column.values {
            Values::Numbers(_) | Values::Symmetric(_) => {
                Data::Numbers(room(rows * column.stored()))
            }
            Values::Integers(_) | Values::Callsigns(_) => Data::Integers(room(rows)),
            Values::Flags(_) => Data::Flags(room(rows)),
        };
        let columns = COLUMNS.iter().map(empty).collect();
        Self { columns, last: Vec::new(), tentative, resumed: Vec::new() }
    }

    /// A table that contains all columns and resumed tracks as [`Table::into_columns`] returns
    /// them; later rows of tentative tracks are kept only if `tentative` is set.
    pub fn of((columns, resumed): (Vec<Data>, Vec<Resumed>), tentative: bool) -> Self {
        Self { columns, last: Vec::new(), tentative, resumed }
    }

    /// Removes the rows from index `rows` on.
    pub fn truncate(&mut self, rows: usize) {
        self.flush();
        if rows == 0 {
            self.resumed.clear();
        }
        for (data, column) in self.columns.iter_mut().zip(&COLUMNS) {
            data.truncate(rows, column.stored());
        }
    }

    /// Moves the last rows into the columns.
    fn flush(&mut self) {
        for (data, column) in self.columns.iter_mut().zip(&COLUMNS) {
            match (data, column.values) {
                (Data::Numbers(kept), Values::Numbers(write) | Values::Symmetric(write)) => {
                    let (before, width) = (kept.len(), column.stored());
                    kept.resize(before + width * self.last.len(), 0.0);
                    let rooms = kept[before..].chunks_exact_mut(width);
                    self.last.iter().zip(rooms).for_each(|(row, room)| write(row, room));
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

    /// Removes the rows of tracks that were never confirmed. Rows and plots of tracks that were
    /// resumed get the number of the older track. Cost O(rows log(tracks that were resumed)).
    pub fn keep_confirmed(&mut self, track_of_plot: &mut [i64], n_threads: Option<NonZero<usize>>) {
        self.flush();
        self.renumber(track_of_plot);
        let (tracks, plots) = (self.integers("track"), self.integers("plot"));
        let (Data::Numbers(times), Data::Flags(flags)) = (self.get("time"), self.get("confirmed"))
        else {
            unreachable!("times are numbers")
        };
        let first = tracks.iter().copied().min().unwrap_or(0);
        let place = |track: i64| (track - first) as usize;
        let count = tracks.iter().copied().max().map_or(0, |last| place(last) + 1);
        let mut confirmed = vec![false; count];
        for (&track, _) in tracks.iter().zip(flags).filter(|(_, flag)| **flag) {
            confirmed[place(track)] = true;
        }
        let rows = tracks.len();
        let replaced = Replaced::of(&self.resumed);
        let is_kept = |row: usize| {
            let (track, time) = (tracks[row], times[row]);
            confirmed[place(track)] && !(plots[row] < 0 && replaced.contain(track, time))
        };
        let kept = runs((0..rows).map(is_kept));
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

    /// Gives rows and plots of tracks that were resumed the number of the older track.
    fn renumber(&mut self, track_of_plot: &mut [i64]) {
        if self.resumed.is_empty() {
            return;
        }
        let old: BTreeMap<i64, i64> = self.resumed.iter().map(|one| (one.new, one.old)).collect();
        let Data::Integers(tracks) = &mut self.columns[place("track")] else {
            unreachable!("numbers of tracks are integers")
        };
        for track in tracks.iter_mut().chain(track_of_plot) {
            *track = old.get(track).copied().unwrap_or(*track);
        }
    }

    fn get(&self, name: &str) -> &Data {
        &self.columns[place(name)]
    }

    fn integers(&self, name: &str) -> &[i64] {
        match self.get(name) {
            Data::Integers(values) => values,
            _ => unreachable!("the column has integers"),
        }
    }

    /// Returns the columns, of symmetric matrices only the upper triangle, which
    /// [`Column::completed`] completes, and the tracks that were resumed.
    pub fn into_columns(mut self) -> (Vec<Data>, Vec<Resumed>) {
        self.flush();
        (self.columns, self.resumed)
    }
}

/// Index of the column of this name.
fn place(name: &str) -> usize {
    COLUMNS.iter().position(|column| column.name == name).expect("there is such a column")
}

/// Times at which tracks have plots of the new tracks that continue them, from the first one to the
/// confirmation: rows without a plot at these times are missed detections of a wrong prediction.
struct Replaced(BTreeMap<i64, Vec<RangeInclusive<f64>>>);

impl Replaced {
    fn of(resumed: &[Resumed]) -> Self {
        let mut times: BTreeMap<i64, Vec<RangeInclusive<f64>>> = BTreeMap::new();
        for one in resumed {
            times.entry(one.old).or_default().push(one.first..=one.last);
        }
        Self(times)
    }

    fn contain(&self, track: i64, time: f64) -> bool {
        self.0.get(&track).is_some_and(|own| own.iter().any(|range| range.contains(&time)))
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

/// An empty vector with room for `values` values, if there is enough memory.
fn room<T>(values: usize) -> Vec<T> {
    let mut room = Vec::new();
    // if there is not, the vector grows as needed
    let _ = room.try_reserve_exact(values);
    room
}

/// The ranges of consecutive rows that are kept.
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

/// Keeps these ranges of rows, of `width` values each.
fn keep<T: Copy>(values: &mut Vec<T>, width: usize, kept: &[Range<usize>]) {
    let mut end = 0;
    for run in kept {
        values.copy_within(run.start * width..run.end * width, end);
        end += width * run.len();
    }
    values.truncate(end);
    values.shrink_to_fit();
}

/// Completes symmetric matrices of this order from their upper triangles.
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
