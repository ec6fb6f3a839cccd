//! Bindings of `tertia::bearing`.

use crate::arrays::{Gaps, Output, Samples, array, chunks, repeated, value_error};
use crate::screening::unknown;
use numpy::PyArrayDyn;
use pyo3::prelude::*;
use std::num::NonZero;
use tertia::batch::for_each_row;
use tertia::bearing::{
    BlockOutput, Estimate, Estimator, Method, PaperRule, RobustRule, VarianceTest, Workspace,
};
use tertia::screening::BurstRule;

/// Cost per measurement of the slowest method, for the choice of threads.
const ESTIMATE_NS: f64 = 100.0;

type Array<'py> = Bound<'py, PyArrayDyn<f64>>;
type Blocks<'py> = (Array<'py>, Array<'py>, Array<'py>);
type Estimated<'py> =
    (Array<'py>, Array<'py>, Bound<'py, PyArrayDyn<bool>>, Array<'py>, Option<Blocks<'py>>);

/// The options of the Python function, as they come.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Options {
    method: String,
    period: Option<f64>,
    block_size: usize,
    k: f64,
    variance_test: Option<VarianceTestArgument>,
    significance: f64,
    point_penalty: f64,
    burst_penalty: f64,
    min_burst: usize,
    max_burst: usize,
    correlation: f64,
    rounding: f64,
}

#[derive(FromPyObject)]
pub enum VarianceTestArgument {
    Name(String),
    Factor(f64),
}

impl Options {
    fn estimator(self) -> PyResult<Estimator> {
        let variance_test = match &self.variance_test {
            Some(VarianceTestArgument::Name(name)) if name == "cochran" => {
                VarianceTest::Cochran(self.significance)
            }
            Some(VarianceTestArgument::Name(name)) if name == "student" => {
                VarianceTest::Student(self.significance)
            }
            Some(VarianceTestArgument::Factor(k2)) => VarianceTest::Factor(*k2),
            None => VarianceTest::Off,
            Some(VarianceTestArgument::Name(other)) => {
                return Err(unknown(
                    "variance_test",
                    other,
                    "'cochran', 'student', a number or None",
                ));
            }
        };
        let rule = PaperRule { k: self.k, block_size: self.block_size, variance_test };
        let method = match self.method.as_str() {
            "mean" => Method::Mean,
            "k-sigma" => Method::KSigma(self.k),
            "paper" => Method::Paper(rule),
            "corrected" => Method::Corrected(rule, self.significance),
            "robust" => Method::Robust(self.robust()?),
            other => {
                let choices = "'robust', 'corrected', 'paper', 'k-sigma' or 'mean'";
                return Err(unknown("method", other, choices));
            }
        };
        Estimator::try_new(method, self.period, self.correlation).map_err(value_error)
    }

    fn robust(&self) -> PyResult<RobustRule> {
        let bursts = BurstRule::try_new(
            self.point_penalty,
            self.burst_penalty,
            (self.min_burst, self.max_burst),
            self.correlation,
            self.rounding,
        );
        Ok(RobustRule { bursts: bursts.map_err(value_error)?, block_size: self.block_size })
    }
}

/// Bearing, sigma, mask, polarity and blocks of every row.
#[pyfunction]
pub fn estimate_bearing<'py>(
    py: Python<'py>,
    theta: &Bound<'py, PyAny>,
    options: Options,
    omit: bool,
    n_threads: Option<NonZero<usize>>,
) -> PyResult<Estimated<'py>> {
    let samples = Samples::extract(theta, "theta")?;
    let estimator = options.estimator()?;
    let rows = samples.rows(if omit { 0 } else { estimator.min_count() })?;
    let (n, count) = (rows.len(), rows.count());
    let blocks = estimator.blocks(n);
    let mut outlier = Output::new(py, rows.shape)?;
    let outliers = outlier.values()?;
    let mut estimates = repeated(Estimate { value: 0.0, sigma: 0.0, polarity: 0.0 }, count)?;
    let mut mean = repeated(0.0, blocks * count)?;
    let mut variance = repeated(0.0, blocks * count)?;
    let mut weight = repeated(0.0, blocks * count)?;
    let cost = ESTIMATE_NS * (n * count) as f64;
    py.detach(|| {
        let columns = chunks(&mut mean, blocks, count)
            .zip(chunks(&mut variance, blocks, count))
            .zip(chunks(&mut weight, blocks, count));
        let outputs = chunks(outliers, n, count).zip(columns).zip(&mut estimates);
        let new = || (Workspace::default(), Gaps::default());
        for_each_row(rows.iter().zip(outputs), cost, n_threads, new, |(workspace, gaps), item| {
            let (theta, ((flags, ((mean, variance), weight)), out)) = item;
            let mut blocks = BlockOutput { mean, variance, weight };
            if omit {
                gaps.collect(theta);
                let Gaps { present, outlier, .. } = gaps;
                *out = estimator
                    .estimate(present.values(), outlier, &mut blocks, workspace)
                    .map_err(|error| present.locate(error))?;
                present.scatter(outlier, false, flags);
            } else {
                *out = estimator.estimate(theta, flags, &mut blocks, workspace)?;
            }
            Ok(())
        })
    })
    .map_err(|failure| rows.error(failure))?;
    let column =
        |f: fn(&Estimate) -> f64| array(py, rows.batch(), estimates.iter().map(f).collect());
    let shape = [rows.batch(), &[blocks]].concat();
    let blocks = match blocks {
        0 => None,
        _ => Some((
            array(py, &shape, mean)?,
            array(py, &shape, variance)?,
            array(py, &shape, weight)?,
        )),
    };
    Ok((
        column(|e| e.value)?,
        column(|e| e.sigma)?,
        outlier.into_array(),
        column(|e| e.polarity)?,
        blocks,
    ))
}
