//! The speed of the signals and lasting errors of the stations, which can look alike.
//!
//! About a speed that is too low by the relative difference δ, a measurement of station k with the standard
//! deviation σ and the path d has the residual `σ⁻¹ (g·x − d δ) + e`, with the change x of position and
//! emission and the error e of the station. x is eliminated by projection. The errors of the stations have
//! the prior N(0, B²) in units of σ, and the posterior of δ is the mean over several sizes B, weighted by
//! their evidence.

use super::speed::{FAULT, Speed};
use crate::base::small::{Factor, Matrix, Vector, add_multiple, add_outer, dot};
use crate::location::search::fix::{Instant, Solution, Status};
use crate::location::solver::record::{NOWHERE, Record};
use crate::location::solver::{Locator, Workspace};
use crate::sensors::KINDS;
use nalgebra::{DMatrix, DVector};

/// Standard deviations of the lasting errors, in units of those of the measurements.
const SIZES: [f64; 7] = [0.35, 0.7, 1.4, 2.8, 5.6, 11.2, 22.4];
/// Prior odds of no lasting errors against any.
const NOTHING: f64 = 2.0;
/// Share of outliers, and deviation of the speed in its standard deviations, above which the stated speed is
/// suspected; deviation above which it is wrong.
const MANY: f64 = 0.2;
const SUSPECT: f64 = 3.0;
pub(in crate::location) const WRONG: f64 = 6.0;
/// Largest number of stations for which lasting errors are considered, because the cost grows with the cube.
const MOST: usize = 64;

/// Normal equations of the speed and, unless there are too many stations, of their errors, in this order.
pub(in crate::location) struct Sums {
    information: DMatrix<f64>,
    score: DVector<f64>,
    /// Sum of the squared residuals, and redundant measurements.
    square: f64,
    free: f64,
    /// Numbers of measurements and of outliers.
    measured: f64,
    outliers: f64,
}

/// The posterior of the speed for one size of the lasting errors.
struct Posterior {
    /// Logarithm of the evidence.
    evidence: f64,
    mean: f64,
    variance: f64,
    /// Part of the squared residuals that is not explained, and the number of unknowns that explain the rest.
    left: f64,
    explained: f64,
}

impl Locator {
    /// Returns the speed if the stations may have lasting errors. `speed` is what fits best without such
    /// errors, and `prior` the standard deviation of the share before. O(N K² + K³) for K stations.
    pub(in crate::location) fn beside_lasting<'a, const D: usize>(
        &self,
        instants: impl Iterator<Item = Instant<'a>>,
        speed: Speed,
        prior: f64,
        workspace: &mut Workspace<D>,
    ) -> Speed {
        let sums = self.speed_sums(instants, speed.share, workspace);
        sums.and_then(|sums| sums.speed(speed, prior)).unwrap_or(speed)
    }

    /// Whether the stated speed, whose share has this standard deviation, may be wrong: the residuals look
    /// like those of another speed, or many measurements are outliers. O(N M + N K² + K³) for K stations.
    pub(in crate::location) fn suspects_speed<'a, const D: usize>(
        &self,
        instants: impl Iterator<Item = Instant<'a>>,
        prior: f64,
        workspace: &mut Workspace<D>,
    ) -> bool {
        let Some(sums) = self.speed_sums(instants, 0.0, workspace) else { return false };
        let has_many = sums.outliers > MANY * sums.measured;
        let speed = sums.speed(Speed::EXACT, prior);
        has_many || speed.is_some_and(|speed| speed.share.abs() > SUSPECT * speed.sigma)
    }

    /// Returns the normal equations of all instants if the signals are faster by this share; none without
    /// instants.
    pub(in crate::location) fn speed_sums<'a, const D: usize>(
        &self,
        instants: impl Iterator<Item = Instant<'a>>,
        share: f64,
        workspace: &mut Workspace<D>,
    ) -> Option<Sums> {
        let mut instants = instants.peekable();
        let stations = instants.peek()?.values.len() / KINDS;
        let mut sums = Sums::new(if stations > MOST { 0 } else { stations });
        instants.for_each(|instant| self.add_instant(&instant, share, &mut sums, workspace));
        Some(sums)
    }

    /// Adds the measurements of an instant if the signals are faster by this share.
    fn add_instant<const D: usize>(
        &self,
        instant: &Instant<'_>,
        share: f64,
        sums: &mut Sums,
        workspace: &mut Workspace<D>,
    ) {
        let (fix, Solution { position, outlier, .. }) = self.located_at(share, instant, workspace);
        if fix.status != Status::None {
            return;
        }
        let p: Vector<D> = std::array::from_fn(|i| position[i] - instant.stations[i]);
        let Workspace { own, plane, space } = workspace;
        match (D, self.has_arrivals(instant)) {
            (_, false) => sums.add(&own.records[0], &p, &outlier),
            (2, true) => sums.add(&plane.records[0], &p, &outlier),
            _ => sums.add(&space.records[0], &p, &outlier),
        }
    }
}

