//! A station that is wrong for a part of the record, where few measurements are redundant.
//!
//! Measurements are left out one by one. If one station is wrong from some time on, and an instant has only
//! one or two redundant measurements, those of any other station can be left out as well, and the path follows
//! the wrong station wherever that is smoother. The stations are then left out in turn. Therefore paths
//! without each of these stations in that part of the record are compared: the path without the wrong one is
//! smooth where the part begins or ends, and the errors of the wrong station last. The covariance is that of
//! the mixture of the paths, each with the likelihood of the measurements that it uses.

use crate::base::angle::median;
use crate::trajectory::measured::Record;
use crate::trajectory::methods::result::{Trajectory, residuals};
use crate::trajectory::path::failure::Failure;
use std::ops::Range;

/// Least number of instants of the part, and of those without outliers outside it, with which it is compared.
const ENOUGH: usize = 20;
/// Share of the instants of a part that have outliers, and of the outliers of the part that belong to one
/// column alone: then it is clear which one is wrong.
const HALF: f64 = 0.5;
const CLEAR: f64 = 0.9;
/// Share of the outliers of a part from which a column may be the wrong one; the largest number of these.
const SUSPECTED: f64 = 0.02;
const MOST: usize = 6;
/// Fall of ln of the likelihood by an outlier.
const OUTLIER: f64 = 5.0;
/// Share of the instants of the part that may still have outliers without the wrong column.
const REST: f64 = 0.2;
/// Largest median distance of the errors of the wrong column from their median, relative to this: those of a
/// station that is right, about a path on its wrong side, change more.
const LASTING: f64 = 0.25;
/// Weight below which a path is left out of the mixture.
const LEAST: f64 = 1e-4;

/// A path without a column in the part, and ln of the likelihood of its measurements.
struct Candidate {
    values: Vec<f64>,
    found: Trajectory,
    value: f64,
}

