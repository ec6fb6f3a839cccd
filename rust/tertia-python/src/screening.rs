//! Bindings of `tertia::screening`.

use crate::arrays::{
    Array, Input, Integers, Output, Threads, array, choice, columns, for_each_item, repeated,
    unknown, value_error,
};
use numpy::PyReadonlyArray1;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use tertia::Moments;
use tertia::missing::Present;
use tertia::screening::{
    self, BurstRule, BurstWorkspace, Direction, KSigmaRule, LeaveOneOutRule, MovingRule,
    MovingWorkspace, Replacement, Statistics, Summary, Test,
};

/// Cost of the streaming kernels per measurement. This and the following costs determine the number of
/// threads.
const STREAM_NS: f64 = 1.0;
/// Cost of the kernels that write a cleaned sample, per measurement.
const SCREEN_NS: f64 = 3.0;
/// Cost of the detection of bursts, per measurement, and per measurement and length of a burst.
const BURST_NS: f64 = 60.0;
const LENGTH_NS: f64 = 1.0;
/// Cost of a moving polynomial, per measurement and tap.
const MOVING_NS: f64 = 15.0;
/// Cost of an incomplete beta function.
const TAIL_NS: f64 = 500.0;
/// Cost of a sine, a cosine and a median.
const ANGLE_NS: f64 = 40.0;

type Two<'py> = (Output<'py>, Output<'py>);
type Screened<'py> = (Output<'py, bool>, Output<'py>, Array<'py>, Array<'py>, Array<'py>);

/// Leave-one-out mean and variance of every measurement.
#[pyfunction]
pub fn leave_one_out_statistics<'py>(
    py: Python<'py>,
    y: Input<'py>,
    n_threads: Threads,
) -> PyResult<Two<'py>> {
    two_columns(py, &y, STREAM_NS, n_threads, screening::statistics)
}

/// Computes two numbers for every measurement.
fn two_columns<'py>(
    py: Python<'py>,
    y: &Input<'py>,
    nanoseconds: f64,
    n_threads: Threads,
    kernel: impl Fn(&[f64], &mut [f64], &mut [f64]) -> tertia::Result<()> + Sync + Send,
) -> PyResult<Two<'py>> {
    let rows = y.samples("y", 3)?;
    let (mut first, mut second) = (rows.output(py)?, rows.output(py)?);
    let outputs = first.rows()?.zip(second.rows()?);
    let cost = nanoseconds * rows.size();
    rows.each(py, cost, n_threads, outputs, || (), |(), (_, y), (a, b)| kernel(y, a, b))?;
    Ok((first, second))
}

/// Mask of the leave-one-out rule with frozen statistics.
#[pyfunction]
pub fn leave_one_out_mask<'py>(
    py: Python<'py>,
    y: Input<'py>,
    k: f64,
    n_threads: Threads,
) -> PyResult<Output<'py, bool>> {
    // also checks k if there are no rows
    LeaveOneOutRule::try_new(k, Statistics::Frozen, Direction::Forward, true, 1)
        .map_err(value_error)?;
    let rows = y.samples("y", 3)?;
    let mut outlier = rows.output(py)?;
    let cost = STREAM_NS * rows.size();
    let mark =
        |(): &mut (), (_, y): (usize, &[f64]), flags: &mut [bool]| screening::mask(y, k, flags);
    rows.each(py, cost, n_threads, outlier.rows()?, || (), mark)?;
    Ok(outlier)
}

/// Screens by the leave-one-out rule.
#[pyfunction]
#[allow(clippy::too_many_arguments)] // the Python signature
pub fn leave_one_out<'py>(
    py: Python<'py>,
    y: Input<'py>,
    k: f64,
    statistics: &str,
    direction: &str,
    replace: bool,
    passes: usize,
    omit: bool,
    n_threads: Threads,
) -> PyResult<Screened<'py>> {
    let choices = [("sequential", Statistics::Sequential), ("frozen", Statistics::Frozen)];
    let statistics = choice("statistics", statistics, &choices)?;
    let choices = [("forward", Direction::Forward), ("backward", Direction::Backward)];
    let direction = choice("direction", direction, &choices)?;
    let rule = LeaveOneOutRule::try_new(k, statistics, direction, replace, passes);
    let rule = rule.map_err(value_error)?;
    screen(py, &y, (3, SCREEN_NS), omit, n_threads, Vec::new, |y, outlier, cleaned, scratch| {
        rule.screen(y, outlier, cleaned, scratch)
    })
}

