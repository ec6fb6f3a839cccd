//! Measurements that tell nothing about the target: those that repeat the one before, as of a station that is
//! stuck or read too often, and columns that are wrong throughout, as of a station with another unit or a wrong
//! position.
//!
//! Lasting errors are estimated from residuals about a path, to first order, and the residuals about a path
//! that follows a column with a very large error that changes along the path do not determine its error. The
//! robust positions of single instants do not follow such a column: at nearly every instant, it is an outlier.
//! Where only one measurement would remain redundant, as with four ranges in the plane, the column is the one
//! without which all others agree at most instants, if without any other one they do not.

use super::clocks;
use crate::base::angle::median;
use crate::base::distribution::normal_two_sided_quantile;
use crate::sensors::{KINDS, Kind};
use crate::smoothing::{Noise, repeated_readings};
use crate::trajectory::instants::fixes::Fixes;
use crate::trajectory::instants::instant::{Instant, Seen};
use crate::trajectory::instants::tukey::TUKEY;
use crate::trajectory::measured::{Measured, Place, Record};
use crate::trajectory::methods::result::{Trajectory, residuals};
use crate::trajectory::mirror::Mirror;
use crate::trajectory::systematic::lasting::LastingErrors;
use crate::trajectory::systematic::prior::Systematic;
use nalgebra::{DMatrix, DVector};

/// Least number of measurements, and the least share of them, that contradict the others.
const ENOUGH: usize = 20;
const SHARE: f64 = 0.75;
/// Degrees of freedom of an instant that is located robustly, and those that must remain without outliers. If
/// fewer remain, the others may agree by chance.
const REDUNDANCY: usize = 2;
const REDUNDANT: i64 = 2;
/// Probability below which the measurements of an instant do not agree.
const DISAGREE: f64 = 0.01;
/// Share of the instants with at most the typical statistic, and what it is for measurements with noise alone.
const MOST: f64 = 0.7;
const EXPECTED: f64 = 1.0;
/// Least ratios of the typical statistics without another column and without the wrong one: where the others
/// agree without the wrong one, where they nearly do, and where they do not, as with many outliers or large
/// systematic errors. The limits of the statistic are those between the three.
const CLEARER: [f64; 3] = [5.0, 10.0, 1e3];
const AGREE: f64 = 2.0;
const MODERATE: f64 = 4.0;
/// Ratio of the typical statistics below which constant errors explain the measurements better, and information,
/// relative to the largest one, from which constants are determined.
const BETTER: f64 = 0.8;
const DETERMINED: f64 = 1e-9;
/// Spread of the errors of a column, and their median, in standard deviations, up to which they are the constant
/// error of a station that is otherwise right. Larger ones cannot be estimated to first order.
const CHANGES: f64 = 3.0;
const GROSS: f64 = 30.0;

/// A record without measurements that tell nothing about the target.
pub(in crate::trajectory) struct Thinned {
    values: Vec<f64>,
    /// Columns that are wrong throughout.
    wrong: Vec<usize>,
}

impl Thinned {
    /// Leaves out measurements that repeat the one before; none if there are none.
    pub fn without_repeats(record: &Record<'_>) -> Option<Self> {
        let mut values = record.values.to_vec();
        let any = record.robust && leave_out_repeated(record, &mut values);
        any.then_some(Self { values, wrong: Vec::new() })
    }

