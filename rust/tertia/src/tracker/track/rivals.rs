//! Evidence that a track is a reflection, which is collected even after the track was confirmed: at that
//! time, the track of the target may have been unknown, or either track could have been the reflection of the
//! other.

use super::suspicion::{Reflection, Suspicion};
use crate::tracker::plot::Measured;
use serde::{Deserialize, Serialize};

/// Least number of plots, and least logarithm of the odds, with which a reflection is certain.
const ENOUGH: f64 = 5.0;
const SURE: f64 = 6.9;
/// A target and its side lobe are at the same range. A track is taken for the side lobe if it was missed in
/// at least `MISSED` scans, and in `OUTWEIGHED` more for each scan in which it was seen without the other
/// track.
const MISSED: f64 = 4.0;
const OUTWEIGHED: f64 = 2.0;

/// The tracks of which a track may be a reflection.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Rivals {
    /// Radar of the first plot that was compared: the reflection is of this radar.
    radar: Option<usize>,
    all: Vec<Rival>,
    /// Whether the track is certainly a reflection of one of the rivals.
    pub is_sure: bool,
}

/// A track of which another track may be a reflection.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Rival {
    suspicion: Suspicion,
    /// Time of the first plot of the suspected track that was compared with the rival, s; number of these
    /// plots; number of them in whose scans the rival was not seen.
    since: f64,
    plots: f64,
    unseen: f64,
}

impl Rivals {
    /// Updates the evidence by one more plot of the suspected track and the `reflections` that this plot may
    /// be. Cost O(reflections²).
    pub fn weigh<'a>(
        &mut self,
        plot: &Measured,
        reflections: impl Iterator<Item = &'a Reflection> + Clone,
        period: f64,
    ) {
        if !plot.identities.is_some() {
            return;
        }
        // a plot of another radar is no reflection by the same reflector
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

    /// Updates the evidence by one more plot of the suspected track. Returns whether this track is missed so
    /// much more often than the rival that it is the side lobe.
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
    use super::super::suspicion::tests::reflection;
    use super::*;
    use crate::sensors::Identities;

    const PERIOD: f64 = 4.0;

    fn plot(scan: usize) -> Measured {
        let time = PERIOD * scan as f64;
        Measured { time, identities: Identities::of(1), ..Measured::default() }
    }

    /// Whether a track is certainly a reflection after these scans. For each scan: whether the track is seen,
    /// and whether the other one is.
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
        let one = reflection(5e3, 7.0);
        assert!(after(&[(true, true); 8], one) && !after(&[(true, true); 4], one));
        let unsure = Reflection { is_unsure: true, ..one };
        assert!(!after(&[(true, true); 8], unsure));
        // if the target is not seen where it should be, the track is no reflection
        assert!(!after(&[(true, false); 8], one));
    }

    #[test]
    fn the_track_that_is_missed_more_often_is_the_side_lobe() {
        let (both, only, other) = ((true, true), (true, false), (false, true));
        let one = reflection(0.0, 7.0);
        assert!(!after(&[both; 60], one));
        assert!(after(&[other, both, both, other].repeat(4), one));
        assert!(!after(&[both, both, both, both, both, only, other].repeat(8), one));
        assert!(!after(&[only, both, both, only].repeat(4), one));
    }

    #[test]
    fn what_another_radar_sees_is_no_reflection() {
        let one = reflection(5e3, 7.0);
        let mut own = Rivals::default();
        for scan in 0..30 {
            let radar = scan % 2;
            own.weigh(&Measured { radar, ..plot(scan) }, [one].iter(), PERIOD);
            assert!(!own.is_sure);
        }
    }
}
