//! Bindings of `tertia::simulate`.

use crate::arrays::{
    Array, Input, Integers, Marks, Threads, array, for_each_item, release, vector,
};
use numpy::{PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use tertia::simulate::{
    self as core, Beam, Complex, Flight, Passing, Pilot, Process, Route, Sample, Wander,
};

/// Cost of a step of a flight, and of a passage of a beam, which determines the number of threads.
const STEP_NS: f64 = 400.0;

/// Flights along routes of at most M waypoints, (F, M); shorter routes repeat their last waypoint.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Columns<'py> {
    waypoints: Input<'py>,
    speeds: Input<'py>,
    heights: Input<'py>,
    passing: PyReadonlyArray2<'py, i64>,
    early: Input<'py>,
    last: PyReadonlyArray1<'py, i64>,
    leave: PyReadonlyArray1<'py, i64>,
    rejoin: PyReadonlyArray1<'py, i64>,
    longest: Input<'py>,
    wind: Input<'py>,
    speed_error: Input<'py>,
    bank: Input<'py>,
    roll: Input<'py>,
    turn_rate: Input<'py>,
    /// Values and rates of the navigation error, and of the variation of the speed, (F, 2).
    offset: Input<'py>,
    variation: Input<'py>,
}

/// Transition and root of the covariance of a process.
type Matrices = [[[f64; 2]; 2]; 2];

/// Flights that advance step by step.
#[pyclass(module = "tertia._core")]
pub struct Flights {
    flights: Vec<Flight>,
    samples: Vec<Vec<Sample>>,
}

#[pymethods]
impl Flights {
    #[new]
    fn new(
        columns: Columns<'_>,
        offset: Matrices,
        variation: Matrices,
        step: f64,
    ) -> PyResult<Self> {
        let flights = columns.flights(process(offset), process(variation), step)?;
        let samples = flights.iter().map(|_| Vec::new()).collect();
        Ok(Self { flights, samples })
    }

    /// Advances as long as there are normal numbers (B, 2, 2, F), those for the speed before those for
    /// navigation; returns the number of steps until the last flight ended.
    fn advance(&mut self, py: Python<'_>, noise: Input<'_>, n_threads: Threads) -> PyResult<usize> {
        let noise = noise.numbers("noise")?;
        let n = self.flights.len();
        let steps = noise.len() / (4 * n).max(1);
        let mut used = vec![0_usize; n];
        let cost = STEP_NS * (steps * n) as f64;
        let rows = self.flights.iter_mut().zip(&mut self.samples).zip(&mut used).enumerate();
        for_each_item(py, cost, n_threads, rows, |(i, ((flight, samples), used))| {
            let at = |step: usize, which: usize| noise[(4 * step + which) * n + i];
            for step in 0..steps {
                let Some(sample) = flight.sample() else { break };
                samples.push(sample);
                flight.advance([at(step, 0), at(step, 1)], [at(step, 2), at(step, 3)]);
                *used = step + 1;
            }
            Ok(())
        })?;
        Ok(used.into_iter().max().unwrap_or(0))
    }

    /// Whether any flight has not ended yet.
    #[getter]
    fn is_flying(&self) -> bool {
        self.flights.iter().any(|flight| flight.sample().is_some())
    }

    /// Numbers of samples; positions and velocities (F, S, 2), rates of turn and heights (F, S), nan
    /// after the end; whether the flights turn; times at which they left their plans and were back.
    #[allow(clippy::type_complexity)] // what Python unpacks
    fn samples<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Integers<'py>, [Array<'py>; 4], Marks<'py>, [Array<'py>; 2])> {
        let n = self.flights.len();
        let longest = self.samples.iter().map(Vec::len).max().unwrap_or(0);
        let padded =
            || self.samples.iter().flat_map(|samples| (0..longest).map(|k| samples.get(k)));
        let pair = |f: fn(&Sample) -> [f64; 2]| {
            let values = padded().flat_map(|sample| sample.map_or([f64::NAN; 2], f));
            array(py, &[n, longest, 2], values)
        };
        let number = |f: fn(&Sample) -> f64| {
            array(py, &[n, longest], padded().map(|sample| sample.map_or(f64::NAN, f)))
        };
        let turning = padded().map(|sample| sample.is_some_and(|sample| sample.is_turning));
        let (left, returned): (Vec<_>, Vec<_>) = self.flights.iter().map(Flight::departure).unzip();
        Ok((
            array(py, &[n], self.samples.iter().map(|samples| samples.len() as i64))?,
            [
                pair(|sample| sample.position)?,
                pair(|sample| sample.velocity)?,
                number(|sample| sample.turn_rate)?,
                number(|sample| sample.height)?,
            ],
            array(py, &[n, longest], turning)?,
            [array(py, &[n], left)?, array(py, &[n], returned)?],
        ))
    }
}

fn process([transition, root]: Matrices) -> Process {
    Process { transition, root }
}

