//! Tables of tracks as arrays.

use crate::arrays::{Array, Integers, Threads, vector};
use crate::sensors::{callsign_numbers, callsigns};
use numpy::{PyArray, PyArrayMethods, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::sync::MutexExt;
use std::sync::{Mutex, PoisonError};
use tertia::tracker::{COLUMNS, Column, Data, Resumed, Table, Values};

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
        Values::Callsigns(_) => "str",
        Values::Flags(_) => "bool",
    }
}

/// A column: its values, or the array made from them when it was requested.
enum Kept {
    Data(Data),
    Array(Py<PyAny>),
}

/// The columns of a table of tracks, and the tracks in it that were resumed.
#[pyclass(frozen, module = "tertia._core")]
pub struct TrackColumns {
    columns: Mutex<Vec<Kept>>,
    resumed: Mutex<Vec<Resumed>>,
}

#[pymethods]
impl TrackColumns {
    /// Creates a table without rows, with room for this number of rows.
    #[new]
    fn empty(rows: usize) -> Self {
        Self::new(Table::new(true, rows))
    }

    /// Number of rows.
    #[getter]
    fn count(&self, py: Python<'_>) -> PyResult<usize> {
        let tracks = self.take_integers(py, "track")?;
        let count = tracks.len();
        self.put_back(py, "track", Data::Integers(tracks));
        Ok(count)
    }

    /// Removes the rows from this index on.
    fn truncate(&self, py: Python<'_>, rows: usize) -> PyResult<()> {
        let mut table = self.take_rows(py, true)?;
        table.truncate(rows);
        self.put_rows(py, table);
        Ok(())
    }

    /// Replaces the numbers of plots that were given in parts by their numbers among all plots. `order`
    /// contains the index among all plots of each plot in the sequence of the parts; the first plot has
    /// the number `first`.
    fn renumber(
        &self,
        py: Python<'_>,
        order: PyReadonlyArray1<'_, i64>,
        first: i64,
    ) -> PyResult<()> {
        let (order, mut plots) = (order.as_slice()?, self.take_integers(py, "plot")?);
        for plot in &mut plots {
            let place = usize::try_from(*plot - first).ok();
            if let Some(place) = place.and_then(|place| order.get(place)) {
                *plot = first + place;
            }
        }
        self.put_back(py, "plot", Data::Integers(plots));
        Ok(())
    }

    /// Returns the heights of plots, the first of which has the number `first`. Missing heights are
    /// replaced by those of their tracks in the rows from `begin` on.
    fn heights<'py>(
        &self,
        py: Python<'py>,
        height: PyReadonlyArray1<'py, f64>,
        first: i64,
        begin: usize,
    ) -> PyResult<Array<'py>> {
        let own = height.as_slice()?;
        let mut filled = own.to_vec();
        let (plot, tracks) = (self.take_integers(py, "plot")?, self.take_numbers(py, "height")?);
        for (plot, height) in plot.iter().zip(&tracks).skip(begin) {
            let place = usize::try_from(plot - first).ok().filter(|place| *place < own.len());
            if let Some(place) = place.filter(|place| !own[*place].is_finite()) {
                filled[place] = *height;
            }
        }
        self.put_back(py, "plot", Data::Integers(plot));
        self.put_back(py, "height", Data::Numbers(tracks));
        vector(py, filled)
    }

    /// Removes the rows of tracks that are never confirmed, and gives those of tracks that were resumed
    /// the number of the older track. Returns the numbers of the tracks of the plots.
    fn keep_confirmed<'py>(
        &self,
        py: Python<'py>,
        track_of_plot: PyReadonlyArray1<'py, i64>,
        n_threads: Threads,
    ) -> PyResult<Integers<'py>> {
        let mut tracks = track_of_plot.as_slice()?.to_vec();
        let mut table = self.take_rows(py, true)?;
        table.keep_confirmed(&mut tracks, n_threads);
        self.put_rows(py, table);
        vector(py, tracks)
    }

    /// Returns the array of a column, by its index in `track_columns`; it is always the same array.
    fn column(&self, py: Python<'_>, index: usize) -> PyResult<Py<PyAny>> {
        let mut columns = self.columns.lock_py_attached(py).unwrap_or_else(PoisonError::into_inner);
        if let Kept::Data(data) = &mut columns[index] {
            let data = std::mem::replace(data, Data::Flags(Vec::new()));
            let found = array_of(py, &COLUMNS[index], data)?;
            columns[index] = Kept::Array(found);
        }
        match &columns[index] {
            Kept::Array(array) => Ok(array.clone_ref(py)),
            Kept::Data(_) => unreachable!("it is an array now"),
        }
    }
}

