//! Bindings of `tertia::kalman`.

use crate::arrays::{
    Output, Rows, Samples, array, chunks, release, room_for, value_error, writable,
};
use crate::screening::unknown;
use numpy::{PyArrayDyn, PyReadwriteArrayDyn};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::num::NonZero;
use tertia::batch::{RowError, for_each_row};
use tertia::kalman::{
    self, Filter, Gains, Innovation, LANES, PerStep, Series, Singer, State, Steps, Summary,
    Transition, Workspace, run_block,
};

/// Cost of a step of the filter, for the choice of threads.
const FILTER_NS: f64 = 20.0;
/// Cost of a step of the smoother, likewise.
const SMOOTH_NS: f64 = 120.0;

type Array<'py> = Bound<'py, PyArrayDyn<f64>>;
type Threads = Option<NonZero<usize>>;
/// alpha, acceleration sigma, exact.
pub type Model = (f64, f64, bool);

pub fn singer((alpha, acceleration_sigma, exact): Model) -> PyResult<Singer> {
    Singer::try_new(alpha, acceleration_sigma, exact).map_err(value_error)
}

/// The elements (0, 1), (0, 2), (1, 2), (2, 2) of F, and the upper triangle of Q.
#[pyfunction]
pub fn singer_transition(model: Model, dt: f64) -> PyResult<([f64; 4], [f64; 6])> {
    let transition = singer(model)?.over(dt).map_err(value_error)?;
    Ok((transition.f, transition.q))
}

/// The gain to which a filter converges, and the upper triangle of the covariance after a plot.
#[pyfunction]
pub fn steady_state(model: Model, dt: f64, variance: f64) -> PyResult<([f64; 3], [f64; 6])> {
    kalman::steady_state(&singer(model)?, dt, variance).map_err(value_error)
}

/// Bounds of the mean of so many normalised squared errors.
#[pyfunction]
pub fn consistency_bounds(
    py: Python<'_>,
    probability: f64,
    count: usize,
    dimension: usize,
) -> PyResult<[f64; 2]> {
    py.detach(|| kalman::consistency_bounds(probability, count, dimension)).map_err(value_error)
}

/// A batch of series; `variance`, `dt` and `initial` (mean, then covariance row by row) may have a
/// single row for all.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Batch<'py> {
    z: Bound<'py, PyAny>,
    variance: Bound<'py, PyAny>,
    dt: Bound<'py, PyAny>,
    initial: Option<Bound<'py, PyAny>>,
    model: Model,
    period: Option<f64>,
}

/// The same, extracted.
struct Samplings<'py> {
    z: Samples<'py>,
    variance: Samples<'py>,
    dt: Samples<'py>,
    initial: Option<Samples<'py>>,
}

impl<'py> Batch<'py> {
    fn extract(&self) -> PyResult<Samplings<'py>> {
        let initial = self.initial.as_ref();
        Ok(Samplings {
            z: Samples::extract(&self.z, "z")?,
            variance: Samples::extract(&self.variance, "measurement_variance")?,
            dt: Samples::extract(&self.dt, "time")?,
            initial: initial.map(|value| Samples::extract(value, "initial")).transpose()?,
        })
    }
}

/// The same, contiguous.
struct Inputs<'a> {
    z: Rows<'a>,
    variance: Rows<'a>,
    dt: Rows<'a>,
    initial: Option<Rows<'a>>,
    model: Singer,
    period: Option<f64>,
}

/// Row `row`, or the only one.
pub fn shared<'a>(rows: &'a Rows<'_>, row: usize) -> &'a [f64] {
    let n = rows.len();
    let start = if rows.count() == 1 { 0 } else { row * n };
    &rows.values[start..start + n]
}

/// Whether all rows are the same; long ones are not compared.
fn is_one_row(rows: &Rows<'_>) -> bool {
    const LONGEST: usize = 12;
    rows.count() == 1 || (rows.len() <= LONGEST && rows.iter().all(|row| row == shared(rows, 0)))
}

impl<'a> Inputs<'a> {
    fn new(batch: &Batch<'_>, samplings: &'a Samplings<'_>) -> PyResult<Self> {
        let initial = samplings.initial.as_ref();
        if let Some(period) = batch.period {
            kalman::require_period(period).map_err(value_error)?;
        }
        Ok(Self {
            z: samplings.z.rows(1)?,
            variance: samplings.variance.rows(1)?,
            dt: samplings.dt.rows(0)?,
            initial: initial.map(|samples| samples.rows(12)).transpose()?,
            model: singer(batch.model)?,
            period: batch.period,
        })
    }

