//! Lasting errors: their size and correlation time, from contradictions between stations.
//!
//! A measurement of a station has an error `c + g(t) + e(t)`: c is constant, g is a drift with a correlation
//! time, and e is new in each measurement. From the residuals r of an instant about the path, with weights W
//! and derivatives J, the product `Λ r` with `Λ = W − W J (J'WJ)^-1 J'W` does not depend on the position: it
//! equals `Λ (c + g + e)`. A Kalman filter of g over blocks of instants, for all c together, gives the
//! likelihood. The results are averaged over a grid of the variances of c and g and of the correlation time.
//! Only c is removed from the measurements. The remaining uncertainty of c, and g with its prior variance,
//! are propagated through the smoother into the covariance of the path.

use super::bias::{add_covariance, smoothed, weights};
use super::blocks::{length, memory, together};
use super::contradictions::Blocks;
use super::grid::{CERTAIN, Grid, Weighed};
use super::prior::Prior;
use crate::base::angle::upper_median;
use crate::sensors::KINDS;
use crate::smoothing::ProcessNoise;
use crate::trajectory::instants::instant::{Instant, responses};
use crate::trajectory::measured::{Measured, Record, in_domain};
use crate::trajectory::path::failure::Failure;
use crate::trajectory::search::fit::{Found, Setting};
use nalgebra::{DMatrix, DVector};
use std::ops::Range;
use std::rc::Rc;

/// Lasting errors are believed absent only if they would cause at least this many independent contradictions.
const TELLING: usize = 2;
/// Variance of lasting errors over that of the smoothed noise, below which lasting errors are neglected.
const NEGLIGIBLE: f64 = 0.1;
/// Probability of being far more wrong than all others from which a column is left out.
const DISTRUSTED: f64 = 0.9;
/// Largest number of rounds of removing the estimates, and the change, in standard errors, that ends them.
const ROUNDS: usize = 3;
const SETTLED: f64 = 0.1;
/// Decreases of the squared scores and of the squared residuals by Tukey's weights with normal errors,
/// relative to the decrease of the mean slope: a constant, and a part proportional to the redundant share of
/// the residuals. The remaining factors have the lower bound `LEAST_FALL`.
const FALL_OF_SQUARES: [f64; 2] = [0.2, 1.8];
const FALL_OF_VARIANCES: [f64; 2] = [0.5, 0.9];
const LEAST_FALL: f64 = 0.4;
/// One-sided 99 % quantile of the standard normal distribution.
const SURELY: f64 = 2.326;

/// Estimated lasting errors.
#[derive(Clone, Debug)]
pub(in crate::trajectory) struct Lasting {
    /// Columns of a record's rows that may have lasting errors.
    columns: Vec<usize>,
    /// Values that were removed from the measurements.
    values: DVector<f64>,
    /// Covariance of the constants.
    constant: DMatrix<f64>,
    /// Variances of the drifts, and of what the smoother leaves of the drifts.
    drift: Vec<f64>,
    smooth: Vec<f64>,
    /// For each column, the probability that it is far more wrong than all others.
    alone: Vec<f64>,
    /// Standard deviations of the errors that all stations of a kind have in common.
    common: Vec<f64>,
    /// Variance of the other errors, averaged over a block, relative to the expected one.
    growth: f64,
    /// Number of independent contradictions.
    redundant: usize,
    /// Probability that there are no lasting errors.
    nothing: f64,
    /// Number of instants over which the smoother averages.
    memory: f64,
    /// Columns that are left out, with their estimated errors and the standard deviations of these.
    left_out: Vec<(usize, f64, f64)>,
    /// Number of independent ways in which errors of the stated size would cause contradictions.
    ways: usize,
    share: f64,
    time: f64,
}

/// Estimated lasting errors of each kind and station, and of the clocks of the stations (6 K).
#[derive(Clone, Debug)]
pub struct LastingErrors {
    /// Errors that were removed, and the standard deviations of the remaining errors (6 K).
    pub value: Vec<f64>,
    /// See `value`.
    pub sigma: Vec<f64>,
    /// Share of the variance that drifts, and its correlation time.
    pub share: f64,
    /// See `share`.
    pub time: f64,
    /// Whether lasting errors could have caused contradictions.
    pub is_told: bool,
}

