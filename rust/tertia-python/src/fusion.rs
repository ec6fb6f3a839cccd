//! Bindings of `tertia::fusion`.

use crate::arrays::{Output, Rows, Samples, array, chunks, release, value_error};
use crate::kalman::{Model, extract_model, shared, singer};
use crate::screening::unknown;
use numpy::PyArrayDyn;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::num::NonZero;
use tertia::batch::for_each_row;
use tertia::fusion::{Beliefs, Centre, RadarReport, Rule};
use tertia::kalman::{
    self, Filter, Innovation, PerStep, Series, Singer, State, Transition, wrapped,
};

/// Cost of a step for one radar, for the choice of threads.
const FUSE_NS: f64 = 300.0;
/// The same of the rule that follows hypotheses.
const ROBUST_NS: f64 = 1200.0;

const VARIANCE: &str = "measurement_variance";
/// What it must be.
const POSITIVE: &str = "it must be a positive number from 1e-100 to 1e100";

type Array<'py> = Bound<'py, PyArrayDyn<f64>>;

fn rule(name: &str) -> PyResult<Rule> {
    Ok(match name {
        "equal" => Rule::Equal,
        "static" => Rule::Static,
        "paper" => Rule::Paper,
        "ewma" => Rule::Ewma,
        "posterior" => Rule::Posterior,
        "adaptive" => Rule::Adaptive,
        "matrix" => Rule::Matrix,
        "nominal-matrix" => Rule::NominalMatrix,
        "covariance-intersection" => Rule::CovarianceIntersection,
        "central" => Rule::Central,
        "robust" => Rule::Robust,
        other => {
            let choices = "'robust', 'adaptive', 'matrix', 'central', 'posterior', 'nominal-matrix', \
                           'covariance-intersection', 'ewma', 'static', 'equal' or 'paper'";
            return Err(unknown("method", other, choices));
        }
    })
}

/// Series of several radars (..., K, steps); `variance` (one radar for all or K, and then one or all
/// steps), `dt` and `initial` (one state for all or K: mean, then covariance row by row) may have a
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
    method: String,
    memory: f64,
    threshold: f64,
    outlier_gate: f64,
    change: f64,
}

/// What every row is fused with.
struct Task<'a> {
    variance: Rows<'a>,
    dt: Rows<'a>,
    initial: Option<Rows<'a>>,
    model: Singer,
    period: Option<f64>,
    rule: Rule,
    beliefs: Beliefs,
    /// One radar's for all, or those of each.
    variance_rows: usize,
    radars: usize,
    steps: usize,
}

/// Where the results of a row go.
struct Results<'a> {
    mean: &'a mut [f64],
    covariance: &'a mut [f64],
    weight: &'a mut [f64],
    noise: &'a mut [f64],
    innovation: &'a mut [f64],
    variance: &'a mut [f64],
    outlier: &'a mut [bool],
}

/// Buffers of a thread.
#[derive(Default)]
struct Buffers {
    transitions: Vec<Transition>,
    z: Vec<f64>,
    r: Vec<f64>,
    reports: Vec<RadarReport>,
}

