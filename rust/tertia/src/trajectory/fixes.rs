//! Every instant located on its own.

use super::failure::Failure;
use super::measured::{Measured, REDUNDANCY, Record};
use crate::batch::for_each_row;
use crate::location::{BLOCK, Fix, Instant, Locator, Method, Output, Status, Workspace};

/// Cost of an instant per number, for the choice of threads.
const LOCATE_NS: f64 = 500.0;

/// Positions of the single instants.
#[derive(Clone, Debug)]
pub struct Fixes {
    /// (N, D); nan where there is none.
    pub position: Vec<f64>,
    /// (N, D, D)
    pub covariance: Vec<f64>,
    /// Whitened residuals (N, 5, K).
    pub residual: Vec<f64>,
    /// Measurements without weight (N, 5, K).
    pub outlier: Vec<bool>,
    /// What else came out of each instant.
    pub fixes: Vec<Fix>,
    /// By how much larger errors may be than stated without being left out.
    pub(super) tolerance: f64,
}

impl Fixes {
    /// Locates instants with these weights; those that are as before are not located again.
    pub(super) fn locate<const D: usize>(
        record: &Record<'_>,
        measured: &Measured<D>,
        trust: &[f64],
        tolerance: f64,
        before: Option<(&Self, &[f64])>,
    ) -> Result<Self, Failure> {
        let (n, width) = (record.len(), record.width());
        let changed: Vec<usize> = match before {
            None => (0..n).collect(),
            Some((_, old)) => {
                let pairs = trust.chunks_exact(width).zip(old.chunks_exact(width));
                pairs.enumerate().filter(|(_, (new, old))| new != old).map(|(t, _)| t).collect()
            }
        };
        let mut values = Vec::with_capacity(changed.len() * width);
        let mut sigmas = Vec::with_capacity(changed.len() * width);
        for &t in &changed {
            for place in 0..width {
                let weight = trust[t * width + place];
                let value = measured.values[t * width + place];
                values.push(if weight == 0.0 { f64::NAN } else { value });
                let root = if weight == 0.0 { 1.0 } else { weight.sqrt() };
                sigmas.push(tolerance * record.sigmas[place] / root);
            }
        }
        let mut new = Self::empty(changed.len(), width, D);
        new.fill::<D>(record, &changed, &values, &sigmas);
        if tolerance != 1.0 {
            new.as_stated(tolerance);
        }
        let all = match before {
            None => new,
            Some((old, _)) => {
                let mut all = old.clone();
                for (at, &t) in changed.iter().enumerate() {
                    copy(&mut all.position, t, &new.position, at, D);
                    copy(&mut all.covariance, t, &new.covariance, at, D * D);
                    copy(&mut all.residual, t, &new.residual, at, width);
                    copy(&mut all.outlier, t, &new.outlier, at, width);
                    all.fixes[t] = new.fixes[at];
                }
                all
            }
        };
        all.located()
    }

    /// What standard deviations that were enlarged make of what came out, undone.
    fn as_stated(&mut self, tolerance: f64) {
        self.tolerance = tolerance;
        self.residual.iter_mut().for_each(|v| *v *= tolerance);
        self.covariance.iter_mut().for_each(|v| *v /= tolerance * tolerance);
    }

    /// Locates all instants, from these values and standard deviations (N, 5, K).
    pub(super) fn of<const D: usize>(
        record: &Record<'_>,
        values: &[f64],
        sigmas: &[f64],
    ) -> Result<Self, Failure> {
        let all: Vec<usize> = (0..record.len()).collect();
        let mut fixes = Self::empty(all.len(), record.width(), D);
        fixes.fill::<D>(record, &all, values, sigmas);
        fixes.located()
    }

    /// Fails if no instant is.
    fn located(self) -> Result<Self, Failure> {
        if (0..self.fixes.len()).any(|t| self.is_located(t)) {
            return Ok(self);
        }
        let mut reasons: Vec<u8> = self.fixes.iter().map(|fix| fix.status as u8).collect();
        reasons.sort_unstable();
        reasons.dedup();
        Err(Failure::NotLocated(reasons))
    }

    fn empty(n: usize, width: usize, d: usize) -> Self {
        Self {
            position: vec![f64::NAN; n * d],
            covariance: vec![f64::NAN; n * d * d],
            residual: vec![f64::NAN; n * width],
            outlier: vec![false; n * width],
            fixes: vec![Fix::UNKNOWN; n],
            tolerance: 1.0,
        }
    }

    fn fill<const D: usize>(
        &mut self,
        record: &Record<'_>,
        instants: &[usize],
        values: &[f64],
        sigmas: &[f64],
    ) {
        let width = record.width();
        let method = if record.robust { Method::Robust(REDUNDANCY) } else { Method::LeastSquares };
        let locator = Locator::new(method).with_correlation(record.correlation);
        let cost = LOCATE_NS * values.len() as f64;
        let outputs = self
            .position
            .chunks_mut(D * BLOCK)
            .zip(self.covariance.chunks_mut(D * D * BLOCK))
            .zip(self.residual.chunks_mut(width * BLOCK))
            .zip(self.outlier.chunks_mut(width * BLOCK))
            .zip(self.fixes.chunks_mut(BLOCK));
        let blocks = instants.chunks(BLOCK).zip(outputs).enumerate();
        // nothing can fail
        let _ = for_each_row(
            blocks,
            cost,
            record.n_threads,
            Workspace::default,
            |workspace: &mut Workspace<D>, (block, (own, out))| {
                let ((((position, covariance), residual), outlier), fixes) = out;
                let at = |i: usize| (block * BLOCK + i) * width;
                let given: Vec<_> = own
                    .iter()
                    .enumerate()
                    .map(|(i, &t)| Instant {
                        stations: record.stations_at(t, D),
                        axes: record.axes_at(t, D),
                        values: &values[at(i)..][..width],
                        sigmas: &sigmas[at(i)..][..width],
                        position_sigmas: None,
                        height: None,
                        initial: None,
                    })
                    .collect();
                let mut out: Vec<_> = position
                    .chunks_mut(D)
                    .zip(covariance.chunks_mut(D * D))
                    .zip(residual.chunks_mut(width))
                    .zip(outlier.chunks_mut(width))
                    .map(|(((position, covariance), residual), outlier)| Output {
                        position,
                        covariance,
                        residual,
                        outlier,
                    })
                    .collect();
                locator.locate_all(&given, &mut out, fixes, workspace);
                Ok(())
            },
        );
    }

    pub(super) fn is_located(&self, t: usize) -> bool {
        self.fixes[t].status == Status::None
    }
}

fn copy<T: Copy>(to: &mut [T], t: usize, from: &[T], at: usize, size: usize) {
    to[t * size..][..size].copy_from_slice(&from[at * size..][..size]);
}
