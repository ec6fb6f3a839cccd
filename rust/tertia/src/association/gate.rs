//! Gates: the largest distance of a plot from its prediction, and the sectors of a gate.

use super::grid::{FINITE, Grid};
use crate::base::angle::upper_median;
use crate::base::distribution::chi_square_upper_quantile;
use crate::base::error::{Error, Result, require, require_elements, require_positive};
use crate::base::interrupt::poll;
use crate::base::matrix::read_covariance;
use nalgebra::SMatrix;

/// Probability of the inner gate: a plot inside it indicates straight and uniform motion.
pub const INNER: f64 = 0.65;
/// Probability of the outer gate: a plot beyond the inner gate indicates a change of speed or course.
pub const OUTER: f64 = 0.95;
/// Probability of the guard gate: a plot beyond the outer gate indicates a manoeuvre.
pub const GUARD: f64 = 0.998;

/// Smallest probability for which `1 − p` retains ten digits of the threshold.
const SMALLEST_PROBABILITY: f64 = 1e-6;
const LARGEST_DIMENSION: usize = 1000;
/// Smallest share of a variance that the preceding components must leave unexplained.
const REGULAR: f64 = 1e-13;
/// If at least one of this many plots is in a list, the list is sorted by counting.
const MANY: usize = 16;
/// Margin of half widths for rounding.
const MARGIN: f64 = 1.0 + 1e-12;

/// Returns the d² that a true plot of this dimension does not exceed with this probability: the quantile of
/// the chi-square distribution.
///
/// # Errors
/// A probability or a dimension outside its domain.
pub fn threshold(probability: f64, dimension: usize) -> Result<f64> {
    let holds = (SMALLEST_PROBABILITY..1.0).contains(&probability);
    require("gate_probability", probability, holds, "between 1e-6 and 1 (exclusive)")?;
    let holds = (1..=LARGEST_DIMENSION).contains(&dimension);
    require("dimension", dimension as f64, holds, "between 1 and 1000")?;
    if dimension == 2 {
        return Ok(-2.0 * (-probability).ln_1p());
    }
    Ok(chi_square_upper_quantile(1.0 - probability, dimension))
}

/// The thresholds of the three named gates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Thresholds {
    /// Threshold of [`INNER`].
    pub inner: f64,
    /// Threshold of [`OUTER`].
    pub outer: f64,
    /// Threshold of [`GUARD`].
    pub guard: f64,
}

impl Thresholds {
    /// Returns the thresholds for a dimension.
    ///
    /// # Errors
    /// As [`threshold`].
    pub fn new(dimension: usize) -> Result<Self> {
        Ok(Self {
            inner: threshold(INNER, dimension)?,
            outer: threshold(OUTER, dimension)?,
            guard: threshold(GUARD, dimension)?,
        })
    }
}

/// The sector of the gates in which a plot is. Ahead and behind are within 45° of the velocity and of
/// its opposite, measured between the whitened innovation and the whitened velocity.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum GateSector {
    /// In the inner gate.
    Inner = 0,
    /// Between the inner and the outer gate, ahead: the target accelerates.
    Ahead = 1,
    /// Between the inner and the outer gate, behind: the target decelerates.
    Behind = 2,
    /// Between the inner and the outer gate, to the left.
    Left = 3,
    /// Between the inner and the outer gate, to the right.
    Right = 4,
    /// Between the outer and the guard gate, ahead.
    GuardAhead = 5,
    /// Between the outer and the guard gate, behind.
    GuardBehind = 6,
    /// Between the outer and the guard gate, to the left.
    GuardLeft = 7,
    /// Between the outer and the guard gate, to the right.
    GuardRight = 8,
    /// Beyond the guard gate.
    Outside = 9,
}