/// Screens by the k-sigma rule.
#[pyfunction]
pub fn k_sigma<'py>(
    py: Python<'py>,
    y: Input<'py>,
    k: f64,
    replace: Option<&str>,
    omit: bool,
    n_threads: Threads,
) -> PyResult<Screened<'py>> {
    let replacement = match replace {
        Some("neighbours") => Replacement::Neighbours,
        Some("mean") => Replacement::Mean,
        None => Replacement::Excluded,
        Some(other) => return Err(unknown("replace", other, "'neighbours', 'mean' or None")),
    };
    let rule = KSigmaRule::try_new(k, replacement).map_err(value_error)?;
    screen(py, &y, (2, SCREEN_NS), omit, n_threads, Vec::new, |y, outlier, cleaned, scratch| {
        rule.screen(y, outlier, cleaned, scratch)
    })
}

/// Detects points and bursts.
#[pyfunction]
#[allow(clippy::too_many_arguments)] // the Python signature
pub fn bursts<'py>(
    py: Python<'py>,
    y: Input<'py>,
    point_penalty: f64,
    burst_penalty: f64,
    min_burst: usize,
    max_burst: usize,
    correlation: f64,
    rounding: f64,
    omit: bool,
    n_threads: Threads,
) -> PyResult<Screened<'py>> {
    let lengths = (min_burst, max_burst);
    let rule = BurstRule::try_new(point_penalty, burst_penalty, lengths, correlation, rounding);
    let rule = rule.map_err(value_error)?;
    let cost = BURST_NS + LENGTH_NS * max_burst as f64;
    let new = BurstWorkspace::default;
    screen(py, &y, (3, cost), omit, n_threads, new, |y, outlier, cleaned, work| {
        rule.screen(y, outlier, cleaned, work)
    })
}

/// Screens by a moving polynomial. `time` may have one row for all.
#[pyfunction]
#[allow(clippy::too_many_arguments)] // the Python signature
pub fn moving_polynomial<'py>(
    py: Python<'py>,
    y: Input<'py>,
    time: Input<'py>,
    window: usize,
    degree: usize,
    k: f64,
    period: Option<f64>,
    n_threads: Threads,
) -> PyResult<Screened<'py>> {
    let rule = MovingRule::try_new(window, degree, k, period).map_err(value_error)?;
    let time = time.rows("time", 0)?;
    let cost = MOVING_NS * window as f64;
    let new = MovingWorkspace::default;
    screen_rows(py, &y, (0, cost), n_threads, new, |row, y, outlier, cleaned, work| {
        rule.screen(y, time.shared(row), outlier, cleaned, work)
    })
}

/// Buffers for samples with missing measurements.
#[derive(Default)]
pub struct Gaps {
    pub present: Present,
    pub outlier: Vec<bool>,
    pub cleaned: Vec<f64>,
}

impl Gaps {
    /// Collects the measurements that are present, and makes room for the results.
    pub fn collect(&mut self, y: &[f64]) {
        self.present.collect(y);
        let n = self.present.values().len();
        self.outlier.clear();
        self.outlier.resize(n, false);
        self.cleaned.clear();
        self.cleaned.resize(n, 0.0);
    }
}

