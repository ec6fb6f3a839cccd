//! Bindings of `tertia::kalman`.

use crate::arrays::{
    Array, Input, Integers, Marks, Output, Rows, Threads, array, choice, chunks, release, room_for,
    symmetric, value_error, writable,
};
use numpy::PyReadwriteArrayDyn;
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use tertia::batch::RowError;
use tertia::kalman::{
    self, End, Filter, Innovation, NoiseFit, Recording, Row, Singer, State, Steps, Table,
    Transition,
};

/// Cost of a step of the filter, which determines the number of threads.
const FILTER_NS: f64 = 20.0;
/// Cost of a step of the smoother, which determines the number of threads.
const SMOOTH_NS: f64 = 120.0;

/// Parameters taken from a `SingerModel`.
#[derive(Clone, Copy, FromPyObject)]
pub struct Model {
    dt: f64,
    alpha: f64,
    acceleration_sigma: f64,
    exact: bool,
}

pub fn singer(model: Model) -> PyResult<Singer> {
    Singer::try_new(model.alpha, model.acceleration_sigma, model.exact).map_err(value_error)
}

/// Returns the step over `dt`, or the usual step.
pub fn over(dt: Option<f64>, singer: &Singer, usual: Transition) -> PyResult<Transition> {
    dt.map_or(Ok(usual), |dt| singer.over(dt).map_err(value_error))
}

/// The elements (0, 1), (0, 2), (1, 2), (2, 2) of F, and the upper triangle of Q.
#[pyfunction]
pub fn singer_transition(model: Model, dt: f64) -> PyResult<([f64; 4], [f64; 6])> {
    let transition = singer(model)?.over(dt).map_err(value_error)?;
    Ok((transition.f, transition.q))
}

/// The gain to which a filter converges, and the upper triangle of the covariance after a plot.
#[pyfunction]
pub fn steady_state(model: Model, variance: f64) -> PyResult<([f64; 3], [f64; 6])> {
    kalman::steady_state(&singer(model)?, model.dt, variance).map_err(value_error)
}

/// Bounds of the mean of this number of normalised squared errors.
#[pyfunction]
pub fn consistency_bounds(
    py: Python<'_>,
    probability: f64,
    count: usize,
    dimension: usize,
) -> PyResult<[f64; 2]> {
    release(py, 1e4, || kalman::consistency_bounds(probability, count, dimension))?
        .map_err(value_error)
}

/// A batch of series; `variance`, `dt` and `initial` (mean, then covariance row by row) may have a
/// single row for all series.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Batch<'py> {
    z: Input<'py>,
    variance: Input<'py>,
    dt: Input<'py>,
    initial: Option<Input<'py>>,
    model: Model,
    period: Option<f64>,
}

impl Batch<'_> {
    /// Returns the rows, contiguous.
    fn rows(&self) -> PyResult<Inputs<'_>> {
        let initial = self.initial.as_ref();
        Ok(Inputs {
            z: self.z.rows("z", 1)?,
            variance: self.variance.rows("measurement_variance", 1)?,
            dt: self.dt.rows("time", 0)?,
            initial: initial.map(|initial| initial.rows("initial", 12)).transpose()?,
        })
    }
}

struct Inputs<'a> {
    z: Rows<'a>,
    variance: Rows<'a>,
    dt: Rows<'a>,
    initial: Option<Rows<'a>>,
}

impl Inputs<'_> {
    fn batch(&self, model: Model, period: Option<f64>) -> PyResult<kalman::Batch<'_>> {
        let z = (&*self.z.values, self.z.len(), self.z.count());
        let initial = self.initial.as_ref().map(table);
        let (variance, dt, model) = (table(&self.variance), table(&self.dt), singer(model)?);
        kalman::Batch::try_new(z, variance, dt, initial, model, period).map_err(value_error)
    }
}

fn table<'a>(rows: &'a Rows<'_>) -> Table<'a> {
    Table::new(&rows.values, rows.len())
}

