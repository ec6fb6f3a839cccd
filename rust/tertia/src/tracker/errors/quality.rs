//! Estimates by how much the errors of reported positions exceed those that are stated, and how large the
//! errors of their times are, from the plots of confirmed tracks alone.
//!
//! As for radars, medians of third differences are free of the motion and of outliers. They are divided
//! differences, as reports come at any times. An error of the time is one of the position along the path that
//! grows with the speed; across the path, there is only the error of the position.

use super::differences::{ENOUGH, SPREAD, Size, THIRD, WINDOW};
use crate::base::plane::Plane;
use crate::tracker::plot::Measured;
use serde::{Deserialize, Serialize};
use std::f64::consts::{FRAC_PI_2, TAU};

/// Number of tracks of a sensor that are used at the same time.
const TRACKS: u64 = 64;
/// Longest time between successive reports, s, and largest ratio of two such times.
const LONGEST: f64 = 12.5;
const UNEVEN: f64 = 4.0;
/// Number of classes of the speed, in sigmas of the position a second, each twice as fast as the one before,
/// and logarithm to the base 2 of the speed of the first one.
const CLASSES: usize = 12;
const SLOWEST: f64 = -3.0;
/// Number of sigmas by which the variance of times must exceed zero.
const SURE_CLOCK: f64 = 4.0;
/// Steps to which times may be rounded, and error of a rounded time, s; largest ratio of the variance of rounded
/// times to that found from differences, from which constant errors disappear.
const STEPS: [f64; 7] = [10.0, 5.0, 2.0, 1.0, 0.5, 0.2, 0.1];
const NEAR: f64 = 1e-6;
const MOST_LASTING: f64 = 25.0;
/// Number of different times in a scan from which on a radar turns, or number of changes of the time within the
/// scan if steps are at most this share of a scan; least mean cosine of the changes of the angle between plots and
/// its beam; and least number of scans.
const TURNING: f64 = 2.5;
const CHANGES: f64 = 3.0;
const SHORT: f64 = 0.35;
const BEAM: f64 = 0.6;
const FEWEST_SCANS: f64 = 5.0;
/// Correlation of successive second differences of independent errors, and of random changes of the velocity;
/// variances of the second differences of the former and of third differences of the latter, in those of the
/// errors and of the second differences.
const OF_ERRORS: f64 = -4.0 / 6.0;
const OF_MOTION: f64 = 0.25;
const SECOND: f64 = 6.0;
const THIRD_OF_MOTION: f64 = 1.5;

/// How the reports of a sensor differ from what it states.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Quality {
    /// Ratio of the variance of positions to the stated one, at least 1.
    pub ratio: f64,
    /// Variance of their times, s²; 0 if none was found.
    pub clock: f64,
    /// Part of this variance that is the same in successive reports of a target, s².
    pub lasting: f64,
    /// Share of the stated variance of positions that successive reports do not show: errors of this size last.
    pub common: f64,
}

impl Default for Quality {
    fn default() -> Self {
        Self { ratio: 1.0, clock: 0.0, lasting: 0.0, common: 0.0 }
    }
}

/// Of which steps all times are multiples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Grid {
    first: Option<f64>,
    last: f64,
    /// Number of times, and of different ones.
    count: f64,
    different: f64,
    is_off: [bool; STEPS.len()],
    /// Angle of the last plot of a radar to its beam, and mean cosine of the changes of this angle; time of the plot
    /// within its scan, and number of changes of this time.
    angle: f64,
    beam: f64,
    phase: f64,
    changes: f64,
}

impl Grid {
    /// Whether all times are multiples of any of these steps.
    fn may_be_rounded(&self) -> bool {
        self.is_off.contains(&false)
    }

    fn saw(&mut self, time: f64) {
        if !self.may_be_rounded() {
            return;
        }
        let since = time - *self.first.get_or_insert(time);
        self.count += 1.0;
        if self.different == 0.0 || time > self.last {
            (self.last, self.different) = (time, self.different + 1.0);
        }
        let near = NEAR + NEAR * NEAR * time.abs();
        for (is_off, step) in self.is_off.iter_mut().zip(STEPS) {
            *is_off |= (since - step * (since / step).round()).abs() > near;
        }
    }

    /// Compares the azimuth of a plot of a radar with its beam, which turns once in a period.
    fn saw_beam(&mut self, time: f64, azimuth: f64, period: f64) {
        let phase = (time / period).fract();
        let angle = azimuth - TAU * phase;
        let change = (phase - self.phase) - (phase - self.phase).round();
        self.changes +=
            f64::from(u8::from(self.count > 1.0 && change.abs() * period > NEAR.sqrt()));
        self.phase = phase;
        self.beam += ((angle - self.angle).cos() - self.beam) / self.count;
        self.angle = angle;
    }

