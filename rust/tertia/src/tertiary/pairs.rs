//! Which tracks of different sensors may be of one target: now and before.

use super::bias::propagated;
use super::compare::Distance;
use super::share::mapped;
use crate::association::Grid;
use crate::base::error::Result;
use crate::registration::{ERRORS, Errors};
use crate::sensors::Identities;
use nalgebra::{DMatrix, Matrix4, Vector4};
use pulp::{Arch, Simd, WithSimd};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::iter::Peekable;
use std::num::NonZero;
use std::slice::Iter;

/// χ² of four components: .999, and .999999 for a pair that has been one.
const GATE: f64 = 18.466_826_952_9;
const KEEP: f64 = 33.376_841_581_66;
/// Beyond this distance squared nothing is remembered of a pair.
const FAR: f64 = 100.0;
/// Share of the newest value in running means.
const SHARE: f64 = 0.25;
/// What a pair that has been one is worth at least, and more than others.
const LEAST: f64 = 0.1;
const BONUS: f64 = 2.0;
/// Largest distance of positions along an axis, m.
const REACH: f64 = 8000.0;
/// Standard deviation of a height, m, and how fast that of an old one grows, m/s.
const HEIGHT: f64 = 60.0;
const CLIMB: f64 = 10.0;
/// Heights that differ by so many standard deviations are of two targets.
const APART: f64 = 4.5;
/// Range of heights over which other targets are spread, m.
const LAYER: f64 = 10_000.0;
/// Likelihood ratio of equal identities.
const IDENTITIES: f64 = 4096.0;
/// Cycles in a row in which identities differ, after which they are of two targets.
const DIFFERENT: u8 = 2;
/// Least density of other targets, per m², and the spread of their velocities, m/s.
const LEAST_DENSITY: f64 = 2e-9;
const VELOCITIES: f64 = 250.0;
/// Sides of the least rectangle that others are spread over, m.
const LEAST_EXTENT: f64 = 20e3;
/// Tracks that one thread compares at a time, and the time of one, ns.
const PART: usize = 256;
const PAIRS_NS: f64 = 1000.0;
/// By a hand that joined them.
const JOINED: f64 = 1e6;

/// A track of a sensor at the instant of the picture, without its biases.
#[derive(Clone, Debug)]
pub(super) struct Sample {
    /// Which track, in the order of their beginnings.
    pub id: u64,
    pub sensor: usize,
    pub mean: Vector4<f64>,
    pub covariance: Matrix4<f64>,
    /// The covariance with what unknown errors of the sensor add.
    pub whole: Matrix4<f64>,
    /// By the errors of the sensor.
    pub sensitivity: Matrix4<f64>,
    pub height: f64,
    /// Seconds since the message.
    pub age: f64,
    pub identities: Identities,
}

/// What is remembered of a pair.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct History {
    score: f64,
    squared: f64,
    /// Whether the two were of one target.
    pub paired: bool,
    /// Cycles in which their identities differed.
    different: u8,
}

/// Two tracks, by their places in the list of samples, with the gain of pairing them; `passes` in the
/// gate.
#[derive(Clone, Copy, Debug)]
pub(super) struct Candidate {
    pub first: usize,
    pub second: usize,
    pub gain: f64,
    pub passes: bool,
    /// D² now.
    pub squared: f64,
}

/// What hands have decided of pairs of tracks.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Manual {
    pub joined: BTreeSet<(u64, u64)>,
    pub separate: BTreeSet<(u64, u64)>,
}

/// Pairs and their histories, in the order of the numbers of their tracks.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Pairs {
    known: Vec<((u64, u64), History)>,
}

/// Errors of all sensors, and their covariances, sensor by sensor.
pub(super) struct Known {
    pub errors: Vec<Errors>,
    blocks: Vec<Matrix4<f64>>,
}

impl Known {
    pub fn new(errors: Vec<Errors>, covariance: &DMatrix<f64>) -> Self {
        let k = errors.len();
        let block = |a: usize, b: usize| {
            covariance.fixed_view::<ERRORS, ERRORS>(ERRORS * a, ERRORS * b).into_owned()
        };
        let blocks = (0..k * k).map(|at| block(at / k, at % k)).collect();
        Self { errors, blocks }
    }

    /// Between two sensors.
    pub fn block(&self, a: usize, b: usize) -> &Matrix4<f64> {
        &self.blocks[a * self.errors.len() + b]
    }
}

/// The key of two tracks.
pub(super) fn key(a: u64, b: u64) -> (u64, u64) {
    (a.min(b), a.max(b))
}

