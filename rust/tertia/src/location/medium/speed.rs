//! The speed of the signals, if it is known with a standard deviation.
//!
//! If the signals are faster than stated by a relative difference γ (`share`), all distances that they
//! travel are longer by the same factor 1 + γ. All instants of a batch have the speed in common. The
//! posterior of γ is approximated about its mode; its prior is normal, and a measurement that does not
//! fit costs no more than a fault.

use crate::location::search::fix::{Fix, Instant, Solution, Status};
use crate::location::solver::{Locator, Workspace};
use crate::sensors::{KINDS, Kind};

/// Largest number of instants of a batch, evenly spread, from which the speed is estimated.
pub(super) const SAMPLE: usize = 256;
/// Largest number of instants, evenly spread, with which the mode is located roughly.
const FEW: usize = 32;
/// Range of γ in the rough search, in standard deviations of the prior on either side.
const FARTHEST: f64 = 3.0;
/// Number of steps of the rough search on either side.
const STEPS: i32 = 20;
/// Number of times that the interval about the mode is narrowed by the golden section.
const NARROWINGS: usize = 24;
const GOLDEN: f64 = 0.618_033_988_749_894_9;
/// Cost of a fault: that of the residual from which on a measurement is more probably a fault.
pub(in crate::location) const FAULT: f64 = 8.28;
/// Cost, relative to that of the mode, up to which the cost is taken as a parabola.
const PARABOLA: f64 = 2.0;
const HALVINGS: usize = 40;

/// Relative difference between the true and the stated speed of the signals, with its standard
/// deviation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Speed {
    /// Relative difference, positive for faster signals: 0.01 is one per cent.
    pub share: f64,
    /// Standard deviation of the relative difference.
    pub sigma: f64,
    /// The same if the errors of the measurements were independent.
    pub alone: f64,
}

impl Speed {
    /// A speed that is exactly as stated.
    pub const EXACT: Self = Self { share: 0.0, sigma: 0.0, alone: 0.0 };

    /// Stretches all distances that signals travelled, and likewise their standard deviations: 5 K
    /// numbers of each instant.
    pub fn apply(&self, numbers: &mut [f64], receivers: usize) {
        for instant in numbers.chunks_mut(KINDS * receivers) {
            for kind in [Kind::Range, Kind::RangeDifference, Kind::Arrival] {
                let from = kind as usize * receivers;
                instant[from..from + receivers].iter_mut().for_each(|v| *v *= 1.0 + self.share);
            }
        }
    }
}

/// The cost of an instant at some speed, its position if it could be located, and its outliers.
pub(in crate::location) struct Trial {
    pub cost: f64,
    pub position: Option<Vec<f64>>,
    pub outlier: Vec<bool>,
}

