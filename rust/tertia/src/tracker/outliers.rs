//! How many plots of a radar are far from their targets, and how far.

use serde::{Deserialize, Serialize};

/// Least distance squared of an outlier, and the largest.
const NEAREST: f64 = 9.0;
pub(super) const FARTHEST: f64 = 3600.0;
/// Logarithm of the ratio of these distances: where nothing is known, as many are in each ring as wide as its
/// radius.
const RINGS: f64 = 3.0;
/// Plots over which means are taken, and those as if they had been seen before, with the outliers among them.
const MEMORY: f64 = 4000.0;
const BEFORE: f64 = 1000.0;
const OUTLIERS_BEFORE: f64 = 1.0;
const FEW: f64 = 100.0;
/// Plots until which outliers are looked for in any case, and later the share of those that tracks have taken,
/// and the number.
const FIRST: f64 = 200.0;
const OFTEN: f64 = 4e-4;
const SOME: f64 = 0.9;
/// Share from which it takes one more plot to confirm a track.
const MANY: f64 = 0.03;

/// A plot far from where one of a target was missed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Stray {
    pub radar: usize,
    /// Square of the distance.
    pub square: f64,
    /// Probability that it is of the target, if outliers are not rare.
    pub weight: f64,
}

/// How many plots of a radar are far from their targets, and how far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Outliers {
    /// Plots of tracks, and outliers among them.
    plots: f64,
    taken: f64,
    /// Plots of tracks while others were looked for, plots far from targets that were missed, and the sum of
    /// the squares of their distances.
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

    /// A plot that a track has taken was an outlier.
    pub fn took(&mut self) {
        self.taken += 1.0;
    }

    /// The target of a plot that was far has gone on as before.
    pub fn strayed(&mut self, stray: &Stray) {
        self.far += stray.weight;
        self.squares += stray.weight * stray.square;
    }

    /// Whether it is worth looking for them.
    pub fn are_sought(&self) -> bool {
        self.plots < FIRST || self.taken > SOME.max(OFTEN * self.plots)
    }

    /// Whether there are so many that one in three plots may well be one.
    pub fn are_many(&self) -> bool {
        self.far > MANY * (self.watched + self.far + FEW)
    }

    /// 2π times the density of outliers at this distance squared from where a plot was expected with a
    /// covariance of this determinant, per square metre and scan.
    pub fn density(&self, square: f64, determinant: f64) -> f64 {
        self.share() * self.spread(square, determinant)
    }

    pub fn share(&self) -> f64 {
        let taken = (self.taken + OUTLIERS_BEFORE) / (self.plots + BEFORE);
        taken.max(self.far / (self.watched + self.far + FEW))
    }

    /// The density of one outlier.
    pub fn spread(&self, square: f64, determinant: f64) -> f64 {
        let size = (0.5 * self.squares / self.far.max(1.0)).max(NEAREST);
        let normal = (-0.5 * square / size).exp() / size;
        normal.max(1.0 / (RINGS * square.max(NEAREST))) / determinant.sqrt()
    }
}