    /// The largest step of which all times are multiples, s; 0 if there is none.
    fn step(&self) -> f64 {
        let mut steps = STEPS.into_iter().zip(self.is_off);
        steps.find(|(_, is_off)| !is_off).map_or(0.0, |(step, _)| step)
    }

    /// Variance of times that are rounded to this step, s².
    fn variance(&self) -> f64 {
        self.step().powi(2) / 12.0
    }

    /// Quality of a radar with this scan period. Its beam turns, so that its plots come at all times: if they
    /// do not, their times are rounded. If plots come only once in a scan, or at times that have nothing to do
    /// with the beam, nothing is concluded.
    fn of_radar(&self, period: f64) -> Quality {
        let (step, duration) = (self.step(), self.last - self.first.unwrap_or(self.last));
        let is_divided = self.changes >= CHANGES && step <= SHORT * period;
        let is_turning = is_divided || self.different * period > TURNING * duration;
        let is_turning = is_turning && self.beam > BEAM;
        if step == 0.0 || self.count < ENOUGH || !is_turning || duration < FEWEST_SCANS * period {
            return Quality::default();
        }
        // the error of a target changes by this share of the step from scan to scan
        let (clock, change) = (self.variance(), (period / step).rem_euclid(1.0));
        let correlation = 1.0 - 6.0 * change * (1.0 - change);
        Quality { clock, lasting: clock * correlation.max(0.0), ..Quality::default() }
    }
}

/// Last reports of a target, the last first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Chain {
    track: u64,
    count: usize,
    times: [f64; 4],
    positions: [[f64; 2]; 4],
    /// Stated covariances.
    stated: [Plane; 4],
}

/// Errors along the path, of targets of similar speeds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Along {
    size: Size,
    /// Mean square of the speed, in sigmas of the position a second.
    square: f64,
}

/// Number and mean of the products of the signs of successive second differences.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Product {
    count: f64,
    mean: f64,
}

impl Product {
    fn saw(&mut self, [last, before]: [f64; 2]) {
        self.count = (self.count + 1.0).min(WINDOW);
        self.mean += ((last * before).signum() - self.mean) / self.count;
    }

    /// Share of the errors in the variance of third differences; the rest is motion.
    fn share(&self) -> f64 {
        let correlation = (FRAC_PI_2 * self.mean).sin();
        let motion = (correlation - OF_ERRORS) * SECOND / (OF_MOTION - correlation);
        let is_mixed = correlation < OF_MOTION;
        if is_mixed { THIRD / (THIRD + THIRD_OF_MOTION * motion.max(0.0)) } else { 0.0 }
    }
}

/// Reports of a sensor; of a radar, only their times.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Reports {
    grid: Grid,
    across: Size,
    along: [Along; CLASSES],
    products: [Product; 2],
    chains: Vec<Chain>,
}

/// Divided difference of values at these times, over the standard deviation that errors with these variances
/// cause, times the root of `sum`.
fn divided<const N: usize>(times: &[f64], values: &[f64], variances: &[f64], sum: f64) -> f64 {
    let coefficient = |i: usize| {
        let others = (0..N).filter(|j| *j != i);
        1.0 / others.map(|j| times[i] - times[j]).product::<f64>()
    };
    let own: [f64; N] = std::array::from_fn(coefficient);
    let difference: f64 = own.iter().zip(values).map(|(c, value)| c * value).sum();
    let variance: f64 = own.iter().zip(variances).map(|(c, variance)| c * c * variance).sum();
    difference * (sum / variance).sqrt()
}

impl Reports {
    /// Starts again with the estimates so far: the plots that follow belong to new tracks.
    pub fn restart(&mut self) {
        self.chains.clear();
    }

    /// Time since the last report of a track, s, if it is known.
    pub fn age(&self, track: u64, time: f64) -> Option<f64> {
        let chain = self.chains.get((track % TRACKS) as usize);
        chain
            .filter(|own| own.track == track && own.count > 0)
            .map(|own| (time - own.times[0]).abs())
    }