impl GateSector {
    /// Returns the sector of an innovation in the plane, x east and y north. Without a velocity, all
    /// innovations count as ahead.
    #[must_use]
    pub fn of(
        innovation: [f64; 2],
        velocity: [f64; 2],
        factor: &Factor<2>,
        thresholds: &Thresholds,
    ) -> Self {
        let (e, v) = (factor.whiten(&innovation), factor.whiten(&velocity));
        let d2 = e[0] * e[0] + e[1] * e[1];
        if d2 <= thresholds.inner {
            return Self::Inner;
        }
        if d2.is_nan() || d2 > thresholds.guard {
            return Self::Outside;
        }
        // |φ| ≤ 45° or ≥ 135°: whitening preserves the side, and φ does not depend on the choice of the root
        let along = e[0] * v[0] + e[1] * v[1];
        let across = v[0] * e[1] - v[1] * e[0];
        let (near, far) = match (along.abs() >= across.abs(), along >= 0.0, across > 0.0) {
            (true, true, _) => (Self::Ahead, Self::GuardAhead),
            (true, false, _) => (Self::Behind, Self::GuardBehind),
            (false, _, true) => (Self::Left, Self::GuardLeft),
            (false, _, false) => (Self::Right, Self::GuardRight),
        };
        if d2 <= thresholds.outer { near } else { far }
    }
}

/// The lower triangle L of a covariance `Σ = L Lᵀ`, with which distances are computed.
#[derive(Clone, Copy, Debug)]
pub struct Factor<const M: usize> {
    lower: [[f64; M]; M],
    /// Reciprocals of the diagonal.
    reciprocal: [f64; M],
}

impl<const M: usize> Factor<M> {
    /// Computes the factor; `None` if the covariance is singular.
    #[must_use]
    pub fn try_new(sigma: &[[f64; M]; M]) -> Option<Self> {
        let (mut lower, mut reciprocal) = (*sigma, [0.0; M]);
        for j in 0..M {
            for i in j..M {
                let known: f64 = (0..j).map(|p| lower[i][p] * lower[j][p]).sum();
                let rest = sigma[i][j] - known;
                if i == j {
                    if rest.is_nan() || rest <= REGULAR * sigma[j][j] {
                        return None;
                    }
                    lower[j][j] = rest.sqrt();
                    reciprocal[j] = 1.0 / lower[j][j];
                } else {
                    lower[i][j] = rest * reciprocal[j];
                }
            }
        }
        Some(Self { lower, reciprocal })
    }

    /// `L⁻¹ e`.
    #[inline]
    #[must_use]
    pub fn whiten(&self, e: &[f64; M]) -> [f64; M] {
        let mut out = *e;
        for i in 0..M {
            for p in 0..i {
                out[i] -= self.lower[i][p] * out[p];
            }
            out[i] *= self.reciprocal[i];
        }
        out
    }

    /// `d² = eᵀ Σ⁻¹ e`.
    #[inline]
    #[must_use]
    pub fn distance(&self, e: &[f64; M]) -> f64 {
        self.whiten(e).iter().map(|v| v * v).sum()
    }

    /// `ln |Σ|`.
    #[must_use]
    pub fn ln_determinant(&self) -> f64 {
        (0..M).map(|i| 2.0 * self.lower[i][i].ln()).sum()
    }
}

/// A plot within the gate of a track.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gated {
    /// Index of the track.
    pub track: u32,
    /// Index of the plot.
    pub plot: u32,
    /// Normalised innovation squared, `d²`.
    pub nis: f64,
    /// `ln |Σ|` of the innovation.
    pub ln_determinant: f64,
}

/// Predictions of tracks and plots of one scan, with M coordinates each, in one list; the first two
/// coordinates span the plane of the index.
#[derive(Clone, Copy, Debug)]
pub struct Scan<'a> {
    /// Predicted positions of the tracks.
    pub predicted: &'a [f64],
    /// Covariances of the predictions, or of the innovations if the plots have no covariances.
    pub covariance: &'a [f64],
    /// Positions of the plots.
    pub plots: &'a [f64],
    /// Covariances of the plots.
    pub plot_covariance: Option<&'a [f64]>,
}

