//! Bindings of `tertia::trajectory`.

pub mod arrivals;

use crate::arrays::{Array, Input, Marks, Threads, array, release, value_error};
use crate::location::fix_columns;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::borrow::Cow;
use tertia::sensors::KINDS;
use tertia::trajectory::{
    self, Failure, LastingErrors, Polynomials, Prior, Record, Systematic, Trajectory,
};

/// Position, covariance, residuals and marks of outliers; status, degrees of freedom, chi-square, p-values,
/// dilutions and standard deviations, as from `locate`.
type Located<'py> = (Array<'py>, Array<'py>, Array<'py>, Marks<'py>, [Array<'py>; 8]);

/// Covariance, innovation, log-likelihood, count, and the jerk, its standard uncertainty and the
/// acceleration noise.
type Smoothed<'py> = (Array<'py>, Array<'py>, f64, usize, [f64; 3]);

/// Biases and their standard deviations (5 K, then K of the clocks), the share of their variance that drifts, its correlation time,
/// and whether any measurements could contradict each other.
type Lasting = (Vec<f64>, Vec<f64>, f64, f64, bool);

/// Heights: their whitened residuals, the marks of outliers, and their lasting error with its standard
/// deviation.
type Judged<'py> = (Array<'py>, Marks<'py>, f64, f64);

/// Result of a reconstruction, or the reason of its failure with the numbers of the instants or problems.
#[derive(Default, IntoPyObject)]
pub struct Reconstructed<'py> {
    failure: Option<(&'static str, Vec<usize>)>,
    mean: Option<Array<'py>>,
    covariance: Option<Array<'py>>,
    smoothed: Option<Smoothed<'py>>,
    fixes: Option<Located<'py>>,
    outlier: Option<Marks<'py>>,
    residual: Option<Array<'py>>,
    bias: Option<Lasting>,
    height: Option<Judged<'py>>,
    image: Option<Array<'py>>,
    is_behind: bool,
    may_cross: bool,
    is_doubtful: bool,
    relative_range_sigma: Option<f64>,
}

/// Measurements of stations: positions (K, D) or (N, K, D), axes, standard deviations of the positions
/// (K), times, errors of the clocks (K), values (N, 5, K) and standard deviations (5, K), or one for each value (N, 5, K); relative
/// standard deviation of the signal speed, and covariance of the wind in units of this speed; heights (N), nan
/// where missing, their standard deviations (N) and the usual one.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Measured<'py> {
    stations: Input<'py>,
    axes: Option<Input<'py>>,
    surveys: Option<Vec<f64>>,
    time: Input<'py>,
    clocks: Option<Vec<f64>>,
    values: Input<'py>,
    sigmas: Input<'py>,
    own_sigmas: Option<Input<'py>>,
    height: Option<(Input<'py>, Input<'py>, f64)>,
    correlation: f64,
    speed_sigma: f64,
    wind: Option<[[f64; 2]; 2]>,
    robust: bool,
    initial: Option<Vec<f64>>,
}

/// The order of the two steps, and the method of the second.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Steps {
    temporal_first: bool,
    /// Window and degree (`None`: chosen automatically) of local polynomials; `None`: smoothed with a
    /// motion model.
    polynomials: Option<(usize, Option<usize>)>,
    /// Jerk of positions.
    jerk: Option<f64>,
    /// Indices of the kinds with a flat prior of their biases; `None`: the next three fields apply.
    flat: Option<Vec<usize>>,
    /// Standard deviations of lasting errors (5 K): 0 if trusted, nan if estimated; then those of clocks (K).
    bias_sigma: Vec<f64>,
    /// Shares of their variance that drift, and the correlation times (6 K); nan if estimated.
    drift_share: Vec<f64>,
    drift_time: Vec<f64>,
    /// Standard deviations of azimuths that depend on the direction (N K).
    deviation: Option<Vec<f64>>,
}

/// Measurements of the instants, and their standard deviations.
struct Rows<'a> {
    values: Cow<'a, [f64]>,
    sigmas: Cow<'a, [f64]>,
    own: Option<Cow<'a, [f64]>>,
}

impl Rows<'_> {
    /// Appends the height to the measurements of each instant.
    fn with_heights(self, height: &[f64], sigma: &[f64], usual: f64) -> Self {
        let width = self.sigmas.len();
        let beside = |rows: &[f64], last: &[f64]| {
            let pairs = rows.chunks_exact(width).zip(last);
            pairs.flat_map(|(row, last)| row.iter().chain([last])).copied().collect()
        };
        let own = match &self.own {
            Some(own) => beside(own, sigma),
            None => beside(&self.sigmas.repeat(height.len()), sigma),
        };
        Self {
            values: beside(&self.values, height),
            sigmas: beside(&self.sigmas, &[usual]),
            own: Some(own),
        }
    }
}

