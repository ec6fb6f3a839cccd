//! Bindings of `tertia::tracker`.

use crate::arrays::{Output, Samples, array, release, room_for, value_error};
use crate::flightplan::Route;
use numpy::{PyArrayDyn, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::num::NonZero;
use tertia::kalman::Singer;
use tertia::tracker::{
    self, Motion, Noise, Plane, Plot, PlotStatus, Radar, Row, Rows, Settings, WindowRule,
};

/// Cost of a plot, for the choice of releasing the interpreter's lock.
const PLOT_NS: f64 = 1000.0;
/// Widths of the columns of numbers, integers and flags.
const NUMBERS: [usize; 9] = [1, 2, 2, 16, 2, 4, 1, 1, 1];
const INTEGERS: [usize; 5] = [1; 5];
const FLAGS: [usize; 2] = [1; 2];

/// Numbers of a radar: east, north, up, range_sigma, azimuth_sigma, scan_period, max_range,
/// detection_probability.
type RadarNumbers = [f64; 8];

/// Motion by name, with its parameters.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Options<'py> {
    motion: String,
    parameters: Vec<f64>,
    guard: f64,
    guard_acceleration: [f64; 2],
    confirmation: (usize, usize),
    coasting: usize,
    max_speed: f64,
    clutter_density: f64,
    identity_error_probability: f64,
    emergency_codes: Vec<i64>,
    patience: f64,
    flown_probability: f64,
    wind: [f64; 2],
    wind_sigma: f64,
    plans: Vec<PyRef<'py, Route>>,
}

type Numbers<'py> = Bound<'py, PyArrayDyn<f64>>;
type Flags<'py> = Bound<'py, PyArrayDyn<bool>>;
type Integers<'py> = Bound<'py, PyArrayDyn<i64>>;

/// Columns of a table of N rows, one after the other. Numbers: time, position (2), velocity (2),
/// covariance (16), innovation (2), its covariance (4), turning, height, vertical_rate. Integers: track,
/// radar, plot, identity, plan. Flags: confirmed, conforms. Then the statuses of the plots.
type Table<'py> = (Numbers<'py>, Integers<'py>, Flags<'py>, Integers<'py>);

/// The rows of a scan or of a recording.
struct Found {
    rows: Vec<Row>,
    /// Whether those of tracks that are not confirmed yet are kept as well.
    tentative: bool,
}

impl Rows for Found {
    fn wants(&self, confirmed: bool) -> bool {
        self.tentative || confirmed
    }

    fn push(&mut self, row: &Row) {
        self.rows.push(*row);
    }
}

/// Scans of plots in, tracks out.
#[pyclass(module = "tertia.tracker")]
pub struct PlotTracker(tracker::Tracker);

#[pymethods]
impl PlotTracker {
    #[new]
    fn new(radars: Vec<RadarNumbers>, options: Options<'_>) -> PyResult<Self> {
        let radars = radars.into_iter().map(radar).collect();
        let settings = options.settings(radars)?;
        tracker::Tracker::try_new(settings).map(Self).map_err(value_error)
    }

    /// Until when everything is done.
    #[getter]
    fn time(&self) -> f64 {
        self.0.time()
    }

    /// Takes plots, until `end`. Of a recording, all rows of the tracks that are confirmed in the
    /// end are returned, otherwise those of the tracks that are confirmed by then.
    #[allow(clippy::too_many_arguments)]
    fn track<'py>(
        &mut self,
        py: Python<'py>,
        time: Bound<'py, PyAny>,
        range: Bound<'py, PyAny>,
        azimuth: Bound<'py, PyAny>,
        height: Bound<'py, PyAny>,
        sensor: PyReadonlyArray1<'py, i64>,
        identity: PyReadonlyArray1<'py, i64>,
        end: Option<f64>,
        recording: bool,
        n_threads: Option<NonZero<usize>>,
    ) -> PyResult<Table<'py>> {
        let plots = plots([time, range, azimuth, height], &sensor, &identity, self.0.radars())?;
        let (mut statuses, mut found) =
            (Vec::new(), Found { rows: Vec::new(), tentative: recording });
        release(py, plots.len() as f64 * PLOT_NS, || {
            self.0.track(&plots, end, &mut statuses, &mut found, n_threads).map(|()| {
                if recording {
                    keep_confirmed(&mut found.rows);
                }
            })
        })
        .map_err(value_error)?;
        table(py, &found.rows, &statuses)
    }

    /// Numbers of the confirmed tracks, and where they will be so many seconds from now.
    fn extrapolate<'py>(
        &self,
        py: Python<'py>,
        seconds: f64,
    ) -> PyResult<(Integers<'py>, Numbers<'py>)> {
        let found = self.0.extrapolate(seconds);
        let positions = found.iter().flat_map(|(_, position)| *position).collect();
        let tracks = found.iter().map(|(track, _)| *track as i64).collect();
        Ok((array(py, &[found.len()], tracks)?, array(py, &[found.len(), 2], positions)?))
    }

    /// Blocks the plan of a confirmed track until it is told otherwise, or lets it be believed again.
    fn suspend_plan(&mut self, track: u64, suspended: bool) -> bool {
        self.0.suspend_plan(track, suspended)
    }

    /// Numbers of the confirmed tracks whose plans are suspended.
    fn suspended_plans<'py>(&self, py: Python<'py>) -> PyResult<Integers<'py>> {
        let suspended: Vec<i64> =
            self.0.suspended_plans().into_iter().map(|track| track as i64).collect();
        array(py, &[suspended.len()], suspended)
    }

    /// All that the tracker knows.
    fn __getstate__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let bytes = self.0.to_bytes();
        Ok(PyBytes::new(py, &bytes))
    }

    /// The tracker of such a state.
    #[staticmethod]
    fn from_state(state: &[u8]) -> PyResult<Self> {
        tracker::Tracker::from_bytes(state)
            .map(Self)
            .ok_or_else(|| PyValueError::new_err("this is not the state of a Tracker"))
    }
}