impl Columns<'_> {
    fn flights(&self, offset: Process, variation: Process, step: f64) -> PyResult<Vec<Flight>> {
        let shape = self.passing.as_array().dim();
        let (n, width) = shape;
        let passing = self.passing.as_slice()?;
        let (last, leave, rejoin) =
            (self.last.as_slice()?, self.leave.as_slice()?, self.rejoin.as_slice()?);
        let points = self.waypoints.pairs("waypoints")?;
        let wide = [
            self.speeds.numbers("speeds")?,
            self.heights.numbers("heights")?,
            self.early.numbers("early")?,
        ];
        let each = [
            self.longest.numbers("longest")?,
            self.speed_error.numbers("speed_error")?,
            self.bank.numbers("bank")?,
            self.roll.numbers("roll")?,
            self.turn_rate.numbers("turn_rate")?,
        ];
        let twos = [
            self.wind.pairs("wind")?,
            self.offset.pairs("offset")?,
            self.variation.pairs("variation")?,
        ];
        let fits = points.len() == n * width
            && wide.iter().all(|column| column.len() == n * width)
            && each.iter().all(|column| column.len() == n)
            && twos.iter().all(|column| column.len() == n)
            && [last.len(), leave.len(), rejoin.len()] == [n; 3]
            && last.iter().all(|&last| 0 < last && last < width as i64);
        if !fits {
            return Err(PyValueError::new_err("the columns of flights differ in length"));
        }
        let [speeds, heights, early] = wide;
        let [longest, speed_error, bank, roll, turn_rate] = each;
        let [wind, offsets, variations] = twos;
        let kind = |&passing: &i64| match passing {
            0 => Passing::FlyBy,
            1 => Passing::FlyOver,
            _ => Passing::Direct,
        };
        let complex = |&[east, north]: &[f64; 2]| Complex::new(east, north);
        let flight = |i: usize| {
            let (from, to) = (i * width, i * width + last[i] as usize + 1);
            let route = Route {
                waypoints: points[from..to].iter().map(complex).collect(),
                speeds: speeds[from..to - 1].to_vec(),
                heights: heights[from..to].to_vec(),
                passing: passing[from..to].iter().map(kind).collect(),
                early: early[from..to].to_vec(),
                leave: usize::try_from(leave[i]).ok(),
                rejoin: usize::try_from(rejoin[i]).ok(),
                longest: longest[i],
            };
            let pilot = Pilot {
                wind: complex(&wind[i]),
                speed_error: speed_error[i],
                bank: bank[i],
                roll: roll[i],
                turn_rate: turn_rate[i],
            };
            let wanders = (Wander::new(offset, offsets[i]), Wander::new(variation, variations[i]));
            Flight::new(route, pilot, step, wanders.0, wanders.1)
        };
        Ok((0..n).map(flight).collect())
    }
}

/// Traffic: start and count (F,), position (F, S, 2), velocity (F, S, 2) and height (F, S).
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Traffic<'py> {
    start: Input<'py>,
    count: PyReadonlyArray1<'py, i64>,
    step: f64,
    position: Input<'py>,
    velocity: Input<'py>,
    height: Input<'py>,
}

impl Traffic<'_> {
    fn with<T: Send>(
        &self,
        py: Python<'_>,
        cost: f64,
        work: impl FnOnce(&core::Traffic<'_>) -> T + Send,
    ) -> PyResult<T> {
        let start = self.start.numbers("start")?;
        let (position, velocity) =
            (self.position.pairs("position")?, self.velocity.pairs("velocity")?);
        let height = self.height.numbers("height")?;
        let (count, flights) = (self.count.as_slice()?, start.len());
        let samples = height.len() / flights.max(1);
        let holds = count.len() == flights
            && position.len() == flights * samples
            && [velocity.len(), height.len()] == [position.len(); 2]
            && count.iter().all(|&count| 2 <= count && count <= samples as i64);
        if !holds {
            return Err(PyValueError::new_err("the columns of traffic do not match"));
        }
        let traffic = core::Traffic {
            start: &start,
            count,
            step: self.step,
            position: &position,
            velocity: &velocity,
            height: &height,
        };
        release(py, cost, || work(&traffic))
    }
}

/// Positions and velocities (N, 2) and heights (N,) of flights at times.
#[pyfunction]
pub fn traffic_states<'py>(
    py: Python<'py>,
    traffic: Traffic<'py>,
    flight: PyReadonlyArray1<'py, i64>,
    time: Input<'py>,
) -> PyResult<[Array<'py>; 3]> {
    let (flight, time) = (flight.as_slice()?, time.numbers("time")?);
    let flights = traffic.count.as_slice()?.len();
    let n = time.len();
    if flight.len() != n
        || flight.iter().any(|&k| usize::try_from(k).map_or(true, |k| k >= flights))
    {
        return Err(PyValueError::new_err("there must be a flight for each time"));
    }
    let states = traffic.with(py, STEP_NS * n as f64, |traffic| {
        let states = flight.iter().zip(&time).map(|(&k, &t)| traffic.state(k as usize, t));
        states.collect::<Vec<_>>()
    })?;
    let pair = |f: fn(&core::State) -> Complex<f64>| {
        let values = states.iter().map(f).flat_map(|z| [z.re, z.im]);
        array(py, &[n, 2], values)
    };
    Ok([
        pair(|state| state.position)?,
        pair(|state| state.velocity)?,
        array(py, &[n], states.iter().map(|state| state.height))?,
    ])
}

/// Flights (N,) and times (N,) at which the beam of a radar passes them.
#[pyfunction]
pub fn beam_meetings<'py>(
    py: Python<'py>,
    traffic: Traffic<'py>,
    position: [f64; 2],
    scan_period: f64,
    phase: f64,
) -> PyResult<(Integers<'py>, Array<'py>)> {
    let beam = Beam { position, scan_period, phase };
    let samples = traffic.count.as_slice()?.iter().sum::<i64>() as f64;
    let found = traffic.with(py, STEP_NS * samples, |traffic| core::meetings(traffic, &beam))?;
    let (flights, times): (Vec<i64>, Vec<f64>) =
        found.into_iter().map(|(flight, time)| (flight as i64, time)).unzip();
    Ok((vector(py, flights)?, vector(py, times)?))
}
