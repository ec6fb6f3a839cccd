//! Series of plots of several radars.

use super::{POSITIVE, VARIANCE, require_room, rule};
use crate::arrays::{Input, Output, Rows, Threads, value_error};
use crate::kalman::{Model, check_period, singer};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use tertia::fusion::{Beliefs, Centre, RadarReport, Rule, series_biases as of_series};
use tertia::interrupt::poll;
use tertia::kalman::{Filter, Innovation, PerStep, Series, Singer, State, Transition, wrapped};

/// Cost of a step for one radar, which determines the number of threads.
const FUSE_NS: f64 = 300.0;
/// Cost of a step for one radar with the rule that follows hypotheses.
const ROBUST_NS: f64 = 500.0;

/// Series of several radars (..., K, steps). `variance` has one or K rows, each with one or all steps;
/// `initial` has one or K states (mean, then covariance row by row). `variance`, `dt` and `initial` may
/// have a single element for the whole batch.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Batch<'py> {
    z: Input<'py>,
    variance: Input<'py>,
    dt: Input<'py>,
    initial: Option<Input<'py>>,
    model: Model,
    period: Option<f64>,
    method: String,
    /// Whether the rule of the paper treats a radar without a plot as printed.
    printed: bool,
    forgetting_factor: f64,
    threshold: f64,
    outlier_gate: f64,
    change_probability: f64,
}

/// Parameters with which every row is fused.
struct Task<'a> {
    variance: Rows<'a>,
    dt: Rows<'a>,
    initial: Option<Rows<'a>>,
    model: Singer,
    period: Option<f64>,
    rule: Rule,
    beliefs: Beliefs,
    /// 1 if all radars share a variance, otherwise the number of radars.
    variance_rows: usize,
    radars: usize,
    steps: usize,
}

/// Places for the results of a row.
struct Results<'a> {
    mean: &'a mut [f64],
    covariance: &'a mut [f64],
    weight: &'a mut [f64],
    noise: &'a mut [f64],
    innovation: &'a mut [f64],
    variance: &'a mut [f64],
    outlier: &'a mut [bool],
    repeated: &'a mut [bool],
}

/// Buffers of a thread.
#[derive(Default)]
struct Buffers {
    transitions: Vec<Transition>,
    z: Vec<f64>,
    r: Vec<f64>,
    reports: Vec<RadarReport>,
}

impl Task<'_> {
    fn filters(&self, row: usize) -> tertia::Result<Vec<Filter>> {
        let Some(initial) = &self.initial else {
            let filter = Filter::new(self.model.acceleration_variance(), self.period);
            return Ok(vec![filter; self.radars]);
        };
        let (states, _) = initial.shared(row).as_chunks::<12>();
        let filter = |numbers: &[f64; 12]| {
            let (rows, _) = numbers.as_chunks::<3>();
            let state = State::try_new(rows[0], &[rows[1], rows[2], rows[3]])?;
            Ok(Filter::from_state(state, self.period))
        };
        if let [common] = states {
            return Ok(vec![filter(common)?; self.radars]);
        }
        let of_radar = |(radar, numbers)| filter(numbers).map_err(|error| error.within(radar));
        states.iter().enumerate().map(of_radar).collect()
    }

    /// Returns the row of the variances that belongs to a radar.
    fn variance_row(&self, radar: usize) -> usize {
        if self.variance_rows == 1 { 0 } else { radar }
    }

    /// Converts an error about a radar's series, with the index that the caller knows.
    fn of_radar(&self, radar: usize, error: tertia::Error) -> tertia::Error {
        match error {
            tertia::Error::InvalidParameter { argument, value, .. } if self.variance_rows > 1 => {
                let index = vec![radar, 0];
                tertia::Error::InvalidElement { argument, index, value, requirement: POSITIVE }
            }
            tertia::Error::InvalidMeasurement { argument: VARIANCE, .. } => {
                error.within(self.variance_row(radar))
            }
            other => other.within(radar),
        }
    }

    fn run(
        &self,
        row: usize,
        plots: &[f64],
        out: &mut Results<'_>,
        buffers: &mut Buffers,
    ) -> tertia::Result<()> {
        let (radars, n) = (self.radars, self.steps);
        let Buffers { transitions, z, r, reports } = buffers;
        let transition = self.model.over_all(self.dt.shared(row), transitions)?;
        let variances = self.variance.shared(row);
        let length = variances.len() / self.variance_rows;
        let variance =
            |radar: usize| match &variances[self.variance_row(radar) * length..][..length] {
                [single] => PerStep::Constant(*single),
                each => PerStep::Each(each),
            };
        for radar in 0..radars {
            Series::try_new(&plots[radar * n..][..n], variance(radar), transition)
                .map_err(|error| self.of_radar(radar, error))?;
        }
        let mut centre = Centre::new(self.filters(row)?, self.rule, self.beliefs, self.period);
        for step in 0..n {
            poll();
            z.clear();
            z.extend((0..radars).map(|radar| plots[radar * n + step]));
            r.clear();
            r.extend((0..radars).map(|radar| variance(radar).at(step)));
            if step > 0 {
                centre.predict(&transition.at(step - 1));
            }
            reports.clear();
            reports.resize(radars, RadarReport::NONE);
            let mut state = centre.update(z, r, reports);
            if let Some(period) = self.period {
                state.mean[0] = wrapped(state.mean[0], period);
            }
            out.mean[3 * step..][..3].copy_from_slice(&state.mean);
            out.covariance[6 * step..][..6].copy_from_slice(&state.covariance);
            for (radar, report) in reports.iter().enumerate() {
                let at = radar * n + step;
                let Innovation { value, variance } = report.innovation;
                out.weight[3 * at..][..3].copy_from_slice(&report.weight);
                (out.noise[at], out.innovation[at]) = (report.noise, value);
                (out.variance[at], out.outlier[at]) = (variance, report.outlier);
                out.repeated[at] = !z[radar].is_nan() && centre.repeats(radar);
            }
        }
        Ok(())
    }
}