impl Task<'_> {
    fn filters(&self, row: usize) -> tertia::Result<Vec<Filter>> {
        let Some(initial) = &self.initial else {
            let filter = Filter::new(self.model.acceleration_variance(), self.period);
            return Ok(vec![filter; self.radars]);
        };
        let (states, _) = shared(initial, row).as_chunks::<12>();
        let filter = |numbers: &[f64; 12]| {
            let (rows, _) = numbers.as_chunks::<3>();
            let state = State::try_new(rows[0], &[rows[1], rows[2], rows[3]])?;
            Ok(Filter::from_state(state, self.period))
        };
        if let [common] = states {
            return Ok(vec![filter(common)?; self.radars]);
        }
        let of_radar = |(radar, numbers)| filter(numbers).map_err(|error| error.within(radar));
        states.iter().enumerate().map(of_radar).collect()
    }

    /// The row of the variances that is a radar's.
    fn variance_row(&self, radar: usize) -> usize {
        if self.variance_rows == 1 { 0 } else { radar }
    }

    /// What is wrong with a radar's series, with the place where the caller has it.
    fn of_radar(&self, radar: usize, error: tertia::Error) -> tertia::Error {
        match error {
            tertia::Error::InvalidParameter { argument, value, .. } if self.variance_rows > 1 => {
                let index = vec![radar, 0];
                tertia::Error::InvalidElement { argument, index, value, requirement: POSITIVE }
            }
            tertia::Error::InvalidMeasurement { argument: VARIANCE, .. } => {
                error.within(self.variance_row(radar))
            }
            other => other.within(radar),
        }
    }

    fn run(
        &self,
        row: usize,
        plots: &[f64],
        out: &mut Results<'_>,
        buffers: &mut Buffers,
    ) -> tertia::Result<()> {
        let (radars, n) = (self.radars, self.steps);
        let Buffers { transitions, z, r, reports } = buffers;
        let transition = self.model.over_all(shared(&self.dt, row), transitions)?;
        let variances = shared(&self.variance, row);
        let length = variances.len() / self.variance_rows;
        let variance =
            |radar: usize| match &variances[self.variance_row(radar) * length..][..length] {
                [single] => PerStep::Constant(*single),
                each => PerStep::Each(each),
            };
        for radar in 0..radars {
            Series::try_new(&plots[radar * n..][..n], variance(radar), transition)
                .map_err(|error| self.of_radar(radar, error))?;
        }
        let mut centre = Centre::new(self.filters(row)?, self.rule, self.beliefs, self.period);
        for step in 0..n {
            z.clear();
            z.extend((0..radars).map(|radar| plots[radar * n + step]));
            r.clear();
            r.extend((0..radars).map(|radar| variance(radar).at(step)));
            if step > 0 {
                centre.predict(&transition.at(step - 1));
            }
            reports.clear();
            reports.resize(radars, RadarReport::NONE);
            let mut state = centre.update(z, r, reports);
            if let Some(period) = self.period {
                state.mean[0] = wrapped(state.mean[0], period);
            }
            out.mean[3 * step..][..3].copy_from_slice(&state.mean);
            out.covariance[6 * step..][..6].copy_from_slice(&state.covariance);
            for (radar, report) in reports.iter().enumerate() {
                let at = radar * n + step;
                let Innovation { value, variance } = report.innovation;
                out.weight[3 * at..][..3].copy_from_slice(&report.weight);
                (out.noise[at], out.innovation[at]) = (report.noise, value);
                (out.variance[at], out.outlier[at]) = (variance, report.outlier);
            }
        }
        Ok(())
    }
}

