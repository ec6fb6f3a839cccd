//! Plots of two targets that the radar did not resolve.

use super::Track;
use crate::base::plane::Plane;
use crate::tracker::filter::resolution::Separation;
use crate::tracker::plot::Measured;
use crate::tracker::settings::Settings;

/// Moves a common plot of two tracks to their time; returns its position and its noise.
fn plot_of(tracks: [&Track; 2], plot: &Measured, settings: &Settings) -> ([f64; 2], Plane) {
    let [a, b] = tracks.map(|track| track.brought_here(plot, settings));
    let z = [0, 1].map(|i| 0.5 * (a.position[i] + b.position[i]));
    (z, a.covariance())
}

impl Track {
    /// Gain of a common plot of this target and another one, with the `odds` of its radar, against
    /// two missed detections of resolved targets; none outside the common gate.
    pub fn shared_score(
        &self,
        other: &Self,
        plot: &Measured,
        odds: f64,
        settings: &Settings,
    ) -> Option<f64> {
        let radar = &settings.radars[plot.radar];
        let pair = Separation::of(&self.estimate, &other.estimate, radar)?;
        let seen = plot_of([self, other], plot, settings);
        let (distance, density) = pair.compare([&self.estimate, &other.estimate], seen);
        if distance > settings.guard {
            return None;
        }
        // the odds are against one missed detection
        let second = (1.0 - radar.detection_probability).ln();
        let also = self.also(plot, settings).max(other.also(plot, settings));
        Some(pair.probability.ln() + odds - second + (density * also).ln())
    }

    /// Corrects by a common plot of this target and another one, whose state is the one before this
    /// plot.
    pub fn correct_shared(&mut self, other: &Self, plot: &Measured, settings: &Settings) {
        let radar = &settings.radars[plot.radar];
        let mut other = other.clone();
        for track in [&mut *self, &mut other] {
            track.predict(plot.time, settings.pace(plot.radar), settings);
        }
        let Some(pair) = Separation::of(&self.estimate, &other.estimate, radar) else { return };
        let (z, r) = plot_of([self, &other], plot, settings);
        let middle = [0, 1].map(|i| 0.5 * (self.estimate.mean[i] + other.estimate.mean[i]));
        let both = self.estimate.position_covariance().plus(other.estimate.position_covariance());
        self.innovation =
            ([z[0] - middle[0], z[1] - middle[1]], both.scaled(0.25).plus(r).plus(pair.spread()));
        pair.correct(&mut self.filter, &other.filter, (z, r));
        self.estimate = self.filter.estimate();
        self.merged = true;
        self.seen = self.seen.max(plot.time);
        self.take(plot, settings);
        self.follow(radar.scan_period, settings);
        self.set_swerve(settings);
    }
}
