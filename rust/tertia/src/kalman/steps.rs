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
    /// Whether nothing is wanted.
    #[inline(always)]
    pub(super) fn is_empty(&self) -> bool {
        let rooms = [&self.mean, &self.covariance, &self.innovation, &self.variance];
        rooms.iter().all(|room| room.is_empty())
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
