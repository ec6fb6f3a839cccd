//! The tracks of the sensors, updated row by row.

use super::family::{Evidence, Families};
use super::filtered::Filtered;
use super::gain::Gain;
use super::lasting::Positions;
use super::row::Row;
use super::shadow::Shadow;
use super::share::mapped;
use super::source::{Source, paced, with_noise};
use super::stated::Covariances;
use super::target::Tracklet;
use super::tracklet::{Behind, Past, behind, coasts, is_doubtful};
use crate::base::error::Result;
use crate::base::plane::Plane;
use crate::sensors::Radar;
use crate::tracker::Estimate;
use serde::{Deserialize, Serialize};
use std::num::NonZero;

/// Number of scans without a row after which a track is deleted.
pub(super) const FORGOTTEN: f64 = 6.0;
/// `MEMORY` is the weight of the newest row in the running share of rows that Tertia's filter cannot have
/// made, `UNKNOWN` the initial share; from `FOREIGN` on, the track counts as made by another filter. A
/// single turn may seem to be made by one.
const MEMORY: f64 = 0.05;
const UNKNOWN: f64 = 0.6;
const FOREIGN: f64 = 0.7;
/// Time to process a row, ns.
const ROW_NS: f64 = 2000.0;

/// A track of a sensor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Member {
    pub id: u64,
    pub last: Row,
    is_doubtful: bool,
    pub before: [Option<Past>; 2],
    pub pending: Vec<Tracklet>,
    /// Tertia's filter, which may have made the track.
    shadow: Shadow,
    /// If another filter made it: its gain, and the track that Tertia's models make of the plots behind
    /// its rows.
    gain: Gain,
    filtered: Option<Filtered>,
    families: Option<Box<Families>>,
    covariances: Option<Box<Covariances>>,
    foreign: f64,
    /// Whether the sensor states the covariances of its filter.
    is_stated: bool,
    /// Whether there have been rows without a plot.
    is_periodic: bool,
    /// Time of the last plot.
    plotted: f64,
    pub target: Option<u64>,
}

/// Adds rows to their tracks in order of time; `next` is the id of the next new track. Rows after `time`
/// go to `waiting`, and rows that were waiting are added. `noise` is the largest known noise of plots. Cost
/// O(N log N) for N rows plus O(M) for M tracks.
#[expect(clippy::vec_box, reason = "they are a kilobyte each, and change their places")]
pub(super) fn take(
    members: &mut Vec<Box<Member>>,
    waiting: &mut Vec<Row>,
    next: &mut u64,
    rows: &[Row],
    time: f64,
    (radars, noise, sources): (&[Radar], &[[f64; 2]], &mut [Source]),
    n_threads: Option<NonZero<usize>>,
) -> Result<()> {
    let stated = radars;
    let radars = &paced(radars, sources);
    let noisy = &with_noise(radars, noise);
    let waited = std::mem::take(waiting);
    let all: Vec<&Row> = waited.iter().chain(rows).collect();
    let mut order: Vec<_> =
        all.iter().zip(0..).map(|(row, i)| (row.sensor, row.track, row.time, i)).collect();
    order.sort_unstable_by(|a: &(_, _, _, u32), b| {
        (a.0, a.1).cmp(&(b.0, b.1)).then(a.2.total_cmp(&b.2)).then(a.3.cmp(&b.3))
    });
    let (known, mut at, mut begun) = (members.len(), 0, None);
    // rows of existing tracks, grouped by track
    let mut added: Vec<(usize, &Row)> = Vec::with_capacity(order.len());
    for (.., i) in order {
        let row = all[i as usize];
        if row.time > time {
            waiting.push(*row);
            continue;
        }
        let place = (row.sensor, row.track);
        while at < known && members[at].place() < place {
            at += 1;
        }
        let own = if begun == Some(place) { members.len() - 1 } else { at };
        let radar = &radars[row.sensor];
        let is_known = begun == Some(place) || (at < known && members[at].place() == place);
        if !is_known {
            members.push(Box::new(Member::new(*next, *row, radar)));
            *next += 1;
            begun = Some(place);
            continue;
        }
        let newest = added.last().filter(|(member, _)| *member == own);
        let newest = newest.map_or(members[own].last.time, |(_, row)| row.time);
        if row.time - newest > FORGOTTEN * radar.scan_period {
            // the sensor has used the number again for a new track
            while added.pop_if(|(member, _)| *member == own).is_some() {}
            *members[own] = Member::new(*next, *row, radar);
            *next += 1;
        } else if row.time > newest {
            let period = stated[row.sensor].scan_period;
            sources[row.sensor].see((row.time - newest) / period);
            added.push((own, row));
        }
    }
    added.sort_by_key(|&(own, _)| own);
    let mut rows = added.chunk_by(|a, b| a.0 == b.0).peekable();
    let mut work: Vec<(&mut Member, &[(usize, &Row)])> = Vec::new();
    for (i, member) in members.iter_mut().enumerate() {
        if let Some(own) = rows.next_if(|own| own[0].0 == i) {
            work.push((&mut **member, own));
        }
    }
    let evidence: Vec<_> = sources.iter().map(|source| source.evidence).collect();
    mapped(work.into_iter(), ROW_NS, n_threads, |(member, rows)| {
        for (_, row) in rows {
            let radar = (&radars[row.sensor], &noisy[row.sensor]);
            member.add(**row, &evidence[row.sensor], radar);
        }
        Ok(())
    })?;
    for member in members.iter_mut() {
        if let Some(families) = &mut member.families {
            sources[member.last.sensor].evidence.add(&std::mem::take(&mut families.found));
        }
        if let Some(covariances) = &mut member.covariances {
            let all = &mut sources[member.last.sensor].evidence.covariances;
            all.add(&std::mem::take(&mut covariances.found));
        }
    }
    if begun.is_some() {
        // the list consists of two sorted runs
        members.sort_by_key(|member| member.place());
    }
    Ok(())
}

