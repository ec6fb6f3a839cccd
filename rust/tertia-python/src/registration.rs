//! Bindings of `tertia::registration`.

use crate::arrays::{array, numbers, pairs, release, rows_of};
use numpy::{PyArrayDyn, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use tertia::registration::{self as core, Common, Level, PolarPlot, Row, Site};

/// Cost of a row of a table or an instant of a radar, for releasing the interpreter's lock.
const ROW_NS: f64 = 500.0;

type Array<'py> = Bound<'py, PyArrayDyn<f64>>;
type Integers<'py> = Bound<'py, PyArrayDyn<i64>>;
type Levels<'py> = [Array<'py>; 2];

/// A table of tracks, of which these columns count.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Table<'py> {
    time: Bound<'py, PyAny>,
    track: PyReadonlyArray1<'py, i64>,
    plot: PyReadonlyArray1<'py, i64>,
    confirmed: PyReadonlyArray1<'py, bool>,
    state: Bound<'py, PyAny>,
    covariance: Bound<'py, PyAny>,
    turn_probability: Bound<'py, PyAny>,
    track_of_plot: PyReadonlyArray1<'py, i64>,
}

/// States at common instants: (M,), (M,), (M, K, 4), (M, K, 4, 4).
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct States<'py> {
    time: Bound<'py, PyAny>,
    track: PyReadonlyArray1<'py, i64>,
    state: Bound<'py, PyAny>,
    covariance: Bound<'py, PyAny>,
}

/// Plots that updated the tracks of one radar, and the rows that they updated.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Updates<'py> {
    track: PyReadonlyArray1<'py, i64>,
    turn_probability: Bound<'py, PyAny>,
    row_time: Bound<'py, PyAny>,
    time: Bound<'py, PyAny>,
    range: Bound<'py, PyAny>,
    azimuth: Bound<'py, PyAny>,
    height: Bound<'py, PyAny>,
}

impl Table<'_> {
    fn read(&self) -> PyResult<core::Table> {
        let (time, turning) =
            (numbers(&self.time, "time")?, numbers(&self.turn_probability, "turn_probability")?);
        let state = rows_of::<4>(&self.state, "state", 1)?;
        let covariance = rows_of::<16>(&self.covariance, "covariance", 2)?;
        let (track, plot) = (self.track.as_slice()?, self.plot.as_slice()?);
        let confirmed = self.confirmed.as_slice()?;
        let counts = [turning.len(), state.len(), covariance.len(), track.len(), plot.len()];
        same_length(time.len(), &[&counts[..], &[confirmed.len()]].concat())?;
        let row = |i: usize| Row {
            time: time[i],
            track: track[i],
            plot: usize::try_from(plot[i]).ok(),
            confirmed: confirmed[i],
            state: state[i],
            covariance: covariance[i],
            turn_probability: turning[i],
        };
        let track_of_plot = self.track_of_plot.as_slice()?.to_vec();
        Ok(core::Table { rows: (0..time.len()).map(row).collect(), track_of_plot })
    }
}

impl States<'_> {
    fn read(&self, radars: usize) -> PyResult<Common> {
        let (time, track) = (numbers(&self.time, "time")?, self.track.as_slice()?.to_vec());
        let state = rows_of::<4>(&self.state, "state", 1)?;
        let covariance = rows_of::<16>(&self.covariance, "covariance", 2)?;
        let count = time.len() * radars;
        same_length(count, &[track.len() * radars, state.len(), covariance.len()])?;
        Ok(Common { time, track, state, covariance, ..Common::default() })
    }
}

fn same_length(count: usize, others: &[usize]) -> PyResult<()> {
    if others.iter().any(|&other| other != count) {
        return Err(PyValueError::new_err("the columns differ in length"));
    }
    Ok(())
}