    fn filter(&self, row: usize) -> tertia::Result<Filter> {
        let Some(initial) = &self.initial else {
            return Ok(Filter::new(self.model.acceleration_variance(), self.period));
        };
        let (rows, _) = shared(initial, row).as_chunks::<3>();
        let state = State::try_new(rows[0], &[rows[1], rows[2], rows[3]])?;
        Ok(Filter::from_state(state, self.period))
    }

    fn series<'b>(
        &'b self,
        row: usize,
        z: &'b [f64],
        transition: PerStep<'b, Transition>,
    ) -> tertia::Result<Series<'b>> {
        let variance = match shared(&self.variance, row) {
            [single] => PerStep::Constant(*single),
            each => PerStep::Each(each),
        };
        Series::try_new(z, variance, transition)
    }

    /// The steps of row `row`.
    fn steps<'b>(
        &self,
        row: usize,
        buffer: &'b mut Vec<Transition>,
    ) -> tertia::Result<PerStep<'b, Transition>> {
        self.model.over_all(shared(&self.dt, row), buffer)
    }

    /// The gains of rows that miss no plot, if all have the same.
    fn gains(&self, steps: Option<PerStep<'_, Transition>>, filter: Filter) -> Option<Gains> {
        if self.z.count() < FEWEST_LANES || !is_one_row(&self.variance) {
            return None;
        }
        let plots = vec![0.0; self.z.len()];
        // what is wrong with them is told of the first row
        let series = self.series(0, &plots, steps?).ok()?;
        Some(Gains::new(&series, filter))
    }

    /// The steps, if all rows have the same.
    fn shared_steps<'b>(
        &self,
        buffer: &'b mut Vec<Transition>,
    ) -> PyResult<Option<PerStep<'b, Transition>>> {
        if self.dt.count() > 1 {
            return Ok(None);
        }
        self.steps(0, buffer).map(Some).map_err(value_error)
    }
}

/// What is left of a series.
#[derive(Clone, Copy)]
struct End {
    mean: [f64; 3],
    covariance: [f64; 6],
    log_likelihood: f64,
    count: usize,
}

impl End {
    const NONE: Self = Self { mean: [0.0; 3], covariance: [0.0; 6], log_likelihood: 0.0, count: 0 };

    fn new(summary: &Summary, period: Option<f64>) -> Self {
        let State { mut mean, covariance } = summary.filter.state();
        if let Some(period) = period {
            mean[0] = kalman::wrapped(mean[0], period);
        }
        let Summary { log_likelihood, count, .. } = *summary;
        Self { mean, covariance, log_likelihood, count }
    }
}

/// A series and where its results go.
struct Row<'a> {
    index: usize,
    z: &'a [f64],
    steps: Steps<'a>,
    end: End,
    failed: bool,
}

struct Task<'a> {
    inputs: &'a Inputs<'a>,
    shared_steps: Option<PerStep<'a, Transition>>,
    /// Of all rows, if it is the same.
    filter: Option<Filter>,
    gains: Option<Gains>,
}

/// Fewer rows are not worth lanes.
const FEWEST_LANES: usize = 4;

impl<'a> Task<'a> {
    fn new(inputs: &'a Inputs<'a>, shared_steps: Option<PerStep<'a, Transition>>) -> Self {
        let one_start = inputs.initial.as_ref().is_none_or(is_one_row);
        let filter = inputs.filter(0).ok().filter(|_| one_start);
        let gains = filter.and_then(|filter| inputs.gains(shared_steps, filter));
        Self { inputs, shared_steps, filter, gains }
    }

    fn filter(&self, row: usize) -> tertia::Result<Filter> {
        self.filter.map_or_else(|| self.inputs.filter(row), Ok)
    }