impl Lasting {
    /// Estimates lasting errors from the residuals about the path, with this number of instants combined;
    /// `before` was already removed from the measurements.
    fn estimate<const D: usize, const N: usize>(
        record: &Record<'_>,
        found: &Found<D, N>,
        prior: &Prior,
        columns: &[usize],
        before: &DVector<f64>,
        together: usize,
    ) -> Self {
        let (weight, slope) = weights(record, found, &found.lasting(record));
        let memory = memory(record, found);
        let parts: Vec<Range<usize>> = (0..record.len())
            .step_by(together)
            .map(|first| first..(first + together).min(record.len()))
            .collect();
        let of = |own: &Range<usize>| match together {
            1 => found.instant(own.start, &weight, columns),
            _ => found.together(own.clone(), &weight, columns),
        };
        let instants: Vec<Instant<D>> = parts.iter().map(of).collect();
        let mean =
            |own: &Range<usize>| record.time[own.clone()].iter().sum::<f64>() / own.len() as f64;
        let time: Vec<f64> = parts.iter().map(mean).collect();
        let rows = instants.iter().flat_map(|own| (0..own.rows.len()).map(|i| own.share(i)));
        let (sum, count) = rows.fold((0.0, 0.0), |(sum, count), v| (sum + v, count + 1.0));
        let share = sum / f64::max(count, 1.0);
        let left =
            |[own, part]: [f64; 2]| (1.0 - (own + part * share) * (1.0 - slope)).max(LEAST_FALL);
        let taper = (1.0 - share * (1.0 - slope), left(FALL_OF_SQUARES).sqrt());
        let length = length(instants.len(), memory / together as f64, columns.len());
        let blocks = Blocks::new(&time, &instants, before, length, taper);
        let mut lasting = Self::of(record, &blocks, prior, columns, memory);
        let variances = left(FALL_OF_VARIANCES);
        lasting.share_declared(record, &instants, before, variances, prior);
        lasting
    }

    /// Averages the errors over the grid.
    fn of(
        record: &Record<'_>,
        blocks: &Blocks,
        prior: &Prior,
        columns: &[usize],
        memory: f64,
    ) -> Self {
        let c = columns.len();
        let times_of_memory = lasting(record, memory);
        let stated = |column: &usize| {
            let given = prior.sigma[*column];
            if given.is_nan() { record.sigmas[*column] } else { given }
        };
        let sigmas: Vec<f64> = columns.iter().map(stated).collect();
        let mut grid = Grid::new(record, blocks, prior, columns);
        let mut lasting = Self {
            columns: columns.to_vec(),
            values: DVector::zeros(c),
            constant: DMatrix::zeros(c, c),
            drift: vec![0.0; c],
            smooth: vec![0.0; c],
            alone: vec![0.0; c],
            common: vec![0.0; c],
            growth: 0.0,
            redundant: blocks.count,
            nothing: 0.0,
            left_out: Vec::new(),
            memory,
            ways: blocks.ways(&sigmas),
            share: 0.0,
            time: f64::INFINITY,
        };
        let mut parts = Vec::new();
        let (mut whole, mut drifting, mut times) = (0.0, 0.0, 0.0);
        for Weighed { point, sums, probability: w, growth } in &grid.weighed_as_stated() {
            let (mean, covariance) = sums.constants(&point.constant);
            lasting.growth += w * growth;
            lasting.nothing += if point.is_nothing() { *w } else { 0.0 };
            if let Some(at) = point.alone {
                lasting.alone[at] += w;
            }
            // without heights and clocks, whose errors come last
            let end = record.heights().unwrap_or(record.width());
            let last = columns.partition_point(|column| *column < end);
            let pairs = columns.iter().zip(&point.drift);
            let drifts: Vec<f64> = pairs.map(|(c, v)| prior.unsurveyed(*c) * v).collect();
            let (constant, drift): (f64, f64) =
                (point.constant[..last].iter().sum(), drifts[..last].iter().sum());
            whole += w * (constant + drift);
            drifting += w * drift;
            let own = drifts[..last].iter().zip(&point.time);
            let weighted = own.filter(|(v, _)| **v > 0.0);
            times += w * weighted.map(|(v, time)| v * time).sum::<f64>();
            lasting.values += &mean * *w;
            lasting.constant += covariance * (w * growth);
            for (at, own) in drifts.iter().enumerate() {
                lasting.drift[at] += w * growth * own;
                // few contradictions tell how fast heights drift
                let is_height = record.heights() == Some(columns[at]);
                let over = if is_height { 0.0 } else { times_of_memory / point.time[at] };
                let left = point.kernel.averaged(over);
                lasting.smooth[at] += w * growth * own * left;
            }
            parts.push((*w, mean));
        }
        for (w, mean) in parts {
            let off = mean - &lasting.values;
            lasting.constant += &off * off.transpose() * w;
        }
        if whole > 0.0 {
            lasting.share = drifting / whole;
            lasting.time = if drifting > 0.0 { times / drifting } else { f64::INFINITY };
        }
        let margin = SURELY * (2.0 / blocks.count.max(1) as f64).sqrt();
        if lasting.growth <= 1.0 + margin {
            lasting.growth = 1.0;
        }
        lasting
    }

