//! The side of the stations on which the targets are.
//!
//! Stations near one plane (in two dimensions, near one line) measure nearly the same distances from a
//! position and from its mirror image, and many instants are ambiguous. The targets of a batch are usually
//! on one side. The share of targets on the first side is 0 or 1 with a prior probability of 0.4 each;
//! otherwise its prior is uniform. The likelihoods of both sides at all instants give its posterior,
//! and this the prior odds of the sides at each instant.
//!
//! Lasting errors of the stations make the same side likelier at all instants. Therefore the side counts
//! only if all targets together are clearly likelier on it than on the other side, even if the stations
//! have lasting errors (see [`steady`](super::steady)).

use super::speed::{Trial, spread};
use super::steady::evidence_against;
use crate::location::search::fix::{Fix, Instant, Status};
use crate::location::search::mirror::{Mirror, Side};
use crate::location::solver::{Locator, Workspace};

/// Size of a place, as a share of the distances of the stations within their plane. Instants in one place
/// count once.
const PLACE: f64 = 0.1;
/// Largest number of instants of a batch, evenly spread, from which the side is learnt.
const SAMPLE: usize = 256;
/// Log odds with which every position is on one side, if there is a minimum of the cost.
const CERTAIN: f64 = 1e6;
/// Smallest difference in log evidence between all targets on one side and all on the other, allowing for
/// lasting errors, at which the side counts.
const DECISIVE: f64 = 5.0;
/// Smallest log odds of a side that counts: 4.5 to 1.
const LIKELY: f64 = 1.5;
/// Prior probability that all targets are on one side.
const ONE_SIDED: f64 = 0.8;
/// Steps of the log odds over which the share of one side is averaged, on either side of even odds.
const STEPS: i32 = 120;
const STEPS_OF_ONE: f64 = 10.0;

impl Locator {
    fn with_side(&self, side: Side) -> Self {
        let mut own = *self;
        own.side = Some(side);
        own
    }

