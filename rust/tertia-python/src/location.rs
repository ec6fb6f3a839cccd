//! Bindings of `tertia::location`.

mod batch;
mod posterior;
mod region;

pub use posterior::{locate_posterior, posterior_radii, posterior_regions};
pub use region::{location_radii, location_regions, protection_levels};

use crate::arrays::{
    Array, Input, Output, Threads, choice, columns, optional, release, repeated, vector,
};
use batch::{Batch, size};
use pyo3::prelude::*;
use tertia::batch::for_each_row;
use tertia::location::{
    self, Cause, Contradiction, Fix, Instant, Locator, Method, Mixture, Speed, Wind, Workspace,
};
use tertia::sensors::{KINDS, predict};

type Located<'py> = (
    Output<'py>,
    Output<'py>,
    Output<'py>,
    Output<'py, bool>,
    [Array<'py>; 8],
    [[f64; KINDS]; 4],
    ((f64, f64), Option<Blown<'py>>),
);
/// A wind in units of the signal speed, its covariance, and the measurements converted to still air.
type Blown<'py> = ([f64; 2], [[f64; 2]; 2], Array<'py>);

/// Positions, covariances, residuals, marks of outliers, and the complete results.
struct Found<'py> {
    position: Output<'py>,
    covariance: Output<'py>,
    residual: Output<'py>,
    outlier: Output<'py, bool>,
    fixes: Vec<Fix>,
}

/// Cost of an instant per measurement, which determines the number of threads.
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

/// Returns status, degrees of freedom, chi-square, p-value, dilution, estimated standard deviation, emission
/// and its standard deviation of each fix.
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

/// Returns positions, covariances, residuals and marks of outliers, the columns of `fix_columns`, growth,
/// factor, redundancy and common share of `Contradiction`, the share by which signals are faster than stated, its standard deviation,
/// and the wind, if wind is allowed. `robustness` is the method and the degrees of freedom that it requires;
/// `differences` contains whether late arrivals are more likely to be outliers, and the correlation of
/// range differences; `medium` contains the prior standard deviations of the share, and of the wind in
/// units of the signal speed, and whether the stated speed and still air are assumed unless the instants
/// contradict them.
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
    medium: (f64, f64, (bool, bool)),
    n_threads: Threads,
) -> PyResult<Located<'py>> {
    let ((name, redundancy), (multipath, correlation)) = (robustness, differences);
    let mut locator = Locator::new(method(name, redundancy)?)
        .with_multipath(multipath)
        .with_correlation(correlation)
        .profiling();
    let batch = Batch::new(&stations, axes.as_ref(), &values, &sigmas)?;
    let mut batch = batch.with(position_sigmas.as_ref(), height.as_ref(), initial.as_ref())?;
    let (speed_sigma, wind_sigma, _) = medium;
    let (mut speed, mut wind) = find_medium(py, &locator, &mut batch, medium)?;
    let is_alone = batch.count() == 1 && !pooled && name == "robust" && free.contains(&true);
    let (contradiction, mixture) = match is_alone {
        true => (Contradiction::NONE, None),
        false => adapt(py, &mut locator, &mut batch, &free, pooled)?,
    };
    let growth = || {
        let (count, unknown) = (batch.count(), batch.d + 1);
        let measured = batch.values.values.iter().filter(|v| !v.is_nan()).count();
        let redundancy = measured.saturating_sub(count * unknown) as f64 / count as f64;
        contradiction.lasting(redundancy, count)
    };
    if let Some(wind) = &mut wind {
        *wind = wind.grown(growth(), wind_sigma);
    }
    if speed.sigma > 0.0 {
        let growth = growth();
        speed.sigma = speed.sigma.max(speed.alone * growth.sqrt()).min(speed_sigma);
        locator = locator.with_speed_sigma(speed.sigma);
    }
    let special = match mixture {
        Some(mixture) => Special::Mixed(mixture, &free),
        None if is_alone => Special::Alone(&free),
        None => Special::None,
    };
    let located =
        |locator: &Locator| locate_batch(py, locator, &batch, special, wind.as_ref(), n_threads);
    let mut found = located(&locator)?;
    if batch.count() > 1
        && free.contains(&true)
        && let Some(adapted) = on_side(py, &locator, &batch, &found.fixes)?
    {
        locator = adapted;
        found = located(&locator)?;
    }
    if batch.count() > 1
        && name == "robust"
        && let Some(adapted) = of_batch(py, &locator, &batch, &mut found)?
    {
        found = located(&adapted)?;
    }
    let still = |wind: Wind| {
        let values = vector(py, batch.values.values.iter().copied())?;
        Ok::<_, PyErr>((wind.mean, wind.covariance, values))
    };
    let wind = wind.map(still).transpose()?;
    let redundancy = match batch.count() {
        1 if free.contains(&true) => {
            let instant = batch.instant(0);
            match batch.d {
                2 => locator.redundancy::<2>(&instant, &free, &mut Workspace::default()),
                _ => locator.redundancy::<3>(&instant, &free, &mut Workspace::default()),
            }
        }
        _ => contradiction.redundancy,
    };
    let Contradiction { growth, factor, common, unchecked, .. } = contradiction;
    let growth = std::array::from_fn(|kind| growth[kind] * (1.0 + unchecked[kind]));
    let columns = fix_columns(py, batch.values.batch(), &found.fixes)?;
    Ok((
        found.position,
        found.covariance,
        found.residual,
        found.outlier,
        columns,
        [growth, factor, redundancy, common],
        ((speed.share, speed.sigma), wind),
    ))
}

