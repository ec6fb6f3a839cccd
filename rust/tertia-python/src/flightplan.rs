//! Bindings of `tertia::flightplan`.

use crate::arrays::{
    Array, Input, Integers, Marks, Output, Threads, array, columns, for_each_item, release,
    value_error, vector,
};
use crate::sensors::{IdentityColumns, Named, identities_of, named};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use tertia::flightplan::{
    self, Monitor, Plan, Projection, Sighting, SpeedHistory, TimeOver, Turn, Verdict,
    speed_histories,
};
use tertia::interrupt::poll;
use tertia::sensors::Identities;

/// Cost of a score per leg, plot and plan, which determines the number of threads.
const SCORE_NS: f64 = 170.0;
/// Cost of a position or projection per leg, which determines the number of threads.
const LEG_NS: f64 = 150.0;

type Projected<'py> = (Array<'py>, Array<'py>, Array<'py>, Integers<'py>);

/// A flight plan, validated, with its path.
#[pyclass(frozen, module = "tertia._core")]
pub struct Route {
    plan: Plan,
    waypoints: Vec<[f64; 2]>,
    heights: Vec<f64>,
    start_time: f64,
}

#[pymethods]
impl Route {
    /// Waypoints (N, 2), speeds (N − 1), heights (N, or none), identities (negative or empty if unknown).
    #[new]
    fn new(
        waypoints: Input<'_>,
        speeds: Input<'_>,
        heights: Input<'_>,
        start_time: f64,
        bank: f64,
        turn_rate: f64,
        identities: Named,
    ) -> PyResult<Self> {
        let waypoints = waypoints.pairs("waypoints")?;
        let (speeds, heights) = (speeds.numbers("speeds")?, heights.numbers("heights")?);
        let route =
            flightplan::Route::try_new(&waypoints, &speeds, start_time, &heights, bank, turn_rate)
                .map_err(value_error)?;
        let identities = identities_of(identities);
        let plan = Plan { route, bank, turn_rate, identities };
        Ok(Self { plan, waypoints, heights, start_time })
    }

    /// Arguments from which pickle makes a copy.
    #[allow(clippy::type_complexity)] // arguments of `new`
    fn __getnewargs__<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Array<'py>, Array<'py>, Array<'py>, f64, f64, f64, Named)> {
        let Plan { route, bank, turn_rate, identities } = &self.plan;
        let waypoints = self.waypoints.concat();
        Ok((
            array(py, &[self.waypoints.len(), 2], waypoints)?,
            array(py, &[route.legs()], route.speeds().to_vec())?,
            vector(py, self.heights.clone())?,
            self.start_time,
            *bank,
            *turn_rate,
            named(identities),
        ))
    }

    /// Length of the path in metres.
    #[getter]
    fn length(&self) -> f64 {
        self.plan.route.length()
    }

    /// Times over the waypoints.
    #[getter]
    fn times<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        vector(py, self.plan.route.times().to_vec())
    }

    /// Path distances of the waypoints.
    #[getter]
    fn distances<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        vector(py, self.plan.route.marks().to_vec())
    }

    /// Angles, radii, leads and arcs of the turns; their starts, ends and centres.
    fn turns<'py>(&self, py: Python<'py>) -> PyResult<([Array<'py>; 4], [Array<'py>; 3])> {
        let route = &self.plan.route;
        let turns = &route.turns()[..route.legs() - 1];
        let points =
            |f: fn(&Turn) -> [f64; 2]| array(py, &[turns.len(), 2], turns.iter().flat_map(f));
        let of: [fn(&Turn) -> f64; 4] =
            [|turn| turn.angle, |turn| turn.radius, |turn| turn.lead, Turn::arc];
        Ok((
            columns(py, &[turns.len()], turns, of)?,
            [points(|turn| turn.start)?, points(|turn| turn.end)?, points(|turn| turn.centre)?],
        ))
    }

    /// Positions, directions (or velocities at times), and heights at path distances or at times.
    fn path<'py>(
        &self,
        py: Python<'py>,
        values: Input<'py>,
        are_times: bool,
    ) -> PyResult<[Output<'py>; 3]> {
        let route = &self.plan.route;
        let rows = values.blocks(if are_times { "time" } else { "along_track" }, 0)?;
        let new = |tail: &[usize]| Output::new(py, rows.shape, tail);
        let (mut position, mut direction, mut height) = (new(&[2])?, new(&[2])?, new(&[])?);
        let outputs = position.rows()?.zip(direction.rows()?).zip(height.values()?);
        release(py, LEG_NS * rows.size(), || {
            for (&value, ((position, direction), height)) in rows.values.iter().zip(outputs) {
                let (p, u) = if are_times { route.at(value) } else { route.path(value) };
                position.copy_from_slice(&p);
                direction.copy_from_slice(&u);
                *height = route.height(if are_times { route.distance(value) } else { value });
            }
        })?;
        Ok([position, direction, height])
    }

    /// Along-track and cross-track distances, directions and legs of the nearest points on the path.
    fn project<'py>(&self, py: Python<'py>, positions: Input<'py>) -> PyResult<Projected<'py>> {
        let route = &self.plan.route;
        let rows = positions.blocks("position", 1)?;
        let points = positions.pairs("position")?;
        let cost = LEG_NS * (points.len() * route.legs()) as f64;
        let found: Vec<Projection> =
            release(py, cost, || points.iter().map(|&p| route.project(p)).collect())?;
        let batch = rows.batch();
        let [along, across] = columns(py, batch, &found, [|f| f.along_track, |f| f.cross_track])?;
        let course = array(py, rows.shape, found.iter().flat_map(|f| f.course))?;
        let leg = array(py, batch, found.iter().map(|f| f.leg as i64))?;
        Ok((along, across, course, leg))
    }
}