/// East and north of plots (N, 2) and their covariances (N, 2, 2); nan where there are none.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
pub fn plots_to_cartesian<'py>(
    py: Python<'py>,
    radars: Vec<RadarNumbers>,
    time: Bound<'py, PyAny>,
    range: Bound<'py, PyAny>,
    azimuth: Bound<'py, PyAny>,
    height: Bound<'py, PyAny>,
    sensor: PyReadonlyArray1<'py, i64>,
    identity: PyReadonlyArray1<'py, i64>,
) -> PyResult<(Numbers<'py>, Numbers<'py>)> {
    let radars: Vec<Radar> = radars.into_iter().map(radar).collect();
    let plots = plots([time, range, azimuth, height], &sensor, &identity, radars.len())?;
    let (mut position, mut covariance) = (room_for(2 * plots.len())?, room_for(4 * plots.len())?);
    for plot in &plots {
        let none = ([f64::NAN; 2], Plane { xx: f64::NAN, xy: f64::NAN, yy: f64::NAN });
        let (z, Plane { xx, xy, yy }) = plot.to_cartesian(&radars[plot.radar]).unwrap_or(none);
        position.extend(z);
        covariance.extend([xx, xy, xy, yy]);
    }
    Ok((array(py, &[plots.len(), 2], position)?, array(py, &[plots.len(), 2, 2], covariance)?))
}

/// Plots by their columns: time, range, azimuth, height; the index of the sensor; the identity.
fn plots<'py>(
    numbers: [Bound<'py, PyAny>; 4],
    sensor: &PyReadonlyArray1<'py, i64>,
    identity: &PyReadonlyArray1<'py, i64>,
    sensors: usize,
) -> PyResult<Vec<Plot>> {
    let mut samples = Vec::with_capacity(numbers.len());
    for (column, name) in numbers.iter().zip(["time", "range", "azimuth", "height"]) {
        samples.push(Samples::extract(column, name)?);
    }
    let mut rows = Vec::with_capacity(samples.len());
    for column in &samples {
        rows.push(column.rows(0)?);
    }
    let values: Vec<&[f64]> = rows.iter().map(|rows| &*rows.values).collect();
    let (sensor, identity) = (sensor.as_slice()?, identity.as_slice()?);
    let count = sensor.len();
    if values.iter().any(|column| column.len() != count) || identity.len() != count {
        return Err(PyValueError::new_err("the columns of plots differ in length"));
    }
    let mut plots = room_for(count)?;
    for i in 0..count {
        let index = usize::try_from(sensor[i]).ok().filter(|&index| index < sensors);
        plots.push(Plot {
            time: values[0][i],
            range: values[1][i],
            azimuth: values[2][i],
            height: values[3][i],
            radar: index.ok_or_else(|| {
                PyValueError::new_err(format!(
                    "sensor[{i}] is {}; it must be the index of one of the {sensors} sensors",
                    sensor[i]
                ))
            })?,
            identity: identity[i],
        });
    }
    Ok(plots)
}

fn radar(numbers: RadarNumbers) -> Radar {
    let [east, north, up, range_sigma, azimuth_sigma, scan_period, max_range, detection] = numbers;
    Radar {
        position: [east, north, up],
        range_sigma,
        azimuth_sigma,
        scan_period,
        max_range,
        detection_probability: detection,
    }
}

