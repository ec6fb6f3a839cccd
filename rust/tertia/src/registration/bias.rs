//! Biases of range and azimuth from the differences of the radars' tracks.

use super::common::Common;
use nalgebra::{DMatrix, DVector, Matrix2, Vector2};
use std::collections::BTreeMap;

/// Standard deviations of the noise that a bias may have before anything is known.
const PRIOR: f64 = 10.0;
/// Share of the prior above which the sigma of a bias means that the plots say nothing of it.
const UNKNOWN: f64 = 0.5;
/// Standard deviations beyond which differences count less (Huber), and rounds of weights.
const HUBER: f64 = 2.5;
const ROUNDS: usize = 10;

/// Where a radar is, and the standard deviations of range (m) and azimuth (rad) that it states.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Site {
    /// East and north, metres.
    pub position: [f64; 2],
    /// In range and azimuth.
    pub sigma: [f64; 2],
}

/// Biases of range (m) and azimuth (rad) of each radar and their standard deviations; nan where the
/// differences say nothing of them.
#[derive(Clone, Debug, PartialEq)]
pub struct Biases {
    /// Biases, which measurements are too large by.
    pub value: Vec<[f64; 2]>,
    /// Standard deviations.
    pub sigma: Vec<[f64; 2]>,
}

/// A whitened difference of the tracks of two radars, `r = H b + e`.
struct Difference {
    /// The two radars.
    radars: [usize; 2],
    /// Columns of H for range and azimuth of each, in standard deviations of the prior.
    design: [Matrix2<f64>; 2],
    off: Vector2<f64>,
    /// Number of its track, counted from 0.
    track: usize,
}

/// Constant biases by weighted least squares over the differences of all pairs of radars, reweighted
/// by Huber's rule, with a wide prior. Their covariance is that of a sandwich with one score for each
/// track: instants of a track are not independent, tracks are.
pub fn biases(common: &Common, sites: &[Site]) -> Biases {
    let order = 2 * sites.len();
    let unknown = vec![[f64::NAN; 2]; sites.len()];
    if common.time.is_empty() {
        return Biases { value: unknown.clone(), sigma: unknown };
    }
    let prior: Vec<f64> =
        sites.iter().flat_map(|site| site.sigma.map(|sigma| PRIOR * sigma)).collect();
    let differences = differences(common, sites, &prior);
    let mut weights = vec![1.0; differences.len()];
    let mut rests = vec![Vector2::zeros(); differences.len()];
    let mut found = DVector::zeros(order);
    let mut inverse = DMatrix::identity(order, order);
    for _ in 0..ROUNDS {
        // (I + Σ w HᵀH) b = Σ w Hᵀr
        let mut information = DMatrix::identity(order, order);
        let mut sum = DVector::zeros(order);
        for (difference, &weight) in differences.iter().zip(&weights) {
            difference.add(weight, &mut information, &mut sum);
        }
        let Some(cholesky) = information.cholesky() else {
            return Biases { value: unknown.clone(), sigma: unknown };
        };
        found = cholesky.solve(&sum);
        inverse = cholesky.inverse();
        for ((difference, weight), rest) in differences.iter().zip(&mut weights).zip(&mut rests) {
            *rest = difference.rest(&found);
            *weight = (HUBER / rest.norm().max(1e-12)).min(1.0);
        }
    }
    let sigma = sigmas(&differences, &weights, &rests, &inverse);
    let is_unknown = |i: usize| sigma[i] > UNKNOWN;
    let scaled = |values: &[f64]| {
        let value = |i: usize| if is_unknown(i) { f64::NAN } else { values[i] * prior[i] };
        (0..sites.len()).map(|k| [value(2 * k), value(2 * k + 1)]).collect()
    };
    Biases { value: scaled(found.as_slice()), sigma: scaled(&sigma) }
}

/// Standard deviations, in those of the prior: `A⁻¹ (I + c Σ s sᵀ) A⁻¹` with the scores s of tracks.
fn sigmas(
    differences: &[Difference],
    weights: &[f64],
    rests: &[Vector2<f64>],
    inverse: &DMatrix<f64>,
) -> Vec<f64> {
    let order = inverse.nrows();
    let tracks = differences.iter().map(|difference| difference.track + 1).max().unwrap_or(0);
    let mut scores = DMatrix::zeros(order, tracks);
    for ((difference, &weight), rest) in differences.iter().zip(weights).zip(rests) {
        for (&radar, design) in difference.radars.iter().zip(&difference.design) {
            let score = weight * design.transpose() * rest;
            scores[(2 * radar, difference.track)] += score[0];
            scores[(2 * radar + 1, difference.track)] += score[1];
        }
    }
    // as many of the differences of tracks as there are biases are used up
    let factor = tracks as f64 / tracks.saturating_sub(order).max(1) as f64;
    let meat = DMatrix::identity(order, order) + factor * &scores * scores.transpose();
    let spread = inverse * meat * inverse;
    // the sum of scores does not see what the prior holds
    (0..order).map(|i| spread[(i, i)].max(inverse[(i, i)]).sqrt()).collect()
}

