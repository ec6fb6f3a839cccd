//! The tracks of the sensors, updated row by row.

use super::analysis::Analysis;
use super::family::Evidence;
use super::lasting::Positions;
use super::row::Row;
use super::share::mapped;
use super::source::{Source, paced, with_noise};
use super::target::Tracklet;
use crate::base::error::Result;
use crate::sensors::Radar;
use crate::tracker::Estimate;
use serde::{Deserialize, Serialize};
use std::num::NonZero;

/// Number of scans without a row after which a track is deleted.
pub(super) const FORGOTTEN: f64 = 6.0;
/// Time to process a row, ns.
const ROW_NS: f64 = 2000.0;

/// A track of a sensor. Each cycle reads these values of all tracks several times; what is only needed to add a
/// row or to extrapolate the track is behind a pointer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Member {
    pub id: u64,
    pub sensor: usize,
    track: i64,
    /// Time of the last row.
    pub time: f64,
    pub target: Option<u64>,
    /// Share of the variance of its positions that lasts.
    pub lasting: f64,
    pub pending: Vec<Tracklet>,
    analysis: Box<Analysis>,
}

/// Adds rows to their tracks in order of time; `next` is the id of the next new track. Rows after `time`
/// go to `waiting`, and rows that were waiting are added. `noise` is the largest known noise of plots. Cost
/// O(N log N) for N rows plus O(M) for M tracks.
pub(super) fn take(
    members: &mut Vec<Member>,
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
    let all = in_order(all);
    let (known, mut at, mut begun) = (members.len(), 0, None);
    // rows of existing tracks, grouped by track
    let mut added: Vec<(usize, &Row)> = Vec::with_capacity(all.len());
    for row in all {
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
            members.push(Member::new(*next, *row, radar));
            *next += 1;
            begun = Some(place);
            continue;
        }
        let newest = added.last().filter(|(member, _)| *member == own);
        let newest = newest.map_or(members[own].time, |(_, row)| row.time);
        if row.time - newest > FORGOTTEN * radar.scan_period {
            // the sensor has used the number again for a new track
            while added.pop_if(|(member, _)| *member == own).is_some() {}
            members[own] = Member::new(*next, *row, radar);
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
            work.push((member, own));
        }
    }
    let evidence: Vec<_> = sources.iter().map(|source| source.evidence).collect();
    let found = mapped(work.into_iter(), ROW_NS, n_threads, |(member, rows)| {
        for (_, row) in rows {
            let radar = (&radars[row.sensor], &noisy[row.sensor]);
            member.add(**row, &evidence[row.sensor], radar);
        }
        Ok(member.analysis.found().map(|found| (member.sensor, found)))
    })?;
    for (sensor, found) in found.into_iter().flatten() {
        sources[sensor].evidence.add(&found);
    }
    if begun.is_some() {
        // the list consists of two sorted runs
        members.sort_by_key(|member| member.place());
    }
    Ok(())
}

/// Sorts rows by sensor, track and time; equal ones stay in their order. Sensor, track and place of a row are one
/// number each, because their comparisons are several times as fast as those of rows. Cost O(N log N).
fn in_order(rows: Vec<&Row>) -> Vec<&Row> {
    const PLACE: u32 = u32::BITS;
    let key = |(row, i): (&&Row, u32)| {
        let track = row.track as u64 ^ (1 << (u64::BITS - 1));
        ((row.sensor as u128) << u64::BITS | u128::from(track)) << PLACE | u128::from(i)
    };
    let mut keys: Vec<_> = rows.iter().zip(0..).map(key).collect();
    keys.sort_unstable();
    let mut sorted: Vec<_> = keys.iter().map(|&key| rows[key as u32 as usize]).collect();
    let mut rest = &mut sorted[..];
    for same in keys.chunk_by(|a, b| a >> PLACE == b >> PLACE) {
        let own = rest.split_off_mut(..same.len()).expect("as many as keys");
        own.sort_by(|a, b| a.time.total_cmp(&b.time));
    }
    sorted
}

impl Member {
    fn new(id: u64, row: Row, radar: &Radar) -> Self {
        let (analysis, first) = Analysis::new(row, radar);
        let Row { sensor, track, time, .. } = row;
        let (lasting, pending) = (analysis.lasting(), first.into_iter().collect());
        Self {
            id,
            sensor,
            track,
            time,
            target: None,
            lasting,
            pending,
            analysis: Box::new(analysis),
        }
    }

    /// Sensor and track number, by which members are sorted.
    fn place(&self) -> (usize, i64) {
        (self.sensor, self.track)
    }

    /// Adds a row, and the plot behind it. `radar` has the stated noise of plots, `noisy` the largest known.
    fn add(&mut self, row: Row, evidence: &Evidence, radars: (&Radar, &Radar)) {
        self.pending.extend(self.analysis.add(row, evidence, radars));
        (self.time, self.lasting) = (row.time, self.analysis.lasting());
    }

    /// The last row.
    pub fn last(&self) -> &Row {
        &self.analysis.last
    }

    /// By how much the last row corrected the state; zero for the first row.
    pub fn correction(&self) -> [f64; 4] {
        self.analysis.correction()
    }

    /// Returns position and velocity of the track at a time.
    pub fn at(&self, time: f64, radar: &Radar) -> Estimate<4> {
        self.analysis.at(time, radar)
    }

    /// Returns the positions behind the track.
    pub fn positions(&self, radar: &Radar) -> Positions {
        let last = self.last();
        let [x, y, ..] = last.state;
        Positions {
            lasting: self.lasting,
            noise: radar.noise_at([x, y], last.above(radar)),
            period: radar.scan_period,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensors::Identities;

    #[test]
    fn rows_are_sorted_by_sensor_track_and_time() {
        let row = |sensor, track, time| Row {
            sensor,
            track,
            time,
            state: [0.0; 4],
            covariance: [f64::NAN; 16],
            height: f64::NAN,
            identities: Identities::NONE,
            turn_probability: f64::NAN,
        };
        let rows = [
            row(1, 5, 2.0),
            row(0, i64::MAX, 1.0),
            row(1, -7, 3.0),
            row(1, 5, -1.0),
            row(0, i64::MIN, 4.0),
            row(1, 5, 2.0),
        ];
        let sorted = in_order(rows.iter().collect());
        let place = |row: &Row| rows.iter().position(|own| std::ptr::eq(own, row));
        let places: Vec<_> = sorted.into_iter().filter_map(place).collect();
        assert_eq!(places, [4, 1, 2, 3, 0, 5]);
    }
}
