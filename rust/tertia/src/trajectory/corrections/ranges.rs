//! Errors of ranges that grow with the range, as of ranges that follow from signal strengths.
//!
//! The errors about a path are compared with Student's distribution, whose scale is constant at each station or
//! grows with the range. Where growth is much likelier, at more than one station, the path is estimated again
//! with standard deviations that grow, and from logarithms of the ranges where these fit better: an error of a
//! strength in decibels is an error of the logarithm. Weights follow the ranges of the path, because weights
//! that follow measured ranges would prefer those that are too short.

use crate::base::angle::median;
use crate::base::small::dot;
use crate::trajectory::measured::Record;
use crate::trajectory::methods::result::Trajectory;

/// Degrees of freedom of Student's distribution, which tolerates outliers, and the largest number of steps towards
/// its scale.
const FREEDOM: f64 = 4.0;
const STEPS: usize = 20;
/// Gain of ln of the likelihood from which errors grow, and the least ratio of their standard deviations at the
/// ranges that nine in ten and one in ten do not exceed.
const CLEAR: f64 = 20.0;
const GROWTH: f64 = 1.5;
/// The same gain without the station that contributes most: a motion that is not as assumed, or errors of one
/// station for a while, also make errors differ.
const ELSEWHERE: f64 = 10.0;
/// Ranges, relative to the median one, from which errors are about proportional to the range.
const KNEES: [f64; 8] = [8.0, 4.0, 2.0, 1.0, 0.5, 0.25, 0.125, 0.0625];
/// The same, up to which logarithms are tried, and the gain of ln of the likelihood from which they are used.
const EVERYWHERE: f64 = 0.125;
const LIKELIER: f64 = 3.0;
/// Largest number of ranges of a station that are compared, and the least one.
const MOST: usize = 500;
const FEWEST: usize = 10;
/// Factor from the median size of normal errors to their standard deviation.
const NORMAL: f64 = 1.4826;

/// Standard deviations, and values, of ranges whose errors grow with the range.
pub(in crate::trajectory) struct Proportional {
    values: Vec<f64>,
    sigmas: Vec<f64>,
    initial: Option<Vec<f64>>,
    /// Standard deviation of large ranges relative to the range.
    pub relative: f64,
}

/// A range and its error about the path.
#[derive(Clone, Copy)]
struct Ranged {
    /// Place among the values of the record.
    at: usize,
    station: usize,
    sigma: f64,
    /// Range of the path, and its mean square, which includes the uncertainty of the path.
    range: f64,
    square: f64,
    error: f64,
}

impl Ranged {
    /// Standard deviation relative to that of short ranges.
    fn width(&self, knee: f64) -> f64 {
        (1.0 + self.square / (knee * knee)).sqrt()
    }

    /// Error of the logarithm, times the range.
    fn logarithmic(&self) -> Option<f64> {
        let ratio = 1.0 + self.error / self.range;
        (ratio > 0.0).then(|| self.range * ratio.ln())
    }
}

impl Proportional {
    /// Judges the ranges of a record by the path that was found with the standard deviations `with`, or with
    /// those of the record. None if their errors do not grow.
    pub fn of<const D: usize, const N: usize>(
        record: &Record<'_>,
        with: Option<&Self>,
        found: &Trajectory,
    ) -> Option<Self> {
        let all = ranged::<D, N>(record, with, found);
        let stations = by_station(&all, record.receivers());
        let compared: Vec<&Ranged> = stations.iter().flatten().copied().collect();
        if !record.robust || compared.is_empty() {
            return None;
        }
        let (knee, is_logarithmic) = knee(&stations, &compared)?;
        let mut widths: Vec<f64> = compared.iter().map(|one| one.width(knee)).collect();
        widths.sort_by(f64::total_cmp);
        let [low, usual, high] = [1, 5, 9].map(|tenth| widths[tenth * (widths.len() - 1) / 10]);
        if high < GROWTH * low {
            return None;
        }
        let mut changed = Self {
            values: record.values.to_vec(),
            sigmas: (0..record.len()).flat_map(|t| record.sigmas_at(t)).copied().collect(),
            initial: found.image.is_none().then(|| found.mean[..D].to_vec()),
            relative: relative(&compared, knee),
        };
        for one in &all {
            changed.sigmas[one.at] *= one.width(knee) / usual;
            if let Some(error) = one.logarithmic().filter(|_| is_logarithmic) {
                changed.values[one.at] += error - one.error;
            }
        }
        Some(changed)
    }

