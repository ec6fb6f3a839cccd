//! Bindings of `tertia::tracker`.

mod geometry;
mod registrar;
mod settings;
mod smooth;
mod table;

pub use geometry::Geometry;
pub use registrar::Registrar;
pub use settings::{Motion, TrackAssociation, TrackerSettings};
pub use smooth::{height_offsets, shown_covariances, smooth_tracks};
pub use table::{TrackColumns, track_columns};

use crate::arrays::{
    Array, Input, Integers, Threads, array, release, room_for, value_error, vector,
};
use crate::flightplan::Route;
use crate::sensors::{IdentityColumns, IdentityView, Radar};
use numpy::PyReadonlyArray1;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::borrow::Cow;
use tertia::registration;
use tertia::sensors::Detection;
use tertia::tracker::{self, Command, Plane, Plot, Plots, Report, Table};

/// Cost of a plot, for the decision whether to release the interpreter's lock.
const PLOT_NS: f64 = 1000.0;

/// The tracker: makes tracks from scans of plots.
#[pyclass(module = "tertia.tracker")]
pub struct PlotTracker(tracker::LagTracker);

#[pymethods]
impl PlotTracker {
    #[new]
    fn new(
        settings: &TrackerSettings,
        radars: Vec<PyRef<'_, Radar>>,
        geometry: Vec<PyRef<'_, Geometry>>,
        plans: Vec<PyRef<'_, Route>>,
        lag: f64,
    ) -> PyResult<Self> {
        let geometry = geometry.iter().map(|own| own.0).collect();
        let radars = radars.iter().map(|radar| radar.0.clone()).collect();
        let plans: Vec<_> = plans.iter().map(|route| route.plan().clone()).collect();
        let tracker = tracker::Tracker::try_new(settings.with(radars, geometry, plans.into()));
        let tracker = tracker.and_then(|tracker| tracker::LagTracker::try_new(tracker, lag));
        tracker.map(Self).map_err(value_error)
    }

    /// Time up to which all plots are processed.
    #[getter]
    fn time(&self) -> f64 {
        self.0.tracker().time()
    }

    /// Number of plots given so far.
    #[getter]
    fn plots(&self) -> usize {
        self.0.tracker().plots()
    }

    /// Sets the standard deviations of range and azimuth of each radar, (K, 2).
    fn set_noise(&mut self, noise: Input<'_>) -> PyResult<()> {
        self.0.tracker_mut().set_noise(&noise.pairs("noise")?).map_err(value_error)
    }

    /// Sets which radars' plots may not confirm tracks for now, (K,).
    fn hold(&mut self, radars: Vec<bool>) {
        self.0.tracker_mut().hold(radars);
    }

    /// Sets the common delay by which the times of each sensor were corrected, (K,); nan for sensors whose
    /// delays are not estimated by target.
    fn set_delays(&mut self, common: Input<'_>) -> PyResult<()> {
        let common = common.numbers("common")?;
        let known = |delay: &f64| delay.is_finite().then_some(*delay);
        self.0.tracker_mut().set_delays(&common.iter().map(known).collect::<Vec<_>>());
        Ok(())
    }

    /// Estimates how much the delays of targets differ; errors of other sensors cause delays of the variance
    /// `unsure`.
    fn weigh_delays(&mut self, unsure: f64) {
        self.0.tracker_mut().weigh_delays(unsure);
    }

