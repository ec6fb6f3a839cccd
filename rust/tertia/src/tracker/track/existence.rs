//! Probability that a track belongs to a target (integrated probabilistic data association; Mušicki, Evans,
//! Stanković 1994).

use crate::base::exponential::exp;
use crate::tracker::settings::Settings;
use serde::{Deserialize, Serialize};

/// Expected number of new targets in a scan of a radar.
const NEW_TARGETS: f64 = 1.0;
/// Probability that a target is still there after a scan.
const STAYS: f64 = 0.998;
/// Largest odds. They need not be larger: the target may always have left just now.
const LARGEST_ODDS: f64 = 1e12;
/// A chain of plots is given up when its odds fall below this share of the odds of its first plot.
const HOPELESS: f64 = 0.05;
/// Odds below which a track ends if its last plot has made a target still less likely.
const REFUTED: f64 = 1e-4;

/// The odds that there is a target, against a chain of false plots.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Existence {
    odds: f64,
    /// Whether the last plot has made a target less likely.
    falling: bool,
}

impl Existence {
    /// The odds after a first plot, if there are `false_plots` in a scan.
    pub fn of_first(false_plots: f64) -> Self {
        Self { odds: NEW_TARGETS / false_plots.max(1.0), falling: false }
    }

    /// Multiplies the odds, for example if a target is more likely than usual at the place of the first plot.
    pub fn favour(&mut self, ratio: f64) {
        self.odds *= ratio;
    }

    /// Odds below which a chain that began with the present odds is given up.
    pub fn hopeless(self) -> f64 {
        HOPELESS * self.odds
    }

    pub fn is_below(self, odds: f64) -> bool {
        self.odds < odds
    }

    /// Whether the plots, or the speed of the track, which has the probability `speed`, show that there is no
    /// target.
    pub fn is_refuted(self, speed: f64) -> bool {
        (self.falling && self.odds < REFUTED) || speed * self.odds.max(1.0) < REFUTED
    }

    /// Reduces the odds after some time, in which the target may have left; `period` is the scan period, s.
    #[inline]
    pub fn wait(&mut self, seconds: f64, period: f64) {
        let leaves = ((1.0 - STAYS) * seconds / period).min(1.0);
        self.odds *= (1.0 - leaves) / (1.0 + leaves * self.odds);
    }

    /// Updates the odds by a plot of a radar; `gain` is the log-likelihood ratio of the plot against a missed
    /// detection.
    #[inline]
    pub fn see(&mut self, gain: f64, radar: usize, settings: &Settings) {
        let misses = 1.0 - settings.radars[radar].detection_probability;
        let ratio = settings.missed(radar) + misses * exp(gain);
        self.odds = (self.odds * ratio).min(LARGEST_ODDS);
        self.falling = ratio < 1.0;
    }

    /// Updates the odds by a missed detection of a radar.
    #[inline]
    pub fn miss(&mut self, radar: usize, settings: &Settings) {
        self.odds *= settings.missed(radar);
    }

    #[inline]
    pub fn probability(self) -> f64 {
        self.odds / (1.0 + self.odds)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_within;
    use crate::sensors::{Radar, radar_of};
    use crate::tracker::Motion;

    /// Log-likelihood ratio against a missed detection of a plot whose density is e^`ratio` times that of
    /// false plots.
    fn gain(ratio: f64) -> f64 {
        ratio + (0.9_f64 / 0.1).ln()
    }

    fn settings() -> Settings {
        let radar = Radar { max_range: 1e5, ..radar_of([50.0, 1e-3]) };
        Settings::new(vec![radar], Motion::Cv(1.0))
    }

    #[test]
    fn plots_and_missed_scans_of_a_worked_example() {
        let settings = settings();
        let mut existence = Existence::of_first(50.0);
        assert_within(1e-15, existence.probability(), 1.0 / 51.0);
        let expected = [
            (Some(6.5), 0.922780866211),
            (None, 0.542491801002),
            (Some(7.2), 0.999297899316),
            (Some(4.0), 0.999945007034),
        ];
        for (seen, probability) in expected {
            existence.wait(4.0, 4.0);
            match seen {
                Some(ratio) => existence.see(gain(ratio), 0, &settings),
                None => existence.miss(0, &settings),
            }
            assert!((existence.probability() - probability).abs() < 1e-12);
        }
    }

    #[test]
    fn a_target_that_was_certain_is_lost_with_the_fifth_missed_scan() {
        let settings = settings();
        let mut existence = Existence::of_first(1.0);
        for _ in 0..400 {
            existence.see(30.0, 0, &settings);
        }
        assert!(existence.probability() <= 1.0);
        let mut scans = 0;
        while existence.probability() > 0.01 {
            existence.wait(4.0, 4.0);
            existence.miss(0, &settings);
            scans += 1;
        }
        assert_eq!(scans, 5);
        // after a very long time the target has certainly left
        existence.wait(1e9, 4.0);
        assert_within(1e-300, existence.probability(), 0.0);
    }
    #[test]
    fn plots_refute_a_target_and_missed_scans_do_not() {
        let settings = settings();
        let mut missed = Existence::of_first(1.0);
        (0..8).for_each(|_| missed.miss(0, &settings));
        assert!(missed.is_below(REFUTED) && !missed.is_refuted(1.0));
        // a plot that speaks for the target, and one that speaks against it
        missed.see(gain(2.0), 0, &settings);
        assert!(missed.is_below(REFUTED) && !missed.is_refuted(1.0));
        missed.see(gain(-2.0), 0, &settings);
        assert!(missed.is_refuted(1.0));
        let likely = Existence { odds: 1e3, falling: false };
        assert!(likely.is_refuted(0.9e-7) && !likely.is_refuted(1.1e-7));
    }
}
