//! Noise of reported positions that differs between targets or along their paths: transponders differ, and the
//! accuracy of multilateration depends on the place.
//!
//! The covariance of the noise of each target follows from successive fourth differences, which are nearly free
//! of the motion. It is used once it predicts later differences better than the noise of all targets.

use crate::base::plane::Plane;
use crate::sensors::Identities;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Number of reports in a difference, and variance and covariance of successive fourth differences of independent
/// errors of variance 1.
const REPORTS: usize = 5;
const FOURTH: f64 = 70.0;
const SUCCESSIVE: f64 = -56.0;
/// Longest time between successive reports, s, largest ratio of two such times, and time after which a target is
/// forgotten, s.
const LONGEST: f64 = 12.5;
const UNEVEN: f64 = 1.5;
const FORGOTTEN: f64 = 120.0;
/// Number of targets that are followed until their noise is known to differ.
const TARGETS: usize = 64;
/// Number of differences over which the noise of a target is estimated, weight of the noise of all targets at
/// its beginning, and number of differences before which it is not compared.
const WINDOW: f64 = 40.0;
const BEGINNING: f64 = 8.0;
const FEW: f64 = 15.0;
/// Largest squared differences, in units of their variance, in an estimate and in a comparison: outliers count
/// as much.
const LARGEST: f64 = 8.0;
const FARTHEST: f64 = 30.0;
/// Logarithm of the odds from which the noise of targets differs.
const ODDS: f64 = 15.0;
/// Largest ratio of the variance of a target to that of all.
const MOST: f64 = 1e4;

/// Reports of one target.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Target {
    /// Number of successive reports, and of differences.
    reports: usize,
    count: f64,
    /// Last reports, the last first, with the covariances that were assumed.
    times: [f64; REPORTS],
    positions: [[f64; 2]; REPORTS],
    noise: [Plane; REPORTS],
    /// Last difference, in standard deviations.
    last: [f64; 2],
    /// Covariance of the noise relative to that of all targets, now and when it was compared last.
    size: Plane,
    before: Plane,
}

/// Noise of single targets of a sensor.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Individual {
    targets: BTreeMap<Key, Target>,
    /// Time at which targets were forgotten last.
    tidied: f64,
    /// Logarithm of the odds that the noise differs.
    odds: f64,
}

/// Kind and number of the identity of a target.
pub(in crate::tracker) type Key = (u8, i64);

/// Returns the identity of a target that is shared most rarely.
pub(in crate::tracker) fn key(own: &Identities) -> Option<Key> {
    let all = [own.icao_address.into(), own.identity, own.callsign, own.mode_3a.into()];
    (0..).zip(all).find(|(_, number)| *number >= 0)
}

const UNIT: Plane = Plane { xx: 1.0, xy: 0.0, yy: 1.0 };

impl Individual {
    /// Starts again, with the noise of each target as a first estimate.
    pub fn restart(&mut self) {
        for target in self.targets.values_mut() {
            (target.reports, target.count) = (0, target.count.min(1.0));
        }
    }

    /// Whether the noise differs between targets or along their paths.
    pub fn differs(&self) -> bool {
        self.odds > ODDS
    }

    /// Returns the covariance of a report of a target, given that for all targets.
    pub fn noise(&self, key: Option<Key>, noise: Plane) -> Plane {
        self.size(key).map_or(noise, |size| between(root(size), noise))
    }

    /// Returns the covariance for all targets that was the basis of this one.
    pub fn basis(&self, key: Option<Key>, noise: Plane) -> Plane {
        self.size(key).map_or(noise, |size| between(root(size).inverse(), noise))
    }

    fn size(&self, key: Option<Key>) -> Option<Plane> {
        let target = key.filter(|_| self.differs()).and_then(|key| self.targets.get(&key));
        target.filter(|own| own.count > 0.0).map(|own| own.size)
    }

