//! Finds fixed echoes, that is places with plots again and again: wind turbines, masts and ships at anchor.
//!
//! The module is a clutter map with cells. In a cell without a source, false plots are as dense as in the
//! area around it (Poisson distribution); a cell with a source has a plot in some share of the scans, about
//! which nothing is known beforehand (uniform distribution). Whether there is a source in a cell, and how
//! dense plots are there, follows from the plots so far by Bayes' rule. Plots of tracks that have moved are
//! not counted: a target that stops remains a target.

use crate::base::distribution::ln_gamma;
use crate::base::mixed::{IntegerMap, from_list, in_order, key};
use crate::sensors::Radar;
use serde::{Deserialize, Serialize};

/// Scans over which plots are counted: so many because turbines stand still for a while.
const MEMORY: f64 = 150.0;
/// Sides of a cell, in standard deviations of plots.
const SIDE: f64 = 3.0;
/// Logarithm of the prior odds that a cell has a source.
const SOURCE: f64 = -9.2;
/// Share of scans above which a cell has plots in many scans.
const OFTEN: f64 = 0.1;
/// Largest number of cells. If there are more, at most half of them are kept: those with most plots, and none
/// with fewer plots than `NONE_LATELY`.
const MANY: usize = 100_000;
const NONE_LATELY: f64 = 0.1;

/// Plots by cell, along and across the beam, with fading weights.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Fixed {
    /// Number of scans so far, and (`scans`) their number with fading weights.
    now: f64,
    scans: f64,
    /// Sides of the cells along and across the beam, m and rad, by the noise at the time when the first plot
    /// was counted: noise that is estimated later must not move the cells. 0 before any plot.
    sides: [f64; 2],
    /// Number of plots of each cell, and the scan up to which it has faded.
    #[serde(serialize_with = "in_order", deserialize_with = "from_list")]
    plots: IntegerMap<(f64, f64)>,
}

impl Fixed {
    /// A position in units of the sides of cells, and the area of its cell, m².
    fn place(&self, radar: &Radar, position: [f64; 2]) -> ([f64; 2], f64) {
        let [x, y] = [0, 1].map(|i| position[i] - radar.position[i]);
        let range = radar.about(position);
        let [along, across] = self.sides;
        ([range / along, x.atan2(y) / across], along * across * range)
    }

    fn at(&self, cell: (i32, i32)) -> f64 {
        self.plots.get(&key(cell)).map_or(0.0, |own| faded(*own, self.now))
    }

    /// Number of plots in the cell of a position, and the area of this cell, m².
    fn cell(&self, radar: &Radar, position: [f64; 2]) -> (f64, f64) {
        let (place, area) = self.place(radar, position);
        (self.at((place[0].floor() as i32, place[1].floor() as i32)), area)
    }

    /// Whether there are cells with plots in many scans, more than there are by chance in any cell of an
    /// `area` with this `mean` density. Cost O(cells).
    pub fn has_sources(&self, mean: f64, area: f64) -> bool {
        let [along, across] = self.sides;
        self.plots.iter().any(|(cell, own)| {
            let plots = faded(*own, self.now);
            let range = ((cell >> 32) as f64 + 0.5) * along;
            let own = along * across * range;
            plots > OFTEN * self.scans && self.log_odds(plots, mean * own) > (area / own).ln()
        })
    }

    /// Whether the cell of a position more likely than not has a source. Cost O(1).
    pub fn is_source(&self, radar: &Radar, position: [f64; 2], mean: f64) -> bool {
        if self.plots.is_empty() {
            return false;
        }
        let (plots, area) = self.cell(radar, position);
        plots > 0.0 && SOURCE + self.log_odds(plots, mean * area) > 0.0
    }

    /// Log-likelihood ratio of a number of plots: a cell with a source against a cell in which `expected`
    /// false plots are expected per scan.
    fn log_odds(&self, plots: f64, expected: f64) -> f64 {
        let expected = expected * self.scans;
        let without = plots * expected.ln() - expected - ln_gamma(plots + 1.0);
        -(self.scans + 1.0).ln() - without
    }

    /// Ratio of the density of false plots at a position to their `mean` density, at least 1. Cost O(1).
    pub fn ratio(&self, radar: &Radar, position: [f64; 2], mean: f64) -> f64 {
        if self.plots.is_empty() {
            return 1.0;
        }
        let (plots, area) = self.cell(radar, position);
        if plots == 0.0 {
            return 1.0;
        }
        let odds = (SOURCE + self.log_odds(plots, mean * area)).exp();
        let share = (plots + 1.0) / (self.scans + 2.0);
        1.0 + odds / (1.0 + odds) * share / (mean * area)
    }

    /// Counts a plot, divided among the four cells that are nearest to it.
    pub fn add(&mut self, radar: &Radar, position: [f64; 2]) {
        if self.plots.is_empty() {
            self.sides = [radar.range_sigma, radar.azimuth_sigma].map(|sigma| SIDE * sigma);
        }
        let ([along, across], _) = self.place(radar, position);
        let halves = |place: f64| {
            let low = (place - 0.5).floor();
            let upper = place - 0.5 - low;
            [(low as i32, 1.0 - upper), (low as i32 + 1, upper)]
        };
        for (i, a) in halves(along) {
            for (j, b) in halves(across) {
                let own = self.plots.entry(key((i, j))).or_insert((0.0, self.now));
                *own = (a * b + faded(*own, self.now), self.now);
            }
        }
    }

