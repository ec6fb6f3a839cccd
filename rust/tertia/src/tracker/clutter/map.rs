//! Where false plots are denser than elsewhere: weather, wind farms, quays.

use crate::base::distribution::ln_gamma;
use crate::base::mixed::{IntegerMap, from_list, in_order, key, pair, sorted};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Scans over which plots are counted.
const MEMORY: f64 = 30.0;
/// Number of squares from the radar to its largest range.
const SQUARES: f64 = 64.0;
/// Number of plots that every square is assumed to have had at the density around it, and that the
/// other squares of its block are assumed to have had at the mean density: near a marine radar, a
/// square has few plots, although the density is many times the mean.
const BEFOREHAND: f64 = 1.0;
/// Binary logarithm of the number of squares along a side of a block.
const BLOCK: i32 = 2;
/// Number of squares beyond which those without recent plots are forgotten, and the faded number of
/// plots below which a square counts as such.
const MANY: usize = 20_000;
const NONE_LATELY: f64 = 1e-3;
/// Log-odds of an even density before any plot, and the largest change of the log-odds by plots: a
/// shower may come at any time.
const EVEN: f64 = 2.0;
const MOST: f64 = 5.0;

/// Plots that confirmed tracks have not taken, by square, with fading weights.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Patches {
    /// Side of a square, m; 0 before any plot.
    side: f64,
    /// Scans so far, and their number with fading weights.
    now: f64,
    scans: f64,
    /// The plots of each square, and the time up to which they have faded, in scans.
    #[serde(serialize_with = "in_order", deserialize_with = "from_list")]
    plots: IntegerMap<(f64, f64)>,
    /// The same of each block of squares.
    #[serde(serialize_with = "in_order", deserialize_with = "from_list")]
    blocks: IntegerMap<(f64, f64)>,
    /// Contribution of the places of first plots to the log-odds that the density differs from
    /// place to place.
    uneven: f64,
    /// First plots of tracks that were never confirmed, by square.
    dropped: BTreeMap<(i32, i32), f64>,
}

impl Patches {
    fn square(&self, position: [f64; 2]) -> (i32, i32) {
        let [x, y] = position.map(|at| (at / self.side).floor() as i32);
        (x, y)
    }

    /// Plots in the square of a place, faded until now.
    fn at(&self, position: [f64; 2]) -> f64 {
        self.until_now(&self.plots, self.square(position))
    }

    /// Plots in the other squares of the block, faded until now.
    fn beside(&self, position: [f64; 2]) -> f64 {
        let square = self.square(position);
        let all = self.until_now(&self.blocks, block(square));
        (all - self.until_now(&self.plots, square)).max(0.0)
    }

    fn until_now(&self, plots: &IntegerMap<(f64, f64)>, square: (i32, i32)) -> f64 {
        plots.get(&key(square)).map_or(0.0, |own| faded(*own, self.now))
    }

    /// Plots in a square at the `mean` density, with fading weights.
    fn expected(&self, mean: f64) -> f64 {
        mean * self.side * self.side * self.scans
    }

    /// Density of false plots in a square with this number of plots, relative to their `mean`; that
    /// around it is the density before any plots.
    fn local(&self, plots: f64, mean: f64, around: f64) -> f64 {
        (BEFOREHAND * around + plots) / (BEFOREHAND + self.expected(mean))
    }

    /// Density of false plots in the other squares of the block, relative to their `mean`. As long
    /// as the density may be even everywhere, a few plots nearby are chance.
    fn around(&self, position: [f64; 2], mean: f64) -> f64 {
        if self.uneven <= EVEN {
            return 1.0;
        }
        let others = f64::from((1 << (2 * BLOCK)) - 1) * self.expected(mean);
        (BEFOREHAND + self.beside(position)) / (BEFOREHAND + others)
    }

    /// Whether two places are in one square.
    pub fn is_same(&self, one: [f64; 2], other: [f64; 2]) -> bool {
        self.square(one) == self.square(other)
    }

