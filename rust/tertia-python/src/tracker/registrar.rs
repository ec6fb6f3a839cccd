//! The errors of radars, learned from tables of tracks.

use super::{Columns, TrackColumns};
use crate::arrays::{Array, Input, Integers, array, release};
use crate::registration::same_length;
use crate::sensors::Radar;
use numpy::PyReadonlyArray1;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use tertia::registration::{self as core, ERRORS, Learnt, Place, Report, TargetPlot, Update};
use tertia::tracker::{Plane, Plot, Plots};

/// The errors of radars, scan by scan.
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
        let mean = mean.points::<ERRORS>("mean", 1)?;
        let sigma = sigma.points::<ERRORS>("sigma", 1)?;
        let drift = drift.points::<ERRORS>("drift", 1)?;
        same_length(radars.len(), &[slant.len(), mean.len(), sigma.len(), drift.len()])?;
        Ok(Self(core::Registrar::new(radars, slant, mean, sigma, &drift)))
    }

    /// Times, ranges and azimuths of plots without the errors known, (N,) each.
    fn correct<'py>(&self, py: Python<'py>, plots: Columns<'py>) -> PyResult<[Array<'py>; 3]> {
        let errors = self.0.taken_out();
        let plots = plots.read(&plots.time, errors.len())?;
        let corrected: Vec<Report> = (0..plots.len())
            .map(|i| plots.get(i))
            .map(|plot| report(&plot).corrected(&errors[plot.radar]))
            .collect();
        let column =
            |read: fn(&Report) -> f64| array(py, &[corrected.len()], corrected.iter().map(read));
        Ok([column(|one| one.time)?, column(|one| one.range)?, column(|one| one.azimuth)?])
    }

    /// Learns from a table of tracks and the plots that it is of, of which the first has this number,
    /// until a time; adds what is not known of the errors to the covariances, and moves the rows by what
    /// was learnt. Returns the same of the tracks: numbers, times, positions and velocities.
    #[allow(clippy::too_many_arguments)] // those of the Python method
    fn learn<'py>(
        &mut self,
        py: Python<'py>,
        plots: Columns<'py>,
        first: i64,
        table: &TrackColumns,
        track_of_plot: PyReadonlyArray1<'py, i64>,
        noise: Input<'py>,
        time: f64,
    ) -> PyResult<(Integers<'py>, Array<'py>, Array<'py>)> {
        let noise: Vec<[[f64; 2]; 2]> = noise
            .points::<4>("noise", 2)?
            .into_iter()
            .map(|[a, b, c, d]| [[a, b], [c, d]])
            .collect();
        same_length(self.0.errors().len(), &[noise.len()])?;
        let plots = plots.read(&plots.time, self.0.errors().len())?;
        let updates = updates(py, table, &plots, first)?;
        // plots that no confirmed track has
        let mut loose: Vec<bool> =
            track_of_plot.as_slice()?.iter().map(|&track| track >= 0).collect();
        same_length(plots.len(), &[loose.len()])?;
        let plot = table.integers(py, "plot")?;
        for (plot, update) in plot.iter().zip(&updates).filter(|(_, update)| update.confirmed) {
            let own = usize::try_from(plot - first).ok().and_then(|own| loose.get_mut(own));
            if let (Some(own), true) = (own, update.plot.report.is_seen()) {
                *own = false;
            }
        }
        let loose = loose.iter().enumerate().filter(|(_, loose)| **loose);
        let loose: Vec<Report> = loose.map(|(i, _)| report(&plots.get(i))).collect();
        let Learnt { rows, tracks } = release(py, 1e3 * updates.len() as f64, || {
            self.0.learn(&updates, &loose, &noise, time)
        })?;
        table.upper(py, "covariance", |values| {
            for (upper, (_, added)) in values.chunks_exact_mut(10).zip(&rows) {
                for (at, place) in [0, 1, 2, 3, 5, 6, 7, 10, 11, 15].into_iter().enumerate() {
                    upper[at] += added[place];
                }
            }
        })?;
        for (name, first) in [("position", 0), ("velocity", 2)] {
            table.upper(py, name, |values| {
                for (pair, (moved, _)) in values.chunks_exact_mut(2).zip(&rows) {
                    pair[0] += moved[first];
                    pair[1] += moved[first + 1];
                }
            })?;
        }
        let count = tracks.len();
        Ok((
            array(py, &[count], tracks.iter().map(|(number, ..)| *number))?,
            array(py, &[count], tracks.iter().map(|(_, time, _)| *time))?,
            array(py, &[count, 4], tracks.iter().flat_map(|(.., by)| *by))?,
        ))
    }

    /// Errors and their standard deviations, (K, 4), and the noise for the tracker, (K, 2).
    fn known<'py>(&self, py: Python<'py>) -> PyResult<[Array<'py>; 3]> {
        let (errors, sigmas, noise) = (self.0.errors(), self.0.sigmas(), self.0.noise());
        let k = errors.len();
        Ok([
            array(py, &[k, ERRORS], errors.into_flattened())?,
            array(py, &[k, ERRORS], sigmas.into_flattened())?,
            array(py, &[k, 2], noise.into_flattened())?,
        ])
    }

    /// Radars whose plots are to confirm no tracks for now, (K,).
    fn held(&self) -> Vec<bool> {
        self.0.held()
    }

    /// Times and radars of sudden changes.
    fn changes(&self) -> Vec<(f64, usize)> {
        self.0.changes().to_vec()
    }

    fn __getstate__<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, &self.0.to_bytes())
    }

    /// The registrar of such a state.
    #[staticmethod]
    fn from_state(state: &[u8]) -> PyResult<Self> {
        core::Registrar::from_bytes(state)
            .map(Self)
            .ok_or_else(|| PyValueError::new_err("this is not the state of a registration"))
    }
}

