//! Which tracks of different sensors may be of one target: now and before.

use super::bias::propagated;
use super::compare::Distance;
use super::near::{APART, FAR, Near, Sample, Spot, height_variance};
use super::share::mapped;
use crate::base::error::Result;
use crate::registration::{ERRORS, Errors};
use nalgebra::{DMatrix, Matrix4};
use pulp::{Arch, Simd, WithSimd};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::iter::Peekable;
use std::num::NonZero;
use std::slice::Iter;

/// χ² of four components: .999, and .999999 for a pair that has been one.
const GATE: f64 = 18.466_826_952_9;
const KEEP: f64 = 33.376_841_581_66;
/// Share of the newest value in running means.
const SHARE: f64 = 0.25;
/// What a pair that has been one is worth at least, and more than others.
const LEAST: f64 = 0.1;
const BONUS: f64 = 2.0;
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
        // compact, as most of what is near is far in terms of its variance
        let spots: Vec<_> = samples.iter().map(Spot::new).collect();
        let by_hand = !manual.joined.is_empty();
        let near = Near::new(&spots, by_hand, n_threads)?;
        let before = std::mem::take(&mut self.known);
        let look = |i: usize, old: &mut Old<'_>, found: &mut Vec<_>, others: &mut Vec<u32>| {
            let a = &samples[i];
            others.clear();
            others.extend_from_slice(near.of(i));
            others.sort_unstable();
            for j in others.iter().map(|&j| j as usize) {
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
            let (mut found, mut others) = (Vec::with_capacity(2 * PART), Vec::new());
            let end = samples.len().min(start + PART);
            let from = before.partition_point(|(key, _)| key.0 < samples[start].id);
            let mut old = before[from..].iter().peekable();
            (start..end).for_each(|i| look(i, &mut old, &mut found, &mut others));
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
