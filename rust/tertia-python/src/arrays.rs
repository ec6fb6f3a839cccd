//! Conversion of arrays and errors between Python and Rust, in one place.

mod release;

pub use release::release;

use numpy::{
    Element, PyArray, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyReadwriteArrayDyn,
    PyUntypedArrayMethods,
};
use pyo3::exceptions::{PyMemoryError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use std::borrow::Cow;
use std::num::NonZero;
use tertia::batch::{RowError, for_each_row};

pyo3::import_exception!(numpy.linalg, LinAlgError);

/// Arrays that are returned to Python.
pub type Array<'py> = Bound<'py, PyArrayDyn<f64>>;
pub type Integers<'py> = Bound<'py, PyArrayDyn<i64>>;
pub type Marks<'py> = Bound<'py, PyArrayDyn<bool>>;
/// Number of threads, if it is given.
pub type Threads = Option<NonZero<usize>>;

/// A float64 array; its leading axes are the batch.
pub struct Input<'py>(PyReadonlyArrayDyn<'py, f64>);

impl<'py> FromPyObject<'_, 'py> for Input<'py> {
    type Error = PyErr;

    fn extract(value: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        let array = value.cast::<PyArrayDyn<f64>>();
        let array = array.map_err(|_| PyTypeError::new_err("it must be an array of float64"))?;
        Ok(Self(array.readonly()))
    }
}

/// The shape and the values of an [`Input`], contiguous, with one row for each element of the batch.
pub struct Rows<'a> {
    pub shape: &'a [usize],
    pub values: Cow<'a, [f64]>,
    name: &'static str,
    /// Number of axes of a row: 1 for samples, 2 for matrices.
    axes: usize,
}