/// The rows of a table of tracks, with their plots, of which the first has this number.
fn updates(
    py: Python<'_>,
    table: &TrackColumns,
    plots: &impl Plots,
    first: i64,
) -> PyResult<Vec<Update>> {
    let [track, plot, sensor] = ["track", "plot", "sensor"].map(|name| table.integers(py, name));
    let (track, plot, sensor) = (track?, plot?, sensor?);
    let confirmed = table.flags(py, "confirmed")?;
    let [time, turning] = ["time", "turn_probability"].map(|name| table.numbers(py, name));
    let (time, turning) = (time?, turning?);
    let [position, velocity, innovation] =
        ["position", "velocity", "innovation"].map(|name| table.numbers(py, name));
    let (position, velocity, innovation) = (position?, velocity?, innovation?);
    let covariance = table.upper(py, "covariance", |values| values.to_vec())?;
    let spread = table.upper(py, "innovation_covariance", |values| values.to_vec())?;
    let row = |i: usize| {
        let own = usize::try_from(plot[i] - first).ok().filter(|&own| own < plots.len());
        let radar = sensor[i] as usize;
        let report =
            own.map_or(Report { time: time[i], ..missed(radar) }, |own| report(&plots.get(own)));
        let pair = |values: &[f64]| [values[2 * i], values[2 * i + 1]];
        let upper = &covariance[10 * i..][..10];
        let mut whole = [0.0; 16];
        for (place, at) in UPPER.into_iter().enumerate() {
            whole[place] = upper[at];
        }
        let own = &spread[3 * i..][..3];
        Update {
            plot: TargetPlot { report, target: track[i], turn_probability: turning[i] },
            confirmed: confirmed[i],
            position: pair(&position),
            velocity: pair(&velocity),
            covariance: whole,
            innovation: pair(&innovation),
            innovation_covariance: [own[0], own[1], own[1], own[2]],
        }
    };
    Ok((0..track.len()).map(row).collect())
}

/// Where the elements of a symmetric matrix of order 4 are in its upper half.
const UPPER: [usize; 16] = [0, 1, 2, 3, 1, 4, 5, 6, 2, 5, 7, 8, 3, 6, 8, 9];

/// What a radar reports of a target that it does not see.
fn missed(radar: usize) -> Report {
    let none = f64::NAN;
    Report { radar, time: none, range: none, azimuth: none, height: none, place: None }
}

fn report(plot: &Plot) -> Report {
    let Plot { time, range, azimuth, radar, height, report, .. } = *plot;
    // nan where the sensor is a radar
    let place = report.filter(|report| report.position[0].is_finite()).map(|report| {
        let Plane { xx, xy, yy } = report.covariance;
        Place { position: report.position, covariance: [xx, xy, yy] }
    });
    Report { radar, time, range, azimuth, height, place }
}