impl Options<'_> {
    fn settings(self, radars: Vec<Radar>) -> PyResult<Settings> {
        Ok(Settings {
            radars,
            motion: motion(&self.motion, &self.parameters)?,
            guard: self.guard,
            guard_acceleration: self.guard_acceleration,
            confirmation: self.confirmation,
            coasting: self.coasting,
            max_speed: self.max_speed,
            clutter_density: self.clutter_density,
            identity_error_probability: self.identity_error_probability,
            emergency_codes: self.emergency_codes,
            patience: self.patience,
            plans: self.plans.iter().map(|route| route.plan().clone()).collect(),
            flown_probability: self.flown_probability,
            wind: self.wind,
            wind_sigma: self.wind_sigma,
        })
    }
}

fn motion(name: &str, parameters: &[f64]) -> PyResult<Motion> {
    Ok(match (name, parameters) {
        ("cv", &[sigma]) => Motion::Straight(sigma),
        ("singer", &[alpha, sigma]) => {
            Motion::Singer(Singer::try_new(alpha, sigma, true).map_err(value_error)?)
        }
        ("imm", &[straight, turn, turn_rate_walk, turn_rate, straight_time, turn_time]) => {
            Motion::Multiple(Noise {
                straight,
                turn,
                turn_rate_walk,
                turn_rate,
                straight_time,
                turn_time,
            })
        }
        ("window", &[long, short, turn, inner, outer, guard, sum]) => Motion::Window(WindowRule {
            long: long as usize,
            short: short as usize,
            turn: turn as usize,
            inner,
            outer,
            guard,
            sum,
        }),
        _ => return Err(PyValueError::new_err(format!("motion {name:?} is not known"))),
    })
}

/// Leaves out the rows of tracks that were never confirmed.
fn keep_confirmed(rows: &mut Vec<Row>) {
    let mut confirmed = Vec::new();
    for row in rows.iter().filter(|row| row.confirmed) {
        let track = row.track as usize;
        if track >= confirmed.len() {
            confirmed.resize(track + 1, false);
        }
        confirmed[track] = true;
    }
    rows.retain(|row| confirmed.get(row.track as usize).is_some_and(|&is| is));
}

fn table<'py>(py: Python<'py>, rows: &[Row], statuses: &[PlotStatus]) -> PyResult<Table<'py>> {
    let n = rows.len();
    let mut numbers = Output::<f64>::new(py, &[NUMBERS.iter().sum::<usize>() * n])?;
    let mut integers = Output::<i64>::new(py, &[INTEGERS.len() * n])?;
    let mut flags = Output::<bool>::new(py, &[FLAGS.len() * n])?;
    let mut track_of_plot = Output::<i64>::new(py, &[statuses.len()])?;
    let [time, position, velocity, covariance, innovation, spread, turning, height, vertical_rate] =
        columns(numbers.values()?, NUMBERS, n);
    let [track, radar, plot, identity, plan] = columns(integers.values()?, INTEGERS, n);
    let [confirmed, conforms] = columns(flags.values()?, FLAGS, n);
    for (i, row) in rows.iter().enumerate() {
        let [x, y, vx, vy] = row.estimate.mean.into();
        let Plane { xx, xy, yy } = row.innovation_covariance;
        time[i] = row.time;
        write(position, i, &[x, y]);
        write(velocity, i, &[vx, vy]);
        write(covariance, i, row.estimate.covariance.as_slice());
        write(innovation, i, &row.innovation);
        write(spread, i, &[xx, xy, xy, yy]);
        turning[i] = row.turn_probability;
        height[i] = row.height;
        vertical_rate[i] = row.vertical_rate;
        track[i] = row.track as i64;
        radar[i] = row.radar as i64;
        plot[i] = row.plot.map_or(-1, |plot| plot as i64);
        identity[i] = row.identity;
        plan[i] = row.plan.map_or(-1, |plan| plan as i64);
        confirmed[i] = row.confirmed;
        conforms[i] = row.conforms;
    }
    for (number, status) in track_of_plot.values()?.iter_mut().zip(statuses) {
        *number = match *status {
            PlotStatus::Track(number) => number as i64,
            PlotStatus::Invalid => -1,
            PlotStatus::Late => -2,
            PlotStatus::AtSensor => -3,
            PlotStatus::OutOfRange => -4,
            PlotStatus::ClockError => -5,
            PlotStatus::Duplicate => -6,
        };
    }
    Ok((
        numbers.into_array(),
        integers.into_array(),
        flags.into_array(),
        track_of_plot.into_array(),
    ))
}

/// Columns of these widths, one after the other in a block.
fn columns<T, const M: usize>(block: &mut [T], widths: [usize; M], rows: usize) -> [&mut [T]; M] {
    let mut rest = block;
    widths.map(|width| {
        let (column, others) = std::mem::take(&mut rest).split_at_mut(width * rows);
        rest = others;
        column
    })
}

/// Writes the numbers of one row of a column.
fn write(column: &mut [f64], row: usize, values: &[f64]) {
    column[row * values.len()..(row + 1) * values.len()].copy_from_slice(values);
}