impl Sums {
    fn new(stations: usize) -> Self {
        let (information, score) =
            (DMatrix::zeros(stations + 1, stations + 1), DVector::zeros(stations + 1));
        Self { information, score, square: 0.0, free: 0.0, measured: 0.0, outliers: 0.0 }
    }

    /// Adds the measurements of a located instant that are no outliers; p is its position relative to the
    /// first station.
    fn add<const D: usize, const N: usize>(
        &mut self,
        record: &Record<D, N>,
        p: &[f64],
        outlier: &[bool],
    ) {
        let p: Vector<D> = std::array::from_fn(|i| p[i]);
        let (mut normal, mut right): (Matrix<N>, Vector<N>) = ([[0.0; N]; N], [0.0; N]);
        let mut cross: Vec<Vector<N>> = vec![[0.0; N]; self.score.len()];
        let (mut square, mut count) = (0.0, 0);
        let kept = |place: &usize| *place == NOWHERE || !outlier[*place];
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
        for (m, row) in rows.into_iter().filter(|(m, _)| m.kind.travels()) {
            let slower = -m.path(&p) * m.precision;
            let station = Some(1 + m.index).filter(|column| *column < self.score.len());
            let own = || std::iter::once((0, slower)).chain(station.map(|column| (column, 1.0)));
            for (a, slope) in own() {
                add_multiple(&mut cross[a], slope, &row.gradient);
                own().for_each(|(b, other)| self.information[(a, b)] += slope * other);
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

    /// Returns the log odds of these positions against others for the same measurements, if the stations may
    /// have lasting errors. `None` if there are too many stations for this.
    pub fn evidence_against(self, other: Self) -> Option<f64> {
        if self.score.len() == 1 {
            return None;
        }
        let noise = self.noise(Speed::EXACT, 0.0)?.min(other.noise(Speed::EXACT, 0.0)?);
        let of = |mut sums: Self| -> Option<f64> {
            sums.reduce(noise);
            let all = sums.posteriors(Speed::EXACT, 0.0)?;
            let best = all.iter().map(|(odds, one)| odds + one.evidence).fold(f64::MIN, f64::max);
            let sum: f64 = all.iter().map(|(odds, one)| (odds + one.evidence - best).exp()).sum();
            Some(best + sum.ln() - 0.5 * sums.square - FAULT * sums.outliers)
        };
        Some(of(self)? - of(other)?)
    }

    /// Returns the factor, at least 1, of the variance of the noise.
    fn noise(&self, speed: Speed, prior: f64) -> Option<f64> {
        let widest = self.posterior(speed.share, prior, SIZES[SIZES.len() - 1])?;
        Some((widest.left / (self.free - widest.explained).max(1.0)).max(1.0))
    }

    /// Divides by the factor of the variance of the noise.
    fn reduce(&mut self, noise: f64) {
        self.information /= noise;
        self.score /= noise;
        self.square /= noise;
    }

    /// Returns the prior log odds and the posterior for each size of the errors of the stations.
    fn posteriors(&self, speed: Speed, prior: f64) -> Option<Vec<(f64, Posterior)>> {
        let mut all = vec![(NOTHING.ln(), self.posterior(speed.share, prior, 0.0)?)];
        for size in SIZES {
            let each = -(SIZES.len() as f64).ln();
            all.push((each, self.posterior(speed.share, prior, size)?));
        }
        Some(all)
    }

    /// Returns the posterior if the errors of the stations have this size; the difference from `share` has
    /// the prior mean `-share`. None if the information is not finite.
    fn posterior(&self, share: f64, prior: f64, size: f64) -> Option<Posterior> {
        let count = self.score.len();
        let deviation = |i: usize| if i == 0 { prior } else { size };
        let column = self.information.column(0);
        let off =
            DVector::from_fn(count, |i, _| deviation(i) * (self.score[i] + share * column[i]));
        let square = self.square + share * (2.0 * self.score[0] + share * column[0]);
        let mut whole = DMatrix::from_fn(count, count, |i, j| {
            deviation(i) * self.information[(i, j)] * deviation(j)
        });
        (0..count).for_each(|i| whole[(i, i)] += 1.0);
        let factor = whole.cholesky()?;
        let (solved, inverse) = (factor.solve(&off), factor.inverse());
        let gain = off.dot(&solved);
        Some(Posterior {
            evidence: 0.5 * gain - factor.l_dirty().diagonal().map(f64::ln).sum(),
            mean: prior * solved[0] - share,
            variance: prior * prior * inverse[(0, 0)],
            left: square - gain,
            explained: count as f64 - inverse.trace(),
        })
    }

    /// Returns the speed about `speed`.
    fn speed(mut self, speed: Speed, prior: f64) -> Option<Speed> {
        // the noise may be larger than stated
        self.reduce(self.noise(speed, prior)?);
        let all = self.posteriors(speed, prior)?;
        let best = all.iter().map(|(odds, one)| odds + one.evidence).fold(f64::MIN, f64::max);
        let weight = |odds: f64, one: &Posterior| (odds + one.evidence - best).exp();
        let total: f64 = all.iter().map(|(odds, one)| weight(*odds, one)).sum();
        let mean = |of: &dyn Fn(&Posterior) -> f64| -> f64 {
            all.iter().map(|(odds, one)| weight(*odds, one) * of(one)).sum::<f64>() / total
        };
        let off = mean(&|one| one.mean);
        let variance = mean(&|one| one.variance + (one.mean - off).powi(2));
        let sigma = variance.sqrt().min(prior);
        (off.is_finite() && sigma > 0.0).then_some(Speed {
            share: speed.share + off,
            sigma,
            ..speed
        })
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
        let mut sums = Sums::new(stations);
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

    const FOUND: Speed = Speed { share: 0.0, sigma: 1e-3, alone: 1e-3 };

    #[test]
    fn without_lasting_errors_the_speed_is_nearly_as_certain_as_before() {
        let slope = |k: usize, t: usize| 100.0 + 10.0 * (k * t % 7) as f64;
        let found =
            sums(|k, t| noise(k, t) - 0.01 * slope(k, t), slope).speed(FOUND, 0.02).unwrap();
        assert_within(3.0 * found.sigma, found.share, 0.01);
        assert!(found.sigma < 2e-3, "{found:?}");
    }

    #[test]
    fn errors_of_stations_that_differ_are_no_speed() {
        let slope = |k: usize, t: usize| 100.0 + 10.0 * (k * t % 7) as f64;
        let error = [3.0, -1.0, 4.0, 1.0];
        let found = sums(|k, t| noise(k, t) - error[k], slope).speed(FOUND, 0.02).unwrap();
        assert!(found.share.abs() < 2.5 * found.sigma, "{found:?}");
        // without such errors, the mean of the errors would be an error of the speed
        let alone = sums(|k, t| noise(k, t) - error[k], slope).posterior(0.0, 0.02, 0.0).unwrap();
        assert!(alone.mean.abs() > 10.0 * alone.variance.sqrt(), "{}", alone.mean);
    }

    #[test]
    fn the_prior_mean_is_the_stated_speed_wherever_the_search_ended() {
        let slope = |k: usize, t: usize| 100.0 + 10.0 * (k * t % 7) as f64;
        let at = |share: f64| {
            let off = sums(|k, t| noise(k, t) + (share - 0.01) * slope(k, t), slope);
            off.speed(Speed { share, ..FOUND }, 0.02).unwrap()
        };
        let (near, far) = (at(0.009), at(0.013));
        assert_within(1e-12, near.share, far.share);
        assert_within(1e-12, near.sigma, far.sigma);
    }
}