/// Fused means (..., steps, 3) and upper triangles of covariances (..., steps, 6); weights
/// (..., K, steps, 3); estimated noise, innovations and their variances (..., K, steps); which
/// plots are outliers, and which of these repeat the plot before.
#[pyfunction]
pub fn fuse_series<'py>(
    py: Python<'py>,
    batch: Batch<'py>,
    n_threads: Threads,
) -> PyResult<([Output<'py>; 6], [Output<'py, bool>; 2])> {
    check_period(batch.period)?;
    let &[.., radars, n] = batch.z.shape() else {
        return Err(PyValueError::new_err("z must be of shape (..., K, steps)"));
    };
    require_room(radars)?;
    let (initial, variance) = (batch.initial.as_ref(), batch.variance.shape());
    let task = Task {
        variance: batch.variance.blocks(VARIANCE, 2)?,
        dt: batch.dt.rows("time", 0)?,
        initial: initial.map(|initial| initial.blocks("initial", 2)).transpose()?,
        model: singer(batch.model)?,
        period: batch.period,
        rule: match rule(&batch.method)? {
            Rule::Paper if batch.printed => Rule::PaperPrinted,
            other => other,
        },
        beliefs: Beliefs::try_new(
            batch.forgetting_factor,
            batch.threshold,
            batch.outlier_gate,
            batch.change_probability,
        )
        .map_err(value_error)?,
        variance_rows: variance[variance.len() - 2],
        radars,
        steps: n,
    };
    let rows = batch.z.blocks("z", 2)?;
    let new = |tail: &[usize]| Output::new(py, rows.batch(), tail);
    let (mut mean, mut covariance) = (new(&[n, 3])?, new(&[n, 6])?);
    let (mut weight, mut noise) = (new(&[radars, n, 3])?, rows.output(py)?);
    let (mut innovation, mut spread) = (rows.output(py)?, rows.output(py)?);
    let (mut outlier, mut repeated) = (rows.output(py)?, rows.output(py)?);
    let outputs = mean
        .rows()?
        .zip(covariance.rows()?)
        .zip(weight.rows()?)
        .zip(noise.rows()?)
        .zip(innovation.rows()?)
        .zip(spread.rows()?)
        .zip(outlier.rows()?.zip(repeated.rows()?))
        .map(|((((((mean, covariance), weight), noise), innovation), variance), plots)| {
            let (outlier, repeated) = plots;
            Results { mean, covariance, weight, noise, innovation, variance, outlier, repeated }
        });
    let of_step = if task.rule == Rule::Robust { ROBUST_NS } else { FUSE_NS };
    let cost = of_step * rows.size();
    rows.each(py, cost, n_threads, outputs, Buffers::default, |buffers, (row, z), mut out| {
        task.run(row, z, &mut out, buffers)
    })?;
    Ok(([mean, covariance, weight, noise, innovation, spread], [outlier, repeated]))
}

/// Constant errors of radars (..., K), their standard deviations (..., K), and the covariance that they add
/// to each step (..., steps, 6). They are estimated from unwrapped plots (..., K, steps) with variances
/// of the same shape; `prior` (K) contains the prior standard deviations.
#[pyfunction]
pub fn series_biases<'py>(
    py: Python<'py>,
    arrays: (Input<'py>, Input<'py>, Input<'py>),
    prior: Input<'py>,
    model: Model,
    n_threads: Threads,
) -> PyResult<[Output<'py>; 3]> {
    let (z, variance, dt) = &arrays;
    let &[.., radars, n] = z.shape() else {
        return Err(PyValueError::new_err("z must be of shape (..., K, steps)"));
    };
    let (model, prior) = (singer(model)?, prior.numbers("bias_sigma")?);
    let (rows, noise, dt) = (z.blocks("z", 2)?, variance.blocks(VARIANCE, 2)?, dt.rows("time", 0)?);
    let new = |tail: &[usize]| Output::new(py, rows.batch(), tail);
    let (mut value, mut sigma, mut covariance) = (new(&[radars])?, new(&[radars])?, new(&[n, 6])?);
    let outputs = value.rows()?.zip(sigma.rows()?).zip(covariance.rows()?);
    let cost = FUSE_NS * rows.size();
    rows.each(
        py,
        cost,
        n_threads,
        outputs,
        Vec::new,
        |buffer, (row, z), ((value, sigma), each)| {
            let transition = model.over_all(dt.shared(row), buffer)?;
            let found = of_series(z, noise.shared(row), &prior, transition, &model);
            value.copy_from_slice(&found.value);
            sigma.copy_from_slice(&found.sigma);
            each.as_chunks_mut::<6>().0.copy_from_slice(&found.covariance);
            Ok(())
        },
    )?;
    Ok([value, sigma, covariance])
}
