//! Unknowns that all instants have in common, beside lasting errors of the stations, which can look alike.
//!
//! About located instants, a measurement with the standard deviation σ has the residual
//! `σ⁻¹ (g·x + c·θ) + e`, with the change x of position and emission, the common unknowns θ, such as an error
//! of the speed of the signals, and the error e of the station. x is eliminated by projection. The errors of
//! the stations have the prior N(0, B²) in units of σ, and the posterior of θ is the mean over several sizes
//! B, weighted by their evidence.

use crate::base::small::{Factor, Matrix, Vector, add_multiple, add_outer, dot};
use crate::location::solver::record::{NOWHERE, Record};
use crate::sensors::{Measurement, Row};
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// Standard deviations of the lasting errors, in units of those of the measurements.
const SIZES: [f64; 7] = [0.35, 0.7, 1.4, 2.8, 5.6, 11.2, 22.4];
/// Prior odds of no lasting errors against any.
const NOTHING: f64 = 2.0;

/// Normal equations of the common unknowns and of the errors of the stations, in this order.
#[derive(Clone)]
pub(in crate::location) struct Sums {
    /// Number of common unknowns.
    unknowns: usize,
    information: DMatrix<f64>,
    score: DVector<f64>,
    /// Sum of the squared residuals, and redundant measurements.
    pub square: f64,
    free: f64,
    /// Numbers of measurements and of outliers.
    pub measured: f64,
    pub outliers: f64,
}

/// The posterior of the unknowns: the mean over all sizes of the lasting errors, or that for one size.
pub(in crate::location) struct Posterior {
    /// Logarithm of the evidence.
    pub evidence: f64,
    pub mean: Vec<f64>,
    pub covariance: DMatrix<f64>,
    /// Probability that the stations have no lasting errors.
    pub nothing: f64,
    /// Part of the squared residuals that is not explained, and the number of unknowns that explain the rest.
    left: f64,
    explained: f64,
}

impl Sums {
    /// Returns sums over nothing for these numbers of common unknowns and of errors of stations.
    pub fn new(unknowns: usize, lasting: usize) -> Self {
        let count = unknowns + lasting;
        let (information, score) = (DMatrix::zeros(count, count), DVector::zeros(count));
        Self { unknowns, information, score, square: 0.0, free: 0.0, measured: 0.0, outliers: 0.0 }
    }

    /// Whether the stations may have lasting errors.
    pub fn have_lasting(&self) -> bool {
        self.score.len() > self.unknowns
    }

    /// Adds the measurements of a located instant that are no outliers. `effects` appends the columns of the
    /// unknowns that a measurement depends on, and its whitened derivatives. O(K²) for K unknowns.
    pub fn add<const D: usize, const N: usize>(
        &mut self,
        record: &Record<D, N>,
        outlier: &[bool],
        effects: impl Fn(&Measurement<D>, &Row<N>, &mut Vec<(usize, f64)>),
    ) {
        let (mut normal, mut right): (Matrix<N>, Vector<N>) = ([[0.0; N]; N], [0.0; N]);
        let mut cross: Vec<Vector<N>> = vec![[0.0; N]; self.score.len()];
        let (mut square, mut count) = (0.0, 0);
        let kept = |place: &usize| *place == NOWHERE || outlier.get(*place) != Some(&true);
        let rows = record.measurements.iter().zip(&record.rows).zip(&record.places);
        let rows: Vec<_> = rows.filter(|(_, place)| kept(place)).map(|(row, _)| row).collect();
        self.measured += record.rows.len() as f64;
        self.outliers += (record.rows.len() - rows.len()) as f64;
        for (_, row) in &rows {
            add_multiple(&mut right, row.residual, &row.gradient);
            add_outer(&mut normal, 1.0, &row.gradient);
            square += row.residual * row.residual;
            count += 1;
        }
        let Some(factor) = Factor::try_new(&normal, 0.0) else { return };
        let mut own = Vec::new();
        for (m, row) in rows {
            own.clear();
            effects(m, row, &mut own);
            for &(a, slope) in &own {
                add_multiple(&mut cross[a], slope, &row.gradient);
                own.iter().for_each(|(b, other)| self.information[(a, *b)] += slope * other);
                self.score[a] += slope * row.residual;
            }
        }
        let solved: Vec<_> = cross.iter().map(|own| factor.solve(own)).collect();
        for (a, solved) in solved.iter().enumerate() {
            self.score[a] -= dot(solved, &right);
            for (b, own) in cross.iter().enumerate() {
                self.information[(a, b)] -= dot(solved, own);
            }
        }
        self.square += square - dot(&right, &factor.solve(&right));
        self.free += (count - N as i32) as f64;
    }

    /// Adds the sums of other instants.
    pub fn join(&mut self, other: &Self) {
        self.information += &other.information;
        self.score += &other.score;
        self.square += other.square;
        self.free += other.free;
        self.measured += other.measured;
        self.outliers += other.outliers;
    }