    /// Returns this locator with the side of the stations on which the targets of a batch are, or `None` if
    /// no instant is ambiguous, if the stations are not near a plane, or if the measurements do not tell the
    /// side. The fixes are those of a first location. O(N K² + K³), for at most 256 instants.
    pub fn on_side<const D: usize>(
        &self,
        instants: &[Instant<'_>],
        fixes: &[Fix],
        workspace: &mut Workspace<D>,
    ) -> Option<Self> {
        let stations = instants.first()?.stations;
        let is_open = fixes.iter().any(|fix| fix.status == Status::Ambiguous);
        let are_fixed = instants.iter().all(|own| own.stations == stations);
        if !is_open || !are_fixed || self.side.is_some() || self.lenth().is_some() {
            return None;
        }
        let mirror =
            Mirror::<D>::of(stations.chunks_exact(D).map(|s| std::array::from_fn(|i| s[i])));
        if !mirror.is_thin() {
            return None;
        }
        let sides = [1.0, -1.0].map(|sign| self.with_side(mirror.side(sign, CERTAIN)));
        let size = PLACE * mirror.width(stations.len() / D);
        let mut places = Vec::new();
        let both: Vec<_> = spread(instants, SAMPLE)
            .filter_map(|instant| {
                let trials = sides.map(|side| side.trial(&instant, 0.0, None, workspace));
                let likelier = likelier(&mirror, &trials)?;
                places.extend(trials[0].position.as_ref().map(|p| mirror.place(p, size)));
                Some((instant, likelier, agreeing(&instant, &trials)))
            })
            .collect();
        let log_odds = log_odds(both.iter().map(|(_, likelier, _)| *likelier));
        let cleaned = both.iter().map(|(instant, _, values)| Instant { values, ..*instant });
        let [above, below] = sides.map(|side| side.medium_sums(cleaned.clone(), 0.0, workspace));
        let sign = log_odds.signum();
        let evidence = sign * evidence_against(above?, below?)? * variety(places);
        let is_known = log_odds.abs() > LIKELY && evidence > DECISIVE;
        is_known.then(|| self.with_side(mirror.side(sign, log_odds.abs())))
    }
}

/// Returns the difference in log likelihood between the best positions above and below the plane; `None`
/// if one of them is not on its side.
fn likelier<const D: usize>(mirror: &Mirror<D>, [above, below]: &[Trial; 2]) -> Option<f64> {
    let height = |trial: &Trial| trial.position.as_ref().map(|p| mirror.height(p));
    (height(above)? > 0.0 && height(below)? < 0.0).then_some(below.cost - above.cost)
}

/// Returns the number of different places as a share of all. At the same place, lasting errors speak for the
/// same side every time.
fn variety<const D: usize>(mut places: Vec<[i64; D]>) -> f64 {
    let all = places.len().max(1) as f64;
    places.sort_unstable();
    places.dedup();
    places.len() as f64 / all
}

/// Returns the values of an instant without the outliers of either trial: lasting errors may be outliers on
/// one side only, and the evidence of both sides is to be of the same measurements.
fn agreeing(instant: &Instant<'_>, trials: &[Trial; 2]) -> Vec<f64> {
    let [above, below] = trials.each_ref().map(|trial| &trial.outlier);
    let marked = instant.values.iter().zip(above.iter().zip(below));
    marked.map(|(v, (a, b))| if *a || *b { f64::NAN } else { *v }).collect()
}

/// Returns the logarithm of the odds that a target is on the first side, for the differences in log
/// likelihood between the sides at each instant. All targets are on one side with the prior probability
/// [`ONE_SIDED`]; otherwise the prior of the share of the first side is uniform. O(N).
fn log_odds(likelier: impl Iterator<Item = f64> + Clone) -> f64 {
    let likelihood = |share: f64| -> f64 {
        let of = |d: f64| {
            // neither exponential overflows
            let most = d.max(0.0);
            (share * (d - most).exp() + (1.0 - share) * (-most).exp()).ln() + most - d
        };
        likelier.clone().map(of).sum()
    };
    let of = |step: i32| {
        let share = (1.0 + (-f64::from(step) / STEPS_OF_ONE).exp()).recip();
        let width = share * (1.0 - share) / STEPS_OF_ONE;
        (share, likelihood(share) + ((1.0 - ONE_SIDED) * width).ln())
    };
    let ends = [0.0, 1.0].map(|share| (share, likelihood(share) + (0.5 * ONE_SIDED).ln()));
    let all: Vec<_> = (-STEPS..=STEPS).map(of).chain(ends).collect();
    let most = all.iter().map(|(_, ln)| *ln).fold(f64::MIN, f64::max);
    let sum =
        |of: &dyn Fn(f64) -> f64| all.iter().map(|(s, ln)| of(*s) * (ln - most).exp()).sum::<f64>();
    (sum(&|share| share) / sum(&|share| 1.0 - share)).ln()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_within;
    use crate::base::random::Random;
    use crate::base::small::{Vector, norm};
    use crate::location::search::fix::{Method, Solution};
    use crate::sensors::{KINDS, Kind};

    const STATIONS: [[f64; 3]; 6] = [
        [0.0, 0.0, 10.0],
        [3000.0, 200.0, 0.0],
        [2800.0, 2500.0, 30.0],
        [-100.0, 2900.0, 5.0],
        [1500.0, 1200.0, 25.0],
        [1000.0, 3500.0, 15.0],
    ];

    /// Ranges of targets at `heights` all over the area, with errors of 5 m: mirror images look alike.
    fn ranges(heights: impl Fn(usize) -> f64) -> Vec<[f64; 6 * KINDS]> {
        measured(|i| [(977 * i % 3000) as f64, (1361 * i % 3000) as f64, heights(i)], 3, 0.0)
    }

    /// Ranges of targets with random errors, and with constant ones up to this size.
    fn measured(
        target: impl Fn(usize) -> [f64; 3],
        seed: u64,
        constant: f64,
    ) -> Vec<[f64; 6 * KINDS]> {
        let mut random = Random::new(seed);
        let constant = STATIONS.map(|_| random.symmetric(constant));
        let mut of = |i: usize| {
            let p = target(i);
            let mut values = [f64::NAN; 6 * KINDS];
            for (k, s) in STATIONS.iter().enumerate() {
                let offset: Vector<3> = std::array::from_fn(|j| p[j] - s[j]);
                values[6 * Kind::Range as usize + k] =
                    norm(&offset) + constant[k] + random.symmetric(8.0);
            }
            values
        };
        (0..100).map(&mut of).collect()
    }

    /// Returns the fixes of these ranges and their heights, and the same with the side of the batch.
    fn located(values: &[[f64; 6 * KINDS]]) -> [Option<Vec<(Fix, f64)>>; 2] {
        let sigmas = [5.0; 6 * KINDS];
        let of = |values| Instant {
            stations: STATIONS.as_flattened(),
            axes: None,
            values,
            sigmas: &sigmas,
            position_sigmas: None,
            height: None,
            initial: None,
        };
        let instants: Vec<_> = values.iter().map(|own| of(own.as_slice())).collect();
        let mut workspace = Workspace::<3>::default();
        let mut all = |locator: Locator| -> Vec<_> {
            let one = |instant: &Instant<'_>| {
                let mut solution = Solution::<3>::of(instant);
                let fix = locator.locate(instant, &mut solution.output(), &mut workspace);
                (fix, solution.position[2])
            };
            instants.iter().map(one).collect()
        };
        let locator = Locator::new(Method::Robust(3));
        let first = all(locator);
        let fixes: Vec<Fix> = first.iter().map(|(fix, _)| *fix).collect();
        let sided = locator.on_side(&instants, &fixes, &mut Workspace::<3>::default());
        [Some(first), sided.map(all)]
    }

