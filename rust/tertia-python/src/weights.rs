//! Bindings of `tertia::weights`.

use crate::arrays::{
    Output, Rows, Samples, array, chunks, release, repeated, room_for, value_error,
};
use crate::screening::unknown;
use numpy::PyArrayDyn;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::cell::Cell;
use std::num::NonZero;
use tertia::batch::for_each_row;
use tertia::weights::{
    self, Convention, Simulated, Weighing, require_degrees_of_freedom, weighing,
};

type Array<'py> = Bound<'py, PyArrayDyn<f64>>;
type Threads = Option<NonZero<usize>>;

/// Sensors, dimension, and the solver for them.
type Kept = ((usize, usize), Box<dyn Weighing>);

thread_local! {
    /// The thread's last solver: to make one takes as long as to solve a small problem.
    static KEPT: Cell<Option<Kept>> = const { Cell::new(None) };
}
/// Solvers of more dimensions are not kept.
const MAX_DIMENSION_KEPT: usize = 6;

/// The solver for so many sensors and dimensions, kept for the thread's next problem when dropped.
struct Solver(Option<Kept>);

impl Solver {
    fn new(size: (usize, usize)) -> Self {
        let kept = KEPT.take().filter(|(kept_for, _)| *kept_for == size);
        Self(Some(kept.unwrap_or_else(|| (size, weighing(size.0, size.1)))))
    }

    fn get(&mut self) -> &mut dyn Weighing {
        self.0.as_mut().expect("is there until it is dropped").1.as_mut()
    }
}

impl Drop for Solver {
    fn drop(&mut self) {
        KEPT.set(self.0.take().filter(|((_, m), _)| *m <= MAX_DIMENSION_KEPT));
    }
}

/// Measurements of every sensor, or of each.
#[derive(FromPyObject)]
pub enum Counts {
    All(f64),
    Each(Vec<f64>),
}

fn convention(name: &str) -> PyResult<Convention> {
    Ok(match name {
        "sample-mean" => Convention::SampleMean,
        "known-mean" => Convention::KnownMean,
        "paper" => Convention::Paper,
        "differences" => Convention::Differences,
        other => {
            let choices = "'sample-mean', 'known-mean', 'paper' or 'differences'";
            return Err(unknown("convention", other, choices));
        }
    })
}

impl Counts {
    /// Degrees of freedom and means of the sensors' Wishart laws.
    fn wishart(&self, name: &str, sensors: usize) -> PyResult<Vec<(f64, f64)>> {
        let convention = convention(name)?;
        let of = |&n: &f64| convention.wishart(n).map_err(value_error);
        match self {
            Self::All(n) => Ok(vec![of(n)?; sensors]),
            Self::Each(counts) if counts.len() == sensors => counts.iter().map(of).collect(),
            Self::Each(counts) => Err(PyValueError::new_err(format!(
                "n has {} numbers; it must be one number or one for each of {sensors} sensors",
                counts.len()
            ))),
        }
    }

    /// The laws, with which the fused estimate must have a finite variance.
    fn laws(&self, convention: &str, (sensors, m): (usize, usize)) -> PyResult<Vec<(f64, f64)>> {
        let laws = self.wishart(convention, sensors)?;
        let least = match self {
            Self::All(n) => *n,
            Self::Each(counts) => counts.iter().copied().fold(f64::INFINITY, f64::min),
        };
        require_degrees_of_freedom(laws.iter().map(|law| law.0), least, m).map_err(value_error)?;
        Ok(laws)
    }
}

/// Degrees of freedom and mean of a sensor's Wishart law, each sensor its own.
#[pyfunction]
pub fn wishart_law(n: Counts, convention: &str, sensors: usize) -> PyResult<Vec<(f64, f64)>> {
    n.wishart(convention, sensors)
}

/// The least n, the same for all sensors, with which the loss is finite.
#[pyfunction]
pub fn least_count(name: &str, sensors: usize, dimension: usize) -> PyResult<u64> {
    let n = weights::least_count(convention(name)?, sensors, dimension).map_err(value_error)?;
    Ok(n as u64)
}

/// Matrices that a solver keeps for every sensor, and besides.
const MATRICES: (usize, usize) = (14, 30);

/// Sensors and dimension of covariances (..., K, m, m), for which there must be memory.
fn size(covariances: &Samples<'_>) -> PyResult<(usize, usize)> {
    match covariances.shape() {
        [.., sensors, rows, columns] if *sensors >= 2 && rows == columns && *rows > 0 => {
            require_room((*sensors, *rows))?;
            Ok((*sensors, *rows))
        }
        shape => Err(PyValueError::new_err(format!(
            "covariances has shape {shape:?}; it must be (..., K, m, m): an m by m covariance \
             matrix for each of K >= 2 sensors"
        ))),
    }
}

fn require_room((sensors, m): (usize, usize)) -> PyResult<()> {
    if m > MAX_DIMENSION_KEPT {
        let matrices = sensors.saturating_mul(MATRICES.0).saturating_add(MATRICES.1);
        room_for::<f64>(matrices.saturating_mul(m).saturating_mul(m))?;
    }
    Ok(())
}

