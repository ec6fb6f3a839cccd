//! The fusion centre, which makes a picture in each cycle.

use super::bias::{corrected, propagated, sensitivity};
use super::groups::{Group, grouped};
use super::jump::jumps;
use super::lasting::{Positions, raised};
use super::member::{FORGOTTEN, Member, take};
use super::near::Sample;
use super::pairs::{Known, Manual, Pairs, density, key};
use super::row::Row;
use super::rule::{Part, Rule};
use super::share::{fill, mapped};
use super::source::{Source, paced, with_noise};
use super::target::{Target, Tracklet};
use crate::base::distribution::chi_square_upper;
use crate::base::error::Result;
use crate::base::mixed::IntegerMap;
use crate::base::scratch::Scratch;
use crate::base::state::{restored, saved};
use crate::registration::{Errors, Registrar, Update};
use crate::sensors::{Identities, Radar};
use serde::{Deserialize, Serialize};
use std::cmp::Reverse;
use std::collections::BTreeSet;
use std::num::NonZero;
use std::ops::Deref;

/// Number of scans without a row after which a track is no longer used.
const OLD: f64 = 2.5;
/// Time to extrapolate a track, to filter the plots of a target, and to make its row of the picture, ns.
const SAMPLE_NS: f64 = 300.0;
const FOLLOW_NS: f64 = 3000.0;
const SHOWN_NS: f64 = 500.0;
/// Cycles after which a target is confirmed, and cycles without another sensor after which it is doubtful.
const CONFIRMED: usize = 3;
const UNSEEN: usize = 10;
/// Detection probability from which a sensor must see a target within its range.
const CERTAIN: f64 = 0.8;

/// Settings of a centre.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Settings {
    /// The sensors.
    pub radars: Vec<Radar>,
    /// Rule by which states are fused.
    pub rule: Rule,
    /// Correlation of positions and velocities of two tracks of one target, for [`Rule::Matrix`].
    pub cross_correlation: [f64; 2],
    /// Whether the systematic errors of the sensors are estimated.
    pub registers: bool,
    /// Prior of the systematic errors of each sensor: their values, their standard deviations, and the rates
    /// of their drift, 1/s.
    pub errors: Vec<[Errors; 3]>,
}

/// A target in the picture.
#[derive(Clone, Debug, PartialEq)]
pub struct SystemTrack {
    /// Number of the target, from 1.
    pub number: u64,
    /// East and north, and their rates, m and m/s.
    pub state: [f64; 4],
    /// Covariance of the state, row by row.
    pub covariance: [f64; 16],
    /// Number of the member track of each sensor.
    pub members: Vec<Option<i64>>,
    /// p-value of the test whether the members agree; nan for a single member.
    pub pvalue: f64,
    /// Whether the target has been present for three cycles.
    pub confirmed: bool,
    /// Whether a sensor that should see the target does not see it.
    pub doubtful: bool,
    /// Height, m; nan if no sensor reports one.
    pub height: f64,
    /// Identity of each kind, from the newest member that has one.
    pub identities: Identities,
}

/// The fusion centre, which makes one picture from the tracks of several sensors.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Centre {
    settings: Settings,
    registrar: Registrar,
    /// Sorted by sensor and track number.
    members: Vec<Member>,
    waiting: Vec<Row>,
    /// Sorted by number.
    #[expect(clippy::vec_box, reason = "they are a kilobyte each, and change their places")]
    targets: Vec<Box<Target>>,
    pairs: Pairs,
    manual: Manual,
    /// What is learnt of the trackers of the sensors.
    sources: Vec<Source>,
    next: [u64; 2],
    #[serde(skip)]
    samples: Scratch<Vec<Sample>>,
}

