//! The border: arrays and errors across it, in one place.

use numpy::{
    Element, PyArray, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyReadwriteArrayDyn,
    PyUntypedArrayMethods,
};
use pyo3::exceptions::{PyMemoryError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use std::borrow::Cow;
use tertia::batch::RowError;
use tertia::missing::Present;

pyo3::import_exception!(numpy.linalg, LinAlgError);

/// A float64 array whose last axis is the sample axis; the leading axes are the batch.
pub struct Samples<'py> {
    array: PyReadonlyArrayDyn<'py, f64>,
    name: &'static str,
}

/// The shape and the values of [`Samples`], contiguous: one row per element of the batch.
pub struct Rows<'a> {
    pub shape: &'a [usize],
    pub values: Cow<'a, [f64]>,
    name: &'static str,
    /// Axes of a row: one of a sample, two of a matrix.
    axes: usize,
}

impl<'py> Samples<'py> {
    pub fn extract(value: &Bound<'py, PyAny>, name: &'static str) -> PyResult<Self> {
        let array = value
            .cast::<PyArrayDyn<f64>>()
            .map_err(|_| PyTypeError::new_err(format!("{name} must be an array of float64")))?;
        if array.ndim() == 0 {
            return Err(PyValueError::new_err(format!(
                "{name} is a single number; it must be an array with the sample along its last axis"
            )));
        }
        Ok(Self { array: array.readonly(), name })
    }

    /// The rows, which must have at least `minimum` measurements.
    pub fn rows(&self, minimum: usize) -> PyResult<Rows<'_>> {
        let count = self.array.shape()[self.array.ndim() - 1];
        if count < minimum {
            let error = tertia::Error::TooFew { argument: self.name, count, minimum };
            return Err(value_error(error));
        }
        self.blocks(1)
    }

    /// The shape.
    pub fn shape(&self) -> &[usize] {
        self.array.shape()
    }

    /// Rows of so many axes, which must be there.
    pub fn blocks(&self, axes: usize) -> PyResult<Rows<'_>> {
        // not the array's own `as_slice`, which also gives memory that lies column by column
        let view = self.array.as_array();
        let values = match view.to_slice() {
            Some(slice) => Cow::Borrowed(slice),
            None => {
                let mut values = room_for(view.len())?;
                values.extend(view.iter().copied());
                Cow::Owned(values)
            }
        };
        Ok(Rows { shape: self.array.shape(), values, name: self.name, axes })
    }
}

impl Rows<'_> {
    /// Numbers in a row.
    pub fn len(&self) -> usize {
        self.shape[self.shape.len() - self.axes..].iter().product()
    }

    /// Shape of the batch.
    pub fn batch(&self) -> &[usize] {
        &self.shape[..self.shape.len() - self.axes]
    }

    /// Number of samples.
    pub fn count(&self) -> usize {
        self.batch().iter().product()
    }

    /// The samples, one after the other.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = &[f64]> + Send {
        let n = self.len();
        (0..self.count()).map(move |row| &self.values[row * n..(row + 1) * n])
    }

    /// The Python error for a failed row, with the row's place in the batch.
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

/// All numbers of an array.
pub fn numbers(value: &Bound<'_, PyAny>, name: &'static str) -> PyResult<Vec<f64>> {
    Ok(Samples::extract(value, name)?.rows(0)?.values.into_owned())
}

/// Rows of so many numbers, which are the last axes.
pub fn rows_of<const M: usize>(
    value: &Bound<'_, PyAny>,
    name: &'static str,
    axes: usize,
) -> PyResult<Vec<[f64; M]>> {
    let samples = Samples::extract(value, name)?;
    let rows = if samples.shape().len() < axes { None } else { Some(samples.blocks(axes)?) };
    let fits = |rows: &Rows<'_>| rows.len() == M;
    let Some(rows) = rows.filter(fits) else {
        let shape = samples.shape();
        return Err(PyValueError::new_err(format!("{name} has shape {shape:?}; it does not fit")));
    };
    Ok(rows.values.as_chunks().0.to_vec())
}