/// Runs a screening kernel, which needs a minimum of measurements and costs some time for each, over all rows, or
/// over their measurements that are present.
fn screen<'py, S>(
    py: Python<'py>,
    y: &Input<'py>,
    (minimum, nanoseconds): (usize, f64),
    omit: bool,
    n_threads: Threads,
    state: impl Fn() -> S + Sync + Send,
    kernel: impl Fn(&[f64], &mut [bool], &mut [f64], &mut S) -> tertia::Result<Summary> + Sync + Send,
) -> PyResult<Screened<'py>> {
    if !omit {
        let each = (minimum, nanoseconds);
        return screen_rows(py, y, each, n_threads, state, |_, y, outlier, cleaned, state| {
            kernel(y, outlier, cleaned, state)
        });
    }
    let new = || (state(), Gaps::default());
    screen_rows(py, y, (0, nanoseconds), n_threads, new, |_, y, flags, kept, (state, gaps)| {
        gaps.collect(y);
        let Gaps { present, outlier, cleaned } = gaps;
        let found = kernel(present.values(), outlier, cleaned, state)
            .map_err(|error| present.locate(error))?;
        present.scatter(outlier, false, flags);
        present.scatter(cleaned, f64::NAN, kept);
        Ok(found)
    })
}

/// Runs a screening kernel that also gets the index of each row.
fn screen_rows<'py, S>(
    py: Python<'py>,
    y: &Input<'py>,
    (minimum, nanoseconds): (usize, f64),
    n_threads: Threads,
    state: impl Fn() -> S + Sync + Send,
    kernel: impl Fn(usize, &[f64], &mut [bool], &mut [f64], &mut S) -> tertia::Result<Summary>
    + Sync
    + Send,
) -> PyResult<Screened<'py>> {
    let rows = y.samples("y", minimum)?;
    let (mut outlier, mut cleaned) = (rows.output(py)?, rows.output(py)?);
    let none = Summary { mean: 0.0, variance: 0.0, threshold: 0.0 };
    let mut summaries = repeated(none, rows.count())?;
    let outputs = outlier.rows()?.zip(cleaned.rows()?).zip(&mut summaries);
    let cost = nanoseconds * rows.size();
    rows.each(py, cost, n_threads, outputs, state, |state, (row, y), ((flags, kept), out)| {
        *out = kernel(row, y, flags, kept, state)?;
        Ok(())
    })?;
    let of: [fn(&Summary) -> f64; 3] = [|s| s.mean, |s| s.variance, |s| s.threshold];
    let [mean, variance, threshold] = columns(py, rows.batch(), &summaries, of)?;
    Ok((outlier, cleaned, mean, variance, threshold))
}

/// Angles unwrapped about their circular median.
#[pyfunction]
pub fn unwrap_about_median<'py>(
    py: Python<'py>,
    theta: Input<'py>,
    period: f64,
    n_threads: Threads,
) -> PyResult<Output<'py>> {
    // also checks the period if there are no rows
    screening::require_period(period).map_err(value_error)?;
    let rows = theta.rows("theta", 1)?;
    let mut unwrapped = rows.output(py)?;
    let cost = ANGLE_NS * rows.size();
    rows.each(py, cost, n_threads, unwrapped.rows()?, Vec::new, |scratch, (_, theta), out| {
        screening::unwrap_about_median(theta, period, out, scratch)
    })?;
    Ok(unwrapped)
}

/// Tests `x[i]` against the others `y[row[i]]` with known sigma.
#[pyfunction]
pub fn z_test<'py>(
    py: Python<'py>,
    x: PyReadonlyArray1<'py, f64>,
    row: PyReadonlyArray1<'py, i64>,
    y: Input<'py>,
    sigma: PyReadonlyArray1<'py, f64>,
) -> PyResult<(Array<'py>, Array<'py>)> {
    let sigma = sigma.as_array().to_vec();
    one_by_one(py, &x, &row, &y, 1, |i, x, others| screening::z_test(x, others, sigma[i]))
}

