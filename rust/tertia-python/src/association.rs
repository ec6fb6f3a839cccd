//! Bindings of `tertia::association`.

use crate::arrays::{Output, Rows, Samples, array, release, room_for, value_error};
use crate::screening::unknown;
use numpy::{PyArrayDyn, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use tertia::Error;
use tertia::association::gate::{self, Factor, GateSector, Scan, Thresholds};
use tertia::association::score::{self, Surroundings};
use tertia::association::{Assigner, Pair};

type Array<'py> = Bound<'py, PyArrayDyn<f64>>;
type Indices<'py> = Bound<'py, PyArrayDyn<i64>>;
type Gated<'py> = (Indices<'py>, Indices<'py>, Array<'py>, Array<'py>);

/// Cost of a query of the index, of a region, of a score, of a pair in an assignment.
const QUERY_NS: f64 = 100.0;
const SECTOR_NS: f64 = 20.0;
const SCORE_NS: f64 = 2.0;
const PAIR_NS: f64 = 50.0;
/// What a row without a column, or a column without a row, is called.
const NONE: i64 = -1;

/// The d² of a gate.
#[pyfunction]
pub fn gate_threshold(probability: f64, dimension: usize) -> PyResult<f64> {
    gate::threshold(probability, dimension).map_err(value_error)
}

/// Regions of innovations, (..., 2), with covariances, (..., 2, 2), and velocities, (..., 2).
#[pyfunction]
pub fn gate_sectors<'py>(
    py: Python<'py>,
    innovation: &Bound<'py, PyAny>,
    covariance: &Bound<'py, PyAny>,
    velocity: &Bound<'py, PyAny>,
) -> PyResult<Indices<'py>> {
    let innovation = Samples::extract(innovation, "innovation")?;
    let covariance = Samples::extract(covariance, "covariance")?;
    let velocity = Samples::extract(velocity, "velocity")?;
    let (rows, sigmas, courses) =
        (innovation.blocks(1)?, covariance.blocks(2)?, velocity.blocks(1)?);
    require_equal(&[(&rows, "innovation"), (&courses, "velocity")], rows.count(), 2)?;
    require_equal(&[(&sigmas, "covariance")], rows.count(), 4)?;
    let thresholds = Thresholds::new(2).map_err(value_error)?;
    let mut out = Output::<i64>::new(py, rows.batch())?;
    let values = out.values()?;
    let (e, s, v) =
        (rows.values.as_chunks().0, sigmas.values.as_chunks::<2>().0, courses.values.as_chunks().0);
    let done = release(py, SECTOR_NS * rows.count() as f64, || {
        for (i, (e, s, v)) in triples(e, s.as_chunks().0, v).enumerate() {
            let factor = Factor::try_new(s).ok_or(i)?;
            values[i] = GateSector::of(*e, *v, &factor, &thresholds) as i64;
        }
        Ok(())
    });
    done.map_err(|row| {
        let error = Error::Singular { argument: "covariance", index: Vec::new() };
        sigmas.error(tertia::batch::RowError { row, error })
    })?;
    Ok(out.into_array())
}

/// Three slices side by side.
fn triples<'a, A, B, C>(
    a: &'a [A],
    b: &'a [B],
    c: &'a [C],
) -> impl Iterator<Item = (&'a A, &'a B, &'a C)> {
    a.iter().zip(b).zip(c).map(|((a, b), c)| (a, b, c))
}

/// Fails unless all have so many rows of this length.
fn require_equal(all: &[(&Rows<'_>, &str)], count: usize, length: usize) -> PyResult<()> {
    for (rows, name) in all {
        if rows.len() != length || rows.count() != count {
            let shape = rows.shape;
            return Err(PyValueError::new_err(format!("{name} has shape {shape:?}; not fitting")));
        }
    }
    Ok(())
}

/// The paper's scores of any d².
#[pyfunction]
pub fn paper_score<'py>(
    py: Python<'py>,
    d2: &Bound<'py, PyAny>,
    q: f64,
    dimension: usize,
) -> PyResult<Array<'py>> {
    let d2 = Samples::extract(d2, "d2")?;
    let rows = d2.blocks(1)?;
    let mut out = Output::new(py, rows.shape)?;
    let values = out.values()?;
    let done = release(py, SCORE_NS * rows.values.len() as f64, || {
        for (value, &d2) in values.iter_mut().zip(rows.values.iter()) {
            *value = score::paper(d2, q, dimension)?;
        }
        score::paper(0.0, q, dimension)
    });
    done.map_err(value_error)?;
    Ok(out.into_array())
}

