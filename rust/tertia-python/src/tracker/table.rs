//! Tables of tracks as arrays.

use crate::arrays::Output;
use numpy::{PyArray, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::sync::MutexExt;
use std::sync::{Mutex, PoisonError};
use tertia::tracker::{COLUMNS, Column, Data, PlotStatus, Table, Values};

/// Name, unit, type, shape and meaning of each column.
#[pyfunction]
pub fn track_columns() -> Vec<(&'static str, &'static str, &'static str, Vec<usize>, &'static str)>
{
    COLUMNS.iter().map(|c| (c.name, c.unit, kind(c), c.shape.to_vec(), c.doc)).collect()
}

fn kind(column: &Column) -> &'static str {
    match column.values {
        Values::Numbers(_) | Values::Symmetric(_) => "float",
        Values::Integers(_) => "int",
        Values::Flags(_) => "bool",
    }
}

/// A column: its values, or the array that they became when they were asked for.
enum Kept {
    Data(Data),
    Array(Py<PyAny>),
}

/// The columns of a table of tracks.
#[pyclass(frozen, module = "tertia._core")]
pub struct TrackColumns(Mutex<Vec<Kept>>);

#[pymethods]
impl TrackColumns {
    /// The array of a column, by its index in `track_columns`; always the same one.
    fn column(&self, py: Python<'_>, index: usize) -> PyResult<Py<PyAny>> {
        let mut columns = self.0.lock_py_attached(py).unwrap_or_else(PoisonError::into_inner);
        if let Kept::Data(data) = &mut columns[index] {
            let data = std::mem::replace(data, Data::Flags(Vec::new()));
            let found = array(py, &COLUMNS[index], data)?;
            columns[index] = Kept::Array(found);
        }
        match &columns[index] {
            Kept::Array(array) => Ok(array.clone_ref(py)),
            Kept::Data(_) => unreachable!("it is an array now"),
        }
    }
}

impl TrackColumns {
    pub fn new(table: Table) -> Self {
        Self(Mutex::new(table.into_columns().into_iter().map(Kept::Data).collect()))
    }
}

/// The values around which NumPy puts an array, without a copy.
fn array(py: Python<'_>, column: &Column, data: Data) -> PyResult<Py<PyAny>> {
    let shape = |count: usize| {
        let width = column.shape.iter().product::<usize>();
        [&[count / width], column.shape].concat()
    };
    Ok(match column.completed(data) {
        Data::Numbers(values) => {
            let shape = shape(values.len());
            PyArray::from_vec(py, values).reshape(shape)?.into_any().unbind()
        }
        Data::Integers(values) => PyArray::from_vec(py, values).into_any().unbind(),
        Data::Flags(values) => PyArray::from_vec(py, values).into_any().unbind(),
    })
}

/// The status of each plot, as a number.
pub fn codes<'py>(py: Python<'py>, statuses: &[PlotStatus]) -> PyResult<Output<'py, i64>> {
    let mut codes = Output::<i64>::new(py, &[statuses.len()], &[])?;
    for (code, status) in codes.values()?.iter_mut().zip(statuses) {
        *code = status.code();
    }
    Ok(codes)
}
