//! By how much the blocks of plots overstate what is known of the errors of the sensors.
//!
//! The errors of plots may last from block to block: those of tracks of another system, of a transponder, of
//! reflections. The blocks of a target are then no independent evidence, and their scores add up to more than
//! their information states. As in cluster-robust standard errors (Liang & Zeger, Biometrika 73, 1986), with
//! targets as clusters, the ratio of the sums of squares is the factor by which the covariance is too small. It
//! is used if it is significant.
//!
//! If azimuth errors differ between directions, their mean may be well known, but those at a target are not.
//! The variance of their differences follows from the squares of scores, as in random-effects models (DerSimonian
//! & Laird, Controlled Clinical Trials 7, 1986).

use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Time within which blocks of a target are compared, s.
const MEMORY: f64 = 600.0;
/// Standard deviations by which scores must exceed what is expected, and the least expected sum.
const SURE: f64 = 4.0;
const ENOUGH: f64 = 0.5;
/// Number of improvements of the variance between targets.
const ROUNDS: usize = 6;

/// What a block of plots of a target says about the errors in some columns.
#[derive(Clone, Debug)]
pub(super) struct Part {
    pub target: i64,
    pub columns: Vec<usize>,
    pub information: DMatrix<f64>,
    /// Score about the errors that were removed before.
    pub score: DVector<f64>,
    /// Columns of azimuth errors, and their prior sigmas, rad.
    pub azimuths: Vec<(usize, f64)>,
}

/// Sums over the blocks of a target.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Cluster {
    time: f64,
    columns: Vec<usize>,
    information: DMatrix<f64>,
    /// Scores about the errors as they were estimated with each block.
    score: DVector<f64>,
    /// Change of the scores by a unit of each error, if it lasts.
    slope: DMatrix<f64>,
    /// Columns of azimuth errors, and their prior sigmas, rad.
    azimuths: Vec<(usize, f64)>,
}

/// Sums over the blocks of each target.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Clusters(BTreeMap<i64, Cluster>);

impl Clusters {
    /// Adds blocks at a time; the estimates of the errors have changed by `step` since they were removed.
    pub fn add(&mut self, parts: &[Part], step: &DVector<f64>, time: f64) {
        for part in parts {
            let own = self.0.entry(part.target).or_insert_with(|| Cluster::new(time));
            own.add(part, step, time);
        }
    }

    /// Forgets targets without blocks for a long time.
    pub fn forget(&mut self, time: f64) {
        self.0.retain(|_, own| time - own.time <= MEMORY);
    }

    /// Forgets all blocks.
    pub fn clear(&mut self) {
        self.0.clear();
    }

    /// Factor by which this covariance of the errors, which follows from all blocks, is too small; 1 if it may
    /// be right. None if there are too few blocks. Cost O(n q³) for n targets of which the sensors have q
    /// errors.
    pub fn excess(&self, covariance: &DMatrix<f64>) -> Option<f64> {
        let (mut found, mut expected, mut variance) = (0.0, 0.0, 0.0);
        let mut parts: BTreeMap<&[usize], DMatrix<f64>> = BTreeMap::new();
        for Cluster { columns, information, score, .. } in self.0.values() {
            let known = parts
                .entry(columns)
                .or_insert_with(|| covariance.select_rows(columns).select_columns(columns));
            let share = &*known * information;
            // the trace of its square
            let order = columns.len();
            let rows = (0..order).map(|i| share.as_slice()[i..].iter().step_by(order));
            let pairs = rows.zip(share.as_slice().chunks_exact(order.max(1)));
            let squares: f64 =
                pairs.map(|(row, column)| row.zip(column).map(|(a, b)| a * b).sum::<f64>()).sum();
            let columns = known.column_iter().zip(score.iter());
            found += columns.map(|(column, own)| own * column.dot(score)).sum::<f64>();
            // the errors are estimated from the same blocks
            expected += (share.trace() - squares).max(0.0);
            variance += 2.0 * squares;
        }
        let is_sure = found > expected + SURE * variance.sqrt();
        (expected > ENOUGH).then(|| if is_sure { found / expected } else { 1.0 })
    }

