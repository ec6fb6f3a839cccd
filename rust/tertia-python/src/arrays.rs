//! The border: arrays and errors across it, in one place.

use numpy::{
    Element, PyArray, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyReadwriteArrayDyn,
    PyUntypedArrayMethods,
};
use pyo3::exceptions::{PyMemoryError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use std::borrow::Cow;
use std::num::NonZero;
use std::panic::resume_unwind;
use std::sync::Mutex;
use std::thread;
use std::time::Duration;
use tertia::batch::{RowError, for_each_row};
use tertia::interrupt::Flag;
use tertia::missing::Present;

pyo3::import_exception!(numpy.linalg, LinAlgError);

/// What results are, in Python.
pub type Array<'py> = Bound<'py, PyArrayDyn<f64>>;
pub type Integers<'py> = Bound<'py, PyArrayDyn<i64>>;
pub type Marks<'py> = Bound<'py, PyArrayDyn<bool>>;
/// Number of threads, where it is given.
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

/// The shape and the values of an [`Input`], contiguous: one row per element of the batch.
pub struct Rows<'a> {
    pub shape: &'a [usize],
    pub values: Cow<'a, [f64]>,
    name: &'static str,
    /// Axes of a row: one of a sample, two of a matrix.
    axes: usize,
}

impl Input<'_> {
    /// The shape.
    pub fn shape(&self) -> &[usize] {
        self.0.shape()
    }

    /// The rows, which must have at least `minimum` numbers.
    pub fn rows(&self, name: &'static str, minimum: usize) -> PyResult<Rows<'_>> {
        let rows = self.blocks(name, 1)?;
        if rows.len() < minimum {
            let error = tertia::Error::TooFew { argument: name, count: rows.len(), minimum };
            return Err(value_error(error));
        }
        Ok(rows)
    }

    /// The rows, samples of at least `minimum` numbers; in shorter ones, a number that is not finite
    /// is reported first.
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

    /// Rows of so many axes.
    pub fn blocks(&self, name: &'static str, axes: usize) -> PyResult<Rows<'_>> {
        let shape = self.shape();
        if shape.len() < axes {
            return Err(does_not_fit(name, shape));
        }
        // not the array's own `as_slice`, which also gives memory that lies column by column
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

    /// All numbers.
    pub fn numbers(&self, name: &'static str) -> PyResult<Vec<f64>> {
        Ok(self.rows(name, 0)?.values.into_owned())
    }

    /// Rows of so many numbers, which are the last axes.
    pub fn points<const M: usize>(
        &self,
        name: &'static str,
        axes: usize,
    ) -> PyResult<Vec<[f64; M]>> {
        let rows = self.blocks(name, axes)?;
        rows.require(M, rows.count())?;
        Ok(rows.values.as_chunks().0.to_vec())
    }

    /// Rows of two numbers.
    pub fn pairs(&self, name: &'static str) -> PyResult<Vec<[f64; 2]>> {
        self.points(name, 1)
    }
}

/// So many numbers are compared before it is asked where one lies outside.
const COMPARED: usize = 64;

/// The place of the first number that does not lie between two others, nor with `missing` is nan.
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

    /// Numbers in all.
    pub fn size(&self) -> f64 {
        self.values.len() as f64
    }

    /// Room for results of the same shape.
    pub fn output<'py, T: Element + Send>(&self, py: Python<'py>) -> PyResult<Output<'py, T>> {
        let (batch, tail) = self.shape.split_at(self.shape.len() - self.axes);
        Output::new(py, batch, tail)
    }

    /// Row `row`, or the only one.
    pub fn shared(&self, row: usize) -> &[f64] {
        let n = self.len();
        let start = if self.count() == 1 { 0 } else { row * n };
        &self.values[start..start + n]
    }

    /// Fails unless there are so many rows of this length.
    pub fn require(&self, length: usize, count: usize) -> PyResult<()> {
        if self.len() == length && self.count() == count {
            return Ok(());
        }
        Err(does_not_fit(self.name, self.shape))
    }

    /// The same of rows of which one is enough for all.
    pub fn require_shared(&self, length: usize, count: usize) -> PyResult<()> {
        self.require(length, if self.count() == 1 { 1 } else { count })
    }

    /// Calls `work` with a state per thread on every row, its index, and where its results go;
    /// `nanoseconds` is the cost of all rows.
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

/// What goes by a name, one of these.
pub fn choice<T: Clone>(argument: &str, name: &str, choices: &[(&str, T)]) -> PyResult<T> {
    if let Some((_, chosen)) = choices.iter().find(|(choice, _)| *choice == name) {
        return Ok(chosen.clone());
    }
    let names: Vec<_> = choices.iter().map(|(name, _)| format!("'{name}'")).collect();
    let (last, others) = names.split_last().expect("there is something to choose");
    Err(unknown(argument, name, &format!("{} or {last}", others.join(", "))))
}