/// Rows of two numbers.
pub fn pairs(value: &Bound<'_, PyAny>, name: &'static str) -> PyResult<Vec<[f64; 2]>> {
    rows_of::<2>(value, name, 1)
}

fn is_name(text: &str) -> bool {
    text.bytes().all(|byte| byte.is_ascii_lowercase() || byte == b'_')
}

/// `row` as indices into a batch of this shape, joined by commas.
fn unravel(mut row: usize, batch: &[usize]) -> String {
    let mut indices = Vec::new();
    for &size in batch.iter().rev() {
        indices.push((row % size).to_string());
        row /= size;
    }
    indices.reverse();
    indices.join(", ")
}

/// Error of a kernel outside a batch.
pub fn value_error(error: tertia::Error) -> PyErr {
    error_with(error.to_string(), &error)
}

fn error_with(text: String, error: &tertia::Error) -> PyErr {
    if error.is_about_definiteness() {
        LinAlgError::new_err(text)
    } else {
        PyValueError::new_err(text)
    }
}

/// An empty vector with room for so many values, or a `MemoryError`.
pub fn room_for<T>(count: usize) -> PyResult<Vec<T>> {
    let mut room = Vec::new();
    room.try_reserve_exact(count)
        .map_err(|_| PyMemoryError::new_err(format!("no memory for {count} numbers")))?;
    Ok(room)
}

/// So many equal values, or a `MemoryError`.
pub fn repeated<T: Clone>(value: T, count: usize) -> PyResult<Vec<T>> {
    let mut values = room_for(count)?;
    values.resize(count, value);
    Ok(values)
}

/// Releasing the interpreter's lock and taking it again costs a tenth of this.
const WORTH_RELEASING_NS: f64 = 2000.0;

/// Does work that takes about so long, with the interpreter's lock released where that is worth it.
pub fn release<T: Send>(py: Python<'_>, nanoseconds: f64, work: impl FnOnce() -> T + Send) -> T {
    if nanoseconds < WORTH_RELEASING_NS { work() } else { py.detach(work) }
}

/// A fresh array of this shape around `values`.
pub fn array<'py, T: Element>(
    py: Python<'py>,
    shape: &[usize],
    values: Vec<T>,
) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
    PyArray::from_vec(py, values).reshape(shape)
}

/// So many numbers find room wherever Python runs.
const SMALL: usize = 100_000;

/// A fresh array for the results of a kernel. NumPy allocates it, because it asks for huge pages:
/// the statistics of 10^7 values took 3 ns a value instead of 10.
pub struct Output<'py, T: Element>(PyReadwriteArrayDyn<'py, T>);

impl<'py, T: Element> Output<'py, T> {
    pub fn new(py: Python<'py>, shape: &[usize]) -> PyResult<Self> {
        let count = shape.iter().try_fold(1_usize, |count, &size| count.checked_mul(size));
        let count = count.unwrap_or(usize::MAX);
        if count > SMALL {
            // rust-numpy panics where NumPy has no memory
            room_for::<T>(count)?;
        }
        Ok(Self(PyArrayDyn::zeros(py, shape, false).readwrite()))
    }

    /// The numbers, row after row.
    pub fn values(&mut self) -> PyResult<&mut [T]> {
        Ok(self.0.as_slice_mut()?)
    }

    pub fn into_array(self) -> Bound<'py, PyArrayDyn<T>> {
        (**self.0).clone()
    }
}

/// The numbers of an array that the caller allocated, row after row.
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

/// A chunked view that also works for samples of length zero.
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

/// Buffers for samples with missing measurements.
#[derive(Default)]
pub struct Gaps {
    pub present: Present,
    pub outlier: Vec<bool>,
    pub cleaned: Vec<f64>,
}

impl Gaps {
    /// Collects what is there and makes room for the results.
    pub fn collect(&mut self, y: &[f64]) {
        self.present.collect(y);
        let n = self.present.values().len();
        self.outlier.clear();
        self.outlier.resize(n, false);
        self.cleaned.clear();
        self.cleaned.resize(n, 0.0);
    }
}
