//! Which tracks are near one another: a first look at all of them, by what fits into caches.

use super::share::mapped;
use crate::association::{Grid, is_inside};
use crate::base::error::Result;
use crate::sensors::Identities;
use nalgebra::{Matrix4, Vector4};
use std::collections::BTreeMap;
use std::num::NonZero;

/// Beyond this distance squared nothing is remembered of a pair.
pub(super) const FAR: f64 = 100.0;
/// Standard deviation of a height, m, and how fast that of an old one grows, m/s.
const HEIGHT: f64 = 60.0;
const CLIMB: f64 = 10.0;
/// Heights that differ by so many standard deviations are of two targets.
pub(super) const APART: f64 = 4.5;
/// Largest distance of positions along an axis, m.
const REACH: f64 = 8000.0;
/// Tracks that one thread looks at at a time, and the time of one, ns.
const PART: usize = 256;
const LOOK_NS: f64 = 200.0;

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

/// The samples that may be of the target of each one, by their places in the list of all.
pub(super) struct Near {
    /// Where those of each sample begin, and where the last one's end.
    start: Vec<u32>,
    others: Vec<u32>,
}

impl Near {
    /// For each sample, later ones of other sensors; `by_hand` all that are not far away. Samples are looked
    /// at cell by cell, as in any other order most of what is read is not in the cache.
    ///
    /// # Errors
    /// A position that is not finite.
    pub fn new(spots: &[Spot], by_hand: bool, n_threads: Option<NonZero<usize>>) -> Result<Self> {
        let layers = layers(spots)?;
        let parts: Vec<_> = layers.iter().flat_map(|layer| layer.spots.chunks(PART)).collect();
        let nanoseconds = PART as f64 * LOOK_NS;
        let found = mapped(parts.into_iter(), nanoseconds, n_threads, |part| {
            let (mut found, mut near) = (Vec::with_capacity(4 * PART), Vec::new());
            for (i, spot) in part {
                let count = look((*i, spot), &layers, by_hand, &mut near);
                found.extend(near[..count].iter().map(|&j| [*i, j]));
            }
            Ok(found)
        })?;
        let mut start = vec![0; spots.len() + 1];
        for [i, _] in found.iter().flatten() {
            start[*i as usize] += 1;
        }
        let mut end = 0;
        for start in &mut start {
            end += *start;
            *start = end;
        }
        let mut others = vec![0; end as usize];
        for [i, j] in found.into_iter().flatten() {
            start[i as usize] -= 1;
            others[start[i as usize] as usize] = j;
        }
        Ok(Self { start, others })
    }

    /// Those of a sample, in no order.
    pub fn of(&self, i: usize) -> &[u32] {
        &self.others[self.start[i] as usize..self.start[i + 1] as usize]
    }
}

/// Finds the samples of a target that one may be of; returns their number.
fn look((i, one): (u32, &Spot), layers: &[Layer], by_hand: bool, near: &mut Vec<u32>) -> usize {
    let mut end = 0;
    for layer in layers {
        let around = |k: usize| if by_hand { REACH } else { layer.reach(one.variance[k]) };
        let corner = |sign: f64| std::array::from_fn(|k| one.place[k] + sign * around(k));
        let (low, high) = (corner(-1.0), corner(1.0));
        layer.grid.ranges(low, high, &mut |range| {
            let others = &layer.spots[range];
            if near.len() < end + others.len() {
                near.resize(end + others.len(), 0);
            }
            // all tests of a sample at once, without a jump: each alone is as good as random, which
            // processors cannot guess
            for (j, other) in others {
                let may_be = by_hand | !one.is_other(other);
                let is_near = is_inside(other.place, low, high) & may_be;
                near[end] = *j;
                end += usize::from((*j > i) & (other.sensor != one.sensor) & is_near);
            }
        });
    }
    end
}

/// Samples whose variances are of one size: how far others are sought depends on both.
struct Layer {
    grid: Grid,
    /// The samples cell by cell, with their places in the list of all.
    spots: Vec<(u32, Spot)>,
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
        let mut layer = Layer { grid: Grid::default(), spots: Vec::new(), largest };
        let cell = layer.reach(largest).max(1.0);
        layer.grid.fill(&points, cell)?;
        let by_cell = layer.grid.all().iter().map(|entry| places[entry.index as usize]);
        layer.spots = by_cell.map(|i| (i as u32, spots[i])).collect();
        Ok(layer)
    };
    sizes.into_values().map(layer).collect()
}

/// What a first look at a track needs.
#[derive(Clone, Copy)]
pub(super) struct Spot {
    pub id: u64,
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
    pub fn new(one: &Sample) -> Self {
        let p = &one.whole;
        let (place, variance) = ([one.mean[0], one.mean[1]], [p[(0, 0)], p[(1, 1)]]);
        let (velocity, spread) = ([one.mean[2], one.mean[3]], [p[(2, 2)], p[(3, 3)]]);
        let &Sample { id, sensor, height, age, .. } = one;
        Self { id, sensor, place, variance, velocity, spread, height, age }
    }

    /// Whether places or velocities are too far apart for one target.
    #[inline]
    fn is_other(&self, other: &Self) -> bool {
        let is_far = |k: usize| {
            let d = self.place[k] - other.place[k];
            d * d > FAR * (self.variance[k] + other.variance[k])
        };
        // the errors of two sensors may be correlated, which doubles the variance at most
        let is_faster = |k: usize| {
            let d = self.velocity[k] - other.velocity[k];
            d * d > 2.0 * FAR * (self.spread[k] + other.spread[k])
        };
        is_far(0) | is_far(1) | is_faster(0) | is_faster(1)
    }

    /// Whether the heights are those of two targets.
    pub fn is_apart(&self, other: &Self) -> bool {
        let up = self.height - other.height;
        up * up > APART * APART * height_variance([self.age, other.age])
    }
}

/// Variance of the difference of two heights of these ages.
pub(super) fn height_variance([a, b]: [f64; 2]) -> f64 {
    2.0 * HEIGHT * HEIGHT + CLIMB * CLIMB * (a * a + b * b)
}
