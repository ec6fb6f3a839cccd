//! Tracks smoothed with all their plots.

use super::settings::Motion;
use crate::arrays::{Array, Input, Integers, Marks, Threads, array, release};
use numpy::PyReadonlyArray1;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use tertia::tracker::{Movement, Plane, SmoothedRow, Times, TrackPlot, smooth_tracks as smooth};

/// Cost of a plot, for the decision whether to release the interpreter's lock.
const PLOT_NS: f64 = 5000.0;
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
    let movement = Movement::of(motion.core())
        .ok_or_else(|| PyValueError::new_err("motion must be 'imm' or 'cv', or such a model"))?;
    let values = plots.points::<12>("plots", 1)?;
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
        array(py, &[rows.len()], rows.iter().map(|track| track.len() as i64))?,
        array(py, &[count, NUMBERS], numbers)?,
        array(py, &[count, 4], codes)?,
        array(py, &[count, 2], marks)?,
    ))
}

/// Creates a plot from time, east, north, their variances and covariance, the same of the velocity, and
/// height.
fn plot(values: &[f64; 12], used: bool) -> TrackPlot {
    let &[time, x, y, xx, xy, yy, vx, vy, uu, uv, vv, height] = values;
    TrackPlot {
        time,
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
