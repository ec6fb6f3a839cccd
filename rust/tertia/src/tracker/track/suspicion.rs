//! Evidence that a track is the reflection of a target that its radar sees elsewhere.

use crate::tracker::plot::Measured;
use serde::{Deserialize, Serialize};

/// Standard deviation of the distance of a reflector due to its extent: in m, and as a share of the
/// distance.
pub(in crate::tracker) const EXTENT: f64 = 60.0;
const SLANTED: f64 = 0.01;
/// Number of scans by which the track of a target must have begun before another track at the same range, for
/// the other track to be its side lobe.
const BEFORE: f64 = 1.5;
/// Largest fall of the logarithm of the odds by one plot.
const STEP: f64 = -4.0;
/// Largest excess of the logarithm of the odds over the mean of those by single plots: the reflector of
/// another target may also seem to keep its distance.
const CONSTANT: f64 = 2.0;
/// Logarithm of the probability that the target of a reflection is not seen where the reflection
/// requires it to be.
const UNSEEN: f64 = -3.0;
/// Mean number of scans for which a reflection lasts: another target would be seen longer. A side lobe is
/// seen as long as the target is near, so plots at the range of the target do not count against it.
const LASTING: f64 = 15.0;

/// A plot, regarded as the reflection of a target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::tracker) struct Reflection {
    pub plot: usize,
    /// Number of the track of the target.
    pub track: u64,
    /// Distance of the reflector from the radar, 0 for a side lobe, and its variance, m and m².
    pub distance: f64,
    pub variance: f64,
    /// Logarithm of the odds that the plot is a reflection and not of another target, by this plot alone.
    pub log_odds: f64,
    /// Whether the radar has seen the target elsewhere in this scan, so that the plot is not of the
    /// target itself.
    pub is_seen: bool,
    /// Whether the target may be the reflection instead: its track is tentative, and has too few plots or is
    /// nearer to the radar only by less than the errors.
    pub is_unsure: bool,
    /// Time of the first plot of the target, s, if the plot may be of a side lobe (if both tracks are new,
    /// either may be the side lobe of the other); otherwise −∞.
    pub since: f64,
    /// Whether the plot is at the range of the target, as a plot of a side lobe is.
    pub is_beside: bool,
}

/// The suspicion that a track is the reflection of a target.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Suspicion {
    radar: usize,
    /// Number of the track of the target.
    track: u64,
    /// Mean over the plots of the distance of the reflector, m, and of the variance of this distance, m².
    distance: f64,
    variance: f64,
    plots: f64,
    /// Number of plots that were not at the range of the target, as those of a side lobe are.
    fading: f64,
    /// Logarithm of the odds of a reflection, and (`first`) the mean of the logarithms by each plot alone.
    log_odds: f64,
    first: f64,
}

impl Reflection {
    /// Whether the plot is more likely a reflection than of another target, but the target may be the
    /// reflection instead.
    pub fn is_mutual(&self) -> bool {
        self.is_unsure && self.is_likely()
    }

    /// Whether the plot is more likely a reflection than of another target.
    pub fn is_likely(&self) -> bool {
        self.is_seen && self.log_odds > 0.0
    }

    /// Whether the plot is certainly farther from the radar than the target, so that it cannot be of a side
    /// lobe.
    pub fn is_farther(&self) -> bool {
        self.since == f64::NEG_INFINITY
    }

    /// Whether the target is the original, and a track that began at this time the reflection.
    pub fn is_of_target(&self, begin: f64, period: f64) -> bool {
        !self.is_unsure && self.since < begin - BEFORE * period
    }
}