/// Log-likelihood ratios of any d² with `ln |Σ|` of the same shape, and that of a missed target.
#[pyfunction]
pub fn likelihood_score<'py>(
    py: Python<'py>,
    d2: &Bound<'py, PyAny>,
    ln_determinant: &Bound<'py, PyAny>,
    dimension: usize,
    detection_probability: f64,
    clutter_density: f64,
) -> PyResult<(Array<'py>, f64)> {
    let surroundings =
        Surroundings::new(detection_probability, clutter_density).map_err(value_error)?;
    let d2 = Samples::extract(d2, "d2")?;
    let ln_determinant = Samples::extract(ln_determinant, "ln_determinant")?;
    let (rows, volumes) = (d2.blocks(1)?, ln_determinant.blocks(1)?);
    require_equal(&[(&volumes, "ln_determinant")], rows.count(), rows.len())?;
    let mut out = Output::new(py, rows.shape)?;
    let values = out.values()?;
    release(py, SCORE_NS * rows.values.len() as f64, || {
        for ((value, &d2), &volume) in values.iter_mut().zip(&*rows.values).zip(&*volumes.values) {
            *value = surroundings.likelihood(score::log_density(d2, volume, dimension));
        }
    });
    Ok((out.into_array(), surroundings.missed()))
}

/// Track, plot, d² and `ln |Σ|` of every plot within the gate of a track.
#[pyfunction]
pub fn gate_pairs<'py>(
    py: Python<'py>,
    predicted: &Bound<'py, PyAny>,
    covariance: &Bound<'py, PyAny>,
    plots: &Bound<'py, PyAny>,
    plot_covariance: Option<&Bound<'py, PyAny>>,
    threshold: f64,
) -> PyResult<Gated<'py>> {
    let predicted = Samples::extract(predicted, "predicted")?;
    let covariance = Samples::extract(covariance, "covariance")?;
    let plots = Samples::extract(plots, "plots")?;
    let noise = plot_covariance.map(|noise| Samples::extract(noise, "plot_covariance"));
    let noise = noise.transpose()?;
    let (tracks, sigmas, plots) = (predicted.blocks(1)?, covariance.blocks(2)?, plots.blocks(1)?);
    let noise = noise.as_ref().map(|noise| noise.blocks(2)).transpose()?;
    let m = tracks.len();
    require_equal(&[(&sigmas, "covariance")], tracks.count(), m * m)?;
    require_equal(&[(&plots, "plots")], plots.count(), m)?;
    if let Some(noise) = &noise {
        require_equal(&[(noise, "plot_covariance")], plots.count(), m * m)?;
    }
    let scan = Scan {
        predicted: &tracks.values,
        covariance: &sigmas.values,
        plots: &plots.values,
        plot_covariance: noise.as_ref().map(|noise| &*noise.values),
    };
    let cost = QUERY_NS * (tracks.count() + plots.count()) as f64;
    let found = release(py, cost, || match m {
        2 => gate::pairs::<2>(&scan, threshold),
        3 => gate::pairs::<3>(&scan, threshold),
        m => Err(Error::InvalidParameter {
            argument: "predicted",
            value: m as f64,
            requirement: "points of 2 or 3 coordinates",
        }),
    });
    let found = found.map_err(value_error)?;
    let shape = [found.len()];
    Ok((
        array(py, &shape, found.iter().map(|pair| i64::from(pair.track)).collect())?,
        array(py, &shape, found.iter().map(|pair| i64::from(pair.plot)).collect())?,
        array(py, &shape, found.iter().map(|pair| pair.nis).collect())?,
        array(py, &shape, found.iter().map(|pair| pair.ln_determinant).collect())?,
    ))
}

/// The column of each row, -1 where there is none.
#[pyfunction]
#[allow(clippy::too_many_arguments)] // the Python signature
pub fn assign_pairs<'py>(
    py: Python<'py>,
    row: PyReadonlyArray1<'py, i64>,
    column: PyReadonlyArray1<'py, i64>,
    gain: PyReadonlyArray1<'py, f64>,
    rows: u32,
    columns: u32,
    method: &str,
) -> PyResult<Indices<'py>> {
    let (row, column, gain) = (row.as_array(), column.as_array(), gain.as_array());
    if row.len() != gain.len() || column.len() != gain.len() {
        return Err(PyValueError::new_err("row, column and gain must have the same length"));
    }
    let global = match method {
        "gnn" => true,
        "nearest" => false,
        other => return Err(unknown("method", other, "'gnn' or 'nearest'")),
    };
    let mut pairs = room_for(row.len())?;
    for ((&row, &column), &gain) in row.iter().zip(column).zip(gain) {
        let (row, column) = (index(row, rows, "row")?, index(column, columns, "column")?);
        pairs.push(Pair { row, column, gain });
    }
    let result = release(py, PAIR_NS * pairs.len() as f64, || {
        let mut assigner = Assigner::default();
        let (rows, columns) = (rows as usize, columns as usize);
        let result = if global {
            assigner.assign(&pairs, rows, columns)
        } else {
            assigner.nearest(&pairs, rows, columns)
        };
        result.iter().map(|column| column.map_or(NONE, i64::from)).collect::<Vec<_>>()
    });
    array(py, &[result.len()], result)
}

/// An index below a number.
fn index(value: i64, count: u32, name: &str) -> PyResult<u32> {
    u32::try_from(value).ok().filter(|&index| index < count).ok_or_else(|| {
        PyValueError::new_err(format!("{name} has {value}; it must be between 0 and {count}"))
    })
}
