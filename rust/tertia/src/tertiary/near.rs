//! Search for tracks that are near each other: a first test of all tracks on compact data that fit into
//! caches.

use super::share::mapped;
use crate::association::Grid;
use crate::base::error::Result;
use crate::sensors::Identities;
use nalgebra::{Matrix4, Vector4};
use pulp::{Arch, Simd, WithSimd};
use std::collections::BTreeMap;
use std::num::NonZero;

/// Squared distance above which no history of a pair is kept.
pub(super) const FAR: f64 = 100.0;
/// Standard deviation of a height, m, and its growth with the age of the height, m/s.
const HEIGHT: f64 = 60.0;
const CLIMB: f64 = 10.0;
/// Heights that differ by more than this many standard deviations belong to two targets.
pub(super) const APART: f64 = 4.5;
/// Largest difference of positions along an axis, m.
const REACH: f64 = 8000.0;
/// Number of tracks that one thread examines at a time, and time for one track, ns.
const PART: usize = 256;
const LOOK_NS: f64 = 200.0;
/// Number of values of a sample that are compared.
const LANES: usize = 8;

/// A track of a sensor at the instant of the picture, without its biases.
#[derive(Clone, Debug, Default)]
pub(super) struct Sample {
    /// Id of the track, in order of initiation.
    pub id: u64,
    pub sensor: usize,
    pub mean: Vector4<f64>,
    pub covariance: Matrix4<f64>,
    /// Covariance including the contribution of unknown errors of the sensor.
    pub whole: Matrix4<f64>,
    /// Derivatives of the state by the errors of the sensor.
    pub sensitivity: Matrix4<f64>,
    pub height: f64,
    /// Time since the last row, s.
    pub age: f64,
    pub identities: Identities,
}

/// For each sample, the indices of the samples that may belong to the same target.
pub(super) struct Near {
    /// Start of the list of each sample in `others`, and the end of the last list.
    start: Vec<u32>,
    others: Vec<u32>,
}

