//! Modes of a contaminated record: the good measurements, and one or two kinds of bad measurements.

use crate::base::exponential::LARGEST_EXPONENT;

/// Largest number of bad modes.
pub(super) const MOST_BAD: usize = 2;
/// Smallest distance of a bad mode beside the good one, in sigmas of the good one.
const LEAST_OFFSET: f64 = 2.0;
/// Smallest width of such a mode, in sigmas of the good one.
const LEAST_WIDTH: f64 = 0.5;
/// Smallest width of a bad mode about the good one, in sigmas of the good one.
const LEAST_WIDE: f64 = 2.5;
/// Largest share of all bad modes together.
const LARGEST_SHARE: f64 = 0.5;
/// Smallest expected number of measurements of each bad mode.
const LEAST_COUNT: f64 = 0.25;
/// Replaces a count of zero in divisors.
const NONE: f64 = 1e-9;
const LEAST_PERSISTENCE: f64 = 1e-4;
/// Number of places from the good mode to a bad mode at which densities are compared.
const PLACES: usize = 12;
/// Smallest density of a peak, relative to the lowest one before it; mixtures that are fitted to skewed noise
/// have a slight dip by chance.
const PEAK: f64 = 1.2;
/// Largest width of a bad mode, relative to the good one, that skewed noise may have.
const WIDEST: f64 = 5.0;
const LARGEST_PERSISTENCE: f64 = 0.98;

/// Returns what must be subtracted from all log ratios of a value so that
/// [`exp`](crate::base::exponential::exp) limits none of them, and the order of large ones is
/// preserved; compared with such a ratio, the good mode is negligible.
#[inline(always)]
pub(super) fn excess(log_ratios: &[f64]) -> f64 {
    let mut largest = LARGEST_EXPONENT;
    for &log in log_ratios {
        largest = if log > largest { log } else { largest };
    }
    largest - LARGEST_EXPONENT
}

/// Position of the bad measurements.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Shape {
    /// On one side of the good measurements.
    OneSided,
    /// On both sides of the good measurements: a wide mode with the same centre.
    Wide,
    /// On both sides, each side with its own mode.
    TwoSided,
}

/// A bad mode.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Mode {
    /// Centre of this mode minus that of the good mode.
    pub offset: f64,
    pub width: f64,
    pub share: f64,
}

/// A mixture `(1 − ε) N(μ, σ²) + Σ ε_j N(μ + d_j, τ_j²)` whose modes may persist: with probability κ, a
/// measurement has the mode of the measurement before it; otherwise its mode is drawn with the shares
/// as probabilities (κ = 0: independent measurements).
#[derive(Clone, Copy, Debug)]
pub(super) struct Modes {
    pub shape: Shape,
    pub centre: f64,
    pub width: f64,
    pub bad: [Mode; MOST_BAD],
    pub persistence: f64,
}

/// Expected numbers and sums of the measurements of each bad mode.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Sums {
    pub count: [f64; MOST_BAD],
    pub first: [f64; MOST_BAD],
    pub second: [f64; MOST_BAD],
    /// Expected number of measurements whose mode was drawn: the good one, and each bad one.
    pub drawn_good: f64,
    pub drawn: [f64; MOST_BAD],
    /// Expected number of measurements that kept the mode of the measurement before.
    pub persisted: f64,
}

/// Number, sum and sum of squares of all measurements.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Totals {
    pub count: f64,
    pub first: f64,
    pub second: f64,
}

impl Shape {
    /// Returns the number of parameters of a mixture of this shape, without persistence.
    pub fn parameters(self) -> f64 {
        match self {
            Shape::OneSided => 5.0,
            Shape::Wide => 4.0,
            Shape::TwoSided => 8.0,
        }
    }
}

impl Modes {
    /// Returns the number of bad modes.
    pub fn kinds(&self) -> usize {
        if self.shape == Shape::TwoSided { 2 } else { 1 }
    }

    /// Returns the share of the good measurements.
    pub fn good_share(&self) -> f64 {
        1.0 - self.bad[..self.kinds()].iter().map(|m| m.share).sum::<f64>()
    }

    /// Returns the coefficients of `ln N(y; μ + d_j, τ_j²) − ln N(y; μ, σ²)` as a polynomial in y − μ.
    pub fn log_ratio(&self, j: usize) -> [f64; 3] {
        let Mode { offset, width, .. } = self.bad[j];
        let (good, bad) = (1.0 / (self.width * self.width), 1.0 / (width * width));
        let constant = (self.width / width).ln() - 0.5 * offset * offset * bad;
        [constant, offset * bad, 0.5 * (good - bad)]
    }

