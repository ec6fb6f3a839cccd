//! Bindings of `tertia::flightplan`.

use crate::arrays::{Output, Rows, Samples, array, chunks, release, repeated, value_error};
use numpy::PyArrayDyn;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::num::NonZero;
use tertia::batch::for_each_row;
use tertia::flightplan::{self, Monitor, Projection, Refinement, Route, Sighting, Turn};

/// Cost of a score by leg, plot and plan, for the choice of threads.
const SCORE_NS: f64 = 170.0;
/// Cost of a position or projection by leg, likewise.
const LEG_NS: f64 = 150.0;

type Array<'py> = Bound<'py, PyArrayDyn<f64>>;
type Integers<'py> = Bound<'py, PyArrayDyn<i64>>;
type Marks<'py> = Bound<'py, PyArrayDyn<bool>>;
type Geometry<'py> = (f64, Array<'py>, Array<'py>, [Array<'py>; 4], [Array<'py>; 3]);
type Projected<'py> = (Array<'py>, Array<'py>, Array<'py>, Integers<'py>);

/// A flight plan as Python holds it.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Plan<'py> {
    waypoints: Bound<'py, PyAny>,
    speeds: Bound<'py, PyAny>,
    start_time: f64,
    heights: Option<Bound<'py, PyAny>>,
    bank: f64,
    turn_rate: f64,
    identity: i64,
}

impl Plan<'_> {
    fn route(&self) -> PyResult<Route> {
        let waypoints = pairs(&self.waypoints, "waypoints")?;
        let speeds = numbers(&self.speeds, "speeds")?;
        let heights = self.heights.as_ref().map(|value| numbers(value, "heights")).transpose()?;
        let heights = heights.unwrap_or_default();
        let (bank, rate) = (self.bank, self.turn_rate);
        Route::try_new(&waypoints, &speeds, self.start_time, &heights, bank, rate)
            .map_err(value_error)
    }
}

/// Tracks (..., N): positions, velocities, covariances of both, heights; all but the times, positions
/// and velocities may be missing.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Tracks<'py> {
    times: Bound<'py, PyAny>,
    positions: Bound<'py, PyAny>,
    velocities: Bound<'py, PyAny>,
    covariances: Option<Bound<'py, PyAny>>,
    heights: Option<Bound<'py, PyAny>>,
}

impl Tracks<'_> {
    /// The sightings of all tracks, one after the other, and the shape (..., N).
    fn sightings(&self) -> PyResult<(Vec<Sighting>, Vec<usize>)> {
        let times = Samples::extract(&self.times, "times")?;
        let shape = times.shape().to_vec();
        let times = times.rows(0)?.values.into_owned();
        let positions = pairs(&self.positions, "positions")?;
        let velocities = pairs(&self.velocities, "velocities")?;
        let covariances = self
            .covariances
            .as_ref()
            .map(|value| rows_of::<16>(value, "covariances", 2))
            .transpose()?;
        let heights = self.heights.as_ref().map(|value| numbers(value, "heights")).transpose()?;
        let n = times.len();
        let counts = [
            positions.len(),
            velocities.len(),
            covariances.as_ref().map_or(n, Vec::len),
            heights.as_ref().map_or(n, Vec::len),
        ];
        if counts.iter().any(|&count| count != n) {
            return Err(PyValueError::new_err("the arrays of the tracks differ in length"));
        }
        let sighting = |i: usize| {
            let covariance = covariances.as_ref().map(|rows| &rows[i]);
            let height = heights.as_ref().map_or(f64::NAN, |heights| heights[i]);
            Sighting::new(times[i], positions[i], velocities[i], covariance, height)
        };
        Ok(((0..n).map(sighting).collect(), shape))
    }
}

fn numbers(value: &Bound<'_, PyAny>, name: &'static str) -> PyResult<Vec<f64>> {
    Ok(Samples::extract(value, name)?.rows(0)?.values.into_owned())
}

/// Rows of so many numbers, which are the last axes.
fn rows_of<const M: usize>(
    value: &Bound<'_, PyAny>,
    name: &'static str,
    axes: usize,
) -> PyResult<Vec<[f64; M]>> {
    let samples = Samples::extract(value, name)?;
    let rows = if samples.shape().len() < axes { None } else { Some(samples.blocks(axes)?) };
    let fits = |rows: &Rows<'_>| rows.len() == M;
    let Some(rows) = rows.filter(fits) else {
        let shape = samples.shape();
        return Err(PyValueError::new_err(format!("{name} has shape {shape:?}; it does not fit")));
    };
    Ok(rows.values.as_chunks().0.to_vec())
}

fn pairs(value: &Bound<'_, PyAny>, name: &'static str) -> PyResult<Vec<[f64; 2]>> {
    rows_of::<2>(value, name, 1)
}

