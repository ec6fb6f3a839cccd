//! Information of many blocks about the errors of the radars.

use super::block::{Block, Known, Unknowns};
use super::clusters::Part;
use super::history::Said;
use super::parallax::{common_range, hide};
use super::sighting::{AZIMUTH, Errors, Sighting};
use super::targets::{TargetPlot, Ways, for_each};
use crate::base::distribution::chi_square_upper;
use nalgebra::{DMatrix, DVector};

/// Acceleration of a target in a block, in straight flight and in a turn, m/s².
const STRAIGHT: f64 = 0.3;
const TURN: f64 = 4.0;
/// Probability of a turn above which a block is taken for a turn.
const TURNING: f64 = 0.3;
/// A block with a smaller p-value contains a plot of another target, or the target moves in an unexpected
/// way.
const SIGNIFICANCE: f64 = 1e-3;
/// Largest number of plots that are left out of a block, and their least residual in standard deviations.
const LEFT_OUT: usize = 2;
const OUTLIER: f64 = 3.5;

/// Sums over blocks.
#[derive(Clone)]
pub(super) struct Sums {
    pub information: DMatrix<f64>,
    pub score: DVector<f64>,
    /// Squares of the residuals and their redundancy.
    pub square: Vec<[f64; 2]>,
    pub redundancy: Vec<[f64; 2]>,
    pub blocks: [usize; 2],
    /// The blocks of targets that do not turn.
    pub parts: Vec<Part>,
}

impl Sums {
    pub fn new(order: usize, radars: usize) -> Self {
        Self {
            information: DMatrix::identity(order, order),
            score: DVector::zeros(order),
            square: vec![[0.0; 2]; radars],
            redundancy: vec![[0.0; 2]; radars],
            blocks: [0; 2],
            parts: Vec::new(),
        }
    }

    /// Sums the squares, redundancies and numbers of blocks of several sums.
    pub fn total(sums: &[Self], radars: usize) -> Self {
        let mut total = Self::new(0, radars);
        for own in sums {
            for k in 0..radars {
                for axis in 0..2 {
                    total.square[k][axis] += own.square[k][axis];
                    total.redundancy[k][axis] += own.redundancy[k][axis];
                }
            }
            (0..2).for_each(|i| total.blocks[i] += own.blocks[i]);
        }
        total
    }

    /// Returns the information of blocks that were corrected for these errors, and their score about the
    /// means of the prior.
    pub fn said(self, errors: &[Errors], unknowns: &Unknowns, mean: &[Errors]) -> Said {
        let order = self.score.len();
        let mut removed = DVector::zeros(order);
        for_each(unknowns, |k, j, column, sigma| {
            removed[column] = (errors[k][j] - mean[k][j]) / sigma;
        });
        let information = self.information - DMatrix::identity(order, order);
        Said { score: self.score + &information * removed, information }
    }

    /// Adds a block without the plots that do not fit.
    pub fn add(
        &mut self,
        plots: &[TargetPlot],
        ways: &Ways<'_>,
        unknowns: &Unknowns,
        errors: &[Errors],
        factor: &[[f64; 2]],
        known: &mut Known<'_>,
    ) {
        let turns = plots.iter().any(|plot| plot.turn_probability > TURNING);
        let acceleration = if turns { TURN } else { STRAIGHT };
        let mut sightings = ways.sightings(plots, errors, factor);
        for left_out in 0..=LEFT_OUT {
            let Some(block) = Block::new(&sightings, unknowns, acceleration) else { return };
            let Some((step, misfit)) = block.fit(known) else { return };
            let residuals = block.residuals(&step);
            // the test is only needed for a misfit above its mean
            let fits =
                misfit <= block.free as f64 || chi_square_upper(misfit, block.free) >= SIGNIFICANCE;
            if fits {
                let target = (!turns).then_some(plots[0].target);
                return self.take(block, target, (&sightings, unknowns), &residuals);
            }
            let off = residuals.iter().zip(&block.redundancy).map(|(own, free)| off(own, free));
            let worst = off.enumerate().max_by(|a, b| a.1.total_cmp(&b.1));
            match worst {
                Some((i, off)) if left_out < LEFT_OUT && off > OUTLIER * OUTLIER => {
                    sightings.remove(i);
                }
                _ => break,
            }
        }
        self.blocks[1] += 1;
    }

    fn take(
        &mut self,
        mut block: Block,
        target: Option<i64>,
        (sightings, unknowns): (&[Sighting], &Unknowns),
        residuals: &[[f64; 2]],
    ) {
        // the noise of plots beside positions, whose sigmas are enlarged, would be underestimated
        let is_polar = sightings.iter().all(|one| !one.is_placed);
        let parts = sightings.iter().zip(residuals.iter().zip(&block.redundancy));
        for (one, (own, free)) in parts.filter(|_| is_polar) {
            for axis in 0..2 {
                self.square[one.radar][axis] += own[axis] * own[axis];
                self.redundancy[one.radar][axis] += free[axis];
            }
        }
        // a single radar gives no information about its errors
        if sightings.iter().all(|one| one.radar == sightings[0].radar) {
            return;
        }
        if let Some(common) = common_range(sightings, &block.columns, unknowns) {
            hide(&mut block.information, &mut block.score, &common);
        }
        self.blocks[0] += 1;
        for (i, &row) in block.columns.iter().enumerate() {
            self.score[row] += block.score[i];
            for (j, &column) in block.columns.iter().enumerate() {
                self.information[(row, column)] += block.information[(i, j)];
            }
        }
        if let Some(target) = target {
            let azimuths = azimuths(sightings, unknowns);
            let Block { columns, information, score, .. } = block;
            self.parts.push(Part { target, columns, information, score, azimuths });
        }
    }
}

/// Returns columns and prior sigmas of the azimuth errors of the radars of these sightings.
fn azimuths(sightings: &[Sighting], unknowns: &Unknowns) -> Vec<(usize, f64)> {
    let mut found = Vec::new();
    for one in sightings.iter().filter(|one| !one.is_placed) {
        if let Some(own) = unknowns[one.radar][AZIMUTH].filter(|own| !found.contains(own)) {
            found.push(own);
        }
    }
    found
}

/// Returns the larger squared residual of a plot over its redundancy.
fn off(residuals: &[f64; 2], redundancy: &[f64; 2]) -> f64 {
    let one = |axis: usize| residuals[axis] * residuals[axis] / redundancy[axis].max(1e-9);
    one(0).max(one(1))
}
