//! Bindings of `tertia::bearing`.

use crate::arrays::{Array, Gaps, Input, Output, Threads, columns, repeated, unknown, value_error};
use pyo3::prelude::*;
use tertia::bearing::{
    BlockOutput, Estimate, Estimator, Method, PaperRule, RobustRule, VarianceTest, Workspace,
};
use tertia::screening::BurstRule;

/// Cost per measurement of the slowest method, for the choice of threads.
const ESTIMATE_NS: f64 = 100.0;

type Blocks<'py> = (Output<'py>, Output<'py>, Output<'py>);
type Estimated<'py> = (Array<'py>, Array<'py>, Output<'py, bool>, Array<'py>, Option<Blocks<'py>>);

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
    theta: Input<'py>,
    options: Options,
    omit: bool,
    n_threads: Threads,
) -> PyResult<Estimated<'py>> {
    let estimator = options.estimator()?;
    let rows = theta.rows("theta", if omit { 0 } else { estimator.min_count() })?;
    let blocks = estimator.blocks(rows.len());
    let mut outlier = rows.output(py)?;
    let none = Estimate { value: 0.0, sigma: 0.0, polarity: 0.0 };
    let mut estimates = repeated(none, rows.count())?;
    let of_blocks = || Output::new(py, rows.batch(), &[blocks]);
    let (mut mean, mut variance, mut weight) = (of_blocks()?, of_blocks()?, of_blocks()?);
    let block_outputs = mean.rows()?.zip(variance.rows()?).zip(weight.rows()?);
    let outputs = outlier.rows()?.zip(block_outputs).zip(&mut estimates);
    let new = || (Workspace::default(), Gaps::default());
    let cost = ESTIMATE_NS * rows.size();
    rows.each(py, cost, n_threads, outputs, new, |(workspace, gaps), (_, theta), out| {
        let ((flags, ((mean, variance), weight)), out) = out;
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
    })?;
    let of: [fn(&Estimate) -> f64; 3] = [|e| e.value, |e| e.sigma, |e| e.polarity];
    let [value, sigma, polarity] = columns(py, rows.batch(), &estimates, of)?;
    let blocks = (blocks > 0).then_some((mean, variance, weight));
    Ok((value, sigma, outlier, polarity, blocks))
}