impl Route {
    /// Returns the plan as a core type.
    pub fn plan(&self) -> &Plan {
        &self.plan
    }
}

/// Tracks (..., N): positions, velocities, covariances of both, heights; the last two are optional.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Tracks<'py> {
    time: Input<'py>,
    position: Input<'py>,
    velocity: Input<'py>,
    covariance: Option<Input<'py>>,
    height: Option<Input<'py>>,
}

impl Tracks<'_> {
    /// Returns the sightings of all tracks, track by track, and the shape (..., N).
    fn sightings(&self) -> PyResult<(Vec<Sighting>, Vec<usize>)> {
        let (shape, time) = (self.time.shape().to_vec(), self.time.numbers("time")?);
        let (position, velocity) =
            (self.position.pairs("position")?, self.velocity.pairs("velocity")?);
        let covariance = self.covariance.as_ref();
        let covariance = covariance.map(|value| value.points::<16>("covariance", 2)).transpose()?;
        let height = self.height.as_ref().map(|value| value.numbers("height")).transpose()?;
        let n = time.len();
        let counts = [
            position.len(),
            velocity.len(),
            covariance.as_ref().map_or(n, Vec::len),
            height.as_ref().map_or(n, Vec::len),
        ];
        if counts.iter().any(|&count| count != n) {
            return Err(PyValueError::new_err("the arrays of the tracks differ in length"));
        }
        let sighting = |i: usize| {
            let covariance = covariance.as_ref().map(|rows| &rows[i]);
            let height = height.as_ref().map_or(f64::NAN, |height| height[i]);
            Sighting::new(time[i], position[i], velocity[i], covariance, height)
        };
        Ok(((0..n).map(sighting).collect(), shape))
    }
}

/// Speeds at which a plan passes its waypoints at given times.
#[pyfunction]
pub fn plan_speeds<'py>(
    py: Python<'py>,
    waypoints: Input<'py>,
    times: Input<'py>,
    bank: f64,
    turn_rate: f64,
) -> PyResult<Array<'py>> {
    let (waypoints, times) = (waypoints.pairs("waypoints")?, times.numbers("times")?);
    let route = flightplan::Route::through(&waypoints, &times, &[], bank, turn_rate)
        .map_err(value_error)?;
    array(py, &[route.legs()], route.speeds().to_vec())
}

