//! Tertia's own filter, run beside a sensor's track to find out whether the sensor uses the same filter.

use super::row::Row;
use crate::sensors::Radar;
use crate::tracker::{Estimate, Follower, ImmModel};
use serde::{Deserialize, Serialize};

/// Weight of the newest row in the running mean of squares, and the mean above which the sensor uses
/// another filter.
const MEMORY: f64 = 0.3;
const UNLIKE: f64 = 0.03;
/// Square below which the velocity is exactly that of the filter, and not only similar.
const SAME: f64 = 1e-3;

/// The default filter of Tertia's tracker, with models of straight flight, turns and changes of speed. If the
/// sensor uses this filter, the predictions of both are equal; the velocities show whether this is the case.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Shadow {
    follower: Follower,
    /// Running mean of the normalised squares of differences of the velocities.
    unlike: f64,
    /// Whether the last velocity was that of the filter.
    pub is_same: bool,
}

impl Shadow {
    /// Starts with the first row of a track.
    pub fn new(row: &Row, radar: &Radar) -> Self {
        let model = ImmModel::default();
        let follower = Follower::new(&model, row.estimate(radar), row.turning(), row.time);
        Self { follower, unlike: 0.0, is_same: false }
    }

    /// Returns the plot that moved the track to its next row; `None` if another filter made the row.
    pub fn follow(&mut self, row: &Row, radar: &Radar) -> Option<[f64; 2]> {
        self.follower.predict(&ImmModel::default(), row.time, radar.scan_period);
        let predicted = self.follower.estimate().mean;
        let noise = radar.noise_at([predicted[0], predicted[1]], row.above(radar));
        let [x, y, vx, vy] = row.state;
        let Some(plot) = self.follower.plot_behind([x, y], noise) else {
            *self = Self { unlike: 1.0, ..Self::new(row, radar) };
            return None;
        };
        self.follower.correct(&ImmModel::default(), plot, noise);
        let Estimate { mean, covariance } = self.follower.estimate();
        let squared = (mean[2] - vx).powi(2) + (mean[3] - vy).powi(2);
        let square = squared / (covariance[(2, 2)] + covariance[(3, 3)]);
        self.unlike += MEMORY * (square - self.unlike);
        self.is_same = square < SAME;
        (self.unlike < UNLIKE).then_some(plot)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensors::Identities;
    use crate::tracker::Estimate;
    use nalgebra::{SMatrix, SVector};

    const RADAR: Radar = Radar {
        position: [0.0; 3],
        range_sigma: 50.0,
        azimuth_sigma: 1.5e-3,
        scan_period: 4.0,
        max_range: f64::INFINITY,
        detection_probability: 0.9,
        resolution: None,
        extent: 0.0,
        ways: None,
    };

    /// Plots of a target that turns after 80 s or brakes, with errors of about one sigma, and the rows of a
    /// tracker whose initial probabilities of straight flight and turns are equal.
    fn flown(model: &ImmModel, brakes: bool) -> Vec<([f64; 2], Row)> {
        let (mut x, mut y, mut course, mut speed) = (30e3, 40e3, 0.4_f64, 200.0);
        let start = SVector::from([x, y, 78.0, 184.0]);
        let covariance = SMatrix::from_diagonal(&SVector::from([1e4, 1e4, 400.0, 400.0]));
        let estimate = Estimate { mean: start, covariance };
        let mut follower = Follower::new(model, estimate, 0.5, 0.0);
        let mut found = Vec::new();
        for scan in 1..60_u32 {
            let time = 4.0 * f64::from(scan);
            if (20..40).contains(&scan) {
                let (turned, slower) = if brakes { (0.0, 4.0) } else { (0.12, 0.0) };
                course += turned;
                speed -= slower;
            }
            x += 4.0 * speed * course.sin();
            y += 4.0 * speed * course.cos();
            let phase = 2.4 * f64::from(scan);
            let plot = [x + 70.0 * phase.sin(), y + 70.0 * (1.7 * phase).cos()];
            follower.predict(model, time, RADAR.scan_period);
            let predicted = follower.estimate().mean;
            follower.correct(model, plot, RADAR.noise_at([predicted[0], predicted[1]], 0.0));
            let Estimate { mean, covariance } = follower.estimate();
            let row = Row {
                sensor: 0,
                track: 1,
                time,
                state: mean.into(),
                covariance: std::array::from_fn(|i| covariance[(i / 4, i % 4)]),
                height: f64::NAN,
                identities: Identities::NONE,
                turn_probability: follower.turn_probability(),
            };
            found.push((plot, row));
        }
        found
    }

    /// Errors of the plots behind rows; `None` where the filter seems to be another one.
    fn errors(rows: &[([f64; 2], Row)]) -> Vec<Option<f64>> {
        let mut shadow = Shadow::new(&rows[5].1, &RADAR);
        let off = |([x, y], plot): ([f64; 2], &[f64; 2])| (x - plot[0]).hypot(y - plot[1]);
        let follow = |(plot, row): &([f64; 2], Row)| Some(off((shadow.follow(row, &RADAR)?, plot)));
        rows[6..].iter().map(follow).collect()
    }

    #[test]
    fn plots_behind_rows_of_the_same_filter() {
        let found = errors(&flown(&ImmModel::default(), false));
        // the initial probabilities of the models are not known; their influence fades
        assert!(found.iter().all(|error| error.is_some_and(|error| error < 20.0)), "{found:?}");
        let late = found[30..].iter().flatten();
        assert!(late.clone().all(|&error| error < 0.1), "{found:?}");
    }

    #[test]
    fn plots_behind_rows_of_a_target_that_brakes() {
        let found = errors(&flown(&ImmModel::default(), true));
        let known: Vec<_> = found.iter().flatten().collect();
        // a change of speed that becomes a model of its own also moves the row
        assert!(known.len() + 6 >= found.len(), "{found:?}");
        assert!(known.iter().all(|&&error| error < 20.0), "{found:?}");
        assert!(
            found[45..].iter().all(|error| error.is_some_and(|error| error < 1.0)),
            "{found:?}"
        );
    }

    #[test]
    fn another_filter_is_noticed() {
        // practically no turns, and large process noise: a filter of nearly constant velocity
        let model = ImmModel { straight_sigma: 3.0, straight_time: 1e9, ..ImmModel::default() };
        let rows = flown(&model, false);
        let mut shadow = Shadow::new(&rows[5].1, &RADAR);
        let found: Vec<_> = rows[6..].iter().map(|(_, row)| shadow.follow(row, &RADAR)).collect();
        assert!(found[5..].iter().all(Option::is_none), "{found:?}");
    }
}
