//! Where the states of a series go.

use super::state::{Innovation, State, wrapped};

/// The caller's room for the states of all steps. What is not wanted is empty.
#[derive(Debug)]
pub struct Steps<'a> {
    /// Means, three numbers a step.
    pub mean: &'a mut [f64],
    /// Upper triangles of covariances, six.
    pub covariance: &'a mut [f64],
    /// Innovations.
    pub innovation: &'a mut [f64],
    /// Their variances.
    pub variance: &'a mut [f64],
}

impl Steps<'_> {
    /// Numbers of a step in each room; 0 where they are not wanted.
    pub(super) fn widths(&self) -> [usize; 4] {
        let width = |room: &[f64], width| if room.is_empty() { 0 } else { width };
        [
            width(self.mean, 3),
            width(self.covariance, 6),
            width(self.innovation, 1),
            width(self.variance, 1),
        ]
    }

    /// Takes over the first `count` steps of `others` as those from `from` on, as far as there is
    /// room.
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

    /// Keeps a step's state, with its angle in [0, period).
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