/// Mean scores (..., M) of tracks (..., N) for M plans, the plan of each track, and the reason.
#[pyfunction]
pub fn correlate<'py>(
    py: Python<'py>,
    plans: Vec<PyRef<'py, Route>>,
    tracks: Tracks<'py>,
    identities: IdentityColumns<'py>,
    n_threads: Threads,
) -> PyResult<(Output<'py>, Output<'py, i64>, Output<'py, i64>)> {
    let names: Vec<Identities> = plans.iter().map(|route| route.plan.identities).collect();
    let routes: Vec<&flightplan::Route> = plans.iter().map(|route| &route.plan.route).collect();
    let (seen, shape) = tracks.sightings()?;
    let (&n, batch) = shape.split_last().unwrap_or((&0, &[]));
    let count: usize = batch.iter().product();
    let identities = identities.read(count)?;
    let mut scores = Output::new(py, batch, &[routes.len()])?;
    let (mut chosen, mut status) = (Output::new(py, batch, &[])?, Output::new(py, batch, &[])?);
    let legs: usize = routes.iter().map(|route| route.legs()).sum();
    let cost = SCORE_NS * (legs * n * count) as f64;
    let outputs = scores.rows()?.zip(chosen.values()?).zip(status.values()?).enumerate();
    for_each_item(py, cost, n_threads, outputs, |(at, ((scores, chosen), status))| {
        let seen = &seen[at * n..(at + 1) * n];
        let plots = flightplan::mean_scores(&routes, seen, scores);
        let own = identities.get(at);
        let is_same = |plan: usize| own.same(&names[plan]) == Some(true);
        let decision = flightplan::decide(scores, is_same, plots);
        *chosen = decision.plan.map_or(-1, |plan| plan as i64);
        *status = decision.status as i64;
        Ok(())
    })?;
    Ok((scores, chosen, status))
}

/// For every sighting of a track: leg, along-track and cross-track distance, cumulative sum, whether the
/// track conforms and whether it may be turning. Without a sighting: nan, no leg, and no conformance.
#[pyfunction]
#[allow(clippy::type_complexity)] // what Python unpacks
pub fn conformance<'py>(
    py: Python<'py>,
    route: PyRef<'py, Route>,
    track: Tracks<'py>,
    update_interval: f64,
) -> PyResult<(Integers<'py>, [Array<'py>; 3], [Marks<'py>; 2])> {
    let (seen, shape) = track.sightings()?;
    let route = &route.plan.route;
    let cost = LEG_NS * (seen.len() * route.legs()) as f64;
    let verdicts: Vec<_> =
        release(py, cost, || Monitor::follow(route, &seen, update_interval).collect())?;
    let number = |f: fn(&Verdict) -> f64| {
        let values = verdicts.iter().map(|verdict| verdict.as_ref().map_or(f64::NAN, f));
        array(py, &shape, values)
    };
    let mark = |f: fn(&Verdict) -> bool| {
        array(py, &shape, verdicts.iter().map(|verdict| verdict.as_ref().is_some_and(f)))
    };
    let legs = verdicts.iter().map(|verdict| verdict.map_or(-1, |verdict| verdict.leg as i64));
    Ok((
        array(py, &shape, legs)?,
        [number(|v| v.along_track)?, number(|v| v.cross_track)?, number(|v| v.cusum)?],
        [mark(|v| v.conforms)?, mark(|v| v.in_zone)?],
    ))
}

/// Times over the waypoints (N, W) and speeds after every sighting of a track, each with its standard
/// deviation.
#[pyfunction]
pub fn times_over<'py>(
    py: Python<'py>,
    route: PyRef<'py, Route>,
    track: Tracks<'py>,
    update_interval: f64,
    speed_change_sigma: f64,
) -> PyResult<[Array<'py>; 4]> {
    let (seen, shape) = track.sightings()?;
    let route = &route.plan.route;
    let count = route.legs() + 1;
    let wide = [shape.as_slice(), &[count]].concat();
    let cost = LEG_NS * (seen.len() * count) as f64;
    let (over, speeds): (Vec<TimeOver>, Vec<(f64, f64)>) = release(py, cost, || {
        let histories: Vec<_> = speed_histories(route, &seen, update_interval).collect();
        let over = histories.iter().flat_map(|history| {
            poll();
            (0..count).map(|waypoint| history.time_over(route, waypoint, speed_change_sigma))
        });
        (over.collect(), histories.iter().map(SpeedHistory::speed).collect())
    })?;
    let [time, time_sigma] = columns(py, &wide, &over, [|over| over.time, |over| over.sigma])?;
    let [speed, speed_sigma] = columns(py, &shape, &speeds, [|speed| speed.0, |speed| speed.1])?;
    Ok([time, time_sigma, speed, speed_sigma])
}
