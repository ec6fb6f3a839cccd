//! What a tracker has found of the plots of its sensors.

use super::doubles::Doubles;
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

    /// Takes over what another tracker has found of the plots of the same sensors: their noise, how many are
    /// outliers and second plots, and where they come again and again. Returns whether any differs from
    /// what is stated or usual.
    pub(super) fn learn_plots(&mut self, other: &Self) -> bool {
        self.noise.clone_from(&other.noise);
        self.noise.iter_mut().for_each(Noise::restart);
        self.doubles.clone_from(&other.doubles);
        for (own, other) in self.clutter.iter_mut().zip(&other.clutter) {
            own.learn(other);
        }
        let mut clutter = self.clutter.iter().zip(&self.settings.radars);
        clutter.any(|(own, radar)| own.has_fixed(radar) || own.is_uneven(radar))
            || self.noise.iter().any(|noise| noise.differs() || noise.outliers.are_many())
            || self.doubles.iter().any(Doubles::is_often)
    }
}
