//! Errors of radars, estimated from tables of tracks.

use super::{Columns, TrackColumns, View};
use crate::arrays::{Array, Input, Integers, array, release, vector};
use crate::registration::{same_length, with_deviation};
use crate::sensors::Radar;
use numpy::PyReadonlyArray1;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use tertia::registration::{
    self as core, Changed, ERRORS, KINDS, Other, Report, TargetPlot, Update, Updates,
};
use tertia::tracker::{Data, PlotStatus, Plots};

/// Estimates the errors of radars scan by scan.
#[pyclass(module = "tertia._core")]
pub struct Registrar(core::Registrar);

#[pymethods]
impl Registrar {
    #[new]
    fn new(
        radars: Vec<PyRef<'_, Radar>>,
        slant: Vec<bool>,
        mean: Input<'_>,
        sigma: Input<'_>,
        drift: Input<'_>,
    ) -> PyResult<Self> {
        let radars: Vec<_> = radars.iter().map(|radar| radar.0.clone()).collect();
        let mean = with_deviation(mean.points("mean", 1)?);
        let sigma = with_deviation(sigma.points("sigma", 1)?);
        let drift = with_deviation(drift.points("drift", 1)?);
        same_length(radars.len(), &[slant.len(), mean.len(), sigma.len(), drift.len()])?;
        Ok(Self(core::Registrar::new(radars, slant, mean, sigma, &drift)))
    }

    /// Starts with known errors (K, 8) and their covariance: (8 K, 8 K), or (4 K, 4 K) without deviations.
    fn know(&mut self, errors: Input<'_>, covariance: Input<'_>) -> PyResult<()> {
        let errors = errors.points::<ERRORS>("errors", 1)?;
        let covariance = covariance.numbers("covariance")?;
        let radars = self.0.held().len();
        same_length(radars, &[errors.len()])?;
        let kinds = if covariance.len() > (KINDS * radars).pow(2) { ERRORS } else { KINDS };
        same_length((kinds * radars).pow(2), &[covariance.len()])?;
        self.0.know(&errors, &covariance);
        Ok(())
    }

    /// Begins with unknown deviations of the azimuths where a later registrar has found them; returns whether
    /// there are any that were not unknown before.
    fn expect(&mut self, later: PyRef<'_, Self>) -> PyResult<bool> {
        same_length(self.0.held().len(), &[later.0.held().len()])?;
        Ok(self.0.expect(&later.0))
    }