    /// Returns the record with these standard deviations.
    pub fn record<'a>(&'a self, record: &Record<'a>) -> Record<'a> {
        let initial = self.initial.as_deref().filter(|start| start.iter().all(|v| v.is_finite()));
        Record {
            values: &self.values,
            own_sigmas: Some(&self.sigmas),
            initial: record.initial.or(initial),
            ..*record
        }
    }
}

/// Returns all ranges that can be compared with the path.
fn ranged<const D: usize, const N: usize>(
    record: &Record<'_>,
    with: Option<&Proportional>,
    found: &Trajectory,
) -> Vec<Ranged> {
    let width = record.width();
    let one = |at: usize| -> Option<Ranged> {
        let (t, station) = (at / width, at % width);
        let place = &record.stations_at(t, D)[station * D..][..D];
        let away: [f64; D] = std::array::from_fn(|i| found.mean[t * N + i] - place[i]);
        let range = dot(&away, &away).sqrt();
        let row = |i: usize| &found.covariance[(t * N + i) * N..][..D];
        let spread: f64 = (0..D)
            .map(|i| away[i] * row(i).iter().zip(&away).map(|(a, b)| a * b).sum::<f64>())
            .sum();
        let sigma = record.sigmas_at(t)[station];
        let (value, scale) =
            with.map_or((record.values[at], sigma), |own| (own.values[at], own.sigmas[at]));
        let error = record.values[at] - value + found.residual[at] * scale;
        let square = range * range + spread / (range * range);
        let is_known = [error, square, sigma].iter().all(|v| v.is_finite());
        (is_known && range > 0.0).then_some(Ranged { at, station, sigma, range, square, error })
    };
    let places =
        (0..record.len()).flat_map(|t| (0..record.receivers()).map(move |k| t * width + k));
    places.filter_map(one).collect()
}

/// Returns the range from which errors are about proportional to the range, and whether their logarithms fit
/// better. None if the errors do not grow.
fn knee(stations: &[Vec<&Ranged>], compared: &[&Ranged]) -> Option<(f64, bool)> {
    let mut ranges: Vec<f64> = compared.iter().map(|one| one.range).collect();
    let middle = median(&mut ranges);
    let constant = likelihoods(stations, |one| (one.error, one.sigma));
    let growing =
        |knee: f64| likelihoods(stations, |one| (one.error, one.sigma * one.width(knee * middle)));
    let total = |own: &[f64]| own.iter().sum::<f64>();
    let tried = KNEES.iter().map(|&knee| (knee, growing(knee)));
    let (knee, best) = tried.max_by(|a, b| total(&a.1).total_cmp(&total(&b.1)))?;
    let gains: Vec<f64> = best.iter().zip(&constant).map(|(own, usual)| own - usual).collect();
    let most = gains.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if total(&gains) < CLEAR || total(&gains) - most < ELSEWHERE {
        return None;
    }
    let is_logarithmic = knee <= EVERYWHERE && logarithms(stations) > total(&best) + LIKELIER;
    Some((knee * middle, is_logarithmic))
}

/// Returns some of the ranges of each station that has enough.
fn by_station(all: &[Ranged], stations: usize) -> Vec<Vec<&Ranged>> {
    let some = |station: usize| {
        let own: Vec<&Ranged> = all.iter().filter(|one| one.station == station).collect();
        own.iter().step_by(own.len().div_ceil(MOST).max(1)).copied().collect::<Vec<_>>()
    };
    (0..stations).map(some).filter(|own| own.len() >= FEWEST).collect()
}

/// Returns ln of the likelihood of the errors, with widths, of each station, which has its own scale.
fn likelihoods(stations: &[Vec<&Ranged>], error: impl Fn(&Ranged) -> (f64, f64)) -> Vec<f64> {
    let of = |own: &Vec<&Ranged>| {
        let (errors, widths): (Vec<f64>, Vec<f64>) =
            own.iter().map(|one| error(one)).map(|(error, width)| (error / width, width)).unzip();
        let scale = scale(&errors);
        let one = |error: &f64| {
            scale.ln() + 0.5 * (FREEDOM + 1.0) * ((error / scale).powi(2) / FREEDOM).ln_1p()
        };
        -errors.iter().map(one).sum::<f64>() - widths.iter().map(|width| width.ln()).sum::<f64>()
    };
    stations.iter().map(of).collect()
}