/// Returns all pairs of a plot and a track in whose gate it is, sorted by track and then by plot. Cost
/// O(T + N) if gates are small, plus O(1) for each pair.
///
/// # Errors
/// A number that is not finite, a matrix that is singular or is not a covariance, or a threshold that is
/// not positive.
pub fn pairs<const M: usize>(scan: &Scan<'_>, threshold: f64) -> Result<Vec<Gated>> {
    require_positive("threshold", threshold)?;
    let tracks = read_points::<M>("predicted", scan.predicted)?;
    let plots = read_points::<M>("plots", scan.plots)?;
    let sums = Sums::<M>::read(scan)?;
    let half_widths = sums.half_widths(threshold);
    let plane: Vec<[f64; 2]> = plots.iter().map(|p| [p[0], p[1]]).collect();
    let grid = Grid::new(&plane, cell(&half_widths))?;
    let (mut out, mut near, mut there) = (Vec::new(), Vec::new(), vec![false; plots.len()]);
    for (track, (position, half)) in tracks.iter().zip(&half_widths).enumerate() {
        poll();
        near.clear();
        grid.within([position[0], position[1]], *half, &mut |plot| near.push(plot));
        sort(&mut near, &mut there);
        let mut last: Option<Last<M>> = None;
        for &plot in &near {
            let sum = match last.filter(|last| sums.is_same(last.plot, plot)) {
                Some(last) => last,
                None => sums.factor(track, plot)?,
            };
            last = Some(sum);
            let innovation = std::array::from_fn(|i| plots[plot][i] - position[i]);
            let nis = sum.factor.distance(&innovation);
            if nis <= threshold {
                let ln_determinant = sum.ln_determinant;
                let (track, plot) = (track as u32, plot as u32);
                out.push(Gated { track, plot, nis, ln_determinant });
            }
        }
    }
    Ok(out)
}

/// Sorts distinct indices below the length of `there`, in which all elements are false before and
/// afterwards.
fn sort(indices: &mut Vec<usize>, there: &mut [bool]) {
    if indices.len() < there.len() / MANY {
        return indices.sort_unstable();
    }
    indices.drain(..).for_each(|index| there[index] = true);
    indices.extend((0..there.len()).filter(|&index| std::mem::take(&mut there[index])));
}

/// Factor of the innovation covariance for this plot and all plots with the same covariance.
#[derive(Clone, Copy)]
struct Last<const M: usize> {
    plot: usize,
    factor: Factor<M>,
    ln_determinant: f64,
}

/// Covariances of innovations.
struct Sums<const M: usize> {
    sigmas: Vec<[[f64; M]; M]>,
    noises: Option<Vec<[[f64; M]; M]>>,
    /// Factor for each track, if the plots have no covariances.
    factors: Vec<Factor<M>>,
}

impl<const M: usize> Sums<M> {
    fn read(scan: &Scan<'_>) -> Result<Self> {
        let sigmas = read_covariances("covariance", scan.covariance)?;
        let read = |values| read_covariances("plot_covariance", values);
        let noises = scan.plot_covariance.map(read).transpose()?;
        let factors = match noises {
            Some(_) => Vec::new(),
            None => {
                let each = sigmas.iter().enumerate();
                each.map(|(track, sigma)| regular(sigma, track)).collect::<Result<_>>()?
            }
        };
        Ok(Self { sigmas, noises, factors })
    }

    /// Whether two plots have the same covariance.
    fn is_same(&self, plot: usize, other: usize) -> bool {
        self.noises.as_ref().is_none_or(|noises| noises[plot] == noises[other])
    }

    fn factor(&self, track: usize, plot: usize) -> Result<Last<M>> {
        let factor = match &self.noises {
            None => self.factors[track],
            Some(noises) => {
                let (a, b) = (&self.sigmas[track], &noises[plot]);
                let sum = std::array::from_fn(|i| std::array::from_fn(|j| a[i][j] + b[i][j]));
                regular(&sum, track)?
            }
        };
        Ok(Last { plot, factor, ln_determinant: factor.ln_determinant() })
    }

    /// Returns half widths of a box around each gate, for the plot with the largest covariance.
    fn half_widths(&self, threshold: f64) -> Vec<[f64; 2]> {
        let mut widest = [0.0_f64; 2];
        for noise in self.noises.iter().flatten() {
            widest = [0, 1].map(|i| widest[i].max(noise[i][i]));
        }
        let side =
            |s: &[[f64; M]; M], i: usize| MARGIN * (threshold * (s[i][i] + widest[i])).sqrt();
        self.sigmas.iter().map(|s| [0, 1].map(|i| side(s, i))).collect()
    }
}

