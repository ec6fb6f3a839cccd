//! Bindings of `tertia::location`.

mod posterior;
mod region;

pub use posterior::{locate_posterior, posterior_radii, posterior_regions};
pub use region::{location_radii, location_regions, protection_levels};

use crate::arrays::{Array, Input, Output, Rows, Threads, choice, columns, release, repeated};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use tertia::batch::for_each_row;
use tertia::location::{self, Contradiction, Fix, Instant, Locator, Method, Speed, Workspace};
use tertia::sensors::{KINDS, predict};

type Located<'py> = (
    Output<'py>,
    Output<'py>,
    Output<'py>,
    Output<'py, bool>,
    [Array<'py>; 8],
    [[f64; KINDS]; 4],
    (f64, f64),
);

/// Cost of an instant per measurement, for the choice of threads.
const LOCATE_NS: f64 = 500.0;
const ACCURACY_NS: f64 = 30.0;

fn method(name: &str, redundancy: usize) -> PyResult<Method> {
    let choices = [
        ("robust", Method::Robust(redundancy)),
        ("least-squares", Method::LeastSquares),
        ("lenth-mle", Method::LenthMle),
        ("lenth-huber", Method::LenthHuber),
        ("lenth-andrews", Method::LenthAndrews),
    ];
    choice("method", name, &choices)
}

/// Stations and dimensions of positions (..., K, D).
fn size(stations: &Input<'_>) -> PyResult<(usize, usize)> {
    match stations.shape() {
        [.., k, d @ (2 | 3)] if *k > 0 => Ok((*k, *d)),
        shape => Err(PyValueError::new_err(format!(
            "stations has shape {shape:?}; it must be (..., K, D)"
        ))),
    }
}

/// Rows of so many axes and numbers, of so many instants or one for all, where they are given.
fn optional<'a>(
    input: Option<&'a Input<'_>>,
    name: &'static str,
    (axes, length): (usize, usize),
    count: usize,
) -> PyResult<Option<Rows<'a>>> {
    let Some(input) = input else { return Ok(None) };
    let rows = input.blocks(name, axes)?;
    rows.require_shared(length, count)?;
    Ok(Some(rows))
}

/// A height and its standard deviation; none where it is nan.
fn known_height(row: &[f64]) -> Option<(f64, f64)> {
    (!row[0].is_nan()).then(|| (row[0], row[1]))
}

/// What was measured at the instants of a batch, but for its standard deviations.
struct Batch<'a> {
    stations: &'a Rows<'a>,
    axes: Option<&'a Rows<'a>>,
    values: &'a Rows<'a>,
    surveys: Option<&'a Rows<'a>>,
    height: Option<&'a Rows<'a>>,
    initial: Option<&'a Rows<'a>>,
}

impl<'a> Batch<'a> {
    fn new(
        stations: &'a Rows<'a>,
        axes: Option<&'a Rows<'a>>,
        values: &'a Rows<'a>,
        [surveys, height, initial]: [Option<&'a Rows<'a>>; 3],
    ) -> Self {
        Self { stations, axes, values, surveys, height, initial }
    }

    fn instant(&self, sigmas: &'a Rows<'_>, i: usize) -> Instant<'a> {
        Instant {
            stations: self.stations.shared(i),
            axes: self.axes.map(|axes| axes.shared(i)),
            values: self.values.shared(i),
            sigmas: sigmas.shared(i),
            position_sigmas: self.surveys.map(|surveys| surveys.shared(i)),
            height: self.height.and_then(|rows| known_height(rows.shared(i))),
            initial: self.initial.map(|initial| initial.shared(i)),
        }
    }

    fn instants(&self, sigmas: &'a Rows<'_>) -> Vec<Instant<'a>> {
        (0..self.values.count()).map(|i| self.instant(sigmas, i)).collect()
    }
}

/// Problems, degrees of freedom, chi-square, p-values, dilutions, estimated standard deviations,
/// emissions and their standard deviations.
pub fn fix_columns<'py>(
    py: Python<'py>,
    batch: &[usize],
    fixes: &[Fix],
) -> PyResult<[Array<'py>; 8]> {
    let of: [fn(&Fix) -> f64; 8] = [
        |fix| f64::from(fix.status as u8),
        |fix| fix.degrees_of_freedom as f64,
        |fix| fix.statistic,
        |fix| fix.pvalue,
        |fix| fix.dop,
        |fix| fix.sigma,
        |fix| fix.emission,
        |fix| fix.emission_sigma,
    ];
    columns(py, batch, fixes, of)
}

