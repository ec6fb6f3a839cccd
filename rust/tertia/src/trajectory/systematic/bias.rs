//! Constant biases of the stations, from contradictions between the measurements of each instant.
//!
//! To first order, biases b add `A_t b` to the position of an instant, where `A_t` is its least-squares
//! solution, and `(I − H_t) b` to its residuals, with `H_t = J_t A_t`. The biases follow from the residuals
//! alone; nothing is assumed about the positions.

use crate::base::small::Vector;
use crate::smoothing::ProcessNoise;
use crate::trajectory::instants::instant::{Instant, Seen, responses};
use crate::trajectory::instants::tukey::{TAPERED, TUKEY, chance, scale, tukey};
use crate::trajectory::measured::{Measured, Record, in_domain};
use crate::trajectory::path::Plots;
use crate::trajectory::path::failure::Failure;
use crate::trajectory::search::fit::{Found, Setting, known};
use nalgebra::{DMatrix, DVector, SMatrix};
use std::rc::Rc;

/// Change of a bias, in standard errors, that ends the rounds.
const SETTLED: f64 = 0.01;
/// Information about a bias, relative to that with known positions, below which it is rounding.
const UNOBSERVABLE: f64 = 1e-9;
/// Largest share of the information that may come from errors of the positions.
const SPURIOUS: f64 = 0.1;
/// Component in an unobservable direction from which a bias is named.
const NAMED: f64 = 0.1;

/// Estimated biases.
#[derive(Clone, Debug)]
pub(in crate::trajectory) struct Biases {
    /// Columns of a record's rows that have biases.
    pub columns: Vec<usize>,
    pub values: DVector<f64>,
    pub covariance: DMatrix<f64>,
    /// Change of the values by a change of their scores.
    inverse: DMatrix<f64>,
    /// Shifts of the positions by biases of 1, (P, N, D), nan where unknown, and the covariances of the
    /// positions (N, D, D).
    responses: Vec<Vec<f64>>,
    spread: Vec<f64>,
}

impl Biases {
    /// Estimates the biases from the residuals about the smooth path.
    pub fn estimate<const D: usize, const N: usize>(
        record: &Record<'_>,
        found: &Found<D, N>,
        columns: &[usize],
    ) -> Result<Self, Failure> {
        let (weight, slope) = weights(record, found, &vec![0.0; record.width()]);
        let instants: Vec<Instant<D>> =
            (0..record.len()).map(|t| found.instant(t, &weight, columns)).collect();
        let p = columns.len();
        let (mut information, mut scores) = (DMatrix::zeros(p, p), DVector::zeros(p));
        let mut size = DVector::<f64>::zeros(p);
        for instant in &instants {
            instant.add_information(|i| instant.rows[i].1, &mut information);
            for (kept, (own, w, r, ..)) in instant.kept.chunks_exact(p).zip(&instant.rows) {
                for a in 0..p {
                    scores[a] += kept[a] * w * r;
                    if *own == columns[a] {
                        size[a] += w;
                    }
                }
            }
        }
        let spurious = spurious(record, found, &weight, columns);
        let size = size.map(f64::sqrt);
        let linear = inverted(&information, &spurious, &size, columns)?;
        let inverse = &linear / slope;
        let values = &inverse * scores;
        let covariance = covariance(record, &instants, &inverse, &values);
        let (responses, spread) = responses(&instants, p);
        let columns = columns.to_vec();
        Ok(Self { columns, values, covariance, inverse: linear, responses, spread })
    }

    /// Adds the biases of the rounds before, which were removed from the measurements.
    pub fn added_to(mut self, before: Option<Self>) -> Self {
        if let Some(before) = before {
            self.values += before.values;
        }
        self
    }

    /// Whether all biases are far below their standard errors.
    pub fn is_small(&self) -> bool {
        self.values.iter().enumerate().all(|(i, value)| value.abs() <= SETTLED * self.sigma(i))
    }

    pub fn sigma(&self, i: usize) -> f64 {
        self.covariance[(i, i)].sqrt()
    }

    /// Returns the measurements less the biases; nan outside their domain.
    pub fn removed_from(&self, values: &[f64], width: usize) -> Vec<f64> {
        let mut removed = values.to_vec();
        for (column, bias) in self.columns.iter().zip(&self.values) {
            for row in removed.chunks_exact_mut(width) {
                row[*column] = in_domain(*column, width, row[*column] - bias);
            }
        }
        removed
    }

    /// Subtracts the effect of biases that errors with these scores cause from the shifts of the positions
    /// (N, D).
    pub fn remove_from_shifts(&self, scores: &DVector<f64>, shift: &mut [f64]) {
        let values = &self.inverse * scores;
        for (response, value) in self.responses.iter().zip(&values) {
            shift.iter_mut().zip(response).for_each(|(own, one)| *own -= value * one);
        }
    }