/// Returns what explains the contradictions of located instants without outliers, its value and its standard
/// deviation: the kind whose offset it is, the station whose clock it is, or the squared height of the target.
#[pyfunction]
#[allow(clippy::too_many_arguments)] // the Python signature
pub fn explanation(
    py: Python<'_>,
    stations: Input<'_>,
    axes: Option<Input<'_>>,
    values: Input<'_>,
    sigmas: Input<'_>,
    position_sigmas: Option<Input<'_>>,
    height: Option<Input<'_>>,
    positions: Input<'_>,
    velocities: Option<Input<'_>>,
) -> PyResult<Option<(&'static str, usize, f64, f64)>> {
    let batch = Batch::new(&stations, axes.as_ref(), &values, &sigmas)?;
    let batch = batch.with(position_sigmas.as_ref(), height.as_ref(), None)?;
    let positions = positions.blocks("positions", 1)?;
    positions.require(batch.d, batch.count())?;
    let velocities = optional(velocities.as_ref(), "velocities", (1, batch.d), batch.count())?;
    let (instants, locator) = (batch.instants(), Locator::new(Method::LeastSquares));
    let moving = velocities.as_ref().map(|rows| &*rows.values);
    let found = release(py, LOCATE_NS * batch.values.size(), || match batch.d {
        2 => locator.explanation::<2>(&instants, &positions.values, moving),
        _ => locator.explanation::<3>(&instants, &positions.values, moving),
    })?;
    Ok(found.map(|found| {
        let (name, number) = match found.cause {
            Cause::Slant => ("slant", 0),
            Cause::Offset(kind) => ("offset", kind),
            Cause::Clock(station) => ("clock", station),
        };
        (name, number, found.value, found.sigma)
    }))
}

/// Returns the estimator for the side of the stations on which the targets of a batch are, if it is known.
fn on_side(
    py: Python<'_>,
    locator: &Locator,
    batch: &Batch<'_>,
    fixes: &[Fix],
) -> PyResult<Option<Locator>> {
    let instants = batch.instants();
    release(py, LOCATE_NS * batch.values.size(), || match batch.d {
        2 => locator.on_side::<2>(&instants, fixes, &mut Workspace::default()),
        _ => locator.on_side::<3>(&instants, fixes, &mut Workspace::default()),
    })
}

/// Returns the estimator for the outliers of a batch, if they are not those that it expects.
fn of_batch(
    py: Python<'_>,
    locator: &Locator,
    batch: &Batch<'_>,
    found: &mut Found<'_>,
) -> PyResult<Option<Locator>> {
    let instants = batch.instants();
    let seen = (&*found.outlier.values()?, &found.fixes[..]);
    release(py, LOCATE_NS * batch.values.size(), || match batch.d {
        2 => locator.of_batch::<2>(&instants, seen, &mut Workspace::default()),
        _ => locator.of_batch::<3>(&instants, seen, &mut Workspace::default()),
    })
}