    /// Updates the estimates by a plot of a confirmed track, of which this is the stated covariance; if it is
    /// unknown, nan, only the time counts.
    pub fn saw(&mut self, track: u64, plot: &Measured, stated: Plane) {
        self.grid.saw(plot.time);
        if self.chains.is_empty() {
            self.chains = vec![Chain::default(); TRACKS as usize];
        }
        let chain = &mut self.chains[(track % TRACKS) as usize];
        let age = plot.time - chain.times[0];
        let is_other = chain.track != track;
        if age == 0.0 || is_other && chain.count > 0 && (0.0..LONGEST).contains(&age) {
            return;
        }
        let before = chain.times[0] - chain.times[1];
        let is_even = chain.count < 2 || (age < UNEVEN * before && before < UNEVEN * age);
        if is_other || !is_even || !(0.0..LONGEST).contains(&age) {
            (chain.track, chain.count) = (track, 0);
        }
        chain.times.copy_within(..3, 1);
        chain.positions.copy_within(..3, 1);
        chain.stated.copy_within(..3, 1);
        (chain.times[0], chain.positions[0], chain.stated[0]) = (plot.time, plot.position, stated);
        chain.count += 1;
        if chain.count >= 4 {
            let full = *chain;
            self.learn(&full);
        }
    }

    fn learn(&mut self, Chain { times, positions, stated, .. }: &Chain) {
        let [last, .., first] = positions;
        let way = [0, 1].map(|i| (last[i] - first[i]) / (times[0] - times[3]));
        let speed = way[0].hypot(way[1]).max(f64::MIN_POSITIVE);
        let [east, north] = way.map(|v| v / speed);
        let differences = |direction: [f64; 2]| {
            let values = positions.map(|[x, y]| x * direction[0] + y * direction[1]);
            let variances = stated.map(|own| own.form(direction));
            let second =
                |i: usize| divided::<3>(&times[i..], &values[i..], &variances[i..], SECOND);
            (divided::<4>(times, &values, &variances, THIRD), [second(0), second(1)])
        };
        let (along, across) = (differences([east, north]), differences([north, -east]));
        if !(along.0 + across.0).is_finite() {
            return;
        }
        let variance = stated.iter().map(|own| own.form([east, north])).sum::<f64>() / 4.0;
        let square = speed * speed / variance;
        let class = (0.5 * square.log2() - SLOWEST).clamp(0.0, CLASSES as f64 - 1.0);
        let own = &mut self.along[class as usize];
        own.size.saw(along.0);
        own.square += (square - own.square) / own.size.count;
        self.across.saw(across.0);
        self.products[0].saw(across.1);
        self.products[1].saw(along.1);
    }

    /// Ratio of the variance of positions to the stated one, whether it is sure or not; none before there are
    /// enough plots.
    pub fn ratio(&self) -> Option<f64> {
        let is_known = self.across.count >= ENOUGH;
        is_known.then(|| self.across.level.exp() * self.products[0].share())
    }

    /// Whether the times may be rounded.
    pub fn may_be_rounded(&self) -> bool {
        self.grid.may_be_rounded()
    }

    /// Learns from a plot of a radar at this azimuth, with this scan period.
    pub fn saw_plot(&mut self, time: f64, azimuth: f64, period: f64) {
        self.grid.saw(time);
        self.grid.saw_beam(time, azimuth, period);
    }

    /// What is significant of the estimates; `period` is that of a radar.
    pub fn quality(&self, period: f64) -> Quality {
        let Some(ratio) = self.ratio() else { return self.grid.of_radar(period) };
        let changing = self.clock();
        let clock = changing.max(self.grid.variance().min(MOST_LASTING * changing));
        let common = (1.0 - self.across.most(ratio)).max(0.0);
        Quality { ratio: self.across.sure(ratio), clock, lasting: clock - changing, common }
    }

