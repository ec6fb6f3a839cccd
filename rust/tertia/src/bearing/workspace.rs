//! Buffers for an estimate.

use super::blocks::BlockTable;
use super::hypotheses::Hypotheses;
use crate::base::angle::unwrap_about_median;
use crate::base::error::Result;
use crate::base::moments::Moments;
use crate::base::scratch::refill;

/// Buffers that are reused for each row.
#[derive(Clone, Debug, Default)]
pub struct Workspace {
    pub(super) angle: Vec<f64>,
    pub(super) cleaned: Vec<f64>,
    pub(super) scratch: Vec<f64>,
    pub(super) blocks: BlockTable,
    pub(super) hypotheses: Hypotheses,
}

impl Workspace {
    /// Copies the angles that are no outliers to `scratch`; returns their moments.
    pub(super) fn keep(&mut self, outlier: &[bool]) -> Result<Moments> {
        let kept = self.angle.iter().zip(outlier).filter(|(_, flag)| !**flag);
        self.scratch.clear();
        self.scratch.extend(kept.map(|(v, _)| v));
        Moments::of("theta", &self.scratch)
    }

    /// Copies the angles of one sample and unwraps them.
    pub(super) fn read(&mut self, theta: &[f64], period: Option<f64>) -> Result<()> {
        refill(&mut self.cleaned, theta.len(), 0.0);
        self.angle.clear();
        self.angle.extend_from_slice(theta);
        match period {
            Some(period) => unwrap_about_median(theta, period, &mut self.angle, &mut self.scratch),
            None => Ok(()),
        }
    }
}
