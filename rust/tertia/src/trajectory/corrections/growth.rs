//! Kinds of measurements whose standard deviations are far too small.
//!
//! If several kinds are measured, the path follows the kind whose errors are larger than stated, and leaves out
//! many of its measurements. The residuals, also of what was left out, show it at most stations. The path is then
//! estimated again with standard deviations that agree with them.

use crate::base::angle::median;
use crate::sensors::KINDS;
use crate::trajectory::measured::Record;
use crate::trajectory::methods::result::Trajectory;
use crate::trajectory::path::failure::Failure;

/// Usual size of the residuals, in stated standard deviations, from which a kind has larger errors than stated,
/// and from which a kind that is known to has still larger ones. Faults of a third of the measurements look like
/// 1.7.
const LARGER: f64 = 1.8;
const STILL_LARGER: f64 = 1.3;
/// How much larger they are than those of another kind: if all are as large, the errors of all kinds are, and the
/// path is right.
const UNEQUAL: f64 = 1.3;
/// Largest number of times that the path is estimated again.
const AGAIN: usize = 3;
/// Share of outliers from which a kind is wrong, whatever its standard deviation is.
const WRONG: f64 = 0.9;
/// Least number of residuals of a station that are judged.
const FEWEST: usize = 10;
/// Factor from the median size of normal errors to their standard deviation.
const NORMAL: f64 = 1.4826;

/// Reconstructs a path by `solve`, again with larger standard deviations of those kinds that need them.
pub(in crate::trajectory) fn with_larger_errors(
    record: &Record<'_>,
    solve: impl Fn(&Record<'_>) -> Result<Trajectory, Failure>,
) -> Result<Trajectory, Failure> {
    let mut found = solve(record)?;
    let mut growth = [1.0; KINDS];
    if !record.robust || !has_several_kinds(record) {
        return Ok(found);
    }
    for _ in 0..AGAIN {
        let Some(larger) = larger(record, &found, growth) else { break };
        let grown = Grown::of(record, &larger);
        let Ok(again) = solve(&grown.record(record)) else { break };
        // the fixes are those with the stated standard deviations
        (found, growth) = (Trajectory { fixes: found.fixes, ..again }, larger);
    }
    let width = record.width();
    for (at, residual) in found.residual.iter_mut().enumerate() {
        // in units of what was stated
        *residual *= growth.get(record.kind_of(at % width)).copied().unwrap_or(1.0);
    }
    Ok(found)
}

/// A record with other standard deviations.
struct Grown {
    sigmas: Vec<f64>,
    own_sigmas: Option<Vec<f64>>,
}

impl Grown {
    fn of(record: &Record<'_>, growth: &[f64; KINDS]) -> Self {
        let grown = |sigmas: &[f64]| -> Vec<f64> {
            let factor =
                |at: usize| growth.get(record.kind_of(at % record.width())).unwrap_or(&1.0);
            sigmas.iter().enumerate().map(|(at, sigma)| sigma * factor(at)).collect()
        };
        Self { sigmas: grown(record.sigmas), own_sigmas: record.own_sigmas.map(grown) }
    }

    fn record<'a>(&'a self, record: &Record<'a>) -> Record<'a> {
        Record { sigmas: &self.sigmas, own_sigmas: self.own_sigmas.as_deref(), ..*record }
    }
}

fn has_several_kinds(record: &Record<'_>) -> bool {
    let (width, all) = (record.width(), KINDS * record.receivers());
    let is_known = |column: usize| {
        record.values.iter().skip(column).step_by(width).any(|value| !value.is_nan())
    };
    let first = (0..all).find(|column| is_known(*column)).map(|column| record.kind_of(column));
    (0..all).any(|column| Some(record.kind_of(column)) != first && is_known(column))
}

/// Returns the factors of the standard deviations of each kind, if one of them must be larger than `growth`.
fn larger(record: &Record<'_>, found: &Trajectory, growth: [f64; KINDS]) -> Option<[f64; KINDS]> {
    let sizes: [Option<f64>; KINDS] = std::array::from_fn(|kind| size(record, found, kind));
    let least = sizes.iter().flatten().copied().fold(f64::INFINITY, f64::min);
    let mut larger = growth;
    for (factor, size) in larger.iter_mut().zip(sizes) {
        let limit = if *factor > 1.0 { STILL_LARGER } else { LARGER };
        if let Some(size) = size.filter(|size| *size > limit && *size > UNEQUAL * least) {
            *factor *= size;
        }
    }
    (larger != growth).then_some(larger)
}

/// Returns the usual size of the residuals of a kind at the median station, so that a station that is wrong has no
/// effect. None if nearly all measurements of the kind are outliers.
fn size(record: &Record<'_>, found: &Trajectory, kind: usize) -> Option<f64> {
    let (width, stations) = (record.width(), record.receivers());
    let columns = kind * stations..(kind + 1) * stations;
    let is_own = |at: &usize| columns.contains(&(at % width)) && found.residual[*at].is_finite();
    let own = (0..found.residual.len()).filter(is_own);
    let (wrong, right): (Vec<usize>, Vec<usize>) = own.partition(|at| found.outlier[*at]);
    if wrong.len() as f64 > WRONG * (wrong.len() + right.len()) as f64 {
        return None;
    }
    let of = |column: usize| {
        let own = found.residual.iter().skip(column).step_by(width);
        let mut sizes: Vec<f64> = own.filter(|r| r.is_finite()).map(|r| r.abs()).collect();
        (sizes.len() >= FEWEST).then(|| NORMAL * median(&mut sizes))
    };
    let mut sizes: Vec<f64> = columns.clone().filter_map(of).collect();
    sizes.sort_by(f64::total_cmp);
    sizes.get(sizes.len().saturating_sub(1) / 2).copied()
}
