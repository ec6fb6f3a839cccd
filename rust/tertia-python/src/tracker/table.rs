//! Rows of tracks as columns.

use crate::arrays::Output;
use pyo3::prelude::*;
use tertia::tracker::{COLUMNS, Column, PlotStatus, Row, Values};

/// Numbers, integers and flags of N rows, in each the columns of `track_columns` one after the
/// other; then the status of each plot.
pub type Table<'py> = (Output<'py>, Output<'py, i64>, Output<'py, bool>, Output<'py, i64>);

/// Rows that are read column by column while they are in the cache.
const AT_ONCE: usize = 64;

/// Name, unit, type, shape and meaning of each column.
#[pyfunction]
pub fn track_columns() -> Vec<(&'static str, &'static str, &'static str, Vec<usize>, &'static str)>
{
    let name = |column| ["float", "int", "bool"][kind(column)];
    COLUMNS.iter().map(|c| (c.name, c.unit, name(c), c.shape.to_vec(), c.doc)).collect()
}

/// Which of the blocks of a table has this column.
fn kind(column: &Column) -> usize {
    match column.values {
        Values::Numbers(_) => 0,
        Values::Integers(_) => 1,
        Values::Flags(_) => 2,
    }
}

pub fn table<'py>(py: Python<'py>, rows: &[Row], statuses: &[PlotStatus]) -> PyResult<Table<'py>> {
    // numbers, integers and flags in a row
    let mut widths = [0; 3];
    for column in &COLUMNS {
        widths[kind(column)] += column.width();
    }
    let n = rows.len();
    let mut numbers = Output::<f64>::new(py, &[widths[0] * n], &[])?;
    let mut integers = Output::<i64>::new(py, &[widths[1] * n], &[])?;
    let mut flags = Output::<bool>::new(py, &[widths[2] * n], &[])?;
    let mut track_of_plot = Output::<i64>::new(py, &[statuses.len()], &[])?;
    let (number, integer, flag) = (numbers.values()?, integers.values()?, flags.values()?);
    for (part, some) in rows.chunks(AT_ONCE).enumerate() {
        let mut before = [0; 3];
        for column in &COLUMNS {
            let width = column.width();
            let first = before[kind(column)] * n + part * AT_ONCE * width;
            before[kind(column)] += width;
            match column.values {
                Values::Numbers(write) => {
                    let out = number[first..].chunks_exact_mut(width);
                    some.iter().zip(out).for_each(|(row, out)| write(row, out));
                }
                Values::Integers(read) => {
                    some.iter().zip(&mut integer[first..]).for_each(|(row, out)| *out = read(row));
                }
                Values::Flags(read) => {
                    some.iter().zip(&mut flag[first..]).for_each(|(row, out)| *out = read(row));
                }
            }
        }
    }
    for (number, status) in track_of_plot.values()?.iter_mut().zip(statuses) {
        *number = status.code();
    }
    Ok((numbers, integers, flags, track_of_plot))
}
