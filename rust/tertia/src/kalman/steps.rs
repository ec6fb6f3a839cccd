//! Room for the states of a series.

use super::state::{Innovation, State, wrapped};

/// Room that the caller provides for the states after all steps; empty for what is not wanted.
#[derive(Debug)]
pub struct Steps<'a> {
    /// Means, three numbers per step.
    pub mean: &'a mut [f64],
    /// Upper triangles of covariances, six numbers per step.
    pub covariance: &'a mut [f64],
    /// Innovations, one per step.
    pub innovation: &'a mut [f64],
    /// Variances of the innovations, one per step.
    pub variance: &'a mut [f64],
}

impl Steps<'_> {
    /// Returns the numbers per step in each room; 0 for what is not wanted.
    pub(super) fn widths(&self) -> [usize; 4] {
        let width = |room: &[f64], width| if room.is_empty() { 0 } else { width };
        [
            width(self.mean, 3),
            width(self.covariance, 6),
            width(self.innovation, 1),
            width(self.variance, 1),
        ]
    }

    /// Copies the first `count` steps of `others` to the steps from `from` on, as far as there is room.
    pub(super) fn take(&mut self, from: usize, count: usize, others: &Steps<'_>) {
        let pairs = [
            (&mut self.mean, &others.mean, 3),
            (&mut self.covariance, &others.covariance, 6),
            (&mut self.innovation, &others.innovation, 1),
            (&mut self.variance, &others.variance, 1),
        ];
        for (room, values, width) in pairs {
            let room = room.get_mut(width * from..width * (from + count));
            if let (Some(room), Some(values)) = (room, values.get(..width * count)) {
                room.copy_from_slice(values);
            }
        }
    }

    /// Writes the state and the innovation of a step, with the angle in [0, period).
    #[inline(always)]
    pub fn put(&mut self, step: usize, state: &State, innovation: Innovation, period: Option<f64>) {
        if let Some(mean) = self.mean.get_mut(3 * step..3 * step + 3) {
            mean.copy_from_slice(&state.mean);
            if let Some(period) = period {
                mean[0] = wrapped(mean[0], period);
            }
        }
        if let Some(covariance) = self.covariance.get_mut(6 * step..6 * step + 6) {
            covariance.copy_from_slice(&state.covariance);
        }
        if let Some(value) = self.innovation.get_mut(step) {
            *value = innovation.value;
        }
        if let Some(variance) = self.variance.get_mut(step) {
            *variance = innovation.variance;
        }
    }
}
