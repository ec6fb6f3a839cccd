//! Updating the errors and the noise of radars by the blocks of a scan.

use super::{CHANGE, CHANGE_TIME, MEMORY, Registrar};
use crate::registration::block::Known;
use crate::registration::change::{Change, Scan, changed};
use crate::registration::gaussian::scaled;
use crate::registration::recording::factor;
use crate::registration::sums::Sums;
use crate::registration::targets::{TargetPlot, Ways, for_each};
use nalgebra::DMatrix;

impl Registrar {
    /// Updates the errors by the blocks of a scan.
    pub(super) fn step(&mut self, blocks: &[Vec<TargetPlot>], time: f64) {
        let (order, unknowns) = (self.known.mean.len(), self.unknowns());
        let mut sums = Sums::new(order, self.radars.len());
        let errors = self.errors();
        let mut known = Known::new(&self.known.covariance);
        let ways = Ways { radars: &self.radars, slant: &self.slant };
        let noise: Vec<_> = (0..self.radars.len()).map(|k| self.believed(k)).collect();
        for block in blocks {
            sums.add(block, &ways, &unknowns, &errors, &noise, &mut known);
        }
        self.learn_noise(&sums, &noise);
        if sums.blocks[0] == 0 || order == 0 {
            return;
        }
        let information = sums.information - DMatrix::identity(order, order);
        let score = (sums.score + &information * &self.known.mean) / self.excess;
        let information = information / self.excess;
        let (mean, covariance) = (self.known.mean.clone(), self.known.covariance.clone());
        self.known.update(&information, &score);
        self.clusters.add(&sums.parts, &(&self.known.mean - &mean), time);
        self.clusters.forget(time);
        self.recent.retain(|scan| time - scan.time <= CHANGE_TIME);
        self.recent.push(Scan { time, information, score, mean, covariance });
        self.widen();
        self.find_change(time);
    }

    /// Compares the blocks of each target with what they state together, and scales all information by the
    /// change of the excess.
    fn widen(&mut self) {
        let Some(stated) = scaled(&self.known.covariance, self.excess) else { return };
        let Some(excess) = self.clusters.excess(&stated).filter(|own| *own != self.excess) else {
            return;
        };
        let factor = self.excess / excess;
        self.known.scale(factor);
        for scan in &mut self.recent {
            scan.scale(factor);
        }
        self.excess = excess;
    }

    /// Updates the noise by the residuals of blocks, in which this noise was assumed.
    pub(super) fn learn_noise(&mut self, sums: &Sums, assumed: &[[f64; 2]]) {
        for (k, factor) in self.factor.iter_mut().enumerate() {
            for (axis, factor) in factor.iter_mut().enumerate() {
                let (squares, free) = (&mut self.squares[k][axis], &mut self.redundancy[k][axis]);
                *squares += assumed[k][axis].powi(2) * sums.square[k][axis];
                *free += sums.redundancy[k][axis];
                if *free > MEMORY {
                    *squares *= MEMORY / *free;
                    *free = MEMORY;
                }
                *factor = self::factor(*squares, *free);
            }
        }
    }

    /// Estimates the errors of radars anew that may have changed within the last scans.
    fn find_change(&mut self, time: f64) {
        let mut own: Vec<Vec<usize>> = vec![Vec::new(); self.radars.len()];
        for_each(&self.unknowns(), |k, _, column, _| own[k].push(column));
        let Some(Change { from, radars, size }) = changed(&self.recent, &own, CHANGE) else {
            return;
        };
        let scans = std::mem::take(&mut self.recent);
        self.known.mean = scans[from].mean.clone();
        self.known.covariance = scans[from].covariance.clone();
        for &column in radars.iter().flat_map(|&radar| &own[radar]) {
            self.known.covariance[(column, column)] += size * size;
        }
        self.clusters.clear();
        for scan in &scans[from..] {
            self.known.update(&scan.information, &scan.score);
        }
        self.changes.push((time, radars[0]));
    }
}
