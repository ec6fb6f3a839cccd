//! Protection level: the radius that the error of a position exceeds with a stated risk, undetected
//! faults included.
//!
//! Solution separation (Blanch et al. 2012) in the plane. For every set k of measurements that may be
//! faulty together, the position without this set is computed, with its covariance `P_k` and a
//! threshold on its distance from the position with all measurements. If all sets pass this test, the
//! error, without faults or with faults in one of the sets, exceeds the radius R with a probability of
//! at most
//!
//! ```text
//! P(|N(0, P_0)| > R) + Σ_k p_k P(|N(0, P_k)| > R − T_k) + P(more faults than guarded),
//! T_k = √(χ²_m⁻¹(1 − P_fa/N) λ_max(P_k − P_0)),   m = min(faults in k, 2).
//! ```

use super::contour::principal;
use super::radial::{Radial, falling_root};
use super::region::Located;
use crate::base::distribution::chi_square_upper_quantile;
use crate::base::error::{Error, Result};
use crate::base::small::{Factor, Matrix, Vector, add_outer, rotated};
use crate::sensors::Row;

/// Largest number of sets of measurements that are left out in turn: they take a few seconds and 100 MB.
const MOST_SETS: f64 = 1e6;

/// The faults that are guarded against, and the probabilities of the protection.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Protection {
    /// Probability that the error exceeds the protection level.
    pub risk: f64,
    /// Probability that a measurement is faulty.
    pub fault_probability: f64,
    /// Number of simultaneous faults that are guarded against.
    pub faults: usize,
    /// Probability that the test rejects measurements without a fault.
    pub false_alarm_probability: f64,
}

/// A set of measurements that may be faulty together.
struct Mode {
    probability: f64,
    threshold: f64,
    error: Radial,
}

impl Protection {
    /// Returns the protection level in m, a horizontal radius, of a position estimated from the
    /// measurements that are not marked as outliers. The state has N components if the emission of
    /// arrivals is the last of them, otherwise D. The level is infinite if no radius is large enough:
    /// faults cannot be detected, are more probable than the risk, or were detected but not excluded.
    /// Excluded measurements count as faults. O(M^(faults + 1)).
    ///
    /// # Errors
    /// More than a million sets of measurements that may be faulty together.
    pub fn level<const D: usize, const N: usize>(&self, located: &Located<'_>) -> Result<f64> {
        if located.is_timed() {
            self.level_with::<D, N>(located)
        } else {
            self.level_with::<D, D>(located)
        }
    }

    fn level_with<const D: usize, const N: usize>(&self, located: &Located<'_>) -> Result<f64> {
        let (kept, excluded) = located.kept::<D, N>();
        let mut state = [0.0; N];
        state[..D].copy_from_slice(&located.offset::<D>());
        let rows: Vec<_> = kept.iter().map(|m| m.row_at(&state)).collect();
        let Some(faults) = self.faults.checked_sub(excluded) else { return Ok(f64::INFINITY) };
        if let Some(most) = most_faults(rows.len()).filter(|most| *most < faults) {
            let (faults, measurements) = (self.faults, rows.len() + excluded);
            return Err(Error::TooManySets { faults, measurements, most: most + excluded });
        }
        Ok(self.level_of(&rows, faults).unwrap_or(f64::INFINITY))
    }