/// Returns ln of the likelihood of the errors of logarithms.
fn logarithms(stations: &[Vec<&Ranged>]) -> f64 {
    let positive = |own: &Vec<&Ranged>| own.iter().all(|one| one.logarithmic().is_some());
    if !stations.iter().all(positive) {
        return f64::NEG_INFINITY;
    }
    let error = |one: &Ranged| one.logarithmic().unwrap_or(0.0);
    // the density of a range is that of its logarithm over the range
    let ranges = stations.iter().flatten().map(|one| (one.error / one.range).ln_1p());
    likelihoods(stations, |one| (error(one), one.range)).iter().sum::<f64>() - ranges.sum::<f64>()
}

/// Scale of Student's distribution of these errors.
fn scale(errors: &[f64]) -> f64 {
    let mut sizes: Vec<f64> = errors.iter().map(|error| error.abs()).collect();
    let mut scale = (NORMAL * median(&mut sizes)).max(f64::MIN_POSITIVE);
    for _ in 0..STEPS {
        let weighted = |error: &f64| {
            let square = error * error;
            square * (FREEDOM + 1.0) / (FREEDOM + square / (scale * scale))
        };
        let next = (errors.iter().map(weighted).sum::<f64>() / errors.len() as f64).sqrt();
        let is_settled = (next - scale).abs() <= 1e-3 * scale;
        scale = next.max(f64::MIN_POSITIVE);
        if is_settled {
            break;
        }
    }
    scale
}

/// Standard deviation of large ranges relative to the range.
fn relative(compared: &[&Ranged], knee: f64) -> f64 {
    let (mut sizes, mut sigmas): (Vec<f64>, Vec<f64>) = compared
        .iter()
        .map(|one| (one.error.abs() / (one.sigma * one.width(knee)), one.sigma))
        .unzip();
    NORMAL * median(&mut sizes) * median(&mut sigmas) / knee
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;

    /// Ranges of two stations with errors of `sigma(range)`.
    fn of(sigma: impl Fn(f64) -> f64) -> Vec<Ranged> {
        let mut random = Random::new(3);
        let one = |at: usize| {
            let normal = (0..12).map(|_| random.uniform()).sum::<f64>() - 6.0;
            let range = 5.0 + 45.0 * random.uniform();
            let error = sigma(range) * normal;
            Ranged { at, station: at % 2, sigma: 1.0, range, square: range * range, error }
        };
        (0..400).map(one).collect()
    }

    /// Gain of ln of the likelihood by errors that grow from this range on.
    fn gain(all: &[Ranged], knee: f64) -> f64 {
        let stations = by_station(all, 2);
        let total = |own: Vec<f64>| own.iter().sum::<f64>();
        total(likelihoods(&stations, |one| (one.error, one.width(knee))))
            - total(likelihoods(&stations, |one| (one.error, 1.0)))
    }

    #[test]
    fn errors_that_grow_are_likelier_with_a_growing_scale() {
        let (constant, growing) = (of(|_| 3.0), of(|range| 0.2 * range));
        assert!(KNEES.iter().all(|knee| gain(&constant, 30.0 * knee) < 2.0));
        assert!(gain(&growing, 2.0) > CLEAR);
        let compared: Vec<&Ranged> = growing.iter().collect();
        assert!((relative(&compared, 2.0) / 0.2 - 1.0).abs() < 0.1);
    }

    #[test]
    fn the_scale_tolerates_outliers() {
        let mut errors: Vec<f64> = of(|_| 3.0).iter().map(|one| one.error).collect();
        let clean = scale(&errors);
        errors.iter_mut().step_by(10).for_each(|error| *error = 1e3);
        assert!((2.0..3.2).contains(&clean), "{clean}");
        assert!(scale(&errors) < 2.0 * clean);
    }

    #[test]
    fn logarithms_are_likelier_for_errors_of_strengths() {
        let mut all = of(|_| 0.3);
        all.iter_mut().for_each(|one| one.error = one.range * one.error.exp_m1());
        let stations = by_station(&all, 2);
        let linear = likelihoods(&stations, |one| (one.error, one.range));
        assert!(logarithms(&stations) > linear.iter().sum::<f64>() + LIKELIER);
    }
}