impl Centre {
    /// Creates a centre without tracks.
    pub fn new(settings: Settings) -> Self {
        let [start, sigma, drift] =
            [0, 1, 2].map(|at| settings.errors.iter().map(|one| one[at]).collect::<Vec<_>>());
        // tracks are reported as positions, without slant ranges
        let slant = vec![false; settings.radars.len()];
        Self {
            registrar: Registrar::new(settings.radars.clone(), slant, start, sigma, &drift),
            members: Vec::new(),
            waiting: Vec::new(),
            targets: Vec::new(),
            pairs: Pairs::default(),
            manual: Manual::default(),
            sources: vec![Source::default(); settings.radars.len()],
            next: [1; 2],
            settings,
            samples: Scratch::default(),
        }
    }

    /// Returns the registrar, which estimates the errors of the sensors.
    pub fn registrar(&self) -> &Registrar {
        &self.registrar
    }

    /// Returns the centre as bytes.
    pub fn to_bytes(&self) -> Vec<u8> {
        saved(self)
    }

    /// Restores a centre from [`Centre::to_bytes`]; `None` if the bytes are invalid or damaged.
    pub fn from_bytes(bytes: &[u8]) -> Option<Self> {
        restored(bytes)
    }

    /// Adds messages, in any order, and makes the picture at `time`. Messages with later times are kept for
    /// the next picture; those older than the last row of their track are dropped. The picture does not
    /// depend on the number of threads.
    ///
    /// # Errors
    /// A state that is not finite.
    pub fn update(
        &mut self,
        rows: &[Row],
        time: f64,
        n_threads: Option<NonZero<usize>>,
    ) -> Result<Vec<SystemTrack>> {
        let stated = &self.settings.radars;
        let Self { members, waiting, next, sources, .. } = self;
        let noise = self.registrar.largest_noise();
        take(members, waiting, &mut next[0], rows, time, (stated, &noise, sources), n_threads)?;
        let radars = paced(stated, sources);
        self.members
            .retain(|member| time - member.time <= FORGOTTEN * radars[member.sensor].scan_period);
        self.manual.forget(self.members.iter().map(|member| member.id));
        let known = Known::new(self.registrar.errors(), &self.registrar.covariance());
        let mut samples = std::mem::take(&mut self.samples.0);
        let places = self.sample(&mut samples, time, (&radars, &known), n_threads);
        let density = density(&samples);
        let candidates = self.pairs.look(&samples, &known, &self.manual, density, n_threads)?;
        let groups = grouped(&samples, &candidates, &self.order());
        let mut group_of = vec![0; samples.len()];
        for (g, group) in groups.iter().enumerate() {
            group.members.iter().for_each(|&i| group_of[i] = g);
        }
        self.pairs.remember(candidates, &group_of);
        let numbers = self.name(&groups, &places);
        let lasting = self.members.iter().map(|own| (own.sensor, own.lasting));
        let noise = raised(self.registrar.noise(), &self.settings.radars, lasting);
        let noisy = with_noise(&radars, &noise);
        let learnt =
            self.follow(&groups, &numbers, (&samples, &places), &noisy, &known, n_threads)?;
        if self.settings.registers {
            self.learn(&learnt, time, n_threads)?;
            for jump in jumps(&samples, &groups, radars.len()) {
                self.registrar.move_clock(jump.sensor, [jump.by, jump.sigma], time);
            }
        }
        let mut shown: Vec<_> = matched(self.targets.iter(), in_order(&numbers)).collect();
        shown.sort_unstable_by_key(|&(_, g)| g);
        let picture = mapped(shown.into_iter(), SHOWN_NS, n_threads, |(target, g)| {
            self.shown(&groups[g], target, (&samples, &places), &radars, time)
        });
        self.samples.0 = samples;
        picture
    }

