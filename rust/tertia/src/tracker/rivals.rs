//! What speaks for it that a track is a reflection although it may be confirmed: the track of its target was
//! unknown then, or could as well be the reflection.

use super::plot::Measured;
use super::suspicion::{Reflection, Suspicion};
use serde::{Deserialize, Serialize};

/// Plots of a reflection after which it is sure, if the logarithm of its odds is so large.
const ENOUGH: f64 = 5.0;
const SURE: f64 = 6.9;
/// Of a target and its side lobe, which are at one range, the side lobe is missed in so many scans more than the target; each scan
/// in which only the side lobe is seen outweighs so many.
const MISSED: f64 = 4.0;
const OUTWEIGHED: f64 = 2.0;

/// Tracks of which one may be the target whose reflection a track is.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Rivals {
    /// Of the first plot that was compared.
    radar: Option<usize>,
    all: Vec<Rival>,
    /// Whether the track is a reflection of one of them.
    pub is_sure: bool,
}

/// One of them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Rival {
    suspicion: Suspicion,
    /// First plot of the track that was compared with it, s, how many were, and in how many of their scans it
    /// was not seen.
    since: f64,
    plots: f64,
    unseen: f64,
}

impl Rivals {
    /// Weighs one more plot of a track, by the reflections that the plot may be. Cost O(reflections²).
    pub fn weigh<'a>(
        &mut self,
        plot: &Measured,
        reflections: impl Iterator<Item = &'a Reflection> + Clone,
        period: f64,
    ) {
        if !plot.identities.is_some() {
            return;
        }
        // of another radar it is no reflection
        let is_same = *self.radar.get_or_insert(plot.radar) == plot.radar;
        let reflections = reflections.filter(|_| is_same);
        self.is_sure = false;
        for rival in &mut self.all {
            let number = rival.suspicion.track();
            let found = reflections.clone().find(|one| one.track == number);
            let is_weaker = rival.compare(plot, found, period);
            let is_of_it = |one: &Reflection| !one.is_unsure && (one.is_farther() || is_weaker);
            let is_likely = rival.suspicion.is_at_least(ENOUGH, SURE);
            self.is_sure |= is_likely && found.is_some_and(is_of_it);
        }
        self.all.retain(|rival| rival.suspicion.holds());
        for one in reflections {
            let is_new = self.all.iter().all(|rival| rival.suspicion.track() != one.track);
            let suspicion = Suspicion::of(plot, [one].into_iter()).filter(|_| is_new);
            self.all.extend(suspicion.map(|suspicion| Rival::new(suspicion, plot)));
        }
    }
}

impl Rival {
    fn new(suspicion: Suspicion, plot: &Measured) -> Self {
        Self { suspicion, since: plot.time, plots: 1.0, unseen: 0.0 }
    }

    /// Weighs one more plot. Returns whether its track is missed more often than this one.
    fn compare(&mut self, plot: &Measured, found: Option<&Reflection>, period: f64) -> bool {
        self.suspicion.compare(found);
        self.plots += 1.0;
        self.unseen += f64::from(u8::from(found.is_none_or(|one| !one.is_seen)));
        let missed = ((plot.time - self.since) / period).round() + 1.0 - self.plots;
        missed >= MISSED + OUTWEIGHED * self.unseen
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensors::Identities;

    const PERIOD: f64 = 4.0;

    fn plot(scan: usize) -> Measured {
        let time = PERIOD * scan as f64;
        Measured { time, identities: Identities::of(1), ..Measured::default() }
    }

    /// By a reflector at a distance, or a side lobe.
    fn reflection(distance: f64) -> Reflection {
        let (plot, track, variance, log_odds) = (0, 1, 1e4, 7.0);
        let (is_seen, is_unsure, is_beside) = (true, false, distance == 0.0);
        let since = if is_beside { 0.0 } else { f64::NEG_INFINITY };
        Reflection {
            plot,
            track,
            distance,
            variance,
            log_odds,
            is_seen,
            is_unsure,
            since,
            is_beside,
        }
    }

    /// Whether a track is a reflection after these scans: whether it is seen, and whether the other one is.
    fn after(scans: &[(bool, bool)], one: Reflection) -> bool {
        let mut own = Rivals::default();
        for (scan, (is_seen, is_other_seen)) in scans.iter().enumerate() {
            if *is_seen {
                let found = is_other_seen.then_some(one);
                own.weigh(&plot(scan), found.iter(), PERIOD);
            }
        }
        own.is_sure
    }

    #[test]
    fn the_farther_track_is_the_reflection() {
        let one = reflection(5e3);
        assert!(after(&[(true, true); 8], one) && !after(&[(true, true); 4], one));
        let unsure = Reflection { is_unsure: true, ..one };
        assert!(!after(&[(true, true); 8], unsure));
        // a target that is not seen where it should be is no reason for a reflection
        assert!(!after(&[(true, false); 8], one));
    }

    #[test]
    fn the_track_that_is_missed_more_often_is_the_side_lobe() {
        let (both, only, other) = ((true, true), (true, false), (false, true));
        let one = reflection(0.0);
        assert!(!after(&[both; 60], one));
        assert!(after(&[other, both, both, other].repeat(4), one));
        assert!(!after(&[both, both, both, both, both, only, other].repeat(8), one));
        assert!(!after(&[only, both, both, only].repeat(4), one));
    }

    #[test]
    fn what_another_radar_sees_is_no_reflection() {
        let one = reflection(5e3);
        let mut own = Rivals::default();
        for scan in 0..30 {
            let radar = scan % 2;
            own.weigh(&Measured { radar, ..plot(scan) }, [one].iter(), PERIOD);
            assert!(!own.is_sure);
        }
    }
}