    /// Variances, in units of the prior, by which azimuth errors differ between targets, one for each error: 0
    /// unless scores differ by `sure` standard deviations. `covariance` is that of the errors. Cost O(n q³).
    pub fn apart(&self, covariance: &DMatrix<f64>, sure: f64) -> DVector<f64> {
        let mut found = DVector::zeros(covariance.nrows());
        let azimuths = self.0.values().flat_map(|own| &own.azimuths);
        let targets = self.0.values().filter_map(|own| own.scatter(covariance));
        let variance = variance(targets, sure);
        for (column, sigma) in azimuths {
            found[*column] = variance / (sigma * sigma);
        }
        found
    }
}

/// Squares of scores of azimuth errors beyond what is expected, their increase by the variance between targets,
/// and their standard deviation over the root of two without it.
struct Scatter {
    excess: f64,
    slope: f64,
    spread: f64,
}

/// Variance between targets, rad²; 0 unless it is significant by `sure` standard deviations.
fn variance(targets: impl Iterator<Item = Scatter>, sure: f64) -> f64 {
    let targets: Vec<Scatter> = targets.collect();
    let estimate = |before: f64| {
        let (mut sum, mut slopes, mut noise) = (0.0, 0.0, 0.0);
        for Scatter { excess, slope, spread } in &targets {
            let sigma = spread + before * slope;
            let weight = slope / (sigma * sigma);
            sum += weight * excess;
            slopes += weight * slope;
            noise += 2.0 * (weight * spread).powi(2);
        }
        (sum, slopes, noise)
    };
    let (sum, slopes, noise) = estimate(0.0);
    let is_sure = sum > sure * noise.sqrt();
    let improved = |before: f64| {
        let (sum, slopes, _) = estimate(before);
        (sum / slopes).max(0.0)
    };
    if is_sure { (0..ROUNDS).fold(sum / slopes, |before, _| improved(before)) } else { 0.0 }
}

impl Cluster {
    fn new(time: f64) -> Self {
        let [information, slope] = [(); 2].map(|()| DMatrix::zeros(0, 0));
        let (columns, score, azimuths) = (Vec::new(), DVector::zeros(0), Vec::new());
        Self { time, columns, information, score, slope, azimuths }
    }

    /// How far the azimuth errors of this target differ from those of all; none if no sensor has any.
    fn scatter(&self, covariance: &DMatrix<f64>) -> Option<Scatter> {
        let known = covariance.select_rows(&self.columns).select_columns(&self.columns);
        // the errors are estimated from the same blocks
        let expected = &self.information - &self.information * known * &self.information;
        let own: Vec<(usize, f64)> = (self.azimuths.iter())
            .filter_map(|(column, sigma)| Some((self.columns.binary_search(column).ok()?, *sigma)))
            .collect();
        let (mut excess, mut slope, mut spread) = (0.0, 0.0, 0.0);
        for &(i, a) in &own {
            excess += (self.score[i] * self.score[i] - expected[(i, i)]) / (a * a);
            for &(j, b) in &own {
                slope += (self.slope[(i, j)] / (a * b)).powi(2);
                spread += (expected[(i, j)] / (a * b)).powi(2);
            }
        }
        (spread > 0.0).then(|| Scatter { excess, slope, spread: spread.sqrt() })
    }

    fn add(&mut self, part: &Part, step: &DVector<f64>, time: f64) {
        let kept = ((self.time - time).min(0.0) / MEMORY).exp();
        self.time = self.time.max(time);
        self.score *= kept;
        // the variance of a weighted sum of scores
        self.information *= kept * kept;
        self.slope *= kept;
        for own in &part.azimuths {
            if !self.azimuths.contains(own) {
                self.azimuths.push(*own);
            }
        }
        self.cover(&part.columns);
        // all columns are there
        let place = |column: &usize| self.columns.partition_point(|own| own < column);
        let places: Vec<usize> = part.columns.iter().map(place).collect();
        let order = self.columns.len();
        let (own, slope) = (self.information.as_mut_slice(), self.slope.as_mut_slice());
        let blocks = part.information.as_slice().chunks_exact(places.len().max(1));
        let steps: Vec<f64> = part.columns.iter().map(|&column| step[column]).collect();
        for ((&place, score), from) in places.iter().zip(part.score.iter()).zip(blocks) {
            let column = place * order..(place + 1) * order;
            let (to, slope) = (&mut own[column.clone()], &mut slope[column]);
            let mut moved = 0.0;
            for ((&row, value), step) in places.iter().zip(from).zip(&steps) {
                to[row] += value;
                slope[row] += value;
                moved += value * step;
            }
            // a row of the symmetric information is its column
            self.score[place] += score - moved;
        }
    }