impl Suspicion {
    /// Returns the suspicion after the first plot; none if the plot is more likely of another target.
    pub fn of<'a>(
        plot: &Measured,
        reflections: impl Iterator<Item = &'a Reflection>,
    ) -> Option<Self> {
        let seen = reflections.filter(|one| one.is_likely());
        let one = seen.max_by(|a, b| a.log_odds.total_cmp(&b.log_odds))?;
        let Reflection { track, distance, variance, log_odds, .. } = *one;
        let (radar, plots, fading, first) = (plot.radar, 1.0, 0.0, log_odds);
        Some(Self { radar, track, distance, variance, plots, fading, log_odds, first })
    }

    /// Whether the track is more likely a reflection than another target.
    pub fn holds(&self) -> bool {
        self.log_odds > 0.0
    }

    /// Updates the odds by one more plot of the track: a reflector does not move.
    pub fn weigh<'a>(
        &mut self,
        plot: &Measured,
        mut reflections: impl Iterator<Item = &'a Reflection>,
    ) {
        if !self.holds() || !plot.identities.is_some() {
            return;
        }
        let is_own = |one: &&Reflection| one.track == self.track && plot.radar == self.radar;
        let one = reflections.find(is_own);
        let fades = one.is_some_and(|one| one.is_seen && !one.is_beside);
        self.fading += f64::from(u8::from(fades));
        self.compare(one);
        self.log_odds = self.log_odds.min(self.first - self.fading / LASTING);
    }

    /// Updates the odds by the distance of the reflector according to one more plot. `one` is none if
    /// this plot cannot be a reflection of the target.
    pub fn compare(&mut self, one: Option<&Reflection>) {
        let Some(one) = one else {
            self.log_odds += UNSEEN;
            return;
        };
        if one.is_seen {
            let log_odds = self.log_odds + (0.5 - 0.5 * self.square(one)).max(STEP);
            self.log_odds = log_odds.min(self.first + CONSTANT);
            self.plots += 1.0;
            self.distance += (one.distance - self.distance) / self.plots;
            self.variance += (one.variance - self.variance) / self.plots;
            self.first += (one.log_odds - self.first) / self.plots;
        }
    }

    /// Whether there are at least this many plots and the logarithm of the odds is at least `log_odds`.
    pub fn is_at_least(&self, plots: f64, log_odds: f64) -> bool {
        self.plots >= plots && self.log_odds >= log_odds
    }

    /// Returns the number of the track of the target.
    pub fn track(&self) -> u64 {
        self.track
    }

    /// Returns the squared normalised difference between the distance of the reflector and its mean so far.
    fn square(&self, one: &Reflection) -> f64 {
        let extent = EXTENT + SLANTED * self.distance.abs();
        let variance = one.variance + self.variance / self.plots + extent * extent;
        (one.distance - self.distance).powi(2) / variance
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::sensors::Identities;

    /// A reflection by a reflector at this distance, or a side lobe if the distance is 0.
    pub fn reflection(distance: f64, log_odds: f64) -> Reflection {
        let (plot, track, variance) = (0, 1, 1e4);
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

    fn after(log_odds: f64, plots: &[Option<f64>]) -> bool {
        let plot = Measured { identities: Identities::of(1), ..Measured::default() };
        let first = reflection(5e3, log_odds);
        let mut own = Suspicion::of(&plot, [first].iter()).unwrap();
        for distance in plots {
            let found = distance.map(|distance| reflection(distance, log_odds));
            own.weigh(&plot, found.iter());
        }
        own.holds()
    }

    #[test]
    fn a_reflector_stays_where_it_is() {
        let moving: Vec<_> = (1..6).map(|k| Some(5e3 + 400.0 * f64::from(k))).collect();
        assert!(after(7.0, &[Some(5.1e3); 30]) && !after(7.0, &[Some(5.1e3); 110]));
        assert!(after(7.0, &moving[..1]) && !after(7.0, &moving));
        // a target that is not seen where it should be speaks against a reflection
        assert!(after(7.0, &[None, None]) && !after(7.0, &[None; 3]));
        // a reflection of another target does so, too
        let other = Reflection { track: 2, ..reflection(5e3, 7.0) };
        let plot = Measured { identities: Identities::of(1), ..Measured::default() };
        let mut own = Suspicion::of(&plot, [reflection(5e3, 2.0)].iter()).unwrap();
        own.weigh(&plot, [other].iter());
        assert!(!own.holds());
        let plot = Measured::default();
        assert!(Suspicion::of(&plot, [reflection(5e3, -1.0)].iter()).is_none());
    }

    #[test]
    fn a_side_lobe_lasts() {
        let plot = Measured { identities: Identities::of(1), ..Measured::default() };
        let lobe = reflection(0.0, 5.0);
        let mut own = Suspicion::of(&plot, [lobe].iter()).unwrap();
        (0..200).for_each(|_| own.weigh(&plot, [lobe].iter()));
        assert!(own.holds());
        // plots that are not at the range of the target speak against a side lobe
        let other = Reflection { is_beside: false, ..lobe };
        (0..70).for_each(|_| own.weigh(&plot, [other].iter()));
        assert!(own.holds());
        (0..7).for_each(|_| own.weigh(&plot, [other].iter()));
        assert!(!own.holds());
    }

    #[test]
    fn a_side_lobe_is_of_the_target_that_began_before() {
        let own = Reflection { since: 10.0, ..reflection(0.0, 3.0) };
        assert!(own.is_of_target(20.0, 4.0) && !own.is_of_target(14.0, 4.0));
        let unsure = Reflection { is_unsure: true, ..own };
        assert!(!unsure.is_of_target(20.0, 4.0) && unsure.is_mutual());
    }
}
