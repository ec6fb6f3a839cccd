//! Bindings of `tertia::tertiary`.

use crate::arrays::{Array, Input, Integers, Marks, Threads, array, choice, release, value_error};
use crate::registration::{with_deviation, without_deviation};
use crate::sensors::{IdentityColumns, Radar, callsigns};
use numpy::PyReadonlyArray1;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use tertia::registration::KINDS;
use tertia::tertiary::{Centre, Row, Rule, Settings, SystemTrack};

/// Rows of the tracks of sensors.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct TrackRows<'py> {
    time: Input<'py>,
    sensor: PyReadonlyArray1<'py, i64>,
    track: PyReadonlyArray1<'py, i64>,
    state: Input<'py>,
    covariance: Input<'py>,
    height: Input<'py>,
    identities: IdentityColumns<'py>,
    turn_probability: Input<'py>,
}

impl TrackRows<'_> {
    /// Replaces `rows`, whose memory is reused.
    fn read(&self, rows: &mut Vec<Row>, sensors: usize) -> PyResult<()> {
        let columns = [&self.time, &self.height, &self.turn_probability];
        let [time, height, turning] = columns.map(|column| column.numbers("tracks"));
        let (time, height, turning) = (time?, height?, turning?);
        let (sensor, track, n) = (self.sensor.as_slice()?, self.track.as_slice()?, time.len());
        let (states, covariances) =
            (self.state.blocks("state", 1)?, self.covariance.blocks("covariance", 2)?);
        states.require(4, n)?;
        covariances.require(16, n)?;
        let (state, covariance) = (states.values.as_chunks().0, covariances.values.as_chunks().0);
        let identities = self.identities.read(n)?;
        if [height.len(), turning.len(), sensor.len(), track.len()].iter().any(|&k| k != n) {
            return Err(PyValueError::new_err("the columns differ in length"));
        }
        if let Some(other) = sensor.iter().find(|&&k| !(0..sensors as i64).contains(&k)) {
            let text = format!("sensor is {other}; there are {sensors}");
            return Err(PyValueError::new_err(text));
        }
        rows.clear();
        rows.extend((0..n).map(|i| Row {
            sensor: sensor[i] as usize,
            track: track[i],
            time: time[i],
            state: state[i],
            covariance: covariance[i],
            height: height[i],
            identities: identities.get(i),
            turn_probability: turning[i],
        }));
        Ok(())
    }
}

/// Numbers (N,), states (N, 4), covariances (N, 4, 4), p-values and heights (N,); tracks of the sensors
/// (N, K), −1 for none; numbers, addresses, codes and callsigns, (N,); whether targets are confirmed and
/// whether they are doubtful, (N,).
type Picture<'py> =
    (Integers<'py>, [Array<'py>; 4], Integers<'py>, [Integers<'py>; 3], Py<PyAny>, [Marks<'py>; 2]);

/// The fusion centre.
#[pyclass(module = "tertia._core")]
pub struct FusionCentre {
    centre: Centre,
    sensors: usize,
    /// Memory of the rows of an update.
    rows: Vec<Row>,
}

#[pymethods]
impl FusionCentre {
    /// `mean`, `sigma` and `drift` are the prior means of the errors (K, 4), their standard deviations,
    /// and the rates of their drift.
    #[new]
    fn new(
        radars: Vec<PyRef<'_, Radar>>,
        method: &str,
        cross_correlation: [f64; 2],
        registers: bool,
        mean: Input<'_>,
        sigma: Input<'_>,
        drift: Input<'_>,
    ) -> PyResult<Self> {
        let choices = [
            ("tracklets", Rule::Tracklets),
            ("matrix", Rule::Matrix),
            ("covariance-intersection", Rule::Intersection),
            ("static", Rule::Static),
            ("equal", Rule::Equal),
            ("paper", Rule::Paper),
        ];
        let rule = choice("method", method, &choices)?;
        let [mean, sigma, drift] = [(mean, "mean"), (sigma, "sigma"), (drift, "drift")]
            .map(|(input, name)| input.points(name, 1).map(with_deviation));
        let (mean, sigma, drift) = (mean?, sigma?, drift?);
        let radars: Vec<_> = radars.iter().map(|radar| radar.0.clone()).collect();
        let sensors = radars.len();
        if [&mean, &sigma, &drift].iter().any(|own| own.len() != sensors) {
            return Err(PyValueError::new_err("the columns differ in length"));
        }
        let errors = (0..sensors).map(|k| [mean[k], sigma[k], drift[k]]).collect();
        let centre = Centre::new(Settings { radars, rule, cross_correlation, registers, errors });
        Ok(Self { centre, sensors, rows: Vec::new() })
    }

    /// Makes the picture at a time from rows in any order.
    fn update<'py>(
        &mut self,
        py: Python<'py>,
        tracks: TrackRows<'py>,
        time: f64,
        n_threads: Threads,
    ) -> PyResult<Picture<'py>> {
        tracks.read(&mut self.rows, self.sensors)?;
        let Self { centre, rows, .. } = self;
        let found = release(py, 1e3 * rows.len() as f64, || centre.update(rows, time, n_threads))?
            .map_err(value_error)?;
        let (n, k) = (found.len(), self.sensors);
        let members = found.iter().flat_map(|one| &one.members);
        let numbers = |of: fn(&SystemTrack) -> f64| array(py, &[n], found.iter().map(of));
        let whole = |of: fn(&SystemTrack) -> i64| array(py, &[n], found.iter().map(of));
        let marks = |of: fn(&SystemTrack) -> bool| array(py, &[n], found.iter().map(of));
        Ok((
            array(py, &[n], found.iter().map(|one| one.number as i64))?,
            [
                array(py, &[n, 4], found.iter().flat_map(|one| one.state))?,
                array(py, &[n, 4, 4], found.iter().flat_map(|one| one.covariance))?,
                numbers(|one| one.pvalue)?,
                numbers(|one| one.height)?,
            ],
            array(py, &[n, k], members.map(|track| track.unwrap_or(-1)))?,
            [
                whole(|one| one.identities.identity)?,
                whole(|one| one.identities.icao_address.into())?,
                whole(|one| one.identities.mode_3a.into())?,
            ],
            callsigns(py, found.iter().map(|one| one.identities.callsign)),
            [marks(|one| one.confirmed)?, marks(|one| one.doubtful)?],
        ))
    }

    /// Joins two targets, or keeps them separate; false if that is impossible.
    fn decide(&mut self, a: u64, b: u64, joined: bool) -> bool {
        self.centre.decide(a, b, joined)
    }

    /// Withdraws decisions; false if there is no such target.
    fn release(&mut self, number: u64) -> bool {
        self.centre.release(number)
    }

    /// Returns errors and their standard deviations, (K, 4).
    fn known<'py>(&self, py: Python<'py>) -> PyResult<[Array<'py>; 2]> {
        let registrar = self.centre.registrar();
        let shape = [self.sensors, KINDS];
        Ok([
            array(py, &shape, without_deviation(&registrar.errors()))?,
            array(py, &shape, without_deviation(&registrar.sigmas()))?,
        ])
    }

    fn __getstate__<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, &self.centre.to_bytes())
    }

    /// Restores a centre from its state.
    #[staticmethod]
    fn from_state(state: &[u8]) -> PyResult<Self> {
        let centre = Centre::from_bytes(state)
            .ok_or_else(|| PyValueError::new_err("this is not the state of a fusion centre"))?;
        let sensors = centre.registrar().errors().len();
        Ok(Self { centre, sensors, rows: Vec::new() })
    }
}