/// Returns the path without the column that is wrong for a part of the record, if one is; otherwise the path
/// as it was found.
pub(in crate::trajectory) fn without_wrong<const D: usize, const N: usize>(
    record: &Record<'_>,
    found: Trajectory,
    solve: impl Fn(&Record<'_>) -> Result<Trajectory, Failure>,
) -> Trajectory {
    if !record.robust {
        return found;
    }
    let Some((part, columns)) = left_out_in_turn(record, &found.outlier) else { return found };
    let mut candidates = Vec::new();
    for column in columns {
        let mut values = record.values.to_vec();
        part.clone().for_each(|t| values[t * record.width() + column] = f64::NAN);
        let Ok(own) = solve(&Record { values: &values, ..*record }) else { continue };
        let Some(value) = value(record, &own, &part) else { continue };
        if !lasts::<D, N>(record, &own, &part, column) {
            continue;
        }
        candidates.push(Candidate { values, found: own, value });
    }
    candidates.sort_by(|a, b| b.value.total_cmp(&a.value));
    if candidates.is_empty() { found } else { mixed::<D, N>(record, candidates) }
}

/// Returns the part of the record in which most instants have outliers, and the columns to which these belong;
/// none if they belong to one column, or if there is no such part.
fn left_out_in_turn(record: &Record<'_>, outlier: &[bool]) -> Option<(Range<usize>, Vec<usize>)> {
    let width = record.width();
    let (mut best, mut top, mut start, mut sum) = (0..0, 0.0, 0, 0.0);
    for t in 0..record.len() {
        let own = t * width..(t + 1) * width;
        if record.values[own.clone()].iter().all(|v| v.is_nan()) {
            continue;
        }
        sum += if outlier[own].contains(&true) { 1.0 - HALF } else { -HALF };
        if sum <= 0.0 {
            (start, sum) = (t + 1, 0.0);
        } else if sum > top {
            (best, top) = (start..t + 1, sum);
        }
    }
    let mut rest = (0..record.len()).filter(|t| !best.contains(t));
    let agrees = |t: usize| !outlier[t * width..][..width].contains(&true);
    if best.len() < ENOUGH || rest.by_ref().filter(|&t| agrees(t)).count() < ENOUGH {
        return None;
    }
    let count = |column: usize| best.clone().filter(|t| outlier[t * width + column]).count();
    let mut counts: Vec<(usize, usize)> =
        (0..width).map(|column| (count(column), column)).collect();
    let total: usize = counts.iter().map(|(count, _)| count).sum();
    counts.sort_by(|a, b| b.cmp(a));
    if counts[0].0 as f64 > CLEAR * total as f64 {
        return None;
    }
    let suspected = |(count, _): &(usize, usize)| *count as f64 > SUSPECTED * total as f64;
    let columns = counts.into_iter().filter(suspected).take(MOST).map(|(_, column)| column);
    Some((best, columns.collect()))
}

/// Returns ln of the likelihood of the measurements of a path; none if it contradicts many of them in the part.
fn value(record: &Record<'_>, found: &Trajectory, part: &Range<usize>) -> Option<f64> {
    let width = record.width();
    let has_outlier = |t: &usize| found.outlier[t * width..][..width].contains(&true);
    let contradicted = part.clone().filter(has_outlier).count() as f64;
    let smoothed = found.smoothed.as_ref()?;
    let outliers = found.outlier.iter().filter(|is_outlier| **is_outlier).count() as f64;
    let value = smoothed.summary.log_likelihood + smoothed.ln_spread - OUTLIER * outliers;
    (contradicted <= REST * part.len() as f64 && value.is_finite()).then_some(value)
}

/// Whether the errors of a column in the part are rather those of a station that is wrong than of a path that
/// is: they last.
fn lasts<const D: usize, const N: usize>(
    record: &Record<'_>,
    found: &Trajectory,
    part: &Range<usize>,
    column: usize,
) -> bool {
    let places = || part.clone().map(|t| t * record.width() + column);
    let mut outlier = found.outlier.clone();
    places().for_each(|at| outlier[at] = true);
    let residual = residuals::<D, N>(record, record.values.to_vec(), &found.mean, &outlier);
    let own = places().map(|at| residual[at]);
    let mut errors: Vec<f64> = own.filter(|error| !error.is_nan()).collect();
    if errors.is_empty() {
        return false;
    }
    let middle = median(&mut errors);
    let mut spread: Vec<f64> = errors.iter().map(|error| (error - middle).abs()).collect();
    median(&mut spread) < LASTING * middle.abs()
}

/// Returns the likeliest path, with the covariance of the mixture of all.
fn mixed<const D: usize, const N: usize>(
    record: &Record<'_>,
    mut candidates: Vec<Candidate>,
) -> Trajectory {
    let Candidate { values, mut found, value: top } = candidates.remove(0);
    let weights: Vec<f64> = candidates.iter().map(|own| (own.value - top).exp()).collect();
    let total = 1.0 + weights.iter().sum::<f64>();
    let best = found.covariance.clone();
    for (own, weight) in candidates.iter().zip(weights).filter(|(_, weight)| *weight > LEAST) {
        for at in 0..best.len() {
            let (row, column) = (at / N, at / (N * N) * N + at % N);
            let away = |i: usize| own.found.mean[i] - found.mean[i];
            let change = own.found.covariance[at] + away(row) * away(column) - best[at];
            if change.is_finite() {
                found.covariance[at] += weight / total * change;
            }
        }
    }
    let left_out = |at: &usize| values[*at].is_nan() && !record.values[*at].is_nan();
    let left_out: Vec<usize> = (0..values.len()).filter(left_out).collect();
    left_out.iter().for_each(|&at| found.outlier[at] = true);
    let residual = residuals::<D, N>(record, record.values.to_vec(), &found.mean, &found.outlier);
    left_out.iter().for_each(|&at| found.residual[at] = residual[at]);
    found
}
