//! Bindings of `tertia::screening`.

use crate::arrays::{Gaps, Output, Rows, Samples, array, chunks, repeated, value_error};
use numpy::{PyArrayDyn, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::num::NonZero;
use tertia::Moments;
use tertia::batch::for_each_row;
use tertia::screening::{
    self, BurstRule, BurstWorkspace, Direction, KSigmaRule, LeaveOneOutRule, Replacement,
    Statistics, Summary, Test,
};

/// Cost of the streaming kernels per measurement, for the choice of threads.
const STREAM_NS: f64 = 1.0;
/// Cost of the kernels that write a cleaned sample, likewise.
const SCREEN_NS: f64 = 3.0;
/// Cost of the burst detection, likewise.
const BURST_NS: f64 = 60.0;
/// Cost of an incomplete beta function, likewise.
const TAIL_NS: f64 = 500.0;
/// Cost of a sine, a cosine and a median, likewise.
const ANGLE_NS: f64 = 40.0;

type Array<'py> = Bound<'py, PyArrayDyn<f64>>;
type Mask<'py> = Bound<'py, PyArrayDyn<bool>>;
type Screened<'py> = (Mask<'py>, Array<'py>, Array<'py>, Array<'py>, Array<'py>);

/// Leave-one-out mean and variance of every measurement.
#[pyfunction]
pub fn leave_one_out_statistics<'py>(
    py: Python<'py>,
    y: &Bound<'py, PyAny>,
    n_threads: Option<NonZero<usize>>,
) -> PyResult<(Array<'py>, Array<'py>)> {
    two_columns(py, y, STREAM_NS, n_threads, screening::statistics)
}

/// Two numbers for every measurement.
fn two_columns<'py>(
    py: Python<'py>,
    y: &Bound<'py, PyAny>,
    nanoseconds: f64,
    n_threads: Option<NonZero<usize>>,
    kernel: impl Fn(&[f64], &mut [f64], &mut [f64]) -> tertia::Result<()> + Sync,
) -> PyResult<(Array<'py>, Array<'py>)> {
    let samples = Samples::extract(y, "y")?;
    let rows = samples.rows(3)?;
    let (n, count) = (rows.len(), rows.count());
    let (mut first, mut second) = (Output::new(py, rows.shape)?, Output::new(py, rows.shape)?);
    let (a, b) = (first.values()?, second.values()?);
    let cost = nanoseconds * (n * count) as f64;
    let items = rows.iter().zip(chunks(a, n, count).zip(chunks(b, n, count)));
    let work = |(): &mut (), (y, (a, b)): (&[f64], (&mut [f64], &mut [f64]))| kernel(y, a, b);
    py.detach(|| for_each_row(items, cost, n_threads, || (), work))
        .map_err(|failure| rows.error(failure))?;
    Ok((first.into_array(), second.into_array()))
}

/// Mask of the leave-one-out rule with frozen statistics.
#[pyfunction]
pub fn leave_one_out_mask<'py>(
    py: Python<'py>,
    y: &Bound<'py, PyAny>,
    k: f64,
    n_threads: Option<NonZero<usize>>,
) -> PyResult<Mask<'py>> {
    // also where there is no row to find it out
    LeaveOneOutRule::try_new(k, Statistics::Frozen, Direction::Forward, true, 1)
        .map_err(value_error)?;
    let samples = Samples::extract(y, "y")?;
    let rows = samples.rows(3)?;
    let (n, count) = (rows.len(), rows.count());
    let mut outlier = Output::new(py, rows.shape)?;
    let flags = outlier.values()?;
    let cost = STREAM_NS * (n * count) as f64;
    py.detach(|| {
        let work = |(): &mut (), (y, flags): (&[f64], &mut [bool])| screening::mask(y, k, flags);
        let items = rows.iter().zip(chunks(flags, n, count));
        for_each_row(items, cost, n_threads, || (), work)
    })
    .map_err(|failure| rows.error(failure))?;
    Ok(outlier.into_array())
}