    /// Returns the standard deviation of an unknown that follows from the differences between parts of the
    /// instants, at the likeliest size of the lasting errors. None if the information is not finite.
    pub fn spread(&self, parts: &[Self], prior: &[f64], at: &[f64], unknown: usize) -> Option<f64> {
        let likeliest = std::iter::once(0.0).chain(SIZES).filter_map(|size| {
            let evidence = self.posterior(prior, at, size)?.evidence;
            Some((if size == 0.0 { NOTHING.ln() } else { 0.0 } + evidence, size))
        });
        let (_, size) = likeliest.max_by(|a, b| a.0.total_cmp(&b.0))?;
        let Solved { deviation, start, off, factor, .. } = self.solved(prior, at, size)?;
        let change = factor.solve(&off).component_mul(&deviation) - start;
        let influence = factor.inverse().column(unknown).component_mul(&deviation);
        let influence = deviation[unknown] * influence;
        let off = |part: &Self| influence.dot(&(&part.score - &part.information * &change));
        let count = parts.len() as f64;
        Some(
            (parts.iter().map(|part| off(part).powi(2)).sum::<f64>() * count / (count - 1.0))
                .sqrt(),
        )
    }

    /// Returns the factor, at least 1, of the variance of the noise, for unknowns with these standard
    /// deviations about 0 that are linearised about `at`.
    pub fn noise(&self, prior: &[f64], at: &[f64]) -> Option<f64> {
        let widest = self.posterior(prior, at, SIZES[SIZES.len() - 1])?;
        Some((widest.left / (self.free - widest.explained).max(1.0)).max(1.0))
    }

    /// Divides by the factor of the variance of the noise.
    pub fn reduce(&mut self, noise: f64) {
        self.information /= noise;
        self.score /= noise;
        self.square /= noise;
    }

    /// Returns the posterior of unknowns with these standard deviations about 0 that are linearised about `at`.
    pub fn mixed(&self, prior: &[f64], at: &[f64]) -> Option<Posterior> {
        let each = -(SIZES.len() as f64).ln();
        let odds = std::iter::once(NOTHING.ln()).chain(SIZES.map(|_| each));
        let sizes = std::iter::once(0.0).chain(SIZES);
        let mut all = Vec::with_capacity(SIZES.len() + 1);
        for (odds, size) in odds.zip(sizes) {
            let one = self.posterior(prior, at, size)?;
            all.push((odds + one.evidence, one));
        }
        let best = all.iter().map(|(ln, _)| *ln).fold(f64::MIN, f64::max);
        let total: f64 = all.iter().map(|(ln, _)| (ln - best).exp()).sum();
        let mean_of = |of: &dyn Fn(&Posterior) -> f64| -> f64 {
            all.iter().map(|(ln, one)| (ln - best).exp() * of(one)).sum::<f64>() / total
        };
        let mean: Vec<f64> = (0..self.unknowns).map(|a| mean_of(&|one| one.mean[a])).collect();
        let covariance = DMatrix::from_fn(self.unknowns, self.unknowns, |a, b| {
            let off = |one: &Posterior, i: usize| one.mean[i] - mean[i];
            mean_of(&|one| one.covariance[(a, b)] + off(one, a) * off(one, b))
        });
        let (left, explained) = (mean_of(&|one| one.left), mean_of(&|one| one.explained));
        let (evidence, nothing) = (best + total.ln(), mean_of(&|one| one.nothing));
        Some(Posterior { evidence, mean, covariance, nothing, left, explained })
    }

    /// Returns the posterior if the errors of the stations have this size. None if the information is not
    /// finite.
    pub fn posterior(&self, prior: &[f64], at: &[f64], size: f64) -> Option<Posterior> {
        let (count, known) = (self.score.len(), self.unknowns);
        let Solved { off, square, factor, .. } = self.solved(prior, at, size)?;
        let (solved, inverse) = (factor.solve(&off), factor.inverse());
        let gain = off.dot(&solved);
        Some(Posterior {
            evidence: 0.5 * gain - factor.l_dirty().diagonal().map(f64::ln).sum(),
            mean: (0..known).map(|a| prior[a] * solved[a] - at[a]).collect(),
            covariance: DMatrix::from_fn(known, known, |a, b| {
                prior[a] * prior[b] * inverse[(a, b)]
            }),
            nothing: f64::from(size == 0.0),
            left: square - gain,
            explained: count as f64 - inverse.trace(),
        })
    }

