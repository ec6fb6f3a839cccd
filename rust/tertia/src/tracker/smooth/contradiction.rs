//! Sensors that see a target in different places for several plots.
//!
//! The path follows the sensors with the smaller errors, or with more plots, and the plots of the other one are
//! left out. Nothing shows which of them is wrong: the covariance contains the square of the difference, so that
//! the region includes the places of both.

use super::flight::{SmoothedRow, TrackPlot};
use crate::base::plane::Plane;

/// A plot contradicts if it and these numbers of plots before and after it of the same sensor contain `MOST`
/// outliers: single ones do not.
const BESIDE: usize = 2;
const MOST: usize = 3;

/// Difference of a sensor from the path, in position and velocity.
#[derive(Clone, Copy)]
struct Difference {
    time: f64,
    value: [f64; 4],
    /// Covariance of the position, and the variance of the velocity relative to it.
    covariance: Plane,
    rate_variance: f64,
}

/// Adds to the covariances the squares of the differences of sensors whose plots were left out. Rows are in the
/// order of time. Cost O(rows) for each such sensor.
pub(super) fn add_contradictions(plots: &[TrackPlot], rows: &mut [SmoothedRow]) {
    let is_left_out = |row: &SmoothedRow| row.plot.filter(|_| row.outlier);
    let mut sensors: Vec<usize> =
        rows.iter().filter_map(is_left_out).map(|plot| plots[plot].sensor).collect();
    sensors.sort_unstable();
    sensors.dedup();
    for sensor in sensors {
        let is_own = |row: &&SmoothedRow| row.plot.is_some_and(|plot| plots[plot].sensor == sensor);
        let own = rows.iter().filter(is_own).filter(|row| row.innovation[0].is_finite());
        let own: Vec<SmoothedRow> = own.copied().collect();
        let differences: Vec<Option<Difference>> =
            (0..own.len()).map(|k| difference(&own, k)).collect();
        for pair in differences.windows(2) {
            if let [Some(from), Some(to)] = pair {
                add(from, to, rows);
            }
        }
        // nothing shows that the sensors agree before the first plot or after the last one
        if let Some(Some(first)) = differences.first() {
            add(&first.at(f64::NEG_INFINITY), first, rows);
        }
        if let Some(Some(last)) = differences.last() {
            add(last, &last.at(f64::INFINITY), rows);
        }
    }
}

impl Difference {
    /// The same difference at another time.
    fn at(&self, time: f64) -> Self {
        Self { time, ..*self }
    }
}

/// Returns the difference at a plot, by a line through those beside it; none if most of them are not outliers.
fn difference(own: &[SmoothedRow], k: usize) -> Option<Difference> {
    let beside = &own[k.saturating_sub(BESIDE)..(k + BESIDE + 1).min(own.len())];
    if beside.iter().filter(|row| row.outlier).count() < MOST {
        return None;
    }
    let count = beside.len() as f64;
    let mean = |of: &dyn Fn(&SmoothedRow) -> f64| beside.iter().map(of).sum::<f64>() / count;
    let middle = mean(&|row| row.time);
    let spread = mean(&|row| (row.time - middle).powi(2));
    let per_spread = if spread > 0.0 { 1.0 / spread } else { 0.0 };
    let time = own[k].time;
    let mut value = [0.0; 4];
    for i in 0..2 {
        let rate = mean(&|row| (row.time - middle) * row.innovation[i]) * per_spread;
        value[i] = mean(&|row| row.innovation[i]) + rate * (time - middle);
        value[i + 2] = rate;
    }
    let covariance = own[k].innovation_covariance.scaled(1.0 / count);
    Some(Difference { time, value, covariance, rate_variance: per_spread })
}

/// Adds the square of the difference, linear between two plots, and its covariance to the rows from the first
/// plot to before the second.
fn add(from: &Difference, to: &Difference, rows: &mut [SmoothedRow]) {
    let begin = rows.partition_point(|row| row.time < from.time);
    let end = rows.partition_point(|row| row.time < to.time);
    let Plane { xx, xy, yy } = from.covariance;
    for row in &mut rows[begin..end] {
        let step = to.time - from.time;
        let share = if step.is_finite() { (row.time - from.time) / step } else { 0.0 };
        let at: [f64; 4] =
            std::array::from_fn(|i| from.value[i] + share * (to.value[i] - from.value[i]));
        for (i, j) in (0..16).map(|place| (place / 4, place % 4)) {
            row.covariance[i][j] += at[i] * at[j];
        }
        for (i, j, own) in [(0, 0, xx), (0, 1, xy), (1, 0, xy), (1, 1, yy)] {
            row.covariance[i][j] += own;
            row.covariance[i + 2][j + 2] += from.rate_variance * own;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::flight::smooth;
    use super::super::{Movement, Times};
    use super::*;
    use crate::tracker::motion::{ImmModel, Motion};

    /// Plots each second of a precise sensor that drifts away from 20 s on, and every 4 s of another one.
    fn drifting() -> Vec<TrackPlot> {
        let plot = |t: f64, sensor: usize, drift: f64, sigma: f64| TrackPlot {
            time: t,
            sensor,
            position: [200.0 * t, drift * (t - 20.0).max(0.0)],
            covariance: Plane { xx: sigma * sigma, xy: 0.0, yy: sigma * sigma },
            velocity: [f64::NAN; 2],
            velocity_covariance: Plane { xx: f64::NAN, xy: f64::NAN, yy: f64::NAN },
            height: f64::NAN,
            used: true,
        };
        let mut plots: Vec<TrackPlot> = (0..100)
            .flat_map(|k| {
                let t = f64::from(k);
                let other = (k % 4 == 2).then(|| plot(t + 0.5, 1, 0.0, 30.0));
                [Some(plot(t, 0, 15.0, 3.0)), other].into_iter().flatten()
            })
            .collect();
        plots.sort_by(|a, b| a.time.total_cmp(&b.time));
        plots
    }

    #[test]
    fn the_region_contains_the_places_of_both_sensors() {
        let plots = drifting();
        let movement = Movement::of(&Motion::Imm(ImmModel::default())).unwrap();
        let mut rows = smooth(&movement, &plots, &Times::default(), 12.4);
        add_contradictions(&plots, &mut rows);
        // to the end, after the last plot of the other sensor
        let late = rows.iter().filter(|row| row.time > 60.0);
        for row in late {
            let sigma = row.covariance[1][1].sqrt();
            assert!(row.state[1].abs() < 2.0 * sigma && sigma < 2.0 * row.state[1].abs());
        }
        let before = rows.iter().filter(|row| row.time < 15.0);
        assert!(before.into_iter().all(|row| row.covariance[1][1].sqrt() < 5.0));
    }
}