/// Standard deviations of range and azimuth with their errors, of the whole recording, (2,), and in
/// the stretches of time between `edges`, (T, 2).
#[pyfunction]
pub fn register_noise<'py>(
    py: Python<'py>,
    updates: Updates<'py>,
    azimuth_sigma: f64,
    scan_period: f64,
    edges: &Bound<'py, PyAny>,
) -> PyResult<[Levels<'py>; 2]> {
    let edges = numbers(edges, "edges")?;
    let track = updates.track.as_slice()?;
    let columns = [
        numbers(&updates.turn_probability, "turn_probability")?,
        numbers(&updates.row_time, "row_time")?,
        numbers(&updates.time, "time")?,
        numbers(&updates.range, "range")?,
        numbers(&updates.azimuth, "azimuth")?,
        numbers(&updates.height, "height")?,
    ];
    same_length(track.len(), &columns.each_ref().map(Vec::len))?;
    let [turning, row_time, time, range, azimuth, height] = columns;
    let plot = |i: usize| PolarPlot {
        track: track[i],
        turn_probability: turning[i],
        row_time: row_time[i],
        time: time[i],
        range: range[i],
        azimuth: azimuth[i],
        height: height[i],
    };
    let found = release(py, ROW_NS * track.len() as f64, || {
        let plots = (0..track.len()).map(plot).collect();
        core::noise(&core::lines(plots, azimuth_sigma, scan_period), &edges)
    });
    let levels = |levels: &[[Level; 2]], shape: &[usize]| -> PyResult<Levels<'py>> {
        let of = |f: fn(&Level) -> f64| array(py, shape, levels.iter().flatten().map(f).collect());
        Ok([of(|level| level.value)?, of(|level| level.sigma)?])
    };
    Ok([levels(&[found.whole], &[2])?, levels(&found.stretches, &[found.stretches.len(), 2])?])
}

/// Times (M,) and tracks (M,) of common instants; states (M, K, 4) with covariances, nan where a
/// radar has no track, and those of the joint track.
#[pyfunction]
#[allow(clippy::type_complexity)] // what Python unpacks
pub fn common_states<'py>(
    py: Python<'py>,
    joint: Table<'py>,
    single: Vec<Table<'py>>,
    scan_periods: Vec<f64>,
) -> PyResult<(Array<'py>, Integers<'py>, [Array<'py>; 4])> {
    let joint = joint.read()?;
    let single = single.iter().map(Table::read).collect::<PyResult<Vec<_>>>()?;
    same_length(single.len(), &[scan_periods.len()])?;
    let counts = single.iter().map(|table| table.track_of_plot.len()).collect::<Vec<_>>();
    same_length(joint.track_of_plot.len(), &counts)?;
    let rows: usize = single.iter().map(|table| table.rows.len()).sum();
    let found = release(py, ROW_NS * rows as f64, || core::common(&joint, &single, &scan_periods));
    let (m, k) = (found.time.len(), single.len());
    Ok((
        array(py, &[m], found.time)?,
        array(py, &[m], found.track)?,
        [
            array(py, &[m, k, 4], found.state.into_flattened())?,
            array(py, &[m, k, 4, 4], found.covariance.into_flattened())?,
            array(py, &[m, 4], found.joint_state.into_flattened())?,
            array(py, &[m, 4, 4], found.joint_covariance.into_flattened())?,
        ],
    ))
}

/// Biases of range and azimuth (K, 2) of radars, and their standard deviations; nan where unknown.
#[pyfunction]
pub fn register_biases<'py>(
    py: Python<'py>,
    states: States<'py>,
    positions: &Bound<'py, PyAny>,
    sigmas: &Bound<'py, PyAny>,
) -> PyResult<Levels<'py>> {
    let (positions, sigmas) = (pairs(positions, "positions")?, pairs(sigmas, "sigmas")?);
    same_length(positions.len(), &[sigmas.len()])?;
    let sites: Vec<Site> = positions
        .into_iter()
        .zip(sigmas)
        .map(|(position, sigma)| Site { position, sigma })
        .collect();
    let k = sites.len();
    let common = states.read(k)?;
    let cost = ROW_NS * (common.time.len() * k.pow(3)) as f64;
    let found = release(py, cost, || core::biases(&common, &sites));
    Ok([
        array(py, &[k, 2], found.value.into_flattened())?,
        array(py, &[k, 2], found.sigma.into_flattened())?,
    ])
}

/// States (M, K, 4) and covariances with biases (K, 2) removed and standard deviations scaled by
/// factors (M, K, 2) along the range and across it.
#[pyfunction]
pub fn correct_states<'py>(
    py: Python<'py>,
    states: States<'py>,
    positions: &Bound<'py, PyAny>,
    biases: &Bound<'py, PyAny>,
    factors: &Bound<'py, PyAny>,
) -> PyResult<Levels<'py>> {
    let (positions, biases) = (pairs(positions, "positions")?, pairs(biases, "biases")?);
    let factors = pairs(factors, "factors")?;
    let k = positions.len();
    let mut common = states.read(k)?;
    same_length(k, &[biases.len()])?;
    same_length(common.state.len(), &[factors.len()])?;
    let m = common.time.len();
    release(py, ROW_NS * factors.len() as f64, || {
        core::correct(&mut common, &positions, &biases, &factors);
    });
    Ok([
        array(py, &[m, k, 4], common.state.into_flattened())?,
        array(py, &[m, k, 4, 4], common.covariance.into_flattened())?,
    ])
}