    /// Filters rows, side by side if there are several.
    fn run(&self, rows: &mut [Row<'_>], buffer: &mut Vec<Transition>) -> tertia::Result<()> {
        if let Some(steps) = self.shared_steps
            && rows.len() >= FEWEST_LANES
            && self.run_block(rows, steps)?
        {
            return Ok(());
        }
        for row in rows {
            self.run_one(row, buffer).inspect_err(|_| row.failed = true)?;
        }
        Ok(())
    }

    fn run_one(&self, row: &mut Row<'_>, buffer: &mut Vec<Transition>) -> tertia::Result<()> {
        let (inputs, period) = (self.inputs, self.inputs.period);
        let transition = match self.shared_steps {
            Some(steps) => steps,
            None => inputs.steps(row.index, buffer)?,
        };
        let series = inputs.series(row.index, row.z, transition)?;
        let (filter, steps) = (self.filter(row.index)?, &mut row.steps);
        let summary = series.fill(filter, steps);
        row.end = End::new(&summary, period);
        Ok(())
    }

    /// False where the rows must be filtered one by one.
    fn run_block(
        &self,
        rows: &mut [Row<'_>],
        steps: PerStep<'_, Transition>,
    ) -> tertia::Result<bool> {
        let (inputs, period) = (self.inputs, self.inputs.period);
        let mut series = Vec::with_capacity(LANES);
        let mut filters = Vec::with_capacity(LANES);
        for row in &mut *rows {
            let both = inputs
                .series(row.index, row.z, steps)
                .and_then(|series| Ok((series, self.filter(row.index)?)));
            let both = both.inspect_err(|_| row.failed = true)?;
            series.push(both.0);
            filters.push(both.1);
        }
        let mut out: Vec<_> = rows.iter_mut().map(|row| &mut row.steps).collect();
        let summaries = run_block(&series, &filters, self.gains.as_ref(), &mut out);
        let Some(summaries) = summaries else { return Ok(false) };
        for (row, summary) in rows.iter_mut().zip(&summaries) {
            row.end = End::new(summary, period);
        }
        Ok(true)
    }
}

/// What the kernel fills: means, upper triangles of covariances, innovations and their variances of
/// all steps; without steps where `store` leaves them out.
type Filled<'py> = [PyReadwriteArrayDyn<'py, f64>; 4];

/// Fills the states of all steps; returns last means and covariances, logarithms of the likelihood,
/// and numbers of innovations.
#[pyfunction]
pub fn filter_series<'py>(
    py: Python<'py>,
    batch: Batch<'py>,
    store: &str,
    filled: Filled<'py>,
    n_threads: Threads,
) -> PyResult<([Array<'py>; 3], Bound<'py, PyArrayDyn<i64>>)> {
    let samplings = batch.extract()?;
    let inputs = Inputs::new(&batch, &samplings)?;
    let (n, count) = (inputs.z.len(), inputs.z.count());
    let (many, every) = match store {
        "all" => (n, n),
        "mean" => (n, 0),
        "final" => (0, 0),
        other => return Err(unknown("store", other, "'all', 'mean' or 'final'")),
    };
    let shape = |tail: &[usize]| [inputs.z.batch(), tail].concat();
    let [mut mean, mut covariance, mut innovation, mut variance] = filled;
    let steps = chunks(writable(&mut mean, &shape(&[many, 3]), "mean")?, 3 * many, count)
        .zip(chunks(writable(&mut covariance, &shape(&[every, 6]), "upper")?, 6 * every, count))
        .zip(chunks(writable(&mut innovation, &shape(&[every]), "innovation")?, every, count))
        .zip(chunks(writable(&mut variance, &shape(&[every]), "variance")?, every, count));
    let mut rows = room_for(count)?;
    for ((index, z), (((mean, covariance), innovation), variance)) in
        inputs.z.iter().enumerate().zip(steps)
    {
        let steps = Steps { mean, covariance, innovation, variance };
        rows.push(Row { index, z, steps, end: End::NONE, failed: false });
    }
    let mut buffer = Vec::new();
    let task = Task::new(&inputs, inputs.shared_steps(&mut buffer)?);
    let cost = FILTER_NS * (n * count) as f64;
    let done = release(py, cost, || {
        for_each_row(rows.chunks_mut(LANES), cost, n_threads, Vec::new, |buffer, rows| {
            task.run(rows, buffer)
        })
    });
    done.map_err(|failure| {
        let first = failure.row * LANES;
        let row = rows[first..].iter().position(|row| row.failed).unwrap_or(0) + first;
        inputs.z.error(RowError { row, ..failure })
    })?;
    let ends: Vec<End> = rows.into_iter().map(|row| row.end).collect();
    let last = |tail: usize, of: fn(&End) -> &[f64]| {
        array(py, &shape(&[tail]), ends.iter().flat_map(of).copied().collect())
    };
    let likelihood = ends.iter().map(|end| end.log_likelihood).collect();
    let counts = ends.iter().map(|end| end.count as i64).collect();
    let arrays = [
        last(3, |end| &end.mean)?,
        last(6, |end| &end.covariance)?,
        array(py, &shape(&[]), likelihood)?,
    ];
    Ok((arrays, array(py, &shape(&[]), counts)?))
}

/// Smoothed states: means and upper triangles of covariances of all steps.
#[pyfunction]
pub fn smooth_series<'py>(
    py: Python<'py>,
    batch: Batch<'py>,
    n_threads: Threads,
) -> PyResult<(Array<'py>, Array<'py>)> {
    let samplings = batch.extract()?;
    let inputs = Inputs::new(&batch, &samplings)?;
    let (n, count, period) = (inputs.z.len(), inputs.z.count(), inputs.period);
    let mut mean = Output::new(py, &[inputs.z.shape, &[3]].concat())?;
    let mut covariance = Output::new(py, &[inputs.z.shape, &[6]].concat())?;
    let outputs =
        chunks(mean.values()?, 3 * n, count).zip(chunks(covariance.values()?, 6 * n, count));
    let cost = SMOOTH_NS * (n * count) as f64;
    let mut buffer = Vec::new();
    let shared_steps = inputs.shared_steps(&mut buffer)?;
    release(py, cost, || {
        let items = inputs.z.iter().enumerate().zip(outputs);
        let new = || (Vec::new(), Workspace::default());
        for_each_row(items, cost, n_threads, new, |(buffer, workspace), ((row, z), out)| {
            let transition = match shared_steps {
                Some(steps) => steps,
                None => inputs.steps(row, buffer)?,
            };
            let series = inputs.series(row, z, transition)?;
            let (mean, covariance) = out;
            kalman::smooth(&series, inputs.filter(row)?, workspace, |step, state| {
                mean[3 * step..][..3].copy_from_slice(&state.mean);
                if let Some(period) = period {
                    mean[3 * step] = kalman::wrapped(state.mean[0], period);
                }
                covariance[6 * step..][..6].copy_from_slice(&state.covariance);
            });
            Ok(())
        })
    })
    .map_err(|failure| inputs.z.error(failure))?;
    Ok((mean.into_array(), covariance.into_array()))
}