/// Tests `x[i]` against the others `y[row[i]]` with unknown sigma.
#[pyfunction]
pub fn t_test<'py>(
    py: Python<'py>,
    x: PyReadonlyArray1<'py, f64>,
    row: PyReadonlyArray1<'py, i64>,
    y: Input<'py>,
) -> PyResult<(Array<'py>, Array<'py>)> {
    one_by_one(py, &x, &row, &y, 2, |_, x, others| screening::t_test(x, others))
}

/// Computes the moments of every row of y once, and then a test for every x.
fn one_by_one<'py>(
    py: Python<'py>,
    x: &PyReadonlyArray1<'py, f64>,
    row: &PyReadonlyArray1<'py, i64>,
    y: &Input<'py>,
    minimum: usize,
    test: impl Fn(usize, f64, &Moments) -> tertia::Result<screening::OutlierTest> + Sync + Send,
) -> PyResult<(Array<'py>, Array<'py>)> {
    let rows = y.samples("y", minimum)?;
    let (x, row) = (x.as_array().to_vec(), row.as_array().to_vec());
    let others = rows.results(py, STREAM_NS * rows.size(), None, None, |_, y, out| {
        *out = Some(Moments::of("y", y)?);
        Ok(())
    })?;
    let mut results = repeated((0.0, 0.0), x.len())?;
    let cost = TAIL_NS * x.len() as f64;
    let items = x.iter().zip(&row).enumerate().zip(&mut results);
    for_each_item(py, cost, None, items, |((i, (&x, &row)), out)| {
        if let Some(others) = &others[row as usize] {
            let result = test(i, x, others)?;
            *out = (result.statistic, result.pvalue);
        }
        Ok(())
    })?;
    Ok(columns(py, &[x.len()], &results, [|r| r.0, |r| r.1])?.into())
}

type Extreme<'py> = (Integers<'py>, Array<'py>, Array<'py>);

/// Index, statistic and p-value of one test per row.
fn extreme<'py>(
    py: Python<'py>,
    y: &Input<'py>,
    name: &'static str,
    minimum: usize,
    test: impl Fn(&[f64]) -> tertia::Result<(usize, screening::OutlierTest)> + Sync + Send,
) -> PyResult<Extreme<'py>> {
    let rows = y.samples(name, minimum)?;
    let results = rows.results(py, STREAM_NS * rows.size(), None, (0, 0.0, 0.0), |_, y, out| {
        let (index, result) = test(y)?;
        *out = (index as i64, result.statistic, result.pvalue);
        Ok(())
    })?;
    let index = array(py, rows.batch(), results.iter().map(|r| r.0))?;
    let [statistic, pvalue] = columns(py, rows.batch(), &results, [|r| r.1, |r| r.2])?;
    Ok((index, statistic, pvalue))
}

/// Thompson's tau of every measurement and its p-value.
#[pyfunction]
pub fn thompson_tau<'py>(py: Python<'py>, y: Input<'py>) -> PyResult<Two<'py>> {
    two_columns(py, &y, TAIL_NS, None, screening::thompson_tau)
}

/// Grubbs' test of every row.
#[pyfunction]
pub fn grubbs<'py>(py: Python<'py>, y: Input<'py>) -> PyResult<Extreme<'py>> {
    extreme(py, &y, "y", 3, screening::grubbs)
}

/// Cochran's test of every row of variances.
#[pyfunction]
pub fn cochran<'py>(
    py: Python<'py>,
    variances: Input<'py>,
    degrees_of_freedom: f64,
) -> PyResult<Extreme<'py>> {
    extreme(py, &variances, "variances", 2, |d| screening::cochran(d, degrees_of_freedom))
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
        ("leave-one-out", None) => Ok(Test::LeaveOneOut),
        ("z-test", None) => Ok(Test::ZTest),
        ("t-test", None) => Ok(Test::TTest),
        ("thompson-tau", None) => Ok(Test::ThompsonTau),
        ("grubbs", None) => Ok(Test::Grubbs),
        (other, None) => Err(unknown(
            "test",
            other,
            "'leave-one-out', 'z-test', 't-test', 'thompson-tau', 'grubbs' or 'cochran'",
        )),
    }
}
