//! Rows of tracks, and their extrapolation over some seconds.

use nalgebra::{Matrix4, Vector4};
use std::collections::BTreeMap;

/// Acceleration of a target since its last plot, in straight flight and in a turn, m/s².
const STRAIGHT: f64 = 0.1;
const TURN: f64 = 3.0;

/// A row of a table of tracks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// Seconds.
    pub time: f64,
    /// Number of the track.
    pub track: i64,
    /// The plot that has updated the track.
    pub plot: Option<usize>,
    /// Whether the track is confirmed.
    pub confirmed: bool,
    /// East, north, and their rates.
    pub state: [f64; 4],
    /// Covariance of the state, row by row.
    pub covariance: [f64; 16],
    /// Probability that the target turns.
    pub turn_probability: f64,
}

/// Tracks, and the track that each plot has updated, negative if there is none.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// The rows, in any order.
    pub rows: Vec<Row>,
    /// Number of the track of each plot.
    pub track_of_plot: Vec<i64>,
}

impl Row {
    /// Returns state and covariance after some seconds of straight motion with the usual acceleration.
    pub(super) fn extrapolated(&self, ahead: f64) -> (Vector4<f64>, Matrix4<f64>) {
        let mut f = Matrix4::identity();
        f[(0, 2)] = ahead;
        f[(1, 3)] = ahead;
        let p = Matrix4::from_row_slice(&self.covariance);
        let turning = self.turn_probability;
        let variance = (1.0 - turning) * (STRAIGHT * STRAIGHT) + turning * (TURN * TURN);
        let push = [0.5 * ahead * ahead, ahead];
        let mut moved = f * p * f.transpose();
        for axis in 0..2 {
            for (i, a) in push.into_iter().enumerate() {
                for (j, b) in push.into_iter().enumerate() {
                    moved[(2 * i + axis, 2 * j + axis)] += variance * a * b;
                }
            }
        }
        (f * Vector4::from(self.state), 0.5 * (moved + moved.transpose()))
    }
}

impl Table {
    /// Returns the confirmed rows of each target; `target` maps tracks to targets.
    pub(super) fn by_target(
        &self,
        target: impl Fn(i64) -> Option<i64>,
    ) -> BTreeMap<i64, Vec<&Row>> {
        let mut found: BTreeMap<i64, Vec<&Row>> = BTreeMap::new();
        for row in self.rows.iter().filter(|row| row.confirmed) {
            if let Some(target) = target(row.track) {
                found.entry(target).or_default().push(row);
            }
        }
        found
    }
}

/// Returns the rows in order of time, without those more than `age` after the last plot.
pub(super) fn fresh(mut rows: Vec<&Row>, age: f64) -> Vec<&Row> {
    rows.sort_by(|a, b| a.time.total_cmp(&b.time));
    let mut last = f64::NEG_INFINITY;
    rows.retain(|row| {
        if row.plot.is_some() {
            last = last.max(row.time);
        }
        row.time - last <= age
    });
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_goes_straight_on() {
        let mut covariance = [0.0; 16];
        for (i, variance) in [100.0, 100.0, 4.0, 4.0].into_iter().enumerate() {
            covariance[5 * i] = variance;
        }
        let state = [1e3, 2e3, 200.0, -100.0];
        let (time, track, plot, confirmed, turn_probability) = (0.0, 1, Some(0), true, 0.0);
        let row = Row { time, track, plot, confirmed, state, covariance, turn_probability };
        let (moved, p) = row.extrapolated(10.0);
        assert_eq!(moved, Vector4::new(3e3, 1e3, 200.0, -100.0));
        assert!((p[(0, 0)] - (100.0 + 400.0 + 0.01 * 2500.0)).abs() < 1e-9);
        assert_eq!(p, p.transpose());
    }
}