/// What is taken from a `SingerModel`.
#[derive(FromPyObject)]
struct Attributes {
    dt: f64,
    alpha: f64,
    acceleration_sigma: f64,
    exact: bool,
}

/// The model of a `SingerModel`, and its step.
pub fn extract_model(model: &Bound<'_, PyAny>) -> PyResult<(Singer, Transition)> {
    let attributes: Attributes = model.extract().map_err(|_| {
        PyTypeError::new_err(format!("model is {model:?}; it must be a SingerModel"))
    })?;
    let Attributes { dt, alpha, acceleration_sigma, exact } = attributes;
    let singer = singer((alpha, acceleration_sigma, exact))?;
    Ok((singer, singer.over(dt).map_err(value_error)?))
}

/// A filter that is fed plot by plot, for embedding.
///
/// It can be pickled and copied; a step that fails leaves it as it was.
///
/// Parameters
/// ----------
/// model : SingerModel
///     How the target moves; `model.dt` is the time of a step unless another is given.
/// measurement_variance : float
///     Variance of a plot's noise, unless another is given with the plot.
/// period : float, optional
///     360.0 for degrees, 2*pi for radians; None for data that do not wrap.
///
/// Attributes
/// ----------
/// angle : float
///     In [0, period) if there is a period; nan before the first plot.
/// mean : ndarray of shape (3,)
///     Angle, rate and acceleration.
/// covariance : ndarray of shape (3, 3)
///     inf where something is unknown.
/// innovation, innovation_variance : float
///     Of the last plot; nan if there was none, or nothing to predict it from.
///
/// Raises
/// ------
/// ValueError
///     A number outside its domain: a plot that is infinite, a variance that is not positive, a
///     negative time.
/// TypeError
///     An argument of the wrong type.
///
/// Examples
/// --------
/// >>> from tertia.kalman import AngleFilter, SingerModel
/// >>> track = AngleFilter(SingerModel(5.0, 0.05, 0.003), 0.01, period=360.0)
/// >>> for plot in [359.1, 359.8, float("nan"), 1.1]:
/// ...     angle = track.step(plot)
/// >>> round(angle, 2)
/// 1.11
#[pyclass(module = "tertia.kalman")]
pub struct AngleFilter {
    /// As given, for the pickle.
    given: Py<PyAny>,
    singer: Singer,
    variance: f64,
    period: Option<f64>,
    /// Over `dt`.
    transition: Transition,
    filter: Filter,
    innovation: Innovation,
}

/// What is pickled besides the arguments: the filter, innovation and its variance.
type Saved = (Vec<f64>, f64, f64);
type NewArguments<'py> = ((Py<PyAny>, f64), Bound<'py, PyDict>);

impl AngleFilter {
    fn over(&self, dt: Option<f64>) -> PyResult<Transition> {
        match dt {
            None => Ok(self.transition),
            Some(dt) => self.singer.over(dt).map_err(value_error),
        }
    }