    /// Estimates the error that all stations of a kind share, which causes no contradictions. Its variance is
    /// assumed to equal that of the errors that cause contradictions, and to be at least the part of the
    /// stated variance that appears neither as scatter nor as contradictions.
    fn share_declared<const D: usize>(
        &mut self,
        record: &Record<'_>,
        instants: &[Instant<D>],
        before: &DVector<f64>,
        expected: f64,
        prior: &Prior,
    ) {
        let (c, k) = (self.columns.len(), record.width() / KINDS);
        let change = &self.values - before;
        // heights come after the kinds of the stations
        let (mut squares, mut shares) = ([0.0; KINDS + 1], [0.0; KINDS + 1]);
        for instant in instants {
            let left = instant.left(&change);
            for (i, ((column, w, ..), left)) in instant.rows.iter().zip(left).enumerate() {
                let kind = column / k;
                squares[kind] += w * left * left;
                shares[kind] += instant.share(i);
            }
        }
        for kind in 0..KINDS {
            let own: Vec<usize> = (0..c)
                .filter(|i| self.columns[*i] / k == kind && prior.sigma[self.columns[*i]].is_nan())
                .collect();
            if own.is_empty() || shares[kind] <= 0.0 || self.is_nothing() {
                continue;
            }
            let scatter = squares[kind] / shares[kind] / expected;
            let scatter = scatter * (1.0 + SURELY * (2.0 / shares[kind]).sqrt());
            let variance = |i: &usize| record.sigmas[self.columns[*i]].powi(2);
            // the error of a column that is singled out is not shared by all stations
            let contradicted = |i: &usize| {
                let squares = self.values[*i].powi(2) + self.drift[*i];
                (1.0 - self.alone[*i]).max(0.0) * squares / variance(i)
            };
            let contradicts = own.iter().map(contradicted).sum::<f64>() / own.len() as f64;
            let rest = (1.0 - scatter - contradicts).max(contradicts);
            for i in &own {
                self.common[*i] = (rest * variance(i)).sqrt();
            }
        }
    }

    /// Turns the estimates into uncertainty, for the case that nothing is removed although lasting errors
    /// cannot be excluded.
    fn not_removed(mut self, record: &Record<'_>) -> Self {
        self.constant += &self.values * self.values.transpose();
        self.values.fill(0.0);
        let own = |i: usize| {
            let variance = self.constant[(i, i)] + self.smooth[i];
            variance / record.sigmas[self.columns[i]].powi(2)
        };
        let most = (0..self.columns.len()).map(own).fold(0.0, f64::max);
        if most * self.memory < NEGLIGIBLE {
            self.constant.fill(0.0);
            self.drift.fill(0.0);
            self.smooth.fill(0.0);
        }
        self
    }

    fn is_zero(&self) -> bool {
        (0..self.columns.len()).all(|i| self.sigma(i) == 0.0)
    }

    /// Whether there are probably no lasting errors.
    pub fn is_nothing(&self) -> bool {
        self.nothing >= CERTAIN
    }

    /// Standard deviation of the noise relative to the stated one, if there are contradictions that determine
    /// it.
    pub fn noise(&self) -> Option<f64> {
        (self.redundant > 0).then(|| self.growth.sqrt())
    }

    fn sigma(&self, i: usize) -> f64 {
        (self.constant[(i, i)] + self.drift[i] + self.common[i].powi(2)).sqrt()
    }