const SHAPES: &str = "the shapes do not fit together";

/// Reconstructs a trajectory from measurements.
#[pyfunction]
#[pyo3(signature = (measured, steps, n_threads))]
pub fn reconstruct<'py>(
    py: Python<'py>,
    measured: Measured<'py>,
    steps: Steps,
    n_threads: Threads,
) -> PyResult<Reconstructed<'py>> {
    let d = measured.stations.shape().last().copied().unwrap_or(0);
    let stations = measured.stations.blocks("stations", 2)?;
    let axes = measured.axes.as_ref().map(|axes| axes.blocks("axes", 3)).transpose()?;
    let time = measured.time.rows("time", 0)?;
    let (values, sigmas) =
        (measured.values.blocks("values", 2)?, measured.sigmas.blocks("sigmas", 2)?);
    let own = measured.own_sigmas.as_ref().map(|own| own.blocks("sigmas", 2)).transpose()?;
    let (n, k) = (time.values.len(), sigmas.values.len() / KINDS);
    let fits = values.values.len() == n * KINDS * k
        && own.as_ref().is_none_or(|own| own.values.len() == n * KINDS * k);
    let mut rows = Rows {
        values: Cow::Borrowed(&values.values),
        sigmas: Cow::Borrowed(&sigmas.values),
        own: own.as_ref().map(|own| Cow::Borrowed(&*own.values)),
    };
    let mut usual = None;
    if let Some((height, sigma, own)) = &measured.height {
        let (height, sigma) = (height.numbers("height")?, sigma.numbers("height_sigma")?);
        if !fits || d != 3 || [height.len(), sigma.len()] != [n; 2] {
            return Err(PyValueError::new_err(SHAPES));
        }
        rows = rows.with_heights(&height, &sigma, *own);
        usual = Some(*own);
    }
    let record = Record {
        stations: &stations.values,
        axes: axes.as_ref().map(|axes| &*axes.values),
        surveys: measured.surveys.as_deref(),
        time: &time.values,
        clocks: measured.clocks.as_deref(),
        values: &rows.values,
        sigmas: &rows.sigmas,
        own_sigmas: rows.own.as_deref(),
        correlation: measured.correlation,
        speed_sigma: measured.speed_sigma,
        wind: measured.wind,
        robust: measured.robust,
        initial: measured.initial.as_deref(),
        n_threads,
    };
    if !fits || !steps.fit(&record, (n, k, d)) {
        return Err(PyValueError::new_err(SHAPES));
    }
    let found = release(py, f64::INFINITY, || match d {
        2 => steps.take::<2, 6>(&record, usual),
        _ => steps.take::<3, 9>(&record, usual),
    })?;
    match found {
        Ok(found) => Reconstructed::new(py, found, n, d, k),
        Err(Failure::NotLocated(reasons)) => {
            let reasons = reasons.into_iter().map(usize::from).collect();
            Ok(Reconstructed::failed("not-located", reasons))
        }
        Err(Failure::Unusable(columns)) => Ok(Reconstructed::failed("unusable", columns)),
        Err(Failure::Unobservable(columns)) => Ok(Reconstructed::failed("unobservable", columns)),
        Err(Failure::Mirrored) => Ok(Reconstructed::failed("mirrored", Vec::new())),
        Err(Failure::Unbounded) => Ok(Reconstructed::failed("unbounded", Vec::new())),
        Err(Failure::Diverged) => Ok(Reconstructed::failed("diverged", Vec::new())),
        Err(Failure::Error(error)) => Err(value_error(error)),
    }
}

impl Steps {
    /// Whether all shapes are those of N instants and K stations in D dimensions.
    fn fit(&self, record: &Record<'_>, (n, k, d): (usize, usize, usize)) -> bool {
        let fits = |size: usize, count: usize| size == count || size == n * count;
        fits(record.stations.len(), k * d)
            && record.surveys.is_none_or(|surveys| surveys.len() == k)
            && record.clocks.is_none_or(|clocks| clocks.len() == k)
            && record.axes.is_none_or(|axes| fits(axes.len(), k * d * d))
            && record.initial.is_none_or(|initial| initial.len() == d)
            && self.flat.iter().flatten().all(|kind| *kind < KINDS)
            && [&self.bias_sigma, &self.drift_share, &self.drift_time]
                .iter()
                .all(|own| own.len() == (KINDS + 1) * k)
            && self.deviation.as_ref().is_none_or(|sigma| sigma.len() == n * k)
    }

