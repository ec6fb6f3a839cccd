//! Estimates how many plots of a radar are outliers, far from their targets, and how far they are.

use serde::{Deserialize, Serialize};

/// Smallest and largest normalised distance squared of an outlier.
const NEAREST: f64 = 9.0;
pub(in crate::tracker) const FARTHEST: f64 = 3600.0;
/// Logarithm of the ratio of these distances: if nothing is known about outliers, their distances are uniform
/// on a logarithmic scale.
const RINGS: f64 = 3.0;
/// Number of plots over which means are taken; prior number of plots, and of outliers among them; and prior
/// number of plots for the share of plots far from missed targets.
const MEMORY: f64 = 4000.0;
const BEFORE: f64 = 1000.0;
const OUTLIERS_BEFORE: f64 = 1.0;
const FEW: f64 = 100.0;
/// Number of plots up to which outliers are looked for in any case. Later they are looked for if tracks have
/// taken more than this share of outliers, and more than this number.
const FIRST: f64 = 200.0;
const OFTEN: f64 = 4e-4;
const SOME: f64 = 0.9;
/// Share of outliers above which one more plot is required to confirm a track.
const MANY: f64 = 0.03;

/// A plot far from the place where a plot of a target was missed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Stray {
    pub radar: usize,
    /// Normalised distance squared.
    pub square: f64,
    /// Probability that the plot is of the target, if outliers are not rare.
    pub weight: f64,
}

/// How many plots of a radar are far from their targets, and how far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Outliers {
    /// Number of plots of tracks, and (`taken`) number of outliers among them.
    plots: f64,
    taken: f64,
    /// Number of plots of tracks while outliers were looked for; (`far`) number of plots far from missed
    /// targets; and (`squares`) sum of the squares of their distances.
    watched: f64,
    far: f64,
    squares: f64,
}

impl Outliers {
    /// Counts a plot of a track.
    pub fn saw(&mut self) {
        let is_watched = f64::from(u8::from(self.are_sought()));
        let kept = 1.0 - 1.0 / MEMORY;
        let Self { plots, taken, watched, far, squares } = self;
        for count in [plots, taken, watched, far, squares] {
            *count *= kept;
        }
        self.plots += 1.0;
        self.watched += is_watched;
    }

    /// Counts a plot that a track has taken and that was an outlier.
    pub fn took(&mut self) {
        self.taken += 1.0;
    }

    /// Counts a plot far from its target, which has continued as before.
    pub fn strayed(&mut self, stray: &Stray) {
        self.far += stray.weight;
        self.squares += stray.weight * stray.square;
    }

    /// Whether it is worth looking for outliers.
    pub fn are_sought(&self) -> bool {
        self.plots < FIRST || self.taken > SOME.max(OFTEN * self.plots)
    }

    /// Whether outliers are so frequent that one of three plots may well be one.
    pub fn are_many(&self) -> bool {
        self.far > MANY * (self.watched + self.far + FEW)
    }

    /// 2π times the density of outliers, per square metre and scan, at this normalised distance squared from
    /// where a plot was expected; the covariance of the innovation has this determinant.
    pub fn density(&self, square: f64, determinant: f64) -> f64 {
        self.share() * self.spread(square, determinant)
    }

    pub fn share(&self) -> f64 {
        let taken = (self.taken + OUTLIERS_BEFORE) / (self.plots + BEFORE);
        taken.max(self.far / (self.watched + self.far + FEW))
    }

    /// 2π times the probability density of a single outlier, with the same arguments as `density`.
    pub fn spread(&self, square: f64, determinant: f64) -> f64 {
        let size = (0.5 * self.squares / self.far.max(1.0)).max(NEAREST);
        let normal = (-0.5 * square / size).exp() / size;
        normal.max(1.0 / (RINGS * square.max(NEAREST))) / determinant.sqrt()
    }
}
