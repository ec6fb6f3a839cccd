//! What a tracker has estimated about the plots of its sensors.

use super::Tracker;
use crate::tracker::noise::Noise;
use crate::tracker::noise::duplicates::Doubles;
use crate::tracker::settings::Settings;

impl Tracker {
    /// Noise factor of each sensor, estimated over stated sigma, by its last plots of confirmed tracks; nan
    /// until there are enough of them.
    pub fn noise_factors(&self) -> impl Iterator<Item = f64> {
        self.noise.iter().map(Noise::told)
    }

    /// Standard deviations of range (m) and azimuth (rad) of each radar: as they were used last, and as they
    /// were estimated; the latter are 0 unless they are significantly larger than stated.
    pub fn noise(&self) -> Vec<[[f64; 2]; 2]> {
        self.noise.iter().map(|noise| [noise.used, noise.found()]).collect()
    }

    /// Number of tracks, the settings, and the shortest interval between reports of a target by one sensor, s;
    /// infinite if none is much shorter than stated.
    pub(in crate::tracker) fn known(&self) -> (usize, &Settings, f64) {
        let intervals = self.noise.iter().map(|noise| noise.interval.seconds());
        (self.tracks.len(), &self.settings, intervals.fold(f64::INFINITY, f64::min))
    }

    /// Takes over what another tracker has estimated about the plots of the same sensors: their noise, the
    /// shares of outliers and of second plots, the density of false plots and fixed echoes. Returns whether
    /// any of these differs from what is stated or usual.
    pub(in crate::tracker) fn learn_plots(&mut self, other: &Self) -> bool {
        self.noise.clone_from(&other.noise);
        self.noise.iter_mut().for_each(Noise::restart);
        self.doubles.clone_from(&other.doubles);
        self.settings.delays.clone_from(&other.settings.delays);
        for (own, other) in self.clutter.iter_mut().zip(&other.clutter) {
            own.learn(other);
        }
        let mut clutter = self.clutter.iter().zip(&self.settings.radars);
        clutter.any(|(own, radar)| own.has_fixed(radar) || own.is_uneven(radar))
            || self.noise.iter().any(|noise| noise.differs() || noise.outliers.are_many())
            || self.doubles.iter().any(Doubles::is_often)
            || self.settings.delays.iter().flatten().any(|own| own.sigma > 0.0)
    }
}
