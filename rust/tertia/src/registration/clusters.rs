//! By how much the blocks of plots overstate what is known of the errors of the sensors.
//!
//! The errors of plots may last from block to block: those of tracks of another system, of a transponder, of
//! reflections. The blocks of a target are then no independent evidence, and their scores add up to more than
//! their information states. As in cluster-robust standard errors (Liang & Zeger, Biometrika 73, 1986), with
//! targets as clusters, the ratio of the sums of squares is the factor by which the covariance is too small. It
//! is used if it is significant.

use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Time within which blocks of a target are compared, s.
const MEMORY: f64 = 600.0;
/// Standard deviations by which scores must exceed what is expected, and the least expected sum.
const SURE: f64 = 4.0;
const ENOUGH: f64 = 0.5;

/// What a block of plots of a target says about the errors in some columns.
#[derive(Clone, Debug)]
pub(super) struct Part {
    pub target: i64,
    pub columns: Vec<usize>,
    pub information: DMatrix<f64>,
    /// Score about the errors that were removed before.
    pub score: DVector<f64>,
}

/// Sums over the blocks of a target.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Cluster {
    time: f64,
    columns: Vec<usize>,
    information: DMatrix<f64>,
    /// Scores about the errors as they were estimated with each block.
    score: DVector<f64>,
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
        for Cluster { columns, information, score, .. } in self.0.values() {
            let known = covariance.select_rows(columns).select_columns(columns);
            let share = &known * information;
            let squares = share.dot(&share.transpose());
            found += score.dot(&(known * score));
            // the errors are estimated from the same blocks
            expected += (share.trace() - squares).max(0.0);
            variance += 2.0 * squares;
        }
        let is_sure = found > expected + SURE * variance.sqrt();
        (expected > ENOUGH).then(|| if is_sure { found / expected } else { 1.0 })
    }
}

impl Cluster {
    fn new(time: f64) -> Self {
        let (columns, information) = (Vec::new(), DMatrix::zeros(0, 0));
        Self { time, columns, information, score: DVector::zeros(0) }
    }

    fn add(&mut self, part: &Part, step: &DVector<f64>, time: f64) {
        let kept = ((self.time - time).min(0.0) / MEMORY).exp();
        self.time = self.time.max(time);
        self.score *= kept;
        // the variance of a weighted sum of scores
        self.information *= kept * kept;
        self.cover(&part.columns);
        // all columns are there
        let place = |column: &usize| self.columns.partition_point(|own| own < column);
        let places: Vec<usize> = part.columns.iter().map(place).collect();
        let (order, own) = (self.columns.len(), self.information.as_mut_slice());
        let blocks = part.information.as_slice().chunks_exact(places.len().max(1));
        let steps: Vec<f64> = part.columns.iter().map(|&column| step[column]).collect();
        for ((&place, score), from) in places.iter().zip(part.score.iter()).zip(blocks) {
            let to = &mut own[place * order..][..order];
            let mut moved = 0.0;
            for ((&row, value), step) in places.iter().zip(from).zip(&steps) {
                to[row] += value;
                moved += value * step;
            }
            // a row of the symmetric information is its column
            self.score[place] += score - moved;
        }
    }

    /// Adds columns that are not yet there.
    fn cover(&mut self, columns: &[usize]) {
        for &column in columns {
            if let Err(place) = self.columns.binary_search(&column) {
                self.columns.insert(place, column);
                let information = std::mem::replace(&mut self.information, DMatrix::zeros(0, 0));
                self.information = information.insert_row(place, 0.0).insert_column(place, 0.0);
                let score = std::mem::replace(&mut self.score, DVector::zeros(0));
                self.score = score.insert_row(place, 0.0);
            }
        }
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
}