/// Fused means (..., steps, 3) and upper triangles of covariances (..., steps, 6); weights
/// (..., K, steps, 3), believed noise, innovations and their variances (..., K, steps); and which
/// plots are outliers.
#[pyfunction]
pub fn fuse_series<'py>(
    py: Python<'py>,
    batch: Batch<'py>,
    n_threads: Option<NonZero<usize>>,
) -> PyResult<([Array<'py>; 6], Bound<'py, PyArrayDyn<bool>>)> {
    let z = Samples::extract(&batch.z, "z")?;
    let variance = Samples::extract(&batch.variance, VARIANCE)?;
    let dt = Samples::extract(&batch.dt, "times")?;
    let initial = batch.initial.as_ref();
    let initial = initial.map(|value| Samples::extract(value, "initial")).transpose()?;
    if let Some(period) = batch.period {
        kalman::require_period(period).map_err(value_error)?;
    }
    let &[.., radars, n] = z.shape() else {
        return Err(PyValueError::new_err("z must be of shape (..., K, steps)"));
    };
    let task = Task {
        variance: variance.blocks(2)?,
        dt: dt.rows(0)?,
        initial: initial.as_ref().map(|samples| samples.blocks(2)).transpose()?,
        model: singer(batch.model)?,
        period: batch.period,
        rule: rule(&batch.method)?,
        beliefs: Beliefs::try_new(batch.memory, batch.threshold, batch.outlier_gate, batch.change)
            .map_err(value_error)?,
        variance_rows: variance.shape()[variance.shape().len() - 2],
        radars,
        steps: n,
    };
    let rows = z.blocks(2)?;
    let count = rows.count();
    let new = |tail: &[usize]| Output::new(py, &[rows.batch(), tail].concat());
    let (mut mean, mut covariance) = (new(&[n, 3])?, new(&[n, 6])?);
    let (mut weight, mut noise) = (new(&[radars, n, 3])?, new(&[radars, n])?);
    let (mut innovation, mut spread) = (new(&[radars, n])?, new(&[radars, n])?);
    let mut outlier = Output::new(py, rows.shape)?;
    let size = radars * n;
    let outputs = chunks(mean.values()?, 3 * n, count)
        .zip(chunks(covariance.values()?, 6 * n, count))
        .zip(chunks(weight.values()?, 3 * size, count))
        .zip(chunks(noise.values()?, size, count))
        .zip(chunks(innovation.values()?, size, count))
        .zip(chunks(spread.values()?, size, count))
        .zip(chunks(outlier.values()?, size, count))
        .map(|((((((mean, covariance), weight), noise), innovation), variance), outlier)| {
            Results { mean, covariance, weight, noise, innovation, variance, outlier }
        });
    let of_step = if task.rule == Rule::Robust { ROBUST_NS } else { FUSE_NS };
    let cost = of_step * (size * count) as f64;
    release(py, cost, || {
        let items = rows.iter().enumerate().zip(outputs);
        for_each_row(items, cost, n_threads, Buffers::default, |buffers, ((row, z), mut out)| {
            task.run(row, z, &mut out, buffers)
        })
    })
    .map_err(|failure| rows.error(failure))?;
    let arrays = [mean, covariance, weight, noise, innovation, spread].map(Output::into_array);
    Ok((arrays, outlier.into_array()))
}

/// A centre that is fed scan by scan with the plots of several radars, for embedding.
///
/// It can be pickled and copied; a step that fails leaves it as it was.
///
/// Parameters
/// ----------
/// model : SingerModel
///     How the target moves; `model.dt` is the time of a step unless another is given.
/// measurement_variance : sequence of K floats
///     Variance of each radar's noise, unless others are given with the plots.
/// method, period, change, memory, threshold, outlier_gate
///     See `fuse_series`.
///
/// Attributes
/// ----------
/// angle : float
///     The fused angle, in [0, period) if there is a period; nan before the first plot.
/// mean : ndarray of shape (3,)
///     Angle, rate and acceleration.
/// covariance : ndarray of shape (3, 3)
///     inf where something is unknown.
/// weights : ndarray of shape (K, 3)
///     Of each radar in angle, rate and acceleration.
/// noise_variance : ndarray of shape (K,)
///     Of each radar, as now believed.
/// innovation, innovation_variance : ndarray of shape (K,)
///     Of the radars' own filters.
/// outlier : list of K bools
///     Whose last plot was an outlier.
///
/// Raises
/// ------
/// ValueError
///     A number outside its domain, or not one number per radar.
/// TypeError
///     An argument of the wrong type.
///
/// Examples
/// --------
/// >>> from tertia.fusion import TrackFusion
/// >>> from tertia.kalman import SingerModel
/// >>> centre = TrackFusion(SingerModel(5.0, 0.05, 0.003), [0.01, 0.04], period=360.0)
/// >>> for plots in [(359.1, 359.2), (359.8, float("nan")), (0.4, 0.5)]:
/// ...     angle = centre.step(plots)
/// >>> round(angle, 2)
/// 0.44
#[pyclass(module = "tertia.fusion")]
pub struct TrackFusion {
    /// As given, for the pickle.
    given: Py<PyAny>,
    method: String,
    parameters: [f64; 4],
    singer: Singer,
    transition: Transition,
    variances: Vec<f64>,
    period: Option<f64>,
    centre: Centre,
    state: State,
    reports: Vec<RadarReport>,
}

/// What is pickled besides the arguments: the centre, the state and the reports.
type Saved = (Vec<Vec<f64>>, ([f64; 3], [f64; 6]), Vec<(f64, f64, f64, bool, [f64; 3])>);
type NewArguments<'py> = ((Py<PyAny>, Vec<f64>), Bound<'py, PyDict>);