impl Pairs {
    /// All pairs of samples, in order of their ids, that may be one target, with `density` of others.
    ///
    /// # Errors
    /// A position that is not finite.
    pub fn look(
        &mut self,
        samples: &[Sample],
        known: &Known,
        manual: &Manual,
        density: f64,
        n_threads: Option<NonZero<usize>>,
    ) -> Result<Vec<Candidate>> {
        let places: Vec<_> = samples.iter().map(place_of).collect();
        // compact, as most of what is near is far in terms of its variance
        let spots: Vec<_> = samples.iter().map(Spot::new).collect();
        let by_hand = !manual.joined.is_empty();
        let layers = layers(&spots)?;
        let before = std::mem::take(&mut self.known);
        let look = |i: usize, old: &mut Old<'_>, found: &mut Vec<_>, near: &mut Vec<usize>| {
            let (a, p) = (&samples[i], &samples[i].whole);
            near.clear();
            // all tests of a sample at once: each alone is as good as random, which processors cannot guess
            let mut meet = |j: usize| {
                let spot = &spots[j];
                let is_far = |k: usize| {
                    let d = places[i][k] - spot.place[k];
                    d * d > FAR * (p[(k, k)] + spot.variance[k])
                };
                // the errors of two sensors may be correlated, which doubles the variance at most
                let is_faster = |k: usize| {
                    let d = a.mean[2 + k] - spot.velocity[k];
                    d * d > 2.0 * FAR * (p[(2 + k, 2 + k)] + spot.spread[k])
                };
                let is_other = is_far(0) | is_far(1) | is_faster(0) | is_faster(1);
                if (j > i) & (spot.sensor != a.sensor) & (by_hand | !is_other) {
                    near.push(j);
                }
            };
            for layer in &layers {
                let around = |k: usize| if by_hand { REACH } else { layer.reach(p[(k, k)]) };
                let corner = |sign: f64| std::array::from_fn(|k| places[i][k] + sign * around(k));
                layer.grid.entries(corner(-1.0), corner(1.0), &mut |own| meet(own.tag as usize));
            }
            near.sort_unstable();
            for &j in near.iter() {
                let pair = (a.id, spots[j].id);
                while old.next_if(|(key, _)| *key < pair).is_some() {}
                let history = old.next_if(|(key, _)| *key == pair).map(|&(_, history)| history);
                let joined = by_hand && manual.joined.contains(&pair);
                if history.is_none() && !joined && spots[i].is_apart(&spots[j]) {
                    continue;
                }
                let b = &samples[j];
                let block = known.block(a.sensor, b.sensor);
                let distance = Arch::new().dispatch(Compared { a, b, block });
                let Some(distance) = distance else { continue };
                if distance.squared > FAR && !joined {
                    continue;
                }
                let (mut candidate, history) = judged(a, b, distance, density, history);
                (candidate.first, candidate.second) = (i, j);
                if joined {
                    (candidate.gain, candidate.passes) = (JOINED, true);
                } else if manual.separate.contains(&pair) {
                    candidate.gain = f64::NEG_INFINITY;
                }
                found.push((candidate, pair, history));
            }
        };
        let parts = (0..samples.len()).step_by(PART);
        let found = mapped(parts, PART as f64 * PAIRS_NS, n_threads, |start| {
            let (mut found, mut near) = (Vec::with_capacity(2 * PART), Vec::new());
            let end = samples.len().min(start + PART);
            let from = before.partition_point(|(key, _)| key.0 < samples[start].id);
            let mut old = before[from..].iter().peekable();
            (start..end).for_each(|i| look(i, &mut old, &mut found, &mut near));
            Ok(found)
        })?;
        self.known = found.iter().flatten().map(|&(_, pair, history)| (pair, history)).collect();
        Ok(found.into_iter().flatten().map(|(candidate, ..)| candidate).collect())
    }

    /// Remembers which pairs, the candidates of the last look, are one target: `group` of each sample.
    pub fn remember(&mut self, candidates: &[Candidate], group: &[usize]) {
        for ((_, history), pair) in self.known.iter_mut().zip(candidates) {
            history.paired = group[pair.first] == group[pair.second];
        }
    }
}

/// What is remembered of pairs, in order of their ids.
type Old<'a> = Peekable<Iter<'a, ((u64, u64), History)>>;

/// Samples whose variances are of one size: how far others are sought depends on both.
struct Layer {
    /// Tags are places in the list of samples.
    grid: Grid,
    /// Largest variance of a position along an axis.
    largest: f64,
}

impl Layer {
    /// How far along an axis the samples are that one with this variance is compared with.
    fn reach(&self, variance: f64) -> f64 {
        (FAR * (variance + self.largest)).sqrt().min(REACH)
    }
}

/// Samples by powers of four of their variances. Cost O(N).
fn layers(spots: &[Spot]) -> Result<Vec<Layer>> {
    let mut sizes: BTreeMap<i32, Vec<usize>> = BTreeMap::new();
    let variance = |spot: &Spot| spot.variance[0].max(spot.variance[1]);
    for (i, spot) in spots.iter().enumerate() {
        sizes.entry((0.5 * variance(spot).log2()).floor() as i32).or_default().push(i);
    }
    let layer = |places: Vec<usize>| {
        let points: Vec<_> = places.iter().map(|&i| spots[i].place).collect();
        let largest = places.iter().map(|&i| variance(&spots[i])).fold(0.0, f64::max);
        let mut layer = Layer { grid: Grid::default(), largest };
        let cell = layer.reach(largest).max(1.0);
        layer.grid.fill_tagged(&points, |at| places[at] as u32, cell)?;
        Ok(layer)
    };
    sizes.into_values().map(layer).collect()
}