    /// Returns the times, ranges and azimuths of plots after correction for the known errors, (N,) each, and
    /// the positions, (N, 2), if there are any.
    #[allow(clippy::type_complexity)] // columns
    fn correct<'py>(
        &self,
        py: Python<'py>,
        plots: Columns<'py>,
    ) -> PyResult<([Array<'py>; 3], Option<Array<'py>>)> {
        let errors = self.0.taken_out();
        let plots = plots.read(&plots.time, errors.len())?;
        let count = plots.len();
        let corrected = |i: usize| {
            let report = plots.measured(i);
            report.corrected(&errors[report.radar])
        };
        let mut polar = [(); 3].map(|()| Vec::with_capacity(count));
        for report in (0..count).map(corrected) {
            polar[0].push(report.time);
            polar[1].push(report.range);
            polar[2].push(report.azimuth);
        }
        let [time, range, azimuth] = polar.map(|column| array(py, &[count], column));
        let place = |i: usize| corrected(i).place.map_or([f64::NAN; 2], |place| place.position);
        let places =
            plots.has_positions().then(|| array(py, &[count, 2], (0..count).flat_map(place)));
        Ok(([time?, range?, azimuth?], places.transpose()?))
    }

    /// Learns, up to `time`, from the rows of a table of tracks and from their plots. `rows` is the table
    /// with the index of the first row to be used; `first` is the number of the first of the plots. The rows
    /// are shifted by what was learnt about the errors, and the remaining uncertainty of the errors is added
    /// to their covariances. `noise` is that of `PlotTracker.noise`, (K, 2, 2). `azimuth_sigmas` are the
    /// sigmas of sensors that measure only azimuths, whose plots have the position of the sensor as their
    /// position, and nan for all other sensors. `alive` are the numbers of all tracks in ascending order.
    /// Returns the shifts of the tracks: numbers, times, and positions with velocities (T, 4).
    #[allow(clippy::too_many_arguments)] // those of the Python method
    fn learn<'py>(
        &mut self,
        py: Python<'py>,
        plots: Columns<'py>,
        first: i64,
        rows: (PyRef<'py, TrackColumns>, usize),
        track_of_plot: PyReadonlyArray1<'py, i64>,
        noise: Input<'py>,
        azimuth_sigmas: Input<'py>,
        time: f64,
        alive: PyReadonlyArray1<'py, i64>,
    ) -> PyResult<(Integers<'py>, Array<'py>, Array<'py>)> {
        let noise: Vec<[[f64; 2]; 2]> = noise
            .points::<4>("noise", 2)?
            .into_iter()
            .map(|[a, b, c, d]| [[a, b], [c, d]])
            .collect();
        same_length(self.0.errors().len(), &[noise.len()])?;
        let azimuth_sigmas = azimuth_sigmas.numbers("azimuth_sigmas")?;
        same_length(noise.len(), &[azimuth_sigmas.len()])?;
        let plots = plots.read(&plots.time, self.0.errors().len())?;
        let (track_of_plot, alive) = (track_of_plot.as_slice()?, alive.as_slice()?);
        same_length(plots.len(), &[track_of_plot.len()])?;
        let (table, begin) = rows;
        let mut told = Told::take(py, &table, (&plots, &azimuth_sigmas), (first, begin))?;
        let tracks = release(py, 1e3 * told.count() as f64, || {
            let loose = told.loose(track_of_plot);
            self.0.learn(&mut told, &loose, &noise, (time, Some(alive)))
        });
        told.put_back(py, &table);
        let tracks = tracks?;
        let count = tracks.len();
        Ok((
            array(py, &[count], tracks.iter().map(|(number, ..)| *number))?,
            array(py, &[count], tracks.iter().map(|(_, time, _)| *time))?,
            array(py, &[count, 4], tracks.iter().flat_map(|(.., by)| *by))?,
        ))
    }

    /// Returns errors and their standard deviations, (K, 8), and the noise for the tracker, (K, 2).
    fn known<'py>(&self, py: Python<'py>) -> PyResult<[Array<'py>; 3]> {
        let (errors, sigmas, noise) = (self.0.errors(), self.0.sigmas(), self.0.noise());
        let k = errors.len();
        Ok([
            array(py, &[k, ERRORS], errors.into_flattened())?,
            array(py, &[k, ERRORS], sigmas.into_flattened())?,
            array(py, &[k, 2], noise.into_flattened())?,
        ])
    }

    /// Returns marks of the radars whose plots may not confirm tracks for now, (K,).
    fn held(&self) -> Vec<bool> {
        self.0.held()
    }

    /// Clock errors by which plots are corrected, (K,).
    fn clocks<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        vector(py, self.0.taken_out().iter().map(|errors| errors[KINDS - 1]))
    }

    /// Variance of what the remaining errors of the sensors that are radars, (K,), change in the delay of a
    /// target.
    fn unsure(&self, radars: Vec<bool>) -> PyResult<f64> {
        same_length(self.0.held().len(), &[radars.len()])?;
        Ok(self.0.unsure(&radars))
    }

    /// Sets the standard deviations of the differences between the delays of targets, (K,).
    fn set_delays(&mut self, sigmas: Input<'_>) -> PyResult<()> {
        let sigmas = sigmas.numbers("sigmas")?;
        same_length(self.0.held().len(), &[sigmas.len()])?;
        self.0.set_delays(&sigmas);
        Ok(())
    }

    /// Returns times and radars of sudden changes of errors.
    fn changes(&self) -> Vec<(f64, usize)> {
        self.0.changes().to_vec()
    }

    fn __getstate__<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, &self.0.to_bytes())
    }

    /// Restores a registrar from its state.
    #[staticmethod]
    fn from_state(state: &[u8]) -> PyResult<Self> {
        core::Registrar::from_bytes(state)
            .map(Self)
            .ok_or_else(|| PyValueError::new_err("this is not the state of a registration"))
    }
}

/// The columns of a table of tracks, with the plots of the rows from `begin` on; the first plot has the
/// number `first`.
struct Told<'a> {
    plots: &'a View<'a>,
    /// Sigmas of the sensors that measure only azimuths; nan for other sensors.
    azimuth_sigmas: &'a [f64],
    first: i64,
    begin: usize,
    track: Vec<i64>,
    plot: Vec<i64>,
    sensor: Vec<i64>,
    confirmed: Vec<bool>,
    time: Vec<f64>,
    turning: Vec<f64>,
    position: Vec<f64>,
    velocity: Vec<f64>,
    innovation: Vec<f64>,
    covariance: Vec<f64>,
    spread: Vec<f64>,
}