impl TrackColumns {
    /// Returns all rows and leaves the table empty; later rows are kept for tentative tracks only if
    /// `tentative` is set.
    pub fn take_rows(&self, py: Python<'_>, tentative: bool) -> PyResult<Table> {
        let columns = (0..COLUMNS.len()).map(|index| self.take(py, index));
        let columns = columns.collect::<PyResult<_>>()?;
        let mut resumed = self.resumed.lock_py_attached(py).unwrap_or_else(PoisonError::into_inner);
        Ok(Table::of((columns, std::mem::take(&mut *resumed)), tentative))
    }

    /// Returns the rows to the table.
    pub fn put_rows(&self, py: Python<'_>, table: Table) {
        let (columns, resumed) = table.into_columns();
        for (index, data) in columns.into_iter().enumerate() {
            self.put(py, index, data);
        }
        *self.resumed.lock_py_attached(py).unwrap_or_else(PoisonError::into_inner) = resumed;
    }

    /// Takes the values of a column of numbers out of the table; symmetric matrices have only the
    /// elements on and above the diagonal.
    pub fn take_numbers(&self, py: Python<'_>, name: &str) -> PyResult<Vec<f64>> {
        match self.take(py, place(name))? {
            Data::Numbers(values) => Ok(values),
            _ => unreachable!("it is a column of numbers"),
        }
    }

    /// Takes the values of a column of integers out of the table.
    pub fn take_integers(&self, py: Python<'_>, name: &str) -> PyResult<Vec<i64>> {
        match self.take(py, place(name))? {
            Data::Integers(values) => Ok(values),
            _ => unreachable!("it is a column of integers"),
        }
    }

    /// Takes the values of a column of flags out of the table.
    pub fn take_flags(&self, py: Python<'_>, name: &str) -> PyResult<Vec<bool>> {
        match self.take(py, place(name))? {
            Data::Flags(values) => Ok(values),
            _ => unreachable!("it is a column of flags"),
        }
    }

    /// Returns the values of a column to the table.
    pub fn put_back(&self, py: Python<'_>, name: &str, data: Data) {
        self.put(py, place(name), data);
    }

    /// Takes the values of a column out of the table.
    fn take(&self, py: Python<'_>, index: usize) -> PyResult<Data> {
        let mut columns = self.columns.lock_py_attached(py).unwrap_or_else(PoisonError::into_inner);
        let taken = std::mem::replace(&mut columns[index], Kept::Data(Data::Flags(Vec::new())));
        let array = match taken {
            Kept::Array(array) => array.into_bound(py),
            Kept::Data(data) => return Ok(data),
        };
        Ok(match COLUMNS[index].values {
            Values::Numbers(_) => Data::Numbers(array.call_method0("ravel")?.extract()?),
            Values::Integers(_) => Data::Integers(array.extract()?),
            Values::Callsigns(_) => Data::Integers(callsign_numbers(&array.extract()?)?),
            Values::Flags(_) => Data::Flags(array.extract()?),
            Values::Symmetric(_) => {
                let name = COLUMNS[index].name;
                return Err(PyValueError::new_err(format!("{name} is an array already")));
            }
        })
    }

    fn put(&self, py: Python<'_>, index: usize, data: Data) {
        let mut columns = self.columns.lock_py_attached(py).unwrap_or_else(PoisonError::into_inner);
        columns[index] = Kept::Data(data);
    }

    pub fn new(table: Table) -> Self {
        let (columns, resumed) = table.into_columns();
        let columns = columns.into_iter().map(Kept::Data).collect();
        Self { columns: Mutex::new(columns), resumed: Mutex::new(resumed) }
    }
}

/// Index of a column.
fn place(name: &str) -> usize {
    COLUMNS.iter().position(|column| column.name == name).expect("it is a column")
}

/// Creates a NumPy array from the values of a column, without a copy.
fn array_of(py: Python<'_>, column: &Column, data: Data) -> PyResult<Py<PyAny>> {
    let shape = |count: usize| {
        let width = column.shape.iter().product::<usize>();
        [&[count / width], column.shape].concat()
    };
    Ok(match column.completed(data) {
        Data::Integers(values) if matches!(column.values, Values::Callsigns(_)) => {
            callsigns(py, values.into_iter())
        }
        Data::Numbers(values) => {
            let shape = shape(values.len());
            PyArray::from_vec(py, values).reshape(shape)?.into_any().unbind()
        }
        Data::Integers(values) => PyArray::from_vec(py, values).into_any().unbind(),
        Data::Flags(values) => PyArray::from_vec(py, values).into_any().unbind(),
    })
}