/// The speeds with which a plan passes its waypoints at given times.
#[pyfunction]
pub fn plan_speeds<'py>(
    py: Python<'py>,
    waypoints: &Bound<'py, PyAny>,
    times: &Bound<'py, PyAny>,
    bank: f64,
    turn_rate: f64,
) -> PyResult<Array<'py>> {
    let (waypoints, times) = (pairs(waypoints, "waypoints")?, numbers(times, "times")?);
    let route = Route::through(&waypoints, &times, &[], bank, turn_rate).map_err(value_error)?;
    array(py, &[route.legs()], route.speeds().to_vec())
}

/// Length, passing times and distances of the waypoints; of the turns angles, radii, leads and arcs,
/// and starts, ends and centres.
#[pyfunction]
pub fn plan_geometry<'py>(py: Python<'py>, plan: Plan<'py>) -> PyResult<Geometry<'py>> {
    let route = plan.route()?;
    let turns = &route.turns()[..route.legs() - 1];
    let column = |f: fn(&Turn) -> f64| array(py, &[turns.len()], turns.iter().map(f).collect());
    let points =
        |f: fn(&Turn) -> [f64; 2]| array(py, &[turns.len(), 2], turns.iter().flat_map(f).collect());
    Ok((
        route.length(),
        array(py, &[route.legs() + 1], route.times().to_vec())?,
        array(py, &[route.legs() + 1], route.marks().to_vec())?,
        [
            column(|turn| turn.angle)?,
            column(|turn| turn.radius)?,
            column(|turn| turn.lead)?,
            column(Turn::arc)?,
        ],
        [points(|turn| turn.start)?, points(|turn| turn.end)?, points(|turn| turn.centre)?],
    ))
}

/// Positions, directions, and distances of a plan at distances, or at times.
#[pyfunction]
pub fn plan_path<'py>(
    py: Python<'py>,
    plan: Plan<'py>,
    values: &Bound<'py, PyAny>,
    are_times: bool,
) -> PyResult<[Array<'py>; 3]> {
    let route = plan.route()?;
    let samples = Samples::extract(values, if are_times { "time" } else { "distance" })?;
    let rows = samples.blocks(0)?;
    let shape = [rows.shape, &[2]].concat();
    let (mut position, mut direction) = (Output::new(py, &shape)?, Output::new(py, &shape)?);
    let mut height = Output::new(py, rows.shape)?;
    let count = rows.values.len();
    let outputs = chunks(position.values()?, 2, count)
        .zip(chunks(direction.values()?, 2, count))
        .zip(height.values()?);
    release(py, LEG_NS * count as f64, || {
        for (&value, ((position, direction), height)) in rows.values.iter().zip(outputs) {
            let (p, u) = if are_times { route.at(value) } else { route.path(value) };
            position.copy_from_slice(&p);
            direction.copy_from_slice(&u);
            *height = route.height(if are_times { route.distance(value) } else { value });
        }
    });
    Ok([position.into_array(), direction.into_array(), height.into_array()])
}

/// Distances, offsets, directions and legs of the points of a plan nearest to positions.
#[pyfunction]
pub fn plan_project<'py>(
    py: Python<'py>,
    plan: Plan<'py>,
    positions: &Bound<'py, PyAny>,
) -> PyResult<Projected<'py>> {
    let route = plan.route()?;
    let samples = Samples::extract(positions, "position")?;
    let rows = samples.blocks(1)?;
    let points = pairs(positions, "position")?;
    let cost = LEG_NS * (points.len() * route.legs()) as f64;
    let found: Vec<Projection> =
        release(py, cost, || points.iter().map(|&p| route.project(p)).collect());
    let batch = rows.batch();
    Ok((
        array(py, batch, found.iter().map(|f| f.distance).collect())?,
        array(py, batch, found.iter().map(|f| f.offset).collect())?,
        array(py, rows.shape, found.iter().flat_map(|f| f.course).collect())?,
        array(py, batch, found.iter().map(|f| f.leg as i64).collect())?,
    ))
}