impl<'a> Told<'a> {
    /// Takes the columns from a table.
    fn take(
        py: Python<'_>,
        table: &TrackColumns,
        (plots, azimuth_sigmas): (&'a View<'a>, &'a [f64]),
        (first, begin): (i64, usize),
    ) -> PyResult<Self> {
        Ok(Self {
            plots,
            azimuth_sigmas,
            first,
            begin,
            track: table.take_integers(py, "track")?,
            plot: table.take_integers(py, "plot")?,
            sensor: table.take_integers(py, "sensor")?,
            confirmed: table.take_flags(py, "confirmed")?,
            time: table.take_numbers(py, "time")?,
            turning: table.take_numbers(py, "turn_probability")?,
            position: table.take_numbers(py, "position")?,
            velocity: table.take_numbers(py, "velocity")?,
            innovation: table.take_numbers(py, "innovation")?,
            covariance: table.take_numbers(py, "covariance")?,
            spread: table.take_numbers(py, "innovation_covariance")?,
        })
    }

    /// Puts the columns back into the table.
    fn put_back(self, py: Python<'_>, table: &TrackColumns) {
        for (name, values) in [
            ("time", self.time),
            ("turn_probability", self.turning),
            ("position", self.position),
            ("velocity", self.velocity),
            ("innovation", self.innovation),
            ("covariance", self.covariance),
            ("innovation_covariance", self.spread),
        ] {
            table.put_back(py, name, Data::Numbers(values));
        }
        for (name, values) in [("track", self.track), ("plot", self.plot), ("sensor", self.sensor)]
        {
            table.put_back(py, name, Data::Integers(values));
        }
        table.put_back(py, "confirmed", Data::Flags(self.confirmed));
    }

    /// Returns the index of the plot of a row among the given plots.
    fn plot_of(&self, row: usize) -> Option<usize> {
        let own = usize::try_from(self.plot[row] - self.first).ok();
        own.filter(|&own| own < self.plots.len())
    }

    /// Returns the plots of tracks that are not confirmed, and those that are taken for reflections: if the
    /// errors of a radar have changed, its plots are beside their tracks, as those of side lobes are.
    fn loose(&self, track_of_plot: &[i64]) -> Vec<Report> {
        let reflection = PlotStatus::Reflection.code();
        let is_loose = |&track: &i64| track >= 0 || track == reflection;
        let mut loose: Vec<bool> = track_of_plot.iter().map(is_loose).collect();
        for row in (self.begin..self.track.len()).filter(|row| self.confirmed[*row]) {
            if let Some(own) = self.plot_of(row) {
                loose[own] = false;
            }
        }
        let loose = loose.iter().enumerate().filter(|(_, loose)| **loose);
        loose.map(|(i, _)| self.plots.measured(i)).collect()
    }
}

impl Updates for Told<'_> {
    fn count(&self) -> usize {
        self.track.len() - self.begin
    }

    fn target(&self, row: usize) -> i64 {
        self.track[self.begin + row]
    }

    #[inline(always)]
    fn get(&self, row: usize) -> Update {
        let row = self.begin + row;
        let radar = self.sensor[row] as usize;
        let missed = || Report { time: self.time[row], ..missed(radar) };
        let own = self.plot_of(row);
        let sight = own.filter(|_| self.azimuth_sigmas[radar].is_finite());
        let report = match own {
            Some(own) if sight.is_none() => self.plots.measured(own),
            _ => missed(),
        };
        let other = match sight {
            Some(own) => {
                self.plots.place(own).map(|at| Other::Azimuth(at, self.azimuth_sigmas[radar]))
            }
            None => own.and_then(|own| self.plots.moving(own)).map(|(v, r)| Other::Velocity(v, r)),
        };
        let pair = |values: &[f64]| [values[2 * row], values[2 * row + 1]];
        let upper = &self.covariance[10 * row..][..10];
        let [xx, xy, yy] = self.spread.as_chunks::<3>().0[row];
        Update {
            plot: TargetPlot {
                report,
                target: self.track[row],
                turn_probability: self.turning[row],
            },
            confirmed: self.confirmed[row],
            position: pair(&self.position),
            velocity: pair(&self.velocity),
            covariance: WHOLE.map(|at| upper[at]),
            innovation: pair(&self.innovation),
            innovation_covariance: [xx, xy, xy, yy],
            other,
        }
    }
}

impl Changed for Told<'_> {
    #[inline(always)]
    fn change(&mut self, row: usize, moved: &[f64; 4], added: &[f64; 16]) {
        let row = self.begin + row;
        for i in 0..2 {
            self.position[2 * row + i] += moved[i];
            self.velocity[2 * row + i] += moved[2 + i];
        }
        let upper = &mut self.covariance[10 * row..][..10];
        for (upper, place) in upper.iter_mut().zip(UPPER) {
            *upper += added[place];
        }
    }
}

/// Index in the upper triangle of each element of a symmetric 4×4 matrix; below, the reverse.
const WHOLE: [usize; 16] = [0, 1, 2, 3, 1, 4, 5, 6, 2, 5, 7, 8, 3, 6, 8, 9];
const UPPER: [usize; 10] = [0, 1, 2, 3, 5, 6, 7, 10, 11, 15];

/// Returns the report for a missed detection of a radar.
fn missed(radar: usize) -> Report {
    let none = f64::NAN;
    Report { radar, time: none, range: none, azimuth: none, height: none, place: None }
}