    /// Standard deviations of the differences between the delays of targets, (K,).
    fn delay_sigmas<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        vector(py, self.0.tracker().delay_sigmas())
    }

    /// Returns the numbers of all tracks in ascending order, (T,).
    fn numbers<'py>(&self, py: Python<'py>) -> PyResult<Integers<'py>> {
        vector(py, self.0.tracker().numbers().into_iter().map(|number| number as i64))
    }

    /// Moves tracks, in ascending order of their numbers, by positions and velocities (M, 4) at these times.
    fn shift(
        &mut self,
        track: PyReadonlyArray1<'_, i64>,
        time: Input<'_>,
        by: Input<'_>,
    ) -> PyResult<()> {
        let (track, by) = (track.as_slice()?, by.points::<4>("by", 1)?);
        let moved: Vec<_> = track
            .iter()
            .zip(time.numbers("time")?.iter().zip(by))
            .map(|(&number, (&time, by))| (number as u64, time, by))
            .collect();
        self.0.tracker_mut().shift(&moved);
        Ok(())
    }

    /// Restarts without tracks, as if the last `plots` plots had not been given.
    fn restart(&mut self, plots: usize) {
        self.0.restart(plots);
    }

    /// Processes plots at these times, until `end`. The rows added to the table are those of the tracks
    /// that are "confirmed" by then, those of "all" tracks, or, for a "recording", all rows of the tracks
    /// that are confirmed by its end. The plots are given twice: corrected, and as they were measured. Returns
    /// the track of each plot.
    #[allow(clippy::too_many_arguments)] // those of the Python method
    fn track<'py>(
        &mut self,
        py: Python<'py>,
        plots: (Columns<'py>, Columns<'py>),
        time: Input<'py>,
        end: Option<f64>,
        rows: &str,
        table: &TrackColumns,
        n_threads: Threads,
    ) -> PyResult<Integers<'py>> {
        let sensors = self.0.tracker().radars();
        let given = plots.1.read(&time, sensors)?;
        let plots = View { given: Some(&given), ..plots.0.read(&time, sensors)? };
        let (mut statuses, mut found) = (Vec::new(), table.take_rows(py, rows != "confirmed")?);
        let mut tracks = Vec::new();
        let done = release(py, plots.len() as f64 * PLOT_NS, || {
            if rows != "recording" {
                match rows {
                    // a recording, scan by scan
                    "all" => self.0.record(&plots, &mut statuses, &mut found, n_threads)?,
                    _ => self.0.track(&plots, end, &mut statuses, &mut found, n_threads)?,
                }
                tracks.extend(statuses.iter().map(|status| status.code()));
                return Ok(());
            }
            let fresh = (self.0.tracker().plots() == 0).then(|| self.0.clone());
            self.0.record(&plots, &mut statuses, &mut found, n_threads)?;
            // the first plots were tracked before the properties of the plots were known
            if let Some(again) = fresh.and_then(|fresh| fresh.knowing(&self.0)) {
                self.0 = again;
                found.truncate(0);
                self.0.record(&plots, &mut statuses, &mut found, n_threads)?;
            }
            tracks.extend(statuses.iter().map(|status| status.code()));
            found.keep_confirmed(&mut tracks, n_threads);
            Ok(())
        });
        table.put_rows(py, found);
        done?.map_err(value_error)?;
        vector(py, tracks)
    }

    /// Sensors whose clocks came into doubt since the last call: their indices, by how many seconds their plots
    /// are ahead, and whether the tracker started anew at the time of these.
    fn take_clock_doubts(&mut self) -> Vec<(usize, f64, bool)> {
        let doubts = self.0.take_clock_doubts().into_iter();
        doubts.map(|own| (own.sensor, own.ahead, own.is_believed)).collect()
    }

    /// Returns a copy of the tracker.
    fn copy(&self) -> Self {
        Self(self.0.clone())
    }

    /// Returns a copy with the properties of the plots that a later tracker has estimated; `None` if they are
    /// as stated.
    fn knowing(&self, later: &Self) -> Option<Self> {
        self.0.clone().knowing(&later.0).map(Self)
    }

    /// Ratio of the noise of each radar to the stated noise.
    fn noise_factor<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        vector(py, self.0.tracker().noise_factors().collect::<Vec<_>>())
    }

    /// Standard deviations of range and azimuth, as last used and as estimated, (K, 2, 2).
    fn noise<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        let noise = self.0.tracker().noise();
        array(py, &[noise.len(), 2, 2], noise.into_flattened().into_flattened())
    }

    /// Makes all rows final.
    fn finish<'py>(
        &mut self,
        py: Python<'py>,
        n_threads: Threads,
    ) -> PyResult<(TrackColumns, Integers<'py>)> {
        let mut table = Table::new(false, 0);
        release(py, f64::INFINITY, || self.0.finish(&mut table, n_threads))?;
        Ok((TrackColumns::new(table), vector(py, [])?))
    }

    /// Numbers of the confirmed tracks, and their positions this number of seconds from now.
    fn extrapolate<'py>(
        &self,
        py: Python<'py>,
        seconds: f64,
    ) -> PyResult<(Integers<'py>, Array<'py>)> {
        let found = self.0.extrapolate(seconds);
        let positions = found.iter().flat_map(|(_, position)| *position);
        let tracks = found.iter().map(|(track, _)| *track);
        Ok((array(py, &[found.len()], tracks)?, array(py, &[found.len(), 2], positions)?))
    }

    /// Adds a plan and returns its number.
    fn add_plan(&mut self, plan: &Route) -> PyResult<usize> {
        let added = self.0.command(Command::Add(plan.plan().clone())).map_err(refused)?;
        Ok(added.unwrap_or_default())
    }

    /// Replaces a plan by another one.
    fn replace_plan(&mut self, number: usize, plan: &Route) -> PyResult<()> {
        self.change(Command::Replace(number, plan.plan().clone()))
    }

    fn remove_plan(&mut self, number: usize) -> PyResult<()> {
        self.change(Command::Remove(number))
    }

    /// Assigns a plan to a confirmed track; with `take`, even if the plan belongs to another track.
    fn correlate(&mut self, track: u64, plan: usize, take: bool) -> PyResult<()> {
        self.change(Command::Correlate(track, plan, take))
    }

    /// Removes the plan of a confirmed track.
    fn decorrelate(&mut self, track: u64) -> PyResult<()> {
        self.change(Command::Decorrelate(track))
    }

    /// Suspends the plan of a confirmed track, or resumes it.
    fn suspend_plan(&mut self, track: u64, suspended: bool) -> PyResult<()> {
        self.change(Command::Suspend(track, suspended))
    }

    /// Numbers of the confirmed tracks whose plans are suspended.
    fn suspended_plans<'py>(&self, py: Python<'py>) -> PyResult<Integers<'py>> {
        vector(py, self.0.suspended_plans().into_iter().map(|track| track as i64))
    }

    /// Returns the complete state of the tracker.
    fn __getstate__<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, &self.0.to_bytes())
    }

    /// Restores a tracker from its state.
    #[staticmethod]
    fn from_state(state: &[u8]) -> PyResult<Self> {
        tracker::LagTracker::from_bytes(state)
            .map(Self)
            .ok_or_else(|| PyValueError::new_err("this is not the state of a Tracker"))
    }
}

