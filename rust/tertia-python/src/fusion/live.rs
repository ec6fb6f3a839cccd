//! The fusion centre that is updated step by step.

use super::{POSITIVE, VARIANCE, require_room, rule};
use crate::arrays::{Array, array, symmetric, value_error, vector};
use crate::kalman::{check_period, extract_model, over};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use tertia::fusion::{Beliefs, Centre, RadarReport};
use tertia::kalman::{self, Filter, Innovation, Singer, State, Transition, wrapped};

/// Fusion of the plots of several radars, step by step, for embedding.
///
/// It can be pickled and copied; a step that fails does not change it.
///
/// Parameters
/// ----------
/// model : SingerModel
///     Model of the target's motion; `model.dt` is the time of a step unless another is given.
/// measurement_variance : sequence of K floats
///     Variance of each radar's noise, unless others are given with the plots.
/// method, period, change_probability, forgetting_factor, threshold, outlier_gate
///     See `fuse_series`.
///
/// Attributes
/// ----------
/// angle : float
///     The fused angle, in [0, period) if there is a period; nan before the first plot.
/// mean : ndarray of shape (3,)
///     Angle, rate and acceleration.
/// covariance : ndarray of shape (3, 3)
///     Covariance of `mean`; inf for unknown components.
/// weights : ndarray of shape (K, 3)
///     Weights of each radar in angle, rate and acceleration.
/// noise_variance : ndarray of shape (K,)
///     Estimated noise variance of each radar.
/// innovation, innovation_variance : ndarray of shape (K,)
///     Innovations of the radars' own filters.
/// outlier : list of K bools
///     Whether the last plot of each radar was an outlier.
/// repeated : list of K bools
///     Whether the last plot of each radar was left out because it repeats the one before.
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
/// >>> from tertia.fusion import AngleFusion
/// >>> from tertia.kalman import SingerModel
/// >>> centre = AngleFusion(SingerModel(5.0, 0.05, 0.003), [0.01, 0.04], period=360.0)
/// >>> for plots in [(359.1, 359.2), (359.8, float("nan")), (0.4, 0.5)]:
/// ...     angle = centre.step(plots)
/// >>> round(angle, 2)
/// 0.44
#[pyclass(module = "tertia.fusion")]
pub struct AngleFusion {
    /// The model as given, for pickling.
    given: Py<PyAny>,
    method: String,
    beliefs: Beliefs,
    singer: Singer,
    transition: Transition,
    variances: Vec<f64>,
    period: Option<f64>,
    centre: Centre,
    state: State,
    reports: Vec<RadarReport>,
}

/// Pickled in addition to the arguments: the centre, the state and the reports.
type Saved = (Vec<Vec<f64>>, ([f64; 3], [f64; 6]), Vec<(f64, f64, f64, bool, [f64; 3])>);
type NewArguments<'py> = ((Py<PyAny>, Vec<f64>), Bound<'py, PyDict>);

/// Converts an error about a radar's plot or its variance, with the index that the caller knows.
fn of_plot(radar: usize, error: tertia::Error) -> tertia::Error {
    let tertia::Error::InvalidParameter { argument, value, .. } = error else { return error };
    let (argument, requirement) = match argument {
        VARIANCE => (VARIANCE, POSITIVE),
        _ => ("plots", "it must be a finite number, or nan for no plot"),
    };
    tertia::Error::InvalidElement { argument, index: vec![radar], value, requirement }
}

impl AngleFusion {
    /// Returns the variances of plots, validated.
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
        vector(py, self.reports.iter().map(of))
    }
}

#[pymethods]
impl AngleFusion {
    #[new]
    #[pyo3(signature = (
        model, measurement_variance, *, method="robust", period=None, change_probability=0.005,
        forgetting_factor=0.9, threshold=1.6, outlier_gate=16.0
    ))]
    #[allow(clippy::too_many_arguments)] // the Python signature
    fn new(
        model: Bound<'_, PyAny>,
        measurement_variance: Vec<f64>,
        method: &str,
        period: Option<f64>,
        change_probability: f64,
        forgetting_factor: f64,
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
        check_period(period)?;
        let beliefs =
            Beliefs::try_new(forgetting_factor, threshold, outlier_gate, change_probability)
                .map_err(value_error)?;
        let radars = measurement_variance.len();
        require_room(radars)?;
        let filter = Filter::new(singer.acceleration_variance(), period);
        let filters = std::iter::repeat_n(filter, radars);
        Ok(Self {
            given: model.unbind(),
            beliefs,
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

    /// Predict the state after `dt`, by default the time step of the model.
    #[pyo3(signature = (dt=None))]
    fn predict(&mut self, dt: Option<f64>) -> PyResult<()> {
        let none = vec![f64::NAN; self.variances.len()];
        self.step(none, None, dt).map(|_| ())
    }

    /// Update the state with simultaneous plots (nan: none), one per radar, and return the fused angle.
    #[pyo3(signature = (plots, measurement_variance=None))]
    fn update(&mut self, plots: Vec<f64>, measurement_variance: Option<Vec<f64>>) -> PyResult<f64> {
        let variances = self.checked(&plots, measurement_variance)?;
        Ok(self.take(&plots, &variances))
    }

    /// Predict the state after `dt`, update it with plots (nan: none), and return the fused angle.
    #[pyo3(signature = (plots, measurement_variance=None, dt=None))]
    fn step(
        &mut self,
        plots: Vec<f64>,
        measurement_variance: Option<Vec<f64>>,
        dt: Option<f64>,
    ) -> PyResult<f64> {
        let variances = self.checked(&plots, measurement_variance)?;
        let transition = over(dt, &self.singer, self.transition)?;
        self.centre.predict(&transition);
        Ok(self.take(&plots, &variances))
    }

    #[getter]
    fn angle(&self) -> f64 {
        self.state.mean[0]
    }

    #[getter]
    fn mean<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        array(py, &[3], self.state.mean)
    }

    #[getter]
    fn covariance<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        symmetric(py, self.state.covariance)
    }

    #[getter]
    fn weights<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        let weights = self.reports.iter().flat_map(|report| report.weight);
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

    #[getter]
    fn repeated(&self) -> Vec<bool> {
        (0..self.reports.len()).map(|radar| self.centre.repeats(radar)).collect()
    }

    fn __getnewargs_ex__<'py>(&self, py: Python<'py>) -> PyResult<NewArguments<'py>> {
        let options = PyDict::new(py);
        options.set_item("method", &self.method)?;
        options.set_item("period", self.period)?;
        let Beliefs { forgetting_factor, threshold, outlier_gate, change_probability } =
            self.beliefs;
        for (name, value) in [
            ("change_probability", change_probability),
            ("forgetting_factor", forgetting_factor),
            ("threshold", threshold),
            ("outlier_gate", outlier_gate),
        ] {
            options.set_item(name, value)?;
        }
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
        let refuse = || PyValueError::new_err("this is not the state of an AngleFusion");
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