    /// Leaves out columns that are wrong throughout; none if there are none.
    pub fn without_wrong<const D: usize>(
        record: &Record<'_>,
        systematic: &Systematic,
    ) -> Option<Self> {
        if !record.robust {
            return None;
        }
        let wrong = wrong_throughout::<D>(record, systematic);
        let mut values = record.values.to_vec();
        for column in &wrong {
            let own = values.iter_mut().skip(*column).step_by(record.width());
            own.for_each(|value| *value = f64::NAN);
        }
        (!wrong.is_empty()).then_some(Self { values, wrong })
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

/// Returns the columns that contradict all others throughout, by errors that change. Where clocks differ,
/// measurements belong to other times than those of their instants.
fn wrong_throughout<const D: usize>(record: &Record<'_>, systematic: &Systematic) -> Vec<usize> {
    if !clocks::are_right(record, systematic) {
        return Vec::new();
    }
    let mirror = Mirror::<D>::chosen(record);
    let fixes = Fixes::robust_from::<D>(record, REDUNDANCY);
    let fixes = on_a_side(fixes, record, record.values, mirror.as_ref());
    let found = outside::<D>(record, systematic, &fixes);
    if found.is_empty() && disagree(&fixes) {
        return disturbing::<D>(record, systematic, mirror.as_ref()).into_iter().collect();
    }
    found
}

/// Moves positions to the side of the mirror's normal if hardly any instant has a position otherwise. Stations
/// that are only near a plane determine the side, which may be the other one.
fn on_a_side<const D: usize>(
    fixes: Fixes,
    record: &Record<'_>,
    values: &[f64],
    mirror: Option<&Mirror<D>>,
) -> Fixes {
    if fixes.are_hardly_located() { fixes.beside(record, values, mirror) } else { fixes }
}

/// Columns with measurements of stations.
fn columns(record: &Record<'_>) -> impl Iterator<Item = usize> {
    let own = |column: usize| record.values.iter().skip(column).step_by(record.width());
    (0..KINDS * record.receivers()).filter(move |&column| own(column).any(|v| !v.is_nan()))
}

/// Returns the columns that are outliers at nearly all of the instants that have enough other measurements.
/// Wrong arrivals always agree with the emission that one or another of them determines, so they are judged
/// together where measurements of other kinds determine the positions.
fn outside<const D: usize>(
    record: &Record<'_>,
    systematic: &Systematic,
    fixes: &Fixes,
) -> Vec<usize> {
    let sure = Sure::of(record, systematic, fixes);
    let (arrivals, others): (Vec<usize>, Vec<usize>) =
        columns(record).partition(|column| *column >= Kind::Arrival as usize * record.receivers());
    let all = sure.are_determined_by::<D>(&others) && sure.arrivals_are_wrong(&arrivals);
    let is_wrong = |column: &usize| {
        (all && arrivals.contains(column))
            || sure.errors(*column).is_some_and(|own| are_wrong(&own, own.len()))
    };
    columns(record).filter(is_wrong).collect()
}

/// Whether errors that change are outside at nearly all of so many measurements.
fn are_wrong(errors: &[f64], count: usize) -> bool {
    let outside = errors.iter().filter(|error| error.abs() > TUKEY).count();
    count > 0 && outside as f64 >= SHARE * count as f64 && changes(errors.to_vec())
}

/// Instants whose positions are known without their outliers.
struct Sure<'a> {
    record: &'a Record<'a>,
    systematic: &'a Systematic,
    fixes: &'a Fixes,
    instants: Vec<usize>,
}

impl<'a> Sure<'a> {
    fn of(record: &'a Record<'a>, systematic: &'a Systematic, fixes: &'a Fixes) -> Self {
        let outliers = |t: usize| {
            let own = &fixes.outlier[t * record.width()..][..record.width()];
            own.iter().filter(|outlier| **outlier).count()
        };
        let left = |t: usize| fixes.fixes[t].degrees_of_freedom - outliers(t) as i64;
        let is_sure = |t: &usize| fixes.is_located(*t) && left(*t) >= REDUNDANT;
        let instants = (0..record.len()).filter(is_sure).collect();
        Self { record, systematic, fixes, instants }
    }

    fn is_measured(&self, t: usize, column: usize) -> bool {
        !self.record.values[t * self.record.width() + column].is_nan()
    }

    /// Errors of a column in standard deviations; none if most of its measurements are at other instants.
    fn errors(&self, column: usize) -> Option<Vec<f64>> {
        let measured = |t: &usize| self.is_measured(*t, column);
        let own: Vec<usize> = self.instants.iter().copied().filter(measured).collect();
        let all = (0..self.record.len()).filter(measured).count();
        let is_enough = own.len() >= ENOUGH && 2 * own.len() >= all;
        is_enough.then(|| {
            errors(
                self.record,
                self.systematic,
                column,
                (&self.fixes.position, &self.fixes.residual),
                own.iter(),
            )
        })
    }