    /// Returns the measurements less the estimated errors, except those of clocks; nan outside their domain.
    pub fn removed_from(&self, record: &Record<'_>) -> Vec<f64> {
        let width = record.width();
        let mut removed = record.values.to_vec();
        let values = self.columns.iter().zip(&self.values);
        for (column, value) in values.filter(|(column, _)| **column < width) {
            for row in removed.chunks_exact_mut(width) {
                row[*column] = in_domain(*column, width, row[*column] - value);
            }
        }
        removed
    }

    /// Adds the effect of the lasting errors to the covariance of the states (N, 3D, 3D).
    pub fn add_effect<const D: usize, const N: usize>(
        &self,
        setting: &mut Setting<'_, D, N>,
        found: &Found<D, N>,
        motion: ProcessNoise,
        covariance: &mut [f64],
    ) -> Result<(), Failure> {
        if self.is_zero() {
            return Ok(());
        }
        let (responses, spread) = answers(setting.record, found, &self.columns);
        let means = smoothed(setting, &responses, &spread, motion)?;
        let k = setting.record.width() / KINDS;
        let c = self.columns.len();
        let mut whole = self.constant.clone();
        for i in 0..c {
            whole[(i, i)] += self.smooth[i];
            for j in (0..c).filter(|j| self.columns[i] / k == self.columns[*j] / k) {
                whole[(i, j)] += self.common[i] * self.common[j];
            }
        }
        add_covariance::<N>(&means, &whole, covariance);
        Ok(())
    }

    /// Arranges the errors by kind and station (6 K, as in the prior).
    pub fn by_station(&self, prior: &Prior) -> LastingErrors {
        let mut value = vec![0.0; prior.sigma.len()];
        // columns without measurements keep their prior
        let mut sigma: Vec<f64> =
            prior.sigma.iter().map(|s| if s.is_nan() { 0.0 } else { *s }).collect();
        for (i, column) in self.columns.iter().enumerate() {
            value[*column] = self.values[i];
            sigma[*column] = self.sigma(i);
        }
        for (column, own, error) in &self.left_out {
            (value[*column], sigma[*column]) = (*own, *error);
        }
        // if there is only one way, errors as large as stated sometimes cause no contradiction by chance
        let is_told = self.ways >= if self.is_nothing() { TELLING } else { 1 };
        LastingErrors { value, sigma, share: self.share, time: self.time, is_told }
    }
}

/// Adds the effect of azimuth errors that depend on the direction to the covariance of the states
/// (N, 3D, 3D).
pub(in crate::trajectory) fn add_deviation<const D: usize, const N: usize>(
    setting: &mut Setting<'_, D, N>,
    found: &Found<D, N>,
    sigma: &[f64],
    motion: ProcessNoise,
    covariance: &mut [f64],
) -> Result<(), Failure> {
    let k = setting.record.width() / KINDS;
    let azimuths: Vec<usize> = (k..2 * k).collect();
    let (mut responses, spread) = answers(setting.record, found, &azimuths);
    for (station, response) in responses.iter_mut().enumerate() {
        let own = sigma.iter().skip(station).step_by(k);
        for (part, s) in response.chunks_exact_mut(D).zip(own) {
            part.iter_mut().for_each(|v| *v *= s);
        }
    }
    let means = smoothed(setting, &responses, &spread, motion)?;
    add_covariance::<N>(&means, &DMatrix::identity(k, k), covariance);
    Ok(())
}

/// Returns by how much errors of 1 in these columns move the positions of the instants, and the covariances
/// of the positions, as [`responses`] does.
fn answers<const D: usize, const N: usize>(
    record: &Record<'_>,
    found: &Found<D, N>,
    columns: &[usize],
) -> (Vec<Vec<f64>>, Vec<f64>) {
    let (weight, _) = weights(record, found, &found.lasting(record));
    let of = |t| found.instant(t, &weight, columns);
    let instants: Vec<Instant<D>> = (0..record.len()).map(of).collect();
    responses(&instants, columns.len())
}

/// Median duration of this number of instants; the median is used because instants may come in bursts.
fn lasting(record: &Record<'_>, instants: f64) -> f64 {
    let count = (instants as usize).clamp(1, record.len() - 1);
    let mut times: Vec<f64> = (count..record.len())
        .map(|t| (record.time[t] - record.time[t - count]) * instants / count as f64)
        .collect();
    upper_median(&mut times)
}

