//! What a tracker has found of the noise of its sensors.

use super::live::Tracker;
use super::noise::Noise;

impl Tracker {
    /// Noise of each sensor over what it states, by its last plots of confirmed tracks; nan before there
    /// are enough.
    pub fn noise_factors(&self) -> impl Iterator<Item = f64> {
        self.noise.iter().map(Noise::told)
    }

    /// Standard deviations of range (m) and azimuth (rad) of each radar, as they were used last, and as they
    /// were found; 0 where they are not surely larger than stated.
    pub fn noise(&self) -> Vec<[[f64; 2]; 2]> {
        self.noise.iter().map(|noise| [noise.used, noise.found()]).collect()
    }

    /// Takes over the noise that another tracker of the same sensors has found; returns whether any differs
    /// from what is stated.
    pub(super) fn learn_noise(&mut self, other: &Self) -> bool {
        self.noise.clone_from(&other.noise);
        self.noise.iter_mut().for_each(Noise::restart);
        self.noise.iter().any(Noise::differs)
    }
}
