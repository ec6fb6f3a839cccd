//! The tracks of single radars at common instants.

use super::row::{Row, Table, fresh};
use nalgebra::{Matrix4, Vector4};
use std::collections::BTreeMap;

/// A track says something for so many scan periods after its last plot: one may be missed.
const AGE: f64 = 2.5;
/// Instants of targets at most.
const INSTANTS: f64 = 20_000.0;

/// M instants of targets of which two of K radars or more have a track. Arrays row by row: states
/// (M, K, 4) and covariances (M, K, 4, 4), nan where a radar has no track.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Common {
    /// Seconds.
    pub time: Vec<f64>,
    /// Number of the joint track.
    pub track: Vec<i64>,
    /// East, north, and their rates.
    pub state: Vec<[f64; 4]>,
    /// Of the states.
    pub covariance: Vec<[f64; 16]>,
    /// States of the joint track, (M, 4).
    pub joint_state: Vec<[f64; 4]>,
    /// Their covariances, (M, 4, 4).
    pub joint_covariance: Vec<[f64; 16]>,
}

/// The states of the tracks of all radars together, and of those of single radars, at instants of the
/// slowest scan period; at longer intervals where there would be more than 20,000. A track of a radar
/// belongs to the joint track that has most of its plots, more than half.
pub fn common(joint: &Table, single: &[Table], scan_periods: &[f64]) -> Common {
    let mut found = Common::default();
    let slowest = scan_periods.iter().copied().fold(0.0, f64::max);
    let tracks: Vec<_> = single
        .iter()
        .map(|table| {
            let partners = partners(table, joint);
            table.by_target(|track| partners.get(&track).copied())
        })
        .collect();
    let targets: Vec<(i64, Vec<&Row>)> = joint
        .by_target(Some)
        .into_iter()
        .map(|(track, rows)| (track, fresh(rows, AGE * slowest)))
        .filter(|(_, rows)| !rows.is_empty())
        .collect();
    let duration: f64 =
        targets.iter().map(|(_, rows)| (rows[rows.len() - 1].time - rows[0].time) / slowest).sum();
    let step = slowest * (duration / INSTANTS).max(1.0);
    for (track, rows) in &targets {
        let own: Vec<Vec<&Row>> = tracks
            .iter()
            .zip(scan_periods)
            .map(|(rows, period)| fresh(rows.get(track).cloned().unwrap_or_default(), AGE * period))
            .collect();
        let first = (rows[0].time / step).ceil();
        let count = (rows[rows.len() - 1].time / step).floor() + 1.0 - first;
        for i in 0..count.max(0.0) as usize {
            let time = (first + i as f64) * step;
            let Some(joint) = state_at(rows, time, AGE * slowest) else { continue };
            let states: Vec<_> = own
                .iter()
                .zip(scan_periods)
                .map(|(rows, period)| state_at(rows, time, AGE * period))
                .collect();
            if states.iter().flatten().count() > 1 {
                found.push(time, *track, joint, &states);
            }
        }
    }
    found
}

impl Common {
    fn push(
        &mut self,
        time: f64,
        track: i64,
        joint: (Vector4<f64>, Matrix4<f64>),
        states: &[Option<(Vector4<f64>, Matrix4<f64>)>],
    ) {
        // symmetric: columns are rows
        let write = |(mean, covariance): (Vector4<f64>, Matrix4<f64>)| {
            let mut rows = [0.0; 16];
            rows.copy_from_slice(covariance.as_slice());
            (mean.into(), rows)
        };
        self.time.push(time);
        self.track.push(track);
        for state in states {
            let (mean, covariance) = state.map_or(([f64::NAN; 4], [f64::NAN; 16]), write);
            self.state.push(mean);
            self.covariance.push(covariance);
        }
        let (mean, covariance) = write(joint);
        self.joint_state.push(mean);
        self.joint_covariance.push(covariance);
    }
}

/// The joint track to which each track of one radar belongs, where there is one.
fn partners(table: &Table, joint: &Table) -> BTreeMap<i64, i64> {
    let mut votes: BTreeMap<i64, BTreeMap<i64, usize>> = BTreeMap::new();
    for row in &table.rows {
        if let Some(plot) = row.plot {
            let counts = votes.entry(row.track).or_default();
            *counts.entry(joint.track_of_plot[plot]).or_default() += 1;
        }
    }
    let belongs = |(track, counts): (i64, BTreeMap<i64, usize>)| {
        let total: usize = counts.values().sum();
        let most = counts.into_iter().find(|(joint, count)| *joint >= 0 && 2 * count > total);
        most.map(|(joint, _)| (track, joint))
    };
    votes.into_iter().filter_map(belongs).collect()
}

/// State and covariance at a time, straight on from the last row before; none where that is too old.
fn state_at(rows: &[&Row], time: f64, age: f64) -> Option<(Vector4<f64>, Matrix4<f64>)> {
    let last = rows.partition_point(|row| row.time <= time).checked_sub(1)?;
    let ahead = time - rows[last].time;
    (ahead <= age).then(|| rows[last].extrapolated(ahead))
}