    /// Replaces `samples` by the states at this time of all tracks that are not old, corrected for the errors
    /// of their sensors and sorted by id. Returns the places of these tracks in the list of members.
    fn sample(
        &self,
        samples: &mut Vec<Sample>,
        time: f64,
        (radars, known): (&[Radar], &Known),
        n_threads: Option<NonZero<usize>>,
    ) -> Vec<usize> {
        let mut live: Vec<_> = self
            .members
            .iter()
            .enumerate()
            .filter(|(_, member)| time - member.time <= OLD * radars[member.sensor].scan_period)
            .map(|(place, member)| (member.id, place))
            .collect();
        live.sort_unstable();
        let sample = |&(id, place): &(u64, usize)| {
            let member = &self.members[place];
            let row = member.last();
            let radar = &radars[row.sensor];
            let estimate = member.at(time, radar);
            let sensitivity = sensitivity(&estimate.mean, row.height, radar);
            let added = propagated(&sensitivity, known.block(row.sensor, row.sensor), &sensitivity);
            Sample {
                id,
                sensor: row.sensor,
                mean: corrected(&estimate.mean, &sensitivity, &known.errors[row.sensor]),
                covariance: estimate.covariance,
                whole: estimate.covariance + added,
                sensitivity,
                height: row.height,
                age: time - row.time,
                identities: row.identities,
            }
        };
        fill(samples, live.iter(), SAMPLE_NS, n_threads, sample);
        live.iter().map(|&(_, place)| place).collect()
    }

    /// Returns the indices of the sensors, the best first.
    fn order(&self) -> Vec<usize> {
        let radars = &self.settings.radars;
        let mut order: Vec<_> = (0..radars.len()).collect();
        let cell =
            |k: usize| radars[k].range_sigma * radars[k].azimuth_sigma * radars[k].scan_period;
        order.sort_by(|&a, &b| cell(a).total_cmp(&cell(b)));
        order
    }

    /// Assigns a number to each group: that of the target with the most members in common, or a new one.
    fn name(&mut self, groups: &[Group], places: &[usize]) -> Vec<u64> {
        let (mut common, mut own) = (Vec::with_capacity(groups.len()), Vec::new());
        for (g, group) in groups.iter().enumerate() {
            own.clear();
            own.extend(group.members.iter().filter_map(|&i| self.members[places[i]].target));
            own.sort_unstable();
            let counts = own.chunk_by(|a, b| a == b).map(|same| (Reverse(same.len()), same[0], g));
            common.extend(counts);
        }
        // of equal counts, the older number comes first, then the first group
        common.sort_unstable();
        let (mut numbers, mut used) = (vec![None; groups.len()], IntegerMap::default());
        for (_, number, g) in common {
            if numbers[g].is_none() && used.insert(number as i64, ()).is_none() {
                numbers[g] = Some(number);
            }
        }
        let mut found = Vec::with_capacity(groups.len());
        for (group, number) in groups.iter().zip(numbers) {
            let number = number.unwrap_or_else(|| {
                self.next[1] += 1;
                self.targets.push(Box::new(Target::new(self.next[1] - 1)));
                self.next[1] - 1
            });
            for &i in &group.members {
                self.members[places[i]].target = Some(number);
            }
            found.push(number);
        }
        let targets = self.members.iter().filter_map(|one| one.target);
        let kept: IntegerMap<()> = targets.map(|number| (number as i64, ())).collect();
        self.targets.retain(|target| kept.contains_key(&(target.number as i64)));
        found
    }

