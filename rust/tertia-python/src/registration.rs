//! Bindings of `tertia::registration`.

use crate::arrays::{Array, Input, Integers, array, release};
use crate::sensors::{IdentityColumns, Radar};
use numpy::PyReadonlyArray1;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use tertia::registration::{
    self as core, Alone, ERRORS, Errors, KINDS, Level, Place, PolarPlot, Report, Row, TargetPlot,
};

/// Returns errors that are the same in all directions, as errors without deviations.
pub fn with_deviation(errors: Vec<[f64; KINDS]>) -> Vec<Errors> {
    let with = |[range, gain, azimuth, clock]: [f64; KINDS]| {
        [range, gain, azimuth, clock, 0.0, 0.0, 0.0, 0.0]
    };
    errors.into_iter().map(with).collect()
}

/// Returns the errors that are the same in all directions.
pub fn without_deviation(errors: &[Errors]) -> impl Iterator<Item = f64> + '_ {
    errors.iter().flat_map(|own| own[..KINDS].iter().copied())
}

/// Cost of a row of a table or an instant of a radar, for the decision whether to release the
/// interpreter's lock.
const ROW_NS: f64 = 500.0;
/// Cost of a plot in a block.
const BLOCK_NS: f64 = 5000.0;

type Levels<'py> = [Array<'py>; 2];

/// The columns of a table of tracks that registration reads.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Table<'py> {
    time: Input<'py>,
    track: PyReadonlyArray1<'py, i64>,
    plot: PyReadonlyArray1<'py, i64>,
    confirmed: PyReadonlyArray1<'py, bool>,
    state: Input<'py>,
    covariance: Input<'py>,
    turn_probability: Input<'py>,
    track_of_plot: PyReadonlyArray1<'py, i64>,
}

/// States at common instants: (M,), (M,), (M, K, 4), (M, K, 4, 4).
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct States<'py> {
    time: Input<'py>,
    track: PyReadonlyArray1<'py, i64>,
    state: Input<'py>,
    covariance: Input<'py>,
}

/// Plots that updated the tracks of one radar, and the rows of these updates.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Updates<'py> {
    track: PyReadonlyArray1<'py, i64>,
    turn_probability: Input<'py>,
    row_time: Input<'py>,
    time: Input<'py>,
    range: Input<'py>,
    azimuth: Input<'py>,
    height: Input<'py>,
}

/// Plots of targets.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct TargetPlots<'py> {
    sensor: PyReadonlyArray1<'py, i64>,
    target: PyReadonlyArray1<'py, i64>,
    time: Input<'py>,
    range: Input<'py>,
    azimuth: Input<'py>,
    height: Input<'py>,
    turn_probability: Input<'py>,
    /// Positions (N, 2); below, their covariances (N, 2, 2). For sensors that report positions.
    position: Option<Input<'py>>,
    covariance: Option<Input<'py>>,
}

/// Tracks of single radars at one instant.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct LoneTracks<'py> {
    sensor: PyReadonlyArray1<'py, i64>,
    identities: IdentityColumns<'py>,
    state: Input<'py>,
    covariance: Input<'py>,
    height: Input<'py>,
}

impl Table<'_> {
    fn read(&self) -> PyResult<core::Table> {
        let (time, turning) =
            (self.time.numbers("time")?, self.turn_probability.numbers("turn_probability")?);
        let state = self.state.points::<4>("state", 1)?;
        let covariance = self.covariance.points::<16>("covariance", 2)?;
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

impl TargetPlots<'_> {
    fn read(&self, radars: usize) -> PyResult<Vec<TargetPlot>> {
        let (sensor, target) = (self.sensor.as_slice()?, self.target.as_slice()?);
        let columns = [
            self.time.numbers("time")?,
            self.range.numbers("range")?,
            self.azimuth.numbers("azimuth")?,
            self.height.numbers("height")?,
            self.turn_probability.numbers("turn_probability")?,
        ];
        same_length(sensor.len(), &columns.each_ref().map(Vec::len))?;
        same_length(sensor.len(), &[target.len()])?;
        let [time, range, azimuth, height, turning] = columns;
        let places = self.places(sensor.len())?;
        let plot = |(i, &sensor): (usize, &i64)| {
            let report = Report {
                radar: number(sensor, radars)?,
                time: time[i],
                range: range[i],
                azimuth: azimuth[i],
                height: height[i],
                place: places.as_ref().and_then(|places| places[i]),
            };
            Ok(TargetPlot { report, target: target[i], turn_probability: turning[i] })
        };
        sensor.iter().enumerate().map(plot).collect()
    }

    /// Returns the positions of this number of plots; `None` for plots without one.
    fn places(&self, count: usize) -> PyResult<Option<Vec<Option<Place>>>> {
        let Some(position) = &self.position else { return Ok(None) };
        let position = position.points::<2>("position", 1)?;
        let covariance = match &self.covariance {
            Some(covariance) => covariance.points::<4>("covariance", 2)?,
            None => vec![[f64::NAN; 4]; count],
        };
        same_length(count, &[position.len(), covariance.len()])?;
        let place = |(position, [xx, xy, _, yy]): ([f64; 2], [f64; 4])| {
            position[0].is_finite().then_some(Place { position, covariance: [xx, xy, yy] })
        };
        Ok(Some(position.into_iter().zip(covariance).map(place).collect()))
    }
}