    /// Adds the effect of the uncertainty of the biases to the covariance of the states (N, 3D, 3D).
    pub fn add_effect<const D: usize, const N: usize>(
        &self,
        setting: &mut Setting<'_, D, N>,
        motion: ProcessNoise,
        covariance: &mut [f64],
    ) -> Result<(), Failure> {
        let means = smoothed(setting, &self.responses, &self.spread, motion)?;
        add_covariance::<N>(&means, &self.covariance, covariance);
        Ok(())
    }
}

/// Returns by how much biases of 1 change the smoothed states, (P, N, 3D).
pub(in crate::trajectory) fn smoothed<const D: usize, const N: usize>(
    setting: &mut Setting<'_, D, N>,
    responses: &[Vec<f64>],
    spread: &[f64],
    motion: ProcessNoise,
) -> Result<Vec<Vec<f64>>, Failure> {
    let mut means = Vec::new();
    for response in responses {
        let plots = Plots { position: response.clone(), covariance: spread.to_vec() };
        let track = plots.track(setting.record.time, D)?;
        let mut mean = setting.smoother.smooth(&track, known(motion), 0).mean;
        mean.iter_mut().filter(|v| v.is_nan()).for_each(|v| *v = 0.0);
        means.push(mean);
    }
    Ok(means)
}

/// Adds the effect of biases of this covariance to the covariances of the states (N, 3D, 3D).
pub(in crate::trajectory) fn add_covariance<const N: usize>(
    means: &[Vec<f64>],
    of_biases: &DMatrix<f64>,
    covariance: &mut [f64],
) {
    let p = means.len();
    for (t, own) in covariance.chunks_exact_mut(N * N).enumerate() {
        let response = DMatrix::from_fn(N, p, |i, a| means[a][t * N + i]);
        let added = &response * of_biases * response.transpose();
        for i in 0..N {
            for j in 0..N {
                own[i * N + j] += 0.5 * (added[(i, j)] + added[(j, i)]);
            }
        }
    }
}

/// Returns weights over σ², 0 for measurements that are not used, and the mean slope of Tukey's scores over
/// their mean weight. Columns may have lasting errors, with the variances `lasting` in units of the stated
/// ones: residuals that are due to these do not count as contradictions.
pub(in crate::trajectory) fn weights<const D: usize, const N: usize>(
    record: &Record<'_>,
    found: &Found<D, N>,
    lasting: &[f64],
) -> (Vec<f64>, f64) {
    let measured = &found.measured;
    let mut residual = vec![f64::NAN; measured.len()];
    for t in 0..record.len() {
        for (m, row, _) in found.rows(t) {
            let column = measured.column[m];
            if !found.is_outlier(t * record.width() + column) {
                residual[m] = row.residual / (1.0 + lasting[column]).sqrt();
            }
        }
    }
    let mut sizes: Vec<f64> = residual.iter().filter(|r| !r.is_nan()).map(|r| r.abs()).collect();
    let robust = record.robust && !sizes.is_empty();
    let scale = if robust { scale(&mut sizes) } else { f64::INFINITY };
    let (mut slope, mut total) = (0.0, 0.0);
    for r in &sizes {
        let square = (r / scale / TUKEY).powi(2).min(1.0);
        slope += (1.0 - square) * (1.0 - 5.0 * square);
        total += (1.0 - square) * (1.0 - square);
    }
    let mut weight = vec![0.0; measured.len()];
    for (m, r) in residual.iter().enumerate().filter(|(_, r)| !r.is_nan()) {
        weight[m] = tukey(r / scale) * measured.precision(m).powi(2);
    }
    (weight, slope / total)
}

/// Returns the information that errors of the positions alone generate.
fn spurious<const D: usize, const N: usize>(
    record: &Record<'_>,
    found: &Found<D, N>,
    weight: &[f64],
    columns: &[usize],
) -> DMatrix<f64> {
    let mut sum = DMatrix::zeros(columns.len(), columns.len());
    for t in 0..record.len() {
        let covariance = &found.path.covariance[t * D * D..][..D * D];
        let matrix = SMatrix::<f64, D, D>::from_fn(|i, j| covariance[i * D + j]);
        let Some(root) = matrix.cholesky().filter(|_| covariance.iter().all(|v| v.is_finite()))
        else {
            continue;
        };
        let place = found.place(t);
        for shift in root.l().column_iter() {
            let at = |sign: f64| {
                let by: Vector<D> = std::array::from_fn(|i| sign * shift[i]);
                let own = Seen { t, place: place.moved(&by), velocity: [0.0; D] };
                Instant::new(&found.measured, own, weight, columns, found.anchor[t])
            };
            let (mut ahead, behind) = (at(1.0), at(-1.0));
            for (a, b) in ahead.kept.iter_mut().zip(&behind.kept) {
                *a = (*a - b) / 2.0;
            }
            ahead.add_information(|i| ahead.rows[i].1, &mut sum);
        }
    }
    sum
}