    /// Whether at most instants these columns determine the position without any other one.
    fn are_determined_by<const D: usize>(&self, columns: &[usize]) -> bool {
        let agrees = |t: usize, column: usize| {
            self.is_measured(t, column) && !self.fixes.outlier[t * self.record.width() + column]
        };
        let suffice = |t: &&usize| columns.iter().filter(|own| agrees(**t, **own)).count() > D;
        2 * self.instants.iter().filter(suffice).count() > self.instants.len()
    }

    /// Whether nearly all arrivals are outside, but for those that determine the emissions.
    fn arrivals_are_wrong(&self, arrivals: &[usize]) -> bool {
        let errors: Vec<f64> =
            arrivals.iter().filter_map(|own| self.errors(*own)).flatten().collect();
        let determines = |t: &&usize| arrivals.iter().any(|own| self.is_measured(**t, *own));
        let emissions = self.instants.iter().filter(determines).count();
        are_wrong(&errors, errors.len().saturating_sub(emissions))
    }
}

/// Whether the redundant measurements of most instants contradict each other.
fn disagree(fixes: &Fixes) -> bool {
    let redundant = |t: &usize| fixes.fixes[*t].degrees_of_freedom >= REDUNDANT;
    let redundant: Vec<usize> = (0..fixes.fixes.len()).filter(redundant).collect();
    let agrees = |t: &&usize| fixes.is_located(**t) && fixes.fixes[**t].pvalue >= DISAGREE;
    redundant.len() >= ENOUGH && 2 * redundant.iter().filter(agrees).count() < redundant.len()
}

/// Returns the column without which all others agree much better than without any other one, if there is one,
/// its errors change, and constant errors of all columns do not explain the measurements better. If all others
/// agree, they may do so without a second column, too.
fn disturbing<const D: usize>(
    record: &Record<'_>,
    systematic: &Systematic,
    mirror: Option<&Mirror<D>>,
) -> Option<usize> {
    let located = |values: &[f64]| {
        let record = Record { robust: false, ..*record };
        on_a_side(Fixes::of::<D>(&record, values), &record, values, mirror)
    };
    let without = |column: usize| {
        let mut values = record.values.to_vec();
        values.iter_mut().skip(column).step_by(record.width()).for_each(|own| *own = f64::NAN);
        located(&values)
    };
    let left = |column: usize| {
        let fixes = without(column);
        let own = redundant(&fixes).map(|t| &fixes.fixes[t]);
        typical(own.map(|fix| fix.statistic / fix.degrees_of_freedom as f64))
    };
    let mut all: Vec<(f64, usize)> = columns(record).map(|column| (left(column), column)).collect();
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    let [(least, column), (next, _), (third, _), ..] = all[..] else { return None };
    let clearer = CLEARER[usize::from(least > AGREE) + usize::from(least > MODERATE)];
    // one of two columns is left out rather than none
    let other = if least > AGREE { next } else { third };
    if least == f64::INFINITY || other < clearer * least.max(EXPECTED) {
        return None;
    }
    let constant = typical(left_by_constants::<D>(record, &located(record.values)).into_iter());
    if constant < BETTER * least.max(EXPECTED) {
        return None;
    }
    let fixes = without(column);
    let residual =
        residuals::<D, D>(record, record.values.to_vec(), &fixes.position, &fixes.outlier);
    let known = |t: &usize| !residual[t * record.width() + column].is_nan();
    let known: Vec<usize> = (0..record.len()).filter(known).collect();
    let seen = (&*fixes.position, &*residual);
    let errors = errors(record, systematic, column, seen, known.iter());
    (errors.len() >= ENOUGH && changes(errors)).then_some(column)
}

/// Instants with a position and redundant measurements.
fn redundant(fixes: &Fixes) -> impl Iterator<Item = usize> {
    let own = |t: &usize| fixes.is_located(*t) && fixes.fixes[*t].degrees_of_freedom > 0;
    (0..fixes.fixes.len()).filter(own)
}

/// Returns the statistics per degree of freedom of redundant instants less what constant errors of all columns
/// explain.
fn left_by_constants<const D: usize>(record: &Record<'_>, fixes: &Fixes) -> Vec<f64> {
    let columns: Vec<usize> = columns(record).collect();
    let measured = Measured::<D>::new(record, record.values.to_vec());
    let weight: Vec<f64> = (0..measured.len()).map(|m| measured.precision(m).powi(2)).collect();
    let linearised = |t: usize| {
        let seen = Seen { t, place: Place::at(&fixes.position[t * D..]), velocity: [0.0; D] };
        Instant::new(&measured, seen, &weight, &columns, 0.0)
    };
    // at a station itself, azimuths have no derivatives
    let is_finite = |(_, own): &(usize, Instant<D>)| own.kept.iter().all(|kept| kept.is_finite());
    let instants: Vec<(usize, Instant<D>)> =
        redundant(fixes).map(|t| (t, linearised(t))).filter(is_finite).collect();
    let size = columns.len();
    let (mut information, mut scores) = (DMatrix::zeros(size, size), DVector::zeros(size));
    let mut largest = DVector::zeros(size);
    for (_, instant) in &instants {
        instant.add_information(|i| instant.rows[i].1, &mut information);
        largest += DVector::from_row_slice(&instant.largest);
        for (kept, (_, w, r, ..)) in instant.kept.chunks_exact(size).zip(&instant.rows) {
            kept.iter().enumerate().for_each(|(a, kept)| scores[a] += kept * w * r);
        }
    }
    // columns have different units
    let unit = largest.map(|own: f64| if own > 0.0 { own.sqrt().recip() } else { 0.0 });
    let scaled = DMatrix::from_diagonal(&unit) * information * DMatrix::from_diagonal(&unit);
    let values = scaled.svd(true, true);
    let least = DETERMINED * values.singular_values.max();
    // both factors are computed
    let constants = values.solve(&scores.component_mul(&unit), least).unwrap_or(scores);
    let constants = constants.component_mul(&unit);
    let statistic = |instant: &Instant<D>| {
        let left = instant.left(&constants);
        left.iter().zip(&instant.rows).map(|(left, (_, w, ..))| w * left * left).sum::<f64>()
    };
    let each =
        instants.iter().map(|(t, own)| statistic(own) / fixes.fixes[*t].degrees_of_freedom as f64);
    each.collect()
}

/// Number that most of these do not exceed; infinite if there are not enough.
fn typical(numbers: impl Iterator<Item = f64>) -> f64 {
    let mut all: Vec<f64> = numbers.collect();
    if all.len() < ENOUGH {
        return f64::INFINITY;
    }
    let at = (MOST * all.len() as f64) as usize;
    *all.select_nth_unstable_by(at, f64::total_cmp).1
}

/// Errors of a column at these instants, in standard deviations with those of its stated systematic error and of
/// the survey.
fn errors<'a>(
    record: &Record<'_>,
    systematic: &Systematic,
    column: usize,
    (position, residual): (&[f64], &[f64]),
    instants: impl Iterator<Item = &'a usize>,
) -> Vec<f64> {
    let stated = systematic.sigma(column, record);
    let expected = |t: usize| {
        let lasting = f64::hypot(stated, surveyed(record, position, t, column));
        f64::hypot(1.0, lasting / record.sigmas_at(t)[column])
    };
    instants.map(|t| residual[t * record.width() + column] / expected(*t)).collect()
}

/// Standard deviation of the error that the survey of its station causes in a column at an instant.
fn surveyed(record: &Record<'_>, position: &[f64], t: usize, column: usize) -> f64 {
    let (k, d) = (record.receivers(), position.len() / record.len());
    let Some(sigma) = record.surveys.map(|own| own[column % k]).filter(|own| *own > 0.0) else {
        return 0.0;
    };
    if column / k != Kind::Azimuth as usize && column / k != Kind::Elevation as usize {
        return sigma;
    }
    let at = (t * k + column % k) * d % record.stations.len();
    let away = record.stations[at..][..d].iter().zip(&position[t * d..][..d]);
    sigma / away.map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

/// Whether errors in standard deviations are not those of a station with a small constant error.
fn changes(errors: Vec<f64>) -> bool {
    let (centre, spread) = spread(errors);
    spread > CHANGES || centre.abs() > GROSS
}

/// Median, and the standard deviation that follows from the median distance from it.
fn spread(mut values: Vec<f64>) -> (f64, f64) {
    let centre = median(&mut values);
    let mut distances: Vec<f64> = values.iter().map(|value| (value - centre).abs()).collect();
    (centre, median(&mut distances) / normal_two_sided_quantile(0.5))
}