    /// Returns the [`excess`] of the log ratios of a value.
    pub fn excess(&self, y: f64) -> f64 {
        let z = y - self.centre;
        let mut log = [f64::NEG_INFINITY; MOST_BAD];
        for (j, log) in log.iter_mut().enumerate().take(self.kinds()) {
            let [constant, slope, curve] = self.log_ratio(j);
            *log = constant + z * (slope + z * curve);
        }
        excess(&log)
    }

    /// Runs one M step (Dempster, Laird, Rubin 1977); `floor` contains the smallest widths of the good
    /// mode and of the bad modes. Returns the largest change of centre, log width, shares and
    /// persistence, in standard errors.
    pub fn update(&mut self, sums: &Sums, totals: &Totals, floor: [f64; 2]) -> f64 {
        let (kinds, previous) = (self.kinds(), *self);
        let over = |values: &[f64; MOST_BAD]| values[..kinds].iter().sum::<f64>();
        let good = (totals.count - over(&sums.count)).max(NONE);
        let first = totals.first - over(&sums.first);
        let second = totals.second - over(&sums.second);
        let count: [f64; MOST_BAD] = std::array::from_fn(|j| sums.count[j].max(NONE));
        let about = |c: f64, n: f64, s1: f64, s2: f64| (s2 / n - c * (2.0 * s1 / n - c)).max(0.0);
        self.centre = first / good;
        if self.shape == Shape::Wide {
            let (w, v) = (self.width.powi(-2), self.bad[0].width.powi(-2));
            self.centre = (first * w + sums.first[0] * v) / (good * w + count[0] * v);
        }
        self.width = about(self.centre, good, first, second).sqrt().max(floor[0]);
        for j in 0..kinds {
            let mode = &mut self.bad[j];
            let mut least = LEAST_WIDE;
            if self.shape != Shape::Wide {
                let found = (sums.first[j] / count[j] - self.centre) * mode.offset.signum();
                let offset = found.max(LEAST_OFFSET * self.width);
                mode.offset = offset.copysign(mode.offset);
                least = LEAST_WIDTH;
            }
            let centre = self.centre + mode.offset;
            let square = about(centre, count[j], sums.first[j], sums.second[j]);
            mode.width = square.sqrt().max(least * self.width).max(floor[1]);
        }
        self.share_out(sums, totals.count);
        self.change(&previous, totals.count)
    }

    fn share_out(&mut self, sums: &Sums, n: f64) {
        let kinds = self.kinds();
        let drawn = sums.drawn_good + sums.drawn[..kinds].iter().sum::<f64>();
        for (mode, d) in self.bad[..kinds].iter_mut().zip(&sums.drawn) {
            mode.share = (d / drawn).max(LEAST_COUNT / n);
        }
        self.limit_shares();
        if self.persistence > 0.0 {
            let found = sums.persisted / (sums.persisted + drawn - 1.0);
            self.persistence = found.clamp(LEAST_PERSISTENCE, LARGEST_PERSISTENCE);
        }
    }

    /// Returns the mixture in which the good mode and the only bad mode change places.
    pub fn mirrored(&self) -> Self {
        let Mode { offset, width, .. } = self.bad[0];
        let bad = Mode { offset: -offset, width: self.width, share: self.good_share() };
        let mut found = Self { centre: self.centre + offset, width, ..*self };
        found.bad[0] = bad;
        found.limit_shares();
        found
    }

    /// Whether the density between the good mode and a bad one is clearly lower than in the bad one, or the bad one is
    /// so wide that it is no part of any usual noise.
    pub fn is_apart(&self, j: usize) -> bool {
        let of =
            |share: f64, z: f64, width: f64| share * (-0.5 * (z / width).powi(2)).exp() / width;
        let bad = self.bad[j];
        let density = |k: usize| {
            let z = bad.offset * k as f64 / PLACES as f64;
            of(self.good_share(), z, self.width) + of(bad.share, z - bad.offset, bad.width)
        };
        let mut lowest = density(0);
        bad.width > WIDEST * self.width
            || (1..=PLACES).any(|k| {
                let found = density(k);
                lowest = lowest.min(found);
                found > PEAK * lowest
            })
    }

    /// Limits the shares of the bad modes so that at least half of the measurements are good.
    pub fn limit_shares(&mut self) {
        let all = 1.0 - self.good_share();
        if all > LARGEST_SHARE {
            let kinds = self.kinds();
            self.bad[..kinds].iter_mut().for_each(|mode| mode.share *= LARGEST_SHARE / all);
        }
    }

    fn change(&self, previous: &Self, n: f64) -> f64 {
        let of_centre = (self.centre - previous.centre).abs() / self.width;
        let of_width = (self.width / previous.width).ln().abs();
        let of_share = (self.good_share() - previous.good_share()).abs();
        let of_persistence = (self.persistence - previous.persistence).abs();
        of_centre.max(of_width).max(of_share).max(of_persistence) * n.sqrt()
    }
}
