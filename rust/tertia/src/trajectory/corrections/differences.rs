//! Range differences as arrivals at the receivers.
//!
//! The error that all range differences of an instant have in common is that of the first receiver. If its
//! arrival is the origin of time, the range differences are the arrivals at the other receivers. The errors of
//! these arrivals are independent, and the first receiver is one like any other, which is found if it is wrong.

use crate::sensors::Kind;
use crate::trajectory::measured::{Record, seen};
use crate::trajectory::methods::result::Trajectory;
use crate::trajectory::systematic::lasting::LastingErrors;
use crate::trajectory::systematic::prior::Systematic;

/// A record with arrivals instead of range differences.
pub(in crate::trajectory) struct Received {
    values: Vec<f64>,
    sigmas: Vec<f64>,
    own_sigmas: Option<Vec<f64>>,
    pub systematic: Systematic,
}

impl Received {
    /// Converts range differences; none if there are none that have an error in common.
    pub fn of(record: &Record<'_>, systematic: &Systematic) -> Option<Self> {
        let [differences, arrivals] = columns(record.receivers());
        let width = record.width();
        if record.correlation == 0.0 || seen(record, &[Kind::RangeDifference as usize]).is_empty() {
            return None;
        }
        let mut values = record.values.to_vec();
        for row in values.chunks_exact_mut(width) {
            let is_measured = row[differences.clone()].iter().any(|value| !value.is_nan());
            row.copy_within(differences.clone(), arrivals.start);
            row[differences.clone()].fill(f64::NAN);
            row[arrivals.start] = if is_measured { 0.0 } else { f64::NAN };
        }
        let converted = |sigmas: &[f64]| {
            let mut rows = sigmas.to_vec();
            for row in rows.chunks_exact_mut(width) {
                let least = row[differences.clone()].iter().copied().fold(f64::NAN, f64::min);
                let common = record.correlation * least * least;
                for (own, difference) in arrivals.clone().zip(differences.clone()) {
                    row[own] = (row[difference] * row[difference] - common).sqrt();
                }
                row[arrivals.start] = common.sqrt();
                row[differences.clone()].fill(f64::NAN);
            }
            rows
        };
        let mut systematic = systematic.clone();
        if let Systematic::Lasting(prior) = &mut systematic {
            for numbers in [&mut prior.sigma, &mut prior.share, &mut prior.time] {
                numbers.copy_within(differences.clone(), arrivals.start);
            }
        }
        let (sigmas, own_sigmas) = (converted(record.sigmas), record.own_sigmas.map(converted));
        Some(Self { values, sigmas, own_sigmas, systematic })
    }

    /// Returns the record with arrivals.
    pub fn record<'a>(&'a self, record: &Record<'a>) -> Record<'a> {
        Record {
            values: &self.values,
            sigmas: &self.sigmas,
            own_sigmas: self.own_sigmas.as_deref(),
            ..*record
        }
    }

    /// Converts results for arrivals to those for range differences. A difference is an outlier if either of
    /// its arrivals is one. The column of the first receiver states whether it is wrong, but not all others.
    pub fn restored(&self, record: &Record<'_>, mut found: Trajectory) -> Trajectory {
        let [differences, arrivals] = columns(record.receivers());
        let fixes = &mut found.fixes;
        for residual in [&mut found.residual, &mut fixes.residual] {
            for (t, row) in residual.chunks_exact_mut(record.width()).enumerate() {
                let (own, stated) = (self.record(record).sigmas_at(t), record.sigmas_at(t));
                let error = |column: usize| row[column] * own[column];
                let first = error(arrivals.start);
                let errors: Vec<f64> =
                    arrivals.clone().skip(1).map(|at| error(at) - first).collect();
                for (at, error) in differences.clone().skip(1).zip(errors) {
                    row[at] = error / stated[at];
                }
                row[arrivals.clone()].fill(f64::NAN);
            }
        }
        for outlier in [&mut found.outlier, &mut fixes.outlier] {
            for (row, values) in outlier
                .chunks_exact_mut(record.width())
                .zip(record.values.chunks_exact(record.width()))
            {
                let first = row[arrivals.start];
                let is_right = |at: &usize| {
                    !values[*at].is_nan() && !row[arrivals.start + at - differences.start]
                };
                // one alone always agrees with the emission
                let alone = first && differences.clone().skip(1).filter(is_right).count() > 1;
                for (at, arrival) in differences.clone().zip(arrivals.clone()) {
                    row[at] = !values[at].is_nan() && (first || row[arrival]);
                }
                // the column of the first receiver, which has no differences
                row[differences.start] = alone;
                row[arrivals.clone()].fill(false);
            }
        }
        if let Some(LastingErrors { value, sigma, .. }) = &mut found.bias {
            for numbers in [value, sigma] {
                numbers.copy_within(arrivals.clone(), differences.start);
                numbers[arrivals.clone()].fill(0.0);
            }
        }
        found
    }
}

/// Columns of the range differences and of the arrivals of K receivers.
fn columns(k: usize) -> [std::ops::Range<usize>; 2] {
    [Kind::RangeDifference, Kind::Arrival].map(|kind| kind as usize * k..(kind as usize + 1) * k)
}