/// Screening by the leave-one-out rule.
#[pyfunction]
#[allow(clippy::too_many_arguments)] // the Python signature
pub fn leave_one_out<'py>(
    py: Python<'py>,
    y: &Bound<'py, PyAny>,
    k: f64,
    statistics: &str,
    direction: &str,
    replace: bool,
    passes: usize,
    omit: bool,
    n_threads: Option<NonZero<usize>>,
) -> PyResult<Screened<'py>> {
    let statistics = match statistics {
        "sequential" => Statistics::Sequential,
        "frozen" => Statistics::Frozen,
        other => return Err(unknown("statistics", other, "'sequential' or 'frozen'")),
    };
    let direction = match direction {
        "forward" => Direction::Forward,
        "backward" => Direction::Backward,
        other => return Err(unknown("direction", other, "'forward' or 'backward'")),
    };
    let rule = LeaveOneOutRule::try_new(k, statistics, direction, replace, passes);
    let rule = rule.map_err(value_error)?;
    let kernel = |y: &[f64], outlier: &mut [bool], cleaned: &mut [f64], scratch: &mut Vec<f64>| {
        rule.screen(y, outlier, cleaned, scratch)
    };
    screen(py, y, 3, SCREEN_NS, omit, n_threads, Vec::new, kernel)
}

/// Screening by the k-sigma rule.
#[pyfunction]
pub fn k_sigma<'py>(
    py: Python<'py>,
    y: &Bound<'py, PyAny>,
    k: f64,
    replace: Option<&str>,
    omit: bool,
    n_threads: Option<NonZero<usize>>,
) -> PyResult<Screened<'py>> {
    let replacement = match replace {
        Some("neighbours") => Replacement::Neighbours,
        Some("mean") => Replacement::Mean,
        None => Replacement::Excluded,
        Some(other) => return Err(unknown("replace", other, "'neighbours', 'mean' or None")),
    };
    let rule = KSigmaRule::try_new(k, replacement).map_err(value_error)?;
    let kernel = |y: &[f64], outlier: &mut [bool], cleaned: &mut [f64], scratch: &mut Vec<f64>| {
        rule.screen(y, outlier, cleaned, scratch)
    };
    screen(py, y, 2, SCREEN_NS, omit, n_threads, Vec::new, kernel)
}

/// Detection of points and bursts.
#[pyfunction]
#[allow(clippy::too_many_arguments)] // the Python signature
pub fn bursts<'py>(
    py: Python<'py>,
    y: &Bound<'py, PyAny>,
    point_penalty: f64,
    burst_penalty: f64,
    min_burst: usize,
    max_burst: usize,
    correlation: f64,
    rounding: f64,
    omit: bool,
    n_threads: Option<NonZero<usize>>,
) -> PyResult<Screened<'py>> {
    let lengths = (min_burst, max_burst);
    let rule = BurstRule::try_new(point_penalty, burst_penalty, lengths, correlation, rounding);
    let rule = rule.map_err(value_error)?;
    let kernel = |y: &[f64], outlier: &mut [bool], cleaned: &mut [f64], work: &mut _| {
        rule.screen(y, outlier, cleaned, work)
    };
    screen(py, y, 3, BURST_NS, omit, n_threads, BurstWorkspace::default, kernel)
}

/// Runs a screening kernel over all rows.
#[allow(clippy::too_many_arguments)] // what the three callers have in common
fn screen<'py, S>(
    py: Python<'py>,
    y: &Bound<'py, PyAny>,
    minimum: usize,
    nanoseconds: f64,
    omit: bool,
    n_threads: Option<NonZero<usize>>,
    state: impl Fn() -> S + Sync,
    kernel: impl Fn(&[f64], &mut [bool], &mut [f64], &mut S) -> tertia::Result<Summary> + Sync,
) -> PyResult<Screened<'py>> {
    let samples = Samples::extract(y, "y")?;
    let rows = samples.rows(if omit { 0 } else { minimum })?;
    let (n, count) = (rows.len(), rows.count());
    let mut outlier = Output::new(py, rows.shape)?;
    let mut cleaned = Output::new(py, rows.shape)?;
    let (outliers, cleaneds) = (outlier.values()?, cleaned.values()?);
    let mut summaries = repeated(Summary { mean: 0.0, variance: 0.0, threshold: 0.0 }, count)?;
    let cost = nanoseconds * (n * count) as f64;
    py.detach(|| {
        let outputs = chunks(outliers, n, count).zip(chunks(cleaneds, n, count));
        let items = rows.iter().zip(outputs.zip(&mut summaries));
        let new = || (state(), Gaps::default());
        for_each_row(items, cost, n_threads, new, |(state, gaps), (y, ((flags, kept), out))| {
            if omit {
                gaps.collect(y);
                let Gaps { present, outlier, cleaned } = gaps;
                *out = kernel(present.values(), outlier, cleaned, state)
                    .map_err(|error| present.locate(error))?;
                present.scatter(outlier, false, flags);
                present.scatter(cleaned, f64::NAN, kept);
            } else {
                *out = kernel(y, flags, kept, state)?;
            }
            Ok(())
        })
    })
    .map_err(|failure| rows.error(failure))?;
    let column =
        |f: fn(&Summary) -> f64| array(py, rows.batch(), summaries.iter().map(f).collect());
    Ok((
        outlier.into_array(),
        cleaned.into_array(),
        column(|s| s.mean)?,
        column(|s| s.variance)?,
        column(|s| s.threshold)?,
    ))
}