/// Estimates the signal speed and the wind, and converts the measurements to still air and that speed.
fn find_medium(
    py: Python<'_>,
    locator: &Locator,
    batch: &mut Batch<'_>,
    (speed_sigma, wind_sigma, as_stated): (f64, f64, (bool, bool)),
) -> PyResult<(Speed, Option<Wind>)> {
    let sigmas = (speed_sigma, wind_sigma);
    if sigmas == (0.0, 0.0) {
        return Ok((Speed::EXACT, None));
    }
    let instants = batch.instants();
    let found = release(py, LOCATE_NS * batch.values.size(), || match batch.d {
        2 => {
            let mut workspace = Workspace::<2>::default();
            locator.medium_as_stated(&instants, sigmas, as_stated, &mut workspace)
        }
        _ => {
            let mut workspace = Workspace::<3>::default();
            locator.medium_as_stated(&instants, sigmas, as_stated, &mut workspace)
        }
    })?;
    drop(instants);
    *batch.values.values.to_mut() = found.values;
    *batch.sigmas.values.to_mut() = found.sigmas;
    Ok((found.speed, found.wind))
}

/// Cases that need a special method, and marks of the sigmas that may be wrong.
#[derive(Clone, Copy)]
enum Special<'a> {
    None,
    /// A single instant.
    Alone(&'a [bool]),
    /// A batch in which some measurements of instants with few redundant measurements are wrong.
    Mixed(Mixture, &'a [bool]),
}

/// Estimates by how much the instants contradict the stated standard deviations and, if some measurements of
/// instants with few redundant ones are wrong, the distribution of their errors; adapts the standard
/// deviations and the locator.
fn adapt(
    py: Python<'_>,
    locator: &mut Locator,
    batch: &mut Batch<'_>,
    free: &[bool],
    pooled: bool,
) -> PyResult<(Contradiction, Option<Mixture>)> {
    let is_free = free.contains(&true);
    if is_free {
        *locator = locator.growing();
    }
    if !pooled && (batch.count() <= 1 || !is_free) {
        return Ok((Contradiction::NONE, None));
    }
    let instants = batch.instants();
    let cost = LOCATE_NS * batch.values.size();
    let (found, mixture) = release(py, cost, || match batch.d {
        2 => locator.errors::<2>(&instants, free, pooled, &mut Workspace::default()),
        _ => locator.errors::<3>(&instants, free, pooled, &mut Workspace::default()),
    })?;
    drop(instants);
    if found.is_any() {
        found.apply(batch.sigmas.values.to_mut(), free);
    }
    *locator = locator.with_common(found.common).with_unchecked(found.unchecked);
    Ok((found, mixture))
}

/// Locates the instants of a batch.
fn locate_batch<'py>(
    py: Python<'py>,
    locator: &Locator,
    batch: &Batch<'_>,
    special: Special<'_>,
    wind: Option<&Wind>,
    n_threads: Threads,
) -> PyResult<Found<'py>> {
    let (rows, d, count) = (&batch.values, batch.d, batch.count());
    let mut position = Output::new(py, rows.batch(), &[d])?;
    let mut covariance = Output::new(py, rows.batch(), &[d, d])?;
    let (mut residual, mut outlier) = (rows.output(py)?, rows.output(py)?);
    let mut fixes = repeated(Fix::UNKNOWN, count)?;
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
                (block * size..).take(fixes.len()).map(|i| batch.instant(i)).collect();
            let widths = (d, rows.len());
            let mut out =
                location::Output::rows((position, covariance), (residual, outlier), widths);
            match d {
                2 => locate_block(locator, special, &instants, &mut out, fixes, plane),
                _ => locate_block(locator, special, &instants, &mut out, fixes, space),
            }
            if let Some(wind) = wind {
                for ((instant, out), fix) in instants.iter().zip(&mut out).zip(fixes) {
                    match d {
                        2 => wind.add_to::<2>(instant, out, fix),
                        _ => wind.add_to::<3>(instant, out, fix),
                    }
                }
            }
            Ok(())
        })
    })?;
    done.map_err(|failure| rows.error(failure))?;
    Ok(Found { position, covariance, residual, outlier, fixes })
}

/// Locates a block of instants side by side.
fn locate_block<const D: usize>(
    locator: &Locator,
    special: Special<'_>,
    instants: &[Instant<'_>],
    out: &mut [location::Output<'_>],
    fixes: &mut [Fix],
    workspace: &mut Workspace<D>,
) {
    match special {
        Special::None => locator.locate_all(instants, out, fixes, workspace),
        Special::Alone(free) => {
            fixes[0] = locator.locate_alone(&instants[0], free, &mut out[0], workspace);
        }
        Special::Mixed(mixture, free) => {
            locator.locate_all_mixed(instants, (&mixture, free), (out, fixes), workspace);
        }
    }
}

/// Returns covariances and dilutions of precision at positions, for stations with their axes, and for
/// standard deviations of the measurements and of the positions of stations.
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

/// Returns the measurements (..., kinds, K) that stations would make, without errors, of targets at positions
/// (..., D).
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