impl Locator {
    /// Estimates the speed of the signals, whose relative difference from the stated speed has a prior
    /// with this standard deviation. O(N M), for at most 256 instants.
    pub fn speed<const D: usize>(
        &self,
        instants: &[Instant<'_>],
        sigma: f64,
        workspace: &mut Workspace<D>,
    ) -> Speed {
        let few: Vec<_> = spread(instants, FEW).collect();
        let prior = |share: f64| 0.5 * (share / sigma).powi(2);
        let mut best = (f64::INFINITY, 0.0);
        for step in -STEPS..=STEPS {
            let share = FARTHEST * sigma * f64::from(step) / f64::from(STEPS);
            let each = few.iter().map(|instant| self.trial(instant, share, None, workspace).cost);
            let cost = prior(share) + each.sum::<f64>();
            if cost < best.0 {
                best = (cost, share);
            }
        }
        // from here on, the search for each instant starts from its position at this speed
        let followed: Vec<_> = spread(instants, SAMPLE)
            .filter_map(|instant| {
                let position = self.trial(&instant, best.1, None, workspace).position?;
                Some((instant, position))
            })
            .collect();
        let mut cost = |share: f64| {
            let each = followed.iter().map(|(instant, position)| {
                self.trial(instant, share, Some(position), workspace).cost
            });
            prior(share) + each.sum::<f64>()
        };
        let step = FARTHEST * sigma / f64::from(STEPS);
        let share = lowest(&mut cost, best.1 - step, best.1 + step);
        let alone = width(&mut cost, share, sigma);
        let speed = Speed { share, sigma: alone, alone };
        self.beside_lasting(spread(instants, SAMPLE), speed, sigma, workspace)
    }

    /// Whether the stated speed, and still air, may be wrong, if the share of the speed and the wind have these
    /// standard deviations. O(N M), for at most 256 instants.
    pub(in crate::location) fn may_have_other_medium<const D: usize>(
        &self,
        instants: &[Instant<'_>],
        sigmas: (f64, f64),
        workspace: &mut Workspace<D>,
    ) -> (bool, bool) {
        self.suspects_medium(spread(instants, SAMPLE), sigmas, workspace)
    }

    /// Returns the cost of the residuals of an instant if the signals are faster by this share.
    pub(in crate::location) fn trial<const D: usize>(
        &self,
        instant: &Instant<'_>,
        share: f64,
        initial: Option<&Vec<f64>>,
        workspace: &mut Workspace<D>,
    ) -> Trial {
        let initial = initial.map(Vec::as_slice).or(instant.initial);
        let (fix, solution) = self.located_at(share, &Instant { initial, ..*instant }, workspace);
        let Solution { position, residual, outlier, .. } = solution;
        if fix.status != Status::None {
            let cost = FAULT * fix.degrees_of_freedom.max(0) as f64;
            return Trial { cost, position: None, outlier };
        }
        let known = || residual.iter().zip(&outlier).filter(|(u, _)| !u.is_nan());
        let squares: f64 = known().map(|(u, _)| u * u).sum();
        let cost = |(u, wrong): (&f64, &bool)| if *wrong { FAULT } else { FAULT.min(0.5 * u * u) };
        // the rest of the statistic is the residual of the height
        let rest = 0.5 * (fix.statistic - squares).max(0.0);
        let cost = known().map(cost).sum::<f64>() + rest;
        Trial { cost, position: Some(position.to_vec()), outlier }
    }

    /// Locates an instant if the signals are faster by this share.
    pub(in crate::location) fn located_at<const D: usize>(
        &self,
        share: f64,
        instant: &Instant<'_>,
        workspace: &mut Workspace<D>,
    ) -> (Fix, Solution<D>) {
        let receivers = instant.values.len() / KINDS;
        let (mut values, mut sigmas) = (instant.values.to_vec(), instant.sigmas.to_vec());
        let speed = Speed { share, ..Speed::EXACT };
        speed.apply(&mut values, receivers);
        speed.apply(&mut sigmas, receivers);
        let at = Instant { values: &values, sigmas: &sigmas, ..*instant };
        let mut solution = Solution::of(instant);
        // at some speeds another position is as good: this must not count as a fault
        (self.deciding().locate(&at, &mut solution.output(), workspace), solution)
    }
}

/// Returns at most this number of instants, evenly spread.
pub(in crate::location) fn spread<'a, 'b>(
    instants: &'b [Instant<'a>],
    most: usize,
) -> impl Iterator<Item = Instant<'a>> + 'b {
    let count = instants.len().min(most);
    (0..count).map(move |i| instants[i * instants.len() / count])
}

/// Returns the argument of the lowest cost by the golden section.
fn lowest(cost: &mut impl FnMut(f64) -> f64, mut low: f64, mut high: f64) -> f64 {
    let (mut left, mut right) = (high - GOLDEN * (high - low), low + GOLDEN * (high - low));
    let (mut of_left, mut of_right) = (cost(left), cost(right));
    for _ in 0..NARROWINGS {
        if of_left <= of_right {
            (high, right, of_right) = (right, left, of_left);
            left = high - GOLDEN * (high - low);
            of_left = cost(left);
        } else {
            (low, left, of_left) = (left, right, of_right);
            right = low + GOLDEN * (high - low);
            of_right = cost(right);
        }
    }
    0.5 * (low + high)
}

/// Returns the standard deviation of γ from the curvature of the cost about its mode.
fn width(cost: &mut impl FnMut(f64) -> f64, mode: f64, prior: f64) -> f64 {
    let least = cost(mode);
    let mut step = prior;
    let mut rise = f64::NAN;
    for _ in 0..HALVINGS {
        rise = cost(mode - step) + cost(mode + step) - 2.0 * least;
        if rise <= 2.0 * PARABOLA {
            break;
        }
        step *= 0.5;
    }
    // faults can hide the rise of the cost; the result is at most the sigma of the prior
    if rise > 0.0 { (step / rise.sqrt()).min(prior) } else { prior }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::{assert_close, assert_within};

    #[test]
    fn a_parabola_has_its_mode_and_width() {
        let mut cost = |x: f64| 0.5 * ((x - 0.3) / 0.02).powi(2);
        assert_within(1e-4, lowest(&mut cost, 0.0, 1.0), 0.3);
        assert_close(width(&mut cost, 0.3, 1.0), 0.02);
    }

    #[test]
    fn a_flat_cost_leaves_the_prior() {
        assert_eq!(width(&mut |_| 1.0, 0.0, 0.5), 0.5);
    }
}