/// Angles unwrapped about their circular median.
#[pyfunction]
pub fn unwrap_about_median<'py>(
    py: Python<'py>,
    theta: &Bound<'py, PyAny>,
    period: f64,
    n_threads: Option<NonZero<usize>>,
) -> PyResult<Array<'py>> {
    // also where there is no row to find it out
    screening::require_period(period).map_err(value_error)?;
    let samples = Samples::extract(theta, "theta")?;
    let rows = samples.rows(1)?;
    let (n, count) = (rows.len(), rows.count());
    let mut unwrapped = Output::new(py, rows.shape)?;
    let angles = unwrapped.values()?;
    let cost = ANGLE_NS * (n * count) as f64;
    py.detach(|| {
        let items = rows.iter().zip(chunks(angles, n, count));
        for_each_row(items, cost, n_threads, Vec::new, |scratch, (theta, out)| {
            screening::unwrap_about_median(theta, period, out, scratch)
        })
    })
    .map_err(|failure| rows.error(failure))?;
    Ok(unwrapped.into_array())
}

/// Tests of `x[i]` against the others `y[row[i]]`, sigma known.
#[pyfunction]
pub fn z_test<'py>(
    py: Python<'py>,
    x: PyReadonlyArray1<'py, f64>,
    row: PyReadonlyArray1<'py, i64>,
    y: &Bound<'py, PyAny>,
    sigma: PyReadonlyArray1<'py, f64>,
) -> PyResult<(Array<'py>, Array<'py>)> {
    let sigma = sigma.as_array().to_vec();
    one_by_one(py, &x, &row, y, 1, |i, x, others| screening::z_test(x, others, sigma[i]))
}

/// Tests of `x[i]` against the others `y[row[i]]`, sigma unknown.
#[pyfunction]
pub fn t_test<'py>(
    py: Python<'py>,
    x: PyReadonlyArray1<'py, f64>,
    row: PyReadonlyArray1<'py, i64>,
    y: &Bound<'py, PyAny>,
) -> PyResult<(Array<'py>, Array<'py>)> {
    one_by_one(py, &x, &row, y, 2, |_, x, others| screening::t_test(x, others))
}

/// The index of a test, its value and row, and where its statistic and p-value go.
type Job<'a> = ((usize, (&'a f64, &'a i64)), &'a mut (f64, f64));

/// Moments of every row of y, once; then a test for every x.
fn one_by_one<'py>(
    py: Python<'py>,
    x: &PyReadonlyArray1<'py, f64>,
    row: &PyReadonlyArray1<'py, i64>,
    y: &Bound<'py, PyAny>,
    minimum: usize,
    test: impl Fn(usize, f64, &Moments) -> tertia::Result<screening::OutlierTest> + Sync,
) -> PyResult<(Array<'py>, Array<'py>)> {
    let samples = Samples::extract(y, "y")?;
    let rows = samples.rows(minimum)?;
    let (x, row) = (x.as_array().to_vec(), row.as_array().to_vec());
    let moments = |y: &[f64]| Ok(Some(Moments::of("y", y)?));
    let others = per_row(py, &rows, None, moments)?;
    let mut results = repeated((0.0, 0.0), x.len())?;
    let cost = TAIL_NS * x.len() as f64;
    let items = x.iter().zip(&row).enumerate().zip(&mut results);
    let work = |(): &mut (), ((i, (&x, &row)), out): Job<'_>| {
        if let Some(others) = &others[row as usize] {
            let result = test(i, x, others)?;
            *out = (result.statistic, result.pvalue);
        }
        Ok(())
    };
    py.detach(|| for_each_row(items, cost, None, || (), work))
        .map_err(|failure| value_error(failure.error))?;
    Ok((
        array(py, &[x.len()], results.iter().map(|r| r.0).collect())?,
        array(py, &[x.len()], results.iter().map(|r| r.1).collect())?,
    ))
}