    /// Density of false plots at a place relative to their `mean`, at least 1; the number `without`
    /// of the plots in its square does not count. Cost O(1).
    pub fn ratio(&self, position: [f64; 2], mean: f64, without: f64) -> f64 {
        if self.plots.is_empty() {
            return 1.0;
        }
        let plots = (self.at(position) - without).max(0.0);
        let local = self.local(plots, mean, self.around(position, mean)).max(1.0);
        if local == 1.0 {
            return local;
        }
        1.0 + (local - 1.0) / (1.0 + (EVEN - self.uneven).exp())
    }

    /// Whether first plots of tracks that were never confirmed were denser in some squares of an
    /// `area` than in others: exponentially distributed densities are compared with an even one.
    /// Cost O(squares).
    pub fn is_uneven(&self, area: f64) -> bool {
        let expected = self.dropped.values().sum::<f64>() * self.side * self.side / area;
        let one = |plots: &f64| ln_gamma(plots + 1.0) + expected - (plots + 1.0) * expected.ln_1p();
        self.dropped.values().map(one).sum::<f64>() > EVEN
    }

    /// Notes the first plot of a track that was never confirmed, of a radar with this largest
    /// range.
    pub fn drop(&mut self, position: [f64; 2], range: f64) {
        self.cover(range);
        *self.dropped.entry(self.square(position)).or_default() += 1.0;
    }

    /// Uses a plot that has just been counted as evidence for or against an even density.
    pub fn weigh(&mut self, position: [f64; 2], mean: f64) {
        let others = (self.at(position) - 1.0).max(0.0);
        self.uneven = (self.uneven + self.local(others, mean, 1.0).ln()).clamp(-MOST, MOST);
    }

    /// Counts a plot of a radar with this largest range.
    pub fn add(&mut self, position: [f64; 2], range: f64) {
        self.cover(range);
        let (square, now) = (self.square(position), self.now);
        for (plots, square) in [(&mut self.plots, square), (&mut self.blocks, block(square))] {
            let own = plots.entry(key(square)).or_insert((0.0, now));
            *own = (1.0 + faded(*own, now), now);
        }
    }

    /// Enlarges the squares until not many more than [`SQUARES`] reach to the largest range.
    fn cover(&mut self, range: f64) {
        if self.side == 0.0 {
            self.side = range / SQUARES;
        }
        while range > 2.0 * SQUARES * self.side {
            self.join();
        }
    }

    /// Doubles the side of the squares.
    fn join(&mut self) {
        self.side *= 2.0;
        let now = self.now;
        for all in [&mut self.plots, &mut self.blocks] {
            for (square, plots) in sorted(&std::mem::take(all)) {
                let (x, y) = pair(square);
                let own = all.entry(key((x >> 1, y >> 1))).or_insert((0.0, now));
                own.0 += faded(plots, now);
            }
        }
        for ((x, y), plots) in std::mem::take(&mut self.dropped) {
            *self.dropped.entry((x >> 1, y >> 1)).or_default() += plots;
        }
    }

    /// Lets this number of scans pass.
    pub fn fade(&mut self, scans: f64) {
        self.now += scans;
        let kept = (-scans / MEMORY).exp();
        self.scans = kept * self.scans + scans;
        self.uneven *= kept;
        if self.plots.len() > MANY {
            let now = self.now;
            self.plots.retain(|_, own| faded(*own, now) > NONE_LATELY);
            self.blocks.retain(|_, own| faded(*own, now) > NONE_LATELY);
        }
    }
}

/// The block of a square.
fn block((x, y): (i32, i32)) -> (i32, i32) {
    (x >> BLOCK, y >> BLOCK)
}

