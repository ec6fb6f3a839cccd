//! Bindings of `tertia::tracker`.

use crate::arrays::{Samples, array, release, room_for, value_error};
use numpy::{PyArrayDyn, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use tertia::flightplan::Route;
use tertia::kalman::Singer;
use tertia::tracker::{self, Fate, Motion, Noise, Plan, Plot, Radar, Row, Settings, WindowRule};

/// Cost of a plot, for the choice of releasing the interpreter's lock.
const PLOT_NS: f64 = 1000.0;

/// Numbers of a radar: east, north, up, range_sigma, azimuth_sigma, period, range_max,
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
    initiation: (usize, usize),
    coasting: usize,
    speed_max: f64,
    clutter_density: f64,
    identity_error: f64,
    emergency_codes: Vec<i64>,
    patience: f64,
    plan_prior: f64,
    wind: [f64; 2],
    wind_sigma: f64,
    plans: Vec<PlanNumbers<'py>>,
}

/// A plan: waypoints (N, 2), speeds (N − 1), heights (N or none), then start_time, bank, turn_rate;
/// identity.
type PlanNumbers<'py> = (
    PyReadonlyArray2<'py, f64>,
    PyReadonlyArray1<'py, f64>,
    PyReadonlyArray1<'py, f64>,
    [f64; 3],
    i64,
);

type Numbers<'py> = Bound<'py, PyArrayDyn<f64>>;
type Flags<'py> = Bound<'py, PyArrayDyn<bool>>;
type Integers<'py> = Bound<'py, PyArrayDyn<i64>>;

/// Columns of a table: time, state, covariance, innovation, its covariance, turning, height, climb; then track, radar, plot,
/// identity, plan; then confirmed, conforming; then the fates of the plots.
type Table<'py> = (
    Vec<Numbers<'py>>,
    (Integers<'py>, Integers<'py>, Integers<'py>, Integers<'py>, Integers<'py>),
    (Flags<'py>, Flags<'py>),
    Integers<'py>,
);

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

    /// Takes plots, until `end`.
    #[allow(clippy::too_many_arguments)]
    fn track<'py>(
        &mut self,
        py: Python<'py>,
        time: Bound<'py, PyAny>,
        range: Bound<'py, PyAny>,
        azimuth: Bound<'py, PyAny>,
        height: Bound<'py, PyAny>,
        radar: PyReadonlyArray1<'py, i64>,
        identity: PyReadonlyArray1<'py, i64>,
        end: Option<f64>,
    ) -> PyResult<Table<'py>> {
        let columns =
            [(&time, "time"), (&range, "range"), (&azimuth, "azimuth"), (&height, "height")];
        let mut samples = Vec::with_capacity(columns.len());
        for (column, name) in columns {
            samples.push(Samples::extract(column, name)?);
        }
        let mut rows = Vec::with_capacity(samples.len());
        for column in &samples {
            rows.push(column.rows(0)?);
        }
        let values: Vec<&[f64]> = rows.iter().map(|rows| &*rows.values).collect();
        let (radar, identity) = (radar.as_slice()?, identity.as_slice()?);
        let count = radar.len();
        if values.iter().any(|column| column.len() != count) || identity.len() != count {
            return Err(PyValueError::new_err("the columns of plots differ in length"));
        }
        let mut plots = room_for(count)?;
        plots.extend((0..count).map(|i| Plot {
            time: values[0][i],
            range: values[1][i],
            azimuth: values[2][i],
            height: values[3][i],
            radar: usize::try_from(radar[i]).unwrap_or(usize::MAX),
            identity: identity[i],
        }));
        let (mut fates, mut found) = (Vec::new(), Vec::new());
        release(py, count as f64 * PLOT_NS, || self.0.track(&plots, end, &mut fates, &mut found))
            .map_err(value_error)?;
        table(py, &found, &fates)
    }

    /// Numbers of the confirmed tracks, and where they will be so many seconds from now.
    fn ahead<'py>(&self, py: Python<'py>, seconds: f64) -> PyResult<(Integers<'py>, Numbers<'py>)> {
        let found = self.0.ahead(seconds);
        let positions = found.iter().flat_map(|(_, position)| *position).collect();
        let tracks = found.iter().map(|(track, _)| *track as i64).collect();
        Ok((array(py, &[found.len()], tracks)?, array(py, &[found.len(), 2], positions)?))
    }

    /// Blocks the plan of a confirmed track until it is told otherwise, or lets it be believed again.
    fn hold_plan(&mut self, track: u64, held: bool) -> bool {
        self.0.hold_plan(track, held)
    }

    /// Numbers of the confirmed tracks whose plans are held.
    fn held_plans<'py>(&self, py: Python<'py>) -> PyResult<Integers<'py>> {
        let held: Vec<i64> = self.0.held_plans().into_iter().map(|track| track as i64).collect();
        array(py, &[held.len()], held)
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