/// One result for every row, in the order of the rows.
fn per_row<R: Clone + Send>(
    py: Python<'_>,
    rows: &Rows<'_>,
    empty: R,
    kernel: impl Fn(&[f64]) -> tertia::Result<R> + Sync,
) -> PyResult<Vec<R>> {
    let mut results = repeated(empty, rows.count())?;
    let cost = STREAM_NS * (rows.len() * rows.count()) as f64;
    let items = rows.iter().zip(&mut results);
    let work = |(): &mut (), (y, out): (&[f64], &mut R)| {
        *out = kernel(y)?;
        Ok(())
    };
    py.detach(|| for_each_row(items, cost, None, || (), work))
        .map_err(|failure| rows.error(failure))?;
    Ok(results)
}

type Extreme<'py> = (Bound<'py, PyArrayDyn<i64>>, Array<'py>, Array<'py>);

/// Index, statistic and p-value of one test per row.
fn extreme<'py>(
    py: Python<'py>,
    y: &Bound<'py, PyAny>,
    name: &'static str,
    minimum: usize,
    test: impl Fn(&[f64]) -> tertia::Result<(usize, screening::OutlierTest)> + Sync,
) -> PyResult<Extreme<'py>> {
    let samples = Samples::extract(y, name)?;
    let rows = samples.rows(minimum)?;
    let results = per_row(py, &rows, (0, 0.0, 0.0), |y| {
        let (index, result) = test(y)?;
        Ok((index as i64, result.statistic, result.pvalue))
    })?;
    Ok((
        array(py, rows.batch(), results.iter().map(|r| r.0).collect())?,
        array(py, rows.batch(), results.iter().map(|r| r.1).collect())?,
        array(py, rows.batch(), results.iter().map(|r| r.2).collect())?,
    ))
}

/// Thompson's tau of every measurement and its p-value.
#[pyfunction]
pub fn thompson_tau<'py>(
    py: Python<'py>,
    y: &Bound<'py, PyAny>,
) -> PyResult<(Array<'py>, Array<'py>)> {
    two_columns(py, y, TAIL_NS, None, screening::thompson_tau)
}

/// Grubbs' test of every row.
#[pyfunction]
pub fn grubbs<'py>(py: Python<'py>, y: &Bound<'py, PyAny>) -> PyResult<Extreme<'py>> {
    extreme(py, y, "y", 3, screening::grubbs)
}

/// Cochran's test of every row of variances.
#[pyfunction]
pub fn cochran<'py>(
    py: Python<'py>,
    variances: &Bound<'py, PyAny>,
    degrees_of_freedom: f64,
) -> PyResult<Extreme<'py>> {
    extreme(py, variances, "variances", 2, |d| screening::cochran(d, degrees_of_freedom))
}

/// Threshold of a test.
#[pyfunction]
pub fn critical_value(
    n: usize,
    significance: f64,
    test: &str,
    degrees_of_freedom: Option<f64>,
) -> PyResult<f64> {
    screening::critical_value(n, significance, parse_test(test, degrees_of_freedom)?)
        .map_err(value_error)
}

/// False alarm probability of a test.
#[pyfunction]
pub fn false_alarm_probability(
    k: f64,
    n: usize,
    test: &str,
    degrees_of_freedom: Option<f64>,
) -> PyResult<f64> {
    let test = parse_test(test, degrees_of_freedom)?;
    screening::false_alarm_probability(k, n, test).map_err(value_error)
}

fn parse_test(test: &str, degrees_of_freedom: Option<f64>) -> PyResult<Test> {
    match (test, degrees_of_freedom) {
        ("cochran", Some(degrees)) => Ok(Test::Cochran(degrees)),
        ("cochran", None) => Err(PyValueError::new_err(
            "test='cochran' needs degrees_of_freedom, those of one variance",
        )),
        (_, Some(_)) => {
            Err(PyValueError::new_err("degrees_of_freedom goes with test='cochran' only"))
        }
        ("z-test", None) => Ok(Test::ZTest),
        ("t-test", None) => Ok(Test::TTest),
        ("leave-one-out", None) => Ok(Test::LeaveOneOut),
        ("thompson-tau", None) => Ok(Test::ThompsonTau),
        ("grubbs", None) => Ok(Test::Grubbs),
        (other, None) => Err(unknown(
            "test",
            other,
            "'leave-one-out', 'z-test', 't-test', 'thompson-tau', 'grubbs' or 'cochran'",
        )),
    }
}

/// The error for a word that is not among the choices.
pub fn unknown(argument: &str, value: &str, choices: &str) -> PyErr {
    PyValueError::new_err(format!("{argument} is '{value}'; it must be {choices}"))
}