    /// Returns the normal equations about 0 instead of `at`. None if the information is not finite.
    fn solved(&self, prior: &[f64], at: &[f64], size: f64) -> Option<Solved> {
        let (count, known) = (self.score.len(), self.unknowns);
        let deviation = DVector::from_fn(count, |i, _| if i < known { prior[i] } else { size });
        let start = DVector::from_fn(count, |i, _| if i < known { at[i] } else { 0.0 });
        let moved = &self.information * &start;
        let off = (&self.score + &moved).component_mul(&deviation);
        let square = self.square + 2.0 * start.dot(&self.score) + start.dot(&moved);
        let mut whole = DMatrix::from_fn(count, count, |i, j| {
            deviation[i] * self.information[(i, j)] * deviation[j]
        });
        (0..count).for_each(|i| whole[(i, i)] += 1.0);
        Some(Solved { deviation, start, off, square, factor: whole.cholesky()? })
    }
}

/// Normal equations of unknowns in units of their standard deviations before.
struct Solved {
    deviation: DVector<f64>,
    start: DVector<f64>,
    off: DVector<f64>,
    square: f64,
    factor: Cholesky<f64, Dyn>,
}

impl Posterior {
    /// Returns the standard deviation of an unknown.
    pub fn sigma(&self, unknown: usize) -> f64 {
        self.covariance[(unknown, unknown)].sqrt()
    }

    /// Returns the Mahalanobis distance of these unknowns from 0.
    pub fn distance(&self, unknowns: std::ops::Range<usize>) -> f64 {
        let mean = DVector::from_column_slice(&self.mean[unknowns.clone()]);
        let (from, count) = (unknowns.start, unknowns.len());
        let own = self.covariance.view((from, from), (count, count)).into_owned();
        own.cholesky().map_or(0.0, |factor| mean.dot(&factor.solve(&mean)).sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_within;

    /// Sums of measurements with the path `slope(k, t)` for station k at instant t, without unknowns of the
    /// instants.
    fn sums(residual: impl Fn(usize, usize) -> f64, slope: impl Fn(usize, usize) -> f64) -> Sums {
        let (stations, instants) = (4, 50);
        let mut sums = Sums::new(1, stations);
        for (k, t) in (0..stations).flat_map(|k| (0..instants).map(move |t| (k, t))) {
            let (u, d) = (residual(k, t), -slope(k, t));
            sums.information[(0, 0)] += d * d;
            sums.information[(0, 1 + k)] += d;
            sums.information[(1 + k, 0)] += d;
            sums.information[(1 + k, 1 + k)] += 1.0;
            sums.score[0] += d * u;
            sums.score[1 + k] += u;
            sums.square += u * u;
            sums.free += 1.0;
        }
        sums
    }

    /// Noise of unit variance without a mean in pairs of instants.
    fn noise(k: usize, t: usize) -> f64 {
        if (t / 2 + k).is_multiple_of(2) == t.is_multiple_of(2) { 1.0 } else { -1.0 }
    }

    /// Mean about 0 and standard deviation of an unknown that is linearised about `at`.
    fn told(mut sums: Sums, at: f64) -> (f64, f64) {
        let noise = sums.noise(&[PRIOR], &[at]).unwrap();
        sums.reduce(noise);
        let told = sums.mixed(&[PRIOR], &[at]).unwrap();
        (at + told.mean[0], told.sigma(0))
    }

    const PRIOR: f64 = 0.02;

    #[test]
    fn without_lasting_errors_an_unknown_is_nearly_as_certain_as_alone() {
        let slope = |k: usize, t: usize| 100.0 + 10.0 * (k * t % 7) as f64;
        let (mean, sigma) = told(sums(|k, t| noise(k, t) - 0.01 * slope(k, t), slope), 0.0);
        assert_within(3.0 * sigma, mean, 0.01);
        assert!(sigma < 2e-3, "{sigma}");
    }

    #[test]
    fn errors_of_stations_that_differ_are_not_common() {
        let slope = |k: usize, t: usize| 100.0 + 10.0 * (k * t % 7) as f64;
        let error = [3.0, -1.0, 4.0, 1.0];
        let (mean, sigma) = told(sums(|k, t| noise(k, t) - error[k], slope), 0.0);
        assert!(mean.abs() < 2.5 * sigma, "{mean} {sigma}");
        // without such errors, the mean of the errors would be that of the unknown
        let alone = sums(|k, t| noise(k, t) - error[k], slope);
        let alone = alone.posterior(&[PRIOR], &[0.0], 0.0).unwrap();
        assert!(alone.distance(0..1) > 10.0, "{}", alone.mean[0]);
    }

    #[test]
    fn the_prior_mean_is_0_wherever_the_search_ended() {
        let slope = |k: usize, t: usize| 100.0 + 10.0 * (k * t % 7) as f64;
        let at = |share: f64| {
            let off = sums(|k, t| noise(k, t) + (share - 0.01) * slope(k, t), slope);
            told(off, share)
        };
        let (near, far) = (at(0.009), at(0.013));
        assert_within(1e-12, near.0, far.0);
        assert_within(1e-12, near.1, far.1);
    }
}