impl PlotTracker {
    fn change(&mut self, command: Command) -> PyResult<()> {
        self.0.command(command).map(|_| ()).map_err(refused)
    }
}

#[allow(clippy::needless_pass_by_value)] // for `map_err`
fn refused(refusal: tracker::Refusal) -> PyErr {
    PyValueError::new_err(refusal.to_string())
}

/// Returns east and north of plots (N, 2) and their covariances (N, 2, 2); nan if there is no position.
#[pyfunction]
pub fn plots_to_cartesian<'py>(
    py: Python<'py>,
    radars: Vec<PyRef<'py, Radar>>,
    plots: Columns<'py>,
) -> PyResult<(Array<'py>, Array<'py>)> {
    let plots = plots.read(&plots.time, radars.len())?;
    let (mut position, mut covariance) = (room_for(2 * plots.len())?, room_for(4 * plots.len())?);
    for plot in (0..plots.len()).map(|i| plots.get(i)) {
        let none = ([f64::NAN; 2], Plane { xx: f64::NAN, xy: f64::NAN, yy: f64::NAN });
        let (z, Plane { xx, xy, yy }) = plot.to_cartesian(&radars[plot.radar].0).unwrap_or(none);
        position.extend(z);
        covariance.extend([xx, xy, xy, yy]);
    }
    Ok((array(py, &[plots.len(), 2], position)?, array(py, &[plots.len(), 2, 2], covariance)?))
}

/// The columns of `Plots`.
#[derive(FromPyObject)]
pub struct Columns<'py> {
    pub time: Input<'py>,
    range: Input<'py>,
    azimuth: Input<'py>,
    height: Input<'py>,
    sensor: PyReadonlyArray1<'py, i64>,
    #[pyo3(attribute("_identities"))]
    identities: IdentityColumns<'py>,
    /// Index of the detection of each plot, negative if unknown.
    detection: PyReadonlyArray1<'py, i64>,
    /// Positions (N, 2); below, their covariances (N, 2, 2). For sensors that report positions.
    position: Option<Input<'py>>,
    covariance: Option<Input<'py>>,
    /// Velocities (N, 2); below, their covariances (N, 2, 2).
    velocity: Option<Input<'py>>,
    velocity_covariance: Option<Input<'py>>,
}

/// The columns of plots in memory.
pub struct View<'a> {
    time: Cow<'a, [f64]>,
    range: Cow<'a, [f64]>,
    azimuth: Cow<'a, [f64]>,
    height: Cow<'a, [f64]>,
    sensor: &'a [i64],
    identities: IdentityView<'a>,
    detection: &'a [i64],
    position: Option<Cow<'a, [f64]>>,
    covariance: Option<Cow<'a, [f64]>>,
    velocity: Option<Cow<'a, [f64]>>,
    velocity_covariance: Option<Cow<'a, [f64]>>,
    /// The same plots as they were measured, where these are corrected.
    given: Option<&'a View<'a>>,
}

