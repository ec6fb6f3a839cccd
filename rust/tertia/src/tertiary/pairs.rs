//! Pairs of tracks of different sensors that may belong to one target, with their histories.

use super::bias::propagated;
use super::compare::Distance;
use super::near::{APART, FAR, Near, Sample, Spot, height_variance};
use super::share::{fill, mapped};
use crate::base::error::Result;
use crate::base::scratch::Scratch;
use crate::registration::{Errors, KINDS};
use nalgebra::{DMatrix, Matrix4};
use pulp::{Arch, Simd, WithSimd};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::iter::Peekable;
use std::num::NonZero;
use std::slice::Iter;

/// Quantiles of χ² with four degrees of freedom: 0.999, and 0.999999 for pairs that already were one target.
const GATE: f64 = 18.466_826_952_9;
const KEEP: f64 = 33.376_841_581_66;
/// Weight of the newest value in running means.
const SHARE: f64 = 0.25;
/// Smallest gain of a pair that already was one target, and its bonus over other pairs.
const LEAST: f64 = 0.1;
const BONUS: f64 = 2.0;
/// Range of heights over which other targets are distributed, m.
const LAYER: f64 = 10_000.0;
/// Likelihood ratio of equal identities.
const IDENTITIES: f64 = 4096.0;
/// Number of successive cycles with different identities after which tracks belong to two targets.
const DIFFERENT: u8 = 2;
/// Smallest density of other targets, per m², and the speed up to which their velocities are spread, m/s.
const LEAST_DENSITY: f64 = 2e-9;
const VELOCITIES: f64 = 250.0;
/// Smallest side of the rectangle over which other targets are distributed, m.
const LEAST_EXTENT: f64 = 20e3;
/// Number of tracks that one thread compares at a time, and time for one track, ns.
const PART: usize = 256;
const PAIRS_NS: f64 = 1000.0;
/// Time to copy the data of a track for the first test, ns.
const SPOT_NS: f64 = 50.0;
/// Gain of a pair that was joined by hand.
const JOINED: f64 = 1e6;

/// History of a pair.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct History {
    score: f64,
    squared: f64,
    /// Whether the two tracks belonged to one target.
    pub paired: bool,
    /// Number of successive cycles in which the identities differed.
    different: u8,
}

/// A pair of tracks, as indices in the list of samples, with the gain of pairing them; `passes` is whether
/// the pair is in the gate.
#[derive(Clone, Copy, Debug)]
pub(super) struct Candidate {
    pub first: usize,
    pub second: usize,
    pub gain: f64,
    pub passes: bool,
    /// Current D².
    pub squared: f64,
}

/// Decisions by hand on pairs of tracks.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Manual {
    pub joined: BTreeSet<(u64, u64)>,
    pub separate: BTreeSet<(u64, u64)>,
}

impl Manual {
    /// Drops the decisions on tracks that no longer exist: nobody can withdraw these decisions, and as long
    /// as any pair is joined by hand, all pairs within some kilometres are compared.
    pub fn forget(&mut self, alive: impl Iterator<Item = u64>) {
        if self.joined.is_empty() && self.separate.is_empty() {
            return;
        }
        let alive: BTreeSet<u64> = alive.collect();
        let kept = |pair: &(u64, u64)| alive.contains(&pair.0) && alive.contains(&pair.1);
        self.joined.retain(kept);
        self.separate.retain(kept);
    }
}

/// Pairs and their histories, sorted by the ids of their tracks.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Pairs {
    known: Vec<Remembered>,
    /// Memory of the pairs before, and of the candidates.
    #[serde(skip)]
    memory: Scratch<(Vec<Remembered>, Vec<Candidate>)>,
}

/// Ids of the tracks of a pair, and its history.
type Remembered = ((u64, u64), History);

/// Estimated errors of all sensors, and their covariances in blocks of two sensors.
pub(super) struct Known {
    pub errors: Vec<Errors>,
    blocks: Vec<Matrix4<f64>>,
}

impl Known {
    pub fn new(errors: Vec<Errors>, covariance: &DMatrix<f64>) -> Self {
        let k = errors.len();
        let block = |a: usize, b: usize| {
            covariance.fixed_view::<KINDS, KINDS>(KINDS * a, KINDS * b).into_owned()
        };
        let blocks = (0..k * k).map(|at| block(at / k, at % k)).collect();
        Self { errors, blocks }
    }

    /// Covariance of the errors of two sensors.
    pub fn block(&self, a: usize, b: usize) -> &Matrix4<f64> {
        &self.blocks[a * self.errors.len() + b]
    }
}

/// Key of a pair of tracks.
pub(super) fn key(a: u64, b: u64) -> (u64, u64) {
    (a.min(b), a.max(b))
}

impl Pairs {
    /// Returns all pairs of samples that may belong to one target, sorted by id; [`Self::remember`] takes them
    /// back. `density` is that of other targets.
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
        // compact data, because most samples that are near are far in terms of their variance
        let mut spots = Vec::new();
        fill(&mut spots, samples.iter(), SPOT_NS, n_threads, Spot::new);
        let by_hand = !manual.joined.is_empty();
        let near = Near::new(&spots, by_hand, n_threads)?;
        let (memory, mut candidates) = std::mem::take(&mut self.memory.0);
        let before = std::mem::replace(&mut self.known, memory);
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
        self.known.clear();
        candidates.clear();
        for (candidate, pair, history) in found.into_iter().flatten() {
            self.known.push((pair, history));
            candidates.push(candidate);
        }
        self.memory.0.0 = before;
        Ok(candidates)
    }

    /// Stores which candidates of the last call of `look` belong to one target; `group` contains the group
    /// of each sample.
    pub fn remember(&mut self, candidates: Vec<Candidate>, group: &[usize]) {
        for ((_, history), pair) in self.known.iter_mut().zip(&candidates) {
            history.paired = group[pair.first] == group[pair.second];
        }
        self.memory.0.1 = candidates;
    }
}

/// Histories of pairs, sorted by id.
type Old<'a> = Peekable<Iter<'a, Remembered>>;

/// Computes the distance of two samples; `block` is the covariance of the errors of their sensors.
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

/// Returns the gain of a pair and its new history.
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

/// Density of other targets in position and velocity: the number of tracks of the sensor with the most,
/// over the rectangle that contains nine tenths of the positions on each axis.
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