/// What a first look at a track needs.
struct Spot {
    id: u64,
    sensor: usize,
    place: [f64; 2],
    variance: [f64; 2],
    velocity: [f64; 2],
    /// Variances of the velocity.
    spread: [f64; 2],
    height: f64,
    age: f64,
}

impl Spot {
    fn new(one: &Sample) -> Self {
        let p = &one.whole;
        let (place, variance) = (place_of(one), [p[(0, 0)], p[(1, 1)]]);
        let (velocity, spread) = ([one.mean[2], one.mean[3]], [p[(2, 2)], p[(3, 3)]]);
        let &Sample { id, sensor, height, age, .. } = one;
        Self { id, sensor, place, variance, velocity, spread, height, age }
    }

    /// Whether the heights are those of two targets.
    fn is_apart(&self, other: &Self) -> bool {
        let up = self.height - other.height;
        up * up > APART * APART * height_variance([self.age, other.age])
    }
}

/// Variance of the difference of two heights of these ages.
fn height_variance([a, b]: [f64; 2]) -> f64 {
    2.0 * HEIGHT * HEIGHT + CLIMB * CLIMB * (a * a + b * b)
}

fn place_of(sample: &Sample) -> [f64; 2] {
    [sample.mean[0], sample.mean[1]]
}

/// The distance of two samples whose sensors' errors have this covariance.
struct Compared<'a> {
    a: &'a Sample,
    b: &'a Sample,
    block: &'a Matrix4<f64>,
}

impl WithSimd for Compared<'_> {
    type Output = Option<Distance>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Option<Distance> {
        let Self { a, b, block } = self;
        let cross = propagated(&a.sensitivity, block, &b.sensitivity);
        let total = a.whole + b.whole - cross - cross.transpose();
        Distance::new(&(a.mean - b.mean), total)
    }
}

/// The gain of a pair, and what is remembered of it.
fn judged(
    a: &Sample,
    b: &Sample,
    distance: Distance,
    density: f64,
    history: Option<History>,
) -> (Candidate, History) {
    let mut score = distance.score(density);
    let mut apart = false;
    let up = a.height - b.height;
    if up.is_finite() {
        let variance = height_variance([a.age, b.age]);
        apart = up * up > APART * APART * variance;
        score -= 0.5 * (up * up / variance + (std::f64::consts::TAU * variance).ln()) - LAYER.ln();
    }
    let mut different = 0;
    match a.identities.same(&b.identities) {
        Some(true) => score += IDENTITIES.ln(),
        Some(false) => different = history.map_or(0, |h| h.different).saturating_add(1),
        None => (),
    }
    let mut next = History { score, squared: distance.squared, paired: false, different };
    let mut passes = distance.squared <= GATE;
    if let Some(before) = history {
        next.score = before.score + SHARE * (score - before.score);
        next.squared = before.squared + SHARE * (distance.squared - before.squared);
        next.paired = before.paired;
        passes = if before.paired {
            distance.squared.min(next.squared) <= KEEP
        } else {
            passes && next.squared <= GATE
        };
    }
    let mut gain = next.score;
    if next.paired && passes {
        gain = gain.max(LEAST) + BONUS;
    }
    if apart || different >= DIFFERENT {
        gain = f64::NEG_INFINITY;
    }
    let squared = distance.squared;
    (Candidate { first: 0, second: 0, gain, passes, squared }, next)
}

/// Density of other targets in position and velocity: that of the sensor with most tracks, in the
/// rectangle that holds nine tenths of each axis.
pub(super) fn density(samples: &[Sample]) -> f64 {
    let velocities = std::f64::consts::PI * VELOCITIES * VELOCITIES;
    let mut counts: BTreeMap<usize, usize> = BTreeMap::new();
    samples.iter().for_each(|one| *counts.entry(one.sensor).or_default() += 1);
    let most = counts.into_values().max().unwrap_or(0) as f64;
    let extent = |axis: usize| {
        let mut values: Vec<_> = samples.iter().map(|one| one.mean[axis]).collect();
        let n = values.len();
        let mut at = |place: usize| *values.select_nth_unstable_by(place, f64::total_cmp).1;
        if n < 2 {
            f64::INFINITY
        } else {
            ((at(n - 1 - n / 20) - at(n / 20)) / 0.9).max(LEAST_EXTENT)
        }
    };
    (most / (extent(0) * extent(1))).max(LEAST_DENSITY) / velocities
}