impl Input<'_> {
    /// Returns the shape.
    pub fn shape(&self) -> &[usize] {
        self.0.shape()
    }

    /// Returns the rows, which must have at least `minimum` numbers.
    pub fn rows(&self, name: &'static str, minimum: usize) -> PyResult<Rows<'_>> {
        let rows = self.blocks(name, 1)?;
        if rows.len() < minimum {
            let error = tertia::Error::TooFew { argument: name, count: rows.len(), minimum };
            return Err(value_error(error));
        }
        Ok(rows)
    }

    /// Returns the rows as samples of at least `minimum` numbers. If they are shorter, a number that is
    /// not finite is reported first.
    pub fn samples(&self, name: &'static str, minimum: usize) -> PyResult<Rows<'_>> {
        let rows = self.rows(name, 0)?;
        if rows.len() < minimum {
            for (row, sample) in rows.iter().enumerate() {
                tertia::require_finite(name, sample)
                    .map_err(|error| rows.error(RowError { row, error }))?;
            }
        }
        self.rows(name, minimum)
    }

    /// Returns rows with this number of axes.
    pub fn blocks(&self, name: &'static str, axes: usize) -> PyResult<Rows<'_>> {
        let shape = self.shape();
        if shape.len() < axes {
            return Err(does_not_fit(name, shape));
        }
        // not the array's own `as_slice`, which also accepts column-major memory
        let view = self.0.as_array();
        let values = match view.to_slice() {
            Some(slice) => Cow::Borrowed(slice),
            None => {
                let mut values = room_for(view.len())?;
                values.extend(view.iter().copied());
                Cow::Owned(values)
            }
        };
        Ok(Rows { shape, values, name, axes })
    }

    /// Returns all numbers.
    pub fn numbers(&self, name: &'static str) -> PyResult<Vec<f64>> {
        Ok(self.rows(name, 0)?.values.into_owned())
    }

    /// Returns rows of M numbers, which take up the last `axes` axes.
    pub fn points<const M: usize>(
        &self,
        name: &'static str,
        axes: usize,
    ) -> PyResult<Vec<[f64; M]>> {
        let rows = self.blocks(name, axes)?;
        rows.require(M, rows.count())?;
        Ok(rows.values.as_chunks().0.to_vec())
    }

    /// Returns rows of two numbers.
    pub fn pairs(&self, name: &'static str) -> PyResult<Vec<[f64; 2]>> {
        self.points(name, 1)
    }
}

/// Number of values that are compared together before the position of a value outside is searched.
const COMPARED: usize = 64;

/// Returns the index of the first number that is outside an interval; with `missing`, nan is allowed.
#[pyfunction]
pub fn first_outside(array: Input<'_>, least: f64, most: f64, missing: bool) -> Option<usize> {
    let lies = |v: &f64| (least <= *v) & (*v <= most) | missing & v.is_nan();
    let view = array.0.as_array();
    let Some(values) = view.to_slice() else { return view.iter().position(|v| !lies(v)) };
    let bad = |part: &[f64]| !part.iter().fold(true, |all, v| all & lies(v));
    let part = values.chunks(COMPARED).position(bad)?;
    values[part * COMPARED..].iter().position(|v| !lies(v)).map(|at| part * COMPARED + at)
}

fn does_not_fit(name: &str, shape: &[usize]) -> PyErr {
    PyValueError::new_err(match shape {
        [] => format!(
            "{name} is a single number; it must be an array with the sample along its last axis"
        ),
        _ => format!("{name} has shape {shape:?}; it does not fit"),
    })
}

impl Rows<'_> {
    /// Number of values in a row.
    pub fn len(&self) -> usize {
        self.shape[self.shape.len() - self.axes..].iter().product()
    }

    /// Shape of the batch.
    pub fn batch(&self) -> &[usize] {
        &self.shape[..self.shape.len() - self.axes]
    }

    /// Number of rows.
    pub fn count(&self) -> usize {
        self.batch().iter().product()
    }

    /// Iterates over the rows.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = &[f64]> + Send {
        let n = self.len();
        (0..self.count()).map(move |row| &self.values[row * n..(row + 1) * n])
    }

    /// Total number of values, as a cost.
    pub fn size(&self) -> f64 {
        self.values.len() as f64
    }

    /// Allocates an output of the same shape.
    pub fn output<'py, T: Element + Send>(&self, py: Python<'py>) -> PyResult<Output<'py, T>> {
        let (batch, tail) = self.shape.split_at(self.shape.len() - self.axes);
        Output::new(py, batch, tail)
    }

    /// Returns row `row`, or the only row if it is shared by all.
    pub fn shared(&self, row: usize) -> &[f64] {
        let n = self.len();
        let start = if self.count() == 1 { 0 } else { row * n };
        &self.values[start..start + n]
    }

    /// Returns an error unless there are `count` rows of this length.
    pub fn require(&self, length: usize, count: usize) -> PyResult<()> {
        if self.len() == length && self.count() == count {
            return Ok(());
        }
        Err(does_not_fit(self.name, self.shape))
    }

    /// [`Self::require`] that also accepts a single row for all.
    pub fn require_shared(&self, length: usize, count: usize) -> PyResult<()> {
        self.require(length, if self.count() == 1 { 1 } else { count })
    }

    /// Calls `work` on every row with a state per thread, the row and its index, and the place for its
    /// results; `nanoseconds` is the cost of all rows.
    pub fn each<O: Send, S>(
        &self,
        py: Python<'_>,
        nanoseconds: f64,
        n_threads: Threads,
        outputs: impl ExactSizeIterator<Item = O> + Send,
        state: impl Fn() -> S + Sync + Send,
        work: impl Fn(&mut S, (usize, &[f64]), O) -> tertia::Result<()> + Sync + Send,
    ) -> PyResult<()> {
        let items = self.iter().enumerate().zip(outputs);
        let work = |state: &mut S, (row, out)| work(state, row, out);
        release(py, nanoseconds, || for_each_row(items, nanoseconds, n_threads, state, work))?
            .map_err(|failure| self.error(failure))
    }

    /// Calls `work` on every row as [`Self::each`], but without a state; the results are `unknown` until it
    /// changes them.
    pub fn results<R: Clone + Send>(
        &self,
        py: Python<'_>,
        nanoseconds: f64,
        n_threads: Threads,
        unknown: R,
        work: impl Fn(usize, &[f64], &mut R) -> tertia::Result<()> + Sync + Send,
    ) -> PyResult<Vec<R>> {
        let mut found = repeated(unknown, self.count())?;
        let work =
            |(): &mut (), (row, values): (usize, &[f64]), out: &mut R| work(row, values, out);
        self.each(py, nanoseconds, n_threads, found.iter_mut(), || (), work)?;
        Ok(found)
    }

    /// Converts the error of a row to a Python error that contains the index of the row in the batch.
    pub fn error(&self, failure: RowError) -> PyErr {
        let text = failure.error.to_string();
        let place = unravel(failure.row, self.batch());
        let text = match text.split_once('[') {
            _ if place.is_empty() => text,
            Some((name, rest)) if is_name(name) => format!("{name}[{place}, {rest}"),
            _ => format!("{text} (in {}[{place}])", self.name),
        };
        error_with(text, &failure.error)
    }
}