    fn take<const D: usize, const N: usize>(
        &self,
        record: &Record<'_>,
        height_sigma: Option<f64>,
    ) -> Result<Trajectory, Failure> {
        let polynomials = self.polynomials.map(|(window, degree)| Polynomials { window, degree });
        match polynomials {
            _ if self.temporal_first => trajectory::temporal_first::<D, N>(record, polynomials),
            Some(polynomials) => trajectory::by_polynomials::<D, N>(record, polynomials),
            None => {
                let systematic = self.systematic(height_sigma);
                trajectory::reconstruct::<D, N>(record, self.jerk, &systematic)
            }
        }
    }

    fn systematic(&self, height_sigma: Option<f64>) -> Systematic {
        match &self.flat {
            Some(kinds) => Systematic::Flat(kinds.clone()),
            None => {
                let prior = Prior {
                    sigma: self.bias_sigma.clone(),
                    share: self.drift_share.clone(),
                    time: self.drift_time.clone(),
                    deviation: self.deviation.clone(),
                    surveyed: Vec::new(),
                };
                let k = self.bias_sigma.len() / (KINDS + 1);
                Systematic::Lasting(match height_sigma {
                    Some(sigma) => prior.with_heights(sigma, k),
                    None => prior,
                })
            }
        }
    }
}

impl<'py> Reconstructed<'py> {
    fn failed(why: &'static str, numbers: Vec<usize>) -> Self {
        Self { failure: Some((why, numbers)), ..Self::default() }
    }

    fn new(py: Python<'py>, mut found: Trajectory, n: usize, d: usize, k: usize) -> PyResult<Self> {
        let (states, last) = (3 * d, KINDS * k);
        let mut height = None;
        if found.residual.len() > n * last {
            let residual = split_off(&mut found.residual, last);
            let outlier = split_off(&mut found.outlier, last);
            split_off(&mut found.fixes.residual, last);
            split_off(&mut found.fixes.outlier, last);
            // with a single position, nothing lasting is estimated
            let of = |own: &mut LastingErrors| (own.value.remove(last), own.sigma.remove(last));
            let (value, sigma) = found.bias.as_mut().map_or((0.0, f64::NAN), of);
            height = Some((array(py, &[n], residual)?, array(py, &[n], outlier)?, value, sigma));
        }
        let fixes = found.fixes;
        let columns = fix_columns(py, &[n], &fixes.fixes)?;
        let located = (
            array(py, &[n, d], fixes.position)?,
            array(py, &[n, d, d], fixes.covariance)?,
            array(py, &[n, KINDS, k], fixes.residual)?,
            array(py, &[n, KINDS, k], fixes.outlier)?,
            columns,
        );
        let smoothed = found.smoothed.map(|smoothed| -> PyResult<Smoothed<'py>> {
            let (summary, fit) = (smoothed.summary, smoothed.fit);
            Ok((
                array(py, &[n, states, states], smoothed.covariance)?,
                array(py, &[n, d], smoothed.innovation)?,
                summary.log_likelihood,
                summary.count,
                [fit.motion.jerk, fit.sigma(), fit.motion.acceleration],
            ))
        });
        Ok(Self {
            failure: None,
            is_behind: found.is_behind,
            may_cross: found.may_cross,
            is_doubtful: found.is_doubtful,
            relative_range_sigma: found.relative_range_sigma,
            height,
            image: found.image.map(|image| array(py, &[n, d], image)).transpose()?,
            mean: Some(array(py, &[n, states], found.mean)?),
            covariance: Some(array(py, &[n, states, states], found.covariance)?),
            smoothed: smoothed.transpose()?,
            fixes: Some(located),
            outlier: Some(array(py, &[n, KINDS, k], found.outlier)?),
            residual: Some(array(py, &[n, KINDS, k], found.residual)?),
            bias: found.bias.map(|own| (own.value, own.sigma, own.share, own.time, own.is_told)),
        })
    }
}

/// Removes the last number of each row, of which the others are `width` numbers, and returns these.
fn split_off<T: Copy>(rows: &mut Vec<T>, width: usize) -> Vec<T> {
    let last = rows.iter().skip(width).step_by(width + 1).copied().collect();
    let mut at = 0;
    rows.retain(|_| {
        at += 1;
        at % (width + 1) != 0
    });
    last
}
