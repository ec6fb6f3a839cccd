//! Bindings of `tertia::location`.

use crate::arrays::{Output, Rows, Samples, array, chunks, release, repeated};
use crate::screening::unknown;
use numpy::PyArrayDyn;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::num::NonZero;
use tertia::batch::for_each_row;
use tertia::location::{self, Fix, Instant, Locator, Method, Problem, Workspace};
use tertia::sensors::KINDS;

type Array<'py> = Bound<'py, PyArrayDyn<f64>>;
type Located<'py> =
    (Array<'py>, Array<'py>, Array<'py>, Bound<'py, PyArrayDyn<bool>>, [Array<'py>; 6]);
type Threads = Option<NonZero<usize>>;

/// Cost of an instant per measurement, for the choice of threads.
const LOCATE_NS: f64 = 500.0;
const ACCURACY_NS: f64 = 30.0;

fn method(name: &str, redundancy: usize) -> PyResult<Method> {
    Ok(match name {
        "robust" => Method::Robust(redundancy),
        "least-squares" => Method::LeastSquares,
        "lenth-mle" => Method::LenthMle,
        "lenth-huber" => Method::LenthHuber,
        "lenth-andrews" => Method::LenthAndrews,
        other => {
            let choices =
                "'robust', 'least-squares', 'lenth-mle', 'lenth-huber' or 'lenth-andrews'";
            return Err(unknown("method", other, choices));
        }
    })
}

/// The row of each instant, or one for all.
struct Shared<'a>(&'a Rows<'a>);

impl<'a> Shared<'a> {
    fn new(rows: &'a Rows<'a>, count: usize, name: &str) -> PyResult<Self> {
        match rows.count() {
            1 => Ok(Self(rows)),
            n if n == count => Ok(Self(rows)),
            n => Err(PyValueError::new_err(format!("{name} has {n} rows; it must have {count}"))),
        }
    }

    fn row(&self, i: usize) -> &[f64] {
        let (n, i) = (self.0.len(), if self.0.count() == 1 { 0 } else { i });
        &self.0.values[i * n..(i + 1) * n]
    }
}

/// Stations and dimensions of positions (..., K, D).
fn size(stations: &Samples<'_>) -> PyResult<(usize, usize)> {
    match stations.shape() {
        [.., k, d @ (2 | 3)] if *k > 0 => Ok((*k, *d)),
        shape => Err(PyValueError::new_err(format!(
            "stations has shape {shape:?}; it must be (..., K, D)"
        ))),
    }
}

fn require_row(rows: &Rows<'_>, length: usize, name: &str) -> PyResult<()> {
    if rows.len() == length {
        return Ok(());
    }
    Err(PyValueError::new_err(format!("{name} has shape {:?}; it does not fit", rows.shape)))
}

/// Positions, covariances, residuals, marks; and problems, degrees of freedom, chi-square,
/// p-values, dilutions and estimated standard deviations.
#[pyfunction]
#[allow(clippy::too_many_arguments)] // the Python signature
pub fn locate<'py>(
    py: Python<'py>,
    stations: &Bound<'py, PyAny>,
    axes: Option<&Bound<'py, PyAny>>,
    values: &Bound<'py, PyAny>,
    sigmas: &Bound<'py, PyAny>,
    initial: Option<&Bound<'py, PyAny>>,
    method_name: &str,
    redundancy: usize,
    n_threads: Threads,
) -> PyResult<Located<'py>> {
    let locator = Locator::new(method(method_name, redundancy)?);
    let [stations, values, sigmas] =
        [(stations, "stations"), (values, "values"), (sigmas, "sigmas")]
            .map(|(value, name)| Samples::extract(value, name));
    let (stations, values, sigmas) = (stations?, values?, sigmas?);
    let initial = initial.map(|value| Samples::extract(value, "initial")).transpose()?;
    let axes = axes.map(|value| Samples::extract(value, "axes")).transpose()?;
    let (k, d) = size(&stations)?;
    let (stations, rows, sigmas) = (stations.blocks(2)?, values.blocks(2)?, sigmas.blocks(2)?);
    let initial = initial.as_ref().map(|samples| samples.blocks(1)).transpose()?;
    let axes = axes.as_ref().map(|samples| samples.blocks(3)).transpose()?;
    require_row(&rows, KINDS * k, "values")?;
    require_row(&sigmas, KINDS * k, "sigmas")?;
    let count = rows.count();
    let values = Shared::new(&rows, count, "values")?;
    let stations = Shared::new(&stations, count, "stations")?;
    let sigmas = Shared::new(&sigmas, count, "sigmas")?;
    if let Some(initial) = &initial {
        require_row(initial, d, "initial")?;
    }
    if let Some(axes) = &axes {
        require_row(axes, k * d * d, "axes")?;
    }
    let initial = initial.as_ref().map(|rows| Shared::new(rows, count, "initial")).transpose()?;
    let axes = axes.as_ref().map(|rows| Shared::new(rows, count, "axes")).transpose()?;
    let mut position = Output::new(py, &[rows.batch(), &[d]].concat())?;
    let mut covariance = Output::new(py, &[rows.batch(), &[d, d]].concat())?;
    let mut residual = Output::new(py, rows.shape)?;
    let mut outlier = Output::new(py, rows.shape)?;
    let failed = Fix {
        problem: Problem::TooFew,
        degrees_of_freedom: 0,
        chi_square: 0.0,
        p_value: 0.0,
        dilution: 0.0,
        sigma: 0.0,
    };
    let mut fixes = repeated(failed, count)?;
    let size = location::BLOCK;
    let outputs = position
        .values()?
        .chunks_mut(d * size)
        .zip(covariance.values()?.chunks_mut(d * d * size))
        .zip(residual.values()?.chunks_mut(rows.len() * size))
        .zip(outlier.values()?.chunks_mut(rows.len() * size))
        .zip(fixes.chunks_mut(size));
    let cost = LOCATE_NS * (rows.len() * count) as f64;
    let done = release(py, cost, || {
        let new = || (Workspace::<2>::default(), Workspace::<3>::default());
        for_each_row(outputs.enumerate(), cost, n_threads, new, |(plane, space), (block, out)| {
            let ((((position, covariance), residual), outlier), fixes) = out;
            let instants: Vec<_> = (block * size..)
                .take(fixes.len())
                .map(|i| Instant {
                    stations: stations.row(i),
                    axes: axes.as_ref().map(|axes| axes.row(i)),
                    values: values.row(i),
                    sigmas: sigmas.row(i),
                    initial: initial.as_ref().map(|initial| initial.row(i)),
                })
                .collect();
            let mut out: Vec<_> = position
                .chunks_mut(d)
                .zip(covariance.chunks_mut(d * d))
                .zip(residual.chunks_mut(rows.len()))
                .zip(outlier.chunks_mut(rows.len()))
                .map(|(((position, covariance), residual), outlier)| location::Output {
                    position,
                    covariance,
                    residual,
                    outlier,
                })
                .collect();
            match d {
                2 => locator.locate_all(&instants, &mut out, fixes, plane),
                _ => locator.locate_all(&instants, &mut out, fixes, space),
            }
            Ok(())
        })
    });
    done.map_err(|failure| rows.error(failure))?;
    let column = |f: fn(&Fix) -> f64| array(py, rows.batch(), fixes.iter().map(f).collect());
    let columns = [
        column(|fix| f64::from(fix.problem as u8))?,
        column(|fix| fix.degrees_of_freedom as f64)?,
        column(|fix| fix.chi_square)?,
        column(|fix| fix.p_value)?,
        column(|fix| fix.dilution)?,
        column(|fix| fix.sigma)?,
    ];
    let arrays = (position.into_array(), covariance.into_array(), residual.into_array());
    Ok((arrays.0, arrays.1, arrays.2, outlier.into_array(), columns))
}