    /// Variance of the times that differences show, s²; 0 unless it is significant.
    fn clock(&self) -> f64 {
        let across = self.across.level.exp();
        let (share, mut sums) = (self.products[1].share(), [0.0; 3]);
        for Along { size, square } in self.along.iter().filter(|own| own.square > 0.0) {
            let along = size.level.exp();
            let weight = size.count * (square / (along * SPREAD)).powi(2);
            let found = (along * share - across) / square;
            let by_across = weight / square;
            [weight, weight * found, by_across]
                .iter()
                .zip(&mut sums)
                .for_each(|(x, sum)| *sum += x);
        }
        let [weight, found, by_across] = sums;
        let clock = found / weight;
        let of_across = by_across / weight * across * SPREAD;
        let variance = 1.0 / weight + of_across * of_across / self.across.count;
        if clock > SURE_CLOCK * variance.sqrt() { clock } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_within;
    use crate::base::random::Random;

    fn normal(random: &mut Random) -> f64 {
        (-2.0 * (1.0 - random.uniform()).ln()).sqrt() * (TAU * random.uniform()).cos()
    }

    /// Reports of 16 targets at 60 to 210 m/s, with errors of `noise` times the stated 10 m, at times that
    /// `shown` makes of the true ones; their velocities change by `restless` m/s a second.
    fn reports(noise: f64, restless: f64, shown: impl Fn(f64, &mut Random) -> f64) -> Reports {
        let (mut found, mut random) = (Reports::default(), Random::new(7));
        for track in 1..17 {
            let (mut velocity, mut position) = ([10.0 * f64::from(track) + 50.0, 20.0], [0.0; 2]);
            let mut time = random.uniform();
            for _ in 0..200 {
                let step = 0.8 + 0.4 * random.uniform();
                time += step;
                for (x, v) in position.iter_mut().zip(&mut velocity) {
                    *x += *v * step;
                    *v += restless * step.sqrt() * normal(&mut random);
                }
                let position = position.map(|x| x + 10.0 * noise * normal(&mut random));
                let plot =
                    Measured { time: shown(time, &mut random), position, ..Measured::default() };
                found.saw(track as u64, &plot, Plane { xx: 100.0, xy: 0.0, yy: 100.0 });
            }
        }
        found
    }

    fn sigma(found: &Reports) -> f64 {
        found.quality(1.0).clock.sqrt()
    }

    #[test]
    fn larger_errors_of_positions_are_found() {
        let found = |noise| reports(noise, 0.0, |time, _| time);
        assert_eq!(found(1.0).quality(1.0), Quality::default());
        assert_within(0.1, found(0.5).ratio().unwrap(), 0.25);
        let half = found(0.5).quality(1.0);
        assert!((0.6..0.75).contains(&half.common), "{half:?}");
        assert_eq!(half, Quality { common: half.common, ..Quality::default() });
        let twice = found(2.0).quality(1.0);
        assert!((3.2..4.2).contains(&twice.ratio) && twice.clock == 0.0, "{twice:?}");
    }

    #[test]
    fn motion_is_no_error() {
        let ratio = |noise| reports(noise, 5.0, |time, _| time).ratio().unwrap();
        assert!((0.8..1.25).contains(&ratio(1.0)), "{}", ratio(1.0));
        assert!((3.2..5.0).contains(&ratio(2.0)), "{}", ratio(2.0));
        assert_eq!(sigma(&reports(1.0, 5.0, |time, _| time)), 0.0);
    }

    #[test]
    fn errors_of_times_are_found() {
        let late = reports(1.0, 0.0, |time, random| time + 0.1 * normal(random));
        assert_within(0.2, sigma(&late), 0.1);
        assert_eq!(late.quality(1.0).lasting, 0.0);
        // rounded times of successive reports have nearly the same error
        let rounded = reports(1.0, 0.0, |time, _| time.round()).quality(1.0);
        assert_within(1e-12, rounded.clock, 1.0 / 12.0);
        assert!(rounded.lasting > 0.5 * rounded.clock, "{rounded:?}");
    }

    #[test]
    fn times_of_a_beam_that_turns_are_rounded() {
        let radar = |period: f64, times: &dyn Fn(f64, f64) -> f64| {
            let mut found = Reports::default();
            for plot in 0..300 {
                let (scan, turn) = (f64::from(plot / 10), f64::from(plot % 10) / 10.0);
                found.saw_plot(times(scan, turn), TAU * turn, period);
            }
            found.quality(period)
        };
        let rounded = radar(4.0, &|scan, azimuth| (4.0 * (scan + azimuth)).floor());
        assert_within(1e-12, rounded.clock, 1.0 / 12.0);
        assert_within(1e-12, rounded.lasting, 1.0 / 12.0);
        let uneven = radar(4.5, &|scan, azimuth| (4.5 * (scan + azimuth)).round());
        assert_within(1e-12, uneven.clock, 1.0 / 12.0);
        assert_eq!(uneven.lasting, 0.0);
        // all plots of a scan at one time, and times that are not rounded
        assert_eq!(radar(4.0, &|scan, _| 4.0 * scan), Quality::default());
        assert_eq!(radar(4.0, &|scan, azimuth| 4.03 * (scan + azimuth)).clock, 0.0);
        // not those of the beam
        let others =
            radar(4.0, &|scan, azimuth| 4.0 * scan + (30.0 * azimuth * azimuth).floor() % 4.0);
        assert_eq!(others, Quality::default());
    }
}