/// Number of plots that had faded `until` then, faded until `now`.
fn faded((plots, until): (f64, f64), now: f64) -> f64 {
    // often the case, and faster
    if until == now { plots } else { plots * ((until - now) / MEMORY).exp() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_within;

    #[test]
    fn the_density_is_high_where_plots_are_and_fades() {
        let mut patches = Patches::default();
        let (range, mean) = (64e3, 1e-9);
        assert_eq!(patches.ratio([500.0, 500.0], mean, 0.0), 1.0);
        for _ in 0..10 {
            (0..3).for_each(|_| patches.add([500.0, -500.0], range));
            patches.fade(1.0);
        }
        let kept = |scan: i32| (-f64::from(scan) / MEMORY).exp();
        let weights: f64 = (1..=10).map(kept).sum();
        let scans: f64 = (0..10).map(kept).sum();
        let local = (1.0 + 3.0 * weights) / (1.0 + mean * 1e6 * scans);
        // an even density is e² times as likely
        let expected = 1.0 + (local - 1.0) / (1.0 + EVEN.exp());
        assert_within(1e-12, patches.ratio([999.0, -1.0], mean, 0.0), expected);
        assert_eq!(patches.ratio([1001.0, -1.0], mean, 0.0), 1.0);
        patches.fade(300.0);
        assert!(patches.ratio([999.0, -1.0], mean, 0.0) < 1.01);
    }

    #[test]
    fn squares_with_few_plots_are_as_dense_as_their_block() {
        let (mut patches, mean) = (Patches::default(), 1e-8);
        // every second square of a block had a plot, and none elsewhere
        for i in 0..8 {
            let place = [500.0 + 1e3 * f64::from(i % 4), 500.0 + 2e3 * f64::from(i / 4)];
            patches.add(place, 64e3);
        }
        patches.fade(1.0);
        assert_eq!(patches.ratio([500.0, 1500.0], mean, 0.0), 1.0);
        patches.uneven = 100.0;
        let kept = (-1.0 / MEMORY).exp();
        let around = (1.0 + 8.0 * kept) / (1.0 + 15.0 * mean * 1e6);
        let empty = patches.ratio([500.0, 1500.0], mean, 0.0);
        assert_within(1e-12, empty, around / (1.0 + mean * 1e6));
        assert_eq!(patches.ratio([4500.0, 1500.0], mean, 0.0), 1.0);
    }

    #[test]
    fn places_are_all_alike_where_the_density_is_even() {
        let ratio = |side: usize| {
            let mut patches = Patches::default();
            let mean = 2e-8;
            // 1 plot in each of 50 squares, or 5 in each of ten of them
            for i in 0..50 {
                let place = [500.0 + 1e3 * f64::from(i % side as i32), 500.0];
                patches.add(place, 64e3);
                patches.weigh(place, mean);
                if i % 10 == 9 {
                    patches.fade(1.0);
                }
            }
            patches.ratio([500.0, 500.0], mean, 0.0)
        };
        assert!(ratio(50) < 1.03);
        assert!(ratio(10) > 4.0);
    }

    #[test]
    fn false_plots_everywhere_and_in_one_place() {
        let is_uneven = |squares: i32| {
            let mut patches = Patches::default();
            (0..400).for_each(|i| {
                let [x, y] =
                    [i % squares, i / squares % squares].map(|k| 500.0 + 1e3 * f64::from(k));
                patches.drop([x, y], 64e3);
            });
            patches.is_uneven(4e8)
        };
        assert!(!is_uneven(20) && !is_uneven(14) && is_uneven(8));
        assert!(!Patches::default().is_uneven(4e8));
    }

    #[test]
    fn squares_grow_with_the_range() {
        let mut patches = Patches::default();
        patches.add([10.0, 10.0], 64.0 * 100.0);
        patches.add([-10.0, 10.0], 64.0 * 100.0);
        patches.add([150.0, 150.0], 64.0 * 201.0);
        assert_within(1e-15, patches.at([199.0, 0.0]), 2.0);
        assert_within(1e-15, patches.at([-199.0, 0.0]), 1.0);
        assert_eq!([patches.beside([199.0, 0.0]), patches.beside([399.0, 0.0])], [0.0, 2.0]);
    }
}