    /// Updates the noise of a target by a report with the covariance that was assumed, and the variance of its
    /// time. `ratios` are those of variances of all targets to the stated ones, as assumed and as estimated, if
    /// they are known.
    pub fn saw(
        &mut self,
        key: Key,
        (time, position): (f64, [f64; 2]),
        (noise, clock): (Plane, f64),
        (assumed, estimated): (f64, Option<f64>),
    ) {
        let differs = self.differs();
        if (time - self.tidied).abs() > FORGOTTEN {
            let is_recent = |own: &Target| (time - own.times[0]).abs() < FORGOTTEN;
            self.targets.retain(|_, own| own.reports == 0 || is_recent(own));
            self.tidied = time;
        }
        if !differs && self.targets.len() >= TARGETS && !self.targets.contains_key(&key) {
            return;
        }
        let unknown = Target { size: UNIT, before: UNIT, ..Target::default() };
        let target = self.targets.entry(key).or_insert(unknown);
        if target.reports > 0 && target.times[0] == time {
            return;
        }
        target.add(time, position, noise);
        let Some((difference, covariance, late)) = target.difference() else { return };
        let late = late.scaled(clock);
        if let Some(ratio) =
            estimated.filter(|_| !differs && target.reports.is_multiple_of(REPORTS))
        {
            let common = covariance.scaled((ratio / assumed).max(1.0)).plus(late);
            if target.count > FEW {
                let own = between(root(target.before), covariance).plus(late);
                let own = log_density(own, difference);
                self.odds = (self.odds + own - log_density(common, difference)).max(0.0);
            }
            target.before = target.size;
        }
        let assumed_own = if differs { covariance } else { between(root(target.size), covariance) };
        target.learn(difference, assumed_own.plus(late), 1.0 / assumed);
    }
}

impl Target {
    fn add(&mut self, time: f64, position: [f64; 2], noise: Plane) {
        let (age, before) = (time - self.times[0], self.times[0] - self.times[1]);
        let is_even = self.reports < 2 || (age < UNEVEN * before && before < UNEVEN * age);
        if self.reports > 0 && !(is_even && age > 0.0 && age < LONGEST) {
            self.reports = 0;
        }
        self.times.copy_within(..REPORTS - 1, 1);
        self.positions.copy_within(..REPORTS - 1, 1);
        self.noise.copy_within(..REPORTS - 1, 1);
        (self.times[0], self.positions[0], self.noise[0]) = (time, position, noise);
        self.reports += 1;
    }

    /// Returns the divided difference of the last reports, its covariance, and that which times with a variance
    /// of 1 s² would add.
    fn difference(&self) -> Option<([f64; 2], Plane, Plane)> {
        if self.reports < REPORTS {
            return None;
        }
        let (mut difference, mut covariance, mut sum_of_squares) =
            ([0.0; 2], Plane::default(), 0.0);
        for i in 0..REPORTS {
            let others = (0..REPORTS).filter(|j| *j != i);
            let weight = 1.0 / others.map(|j| self.times[i] - self.times[j]).product::<f64>();
            for (sum, x) in difference.iter_mut().zip(self.positions[i]) {
                *sum += weight * x;
            }
            covariance = covariance.plus(self.noise[i].scaled(weight * weight));
            sum_of_squares += weight * weight;
        }
        let (last, first) = (self.positions[0], self.positions[REPORTS - 1]);
        let duration = self.times[0] - self.times[REPORTS - 1];
        let [u, v] = [0, 1].map(|i| (last[i] - first[i]) / duration);
        let late = Plane { xx: u * u, xy: u * v, yy: v * v }.scaled(sum_of_squares);
        // times that hardly differ may be too close for numbers
        let is_regular = covariance.determinant() > 0.0
            && covariance.determinant().is_normal()
            && difference.iter().all(|x| x.is_finite());
        is_regular.then_some((difference, covariance, late))
    }

    /// Updates the size by a difference with this assumed covariance. The product of successive differences is
    /// that of errors, of opposite signs, and not that of the motion.
    fn learn(&mut self, difference: [f64; 2], covariance: Plane, least: f64) {
        let white = times(root(covariance).inverse(), difference);
        let length = white[0] * white[0] + white[1] * white[1];
        let white = white.map(|x| x * (LARGEST / length).sqrt().min(1.0));
        let last = std::mem::replace(&mut self.last, white);
        if self.reports == REPORTS {
            return;
        }
        self.count = (self.count + 1.0).min(WINDOW);
        let rate = 1.0 / (self.count + BEGINNING).min(WINDOW);
        let product = |i: usize, j: usize| {
            0.5 * FOURTH / SUCCESSIVE * (white[i] * last[j] + white[j] * last[i])
        };
        let found = Plane { xx: product(0, 0), xy: product(0, 1), yy: product(1, 1) };
        let step = between(root(self.size), found.plus(UNIT.scaled(-1.0)));
        let size = limited(self.size.plus(step.scaled(rate)), least);
        if size.determinant().is_normal() {
            self.size = size;
        }
    }
}

/// `M v`
fn times(m: Plane, v: [f64; 2]) -> [f64; 2] {
    [m.xx * v[0] + m.xy * v[1], m.xy * v[0] + m.yy * v[1]]
}

/// `G M G`
fn between(g: Plane, m: Plane) -> Plane {
    let (first, second) = ([g.xx, g.xy], [g.xy, g.yy]);
    let by_second = times(m, second);
    Plane {
        xx: m.form(first),
        xy: first[0] * by_second[0] + first[1] * by_second[1],
        yy: m.form(second),
    }
}