/// Arrays that the kernel fills: means, upper triangles of covariances, innovations and their variances for
/// all steps; those that `store` leaves out have no steps.
type Filled<'py> = [PyReadwriteArrayDyn<'py, f64>; 4];

/// Fills the states of all steps; returns the last means and covariances, the log-likelihoods,
/// and the numbers of innovations.
#[pyfunction]
pub fn filter_series<'py>(
    py: Python<'py>,
    batch: Batch<'py>,
    store: &str,
    filled: Filled<'py>,
    n_threads: Threads,
) -> PyResult<([Array<'py>; 3], Integers<'py>)> {
    let inputs = batch.rows()?;
    let series = inputs.batch(batch.model, batch.period)?;
    let (n, count) = (inputs.z.len(), inputs.z.count());
    let (many, every) =
        choice("store", store, &[("all", (n, n)), ("mean", (n, 0)), ("final", (0, 0))])?;
    let shape = |tail: &[usize]| [inputs.z.batch(), tail].concat();
    let [mut mean, mut covariance, mut innovation, mut variance] = filled;
    let steps = chunks(writable(&mut mean, &shape(&[many, 3]), "mean")?, 3 * many, count)
        .zip(chunks(writable(&mut covariance, &shape(&[every, 6]), "upper")?, 6 * every, count))
        .zip(chunks(writable(&mut innovation, &shape(&[every]), "innovation")?, every, count))
        .zip(chunks(writable(&mut variance, &shape(&[every]), "variance")?, every, count));
    let mut rows = room_for(count)?;
    rows.extend(steps.map(|(((mean, covariance), innovation), variance)| {
        let steps = Steps { mean, covariance, innovation, variance };
        Row { steps, end: End::NONE }
    }));
    let cost = FILTER_NS * inputs.z.size();
    release(py, cost, || series.filter(&mut rows, cost, n_threads))?
        .map_err(|failure| inputs.z.error(failure))?;
    let ends = || rows.iter().map(|row| &row.end);
    let mean: Vec<_> = ends().map(|end| end.mean).collect();
    let covariance: Vec<_> = ends().map(|end| end.covariance).collect();
    let last = [
        array(py, &shape(&[3]), mean.into_flattened())?,
        array(py, &shape(&[6]), covariance.into_flattened())?,
        array(py, inputs.z.batch(), ends().map(|end| end.log_likelihood))?,
    ];
    Ok((last, array(py, inputs.z.batch(), ends().map(|end| end.count as i64))?))
}

/// Smoothed states: means and upper triangles of covariances for all steps.
#[pyfunction]
pub fn smooth_series<'py>(
    py: Python<'py>,
    batch: Batch<'py>,
    n_threads: Threads,
) -> PyResult<(Output<'py>, Output<'py>)> {
    let inputs = batch.rows()?;
    let series = inputs.batch(batch.model, batch.period)?;
    let new = |size| Output::new(py, inputs.z.batch(), &[inputs.z.len(), size]);
    let (mut mean, mut covariance) = (new(3)?, new(6)?);
    let rows = mean.rows()?.zip(covariance.rows()?);
    let cost = SMOOTH_NS * inputs.z.size();
    release(py, cost, || series.smooth(rows, cost, n_threads))?
        .map_err(|failure| inputs.z.error(failure))?;
    Ok((mean, covariance))
}