fn is_name(text: &str) -> bool {
    text.bytes().all(|byte| byte.is_ascii_lowercase() || byte == b'_')
}

/// Returns `row` as indices into a batch of this shape, joined by commas.
fn unravel(mut row: usize, batch: &[usize]) -> String {
    let mut indices = Vec::new();
    for &size in batch.iter().rev() {
        indices.push((row % size).to_string());
        row /= size;
    }
    indices.reverse();
    indices.join(", ")
}

/// Converts the error of a kernel outside a batch.
pub fn value_error(error: tertia::Error) -> PyErr {
    error_with(error.to_string(), &error)
}

/// Returns the choice with this name.
pub fn choice<T: Clone>(argument: &str, name: &str, choices: &[(&str, T)]) -> PyResult<T> {
    if let Some((_, chosen)) = choices.iter().find(|(choice, _)| *choice == name) {
        return Ok(chosen.clone());
    }
    let names: Vec<_> = choices.iter().map(|(name, _)| format!("'{name}'")).collect();
    let (last, others) = names.split_last().expect("there is something to choose");
    Err(unknown(argument, name, &format!("{} or {last}", others.join(", "))))
}

/// Returns the error for a name that is not among the choices.
pub fn unknown(argument: &str, value: &str, choices: &str) -> PyErr {
    PyValueError::new_err(format!("{argument} is '{value}'; it must be {choices}"))
}

fn error_with(text: String, error: &tertia::Error) -> PyErr {
    if error.is_about_definiteness() {
        LinAlgError::new_err(text)
    } else {
        PyValueError::new_err(text)
    }
}

/// Returns an empty vector with room for this number of values, or a `MemoryError`.
pub fn room_for<T>(count: usize) -> PyResult<Vec<T>> {
    let mut room = Vec::new();
    room.try_reserve_exact(count)
        .map_err(|_| PyMemoryError::new_err(format!("no memory for {count} numbers")))?;
    Ok(room)
}

/// Returns a vector of equal values, or a `MemoryError`.
pub fn repeated<T: Clone>(value: T, count: usize) -> PyResult<Vec<T>> {
    let mut values = room_for(count)?;
    values.resize(count, value);
    Ok(values)
}

/// Calls `work` on every item; `nanoseconds` is the cost of all. An error does not say which item failed.
pub fn for_each_item<T: Send>(
    py: Python<'_>,
    nanoseconds: f64,
    n_threads: Threads,
    items: impl ExactSizeIterator<Item = T> + Send,
    work: impl Fn(T) -> tertia::Result<()> + Sync + Send,
) -> PyResult<()> {
    let work = |(): &mut (), item| work(item);
    release(py, nanoseconds, || for_each_row(items, nanoseconds, n_threads, || (), work))?
        .map_err(|failure| value_error(failure.error))
}

/// Largest number of values that are copied to the array instead of moved.
const FEW: usize = 64;

/// Creates an array of this shape from `values`, which must be as many as it holds.
pub fn array<'py, T: Element>(
    py: Python<'py>,
    shape: &[usize],
    values: impl IntoIterator<Item = T>,
) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
    let values = values.into_iter();
    if shape.iter().product::<usize>() > FEW {
        return PyArray::from_vec(py, values.collect()).reshape(shape);
    }
    // for so few numbers, a separate vector costs more than a copy
    let array = PyArrayDyn::zeros(py, shape, false);
    for (place, value) in array.readwrite().as_slice_mut()?.iter_mut().zip(values) {
        *place = value;
    }
    Ok(array)
}

/// Creates an array of one axis.
pub fn vector<'py, T: Element>(
    py: Python<'py>,
    values: impl IntoIterator<Item = T, IntoIter: ExactSizeIterator>,
) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
    let values = values.into_iter();
    array(py, &[values.len()], values)
}

