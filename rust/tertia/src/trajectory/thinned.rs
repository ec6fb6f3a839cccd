//! Measurements that tell nothing about the target: those that repeat the one before, as of a station that is
//! stuck or read too often, and columns that are wrong throughout, as of a station with another unit or a wrong
//! position.
//!
//! Lasting errors are estimated from residuals about a path, to first order, and the residuals about a path
//! that follows a column with a very large error that changes along the path do not determine its error. The
//! robust positions of single instants do not follow such a column: at nearly every instant, it is an outlier.

use super::clocks;
use super::fixes::Fixes;
use super::lasting::LastingErrors;
use super::measured::Record;
use super::mirror::Mirror;
use super::prior::Systematic;
use super::result::{Trajectory, residuals};
use super::tukey::TUKEY;
use crate::base::angle::median;
use crate::base::distribution::normal_two_sided_quantile;
use crate::sensors::{KINDS, Kind};
use crate::smoothing::{Noise, repeated_readings};

/// Least number of measurements, and the least share of them, that contradict the others.
const ENOUGH: usize = 20;
const SHARE: f64 = 0.75;
/// Degrees of freedom of an instant that is located robustly, and those that must remain without outliers. If
/// only one remains, the others may agree by chance, and only errors of this size in standard deviations show
/// that a column is wrong.
const REDUNDANCY: usize = 2;
const REDUNDANT: i64 = 2;
const GROSS: f64 = 100.0;
/// Spread of the errors of a column, in standard deviations, up to which it is the constant error of a station
/// that is otherwise right.
const CHANGES: f64 = 3.0;

/// A record without measurements that tell nothing about the target.
pub(super) struct Thinned {
    values: Vec<f64>,
    /// Columns that are wrong throughout.
    wrong: Vec<usize>,
}

impl Thinned {
    /// Leaves measurements out; none if all of them may tell something.
    pub fn of<const D: usize>(record: &Record<'_>, systematic: &Systematic) -> Option<Self> {
        if !record.robust {
            return None;
        }
        let mut values = record.values.to_vec();
        let repeats = leave_out_repeated(record, &mut values);
        let wrong = wrong_throughout::<D>(&Record { values: &values, ..*record }, systematic);
        for column in &wrong {
            let own = values.iter_mut().skip(*column).step_by(record.width());
            own.for_each(|value| *value = f64::NAN);
        }
        (repeats || !wrong.is_empty()).then_some(Self { values, wrong })
    }

    /// Returns the record without these measurements.
    pub fn record<'a>(&'a self, record: &Record<'a>) -> Record<'a> {
        Record { values: &self.values, ..*record }
    }

    /// Adds the measurements that were left out, as outliers, to the results. The median error of a column
    /// that is wrong throughout, and the spread of its errors, are those of its bias.
    pub fn restored<const D: usize, const N: usize>(
        &self,
        record: &Record<'_>,
        mut found: Trajectory,
    ) -> Trajectory {
        let width = record.width();
        let is_left_out = |at: usize| self.values[at].is_nan() && !record.values[at].is_nan();
        let left_out: Vec<usize> = (0..self.values.len()).filter(|at| is_left_out(*at)).collect();
        left_out.iter().for_each(|&at| found.outlier[at] = true);
        let values = record.values.to_vec();
        let residual = residuals::<D, N>(record, values, &found.mean, &found.outlier);
        left_out.iter().for_each(|&at| found.residual[at] = residual[at]);
        let Some(LastingErrors { value, sigma, .. }) = &mut found.bias else { return found };
        for &column in &self.wrong {
            let error = |t: usize| residual[t * width + column] * record.sigmas_at(t)[column];
            let errors = (0..record.len()).map(error).filter(|error| !error.is_nan()).collect();
            (value[column], sigma[column]) = spread(errors);
        }
        found
    }
}

/// Leaves out measurements of stations that repeat the one before. Returns whether there are any. Arrivals, which
/// are relative to the first one of their instant, never repeat.
fn leave_out_repeated(record: &Record<'_>, values: &mut [f64]) -> bool {
    let width = record.width();
    let mut any = false;
    for column in 0..Kind::Arrival as usize * record.receivers() {
        let own: Vec<f64> = values.iter().skip(column).step_by(width).copied().collect();
        let variances: Vec<f64> =
            (0..record.len()).map(|t| record.sigmas_at(t)[column].powi(2)).collect();
        for (t, is_repeated) in repeated_readings(&own, Noise::Each(&variances)).iter().enumerate()
        {
            if *is_repeated {
                values[t * width + column] = f64::NAN;
                any = true;
            }
        }
    }
    any
}

/// Returns the columns that contradict the robust positions of single instants throughout, by errors that
/// change. Where clocks differ, measurements belong to other times than those of their instants.
fn wrong_throughout<const D: usize>(record: &Record<'_>, systematic: &Systematic) -> Vec<usize> {
    if !clocks::are_right(record, systematic) {
        return Vec::new();
    }
    let mirror = Mirror::<D>::chosen(record);
    let fixes = Fixes::robust_from::<D>(record, REDUNDANCY);
    let fixes = fixes.beside(record, record.values, mirror.as_ref());
    let width = record.width();
    let outliers =
        |t: usize| fixes.outlier[t * width..][..width].iter().filter(|outlier| **outlier).count();
    let left = |t: usize| fixes.fixes[t].degrees_of_freedom - outliers(t) as i64;
    let is_sure = |t: &usize| fixes.is_located(*t) && left(*t) > 0;
    let sure: Vec<usize> = (0..record.len()).filter(is_sure).collect();
    let is_wrong = |column: &usize| {
        let is_known = |t: &usize| !record.values[t * width + column].is_nan();
        let own: Vec<usize> = sure.iter().copied().filter(is_known).collect();
        if own.len() < ENOUGH || 2 * own.len() < (0..record.len()).filter(is_known).count() {
            return false;
        }
        let residual = |t: usize| fixes.residual[t * width + column];
        let stated = systematic.sigma(*column, record);
        let contradicts = |t: usize| {
            let limit = if left(t) < REDUNDANT { GROSS } else { TUKEY };
            let expected = f64::hypot(1.0, stated / record.sigmas_at(t)[*column]);
            fixes.outlier[t * width + column] && residual(t).abs() > limit * expected
        };
        let count = own.iter().filter(|t| contradicts(**t)).count();
        count as f64 >= SHARE * own.len() as f64
            && spread(own.iter().map(|t| residual(*t)).collect()).1 > CHANGES
    };
    (0..KINDS * record.receivers()).filter(is_wrong).collect()
}

/// Median, and the standard deviation that follows from the median distance from it.
fn spread(mut values: Vec<f64>) -> (f64, f64) {
    let centre = median(&mut values);
    let mut distances: Vec<f64> = values.iter().map(|value| (value - centre).abs()).collect();
    (centre, median(&mut distances) / normal_two_sided_quantile(0.5))
}