impl Near {
    /// Finds for each sample the later samples of other sensors that may belong to the same target. With
    /// `by_hand`, these are all samples that are not far away. The samples are examined cell by cell,
    /// each with those after it in this order, because in any other order most of the data would not be
    /// in the cache.
    ///
    /// # Errors
    /// A position that is not finite.
    pub fn new(spots: &[Spot], by_hand: bool, n_threads: Option<NonZero<usize>>) -> Result<Self> {
        let layers = layers(spots)?;
        let part = |n: usize| (0..n).step_by(PART).map(move |from| from..n.min(from + PART));
        let parts: Vec<_> = (0..layers.len())
            .flat_map(|l| part(layers[l].order.len()).map(move |part| (l, part)))
            .collect();
        let nanoseconds = PART as f64 * LOOK_NS;
        let found = mapped(parts.into_iter(), nanoseconds, n_threads, |(l, part)| {
            let (mut found, mut passed) = (Vec::with_capacity(4 * PART), Vec::new());
            for at in part {
                look(&layers[l..], at, by_hand, &mut passed, &mut found);
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

    /// Returns the samples near a sample, in no particular order.
    pub fn of(&self, i: usize) -> &[u32] {
        &self.others[self.start[i] as usize..self.start[i + 1] as usize]
    }
}

/// Adds to `found` the pairs of one sample with the samples after it that may belong to the same target. The
/// sample is at this index in the first of the `layers`.
fn look(
    layers: &[Layer],
    at: usize,
    by_hand: bool,
    passed: &mut Vec<bool>,
    found: &mut Vec<[u32; 2]>,
) {
    let (i, sensor) = layers[0].order[at];
    let own = layers[0].lanes.each_ref().map(|lane| lane[at]);
    let mut after = at + 1;
    for layer in layers {
        let around = |k: usize| if by_hand { REACH } else { layer.reach(own[k + 2]) };
        let corner = |sign: f64| std::array::from_fn(|k| own[k] + sign * around(k));
        layer.grid.ranges(corner(-1.0), corner(1.0), &mut |range| {
            let range = range.start.max(after)..range.end;
            if range.is_empty() {
                return;
            }
            passed.resize(range.len(), false);
            let lanes = layer.lanes.each_ref().map(|lane| &lane[range.clone()]);
            Arch::new().dispatch(Test { own, lanes, by_hand, passed });
            for (&(j, other), &passed) in layer.order[range].iter().zip(&*passed) {
                if passed && other != sensor {
                    found.push([i.min(j), i.max(j)]);
                }
            }
        });
        after = 0;
    }
}

/// Tests at once which of several samples may belong to the same target as one sample. All tests are made
/// without branches: each outcome alone is almost random, so processors cannot predict it.
struct Test<'a> {
    own: [f64; LANES],
    lanes: [&'a [f64]; LANES],
    by_hand: bool,
    passed: &'a mut [bool],
}

impl WithSimd for Test<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { own, lanes, by_hand, passed } = self;
        let n = passed.len();
        let lanes = lanes.map(|lane| &lane[..n]);
        for (k, passed) in passed.iter_mut().enumerate() {
            let squared = |at: usize| (own[at] - lanes[at][k]).powi(2);
            let variance = |at: usize| own[at] + lanes[at][k];
            let is_near = |axis: usize| squared(axis) <= REACH * REACH;
            let is_far = |axis: usize| squared(axis) > FAR * variance(axis + 2);
            // the errors of two sensors may be correlated, which at most doubles the variance
            let is_faster = |axis: usize| squared(axis + 4) > 2.0 * FAR * variance(axis + 6);
            let is_other = is_far(0) | is_far(1) | is_faster(0) | is_faster(1);
            *passed = is_near(0) & is_near(1) & (by_hand | !is_other);
        }
    }
}

/// Samples with variances of similar size. The distance of the search depends on the variances of both
/// samples.
struct Layer {
    grid: Grid,
    /// Cell by cell, the indices of the samples in the list of all samples, and their sensors.
    order: Vec<(u32, u32)>,
    /// Compared values of the samples, in the same order.
    lanes: [Vec<f64>; LANES],
    /// Largest variance of a position along an axis.
    largest: f64,
}

impl Layer {
    /// Distance along an axis up to which a sample with this variance is compared with those of the layer.
    fn reach(&self, variance: f64) -> f64 {
        (FAR * (variance + self.largest)).sqrt().min(REACH)
    }
}

/// Divides samples into layers by powers of four of their variances. Cost O(N).
fn layers(spots: &[Spot]) -> Result<Vec<Layer>> {
    let mut sizes: BTreeMap<i32, Vec<usize>> = BTreeMap::new();
    let variance = |spot: &Spot| spot.variance[0].max(spot.variance[1]);
    for (i, spot) in spots.iter().enumerate() {
        sizes.entry((0.5 * variance(spot).log2()).floor() as i32).or_default().push(i);
    }
    let layer = |places: Vec<usize>| {
        let points: Vec<_> = places.iter().map(|&i| spots[i].place).collect();
        let largest = places.iter().map(|&i| variance(&spots[i])).fold(0.0, f64::max);
        let lanes = std::array::from_fn(|_| Vec::with_capacity(places.len()));
        let mut layer = Layer { grid: Grid::default(), order: Vec::new(), lanes, largest };
        let cell = layer.reach(largest).max(1.0);
        layer.grid.fill(&points, cell)?;
        for entry in layer.grid.all() {
            let i = places[entry.index as usize];
            layer.order.push((i as u32, spots[i].sensor as u32));
            layer.lanes.iter_mut().zip(spots[i].lanes()).for_each(|(lane, own)| lane.push(own));
        }
        Ok(layer)
    };
    sizes.into_values().map(layer).collect()
}

/// Data of a track for the first test.
#[derive(Clone, Copy, Default)]
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

    /// Position and its variances, velocity and its variances.
    #[inline]
    fn lanes(&self) -> [f64; LANES] {
        let Self { place: [x, y], variance: [xx, yy], velocity: [u, v], spread: [uu, vv], .. } =
            *self;
        [x, y, xx, yy, u, v, uu, vv]
    }

    /// Whether the heights differ so much that they belong to two targets.
    pub fn is_apart(&self, other: &Self) -> bool {
        let up = self.height - other.height;
        up * up > APART * APART * height_variance([self.age, other.age])
    }
}

/// Variance of the difference of two heights of these ages.
pub(super) fn height_variance([a, b]: [f64; 2]) -> f64 {
    2.0 * HEIGHT * HEIGHT + CLIMB * CLIMB * (a * a + b * b)
}
