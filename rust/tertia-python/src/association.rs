//! Bindings of `tertia::association`.

use crate::arrays::{
    Array, Input, Integers, Output, Rows, array, choice, columns, release, repeated, room_for,
    value_error, vector,
};
use numpy::PyReadonlyArray1;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::borrow::Cow;
use std::num::NonZero;
use tertia::Error;
use tertia::association::gate::{self, Factor, GateSector, Scan, Thresholds};
use tertia::association::score::{self, PaperScore, Surroundings};
use tertia::association::{Assigner, Association, Pair, Scoring};

type Gated<'py> = (Integers<'py>, Integers<'py>, Array<'py>, Array<'py>);

/// Costs of a query of the index, of the sector of a plot, of a score, and of a pair in an assignment.
const QUERY_NS: f64 = 100.0;
const SECTOR_NS: f64 = 20.0;
const SCORE_NS: f64 = 2.0;
const PAIR_NS: f64 = 50.0;
/// Methods of assignment, and whether they maximise the sum of the gains.
const METHODS: [(&str, bool); 2] = [("gnn", true), ("nearest", false)];
/// Index that stands for no column or no row.
const NONE: i64 = -1;

/// Threshold d² of a gate.
#[pyfunction]
pub fn gate_threshold(probability: f64, dimension: usize) -> PyResult<f64> {
    gate::threshold(probability, dimension).map_err(value_error)
}

/// Sectors of innovations, (..., 2), with covariances, (..., 2, 2), and velocities, (..., 2).
#[pyfunction]
pub fn gate_sectors<'py>(
    py: Python<'py>,
    innovation: Input<'py>,
    covariance: Input<'py>,
    velocity: Input<'py>,
) -> PyResult<Output<'py, i64>> {
    let rows = innovation.blocks("innovation", 1)?;
    let (sigmas, courses) = (covariance.blocks("covariance", 2)?, velocity.blocks("velocity", 1)?);
    rows.require(2, rows.count())?;
    courses.require(2, rows.count())?;
    sigmas.require(4, rows.count())?;
    let thresholds = Thresholds::new(2).map_err(value_error)?;
    let mut out = Output::new(py, rows.batch(), &[])?;
    let outputs = out.values()?.iter_mut();
    let (e, v) = (rows.values.as_chunks().0, courses.values.as_chunks().0);
    let matrices = sigmas.values.as_chunks::<2>().0.as_chunks().0;
    sigmas.each(
        py,
        SECTOR_NS * rows.size(),
        NonZero::new(1),
        outputs,
        || (),
        |(), (i, _), out| {
            let singular = Error::Singular { argument: "covariance", index: Vec::new() };
            let factor = Factor::try_new(&matrices[i]).ok_or(singular)?;
            *out = GateSector::of(e[i], v[i], &factor, &thresholds) as i64;
            Ok(())
        },
    )?;
    Ok(out)
}

/// The paper's scores for an array of d².
#[pyfunction]
pub fn paper_score<'py>(
    py: Python<'py>,
    d2: Input<'py>,
    q: f64,
    dimension: usize,
) -> PyResult<Output<'py>> {
    let rows = d2.blocks("d2", 1)?;
    let mut out = rows.output(py)?;
    let values = out.values()?;
    let score = PaperScore::new(q, dimension).map_err(value_error)?;
    release(py, SCORE_NS * rows.size(), || {
        for (value, &d2) in values.iter_mut().zip(rows.values.iter()) {
            *value = score.of(d2);
        }
    })?;
    Ok(out)
}

/// Log-likelihood ratios for an array of d², with `ln |Σ|` of the same shape.
#[pyfunction]
pub fn likelihood_score<'py>(
    py: Python<'py>,
    d2: Input<'py>,
    ln_determinant: Input<'py>,
    dimension: usize,
    detection_probability: f64,
    clutter_density: f64,
) -> PyResult<Output<'py>> {
    let surroundings =
        Surroundings::new(detection_probability, clutter_density).map_err(value_error)?;
    let (rows, volumes) = (d2.blocks("d2", 1)?, ln_determinant.blocks("ln_determinant", 1)?);
    volumes.require(rows.len(), rows.count())?;
    let mut out = rows.output(py)?;
    let values = out.values()?;
    release(py, SCORE_NS * rows.size(), || {
        for ((value, &d2), &volume) in values.iter_mut().zip(&*rows.values).zip(&*volumes.values) {
            *value = surroundings.likelihood(score::log_density(d2, volume, dimension));
        }
    })?;
    Ok(out)
}

/// Predictions of tracks and plots of a scan, with one covariance for each or for all.
struct Scene<'a> {
    tracks: Rows<'a>,
    plots: Rows<'a>,
    covariance: Cow<'a, [f64]>,
    plot_covariance: Option<Cow<'a, [f64]>>,
}