/// Returns the inverse of the information, or the biases that it does not determine.
fn inverted(
    information: &DMatrix<f64>,
    spurious: &DMatrix<f64>,
    size: &DVector<f64>,
    columns: &[usize],
) -> Result<DMatrix<f64>, Failure> {
    let p = columns.len();
    let named = |is: &dyn Fn(usize) -> bool| -> Vec<usize> {
        (0..p).filter(|&i| is(i)).map(|i| columns[i]).collect()
    };
    let unusable = named(&|i| size[i] == 0.0);
    if !unusable.is_empty() {
        return Err(Failure::Unusable(unusable));
    }
    let scaled =
        |matrix: &DMatrix<f64>| DMatrix::from_fn(p, p, |i, j| matrix[(i, j)] / (size[i] * size[j]));
    let doubtful = scaled(information) - scaled(spurious) / SPURIOUS;
    let eigen = doubtful.symmetric_eigen();
    let blind: Vec<usize> = (0..p).filter(|&i| eigen.eigenvalues[i] <= UNOBSERVABLE).collect();
    if !blind.is_empty() {
        let share = |i: usize| -> f64 {
            blind.iter().map(|&b| eigen.eigenvectors[(i, b)].powi(2)).sum::<f64>().sqrt()
        };
        return Err(Failure::Unobservable(named(&|i| share(i) > NAMED)));
    }
    let inverse =
        scaled(information).try_inverse().ok_or(Failure::Unobservable(columns.to_vec()))?;
    Ok(scaled(&inverse))
}

/// Covariance of the biases: that of the scores between inverse slopes. Errors that are correlated over time
/// make it larger.
fn covariance<const D: usize>(
    record: &Record<'_>,
    instants: &[Instant<D>],
    inverse: &DMatrix<f64>,
    values: &DVector<f64>,
) -> DMatrix<f64> {
    let (p, width) = (values.len(), record.width());
    let left: Vec<Vec<f64>> = instants.iter().map(|instant| instant.left(values)).collect();
    let (mut squares, mut shares) = (vec![0.0; width], vec![0.0; width]);
    for (instant, left) in instants.iter().zip(&left) {
        for (i, (column, w, ..)) in instant.rows.iter().enumerate() {
            squares[*column] += w * w * left[i] * left[i];
            shares[*column] += w * w * instant.share(i);
        }
    }
    let factor = if record.robust { TAPERED } else { 1.0 };
    let variance = |column: usize| {
        let found = squares[column] / shares[column].max(f64::MIN_POSITIVE);
        (record.sigmas[column].powi(2) * factor).max(found)
    };
    let mut noise = DMatrix::zeros(p, p);
    let mut parts = vec![Vec::with_capacity(instants.len()); p];
    for (instant, left) in instants.iter().zip(&left) {
        let rows = &instant.rows;
        let spread = |i: usize| rows[i].1.powi(2) * variance(rows[i].0);
        instant.add_information(spread, &mut noise);
        let mut score = vec![0.0; p];
        for ((kept, (_, w, ..)), left) in instant.kept.chunks_exact(p).zip(rows).zip(left) {
            for a in 0..p {
                score[a] += kept[a] * w * left;
            }
        }
        parts.iter_mut().zip(&score).for_each(|(parts, part)| parts.push(*part));
    }
    let root: Vec<f64> = parts.iter().map(|part| repeats(part).sqrt()).collect();
    let whole = inverse * noise * inverse;
    DMatrix::from_fn(p, p, |i, j| whole[(i, j)] * root[i] * root[j])
}

/// Number of instants that are worth one instant with independent errors, at least 1: one plus twice the sum
/// of the autocorrelations, as long as pairs of them are positive (Geyer 1992). The first pair has to exceed
/// chance.
fn repeats(series: &[f64]) -> f64 {
    let whole: f64 = series.iter().map(|v| v * v).sum();
    let mut total = 0.0;
    for lag in (1..series.len() / 2).step_by(2) {
        let products = || {
            let lagged = [lag, lag + 1].map(|one| series[one..].iter().zip(series));
            lagged.into_iter().flatten().map(|(late, early)| late * early)
        };
        let pair: f64 = products().sum();
        let least = match lag {
            1 => chance() * products().map(|v| v * v).sum::<f64>().sqrt(),
            _ => 0.0,
        };
        // nan ends the sum, too
        if pair.partial_cmp(&least) != Some(std::cmp::Ordering::Greater) {
            break;
        }
        total += pair / whole;
    }
    1.0 + 2.0 * total
}

/// Estimates biases in rounds; each round starts from measurements without the biases of the rounds before.
pub(in crate::trajectory) fn rounds<const D: usize, const N: usize>(
    setting: &mut Setting<'_, D, N>,
    mut found: Found<D, N>,
    columns: &[usize],
    most: usize,
) -> Result<(Found<D, N>, Option<Biases>), Failure> {
    let mut total = None;
    for _ in 0..if columns.is_empty() { 0 } else { most } {
        let change = Biases::estimate(setting.record, &found, columns)?;
        let small = change.is_small();
        let sum = change.added_to(total);
        let values = sum.removed_from(setting.record.values, setting.record.width());
        let measured = Rc::new(Measured::new(setting.record, values));
        found = found.without_outliers(setting, &measured)?;
        total = Some(sum);
        if small {
            break;
        }
    }
    Ok((found, total))
}
