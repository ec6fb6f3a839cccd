//! Bindings of `tertia::bearing`.

use crate::arrays::{Array, Input, Output, Threads, columns, repeated, unknown, value_error};
use crate::screening::Gaps;
use pyo3::prelude::*;
use std::collections::HashMap;
use tertia::bearing::{
    BlockOutput, Estimate, Estimator, Known, Method, PaperRule, RobustRule, VarianceTest, Workspace,
};

/// Cost per measurement of the slowest method, which determines the number of threads.
const ESTIMATE_NS: f64 = 1000.0;
/// Cost of the effects of groups per record.
const GROUPS_NS: f64 = 1e6;

type Blocks<'py> = (Output<'py>, Output<'py>, Output<'py>);
type Estimated<'py> = ([Array<'py>; 8], Output<'py, bool>, Option<Blocks<'py>>);

/// The options of the Python function, unchecked.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Options {
    method: String,
    period: Option<f64>,
    block_size: usize,
    k: f64,
    variance_test: Option<VarianceTestArgument>,
    significance: f64,
    correlation: Option<f64>,
    rounding: f64,
    bias_sigma: Option<f64>,
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
            "robust" => {
                Method::Robust(RobustRule { block_size: self.block_size, rounding: self.rounding })
            }
            other => {
                let choices = "'robust', 'corrected', 'paper', 'k-sigma' or 'mean'";
                return Err(unknown("method", other, choices));
            }
        };
        Estimator::try_new(method, self.period, self.correlation).map_err(value_error)
    }
}

/// Results, mask and blocks of every row. The results are value, sigma, polarity, p-value, correlation,
/// effective number, sigma of the systematic errors and noise factor. `groups` are numbered from 0 in
/// each row.
#[pyfunction]
pub fn estimate_bearing<'py>(
    py: Python<'py>,
    theta: Input<'py>,
    sigma: Option<Input<'py>>,
    groups: Option<Input<'py>>,
    options: Options,
    omit: bool,
    n_threads: Threads,
) -> PyResult<Estimated<'py>> {
    let bias_sigma = options.bias_sigma;
    let estimator = options.estimator()?;
    let rows =
        theta.samples("theta", if omit { 0 } else { estimator.min_count(sigma.is_some()) })?;
    let stated = sigma.as_ref().map(|s| s.rows("sigma", 0)).transpose()?;
    let labels = groups.as_ref().map(|g| g.rows("groups", 0)).transpose()?;
    let blocks = estimator.blocks(rows.len());
    let mut outlier = rows.output(py)?;
    let mut estimates = repeated(Estimate::default(), rows.count())?;
    let of_blocks = || Output::new(py, rows.batch(), &[blocks]);
    let (mut mean, mut variance, mut weight) = (of_blocks()?, of_blocks()?, of_blocks()?);
    let block_outputs = mean.rows()?.zip(variance.rows()?).zip(weight.rows()?);
    let outputs = outlier.rows()?.zip(block_outputs).zip(&mut estimates);
    let new = || (Workspace::default(), Gaps::default(), Vec::new(), Vec::new());
    let of_groups = if labels.is_some() { GROUPS_NS * rows.count() as f64 } else { 0.0 };
    let cost = ESTIMATE_NS * rows.size() + of_groups;
    rows.each(py, cost, n_threads, outputs, new, |state, (row, theta), out| {
        let (workspace, gaps, kept, noise) = state;
        let ((flags, ((mean, variance), weight)), out) = out;
        let mut blocks = BlockOutput { mean, variance, weight };
        let groups = labels.as_ref().map(|labels| labels.shared(row));
        let sigma = stated.as_ref().map(|stated| stated.shared(row));
        if omit {
            gaps.collect(theta);
            let Gaps { present, outlier, .. } = gaps;
            let groups = groups.map(|groups| numbered(groups, theta, kept));
            let sigma = sigma.map(|sigma| of_present(sigma, theta, noise));
            let known = Known { sigma, groups, bias_sigma };
            *out = estimator
                .estimate(present.values(), known, outlier, &mut blocks, workspace)
                .map_err(|error| present.locate(error))?;
            present.scatter(outlier, false, flags);
        } else {
            let known = Known { sigma, groups, bias_sigma };
            *out = estimator.estimate(theta, known, flags, &mut blocks, workspace)?;
        }
        Ok(())
    })?;
    let of: [fn(&Estimate) -> f64; 8] = [
        |e| e.value,
        |e| e.sigma,
        |e| e.polarity,
        |e| e.pvalue,
        |e| e.correlation,
        |e| e.effective_number,
        |e| e.bias_sigma,
        |e| e.noise_factor,
    ];
    let numbers = columns(py, rows.batch(), &estimates, of)?;
    let blocks = (blocks > 0).then_some((mean, variance, weight));
    Ok((numbers, outlier, blocks))
}

/// Returns the elements that belong to measurements that are present.
fn of_present<'a>(each: &[f64], theta: &[f64], kept: &'a mut Vec<f64>) -> &'a [f64] {
    kept.clear();
    kept.extend(each.iter().zip(theta).filter(|(_, theta)| !theta.is_nan()).map(|(v, _)| v));
    kept
}

/// Returns the groups of the measurements that are present, numbered from 0 in the order in which they
/// first appear.
fn numbered<'a>(groups: &[f64], theta: &[f64], numbers: &'a mut Vec<f64>) -> &'a [f64] {
    let mut known = HashMap::new();
    numbers.clear();
    for (group, _) in groups.iter().zip(theta).filter(|(_, theta)| !theta.is_nan()) {
        let next = known.len() as f64;
        numbers.push(*known.entry(*group as u64).or_insert(next));
    }
    numbers
}