    /// Adds columns that are not yet there.
    fn cover(&mut self, columns: &[usize]) {
        let place = |own: &[usize], column: &usize| own.binary_search(column).ok();
        if columns.iter().all(|column| place(&self.columns, column).is_some()) {
            return;
        }
        let mut all = [&self.columns, columns].concat();
        all.sort_unstable();
        all.dedup();
        let before: Vec<_> = all.iter().map(|column| place(&self.columns, column)).collect();
        for own in [&mut self.information, &mut self.slope] {
            let element = |i: usize, j: usize| Some(own[(before[i]?, before[j]?)]);
            *own = DMatrix::from_fn(all.len(), all.len(), |i, j| element(i, j).unwrap_or(0.0));
        }
        let score = |i: usize| before[i].map_or(0.0, |place| self.score[place]);
        self.score = DVector::from_fn(all.len(), |i, _| score(i));
        self.columns = all;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;

    /// The excess for blocks of one error whose scores are correlated from block to block.
    fn excess(seed: u64, correlation: f64) -> f64 {
        let (mut random, mut clusters) = (Random::new(seed), Clusters::default());
        let (mut known, mut mean) = (1.0, 0.0);
        let mut normal = || (0..12).map(|_| random.uniform()).sum::<f64>() - 6.0;
        let mut lasting: Vec<f64> = (0..30).map(|_| normal()).collect();
        for k in 0..100 {
            let scores: Vec<f64> = lasting.iter().map(|own| own - mean).collect();
            let posterior = 1.0 / (1.0 / known + 30.0);
            let step = DVector::from_element(1, posterior * scores.iter().sum::<f64>());
            let part = |(target, score): (i64, &f64)| Part {
                target,
                columns: vec![0],
                information: DMatrix::from_element(1, 1, 1.0),
                score: DVector::from_element(1, *score),
                azimuths: vec![(0, 0.005)],
            };
            let parts: Vec<Part> = (0..).zip(&scores).map(part).collect();
            clusters.add(&parts, &step, f64::from(k));
            (known, mean) = (posterior, mean + step[0]);
            let fresh = (1.0 - correlation * correlation).sqrt();
            lasting.iter_mut().for_each(|own| *own = correlation * *own + fresh * normal());
        }
        clusters.excess(&DMatrix::from_element(1, 1, known)).unwrap()
    }

    #[test]
    fn errors_that_last_are_found() {
        assert!((1..9).all(|seed| excess(seed, 0.0) == 1.0));
        // (1 + r) / (1 − r) = 9 for a correlation r of 0.8
        let found = (1..9).map(|seed| excess(seed, 0.8)).sum::<f64>() / 8.0;
        assert!((7.5..10.5).contains(&found), "{found}");
    }

    /// Variance between 40 targets whose azimuth errors have this standard deviation, in units of the prior.
    fn apart(seed: u64, sigma: f64) -> f64 {
        let (mut random, mut clusters) = (Random::new(seed), Clusters::default());
        let mut normal = || (0..12).map(|_| random.uniform()).sum::<f64>() - 6.0;
        let own: Vec<f64> = (0..40).map(|_| sigma * normal()).collect();
        for time in 0..50 {
            for (target, error) in (0..).zip(&own) {
                clusters.add(
                    &[Part {
                        target,
                        columns: vec![1],
                        information: DMatrix::from_element(1, 1, 4.0),
                        score: DVector::from_element(1, 4.0 * error + 2.0 * normal()),
                        azimuths: vec![(1, 0.002)],
                    }],
                    &DVector::zeros(2),
                    f64::from(time),
                );
            }
        }
        let found = clusters.apart(&DMatrix::from_diagonal_element(2, 2, 1.0 / 8000.0), 3.0);
        assert_eq!(found[0], 0.0);
        found[1]
    }

    #[test]
    fn differences_between_targets_are_found() {
        assert!((1..9).filter(|&seed| apart(seed, 0.0) == 0.0).count() >= 7);
        let found = (1..9).map(|seed| apart(seed, 0.5)).sum::<f64>() / 8.0;
        assert!((0.2..0.3).contains(&found), "{found}");
    }
}
