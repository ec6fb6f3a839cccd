//! Tables of tracks as arrays.

use crate::arrays::{Output, Threads};
use numpy::{PyArray, PyArrayMethods, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
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
    /// A table without rows.
    #[new]
    fn empty() -> Self {
        Self::new(Table::new(true))
    }

    /// Adds the rows of the next part of plots, whose table is empty then. `order` is where the plots
    /// of all parts, one after the other, are among all, of which the first has the number `first`.
    fn append(
        &self,
        py: Python<'_>,
        part: &Self,
        order: PyReadonlyArray1<'_, i64>,
        first: i64,
    ) -> PyResult<()> {
        let order = order.as_slice()?;
        for (index, column) in COLUMNS.iter().enumerate() {
            let (mut whole, mut part) = (self.take(py, index)?, part.take(py, index)?);
            if let (Data::Integers(plots), "plot") = (&mut part, column.name) {
                for plot in plots {
                    let place = usize::try_from(*plot - first).ok();
                    if let Some(place) = place.and_then(|place| order.get(place)) {
                        *plot = first + place;
                    }
                }
            }
            whole.append(&mut part);
            self.put(py, index, whole);
        }
        Ok(())
    }

    /// Leaves out the rows of tracks that are never confirmed.
    fn keep_confirmed(&self, py: Python<'_>, n_threads: Threads) -> PyResult<()> {
        let columns = (0..COLUMNS.len()).map(|index| self.take(py, index));
        let mut table = Table::of(columns.collect::<PyResult<_>>()?);
        table.keep_confirmed(n_threads);
        for (index, data) in table.into_columns().into_iter().enumerate() {
            self.put(py, index, data);
        }
        Ok(())
    }

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
    /// The values of a column, those of symmetric matrices on and above the diagonal, if it is not an
    /// array yet; else what `read` makes of that.
    fn values<T>(
        &self,
        py: Python<'_>,
        name: &str,
        own: impl FnOnce(&mut Data) -> Option<T>,
        read: impl FnOnce(&Bound<'_, PyAny>) -> PyResult<T>,
    ) -> PyResult<T> {
        let index = COLUMNS.iter().position(|column| column.name == name).expect("it is a column");
        let mut columns = self.0.lock_py_attached(py).unwrap_or_else(PoisonError::into_inner);
        match &mut columns[index] {
            Kept::Data(data) => Ok(own(data).expect("the type of the column")),
            Kept::Array(array) => read(array.bind(py)),
        }
    }

    /// The numbers of a column that is no matrix.
    pub fn numbers(&self, py: Python<'_>, name: &str) -> PyResult<Vec<f64>> {
        let own = |data: &mut Data| match data {
            Data::Numbers(values) => Some(values.clone()),
            _ => None,
        };
        self.values(py, name, own, |array| {
            let values: PyReadonlyArray1<'_, f64> = array.call_method0("ravel")?.extract()?;
            Ok(values.as_slice()?.to_vec())
        })
    }

    pub fn integers(&self, py: Python<'_>, name: &str) -> PyResult<Vec<i64>> {
        let own = |data: &mut Data| match data {
            Data::Integers(values) => Some(values.clone()),
            _ => None,
        };
        self.values(py, name, own, |array| {
            let values: PyReadonlyArray1<'_, i64> = array.extract()?;
            Ok(values.as_slice()?.to_vec())
        })
    }

    pub fn flags(&self, py: Python<'_>, name: &str) -> PyResult<Vec<bool>> {
        let own = |data: &mut Data| match data {
            Data::Flags(values) => Some(values.clone()),
            _ => None,
        };
        self.values(py, name, own, |array| array.extract())
    }

    /// Acts on the upper halves of symmetric matrices, row by row, before they are an array.
    pub fn upper<T>(
        &self,
        py: Python<'_>,
        name: &str,
        act: impl FnOnce(&mut [f64]) -> T,
    ) -> PyResult<T> {
        let own = |data: &mut Data| match data {
            Data::Numbers(values) => Some(act(values)),
            _ => None,
        };
        self.values(py, name, own, |_| {
            Err(PyValueError::new_err(format!("{name} is an array already")))
        })
    }

    /// The values of a column, of which this table keeps none.
    fn take(&self, py: Python<'_>, index: usize) -> PyResult<Data> {
        let mut columns = self.0.lock_py_attached(py).unwrap_or_else(PoisonError::into_inner);
        let taken = std::mem::replace(&mut columns[index], Kept::Data(Data::Flags(Vec::new())));
        let array = match taken {
            Kept::Array(array) => array.into_bound(py),
            Kept::Data(data) => return Ok(data),
        };
        Ok(match COLUMNS[index].values {
            Values::Numbers(_) => Data::Numbers(array.call_method0("ravel")?.extract()?),
            Values::Integers(_) => Data::Integers(array.extract()?),
            Values::Flags(_) => Data::Flags(array.extract()?),
            Values::Symmetric(_) => {
                let name = COLUMNS[index].name;
                return Err(PyValueError::new_err(format!("{name} is an array already")));
            }
        })
    }

    fn put(&self, py: Python<'_>, index: usize, data: Data) {
        let mut columns = self.0.lock_py_attached(py).unwrap_or_else(PoisonError::into_inner);
        columns[index] = Kept::Data(data);
    }

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
