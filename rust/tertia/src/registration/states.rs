//! Tracks of single radars at common instants.

use super::row::{Row, Table, fresh};
use nalgebra::{Matrix4, Vector4};
use std::collections::BTreeMap;

/// Number of scan periods after its last plot for which a track is used: one plot may be missed.
const AGE: f64 = 2.5;
/// Largest number of instants, summed over targets.
const INSTANTS: f64 = 20_000.0;

/// M instants of targets of which at least two of K radars have a track. Arrays are row by row: states
/// (M, K, 4) and covariances (M, K, 4, 4), nan for a radar without a track.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct States {
    /// Seconds.
    pub time: Vec<f64>,
    /// Number of the joint track.
    pub track: Vec<i64>,
    /// East, north, and their rates.
    pub state: Vec<[f64; 4]>,
    /// Covariances of the states.
    pub covariance: Vec<[f64; 16]>,
    /// States of the joint track, (M, 4).
    pub joint_state: Vec<[f64; 4]>,
    /// Covariances of these states, (M, 4, 4).
    pub joint_covariance: Vec<[f64; 16]>,
}

/// Returns the states of the joint tracks of all radars and of the tracks of single radars, at intervals of
/// the slowest scan period, or longer ones if there would be more than 20,000 instants. A track of a radar
/// belongs to the joint track that has more than half of its plots.
pub fn common_states(joint: &Table, single: &[Table], scan_periods: &[f64]) -> States {
    let mut found = States::default();
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

impl States {
    fn push(
        &mut self,
        time: f64,
        track: i64,
        joint: (Vector4<f64>, Matrix4<f64>),
        states: &[Option<(Vector4<f64>, Matrix4<f64>)>],
    ) {
        // the matrix is symmetric: its columns are its rows
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

/// Returns the joint track to which each track of one radar belongs, if there is one.
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

/// Returns state and covariance at a time, extrapolated from the last row before; none if that is too old.
fn state_at(rows: &[&Row], time: f64, age: f64) -> Option<(Vector4<f64>, Matrix4<f64>)> {
    let last = rows.partition_point(|row| row.time <= time).checked_sub(1)?;
    let ahead = time - rows[last].time;
    (ahead <= age).then(|| rows[last].extrapolated(ahead))
}