impl Difference {
    fn add(&self, weight: f64, information: &mut DMatrix<f64>, sum: &mut DVector<f64>) {
        for (&i, left) in self.radars.iter().zip(&self.design) {
            let transposed = weight * left.transpose();
            let score = transposed * self.off;
            sum[2 * i] += score[0];
            sum[2 * i + 1] += score[1];
            for (&j, right) in self.radars.iter().zip(&self.design) {
                let block = transposed * right;
                for row in 0..2 {
                    for column in 0..2 {
                        information[(2 * i + row, 2 * j + column)] += block[(row, column)];
                    }
                }
            }
        }
    }

    fn rest(&self, bias: &DVector<f64>) -> Vector2<f64> {
        self.radars.iter().zip(&self.design).fold(self.off, |rest, (&k, design)| {
            rest - design * Vector2::new(bias[2 * k], bias[2 * k + 1])
        })
    }
}

/// The differences of all pairs of radars wherever both have a track.
fn differences(common: &Common, sites: &[Site], prior: &[f64]) -> Vec<Difference> {
    let count = sites.len();
    let mut numbers: BTreeMap<i64, usize> = BTreeMap::new();
    let mut found = Vec::new();
    for i in 0..count {
        for j in i + 1..count {
            for (instant, track) in common.track.iter().enumerate() {
                let [first, second] = [i, j].map(|k| instant * count + k);
                let [state, other] = [first, second].map(|at| &common.state[at]);
                if !(state[0].is_finite() && other[0].is_finite()) {
                    continue;
                }
                let spread = position_covariance(&common.covariance[first])
                    + position_covariance(&common.covariance[second]);
                let Some(root) = spread.cholesky().and_then(|l| l.l().try_inverse()) else {
                    continue;
                };
                let design = [(i, 1.0, state), (j, -1.0, other)].map(|(k, sign, state)| {
                    let site = sites[k].position;
                    let offset = [state[0] - site[0], state[1] - site[1]];
                    let distance = offset[0].hypot(offset[1]).max(1.0);
                    let h = Matrix2::new(
                        sign * offset[0] / distance * prior[2 * k],
                        sign * offset[1] * prior[2 * k + 1],
                        sign * offset[1] / distance * prior[2 * k],
                        -sign * offset[0] * prior[2 * k + 1],
                    );
                    root * h
                });
                let off = root * Vector2::new(state[0] - other[0], state[1] - other[1]);
                let next = numbers.len();
                let track = *numbers.entry(*track).or_insert(next);
                found.push(Difference { radars: [i, j], design, off, track });
            }
        }
    }
    found
}

/// The covariance of the position.
fn position_covariance(covariance: &[f64; 16]) -> Matrix2<f64> {
    Matrix2::new(covariance[0], covariance[1], covariance[4], covariance[5])
}

#[cfg(test)]
mod tests {
    use super::*;

    const BIAS: [[f64; 2]; 2] = [[80.0, 1e-3], [-40.0, -5e-4]];

    fn sites() -> Vec<Site> {
        let sigma = [50.0, 1e-3];
        [[0.0, 0.0], [6e4, 2e4]].map(|position| Site { position, sigma }).to_vec()
    }

    /// Targets all around, seen with the biases and nothing else.
    fn common() -> Common {
        let mut found = Common::default();
        let mut covariance = [0.0; 16];
        for i in 0..4 {
            covariance[5 * i] = 100.0;
        }
        for track in 0..12_i64 {
            let (sine, cosine) = (track as f64).sin_cos();
            for k in 0..10 {
                let distance = 4e4 + 2e3 * f64::from(k);
                let place = [3e4 + distance * sine, 1e4 + distance * cosine];
                found.time.push(f64::from(k));
                found.track.push(track);
                for (site, [range, azimuth]) in sites().iter().zip(BIAS) {
                    let offset = [place[0] - site.position[0], place[1] - site.position[1]];
                    let r = offset[0].hypot(offset[1]) + range;
                    let (s, c) = (offset[0].atan2(offset[1]) + azimuth).sin_cos();
                    let seen = [site.position[0] + r * s, site.position[1] + r * c, 0.0, 0.0];
                    found.state.push(seen);
                    found.covariance.push(covariance);
                }
            }
        }
        found
    }

    #[test]
    fn biases_are_found_and_a_lone_radar_has_none() {
        let found = biases(&common(), &sites());
        for ((value, sigma), truth) in found.value.iter().zip(&found.sigma).zip(BIAS) {
            assert!((value[0] - truth[0]).abs() < 2.0, "{value:?} ± {sigma:?}");
            assert!((value[1] - truth[1]).abs() < 5e-5, "{value:?} ± {sigma:?}");
            assert!(sigma[0] < 20.0 && sigma[1] < 5e-4, "{sigma:?}");
        }
        assert!(biases(&Common::default(), &sites()).value[0][0].is_nan());
    }
}
