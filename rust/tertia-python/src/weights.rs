//! Bindings of `tertia::weights`.

use crate::arrays::{Input, Output, Threads, choice, room_for, unknown, value_error};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::cell::Cell;
use tertia::weights::{
    self, Convention, Law, Quantity, Weighing, require_degrees_of_freedom, weighing,
};

/// Number of sensors, dimension, and the solver for them.
type Kept = ((usize, usize), Box<dyn Weighing>);

thread_local! {
    /// The thread's last solver; creating one takes as long as solving a small problem.
    static KEPT: Cell<Option<Kept>> = const { Cell::new(None) };
}
/// Largest dimension of solvers that are kept.
const MAX_DIMENSION_KEPT: usize = 6;

/// The solver for this number of sensors and dimensions; when dropped, it is kept for the thread's next
/// problem.
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

/// Number of measurements of all sensors, or of each.
#[derive(FromPyObject)]
pub enum Counts {
    All(f64),
    Each(Vec<f64>),
}

fn convention(name: &str) -> PyResult<Convention> {
    let choices = [
        ("sample-mean", Convention::SampleMean),
        ("known-mean", Convention::KnownMean),
        ("paper", Convention::Paper),
        ("differences", Convention::Differences),
    ];
    choice("convention", name, &choices)
}

impl Counts {
    fn wishart(&self, name: &str, sensors: usize) -> PyResult<Vec<Law>> {
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

    /// Returns the Wishart laws, for which the fused estimate must have a finite variance.
    fn laws(&self, convention: &str, group: &Group<'_>) -> PyResult<Vec<Law>> {
        let laws = self.wishart(convention, group.sensors)?;
        let least = match self {
            Self::All(n) => *n,
            Self::Each(counts) => counts.iter().copied().fold(f64::INFINITY, f64::min),
        };
        let each = laws.iter().map(|law| law.degrees_of_freedom);
        require_degrees_of_freedom(each, least, group.m).map_err(value_error)?;
        Ok(laws)
    }
}

/// Degrees of freedom and mean of the Wishart law of each sensor.
#[pyfunction]
pub fn wishart_law(n: Counts, convention: &str, sensors: usize) -> PyResult<Vec<(f64, f64)>> {
    let laws = n.wishart(convention, sensors)?;
    Ok(laws.iter().map(|law| (law.degrees_of_freedom, law.mean)).collect())
}

/// Factor by which a sigma estimated with these degrees of freedom must be multiplied.
#[pyfunction]
pub fn student_factor(degrees_of_freedom: f64) -> f64 {
    weights::student_factor(degrees_of_freedom)
}

/// [`student_factor`] from simulated ratios (m, trials) of estimated to actual sigmas.
#[pyfunction]
pub fn simulated_factors(ratios: Input<'_>) -> PyResult<Vec<f64>> {
    let rows = ratios.rows("ratios", 0)?;
    Ok(rows.iter().map(weights::simulated_factor).collect())
}

/// Smallest n, equal for all sensors, for which the loss is finite.
#[pyfunction]
pub fn least_count(name: &str, sensors: usize, dimension: usize) -> PyResult<u64> {
    let n = weights::least_count(convention(name)?, sensors, dimension).map_err(value_error)?;
    Ok(n as u64)
}

/// Numbers of matrices that a solver keeps for every sensor, and in addition.
const MATRICES: (usize, usize) = (14, 30);

/// Covariances (..., K, m, m) of a group of sensors, or (..., m, m) of one.
struct Group<'py> {
    covariances: Input<'py>,
    name: &'static str,
    axes: usize,
    sensors: usize,
    m: usize,
}

impl<'py> Group<'py> {
    /// Covariances of K >= 2 sensors.
    fn extract(covariances: Input<'py>) -> PyResult<Self> {
        match *covariances.shape() {
            [.., sensors, m, columns] if sensors >= 2 && m == columns && m > 0 => {
                Self { covariances, name: "covariances", axes: 3, sensors, m }.with_room()
            }
            ref shape => Err(PyValueError::new_err(format!(
                "covariances has shape {shape:?}; it must be (..., K, m, m): an m by m covariance \
                 matrix for each of K >= 2 sensors"
            ))),
        }
    }

    fn extract_one(covariances: Input<'py>) -> PyResult<Self> {
        match *covariances.shape() {
            [.., m, columns] if m == columns && m > 0 => {
                Self { covariances, name: "covariance", axes: 2, sensors: 1, m }.with_room()
            }
            ref shape => Err(PyValueError::new_err(format!(
                "covariance has shape {shape:?}; it must be (..., m, m)"
            ))),
        }
    }