/// What is wrong with a radar's plot or its variance, with the place where the caller has it.
fn of_plot(radar: usize, error: tertia::Error) -> tertia::Error {
    let tertia::Error::InvalidParameter { argument, value, .. } = error else { return error };
    let (argument, requirement) = match argument {
        VARIANCE => (VARIANCE, POSITIVE),
        _ => ("plots", "it must be a finite number, or nan for no plot"),
    };
    tertia::Error::InvalidElement { argument, index: vec![radar], value, requirement }
}

impl TrackFusion {
    fn over(&self, dt: Option<f64>) -> PyResult<Transition> {
        match dt {
            None => Ok(self.transition),
            Some(dt) => self.singer.over(dt).map_err(value_error),
        }
    }

    /// The variances of plots that can be used.
    fn checked(&self, plots: &[f64], variances: Option<Vec<f64>>) -> PyResult<Vec<f64>> {
        let variances = variances.unwrap_or_else(|| self.variances.clone());
        let radars = self.variances.len();
        for (name, count) in [("plots", plots.len()), ("measurement_variance", variances.len())] {
            if count != radars {
                return Err(PyValueError::new_err(format!(
                    "{name} has {count} numbers; it must be one for each of {radars} radars"
                )));
            }
        }
        for (radar, (&z, &r)) in plots.iter().zip(&variances).enumerate() {
            let z = if z.is_nan() { 0.0 } else { z };
            kalman::require_plot(z, r).map_err(|error| value_error(of_plot(radar, error)))?;
        }
        Ok(variances)
    }

    fn take(&mut self, plots: &[f64], variances: &[f64]) -> f64 {
        self.state = self.centre.update(plots, variances, &mut self.reports);
        if let Some(period) = self.period {
            self.state.mean[0] = wrapped(self.state.mean[0], period);
        }
        self.state.mean[0]
    }

    fn column<'py>(&self, py: Python<'py>, of: fn(&RadarReport) -> f64) -> PyResult<Array<'py>> {
        array(py, &[self.reports.len()], self.reports.iter().map(of).collect())
    }
}

