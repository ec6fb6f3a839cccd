//! Bindings of regions around positions, and of protection levels.

use super::{known_height, optional, size};
use crate::arrays::{Array, Input, Rows, Threads, array, columns, release, repeated};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use tertia::batch::for_each_row;
use tertia::location::{Instant, Located, Outline, Protection, Spread};
use tertia::sensors::KINDS;

/// Areas, semi-axes and orientations of regions; and their outlines.
pub type Regions<'py> = ([Array<'py>; 4], Vec<Vec<Array<'py>>>);

/// Costs of an instant, for the choice of threads.
const REGION_NS: f64 = 3e4;
const LEVEL_NS: f64 = 3e4;

/// Positions, and what they were estimated from.
struct Batch<'a> {
    k: usize,
    d: usize,
    stations: Rows<'a>,
    axes: Option<Rows<'a>>,
    values: Rows<'a>,
    sigmas: Rows<'a>,
    surveys: Option<Rows<'a>>,
    height: Option<Rows<'a>>,
    correlation: f64,
    outlier: Vec<bool>,
    position: Rows<'a>,
}

/// Measurements of a batch: stations, axes, values, sigmas, sigmas of the stations' coordinates,
/// heights with theirs, the correlation of range differences, marks of outliers (not zero), positions.
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

impl<'a> Batch<'a> {
    fn new(scene: &'a Scene<'_>) -> PyResult<Self> {
        let (stations, axes, values, sigmas, surveys, height, correlation, outlier, position) =
            scene;
        let (k, d) = size(stations)?;
        let (stations, values) = (stations.blocks("stations", 2)?, values.blocks("values", 2)?);
        let (sigmas, position) = (sigmas.blocks("sigmas", 2)?, position.blocks("position", 1)?);
        let outlier = outlier.blocks("outlier", 2)?;
        let count = values.count();
        stations.require_shared(k * d, count)?;
        values.require(KINDS * k, count)?;
        sigmas.require_shared(KINDS * k, count)?;
        outlier.require(KINDS * k, count)?;
        position.require(d, count)?;
        let axes = optional(axes.as_ref(), "axes", (3, k * d * d), count)?;
        let surveys = optional(surveys.as_ref(), "position_sigmas", (1, k), count)?;
        let height = optional(height.as_ref(), "height", (1, 2), count)?;
        let outlier = outlier.values.iter().map(|&mark| mark != 0.0).collect();
        let correlation = *correlation;
        Ok(Self {
            k,
            d,
            stations,
            axes,
            values,
            sigmas,
            surveys,
            height,
            correlation,
            outlier,
            position,
        })
    }

    fn instant(&self, row: usize) -> Instant<'_> {
        Instant {
            stations: self.stations.shared(row),
            axes: self.axes.as_ref().map(|axes| axes.shared(row)),
            values: self.values.shared(row),
            sigmas: self.sigmas.shared(row),
            position_sigmas: self.surveys.as_ref().map(|surveys| surveys.shared(row)),
            height: self.height.as_ref().and_then(|rows| known_height(rows.shared(row))),
            initial: None,
        }
    }

    fn outlier(&self, row: usize) -> &[bool] {
        &self.outlier[row * KINDS * self.k..][..KINDS * self.k]
    }

    fn located(&self, row: usize) -> Located<'_> {
        Located {
            instant: self.instant(row),
            correlation: self.correlation,
            outlier: self.outlier(row),
            position: self.position.shared(row),
        }
    }

    /// What `work` makes of every instant.
    fn each<T: Clone + Send>(
        &self,
        py: Python<'_>,
        nanoseconds: f64,
        n_threads: Threads,
        unknown: T,
        work: impl Fn(usize) -> T + Sync + Send,
    ) -> PyResult<Vec<T>> {
        let mut found = repeated(unknown, self.values.count())?;
        let cost = nanoseconds * found.len() as f64;
        let work = |(): &mut (), (row, out): (usize, &mut T)| {
            *out = work(row);
            Ok(())
        };
        release(py, cost, || {
            for_each_row(found.iter_mut().enumerate(), cost, n_threads, || (), work)
        })?
        .map_err(|failure| self.values.error(failure))?;
        Ok(found)
    }
}

/// Covariances, and common standard deviations with their degrees of freedom where these were
/// estimated.
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
    let batch = Batch::new(scene)?;
    let count = batch.values.count();
    let covariance = covariance.blocks("covariance", 2)?;
    covariance.require(batch.d * batch.d, count)?;
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
    batch.each(py, REGION_NS, n_threads, unknown, |row| {
        let (sigma, freedom) =
            estimated.as_ref().map_or((1.0, f64::INFINITY), |(s, f)| (s[row], f[row]));
        work(&Spread { covariance: covariance.shared(row), sigma, freedom }, &batch.located(row))
    })
}

/// Regions around positions.
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

/// Radii about positions.
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

/// Protection levels of positions: the risk, the probability of a fault, the number of faults and
/// the probability of a false alarm.
#[pyfunction]
pub fn protection_levels<'py>(
    py: Python<'py>,
    scene: Scene<'py>,
    guarded: (f64, f64, usize, f64),
    n_threads: Threads,
) -> PyResult<Array<'py>> {
    let (risk, fault_probability, faults, false_alarm_probability) = guarded;
    let protection = Protection { risk, fault_probability, faults, false_alarm_probability };
    let batch = Batch::new(&scene)?;
    let found = batch.each(py, LEVEL_NS, n_threads, f64::NAN, |row| {
        let located = batch.located(row);
        match batch.d {
            2 => protection.level::<2, 3>(&located),
            _ => protection.level::<3, 4>(&located),
        }
    })?;
    array(py, batch.values.batch(), found)
}

/// Outlines, as arrays.
pub fn regions<'py>(py: Python<'py>, shape: &[usize], found: &[Outline]) -> PyResult<Regions<'py>> {
    let of: [fn(&Outline) -> f64; 4] =
        [|own| own.area, |own| own.semi_major, |own| own.semi_minor, |own| own.orientation];
    let columns = columns(py, shape, found, of)?;
    let line = |ring: &Vec<[f64; 2]>| array(py, &[ring.len(), 2], ring.concat());
    let lines = |own: &Outline| own.rings.iter().map(line).collect();
    let lines: PyResult<Vec<_>> = found.iter().map(lines).collect();
    Ok((columns, lines?))
}
