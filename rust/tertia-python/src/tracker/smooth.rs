//! Tracks smoothed with all their plots.

use super::geometry::Geometry;
use super::settings::Motion;
use crate::arrays::{Array, Input, Integers, Marks, Threads, array, release, vector};
use crate::sensors::Radar;
use numpy::PyReadonlyArray1;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use tertia::tracker::{
    self as core, Movement, PlacedPlot, Plane, Settings, SmoothedRow, Times, TrackPlot,
    height_offset, shown_covariances as shown, smooth_tracks as smooth,
};

/// Cost of a plot, for the decision whether to release the interpreter's lock.
const PLOT_NS: f64 = 5000.0;
/// The same for the estimation of the noise.
const NOISE_NS: f64 = 50.0;
/// Number of values of a row: its columns from the time on, including those of vectors and matrices.
const NUMBERS: usize = 35;

/// Smooths tracks. The plots are sorted by track and then by time; `first` contains the index of the
/// first plot of each track, followed by the number of plots. Returns the number of rows of each track;
/// all values of the rows; the index of the plot of each row or −1, and the transversal, longitudinal and
/// vertical movement of the target; and whether the plot was left out, and whether the row is final.
#[pyfunction]
#[pyo3(signature = (motion, first, plots, used, *, time, every, n_threads))]
#[allow(clippy::too_many_arguments)] // the options, by name
#[allow(clippy::type_complexity)] // arrays
pub fn smooth_tracks<'py>(
    py: Python<'py>,
    motion: &Motion,
    first: Vec<usize>,
    plots: Input<'py>,
    used: PyReadonlyArray1<'py, bool>,
    time: Input<'py>,
    every: Option<f64>,
    n_threads: Threads,
) -> PyResult<(Integers<'py>, Array<'py>, Integers<'py>, Marks<'py>)> {
    let movement = Movement::of(motion.core()).ok_or_else(|| {
        PyValueError::new_err("motion must be 'imm', 'cv', an ImmModel or a CvModel")
    })?;
    let values = plots.points::<13>("plots", 1)?;
    let used = used.as_slice()?;
    let in_order = first.is_sorted() && first.last() == Some(&values.len());
    if used.len() != values.len() || !in_order {
        return Err(PyValueError::new_err("the columns of plots differ in length"));
    }
    let plots: Vec<TrackPlot> = values.iter().zip(used).map(|(v, &used)| plot(v, used)).collect();
    let tracks: Vec<&[TrackPlot]> = first.windows(2).map(|w| &plots[w[0]..w[1]]).collect();
    let times = Times { given: time.numbers("time")?, every };
    let rows = release(py, plots.len() as f64 * PLOT_NS, || {
        smooth(&movement, &tracks, &times, n_threads)
    })?;
    let count: usize = rows.iter().map(Vec::len).sum();
    let mut numbers = Vec::with_capacity(count * NUMBERS);
    let mut codes = Vec::with_capacity(count * 4);
    let mut marks = Vec::with_capacity(count * 2);
    for (track, first) in rows.iter().zip(&first) {
        for row in track {
            push_numbers(&mut numbers, row);
            codes.push(row.plot.map_or(-1, |plot| (first + plot) as i64));
            codes.extend([row.transversal, row.longitudinal, row.vertical].map(|m| m as i64));
            marks.extend([row.outlier, row.is_final]);
        }
    }
    Ok((
        vector(py, rows.iter().map(|track| track.len() as i64))?,
        array(py, &[count, NUMBERS], numbers)?,
        array(py, &[count, 4], codes)?,
        array(py, &[count, 2], marks)?,
    ))
}