/// The sensor's index, counted from the end where it is negative.
fn index(sensor: isize, sensors: usize) -> PyResult<usize> {
    let k = if sensor < 0 { sensor + sensors as isize } else { sensor };
    usize::try_from(k).ok().filter(|&k| k < sensors).ok_or_else(|| {
        let last = sensors - 1;
        PyValueError::new_err(format!(
            "sensor is {sensor}; it must be between -{sensors} and {last}"
        ))
    })
}

/// Cost of weighing K sensors, measured.
fn weigh_ns((sensors, m): (usize, usize)) -> f64 {
    sensors as f64 * (20.0 + 2.0 * (m as f64).powi(3))
}

/// Cost of a result with m⁴ numbers for each of K sensors, measured.
fn propagate_ns((sensors, m): (usize, usize)) -> f64 {
    weigh_ns((sensors, m)) + sensors as f64 * (m as f64).powi(4)
}

/// One result of the shape `tail` for every element of the batch.
fn fill<'py>(
    py: Python<'py>,
    rows: &Rows<'_>,
    size: (usize, usize),
    tail: &[usize],
    nanoseconds: f64,
    n_threads: Threads,
    work: impl Fn(&mut dyn Weighing, &[f64], &mut [f64]) -> tertia::Result<()> + Sync,
) -> PyResult<Array<'py>> {
    let mut out = Output::new(py, &[rows.batch(), tail].concat())?;
    let values = out.values()?;
    let (count, length) = (rows.count(), tail.iter().product());
    release(py, nanoseconds * count as f64, || {
        let items = rows.iter().zip(chunks(values, length, count));
        let new = || Solver::new(size);
        for_each_row(items, nanoseconds * count as f64, n_threads, new, |solver, (s, out)| {
            work(solver.get(), s, out)
        })
    })
    .map_err(|failure| rows.error(failure))?;
    Ok(out.into_array())
}

/// The weight matrix of every sensor.
#[pyfunction]
pub fn weight_matrices<'py>(
    py: Python<'py>,
    covariances: &Bound<'py, PyAny>,
    n_threads: Threads,
) -> PyResult<Array<'py>> {
    let samples = Samples::extract(covariances, "covariances")?;
    let (sensors, m) = size(&samples)?;
    let (rows, tail) = (samples.blocks(3)?, [sensors, m, m]);
    fill(py, &rows, (sensors, m), &tail, weigh_ns((sensors, m)), n_threads, |solver, s, out| {
        solver.weights(s, out)
    })
}

/// The covariance of the fused estimate.
#[pyfunction]
pub fn fused_covariance<'py>(
    py: Python<'py>,
    covariances: &Bound<'py, PyAny>,
    n_threads: Threads,
) -> PyResult<Array<'py>> {
    let samples = Samples::extract(covariances, "covariances")?;
    let (sensors, m) = size(&samples)?;
    let (rows, cost) = (samples.blocks(3)?, weigh_ns((sensors, m)));
    fill(py, &rows, (sensors, m), &[m, m], cost, n_threads, |solver, s, out| {
        solver.fused_covariance(s, out)
    })
}

/// The Jacobian's blocks of every sensor.
#[pyfunction]
pub fn jacobian<'py>(
    py: Python<'py>,
    covariances: &Bound<'py, PyAny>,
    sensor: isize,
    n_threads: Threads,
) -> PyResult<Array<'py>> {
    let samples = Samples::extract(covariances, "covariances")?;
    let (sensors, m) = size(&samples)?;
    let k = index(sensor, sensors)?;
    let (rows, tail, cost) =
        (samples.blocks(3)?, [sensors, m * m, m * m], propagate_ns((sensors, m)));
    fill(py, &rows, (sensors, m), &tail, cost, n_threads, |solver, s, out| {
        solver.jacobian(s, k, out)
    })
}

/// The Jacobian's factors, left ones (K, m, m) and then right ones (K, m, m).
#[pyfunction]
pub fn jacobian_factors<'py>(
    py: Python<'py>,
    covariances: &Bound<'py, PyAny>,
    sensor: isize,
    n_threads: Threads,
) -> PyResult<Array<'py>> {
    let samples = Samples::extract(covariances, "covariances")?;
    let (sensors, m) = size(&samples)?;
    let k = index(sensor, sensors)?;
    let (rows, tail, cost) = (samples.blocks(3)?, [2, sensors, m, m], weigh_ns((sensors, m)));
    fill(py, &rows, (sensors, m), &tail, cost, n_threads, |solver, s, out| {
        let (left, right) = out.split_at_mut(s.len());
        solver.jacobian_factors(s, k, left, right)
    })
}

