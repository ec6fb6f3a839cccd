//! Bindings for regions around positions, and for protection levels.

use super::batch::Batch;
use crate::arrays::{Array, Input, Rows, Threads, array, columns};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use tertia::location::{Located, Outline, Protection, Spread};
use tertia::sensors::KINDS;

/// Areas, semi-axes and orientations of regions, and their outlines.
pub type Regions<'py> = ([Array<'py>; 4], Vec<Vec<Array<'py>>>);

/// Costs of an instant, which determine the number of threads.
const REGION_NS: f64 = 3e4;
const LEVEL_NS: f64 = 3e4;

/// Positions, and the measurements from which they were estimated.
struct Positions<'a> {
    batch: Batch<'a>,
    correlation: f64,
    outlier: Vec<bool>,
    position: Rows<'a>,
}

/// Measurements of a batch: stations, axes, values, sigmas, sigmas of the stations' coordinates, heights with
/// their sigmas, the correlation of range differences, marks of outliers (not zero), positions.
type Scene<'py> = (
    Input<'py>,
    Option<Input<'py>>,
    Input<'py>,
    Input<'py>,
    Option<Input<'py>>,
    Option<Input<'py>>,
    f64,
    Input<'py>,
    Input<'py>,
);

impl<'a> Positions<'a> {
    fn new(scene: &'a Scene<'_>) -> PyResult<Self> {
        let (stations, axes, values, sigmas, surveys, height, correlation, outlier, position) =
            scene;
        let batch = Batch::new(stations, axes.as_ref(), values, sigmas)?;
        let batch = batch.with(surveys.as_ref(), height.as_ref(), None)?;
        let (outlier, position) = (outlier.blocks("outlier", 2)?, position.blocks("position", 1)?);
        outlier.require(KINDS * batch.k, batch.count())?;
        position.require(batch.d, batch.count())?;
        let outlier = outlier.values.iter().map(|&mark| mark != 0.0).collect();
        Ok(Self { batch, correlation: *correlation, outlier, position })
    }

    fn located(&self, row: usize) -> Located<'_> {
        let size = KINDS * self.batch.k;
        Located {
            instant: self.batch.instant(row),
            correlation: self.correlation,
            outlier: &self.outlier[row * size..][..size],
            position: self.position.shared(row),
        }
    }
}

/// Covariances; if the standard deviations were estimated, also the common ones with their degrees of
/// freedom.
type Accuracy<'py> = (Input<'py>, Option<(Input<'py>, Input<'py>)>);

/// Calls `work` with every position and its accuracy.
fn each_located<T: Clone + Send>(
    py: Python<'_>,
    scene: &Scene<'_>,
    (covariance, estimated): &Accuracy<'_>,
    unknown: T,
    n_threads: Threads,
    work: impl Fn(&Spread<'_>, &Located<'_>) -> T + Sync + Send,
) -> PyResult<Vec<T>> {
    let positions = Positions::new(scene)?;
    let (count, d) = (positions.batch.count(), positions.batch.d);
    let covariance = covariance.blocks("covariance", 2)?;
    covariance.require(d * d, count)?;
    let estimated = match estimated {
        None => None,
        Some((sigma, freedom)) => {
            let (sigma, freedom) = (sigma.numbers("sigma")?, freedom.numbers("freedom")?);
            if sigma.len() != count || freedom.len() != count {
                return Err(PyValueError::new_err("sigma and freedom must be of every instant"));
            }
            Some((sigma, freedom))
        }
    };
    positions.batch.each(py, REGION_NS, n_threads, unknown, |row, out| {
        let (sigma, freedom) =
            estimated.as_ref().map_or((1.0, f64::INFINITY), |(s, f)| (s[row], f[row]));
        let spread = Spread { covariance: covariance.shared(row), sigma, freedom };
        *out = work(&spread, &positions.located(row));
        Ok(())
    })
}

/// Computes regions around positions.
#[pyfunction]
pub fn location_regions<'py>(
    py: Python<'py>,
    scene: Scene<'py>,
    accuracy: Accuracy<'py>,
    probability: f64,
    n_threads: Threads,
) -> PyResult<Regions<'py>> {
    let unknown = Outline::empty();
    let found = each_located(py, &scene, &accuracy, unknown, n_threads, |spread, located| {
        spread.region(located, probability)
    })?;
    let shape = scene.2.shape();
    regions(py, &shape[..shape.len() - 2], &found)
}

/// Computes radii about positions.
#[pyfunction]
pub fn location_radii<'py>(
    py: Python<'py>,
    scene: Scene<'py>,
    accuracy: Accuracy<'py>,
    probability: f64,
    n_threads: Threads,
) -> PyResult<Array<'py>> {
    let found = each_located(py, &scene, &accuracy, f64::NAN, n_threads, |spread, _| {
        spread.radius(probability)
    })?;
    let shape = scene.2.shape();
    array(py, &shape[..shape.len() - 2], found)
}

/// Computes protection levels of positions. `guarded` contains the risk, the probability of a fault, the
/// number of faults and the probability of a false alarm.
#[pyfunction]
pub fn protection_levels<'py>(
    py: Python<'py>,
    scene: Scene<'py>,
    guarded: (f64, f64, usize, f64),
    n_threads: Threads,
) -> PyResult<Array<'py>> {
    let (risk, fault_probability, faults, false_alarm_probability) = guarded;
    let protection = Protection { risk, fault_probability, faults, false_alarm_probability };
    let positions = Positions::new(&scene)?;
    let batch = &positions.batch;
    let found = batch.each(py, LEVEL_NS, n_threads, f64::NAN, |row, out| {
        let located = positions.located(row);
        *out = match batch.d {
            2 => protection.level::<2, 3>(&located),
            _ => protection.level::<3, 4>(&located),
        }?;
        Ok(())
    })?;
    array(py, batch.values.batch(), found)
}

/// Converts outlines to arrays.
pub fn regions<'py>(py: Python<'py>, shape: &[usize], found: &[Outline]) -> PyResult<Regions<'py>> {
    let of: [fn(&Outline) -> f64; 4] =
        [|own| own.area, |own| own.semi_major, |own| own.semi_minor, |own| own.orientation];
    let columns = columns(py, shape, found, of)?;
    let line = |ring: &Vec<[f64; 2]>| array(py, &[ring.len(), 2], ring.concat());
    let lines = |own: &Outline| own.rings.iter().map(line).collect();
    let lines: PyResult<Vec<_>> = found.iter().map(lines).collect();
    Ok((columns, lines?))
}