/// Returns by how much the target of each track is lower than the height at which its plots were placed, and
/// the variance of this, (tracks, 2). `first` is as above; `plots` contains time, east, north, their variances
/// and covariance, and the derivatives of the position with respect to the height.
#[pyfunction]
pub fn height_offsets<'py>(
    py: Python<'py>,
    first: Vec<usize>,
    plots: Input<'py>,
) -> PyResult<Array<'py>> {
    let values = plots.points::<8>("plots", 1)?;
    if !first.is_sorted() || first.last() != Some(&values.len()) {
        return Err(PyValueError::new_err("the columns of plots differ in length"));
    }
    let placed = |v: &[f64; 8]| {
        let mut columns = [f64::NAN; 13];
        columns[..6].copy_from_slice(&v[..6]);
        columns[12] = 0.0;
        plot(&columns, true)
    };
    let lifts: Vec<[f64; 2]> = values.iter().map(|v| [v[6], v[7]]).collect();
    let plots: Vec<TrackPlot> = values.iter().map(placed).collect();
    let found: Vec<f64> = first
        .windows(2)
        .flat_map(|w| height_offset(&plots[w[0]..w[1]], &lifts[w[0]..w[1]]))
        .collect();
    array(py, &[first.len().saturating_sub(1), 2], found)
}

/// Returns, for each plot of tracks in the order of time, the variances and the covariance by the noise that
/// the plots show, and the same of what successive plots have in common, (N, 6). `plots` contains time, east,
/// north, their variances and covariance, and the velocity of the target.
#[pyfunction]
pub fn shown_covariances<'py>(
    py: Python<'py>,
    sensors: (Vec<PyRef<'py, Radar>>, Vec<PyRef<'py, Geometry>>),
    track: PyReadonlyArray1<'py, i64>,
    sensor: PyReadonlyArray1<'py, i64>,
    plots: Input<'py>,
) -> PyResult<Array<'py>> {
    let radars = sensors.0.iter().map(|radar| radar.0.clone()).collect();
    let mut settings = Settings::new(radars, core::Motion::Cv(1.0));
    settings.geometry = sensors.1.iter().map(|geometry| geometry.0).collect();
    let (track, sensor, values) =
        (track.as_slice()?, sensor.as_slice()?, plots.points::<8>("plots", 1)?);
    let is_known = |k: &i64| usize::try_from(*k).is_ok_and(|k| k < settings.radars.len());
    if track.len() != values.len() || sensor.len() != values.len() || !sensor.iter().all(is_known) {
        return Err(PyValueError::new_err("plots must have a track and a sensor that exists"));
    }
    let placed: Vec<PlacedPlot> = values
        .iter()
        .zip(track.iter().zip(sensor))
        .map(|(&[time, x, y, xx, xy, yy, u, v], (&track, &sensor))| PlacedPlot {
            track: track.unsigned_abs(),
            sensor: sensor.unsigned_abs() as usize,
            time,
            position: [x, y],
            covariance: Plane { xx, xy, yy },
            velocity: [u, v],
        })
        .collect();
    let found = release(py, placed.len() as f64 * NOISE_NS, || shown(&settings, &placed))?;
    let numbers = |plane: &Plane| [plane.xx, plane.xy, plane.yy];
    array(py, &[found.len(), 6], found.iter().flatten().flat_map(numbers))
}

/// Creates a plot from time, east, north, their variances and covariance, the same of the velocity, height, and
/// the index of the sensor.
fn plot(values: &[f64; 13], used: bool) -> TrackPlot {
    let &[time, x, y, xx, xy, yy, vx, vy, uu, uv, vv, height, sensor] = values;
    TrackPlot {
        time,
        sensor: sensor as usize,
        position: [x, y],
        covariance: Plane { xx, xy, yy },
        velocity: [vx, vy],
        velocity_covariance: Plane { xx: uu, xy: uv, yy: vv },
        height,
        used,
    }
}

fn push_numbers(numbers: &mut Vec<f64>, row: &SmoothedRow) {
    let Plane { xx, xy, yy } = row.innovation_covariance;
    numbers.push(row.time);
    numbers.extend(row.state);
    numbers.extend(row.covariance.as_flattened());
    numbers.extend(row.innovation);
    numbers.extend([xx, xy, xy, yy]);
    numbers.extend([row.acceleration, row.turn_rate]);
    numbers.extend([row.turn_probability, row.speed_change_probability]);
    numbers.extend([row.height, row.height_sigma, row.vertical_rate, row.gap]);
    debug_assert_eq!(numbers.len() % NUMBERS, 0);
}