/// The covariance of an estimated weight matrix.
#[pyfunction]
pub fn weight_covariance<'py>(
    py: Python<'py>,
    covariances: &Bound<'py, PyAny>,
    n: Counts,
    sensor: isize,
    convention: &str,
    n_threads: Threads,
) -> PyResult<Array<'py>> {
    let samples = Samples::extract(covariances, "covariances")?;
    let (sensors, m) = size(&samples)?;
    let k = index(sensor, sensors)?;
    let laws = n.laws(convention, (sensors, m))?;
    let c: Vec<_> = laws.iter().map(|(nu, mean)| mean * mean / nu).collect();
    let (rows, cost) = (samples.blocks(3)?, propagate_ns((sensors, m)));
    fill(py, &rows, (sensors, m), &[m * m, m * m], cost, n_threads, |solver, s, out| {
        solver.weight_covariance(s, &c, k, out)
    })
}

/// The bias of an estimated weight matrix.
#[pyfunction]
pub fn weight_bias<'py>(
    py: Python<'py>,
    covariances: &Bound<'py, PyAny>,
    n: Counts,
    sensor: isize,
    convention: &str,
    n_threads: Threads,
) -> PyResult<Array<'py>> {
    let samples = Samples::extract(covariances, "covariances")?;
    let (sensors, m) = size(&samples)?;
    let k = index(sensor, sensors)?;
    let laws = n.laws(convention, (sensors, m))?;
    // relative to the mean
    let (c, mean): (Vec<_>, Vec<_>) = laws.iter().map(|(nu, mean)| (1.0 / nu, mean)).unzip();
    let (rows, cost) = (samples.blocks(3)?, weigh_ns((sensors, m)));
    fill(py, &rows, (sensors, m), &[m, m], cost, n_threads, |solver, s, out| {
        solver.weight_bias(s, &c, &mean, k, out)
    })
}

/// The fused covariance and the first-order excess of the mean squared error over it (2, m, m).
#[pyfunction]
pub fn first_order_excess<'py>(
    py: Python<'py>,
    covariances: &Bound<'py, PyAny>,
    n: Counts,
    convention: &str,
    n_threads: Threads,
) -> PyResult<Array<'py>> {
    let samples = Samples::extract(covariances, "covariances")?;
    let (sensors, m) = size(&samples)?;
    let laws = n.laws(convention, (sensors, m))?;
    // relative to the mean
    let c: Vec<_> = laws.iter().map(|law| 1.0 / law.0).collect();
    let (rows, cost) = (samples.blocks(3)?, weigh_ns((sensors, m)));
    fill(py, &rows, (sensors, m), &[2, m, m], cost, n_threads, |solver, s, out| {
        let (fused, excess) = out.split_at_mut(m * m);
        solver.excess(s, &c, fused, excess)
    })
}

/// The same from draws of Wishart matrices (T, K, m, m), and the loss with its standard error.
#[pyfunction]
pub fn simulated_excess<'py>(
    py: Python<'py>,
    covariances: &Bound<'py, PyAny>,
    draws: &Bound<'py, PyAny>,
    n_threads: Threads,
) -> PyResult<(Array<'py>, Array<'py>, Array<'py>)> {
    let samples = Samples::extract(covariances, "covariances")?;
    let draws = Samples::extract(draws, "draws")?;
    let (sensors, m) = size(&samples)?;
    let (rows, draws) = (samples.blocks(3)?, draws.blocks(3)?);
    let count = rows.count();
    let mut out = Output::new(py, &[rows.batch(), &[2, m, m]].concat())?;
    let values = out.values()?;
    let mut losses = repeated(Simulated { loss: 0.0, standard_error: 0.0 }, count)?;
    let cost = 3.0 * weigh_ns((sensors, m)) * draws.count() as f64 * count as f64;
    release(py, cost, || {
        let items = rows.iter().zip(chunks(values, 2 * m * m, count)).zip(&mut losses);
        let new = || Solver::new((sensors, m));
        for_each_row(items, cost, n_threads, new, |solver, ((s, out), loss)| {
            let (fused, excess) = out.split_at_mut(m * m);
            *loss = solver.get().simulated_excess(s, &draws.values, fused, excess)?;
            Ok(())
        })
    })
    .map_err(|failure| rows.error(failure))?;
    let column = |f: fn(&Simulated) -> f64| array(py, rows.batch(), losses.iter().map(f).collect());
    Ok((out.into_array(), column(|l| l.loss)?, column(|l| l.standard_error)?))
}

/// The covariance of the vec of a sample covariance.
#[pyfunction]
pub fn covariance_of_covariance<'py>(
    py: Python<'py>,
    covariance: &Bound<'py, PyAny>,
    factor: f64,
    n_threads: Threads,
) -> PyResult<Array<'py>> {
    let samples = Samples::extract(covariance, "covariance")?;
    let m = match samples.shape() {
        [.., rows, columns] if rows == columns && *rows > 0 => *rows,
        shape => {
            return Err(PyValueError::new_err(format!(
                "covariance has shape {shape:?}; it must be (..., m, m)"
            )));
        }
    };
    require_room((2, m))?;
    let rows = samples.blocks(2)?;
    fill(py, &rows, (2, m), &[m * m, m * m], propagate_ns((1, m)), n_threads, |solver, s, out| {
        solver.covariance_of_covariance(s, factor, out)
    })
}