    /// Lets this number of scans pass. Cost O(1) for each plot that was counted.
    pub fn fade(&mut self, scans: f64) {
        self.now += scans;
        self.scans = (-scans / MEMORY).exp() * self.scans + scans;
        if self.plots.len() > MANY {
            self.forget();
        }
    }

    fn forget(&mut self) {
        let (now, mut least) = (self.now, NONE_LATELY);
        while self.plots.len() > MANY / 2 {
            self.plots.retain(|_, own| faded(*own, now) > least);
            least *= 2.0;
        }
    }
}

/// Number of plots now, if it had faded up to the scan `until`.
fn faded((plots, until): (f64, f64), now: f64) -> f64 {
    // often the case, and faster
    if until == now { plots } else { plots * ((until - now) / MEMORY).exp() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_within;
    use crate::sensors::radar_of;

    /// A radar in the origin; cells have sides of 150 m, and of 150 m at 50 km.
    fn radar() -> Radar {
        radar_of([50.0, 1e-3])
    }

    /// A position in the middle of a cell along the beam.
    const PLACE: [f64; 2] = [0.0, 50_025.0];
    const AREA: f64 = 150.0 * 3e-3 * 50_025.0;

    /// A map with a plot in the middle of a cell in each of the first `plots` scans of 100.
    fn after(plots: usize) -> Fixed {
        let mut fixed = Fixed::default();
        for scan in 0..100 {
            if scan < plots {
                fixed.add(&radar(), middle(PLACE));
            }
            fixed.fade(1.0);
        }
        fixed
    }

    /// Moves a position by half a cell across the beam, because its azimuth is that of an edge.
    fn middle([_, range]: [f64; 2]) -> [f64; 2] {
        let azimuth = 0.5 * SIDE * 1e-3;
        [range * f64::sin(azimuth), range * f64::cos(azimuth)]
    }

    #[test]
    fn a_source_is_what_chance_does_not_explain() {
        let (mean, place) = (1e-9, middle(PLACE));
        let found = after(10);
        let plots: f64 = (0..10).map(|scan| (f64::from(scan - 100) / MEMORY).exp()).sum();
        let scans: f64 = (0..100).map(|scan| (-f64::from(scan) / MEMORY).exp()).sum();
        assert_within(1e-9, found.at((333, 0)), plots);
        // it is certain that there is a source
        let expected = 1.0 + (plots + 1.0) / (scans + 2.0) / (mean * AREA);
        assert_within(1e-6, found.ratio(&radar(), place, mean), expected);
        let has_sources = |found: &Fixed, mean| found.has_sources(mean, 1e11);
        assert!(has_sources(&found, mean) == (plots > OFTEN * scans));
        // one plot is chance, and so are ten if false plots are dense everywhere
        assert!(after(1).ratio(&radar(), place, mean) < 1.1);
        assert!(after(10).ratio(&radar(), place, 0.1 / AREA) < 1.1);
        assert!(has_sources(&after(80), mean) && !has_sources(&after(2), mean));
        let is_source = |fixed: &Fixed, place| fixed.is_source(&radar(), place, mean);
        assert!(is_source(&found, place) && !is_source(&after(1), place));
        assert!(!is_source(&found, [0.0, 40e3]));
        // with thousands of false plots per scan, some cell has three by chance
        let mut few = Fixed::default();
        (0..3).for_each(|_| few.add(&radar(), place));
        few.fade(12.0);
        assert!(has_sources(&few, 1e-10) && !has_sources(&few, 2e-8));
        // there is no source elsewhere
        assert_eq!(after(80).ratio(&radar(), [0.0, 40e3], mean), 1.0);
        assert_eq!(Fixed::default().ratio(&radar(), place, mean), 1.0);
    }

    #[test]
    fn what_is_found_of_the_noise_does_not_move_the_cells() {
        let (mean, place, noisy) = (1e-9, middle(PLACE), radar_of([60.0, 1.3e-3]));
        let mut found = after(10);
        let before = found.at((333, 0));
        assert_eq!(found.ratio(&noisy, place, mean), found.ratio(&radar(), place, mean));
        found.add(&noisy, place);
        assert_within(1e-9, found.at((333, 0)), before + 1.0);
    }

    #[test]
    fn cells_stay_few_and_sources_are_kept() {
        let (radar, mut fixed) = (radar(), Fixed::default());
        let mut azimuth = 0.0;
        for _ in 0..100 {
            fixed.add(&radar, middle(PLACE));
            for _ in 0..1000 {
                azimuth += 2.4;
                fixed.add(&radar, [50e3 * f64::sin(azimuth), 50e3 * f64::cos(azimuth)]);
                azimuth += 1e-6;
            }
            for i in 0..500 {
                fixed.add(&radar, [f64::from(i) * 150.0 + 37.0, 60e3 + fixed.now * 150.0]);
            }
            fixed.fade(1.0);
            assert!(fixed.plots.len() <= MANY);
        }
        assert!(fixed.at((333, 0)) > 50.0);
        let saved = postcard::to_allocvec(&fixed).unwrap();
        let loaded: Fixed = postcard::from_bytes(&saved).unwrap();
        assert_eq!(loaded, fixed);
        assert_eq!(postcard::to_allocvec(&loaded).unwrap(), saved);
    }

    #[test]
    fn a_plot_counts_in_the_cells_about_it() {
        let mut fixed = Fixed::default();
        // a quarter of a cell from the middle along the beam, half a cell across
        fixed.add(&radar(), [0.0, 50_025.0 + 37.5]);
        for (cell, plots) in [((333, 0), 0.375), ((333, -1), 0.375), ((334, 0), 0.125)] {
            assert_within(1e-9, fixed.at(cell), plots);
        }
    }
}