fn radar(numbers: RadarNumbers) -> Radar {
    let [east, north, up, range_sigma, azimuth_sigma, period, range_max, detection] = numbers;
    Radar {
        position: [east, north, up],
        range_sigma,
        azimuth_sigma,
        period,
        range_max,
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
            initiation: self.initiation,
            coasting: self.coasting,
            speed_max: self.speed_max,
            clutter_density: self.clutter_density,
            identity_error: self.identity_error,
            emergency_codes: self.emergency_codes,
            patience: self.patience,
            plans: self.plans.iter().map(plan).collect::<PyResult<_>>()?,
            plan_prior: self.plan_prior,
            wind: self.wind,
            wind_sigma: self.wind_sigma,
        })
    }
}

fn plan(numbers: &PlanNumbers<'_>) -> PyResult<Plan> {
    let (waypoints, speeds, heights, [start_time, bank, turn_rate], identity) = numbers;
    let waypoints: Vec<[f64; 2]> =
        waypoints.as_array().rows().into_iter().map(|row| [row[0], row[1]]).collect();
    let (speeds, heights) = (speeds.as_slice()?, heights.as_slice()?);
    let route = Route::try_new(&waypoints, speeds, *start_time, heights, *bank, *turn_rate);
    Ok(Plan {
        route: route.map_err(value_error)?,
        bank: *bank,
        turn_rate: *turn_rate,
        identity: *identity,
    })
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

fn table<'py>(py: Python<'py>, rows: &[Row], fates: &[Fate]) -> PyResult<Table<'py>> {
    let n = rows.len();
    let mut states = room_for(4 * n)?;
    let mut covariances = room_for(16 * n)?;
    let mut innovations = room_for(2 * n)?;
    let mut spreads = room_for(4 * n)?;
    for row in rows {
        let spread = row.innovation_covariance;
        innovations.extend_from_slice(&row.innovation);
        spreads.extend_from_slice(&[spread.xx, spread.xy, spread.xy, spread.yy]);
        states.extend_from_slice(row.estimate.mean.as_slice());
        covariances.extend_from_slice(row.estimate.covariance.as_slice());
    }
    let numbers = |of: fn(&Row) -> f64| array(py, &[n], rows.iter().map(of).collect());
    let integers = |of: fn(&Row) -> i64| array(py, &[n], rows.iter().map(of).collect());
    let flags = |of: fn(&Row) -> bool| array(py, &[n], rows.iter().map(of).collect());
    let fates = fates.iter().map(|&fate| match fate {
        Fate::Track(number) => number as i64,
        Fate::Invalid => -1,
        Fate::Late => -2,
        Fate::AtRadar => -3,
        Fate::OutOfRange => -4,
        Fate::Stray => -5,
        Fate::Duplicate => -6,
    });
    Ok((
        vec![
            numbers(|row| row.time)?,
            array(py, &[n, 4], states)?,
            array(py, &[n, 4, 4], covariances)?,
            array(py, &[n, 2], innovations)?,
            array(py, &[n, 2, 2], spreads)?,
            numbers(|row| row.turning)?,
            numbers(|row| row.height)?,
            numbers(|row| row.climb)?,
        ],
        (
            integers(|row| row.track as i64)?,
            integers(|row| row.radar as i64)?,
            integers(|row| row.plot.map_or(-1, |plot| plot as i64))?,
            integers(|row| row.identity)?,
            integers(|row| row.plan.map_or(-1, |plan| plan as i64))?,
        ),
        (flags(|row| row.confirmed)?, flags(|row| row.conforming)?),
        array(py, &[fates.len()], fates.collect())?,
    ))
}