/// Positions, covariances, residuals, marks; and problems, degrees of freedom, chi-square,
/// p-values, dilutions, estimated standard deviations, emissions and theirs. `robustness` is the
/// method and the degrees of freedom that it needs; `differences` tells whether late arrivals are
/// likelier outliers, and how range differences correlate. Last come the share by which signals are
/// faster than stated, and its standard deviation; that before is `speed_sigma`.
#[pyfunction]
#[allow(clippy::too_many_arguments)] // the Python signature
pub fn locate<'py>(
    py: Python<'py>,
    stations: Input<'py>,
    axes: Option<Input<'py>>,
    values: Input<'py>,
    sigmas: Input<'py>,
    position_sigmas: Option<Input<'py>>,
    height: Option<Input<'py>>,
    initial: Option<Input<'py>>,
    robustness: (&str, usize),
    differences: (bool, f64),
    free: Vec<bool>,
    pooled: bool,
    speed_sigma: f64,
    n_threads: Threads,
) -> PyResult<Located<'py>> {
    let ((name, redundancy), (multipath, correlation)) = (robustness, differences);
    let mut locator = Locator::new(method(name, redundancy)?)
        .with_multipath(multipath)
        .with_correlation(correlation)
        .profiling();
    let (k, d) = size(&stations)?;
    let (stations, mut rows) = (stations.blocks("stations", 2)?, values.blocks("values", 2)?);
    let mut sigmas = sigmas.blocks("sigmas", 2)?;
    let count = rows.count();
    rows.require(KINDS * k, count)?;
    sigmas.require_shared(KINDS * k, count)?;
    stations.require_shared(k * d, count)?;
    let surveys = optional(position_sigmas.as_ref(), "position_sigmas", (1, k), count)?;
    let height = optional(height.as_ref(), "height", (1, 2), count)?;
    let initial = optional(initial.as_ref(), "initial", (1, d), count)?;
    let axes = optional(axes.as_ref(), "axes", (3, k * d * d), count)?;
    let others = [surveys.as_ref(), height.as_ref(), initial.as_ref()];
    let mut speed = Speed::EXACT;
    if speed_sigma > 0.0 {
        speed = {
            let instants = Batch::new(&stations, axes.as_ref(), &rows, others).instants(&sigmas);
            release(py, LOCATE_NS * rows.size(), || match d {
                2 => locator.speed::<2>(&instants, speed_sigma, &mut Workspace::default()),
                _ => locator.speed::<3>(&instants, speed_sigma, &mut Workspace::default()),
            })?
        };
        speed.apply(rows.values.to_mut(), k);
        speed.apply(sigmas.values.to_mut(), k);
    }
    let batch = Batch::new(&stations, axes.as_ref(), &rows, others);
    let mut position = Output::new(py, rows.batch(), &[d])?;
    let mut covariance = Output::new(py, rows.batch(), &[d, d])?;
    let (mut residual, mut outlier) = (rows.output(py)?, rows.output(py)?);
    let mut fixes = repeated(Fix::UNKNOWN, count)?;
    let mut contradiction = Contradiction::NONE;
    if free.contains(&true) {
        locator = locator.growing();
    }
    if pooled || count > 1 && free.contains(&true) {
        contradiction = {
            let instants = batch.instants(&sigmas);
            release(py, LOCATE_NS * rows.size(), || match d {
                2 => {
                    locator.contradiction::<2>(&instants, &free, pooled, &mut Workspace::default())
                }
                _ => {
                    locator.contradiction::<3>(&instants, &free, pooled, &mut Workspace::default())
                }
            })?
        };
        if contradiction.is_any() {
            contradiction.apply(sigmas.values.to_mut(), &free);
        }
        locator = locator.with_common(contradiction.common);
    }
    if speed_sigma > 0.0 {
        let measured = rows.values.iter().filter(|v| !v.is_nan()).count();
        let redundancy = measured.saturating_sub(count * (d + 1)) as f64 / count as f64;
        let growth = contradiction.lasting(redundancy, count);
        speed.sigma = (speed.sigma * growth.sqrt()).min(speed_sigma);
        locator = locator.with_speed_sigma(speed.sigma);
    }
    if count > 1 && name == "robust" {
        let instants = batch.instants(&sigmas);
        locator = release(py, LOCATE_NS * rows.size(), || match d {
            2 => locator.of_batch::<2>(&instants, &mut Workspace::default()),
            _ => locator.of_batch::<3>(&instants, &mut Workspace::default()),
        })?;
    }
    let size = location::BLOCK;
    let outputs = position
        .values()?
        .chunks_mut(d * size)
        .zip(covariance.values()?.chunks_mut(d * d * size))
        .zip(residual.values()?.chunks_mut(rows.len() * size))
        .zip(outlier.values()?.chunks_mut(rows.len() * size))
        .zip(fixes.chunks_mut(size));
    let cost = LOCATE_NS * (rows.len() * count) as f64;
    let done = release(py, cost, || {
        let new = || (Workspace::<2>::default(), Workspace::<3>::default());
        for_each_row(outputs.enumerate(), cost, n_threads, new, |(plane, space), (block, out)| {
            let ((((position, covariance), residual), outlier), fixes) = out;
            let instants: Vec<_> =
                (block * size..).take(fixes.len()).map(|i| batch.instant(&sigmas, i)).collect();
            let mut out: Vec<_> = position
                .chunks_mut(d)
                .zip(covariance.chunks_mut(d * d))
                .zip(residual.chunks_mut(rows.len()))
                .zip(outlier.chunks_mut(rows.len()))
                .map(|(((position, covariance), residual), outlier)| location::Output {
                    position,
                    covariance,
                    residual,
                    outlier,
                })
                .collect();
            match d {
                2 => locator.locate_all(&instants, &mut out, fixes, plane),
                _ => locator.locate_all(&instants, &mut out, fixes, space),
            }
            Ok(())
        })
    })?;
    done.map_err(|failure| rows.error(failure))?;
    let found = fix_columns(py, rows.batch(), &fixes)?;
    let Contradiction { growth, factor, degrees_of_freedom, common } = contradiction;
    Ok((
        position,
        covariance,
        residual,
        outlier,
        found,
        [growth, factor, degrees_of_freedom, common],
        (speed.share, speed.sigma),
    ))
}