fn regular<const M: usize>(sigma: &[[f64; M]; M], track: usize) -> Result<Factor<M>> {
    let singular = || Error::Singular { argument: "covariance", index: vec![track] };
    Factor::try_new(sigma).ok_or_else(singular)
}

/// Width of a cell: the median width of the gates.
fn cell(half_widths: &[[f64; 2]]) -> f64 {
    let mut widths: Vec<f64> = half_widths.iter().map(|w| w[0].max(w[1])).collect();
    if widths.is_empty() {
        return 1.0;
    }
    2.0 * upper_median(&mut widths)
}

fn read_points<const M: usize>(argument: &'static str, values: &[f64]) -> Result<Vec<[f64; M]>> {
    require_elements(argument, values, M, f64::is_finite, FINITE)?;
    Ok(values.as_chunks().0.to_vec())
}

fn read_covariances<const M: usize>(
    argument: &'static str,
    values: &[f64],
) -> Result<Vec<[[f64; M]; M]>> {
    let (mut matrix, mut factor) = (SMatrix::<f64, M, M>::zeros(), SMatrix::<f64, M, M>::zeros());
    let read = |(at, values): (usize, &[f64])| {
        read_covariance(argument, &[at], values, &mut matrix, &mut factor)?;
        Ok(std::array::from_fn(|i| std::array::from_fn(|j| matrix[(i, j)])))
    };
    values.chunks_exact(M * M).enumerate().map(read).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;

    #[test]
    fn thresholds_of_the_paper() {
        for (m, expected) in [
            (1, [0.873457142989, 3.841458820694, 9.549535706083]),
            (2, [2.099644248997, 5.991464547108, 12.429216196844]),
            (3, [3.283112463526, 7.814727903251, 14.795517054552]),
        ] {
            let Thresholds { inner, outer, guard } = Thresholds::new(m).unwrap();
            for (found, expected) in [inner, outer, guard].into_iter().zip(expected) {
                assert!((found / expected - 1.0).abs() < 1e-10, "{found} {expected}");
            }
        }
        for (p, m) in [(0.0, 2), (1.0, 2), (f64::NAN, 2), (0.5, 0), (0.5, 1001)] {
            assert!(threshold(p, m).is_err());
        }
        // the closed form for two dimensions agrees with the general one
        let general = chi_square_upper_quantile(1.0 - 0.9, 2);
        assert!((threshold(0.9, 2).unwrap() / general - 1.0).abs() < 1e-13);
    }

    #[test]
    fn regions_in_the_open() {
        let thresholds = Thresholds::new(2).unwrap();
        let factor = Factor::try_new(&[[1.0, 0.0], [0.0, 1.0]]).unwrap();
        let region = |e: [f64; 2]| GateSector::of(e, [0.0, 200.0], &factor, &thresholds);
        assert_eq!(region([0.0, 1.4]), GateSector::Inner);
        assert_eq!(region([1.0, 1.8]), GateSector::Ahead);
        assert_eq!(region([-1.0, -1.8]), GateSector::Behind);
        assert_eq!(region([-1.8, 1.0]), GateSector::Left);
        assert_eq!(region([1.8, -1.0]), GateSector::Right);
        assert_eq!(region([0.0, 3.0]), GateSector::GuardAhead);
        assert_eq!(region([0.0, -3.0]), GateSector::GuardBehind);
        assert_eq!(region([-3.0, 0.1]), GateSector::GuardLeft);
        assert_eq!(region([3.0, -0.1]), GateSector::GuardRight);
        assert_eq!(region([0.0, 3.6]), GateSector::Outside);
        assert_eq!(region([f64::NAN, 0.0]), GateSector::Outside);
        // the boundary of a wedge belongs to it
        assert_eq!(region([1.5, 1.5]), GateSector::Ahead);
        assert_eq!(GateSector::of([2.0, 0.0], [0.0; 2], &factor, &thresholds), GateSector::Ahead);
    }

    #[test]
    fn singular_is_none() {
        assert!(Factor::try_new(&[[1.0, 1.0], [1.0, 1.0]]).is_none());
        assert!(Factor::try_new(&[[0.0]]).is_none());
        assert!(Factor::try_new(&[[f64::NAN]]).is_none());
        let factor = Factor::try_new(&[[4.0, 2.0], [2.0, 10.0]]).unwrap();
        assert!((factor.distance(&[2.0, 4.0]) - 2.0).abs() < 1e-14);
        assert!((factor.ln_determinant() - 36.0_f64.ln()).abs() < 1e-14);
    }

    fn matrix<const M: usize>(random: &mut Random) -> [[f64; M]; M] {
        let root: [[f64; M]; M] =
            std::array::from_fn(|_| std::array::from_fn(|_| random.symmetric(1.0)));
        std::array::from_fn(|i| {
            std::array::from_fn(|j| {
                (0..M).map(|p| root[i][p] * root[j][p]).sum::<f64>()
                    + if i == j { 0.1 } else { 0.0 }
            })
        })
    }

    fn against_all_pairs<const M: usize>(seed: u64, with_noise: bool) {
        let random = &mut Random::new(seed);
        let (t, n) = (60, 80);
        let point = |random: &mut Random| std::array::from_fn::<_, M, _>(|_| random.symmetric(8.0));
        let tracks: Vec<[f64; M]> = (0..t).map(|_| point(random)).collect();
        let plots: Vec<[f64; M]> = (0..n).map(|_| point(random)).collect();
        let sigmas: Vec<[[f64; M]; M]> = (0..t).map(|_| matrix(random)).collect();
        let noises: Vec<[[f64; M]; M]> = (0..n).map(|_| matrix(random)).collect();
        let gate = threshold(0.95, M).unwrap();
        let flat = |matrices: &[[[f64; M]; M]]| {
            matrices.iter().flatten().flatten().copied().collect::<Vec<f64>>()
        };
        let noise = flat(&noises);
        let scan = Scan {
            predicted: tracks.as_flattened(),
            covariance: &flat(&sigmas),
            plots: plots.as_flattened(),
            plot_covariance: with_noise.then_some(&noise),
        };
        let found = pairs::<M>(&scan, gate).unwrap();
        let mut expected = Vec::new();
        for (i, (track, sigma)) in tracks.iter().zip(&sigmas).enumerate() {
            for (k, plot) in plots.iter().enumerate() {
                let sum = |i: usize, j: usize| sigma[i][j] + noises[k][i][j];
                let both = std::array::from_fn(|i| std::array::from_fn(|j| sum(i, j)));
                let sigma = if with_noise { both } else { *sigma };
                let factor = Factor::try_new(&sigma).unwrap();
                let nis = factor.distance(&std::array::from_fn(|i| plot[i] - track[i]));
                if nis <= gate {
                    let ln_determinant = factor.ln_determinant();
                    expected.push(Gated { track: i as u32, plot: k as u32, nis, ln_determinant });
                }
            }
        }
        assert!(expected.len() > 20);
        assert_eq!(found, expected);
    }

    #[test]
    fn pairs_are_those_of_all() {
        for seed in 0..5 {
            against_all_pairs::<2>(seed, false);
            against_all_pairs::<2>(seed, true);
            against_all_pairs::<3>(seed, false);
            against_all_pairs::<3>(seed, true);
        }
    }

    #[test]
    fn what_is_refused() {
        let scan = Scan {
            predicted: &[0.0, 0.0],
            covariance: &[1.0, 1.0, 1.0, 1.0],
            plots: &[0.0, 0.0],
            plot_covariance: None,
        };
        let error = pairs::<2>(&scan, 5.0).unwrap_err();
        assert_eq!(error, Error::Singular { argument: "covariance", index: vec![0] });
        assert!(
            pairs::<2>(&Scan { plot_covariance: Some(&[1.0, 0.0, 0.0, 1.0]), ..scan }, 5.0).is_ok()
        );
        let error = pairs::<2>(&Scan { plots: &[0.0, f64::NAN], ..scan }, 5.0).unwrap_err();
        assert!(error.to_string().starts_with("plots[0, 1] is nan"));
        for gate in [0.0, f64::NAN, f64::INFINITY] {
            assert!(pairs::<2>(&scan, gate).is_err());
        }
    }
}