impl LoneTracks<'_> {
    fn read(&self, radars: usize) -> PyResult<Vec<Alone>> {
        let sensor = self.sensor.as_slice()?;
        let identities = self.identities.read(sensor.len())?;
        let state = self.state.points::<4>("state", 1)?;
        let covariance = self.covariance.points::<16>("covariance", 2)?;
        let height = self.height.numbers("height")?;
        let counts = [state.len(), covariance.len(), height.len()];
        same_length(sensor.len(), &counts)?;
        let track = |(i, &sensor): (usize, &i64)| {
            let (state, covariance) = (state[i], covariance[i]);
            let (height, identities) = (height[i], identities.get(i));
            Ok(Alone { radar: number(sensor, radars)?, state, covariance, height, identities })
        };
        sensor.iter().enumerate().map(track).collect()
    }
}

/// Checks the index of a radar.
fn number(sensor: i64, radars: usize) -> PyResult<usize> {
    let inside = usize::try_from(sensor).ok().filter(|&k| k < radars);
    inside.ok_or_else(|| PyValueError::new_err(format!("sensor is {sensor}; there are {radars}")))
}

impl States<'_> {
    fn read(&self, radars: usize) -> PyResult<core::States> {
        let (time, track) = (self.time.numbers("time")?, self.track.as_slice()?.to_vec());
        let state = self.state.points::<4>("state", 1)?;
        let covariance = self.covariance.points::<16>("covariance", 2)?;
        let count = time.len() * radars;
        same_length(count, &[track.len() * radars, state.len(), covariance.len()])?;
        Ok(core::States { time, track, state, covariance, ..core::States::default() })
    }
}

pub(crate) fn same_length(count: usize, others: &[usize]) -> PyResult<()> {
    if others.iter().any(|&other| other != count) {
        return Err(PyValueError::new_err("the columns differ in length"));
    }
    Ok(())
}

/// Standard deviations of range and azimuth with their errors: for the whole recording, (2,), and for
/// the periods between `edges`, (T, 2).
#[pyfunction]
pub fn register_noise<'py>(
    py: Python<'py>,
    updates: Updates<'py>,
    azimuth_sigma: f64,
    scan_period: f64,
    edges: Input<'py>,
) -> PyResult<[Levels<'py>; 2]> {
    let edges = edges.numbers("edges")?;
    let track = updates.track.as_slice()?;
    let columns = [
        updates.turn_probability.numbers("turn_probability")?,
        updates.row_time.numbers("row_time")?,
        updates.time.numbers("time")?,
        updates.range.numbers("range")?,
        updates.azimuth.numbers("azimuth")?,
        updates.height.numbers("height")?,
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
    })?;
    let levels = |levels: &[[Level; 2]], shape: &[usize]| -> PyResult<Levels<'py>> {
        let of = |f: fn(&Level) -> f64| array(py, shape, levels.iter().flatten().map(f));
        Ok([of(|level| level.value)?, of(|level| level.sigma)?])
    };
    Ok([levels(&[found.whole], &[2])?, levels(&found.stretches, &[found.stretches.len(), 2])?])
}

/// Times (M,) and tracks (M,) of common instants; states (M, K, 4) with covariances, nan if a
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
    let found =
        release(py, ROW_NS * rows as f64, || core::common_states(&joint, &single, &scan_periods))?;
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