#[pymethods]
impl TrackFusion {
    #[new]
    #[pyo3(signature = (
        model, measurement_variance, *, method="robust", period=None, change=0.005,
        memory=0.1, threshold=1.6, outlier_gate=16.0
    ))]
    #[allow(clippy::too_many_arguments)] // the Python signature
    fn new(
        model: Bound<'_, PyAny>,
        measurement_variance: Vec<f64>,
        method: &str,
        period: Option<f64>,
        change: f64,
        memory: f64,
        threshold: f64,
        outlier_gate: f64,
    ) -> PyResult<Self> {
        let (singer, transition) = extract_model(&model)?;
        if measurement_variance.is_empty() {
            return Err(PyValueError::new_err(
                "measurement_variance is empty; it must be K numbers",
            ));
        }
        for (radar, &r) in measurement_variance.iter().enumerate() {
            kalman::require_plot(0.0, r).map_err(|error| value_error(of_plot(radar, error)))?;
        }
        if let Some(period) = period {
            kalman::require_period(period).map_err(value_error)?;
        }
        let beliefs =
            Beliefs::try_new(memory, threshold, outlier_gate, change).map_err(value_error)?;
        let radars = measurement_variance.len();
        let filter = Filter::new(singer.acceleration_variance(), period);
        let filters = std::iter::repeat_n(filter, radars);
        Ok(Self {
            given: model.unbind(),
            parameters: [change, memory, threshold, outlier_gate],
            singer,
            transition,
            variances: measurement_variance,
            period,
            centre: Centre::new(filters, rule(method)?, beliefs, period),
            method: method.to_owned(),
            state: State::UNKNOWN,
            reports: vec![RadarReport::NONE; radars],
        })
    }

    /// Go on in time by `dt`, by default that of the model.
    #[pyo3(signature = (dt=None))]
    fn predict(&mut self, dt: Option<f64>) -> PyResult<()> {
        let none = vec![f64::NAN; self.variances.len()];
        self.step(none, None, dt).map(|_| ())
    }

    /// Take in plots of the same time (nan: none), one per radar, and return the fused angle.
    #[pyo3(signature = (plots, measurement_variance=None))]
    fn update(&mut self, plots: Vec<f64>, measurement_variance: Option<Vec<f64>>) -> PyResult<f64> {
        let variances = self.checked(&plots, measurement_variance)?;
        Ok(self.take(&plots, &variances))
    }

    /// Go on in time by `dt`, take in plots (nan: none), and return the fused angle.
    #[pyo3(signature = (plots, measurement_variance=None, dt=None))]
    fn step(
        &mut self,
        plots: Vec<f64>,
        measurement_variance: Option<Vec<f64>>,
        dt: Option<f64>,
    ) -> PyResult<f64> {
        let variances = self.checked(&plots, measurement_variance)?;
        let transition = self.over(dt)?;
        self.centre.predict(&transition);
        Ok(self.take(&plots, &variances))
    }

    #[getter]
    fn angle(&self) -> f64 {
        self.state.mean[0]
    }

    #[getter]
    fn mean<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        array(py, &[3], self.state.mean.to_vec())
    }

    #[getter]
    fn covariance<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        let [p00, p01, p02, p11, p12, p22] = self.state.covariance;
        array(py, &[3, 3], vec![p00, p01, p02, p01, p11, p12, p02, p12, p22])
    }

    #[getter]
    fn weights<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        let weights = self.reports.iter().flat_map(|report| report.weight).collect();
        array(py, &[self.reports.len(), 3], weights)
    }

    #[getter]
    fn noise_variance<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        self.column(py, |report| report.noise)
    }

    #[getter]
    fn innovation<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        self.column(py, |report| report.innovation.value)
    }

    #[getter]
    fn innovation_variance<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        self.column(py, |report| report.innovation.variance)
    }

    #[getter]
    fn outlier(&self) -> Vec<bool> {
        self.reports.iter().map(|report| report.outlier).collect()
    }

    fn __getnewargs_ex__<'py>(&self, py: Python<'py>) -> PyResult<NewArguments<'py>> {
        let options = PyDict::new(py);
        options.set_item("method", &self.method)?;
        options.set_item("period", self.period)?;
        let [change, memory, threshold, outlier_gate] = self.parameters;
        options.set_item("change", change)?;
        options.set_item("memory", memory)?;
        options.set_item("threshold", threshold)?;
        options.set_item("outlier_gate", outlier_gate)?;
        Ok(((self.given.clone_ref(py), self.variances.clone()), options))
    }

    fn __getstate__(&self) -> Saved {
        let reports = self.reports.iter().map(|report| {
            let Innovation { value, variance } = report.innovation;
            (value, variance, report.noise, report.outlier, report.weight)
        });
        let state = (self.state.mean, self.state.covariance);
        (self.centre.saved(), state, reports.collect())
    }

    fn __setstate__(&mut self, saved: Saved) -> PyResult<()> {
        let (centre, (mean, covariance), reports) = saved;
        let refuse = || PyValueError::new_err("this is not the state of a TrackFusion");
        if reports.len() != self.reports.len() {
            return Err(refuse());
        }
        self.centre = self.centre.restored(&centre).ok_or_else(refuse)?;
        self.state = State { mean, covariance };
        for (report, (value, variance, noise, outlier, weight)) in
            self.reports.iter_mut().zip(reports)
        {
            let innovation = Innovation { value, variance };
            *report = RadarReport { innovation, noise, outlier, weight };
        }
        Ok(())
    }
}