    /// Filters the plots behind the tracks. Returns, group by group and in order of time, the updates from
    /// which the errors of the sensors can be estimated.
    fn follow(
        &mut self,
        groups: &[Group],
        numbers: &[u64],
        (samples, places): (&[Sample], &[usize]),
        radars: &[Radar],
        known: &Known,
        n_threads: Option<NonZero<usize>>,
    ) -> Result<Vec<Vec<Update>>> {
        let mut targets = std::mem::take(&mut self.targets);
        let mut work = Vec::with_capacity(groups.len());
        for (target, g) in matched(targets.iter_mut(), in_order(numbers)) {
            work.push((g, &mut **target));
        }
        work.sort_unstable_by_key(|&(g, _)| g);
        let follow = |(g, target): (usize, &mut Target)| {
            let group = &groups[g];
            let best = best(group, samples);
            let start = (self.members[places[best]].last(), &samples[best]);
            let pending = group.members.iter().flat_map(|&i| &self.members[places[i]].pending);
            let mut tracklets: Vec<&Tracklet> = pending.collect();
            tracklets.sort_by(|a, b| {
                let order = a.report.time.total_cmp(&b.report.time);
                order.then(a.report.radar.cmp(&b.report.radar))
            });
            target.cycles += 1;
            target.unseen = if self.is_seen(group, samples) { 0 } else { target.unseen + 1 };
            Ok(target.follow(&tracklets, start, radars, known))
        };
        let learnt = mapped(work.into_iter(), FOLLOW_NS, n_threads, follow)?;
        self.targets = targets;
        places.iter().for_each(|&place| self.members[place].pending.clear());
        Ok(learnt)
    }

    /// Updates the estimated errors of the sensors.
    fn learn(
        &mut self,
        learnt: &[Vec<Update>],
        time: f64,
        n_threads: Option<NonZero<usize>>,
    ) -> Result<()> {
        let (added, moved) = self.registrar.learn_targets(learnt, time, n_threads)?;
        let added = added.into_iter().map(|(number, added)| (number as u64, added));
        for (target, added) in matched(self.targets.iter_mut(), added) {
            target.added = nalgebra::SMatrix::from_row_slice(&added);
        }
        let moved = moved.into_iter().map(|(number, at, by)| (number as u64, (at, by)));
        for (target, (at, by)) in matched(self.targets.iter_mut(), moved) {
            if let Some(follower) = &mut target.follower {
                follower.shift(at, by);
            }
        }
        Ok(())
    }

    /// Returns the positions behind the tracks of a group.
    fn positions(&self, group: &Group, places: &[usize], radars: &[Radar]) -> Vec<Positions> {
        let members = group.members.iter().map(|&i| &self.members[places[i]]);
        members.map(|own| own.positions(&radars[own.sensor])).collect()
    }

    /// Whether several sensors see a target, or no other sensor should see it.
    fn is_seen(&self, group: &Group, samples: &[Sample]) -> bool {
        let [only] = group.members[..] else { return true };
        let sample = &samples[only];
        !self.settings.radars.iter().enumerate().any(|(k, radar)| {
            let [x, y] = [0, 1].map(|axis| sample.mean[axis] - radar.position[axis]);
            k != sample.sensor
                && x.hypot(y) < radar.max_range
                && radar.max_range.is_finite()
                && radar.detection_probability > CERTAIN
        })
    }

    /// Returns the row of a target in the picture.
    fn shown(
        &self,
        group: &Group,
        target: &Target,
        (samples, places): (&[Sample], &[usize]),
        radars: &[Radar],
        time: f64,
    ) -> Result<SystemTrack> {
        let estimate = match self.settings.rule {
            Rule::Tracklets => target.at(time, &self.positions(group, places, radars)),
            _ => None,
        };
        let estimate = match estimate {
            Some(estimate) => estimate,
            None => {
                let parts: Vec<_> = group
                    .members
                    .iter()
                    .map(|&i| (i, &self.members[places[i]]))
                    .map(|(i, member)| Part {
                        sensor: samples[i].sensor,
                        estimate: crate::tracker::Estimate {
                            mean: samples[i].mean,
                            covariance: samples[i].whole,
                        },
                        correction: member.correction(),
                    })
                    .collect();
                let settings = &self.settings;
                settings.rule.fuse(&parts, &settings.radars, settings.cross_correlation)?
            }
        };
        let n = group.members.len();
        let pvalue = if n > 1 {
            chi_square_upper(2.0 / n as f64 * group.squared, 4 * (n - 1))
        } else {
            f64::NAN
        };
        let mut members = vec![None; self.settings.radars.len()];
        let (mut height, mut newest) = (f64::NAN, f64::NEG_INFINITY);
        let mut heard = Vec::new();
        for &i in &group.members {
            let row = self.members[places[i]].last();
            members[row.sensor] = Some(row.track);
            if row.height.is_finite() && row.time > newest {
                (height, newest) = (row.height, row.time);
            }
            heard.push((row.time, row.identities));
        }
        heard.sort_by(|a, b| b.0.total_cmp(&a.0));
        let identities = heard.iter().fold(Identities::NONE, |known, (_, own)| known.or(own));
        Ok(SystemTrack {
            number: target.number,
            state: estimate.mean.into(),
            // filters leave an asymmetry of rounding
            covariance: std::array::from_fn(|i| {
                estimate.covariance[((i / 4).min(i % 4), (i / 4).max(i % 4))]
            }),
            members,
            pvalue,
            confirmed: target.cycles >= CONFIRMED,
            doubtful: target.unseen >= UNSEEN,
            height,
            identities,
        })
    }