    /// Checks that there is enough memory for a solver.
    fn with_room(self) -> PyResult<Self> {
        if self.m > MAX_DIMENSION_KEPT {
            let matrices = self.sensors.saturating_mul(MATRICES.0).saturating_add(MATRICES.1);
            room_for::<f64>(matrices.saturating_mul(self.m).saturating_mul(self.m))?;
        }
        Ok(self)
    }

    /// Returns the index of the sensor; negative indices count from the end.
    fn index(&self, sensor: isize) -> PyResult<usize> {
        let sensors = self.sensors;
        let k = if sensor < 0 { sensor + sensors as isize } else { sensor };
        usize::try_from(k).ok().filter(|&k| k < sensors).ok_or_else(|| {
            let last = sensors - 1;
            PyValueError::new_err(format!(
                "sensor is {sensor}; it must be between -{sensors} and {last}"
            ))
        })
    }

    /// Cost of a result, as measured.
    fn cost_ns(&self, quantity: &Quantity<'_>) -> f64 {
        let (k, m) = (self.sensors as f64, self.m as f64);
        let weigh = k * (20.0 + 2.0 * m.powi(3));
        match quantity {
            Quantity::Jacobian { .. }
            | Quantity::WeightCovariance { .. }
            | Quantity::CovarianceOfCovariance { .. } => weigh + k * m.powi(4),
            Quantity::SimulatedExcess { draws } => 3.0 * weigh * draws.len() as f64 / (k * m * m),
            _ => weigh,
        }
    }

    /// Computes the quantity for every element of the batch.
    fn compute(
        &self,
        py: Python<'py>,
        quantity: &Quantity<'_>,
        n_threads: Threads,
    ) -> PyResult<Output<'py>> {
        let size = (self.sensors, self.m);
        let rows = self.covariances.blocks(self.name, self.axes)?;
        let mut out = Output::new(py, rows.batch(), &quantity.shape(self.sensors, self.m))?;
        let cost = self.cost_ns(quantity) * rows.count() as f64;
        let new = || Solver::new(size);
        rows.each(py, cost, n_threads, out.rows()?, new, |solver, (_, s), out| {
            solver.get().compute(quantity, s, out)
        })?;
        Ok(out)
    }
}

/// Computes a quantity, given by name, from covariances (..., K, m, m) or from one (..., m, m). Depending on
/// the quantity, it uses the index of a sensor, the number n of measurements from which covariances were
/// estimated, draws (T, K, m, m), or a factor.
#[pyfunction]
#[pyo3(signature = (
    quantity, covariances, n_threads, *, sensor=-1, n=Counts::All(f64::INFINITY),
    convention="sample-mean", draws=None, factor=0.0
))]
#[allow(clippy::too_many_arguments)] // what the quantities depend on
pub fn weigh<'py>(
    py: Python<'py>,
    quantity: &str,
    covariances: Input<'py>,
    n_threads: Threads,
    sensor: isize,
    n: Counts,
    convention: &str,
    draws: Option<Input<'py>>,
    factor: f64,
) -> PyResult<Output<'py>> {
    if quantity == "covariance_of_covariance" {
        let what = Quantity::CovarianceOfCovariance { c: factor };
        return Group::extract_one(covariances)?.compute(py, &what, n_threads);
    }
    let group = Group::extract(covariances)?;
    let (sensor, laws) = (group.index(sensor)?, n.laws(convention, &group)?);
    let numbers = |of: fn(&Law) -> f64| laws.iter().map(of).collect::<Vec<_>>();
    let (c, relative) = (numbers(Law::factor), numbers(Law::relative_factor));
    let mean = numbers(|law| law.mean);
    let draws = draws.as_ref().map(|draws| draws.blocks("draws", 3)).transpose()?;
    let what = match (quantity, &draws) {
        ("weights", _) => Quantity::Weights,
        ("fused_covariance", _) => Quantity::FusedCovariance,
        ("jacobian", _) => Quantity::Jacobian { sensor },
        ("jacobian_factors", _) => Quantity::JacobianFactors { sensor },
        ("covariance", _) => Quantity::WeightCovariance { sensor, c: &c },
        ("bias", _) => Quantity::WeightBias { sensor, c: &relative, mean: &mean },
        ("excess", None) => Quantity::Excess { c: &relative },
        ("excess", Some(draws)) => Quantity::SimulatedExcess { draws: &draws.values },
        _ => return Err(unknown("quantity", quantity, "that of a function of `weights`")),
    };
    group.compute(py, &what, n_threads)
}