    /// The filter and its innovation after a plot.
    fn after(
        &self,
        mut filter: Filter,
        z: f64,
        variance: Option<f64>,
    ) -> PyResult<(Filter, Innovation)> {
        if z.is_nan() {
            return Ok((filter, Innovation::NONE));
        }
        let r = variance.unwrap_or(self.variance);
        kalman::require_plot(z, r).map_err(value_error)?;
        let innovation = filter.update(z, r).unwrap_or(Innovation::NONE);
        Ok((filter, innovation))
    }

    fn angle_of(&self, state: &State) -> f64 {
        self.period.map_or(state.mean[0], |period| kalman::wrapped(state.mean[0], period))
    }
}

#[pymethods]
impl AngleFilter {
    #[new]
    #[pyo3(signature = (model, measurement_variance, *, period=None))]
    fn new(
        model: Bound<'_, PyAny>,
        measurement_variance: f64,
        period: Option<f64>,
    ) -> PyResult<Self> {
        let (singer, transition) = extract_model(&model)?;
        kalman::require_plot(0.0, measurement_variance).map_err(value_error)?;
        if let Some(period) = period {
            kalman::require_period(period).map_err(value_error)?;
        }
        Ok(Self {
            given: model.unbind(),
            singer,
            variance: measurement_variance,
            period,
            transition,
            filter: Filter::new(singer.acceleration_variance(), period),
            innovation: Innovation::NONE,
        })
    }

    /// Go on in time by `dt`, by default that of the model.
    #[pyo3(signature = (dt=None))]
    fn predict(&mut self, dt: Option<f64>) -> PyResult<()> {
        let transition = self.over(dt)?;
        self.filter.predict(&transition);
        self.innovation = Innovation::NONE;
        Ok(())
    }

    /// Take in a plot (nan: none) and return the angle.
    #[pyo3(signature = (z, measurement_variance=None))]
    fn update(&mut self, z: f64, measurement_variance: Option<f64>) -> PyResult<f64> {
        (self.filter, self.innovation) = self.after(self.filter, z, measurement_variance)?;
        Ok(self.angle())
    }

    /// Go on in time by `dt`, take in a plot (nan: none) and return the angle.
    #[pyo3(signature = (z, measurement_variance=None, dt=None))]
    fn step(
        &mut self,
        z: f64,
        measurement_variance: Option<f64>,
        dt: Option<f64>,
    ) -> PyResult<f64> {
        let mut filter = self.filter;
        filter.predict(&self.over(dt)?);
        (self.filter, self.innovation) = self.after(filter, z, measurement_variance)?;
        Ok(self.angle())
    }

    /// Start again from a mean, of shape (3,), and a covariance, of shape (3, 3).
    fn set_state(&mut self, mean: [f64; 3], covariance: [[f64; 3]; 3]) -> PyResult<()> {
        let state = State::try_new(mean, &covariance).map_err(value_error)?;
        self.filter = Filter::from_state(state, self.period);
        self.innovation = Innovation::NONE;
        Ok(())
    }

    #[getter]
    fn angle(&self) -> f64 {
        self.angle_of(&self.filter.state())
    }

    #[getter]
    fn mean<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        let state = self.filter.state();
        array(py, &[3], vec![self.angle_of(&state), state.mean[1], state.mean[2]])
    }

    #[getter]
    fn covariance<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        let [p00, p01, p02, p11, p12, p22] = self.filter.state().covariance;
        array(py, &[3, 3], vec![p00, p01, p02, p01, p11, p12, p02, p12, p22])
    }

    #[getter]
    fn innovation(&self) -> f64 {
        self.innovation.value
    }

    #[getter]
    fn innovation_variance(&self) -> f64 {
        self.innovation.variance
    }

    fn __getnewargs_ex__<'py>(&self, py: Python<'py>) -> PyResult<NewArguments<'py>> {
        let options = PyDict::new(py);
        options.set_item("period", self.period)?;
        Ok(((self.given.clone_ref(py), self.variance), options))
    }

    fn __getstate__(&self) -> Saved {
        (self.filter.saved(), self.innovation.value, self.innovation.variance)
    }

    fn __setstate__(&mut self, state: Saved) -> PyResult<()> {
        let (saved, value, variance) = state;
        let refuse = || PyValueError::new_err("this is not the state of an AngleFilter");
        self.filter = self.filter.restored(&saved).ok_or_else(refuse)?;
        self.innovation = Innovation { value, variance };
        Ok(())
    }
}