/// Errors (T, K, 8) of radars in periods and their standard deviations; covariance of the last errors (8
/// K, 8 K); ratio of the noise to the stated noise, and the number of redundant measurements behind it,
/// (K, 2); the first period after each sudden change and its radar; the number of blocks that were used,
/// and of those that fit no motion. `prior` contains means, standard deviations and rates of drift, (K,
/// 8); the search for the errors begins at `start` (T K, 8).
#[pyfunction]
#[allow(clippy::type_complexity)] // what Python unpacks
pub fn register_errors<'py>(
    py: Python<'py>,
    plots: TargetPlots<'py>,
    radars: Vec<PyRef<'py, Radar>>,
    slant: Vec<bool>,
    prior: [Input<'py>; 3],
    edges: Input<'py>,
    start: Input<'py>,
) -> PyResult<([Array<'py>; 5], Vec<(usize, usize)>, [usize; 2])> {
    let radars: Vec<_> = radars.iter().map(|radar| radar.0.clone()).collect();
    let plots = plots.read(radars.len())?;
    let points = |input: Input<'py>, name| input.points::<ERRORS>(name, 1);
    let [mean, sigma, rate] = prior;
    let (mean, sigma) = (points(mean, "mean")?, points(sigma, "sigma")?);
    let (rate, start) = (points(rate, "rate")?, points(start, "start")?);
    let (k, edges) = (radars.len(), edges.numbers("edges")?);
    let periods = edges.len().saturating_sub(1);
    same_length(k, &[slant.len(), mean.len(), sigma.len(), rate.len()])?;
    same_length(periods * k, &[start.len()])?;
    let start: Vec<_> = start.chunks(k.max(1)).map(<[_]>::to_vec).collect();
    let prior = core::Prior { mean: &mean, sigma: &sigma, rate: &rate };
    let found = release(py, BLOCK_NS * plots.len() as f64, || {
        core::register(
            &plots,
            &radars,
            &slant,
            prior,
            core::Periods { edges: &edges, start: &start },
        )
    })?;
    let flat = |errors: Vec<Vec<core::Errors>>| errors.into_iter().flatten().flatten();
    let order = ERRORS * k;
    Ok((
        [
            array(py, &[periods, k, ERRORS], flat(found.errors))?,
            array(py, &[periods, k, ERRORS], flat(found.sigmas))?,
            // symmetric, so columns take the place of rows
            array(py, &[order, order], found.covariance.as_slice().to_vec())?,
            array(py, &[k, 2], found.factor.into_flattened())?,
            array(py, &[k, 2], found.redundancy.into_flattened())?,
        ],
        found.changes,
        found.blocks,
    ))
}

/// Errors (K, 4) from which a registration starts, the standard deviations of its prior and of the
/// errors, and the number of targets that each radar has in common with others.
#[pyfunction]
pub fn register_start<'py>(
    py: Python<'py>,
    tracks: LoneTracks<'py>,
    radars: Vec<PyRef<'py, Radar>>,
    sigma: Input<'py>,
) -> PyResult<([Array<'py>; 3], Vec<usize>)> {
    let radars: Vec<_> = radars.iter().map(|radar| radar.0.clone()).collect();
    let sigma = sigma.points::<KINDS>("sigma", 1)?;
    same_length(radars.len(), &[sigma.len()])?;
    let tracks = tracks.read(radars.len())?;
    let found = release(py, f64::INFINITY, || core::start(&tracks, &radars, &sigma))?;
    let k = radars.len();
    let levels = [
        array(py, &[k, KINDS], found.errors.into_flattened())?,
        array(py, &[k, KINDS], found.prior.into_flattened())?,
        array(py, &[k, KINDS], found.sigma.into_flattened())?,
    ];
    Ok((levels, found.paired))
}

/// Constant and coefficients of a sensor's error, their covariance, the variance of its drift, its
/// correlation time, and the remaining variance that depends on the direction: estimated from residuals at
/// these times in these directions.
#[pyfunction]
pub fn calibrate<'py>(
    py: Python<'py>,
    time: Input<'py>,
    residual: Input<'py>,
    azimuth: Input<'py>,
    sigma: f64,
    orders: (usize, usize),
) -> PyResult<(Array<'py>, Array<'py>, f64, f64, f64)> {
    let (time, residual) = (time.rows("time", 0)?, residual.rows("residual", 0)?);
    let azimuth = azimuth.rows("azimuth", 0)?;
    same_length(time.values.len(), &[residual.values.len(), azimuth.values.len()])?;
    if time.values.is_empty() {
        return Err(PyValueError::new_err("there is no measurement"));
    }
    let run = core::Run {
        time: &time.values,
        residual: &residual.values,
        azimuth: &azimuth.values,
        sigma,
    };
    let found = release(py, f64::INFINITY, || core::calibrate(&run, orders.0..=orders.1))?;
    let size = found.mean.len();
    let covariance = found.covariance.as_slice().to_vec();
    Ok((
        array(py, &[size], found.mean.as_slice().to_vec())?,
        array(py, &[size, size], covariance)?,
        found.drift,
        found.time,
        found.remainder,
    ))
}

/// States (M, K, 4) and covariances after removing errors (M, K, 8) and scaling the standard deviations by
/// factors (M, K, 2) along the range and across it.
#[pyfunction]
pub fn correct_states<'py>(
    py: Python<'py>,
    states: States<'py>,
    positions: Input<'py>,
    errors: Input<'py>,
    factors: Input<'py>,
) -> PyResult<Levels<'py>> {
    let (positions, factors) = (positions.pairs("positions")?, factors.pairs("factors")?);
    let errors = errors.points::<ERRORS>("errors", 1)?;
    let k = positions.len();
    let mut states = states.read(k)?;
    same_length(states.state.len(), &[errors.len(), factors.len()])?;
    let m = states.time.len();
    release(py, ROW_NS * factors.len() as f64, || {
        core::correct(&mut states, &positions, &errors, &factors);
    })?;
    Ok([
        array(py, &[m, k, 4], states.state.into_flattened())?,
        array(py, &[m, k, 4, 4], states.covariance.into_flattened())?,
    ])
}