/// Covariances and dilutions at positions, of stations with their axes, and of the standard deviations
/// of measurements and of surveys.
#[pyfunction]
pub fn location_accuracy<'py>(
    py: Python<'py>,
    stations: (Input<'py>, Option<Input<'py>>),
    sigmas: (Input<'py>, Option<Input<'py>>),
    positions: Input<'py>,
    correlation: f64,
    n_threads: Threads,
) -> PyResult<(Output<'py>, Output<'py>)> {
    let ((stations, axes), (sigmas, position_sigmas)) = (stations, sigmas);
    let (k, d) = size(&stations)?;
    let (stations, sigmas) = (stations.blocks("stations", 2)?, sigmas.blocks("sigmas", 2)?);
    let rows = positions.blocks("positions", 1)?;
    stations.require(k * d, 1)?;
    sigmas.require(KINDS * k, 1)?;
    rows.require(d, rows.count())?;
    let axes = optional(axes.as_ref(), "axes", (3, k * d * d), 1)?;
    let surveys = optional(position_sigmas.as_ref(), "position_sigmas", (1, k), 1)?;
    let locator = Locator::new(Method::LeastSquares).with_correlation(correlation);
    let instant = Instant {
        stations: &stations.values,
        axes: axes.as_ref().map(|axes| &*axes.values),
        values: &sigmas.values,
        sigmas: &sigmas.values,
        position_sigmas: surveys.as_ref().map(|surveys| &*surveys.values),
        height: None,
        initial: None,
    };
    let mut covariance = Output::new(py, rows.batch(), &[d, d])?;
    let mut dilution = Output::new(py, rows.batch(), &[])?;
    let outputs = covariance.rows()?.zip(dilution.values()?);
    let cost = ACCURACY_NS * (KINDS * k * rows.count()) as f64;
    let new = || (Workspace::<2>::default(), Workspace::<3>::default());
    rows.each(py, cost, n_threads, outputs, new, |(plane, space), (_, p), (covariance, out)| {
        *out = match d {
            2 => locator.accuracy(&instant, p, covariance, plane),
            _ => locator.accuracy(&instant, p, covariance, space),
        };
        Ok(())
    })?;
    Ok((covariance, dilution))
}

/// What stations measure of positions (..., D) without errors, (..., kinds, K).
#[pyfunction]
pub fn predicted<'py>(
    py: Python<'py>,
    stations: Input<'py>,
    axes: Option<Input<'py>>,
    positions: Input<'py>,
    n_threads: Threads,
) -> PyResult<Output<'py>> {
    let (k, d) = size(&stations)?;
    let (stations, rows) = (stations.blocks("stations", 2)?, positions.blocks("positions", 1)?);
    stations.require_shared(k * d, rows.count())?;
    rows.require(d, rows.count())?;
    let axes = optional(axes.as_ref(), "axes", (3, k * d * d), rows.count())?;
    let mut found = Output::new(py, rows.batch(), &[KINDS, k])?;
    let cost = ACCURACY_NS * (KINDS * k * rows.count()) as f64;
    rows.each(
        py,
        cost,
        n_threads,
        found.rows()?,
        || (),
        |(), (i, p), out| {
            let axes = axes.as_ref().map(|axes| axes.shared(i));
            match d {
                2 => predict::<2>(stations.shared(i), axes, p, out),
                _ => predict::<3>(stations.shared(i), axes, p, out),
            }
            Ok(())
        },
    )?;
    Ok(found)
}