    /// Returns the level from whitened rows; `None` if no radius is large enough.
    fn level_of<const D: usize>(&self, rows: &[Row<D>], faults: usize) -> Option<f64> {
        let all = Sums::of(rows);
        let (inverse, shift) = all.solve()?;
        let own = horizontal(&inverse);
        let error = Radial::try_new(own, f64::INFINITY)?;
        let faults = faults.min(rows.len());
        let count = (1..=faults).map(|size| combinations(rows.len(), size)).sum::<f64>();
        let mut modes = Vec::new();
        let mut unguarded = self.more_than(faults, rows.len());
        let mut set = Vec::new();
        for size in 1..=faults {
            let probability = self.probability_of(size, rows.len());
            let rank = size.min(2);
            let quantile = chi_square_upper_quantile(self.false_alarm_probability / count, rank);
            set.clear();
            set.extend(0..size);
            loop {
                let mut rest = all;
                set.iter().for_each(|&row| rest.remove(&rows[row]));
                match rest.solve() {
                    // faults of this set cannot be detected: they contribute to the risk at any radius
                    None => unguarded += probability,
                    Some((without, moved)) => {
                        let separation: Vector<D> = std::array::from_fn(|i| moved[i] - shift[i]);
                        let mode = Separation::new(own, horizontal(&without), separation);
                        if mode.statistic(rank) > quantile {
                            return None;
                        }
                        modes.push(Mode {
                            probability,
                            threshold: (quantile * mode.large).sqrt(),
                            error: Radial::try_new(horizontal(&without), f64::INFINITY)?,
                        });
                    }
                }
                if !advance(&mut set, rows.len()) {
                    break;
                }
            }
        }
        if unguarded >= self.risk {
            return None;
        }
        let risk = |r: f64| {
            let of = |mode: &Mode| mode.probability * mode.error.outside(r - mode.threshold);
            error.outside(r) + modes.iter().map(of).sum::<f64>() + unguarded
        };
        let radius = falling_root(|r| (risk(r) / self.risk).ln(), error.longest());
        // the radius is about the least-squares position, from which the given one differs by the shift
        Some(radius + shift[0].hypot(shift[1]))
    }

    /// Returns the probability that exactly `size` given measurements out of `count` are faulty.
    fn probability_of(&self, size: usize, count: usize) -> f64 {
        let p = self.fault_probability;
        p.powi(size as i32) * (1.0 - p).powi((count - size) as i32)
    }

    /// Returns the probability that more than `faults` of `count` measurements are faulty.
    fn more_than(&self, faults: usize, count: usize) -> f64 {
        (faults + 1..=count)
            .map(|size| combinations(count, size) * self.probability_of(size, count))
            .sum()
    }
}

/// `J^T J` and `J^T r`.
#[derive(Clone, Copy)]
struct Sums<const D: usize> {
    matrix: Matrix<D>,
    vector: Vector<D>,
}

impl<const D: usize> Sums<D> {
    fn of(rows: &[Row<D>]) -> Self {
        let mut sums = Self { matrix: [[0.0; D]; D], vector: [0.0; D] };
        rows.iter().for_each(|row| sums.add(row, 1.0));
        sums
    }

    fn remove(&mut self, row: &Row<D>) {
        self.add(row, -1.0);
    }

    fn add(&mut self, row: &Row<D>, sign: f64) {
        for i in 0..D {
            self.vector[i] += sign * row.gradient[i] * row.residual;
        }
        add_outer(&mut self.matrix, sign, &row.gradient);
    }

    /// Returns the covariance, and the step from the position to the least-squares minimum.
    fn solve(&self) -> Option<(Matrix<D>, Vector<D>)> {
        let inverse = Factor::try_new(&self.matrix, 0.0)?.inverse();
        Some((inverse, rotated(&inverse, &self.vector)))
    }
}

/// Difference between the position without a set of measurements and the position with it.
struct Separation {
    /// Eigenvalues of the covariance `P_k − P_0` of the difference.
    large: f64,
    small: f64,
    /// Components of the difference along the principal axes.
    along: f64,
    across: f64,
}

impl Separation {
    fn new<const D: usize>(own: [f64; 3], without: [f64; 3], d: Vector<D>) -> Self {
        let covariance = std::array::from_fn(|i| without[i] - own[i]);
        let (large, small, angle) = principal(covariance);
        let (sine, cosine) = angle.sin_cos();
        let (along, across) = (d[0] * cosine + d[1] * sine, d[1] * cosine - d[0] * sine);
        Self { large, small, along, across }
    }

    /// Returns `d^T (P_k − P_0)⁺ d`; zero if the set does not change the position.
    fn statistic(&self, rank: usize) -> f64 {
        let share = |d: f64, variance: f64| if variance > 0.0 { d * d / variance } else { 0.0 };
        let second = if rank > 1 { share(self.across, self.small) } else { 0.0 };
        share(self.along, self.large) + second
    }
}

