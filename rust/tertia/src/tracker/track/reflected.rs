//! Tracks that may be reflections of other targets.

use super::{Stage, Track};
use crate::tracker::plot::Measured;
use crate::tracker::settings::Settings;
use crate::tracker::track::suspicion::{Reflection, Suspicion};

impl Track {
    /// Number of plots so far; none once the track is confirmed.
    pub fn hits(&self) -> Option<usize> {
        if let Stage::Tentative { hits, .. } = self.stage { Some(hits) } else { None }
    }

    /// Requires one more plot if another track has begun with the same identity: one of the two is
    /// the reflection of the other.
    pub fn wait_for(&mut self, reflections: &[Reflection]) {
        if self.hits() == Some(1) && reflections.iter().any(Reflection::is_mutual) {
            self.require_more();
        }
    }

    /// Updates the suspicion that the track is a reflection, by a plot and the `reflections` that
    /// this plot may be.
    pub fn suspect(&mut self, plot: &Measured, reflections: &[Reflection], settings: &Settings) {
        let (begin, period) = (self.first.time, settings.radars[plot.radar].scan_period);
        let own = reflections.iter().filter(|one| one.is_of_target(begin, period));
        match &mut self.suspicion {
            Some(suspicion) => suspicion.weigh(plot, own),
            None => self.suspicion = Suspicion::of(plot, own).map(Box::new),
        }
        if self.rivals.is_none() && reflections.iter().any(Reflection::is_likely) {
            self.rivals = Some(Box::default());
        }
        self.doubt(plot, reflections, settings);
    }

    /// Whether evidence is collected that the track is a reflection, even after its confirmation.
    pub fn is_doubted(&self) -> bool {
        self.rivals.is_some()
    }

    /// Collects evidence that the track is a reflection from its next plot on.
    pub fn begin_to_doubt(&mut self) {
        self.rivals.get_or_insert_default();
    }

    /// Updates the evidence that the track is a reflection, by a plot and the `reflections` that this plot
    /// may be; does nothing if no such evidence is collected.
    pub fn doubt(&mut self, plot: &Measured, reflections: &[Reflection], settings: &Settings) {
        let number = self.number;
        let period = settings.radars[plot.radar].scan_period;
        if let Some(rivals) = &mut self.rivals {
            let others = reflections.iter().filter(|one| one.track != number);
            rivals.weigh(plot, others, period);
        }
    }

    /// Whether the track is confirmed and was found to be a reflection nevertheless.
    pub fn is_refuted(&self) -> bool {
        self.is_confirmed() && self.rivals.as_ref().is_some_and(|rivals| rivals.is_sure)
    }

    /// Whether the track is more likely a reflection than not.
    pub fn is_reflection(&self) -> bool {
        self.suspicion.as_ref().is_some_and(|own| own.holds())
    }

    /// Likelihood ratio of the height of a plot: this target against any.
    pub fn height_ratio(&self, plot: &Measured) -> f64 {
        match self.vertical {
            Some(vertical) if plot.height.is_finite() => vertical.ratio(plot.time, plot.height),
            _ => 1.0,
        }
    }
}