/// The symmetric root of a positive definite matrix.
fn root(m: Plane) -> Plane {
    let s = m.determinant().max(0.0).sqrt();
    m.plus(UNIT.scaled(s)).scaled(1.0 / (m.xx + m.yy + 2.0 * s).sqrt())
}

/// Limits the eigenvalues.
fn limited(m: Plane, least: f64) -> Plane {
    let (middle, half) = (0.5 * (m.xx + m.yy), 0.5 * (m.xx - m.yy));
    let radius = half.hypot(m.xy);
    let [high, low] = [middle + radius, middle - radius].map(|own| own.clamp(least, MOST));
    if radius == 0.0 {
        return UNIT.scaled(high);
    }
    let (middle, by) = (0.5 * (high + low), 0.5 * (high - low) / radius);
    Plane { xx: middle + by * half, xy: by * m.xy, yy: middle - by * half }
}

/// Logarithm of a normal density, apart from a constant, if large differences count as less large ones.
fn log_density(covariance: Plane, difference: [f64; 2]) -> f64 {
    let square = covariance.inverse().form(difference).min(FARTHEST);
    -0.5 * (square + covariance.determinant().ln())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;
    use std::f64::consts::TAU;

    fn normal(random: &mut Random) -> f64 {
        (-2.0 * (1.0 - random.uniform()).ln()).sqrt() * (TAU * random.uniform()).cos()
    }

    /// Reports of 8 targets with a stated sigma of 10 m, whose sigmas east and north are given, and that turn by
    /// this rate at 100 m/s.
    fn reports(sigmas: impl Fn(i64) -> [f64; 2], rate: f64) -> Individual {
        let (mut found, mut random) = (Individual::default(), Random::new(3));
        let stated = UNIT.scaled(100.0);
        for report in 0..200 {
            let angle = rate * f64::from(report);
            for target in 0..8_i64 {
                let [east, north] = sigmas(target).map(|sigma| sigma * normal(&mut random));
                let position = if rate > 0.0 {
                    [angle.sin(), angle.cos()].map(|x| 100.0 / rate * x)
                } else {
                    [100.0 * f64::from(report), 0.0]
                };
                let position = [position[0] + east, position[1] + north];
                let noise = found.noise(Some((0, target)), stated);
                let time = f64::from(report);
                found.saw((0, target), (time, position), (noise, 0.0), (1.0, Some(1.0)));
            }
        }
        found
    }

    #[test]
    fn equal_noise_stays_that_of_all_even_in_turns() {
        for rate in [0.0, 0.05, 0.3] {
            let found = reports(|_| [10.0; 2], rate);
            assert!(!found.differs(), "{rate}: {}", found.odds);
            assert_eq!(found.noise(Some((0, 1)), UNIT), UNIT);
        }
        // errors that change slowly are not small
        assert!(!reports(|_| [1.0; 2], 0.0).differs());
    }

    #[test]
    fn times_that_hardly_differ_teach_nothing() {
        for step in [1e-30, 1e-80, 1e-300] {
            let mut found = Individual::default();
            for report in 0..40 {
                let (time, position) = (step * f64::from(report), [f64::from(report % 3), 0.0]);
                found.saw((0, 1), (time, position), (UNIT, 0.0), (1.0, Some(1.0)));
            }
            assert!(found.targets.values().all(|own| own.size == UNIT), "{step}");
        }
    }

    #[test]
    fn noise_of_single_targets_is_found_in_each_direction() {
        let found = reports(|target| if target < 4 { [10.0; 2] } else { [60.0, 15.0] }, 0.05);
        assert!(found.differs());
        let sigmas = |target: i64| {
            let own = found.noise(Some((0, target)), UNIT.scaled(100.0));
            [own.xx.sqrt(), own.yy.sqrt()]
        };
        for target in 0..4 {
            assert!(
                sigmas(target).iter().all(|own| (9.9..15.0).contains(own)),
                "{:?}",
                sigmas(target)
            );
        }
        for target in 4..8 {
            let [east, north] = sigmas(target);
            assert!((40.0..90.0).contains(&east), "{east}");
            assert!((10.0..25.0).contains(&north), "{north}");
        }
        assert_eq!(found.noise(None, UNIT), UNIT);
        let there = found.noise(Some((0, 5)), Plane { xx: 3.0, xy: 1.0, yy: 2.0 });
        let back = found.basis(Some((0, 5)), there);
        assert!((back.xx - 3.0).abs() < 1e-9 && (back.xy - 1.0).abs() < 1e-9);
    }
}
