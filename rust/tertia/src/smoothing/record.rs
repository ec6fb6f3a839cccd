//! Series over time that local polynomials smooth.

use crate::base::error::{Error, Result, require_each, require_times};
use std::ops::Range;

const VARIANCES: std::ops::RangeInclusive<f64> = 1e-140..=1e140;
const LARGEST: f64 = 1e140;
/// Largest deviation of instants from equal steps, in roundings.
const ROUNDINGS: f64 = 4.0;

/// A series over time.
#[derive(Clone, Copy, Debug)]
pub struct Record<'a> {
    /// Measurements; nan where missing.
    pub y: &'a [f64],
    /// Times of the measurements; none: 0, 1, 2, …
    pub time: Option<&'a [f64]>,
    /// Variances of the measurements: one for each, or one for all.
    pub variance: Option<&'a [f64]>,
}

impl Record<'_> {
    pub(super) fn time(&self, i: usize) -> f64 {
        self.time.map_or(i as f64, |times| times[i])
    }

    pub(super) fn variance(&self, i: usize) -> f64 {
        match self.variance {
            None => 1.0,
            Some([single]) => *single,
            Some(each) => each[i],
        }
    }
}

pub(super) fn require_record(record: &Record<'_>) -> Result<()> {
    let requirement = "a measurement must be a finite number, or nan for none";
    require_each("y", record.y, |y| y.is_nan() || y.abs() <= LARGEST, requirement)?;
    if let Some(times) = record.time {
        require_times(times, LARGEST)?;
    }
    let requirement = "it must be positive, between 1e-140 and 1e140, where there is a measurement";
    for index in 0..record.y.len() {
        let value = record.variance(index);
        if !record.y[index].is_nan() && !VARIANCES.contains(&value) {
            let argument = "variance";
            return Err(Error::InvalidMeasurement { argument, index, value, requirement });
        }
    }
    Ok(())
}

/// Returns the step of times that are equally spaced except for rounding.
pub(super) fn regular_step(record: &Record<'_>) -> Option<f64> {
    let Some(times) = record.time else { return Some(1.0) };
    let (&first, &last) = (times.first()?, times.last()?);
    let step = (last - first) / (times.len() - 1).max(1) as f64;
    let rounding = ROUNDINGS * f64::EPSILON * first.abs().max(last.abs());
    let fits = |(i, t): (usize, &f64)| (t - first - i as f64 * step).abs() <= rounding;
    (step > 0.0 && times.iter().enumerate().all(fits)).then_some(step)
}

/// Returns the ranges of the starts of windows without a gap.
pub(super) fn complete_runs(y: &[f64], window: usize) -> Vec<Range<usize>> {
    let mut runs = Vec::new();
    let mut start = 0;
    let gaps = y.iter().enumerate().filter(|(_, y)| y.is_nan()).map(|(i, _)| i);
    for gap in gaps.chain([y.len()]) {
        if gap >= start + window {
            runs.push(start..gap - window + 1);
        }
        start = gap + 1;
    }
    runs
}