/// The error for a word that is not among the choices.
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

/// Work that takes this long looks for signals, such as Ctrl-C: by another thread, so that this one can.
const WORTH_STOPPING_NS: f64 = 1e8;
const LOOKS: Duration = Duration::from_millis(50);
/// Of the stack of the other thread, as of most main ones.
const STACK: usize = 8 << 20;

/// Does work that takes about so long, with the interpreter's lock released where that is worth it.
///
/// # Errors
/// What a signal handler raised: the work was stopped.
pub fn release<T: Send>(
    py: Python<'_>,
    nanoseconds: f64,
    work: impl FnOnce() -> T + Send,
) -> PyResult<T> {
    match nanoseconds {
        ..WORTH_RELEASING_NS => Ok(work()),
        ..WORTH_STOPPING_NS => Ok(py.detach(work)),
        _ => py.detach(|| stoppable(work)),
    }
}

/// Does work on another thread, and looks for signals meanwhile.
fn stoppable<T: Send>(work: impl FnOnce() -> T + Send) -> PyResult<T> {
    let (flag, work, caller) = (Flag::default(), Mutex::new(Some(work)), thread::current());
    let run = || {
        let work = work.lock().ok().and_then(|mut work| work.take()).expect("it is done once");
        let done = flag.watch(work);
        caller.unpark();
        done
    };
    thread::scope(|scope| {
        let builder = thread::Builder::new().stack_size(STACK);
        // if the system refuses a thread, this one does it
        let Ok(worker) = builder.spawn_scoped(scope, run) else { return Ok(run()) };
        let mut signal = None;
        while !worker.is_finished() {
            thread::park_timeout(LOOKS);
            if let (None, Err(raised)) = (&signal, Python::attach(|py| py.check_signals())) {
                signal = Some(raised);
                flag.set();
            }
        }
        match (worker.join(), signal) {
            (_, Some(raised)) => Err(raised),
            (Ok(done), None) => Ok(done),
            (Err(panic), None) => resume_unwind(panic),
        }
    })
}

/// So many numbers are copied rather than kept where they are.
const FEW: usize = 64;

/// A fresh array of this shape around `values`, as many as it holds.
pub fn array<'py, T: Element>(
    py: Python<'py>,
    shape: &[usize],
    values: impl IntoIterator<Item = T>,
) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
    let values = values.into_iter();
    if shape.iter().product::<usize>() > FEW {
        return PyArray::from_vec(py, values.collect()).reshape(shape);
    }
    // a vector of its own costs more than so few numbers
    let array = PyArrayDyn::zeros(py, shape, false);
    for (place, value) in array.readwrite().as_slice_mut()?.iter_mut().zip(values) {
        *place = value;
    }
    Ok(array)
}

/// The matrix of an upper triangle.
pub fn symmetric<'py>(py: Python<'py>, upper: [f64; 6]) -> PyResult<Array<'py>> {
    let [p00, p01, p02, p11, p12, p22] = upper;
    array(py, &[3, 3], [p00, p01, p02, p01, p11, p12, p02, p12, p22])
}

/// Fresh arrays of this shape, one for each number of the results.
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

/// So many numbers find room wherever Python runs.
const SMALL: usize = 100_000;

/// A fresh array for the results of a kernel. NumPy allocates it, because it asks for huge pages:
/// the statistics of 10^7 values took 3 ns a value instead of 10.
pub struct Output<'py, T: Element = f64> {
    array: PyReadwriteArrayDyn<'py, T>,
    /// Axes of the batch.
    axes: usize,
}

impl<'py, T: Element + Send> Output<'py, T> {
    /// Room for a row of shape `tail` for each element of the batch.
    pub fn new(py: Python<'py>, batch: &[usize], tail: &[usize]) -> PyResult<Self> {
        let shape = [batch, tail].concat();
        let count = shape.iter().try_fold(1_usize, |count, &size| count.checked_mul(size));
        let count = count.unwrap_or(usize::MAX);
        if count > SMALL {
            // rust-numpy panics where NumPy has no memory
            room_for::<T>(count)?;
        }
        let array = PyArrayDyn::zeros(py, shape, false).readwrite();
        Ok(Self { array, axes: batch.len() })
    }

    /// The numbers, row after row.
    pub fn values(&mut self) -> PyResult<&mut [T]> {
        Ok(self.array.as_slice_mut()?)
    }

    /// The rows.
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

/// Rows of so many axes and numbers, of so many instants or one for all, where they are given.
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