fn horizontal<const D: usize>(covariance: &Matrix<D>) -> [f64; 3] {
    [covariance[0][0], covariance[0][1], covariance[1][1]]
}

fn combinations(count: usize, size: usize) -> f64 {
    (0..size).map(|i| (count - i.min(count)) as f64 / (i + 1) as f64).product()
}

/// Largest number of simultaneous faults of which there are not too many sets; `None` if any number is
/// possible.
fn most_faults(count: usize) -> Option<usize> {
    let mut sets = 0.0;
    (1..=count).find_map(|size| {
        sets += combinations(count, size);
        (sets > MOST_SETS).then_some(size - 1)
    })
}

/// Advances to the next set of the same size in lexicographic order; false after the last one.
fn advance(set: &mut [usize], count: usize) -> bool {
    let size = set.len();
    let Some(at) = (0..size).rev().find(|&i| set[i] < count - size + i) else { return false };
    set[at] += 1;
    for i in at + 1..size {
        set[i] = set[i - 1] + 1;
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_within;

    const MILD: Protection = Protection {
        risk: 1e-5,
        fault_probability: 1e-4,
        faults: 1,
        false_alarm_probability: 1e-3,
    };

    #[test]
    fn sets() {
        let mut set = vec![0, 1];
        let mut all = vec![set.clone()];
        while advance(&mut set, 4) {
            all.push(set.clone());
        }
        assert_eq!(all.len(), 6);
        assert_eq!(all.last().unwrap(), &[2, 3]);
        assert_within(1e-15, combinations(8, 3), 56.0);
        assert_within(1e-12, MILD.more_than(0, 2), 1e-4 * (2.0 - 1e-4));
    }

    /// Five arrival times and mirror images of three of them, with the emission time as the third
    /// unknown. The expected values were computed independently in double precision.
    #[test]
    fn arrival_times() {
        let stations =
            [[0.0, 0.0], [4000.0, 0.0], [0.0, 3000.0], [4200.0, 3100.0], [2000.0, -1500.0]];
        let row = |k: usize, sign: f64| {
            let [x, y]: [f64; 2] = [1500.0 - stations[k % 5][0], 1100.0 - stations[k % 5][1]];
            let range = x.hypot(y);
            let gradient = [sign * x / range, y / range, 1.0].map(|v| v / 10.0);
            Row { residual: 0.0, gradient }
        };
        let rows: Vec<_> = (0..8).map(|k| row(k, if k < 5 { 1.0 } else { -1.0 })).collect();
        assert_within(1e-12, MILD.level_of(&rows, 1).unwrap(), 32.480_406_326_899_605);
        let own = horizontal(&Sums::of(&rows).solve().unwrap().0);
        let without_faults = Radial::try_new(own, f64::INFINITY).unwrap().quantile(1e-5);
        assert_within(1e-12, without_faults, 25.100_082_201_583_746);
    }

    #[test]
    fn sets_are_counted() {
        // 2^19 − 1 sets; 2^20 − 1 without the last 60,460; 40 + 780 + 9880 + 91,390 + 658,008
        assert_eq!(most_faults(19), None);
        assert_eq!(most_faults(20), Some(13));
        assert_eq!(most_faults(40), Some(5));
    }

    #[test]
    fn no_radius_is_enough() {
        let row = |gradient, residual| Row { residual, gradient };
        let square = [[1.0, 0.0], [0.0, 1.0], [0.7, 0.7], [0.7, -0.7]];
        let rows = square.map(|gradient| row(gradient, 0.0));
        assert!(MILD.level_of(&rows, 1).unwrap().is_finite());
        // none: one fault is more probable than the risk; two measurements cannot check each other; a
        // fault
        assert!(MILD.level_of(&rows, 0).is_none());
        assert_eq!(MILD.level_of(&rows, usize::MAX), MILD.level_of(&rows, 4));
        assert!(MILD.level_of(&rows[..2], 1).is_none());
        let mut wrong = rows;
        wrong[0].residual = 20.0;
        assert!(MILD.level_of(&wrong, 1).is_none());
    }
}