/// Mean scores (..., M) of tracks (..., N) against M plans, the plan of each, and why.
#[pyfunction]
pub fn correlate<'py>(
    py: Python<'py>,
    plans: Vec<Plan<'py>>,
    tracks: Tracks<'py>,
    identities: &Bound<'py, PyAny>,
    n_threads: Option<NonZero<usize>>,
) -> PyResult<(Array<'py>, Integers<'py>, Integers<'py>)> {
    let routes = plans.iter().map(Plan::route).collect::<PyResult<Vec<_>>>()?;
    let names: Vec<i64> = plans.iter().map(|plan| plan.identity).collect();
    let (seen, shape) = tracks.sightings()?;
    let (&n, batch) = shape.split_last().unwrap_or((&0, &[]));
    let count: usize = batch.iter().product();
    let identities: Vec<i64> = identities.extract()?;
    if identities.len() != count {
        return Err(PyValueError::new_err("identities must have one for each track"));
    }
    let mut scores = Output::new(py, &[batch, &[routes.len()]].concat())?;
    let (mut chosen, mut status) = (repeated(-1_i64, count)?, repeated(0_i64, count)?);
    let legs: usize = routes.iter().map(Route::legs).sum();
    let cost = SCORE_NS * (legs * n * count) as f64;
    let outputs = chunks(scores.values()?, routes.len(), count)
        .zip(chunks(&mut chosen, 1, count))
        .zip(chunks(&mut status, 1, count))
        .enumerate();
    let done = release(py, cost, || {
        for_each_row(
            outputs,
            cost,
            n_threads,
            || (),
            |(), (at, ((scores, chosen), status))| {
                let seen = &seen[at * n..(at + 1) * n];
                let plots = flightplan::mean_scores(&routes, seen, scores);
                let is_same = |plan: usize| names[plan] >= 0 && names[plan] == identities[at];
                let decision = flightplan::decide(scores, is_same, plots);
                chosen[0] = decision.plan.map_or(-1, |plan| plan as i64);
                status[0] = decision.status as i64;
                Ok(())
            },
        )
    });
    done.map_err(|failure| value_error(failure.error))?;
    Ok((scores.into_array(), array(py, batch, chosen)?, array(py, batch, status)?))
}

/// Legs, distances, offsets, levels, and whether it conforms and may be turning, of every sighting
/// of a track; nan, no leg and no conformance where there is none.
#[pyfunction]
#[allow(clippy::type_complexity)] // what Python unpacks
pub fn conformance<'py>(
    py: Python<'py>,
    plan: Plan<'py>,
    track: Tracks<'py>,
    period: f64,
) -> PyResult<(Integers<'py>, [Array<'py>; 3], [Marks<'py>; 2])> {
    let route = plan.route()?;
    let (seen, shape) = track.sightings()?;
    let n = seen.len();
    let (mut legs, mut numbers) = (repeated(-1_i64, n)?, [(); 3].map(|()| vec![f64::NAN; n]));
    let mut marks = [(); 2].map(|()| vec![false; n]);
    let mut monitor: Option<Monitor> = None;
    for (i, seen) in seen.iter().enumerate().filter(|(_, seen)| seen.is_present()) {
        let monitor = monitor.get_or_insert_with(|| Monitor::new(route.project(seen.position).leg));
        let verdict = monitor.update(&route, seen, 0.0, period);
        let (distance, offset) = route.project_leg(verdict.leg, seen.position);
        legs[i] = verdict.leg as i64;
        numbers[0][i] = distance;
        numbers[1][i] = offset;
        numbers[2][i] = verdict.level;
        marks[0][i] = verdict.conforming;
        marks[1][i] = verdict.in_zone;
    }
    let [distance, offset, level] = numbers.map(|values| array(py, &shape, values));
    let [conforming, in_zone] = marks.map(|values| array(py, &shape, values));
    Ok((array(py, &shape, legs)?, [distance?, offset?, level?], [conforming?, in_zone?]))
}

/// Passing times (N, W) with their standard deviations, speeds with theirs, after every sighting of a
/// track, those on a leg of -1 left out.
#[pyfunction]
pub fn passing_times<'py>(
    py: Python<'py>,
    plan: Plan<'py>,
    track: Tracks<'py>,
    legs: Vec<i64>,
    drift: f64,
) -> PyResult<[Array<'py>; 4]> {
    let route = plan.route()?;
    let (seen, shape) = track.sightings()?;
    if legs.len() != seen.len() {
        return Err(PyValueError::new_err("legs must have one for each sighting"));
    }
    let (n, count) = (seen.len(), route.legs() + 1);
    let (mut times, mut sigmas) = (Vec::with_capacity(n * count), Vec::with_capacity(n * count));
    let (mut speeds, mut speed_sigmas) = (Vec::with_capacity(n), Vec::with_capacity(n));
    let mut refinement = Refinement::new(drift);
    for (seen, &leg) in seen.iter().zip(&legs) {
        if let Ok(leg) = usize::try_from(leg)
            && leg < route.legs()
            && seen.is_present()
        {
            refinement.update(&route, leg, seen);
        }
        for waypoint in 0..count {
            let passing = refinement.passing(&route, waypoint);
            times.push(passing.time);
            sigmas.push(passing.sigma);
        }
        let (speed, sigma) = refinement.speed();
        speeds.push(speed);
        speed_sigmas.push(sigma);
    }
    let wide = [shape.as_slice(), &[count]].concat();
    Ok([
        array(py, &wide, times)?,
        array(py, &wide, sigmas)?,
        array(py, &shape, speeds)?,
        array(py, &shape, speed_sigmas)?,
    ])
}