/// Returns the errors in these columns that measurements are corrected for: 0 except for clocks, which are
/// counted after the `width` columns of an instant.
fn clocks_of<const D: usize, const N: usize>(
    found: &Found<D, N>,
    columns: &[usize],
    width: usize,
) -> DVector<f64> {
    let of = |column: &usize| column.checked_sub(width).and_then(|own| found.clocks.get(own));
    DVector::from_iterator(columns.len(), columns.iter().map(|own| of(own).copied().unwrap_or(0.0)))
}

/// Estimates the errors of the clocks (K) together with lasting errors.
pub(in crate::trajectory) fn clocks<const D: usize, const N: usize>(
    record: &Record<'_>,
    found: &Found<D, N>,
    prior: &Prior,
) -> Vec<f64> {
    let (columns, width) = (prior.columns(record), record.width());
    let mut error = vec![0.0; width / KINDS];
    if columns.iter().all(|column| *column < width) || found.plots.count(D) < 2 {
        return error;
    }
    let begun = clocks_of(found, &columns, width);
    let together = together(record, found);
    let lasting = Lasting::estimate(record, found, prior, &columns, &begun, together);
    for (column, value) in columns.iter().zip(&lasting.values) {
        if let Some(station) = column.checked_sub(width) {
            error[station] = *value;
        }
    }
    error
}

/// Estimates lasting errors, and removes their constant part until it hardly changes.
pub(in crate::trajectory) fn rounds<const D: usize, const N: usize>(
    setting: &mut Setting<'_, D, N>,
    mut found: Found<D, N>,
    prior: &Prior,
) -> Result<(Found<D, N>, Option<Lasting>), Failure> {
    let columns = prior.columns(setting.record);
    if columns.is_empty() || found.plots.count(D) < 2 {
        return Ok((found, None));
    }
    let width = setting.record.width();
    let begun = clocks_of(&found, &columns, width);
    let together = together(setting.record, &found);
    let mut lasting = Lasting::estimate(setting.record, &found, prior, &columns, &begun, together);
    let is_distrusted = |at: &usize| setting.record.robust && lasting.alone[*at] >= DISTRUSTED;
    if let Some(at) = (0..columns.len()).find(is_distrusted) {
        let left_out = (columns[at], lasting.values[at], lasting.sigma(at));
        let (found, rest) = without(setting, found, prior, columns[at])?;
        let rest = rest.map(|mut rest| {
            rest.left_out.push(left_out);
            rest
        });
        return Ok((found, rest));
    }
    if lasting.is_nothing() {
        let lasting = lasting.not_removed(setting.record);
        return Ok((found, Some(lasting)));
    }
    for round in 1..=ROUNDS {
        let values = lasting.removed_from(setting.record);
        let measured = Rc::new(Measured::new(setting.record, values));
        found = found.without_outliers(setting, &measured)?;
        let mut removed = lasting.values;
        // measurements are corrected for the clocks before
        (0..columns.len()).filter(|i| columns[*i] >= width).for_each(|i| removed[i] = begun[i]);
        lasting = Lasting::estimate(setting.record, &found, prior, &columns, &removed, together);
        let change = &lasting.values - &removed;
        let small = (0..columns.len()).all(|i| change[i].abs() <= SETTLED * lasting.sigma(i));
        lasting.nothing = 0.0;
        if small || round == ROUNDS {
            // the result must be the values that were removed
            lasting.values = removed;
            break;
        }
    }
    Ok((found, Some(lasting)))
}

/// Repeats the estimation without one column of all instants.
fn without<const D: usize, const N: usize>(
    setting: &mut Setting<'_, D, N>,
    found: Found<D, N>,
    prior: &Prior,
    column: usize,
) -> Result<(Found<D, N>, Option<Lasting>), Failure> {
    let mut values = setting.record.values.to_vec();
    values.iter_mut().skip(column).step_by(setting.record.width()).for_each(|v| *v = f64::NAN);
    let record = Record { values: &values, ..*setting.record };
    let smoother = std::mem::take(&mut setting.smoother);
    let mut own = Setting { record: &record, motion: setting.motion, smoother };
    let measured = Rc::new(Measured::new(&record, values.clone()));
    let found = found.without_outliers(&mut own, &measured)?;
    let rest = rounds(&mut own, found, prior);
    setting.smoother = own.smoother;
    rest
}