/// Alpha, acceleration sigma and sigma of the plots; their sigmas; sigma of the density; log-likelihood,
/// number of innovations, and names of the parameters at a limit.
type Fit = ([f64; 3], [f64; 3], f64, f64, usize, Vec<&'static str>);

/// Noise and motion model estimated from a recording, and which of its plots were left out. `dt` may be one
/// number, or one row for all.
#[pyfunction]
pub fn fit_noise<'py>(
    py: Python<'py>,
    z: Input<'py>,
    dt: Input<'py>,
    period: Option<f64>,
    outlier_gate: Option<f64>,
    n_threads: Threads,
) -> PyResult<(Fit, Marks<'py>)> {
    let (z, dt) = (z.rows("z", 1)?, dt.rows("time", 0)?);
    for (row, plots) in z.iter().enumerate() {
        kalman::require_plots(plots).map_err(|error| z.error(RowError { row, error }))?;
    }
    let recording = Recording { z: &z.values, steps: z.len(), dt: table(&dt), period };
    let (fit, outlier) =
        release(py, f64::INFINITY, || kalman::fit_noise(&recording, outlier_gate, n_threads))?
            .map_err(value_error)?;
    let limits = fit.limits.iter().map(|limit| limit.name()).collect();
    let NoiseFit { estimates, sigma, density_sigma, log_likelihood, count, .. } = fit;
    let found = (estimates, sigma, density_sigma, log_likelihood, count, limits);
    Ok((found, array(py, z.shape, outlier)?))
}

/// Returns an error if a period is given that is invalid.
pub fn check_period(period: Option<f64>) -> PyResult<()> {
    period.map_or(Ok(()), kalman::require_period).map_err(value_error)
}

/// Returns the model of a `SingerModel`, and its step.
pub fn extract_model(model: &Bound<'_, PyAny>) -> PyResult<(Singer, Transition)> {
    let model: Model = model.extract().map_err(|_| {
        PyTypeError::new_err(format!("model is {model:?}; it must be a SingerModel"))
    })?;
    let singer = singer(model)?;
    Ok((singer, singer.over(model.dt).map_err(value_error)?))
}

/// A filter that is updated plot by plot, for embedding.
///
/// It can be pickled and copied; a step that fails does not change it.
///
/// Parameters
/// ----------
/// model : SingerModel
///     Model of the target's motion; `model.dt` is the time of a step unless another is given.
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
///     Covariance of `mean`; inf for unknown components.
/// innovation, innovation_variance : float
///     Innovation of the last plot; nan if there was no plot, or nothing to predict it from.
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
    /// The model as given, for pickling.
    given: Py<PyAny>,
    singer: Singer,
    variance: f64,
    period: Option<f64>,
    /// The transition over `dt`.
    transition: Transition,
    filter: Filter,
    innovation: Innovation,
}

/// Pickled in addition to the arguments: the filter, the innovation and its variance.
type Saved = (Vec<f64>, f64, f64);
type NewArguments<'py> = ((Py<PyAny>, f64), Bound<'py, PyDict>);

impl AngleFilter {
    /// Returns the filter and its innovation after a plot.
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
        check_period(period)?;
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

    /// Predict the state after `dt`, by default the time step of the model.
    #[pyo3(signature = (dt=None))]
    fn predict(&mut self, dt: Option<f64>) -> PyResult<()> {
        let transition = over(dt, &self.singer, self.transition)?;
        self.filter.predict(&transition);
        self.innovation = Innovation::NONE;
        Ok(())
    }

    /// Update the filter with a plot (nan: none) and return the angle.
    #[pyo3(signature = (z, measurement_variance=None))]
    fn update(&mut self, z: f64, measurement_variance: Option<f64>) -> PyResult<f64> {
        (self.filter, self.innovation) = self.after(self.filter, z, measurement_variance)?;
        Ok(self.angle())
    }

    /// Predict the state after `dt`, update it with a plot (nan: none) and return the angle.
    #[pyo3(signature = (z, measurement_variance=None, dt=None))]
    fn step(
        &mut self,
        z: f64,
        measurement_variance: Option<f64>,
        dt: Option<f64>,
    ) -> PyResult<f64> {
        let mut filter = self.filter;
        filter.predict(&over(dt, &self.singer, self.transition)?);
        (self.filter, self.innovation) = self.after(filter, z, measurement_variance)?;
        Ok(self.angle())
    }

    /// Restart from a mean, of shape (3,), and a covariance, of shape (3, 3).
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
        array(py, &[3], [self.angle_of(&state), state.mean[1], state.mean[2]])
    }

    #[getter]
    fn covariance<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        symmetric(py, self.filter.state().covariance)
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