/// Creates a symmetric matrix from its upper triangle.
pub fn symmetric<'py>(py: Python<'py>, upper: [f64; 6]) -> PyResult<Array<'py>> {
    let [p00, p01, p02, p11, p12, p22] = upper;
    array(py, &[3, 3], [p00, p01, p02, p01, p11, p12, p02, p12, p22])
}

/// Creates arrays of this shape, one for each number of the results.
pub fn columns<'py, R, T: Element, const K: usize>(
    py: Python<'py>,
    shape: &[usize],
    results: &[R],
    of: [fn(&R) -> T; K],
) -> PyResult<[Bound<'py, PyArrayDyn<T>>; K]> {
    let mut columns = Vec::with_capacity(K);
    for of in of {
        columns.push(array(py, shape, results.iter().map(of))?);
    }
    Ok(std::array::from_fn(|_| columns.remove(0)))
}

/// Number of values for which there is always enough memory.
const SMALL: usize = 100_000;

/// A new array for the results of a kernel. It is allocated by NumPy, which requests huge pages:
/// the statistics of 10^7 values took 3 ns per value instead of 10.
pub struct Output<'py, T: Element = f64> {
    array: PyReadwriteArrayDyn<'py, T>,
    /// Number of axes of the batch.
    axes: usize,
}

impl<'py, T: Element + Send> Output<'py, T> {
    /// Allocates a row of shape `tail` for each element of the batch.
    pub fn new(py: Python<'py>, batch: &[usize], tail: &[usize]) -> PyResult<Self> {
        let shape = [batch, tail].concat();
        let count = shape.iter().try_fold(1_usize, |count, &size| count.checked_mul(size));
        let count = count.unwrap_or(usize::MAX);
        if count > SMALL {
            // rust-numpy panics if NumPy cannot allocate memory
            room_for::<T>(count)?;
        }
        let array = PyArrayDyn::zeros(py, shape, false).readwrite();
        Ok(Self { array, axes: batch.len() })
    }

    /// Returns all values, row by row.
    pub fn values(&mut self) -> PyResult<&mut [T]> {
        Ok(self.array.as_slice_mut()?)
    }

    /// Returns the rows.
    pub fn rows(&mut self) -> PyResult<impl ExactSizeIterator<Item = &mut [T]> + Send> {
        let (batch, tail) = self.array.shape().split_at(self.axes);
        let (count, size) = (batch.iter().product(), tail.iter().product());
        Ok(chunks(self.values()?, size, count))
    }
}

impl<'py, T: Element> IntoPyObject<'py> for Output<'py, T> {
    type Target = PyArrayDyn<T>;
    type Output = Bound<'py, PyArrayDyn<T>>;
    type Error = std::convert::Infallible;

    fn into_pyobject(self, _py: Python<'py>) -> Result<Self::Output, Self::Error> {
        Ok((**self.array).clone())
    }
}

/// Returns the values of an array that the caller allocated, row by row.
pub fn writable<'a>(
    array: &'a mut PyReadwriteArrayDyn<'_, f64>,
    shape: &[usize],
    name: &str,
) -> PyResult<&'a mut [f64]> {
    if array.shape() != shape || !array.is_c_contiguous() {
        let found = array.shape();
        return Err(PyValueError::new_err(format!(
            "{name} has shape {found:?}; it must be contiguous, of shape {shape:?}"
        )));
    }
    Ok(array.as_slice_mut()?)
}

/// Splits a slice into chunks; this also works for samples of length zero.
pub fn chunks<T: Send>(
    values: &mut [T],
    size: usize,
    count: usize,
) -> impl ExactSizeIterator<Item = &mut [T]> + Send {
    let mut rest = values;
    (0..count).map(move |_| {
        let (head, tail) = std::mem::take(&mut rest).split_at_mut(size);
        rest = tail;
        head
    })
}

/// Returns optional rows of this number of axes and values, one for each of `count` instants or one for all.
pub fn optional<'a>(
    input: Option<&'a Input<'_>>,
    name: &'static str,
    (axes, length): (usize, usize),
    count: usize,
) -> PyResult<Option<Rows<'a>>> {
    let Some(input) = input else { return Ok(None) };
    let rows = input.blocks(name, axes)?;
    rows.require_shared(length, count)?;
    Ok(Some(rows))
}