/// Covariances and dilutions at positions.
#[pyfunction]
pub fn location_accuracy<'py>(
    py: Python<'py>,
    stations: &Bound<'py, PyAny>,
    axes: Option<&Bound<'py, PyAny>>,
    sigmas: &Bound<'py, PyAny>,
    positions: &Bound<'py, PyAny>,
    n_threads: Threads,
) -> PyResult<(Array<'py>, Array<'py>)> {
    let stations = Samples::extract(stations, "stations")?;
    let sigmas = Samples::extract(sigmas, "sigmas")?;
    let positions = Samples::extract(positions, "positions")?;
    let axes = axes.map(|value| Samples::extract(value, "axes")).transpose()?;
    let (k, d) = size(&stations)?;
    let axes = axes.as_ref().map(|samples| samples.blocks(3)).transpose()?;
    let (stations, sigmas, rows) = (stations.blocks(2)?, sigmas.blocks(2)?, positions.blocks(1)?);
    require_row(&sigmas, KINDS * k, "sigmas")?;
    require_row(&rows, d, "positions")?;
    if let Some(axes) = &axes {
        require_row(axes, k * d * d, "axes")?;
    }
    let count = rows.count();
    let (stations, sigmas) =
        (Shared::new(&stations, 1, "stations")?, Shared::new(&sigmas, 1, "sigmas")?);
    let axes = axes.as_ref().map(|rows| Shared::new(rows, 1, "axes")).transpose()?;
    let mut covariance = Output::new(py, &[rows.shape, &[d]].concat())?;
    let mut dilution = Output::new(py, rows.batch())?;
    let outputs = chunks(covariance.values()?, d * d, count).zip(dilution.values()?);
    let cost = ACCURACY_NS * (KINDS * k * count) as f64;
    let done = release(py, cost, || {
        let new = || (Workspace::<2>::default(), Workspace::<3>::default());
        for_each_row(rows.iter().zip(outputs), cost, n_threads, new, |spaces, (p, out)| {
            let (s, sigmas) = (stations.row(0), sigmas.row(0));
            let axes = axes.as_ref().map(|axes| axes.row(0));
            *out.1 = match d {
                2 => Locator::accuracy(s, axes, sigmas, p, out.0, &mut spaces.0),
                _ => Locator::accuracy(s, axes, sigmas, p, out.0, &mut spaces.1),
            };
            Ok(())
        })
    });
    done.map_err(|failure| rows.error(failure))?;
    Ok((covariance.into_array(), dilution.into_array()))
}