    #[test]
    fn the_side_of_most_targets_decides_where_the_measurements_do_not() {
        for sign in [1.0, -1.0] {
            let [first, second] =
                located(&ranges(|i| sign * (300.0 + 10.0 * (i % 40) as f64))).map(Option::unwrap);
            let ambiguous = |all: &[(Fix, f64)]| {
                all.iter().filter(|(fix, _)| fix.status == Status::Ambiguous).count()
            };
            assert!(ambiguous(&first) > 20, "{}", ambiguous(&first));
            assert!(ambiguous(&second) < 3, "{}", ambiguous(&second));
            let is_right = |(fix, up): &(Fix, f64)| fix.status != Status::None || sign * up > 0.0;
            assert!(second.iter().all(is_right));
        }
    }

    #[test]
    fn targets_on_both_sides_have_no_side() {
        let side = |i: usize| if i.is_multiple_of(2) { 1.0 } else { -1.0 };
        let [_, second] = located(&ranges(|i| side(i) * (300.0 + 10.0 * (i % 40) as f64)));
        assert!(second.is_none());
    }

    #[test]
    fn a_target_at_rest_shows_no_side() {
        let [first, second] = located(&measured(|_| [1100.0, 900.0, 400.0], 3, 0.0));
        assert!(first.unwrap().iter().any(|(fix, _)| fix.status == Status::Ambiguous));
        assert!(second.is_none());
    }

    #[test]
    fn constant_errors_are_not_taken_for_a_side() {
        let target = |i: usize| {
            [(977 * i % 3000) as f64, (1361 * i % 3000) as f64, 200.0 + 10.0 * (i % 30) as f64]
        };
        for seed in 0..6 {
            let [_, second] = located(&measured(target, 11 + seed, 20.0));
            let is_right = |(fix, up): &&(Fix, f64)| fix.status == Status::None && *up > 0.0;
            let is_found = |(fix, _): &&(Fix, f64)| fix.status == Status::None;
            if let Some(all) = second {
                let (right, found) = (all.iter().filter(is_right), all.iter().filter(is_found));
                assert!(2 * right.count() > found.count(), "{seed}");
            }
        }
    }

    #[test]
    fn odds_follow_the_share_of_a_side() {
        // with n instants on one side, and none on the other, they are at least those of a uniform prior
        assert!(log_odds([50.0; 99].into_iter()) > 100_f64.ln());
        assert_within(1e-9, log_odds([-50.0; 99].into_iter()), -log_odds([50.0; 99].into_iter()));
        // one of 100 on the other side: (99 + 1) / (1 + 1), all on one side being impossible
        let mut one = [50.0; 100];
        one[7] = -50.0;
        assert_within(1e-3, log_odds(one.into_iter()), 50_f64.ln());
        assert!(log_odds([].into_iter()).abs() < 1e-9);
        assert!(log_odds([1e4, 1e4].into_iter()).is_finite());
        assert!(log_odds([-1e4, 1e4].into_iter()).abs() < 1e-9);
    }
}