impl<'a> Scene<'a> {
    fn read(
        predicted: &'a Input<'_>,
        covariance: &'a Input<'_>,
        plots: &'a Input<'_>,
        plot_covariance: Option<&'a Input<'_>>,
    ) -> PyResult<Self> {
        let (tracks, plots) = (predicted.blocks("predicted", 1)?, plots.blocks("plots", 1)?);
        let m = tracks.len();
        plots.require(m, plots.count())?;
        let matrices = |input: &'a Input<'_>, name, count| {
            let rows = input.blocks(name, 2)?;
            rows.require_shared(m * m, count)?;
            PyResult::Ok(if rows.count() == count {
                rows.values
            } else {
                Cow::Owned(rows.values.repeat(count))
            })
        };
        let noise = plot_covariance.map(|n| matrices(n, "plot_covariance", plots.count()));
        let covariance = matrices(covariance, "covariance", tracks.count())?;
        Ok(Self { covariance, plot_covariance: noise.transpose()?, tracks, plots })
    }

    fn scan(&self) -> Scan<'_> {
        Scan {
            predicted: &self.tracks.values,
            covariance: &self.covariance,
            plots: &self.plots.values,
            plot_covariance: self.plot_covariance.as_deref(),
        }
    }

    /// Cost in nanoseconds, if all plots are in the gates of all tracks.
    fn cost(&self) -> f64 {
        let (tracks, plots) = (self.tracks.count() as f64, self.plots.count() as f64);
        QUERY_NS * (tracks + plots) + PAIR_NS * tracks * plots
    }
}

fn wrong_dimension<T>(m: usize) -> tertia::Result<T> {
    Err(Error::InvalidParameter {
        argument: "predicted",
        value: m as f64,
        requirement: "points of 2 or 3 coordinates",
    })
}

/// The track of each plot, the plot of each track (-1 if there is none), its score and its d².
/// `likelihood` contains the probability of detection and the clutter density; without it, the score is the
/// paper's with `q`.
#[pyfunction]
#[allow(clippy::too_many_arguments)] // the Python signature
pub fn associate<'py>(
    py: Python<'py>,
    predicted: Input<'py>,
    covariance: Input<'py>,
    plots: Input<'py>,
    plot_covariance: Option<Input<'py>>,
    gate_probability: f64,
    likelihood: Option<(f64, f64)>,
    q: f64,
    method: &str,
) -> PyResult<(Integers<'py>, Integers<'py>, Array<'py>, Array<'py>)> {
    let global = choice("method", method, &METHODS)?;
    let scene = Scene::read(&predicted, &covariance, &plots, plot_covariance.as_ref())?;
    let m = scene.tracks.len();
    let threshold = gate::threshold(gate_probability, m).map_err(value_error)?;
    let scoring = match likelihood {
        None => Scoring::Paper(q),
        Some((pd, density)) => {
            Scoring::Likelihood(Surroundings::new(pd, density).map_err(value_error)?)
        }
    };
    let found = release(py, scene.cost(), || match m {
        2 => tertia::association::associate::<2>(&scene.scan(), threshold, scoring, global),
        3 => tertia::association::associate::<3>(&scene.scan(), threshold, scoring, global),
        m => wrong_dimension(m),
    })?;
    let Association { plot_of_track, score, nis } = found.map_err(value_error)?;
    let mut track_of_plot = repeated(NONE, scene.plots.count())?;
    for (track, plot) in plot_of_track.iter().enumerate() {
        if let Some(plot) = plot {
            track_of_plot[*plot as usize] = track as i64;
        }
    }
    let count = [plot_of_track.len()];
    let plots = plot_of_track.iter().map(|plot| plot.map_or(NONE, i64::from));
    Ok((
        vector(py, track_of_plot)?,
        array(py, &count, plots)?,
        array(py, &count, score)?,
        array(py, &count, nis)?,
    ))
}

/// Track, plot, d² and `ln |Σ|` for every plot in the gate of a track.
#[pyfunction]
pub fn gate_pairs<'py>(
    py: Python<'py>,
    predicted: Input<'py>,
    covariance: Input<'py>,
    plots: Input<'py>,
    plot_covariance: Option<Input<'py>>,
    threshold: f64,
) -> PyResult<Gated<'py>> {
    let scene = Scene::read(&predicted, &covariance, &plots, plot_covariance.as_ref())?;
    let found = release(py, scene.cost(), || match scene.tracks.len() {
        2 => gate::pairs::<2>(&scene.scan(), threshold),
        3 => gate::pairs::<3>(&scene.scan(), threshold),
        m => wrong_dimension(m),
    })?;
    let found = found.map_err(value_error)?;
    let shape = [found.len()];
    let [track, plot] =
        columns(py, &shape, &found, [|pair| i64::from(pair.track), |pair| i64::from(pair.plot)])?;
    let [nis, volume] = columns(py, &shape, &found, [|pair| pair.nis, |pair| pair.ln_determinant])?;
    Ok((track, plot, nis, volume))
}

/// The column of each row, -1 if there is none.
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
) -> PyResult<Integers<'py>> {
    let (row, column, gain) = (row.as_array(), column.as_array(), gain.as_array());
    if row.len() != gain.len() || column.len() != gain.len() {
        return Err(PyValueError::new_err("row, column and gain must have the same length"));
    }
    let global = choice("method", method, &METHODS)?;
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
    })?;
    vector(py, result)
}

/// Checks that an index is below a count.
fn index(value: i64, count: u32, name: &str) -> PyResult<u32> {
    u32::try_from(value).ok().filter(|&index| index < count).ok_or_else(|| {
        PyValueError::new_err(format!("{name} has {value}; it must be between 0 and {count}"))
    })
}