impl Member {
    fn new(id: u64, row: Row, radar: &Radar) -> Self {
        let shadow = Shadow::new(&row, radar);
        let mut member = Self {
            id,
            last: row,
            is_doubtful: is_doubtful(&row, radar),
            before: [None; 2],
            pending: Vec::new(),
            shadow,
            gain: Gain::default(),
            filtered: None,
            families: None,
            covariances: Some(Box::new(Covariances::new(&row))),
            foreign: UNKNOWN,
            is_stated: false,
            is_periodic: false,
            plotted: row.time,
            target: None,
        };
        member.look_behind(None, None, &Evidence::default(), (radar, radar));
        member
    }

    /// Sensor and track number, by which members are sorted.
    fn place(&self) -> (usize, i64) {
        (self.last.sensor, self.last.track)
    }

    /// Adds a row, and the plot behind it. `radar` has the stated noise of plots, `noisy` the largest known.
    fn add(&mut self, row: Row, evidence: &Evidence, (radar, noisy): (&Radar, &Radar)) {
        let past = Past::new(&self.last, self.is_doubtful, self.plotted);
        self.before = [Some(past), self.before[0]];
        self.last = row;
        self.is_doubtful = !self.is_foreign() && is_doubtful(&row, radar);
        if coasts(&row, &past, radar) {
            self.is_periodic = true;
            return;
        }
        // in doubt the filter is not updated; nor is the sensor's filter if the plot did not belong to
        // the target
        let plot = if self.is_doubtful { None } else { self.shadow.follow(&row, radar) };
        let is_same = self.shadow.is_same && !self.is_doubtful;
        let is_unlike = if is_same { 0.0 } else { 1.0 };
        self.foreign += MEMORY * (is_unlike - self.foreign);
        let mut innovation = None;
        if self.foreign < UNKNOWN {
            self.covariances = None;
        } else if let Some(covariances) = &mut self.covariances {
            innovation = covariances.innovation(&row, past.correction(&row), radar);
        } else {
            self.covariances = Some(Box::new(Covariances::new(&row)));
        }
        self.is_stated =
            innovation.is_some() && evidence.covariances.is_sure() && !self.is_periodic;
        let innovation = innovation.filter(|_| self.is_stated);
        self.look_behind(plot.filter(|_| !self.is_foreign()), innovation, evidence, (radar, noisy));
        self.plotted = row.time;
    }

    /// Whether a filter other than Tertia's made the track.
    fn is_foreign(&self) -> bool {
        self.foreign > FOREIGN
    }

    /// Stores what is known of the plot behind the last row: `plot`, or an estimate without knowledge of
    /// the filter.
    fn look_behind(
        &mut self,
        plot: Option<[f64; 2]>,
        innovation: Option<[f64; 2]>,
        evidence: &Evidence,
        (radar, noisy): (&Radar, &Radar),
    ) {
        let last = (&self.last, self.is_doubtful);
        if !self.is_foreign() || evidence.is_complete() {
            self.families = None;
        } else if self.families.is_none() {
            self.families = Some(Box::new(Families::new(&self.last, radar)));
        }
        let gain = (&mut self.gain, evidence, self.is_periodic);
        let families = self.families.as_deref_mut();
        let (place, own, added) =
            match behind(plot, innovation, last, &self.before, gain, families, (radar, noisy)) {
                Behind::Plot(place, added) => (place, None, added),
                Behind::State(place, covariance) => (place, Some(covariance), Plane::default()),
                Behind::Nothing => return,
            };
        if plot.is_some() {
            self.filtered = None;
        } else if let Some(filtered) = &mut self.filtered {
            let noise = own.unwrap_or_else(|| noisy.noise_at(place, self.last.above(noisy)));
            filtered.follow(self.last.time, place, noise.plus(added), radar);
        } else {
            self.filtered = Some(Filtered::new(&self.last, radar));
        }
        self.pending.push(Tracklet::new(&self.last, place, (own, added), radar));
    }

    /// Returns position and velocity of the track at a time.
    pub fn at(&self, time: f64, radar: &Radar) -> Estimate<4> {
        self.foreign_filter().map_or_else(|| self.last.at(time, radar), |own| own.at(time))
    }

    /// Share of the variance of its positions that lasts.
    pub fn lasting(&self) -> f64 {
        self.foreign_filter().map_or(0.0, Filtered::lasting)
    }

    /// Returns the positions behind the track.
    pub fn positions(&self, radar: &Radar) -> Positions {
        let [x, y, ..] = self.last.state;
        Positions {
            lasting: self.lasting(),
            noise: radar.noise_at([x, y], self.last.above(radar)),
            period: radar.scan_period,
        }
    }

    /// Returns Tertia's filter of the track if another filter made it.
    fn foreign_filter(&self) -> Option<&Filtered> {
        self.filtered.as_ref().filter(|_| self.is_stated || self.is_foreign())
    }
}