impl View<'_> {
    pub fn has_positions(&self) -> bool {
        self.position.is_some()
    }

    /// Returns the part of a plot that registration needs.
    #[inline(always)]
    fn measured(&self, index: usize) -> registration::Report {
        // nan if the sensor is a radar
        let place = self.report(index).filter(|report| report.position[0].is_finite()).map(|own| {
            let Plane { xx, xy, yy } = own.covariance;
            registration::Place { position: own.position, covariance: [xx, xy, yy] }
        });
        registration::Report {
            radar: self.sensor[index] as usize,
            time: self.time[index],
            range: self.range[index],
            azimuth: self.azimuth[index],
            height: self.height[index],
            place,
        }
    }

    /// Returns the position that a plot reports, if there is one.
    fn place(&self, index: usize) -> Option<[f64; 2]> {
        let place = self.position.as_ref()?.as_chunks::<2>().0[index];
        place[0].is_finite().then_some(place)
    }

    /// Returns the velocity that a plot reports and its covariance, if there are both.
    #[inline(always)]
    fn moving(&self, index: usize) -> Option<([f64; 2], Plane)> {
        self.velocity.as_ref()?;
        self.report(index)?.stated_velocity()
    }

    /// Returns the reported position of a plot and its velocity, with their covariances.
    #[inline]
    fn report(&self, index: usize) -> Option<Report> {
        let position = self.position.as_ref()?.as_chunks::<2>().0[index];
        let mut report = Report::of(position, spread(self.covariance.as_deref(), index));
        if let Some(velocity) = &self.velocity {
            report.velocity = velocity.as_chunks::<2>().0[index];
            report.velocity_covariance = spread(self.velocity_covariance.as_deref(), index);
        }
        Some(report)
    }
}

/// Returns a covariance; nan if there is none.
fn spread(covariance: Option<&[f64]>, index: usize) -> Plane {
    let own = covariance.map_or([f64::NAN; 4], |covariance| covariance.as_chunks::<4>().0[index]);
    let [xx, xy, _, yy] = own;
    Plane { xx, xy, yy }
}

impl Plots for View<'_> {
    fn len(&self) -> usize {
        self.sensor.len()
    }

    #[inline]
    fn radar(&self, index: usize) -> usize {
        self.sensor[index] as usize
    }

    #[inline]
    fn height(&self, index: usize) -> f64 {
        self.height[index]
    }

    #[inline]
    fn measured(&self, index: usize) -> [f64; 2] {
        let own = self.given.unwrap_or(self);
        [own.range[index], own.azimuth[index]]
    }

    #[inline]
    fn get(&self, index: usize) -> Plot {
        Plot {
            time: self.time[index],
            range: self.range[index],
            azimuth: self.azimuth[index],
            radar: self.radar(index),
            height: self.height(index),
            identities: self.identities.get(index),
            detection: Detection::of(self.detection[index]),
            report: self.report(index),
        }
    }
}

impl Columns<'_> {
    /// Reads the plots, with these times; the indices of their sensors must be below `sensors`.
    pub fn read<'a>(&'a self, time: &'a Input<'_>, sensors: usize) -> PyResult<View<'a>> {
        let values = |column: &'a Option<Input<'_>>, name: &'static str, axes: usize| {
            let rows = column.as_ref().map(|column| column.rows(name, axes)).transpose();
            rows.map(|rows| rows.map(|rows| rows.values))
        };
        let view = View {
            time: time.rows("time", 0)?.values,
            range: self.range.rows("range", 0)?.values,
            azimuth: self.azimuth.rows("azimuth", 0)?.values,
            height: self.height.rows("height", 0)?.values,
            sensor: self.sensor.as_slice()?,
            identities: self.identities.read(self.sensor.as_slice()?.len())?,
            detection: self.detection.as_slice()?,
            position: values(&self.position, "position", 1)?,
            covariance: values(&self.covariance, "covariance", 2)?,
            velocity: values(&self.velocity, "velocity", 1)?,
            velocity_covariance: values(&self.velocity_covariance, "velocity_covariance", 2)?,
            given: None,
        };
        let count = view.len();
        let width = |column: &Option<Cow<'_, [f64]>>, of: usize| {
            column.as_ref().is_none_or(|values| values.len() == of * count)
        };
        let pairs = width(&view.position, 2) && width(&view.velocity, 2);
        if !pairs || !width(&view.covariance, 4) || !width(&view.velocity_covariance, 4) {
            return Err(PyValueError::new_err("the columns of plots differ in length"));
        }
        let numbers = [&view.time, &view.range, &view.azimuth, &view.height];
        let differs = view.detection.len() != count;
        if differs || numbers.iter().any(|column| column.len() != count) {
            return Err(PyValueError::new_err("the columns of plots differ in length"));
        }
        let is_wrong = |&sensor: &i64| usize::try_from(sensor).map_or(true, |s| s >= sensors);
        match view.sensor.iter().position(is_wrong) {
            None => Ok(view),
            Some(i) => Err(PyValueError::new_err(format!(
                "sensor[{i}] is {}; it must be the index of one of the {sensors} sensors",
                view.sensor[i]
            ))),
        }
    }
}