    /// Joins the tracks of two targets, or keeps them separate, until they are released. Returns false if
    /// one of the targets does not exist, or if targets to be joined both have a track of the same sensor.
    pub fn decide(&mut self, a: u64, b: u64, joined: bool) -> bool {
        let ids = |number: u64| -> Vec<(usize, u64)> {
            let own = self.members.iter().filter(|member| member.target == Some(number));
            own.map(|member| (member.sensor, member.id)).collect()
        };
        let (first, second) = (ids(a), ids(b));
        let clash = first.iter().any(|one| second.iter().any(|other| one.0 == other.0));
        if a == b || first.is_empty() || second.is_empty() || (joined && clash) {
            return false;
        }
        for pair in first.iter().flat_map(|one| second.iter().map(|other| key(one.1, other.1))) {
            let (own, other) = if joined {
                (&mut self.manual.joined, &mut self.manual.separate)
            } else {
                (&mut self.manual.separate, &mut self.manual.joined)
            };
            own.insert(pair);
            other.remove(&pair);
        }
        true
    }

    /// Withdraws the decisions on the tracks of a target; false if the target does not exist.
    pub fn release(&mut self, number: u64) -> bool {
        let ids: BTreeSet<u64> = self
            .members
            .iter()
            .filter(|member| member.target == Some(number))
            .map(|member| member.id)
            .collect();
        let kept = |pair: &(u64, u64)| !ids.contains(&pair.0) && !ids.contains(&pair.1);
        self.manual.joined.retain(kept);
        self.manual.separate.retain(kept);
        !ids.is_empty()
    }
}

/// Returns the numbers of targets in ascending order, with the indices of their groups.
fn in_order(numbers: &[u64]) -> impl Iterator<Item = (u64, usize)> {
    let mut order: Vec<_> = numbers.iter().copied().zip(0..).collect();
    order.sort_unstable();
    order.into_iter()
}

/// Joins targets with the values known for their numbers. Both inputs are sorted by number.
fn matched<O: Deref<Target = Box<Target>>, T>(
    targets: impl Iterator<Item = O>,
    known: impl Iterator<Item = (u64, T)>,
) -> impl Iterator<Item = (O, T)> {
    let mut known = known.peekable();
    targets.filter_map(move |target| {
        while known.next_if(|(number, _)| *number < target.number).is_some() {}
        let (_, own) = known.next_if(|(number, _)| *number == target.number)?;
        Some((target, own))
    })
}

/// Index of the track of a group with the smallest position variance.
fn best(group: &Group, samples: &[Sample]) -> usize {
    let trace = |i: usize| samples[i].covariance[(0, 0)] + samples[i].covariance[(1, 1)];
    let first = group.members[0];
    group.members.iter().copied().fold(first, |a, b| if trace(b) < trace(a) { b } else { a })
}
