//! A target of the picture, with its number, age and filter.

use super::bias::propagated;
use super::lasting::{Positions, lasting};
use super::near::Sample;
use super::pairs::Known;
use super::row::{Row, carried};
use crate::base::plane::Plane;
use crate::registration::{Report, TargetPlot, Update};
use crate::sensors::Radar;
use crate::tracker::{Estimate, Follower, ImmModel};
use nalgebra::{Cholesky, SMatrix};
use serde::{Deserialize, Serialize};
use std::ops::AddAssign;

/// Weight of the newest plot in the running mean of innovations, and the largest value that is used of one.
const MEMORY: f64 = 0.3;
const SURPRISE: f64 = 20.0;

/// A plot behind a row of a track, reconstructed as its sensor measured it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Tracklet {
    pub report: Report,
    pub turn_probability: f64,
    /// Covariance of the plot if it is not the sensor's noise.
    pub own: Option<Plane>,
    /// Covariance that is added to this noise because the plot is not exactly known.
    pub added: Plane,
}

impl Tracklet {
    /// Creates a tracklet from the position behind a row.
    pub fn new(
        row: &Row,
        [x, y]: [f64; 2],
        (own, added): (Option<Plane>, Plane),
        radar: &Radar,
    ) -> Self {
        let (dx, dy) = (x - radar.position[0], y - radar.position[1]);
        let report = Report {
            radar: row.sensor,
            time: row.time,
            range: dx.hypot(dy).hypot(row.above(radar)),
            azimuth: dx.atan2(dy),
            height: row.height,
            place: None,
        };
        Self { report, turn_probability: row.turning(), own, added }
    }
}

/// A target of the picture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Target {
    pub number: u64,
    /// Number of cycles in which the target was present.
    pub cycles: usize,
    /// Number of successive cycles in which a sensor that should see the target did not.
    pub unseen: usize,
    pub follower: Option<Follower>,
    /// Running mean of the normalised innovation squared, relative to its expected value.
    surprise: f64,
    /// Running mean of the innovation variance per axis, m².
    square: f64,
    /// Contribution of unknown errors of the sensors to the covariance.
    pub added: SMatrix<f64, 4, 4>,
}

impl Target {
    pub fn new(number: u64) -> Self {
        let added = SMatrix::zeros();
        Self { number, cycles: 0, unseen: 0, follower: None, surprise: 1.0, square: 0.0, added }
    }

    /// Filters the plots behind the rows in order of time; a new target starts with a state. Returns the
    /// updates from which the registration can estimate errors.
    pub fn follow(
        &mut self,
        tracklets: &[&Tracklet],
        (row, sample): (&Row, &Sample),
        radars: &[Radar],
        known: &Known,
    ) -> Vec<Update> {
        let model = ImmModel::default();
        let (mut learnt, mut begins) = (Vec::with_capacity(tracklets.len()), None);
        if self.follower.is_none() {
            let mut covariance = row.estimate(&radars[row.sensor]).covariance;
            let (block, j) = (known.block(row.sensor, row.sensor), &sample.sensitivity);
            covariance += propagated(j, block, j);
            let mut mean = sample.mean;
            mean[0] -= sample.age * mean[2];
            mean[1] -= sample.age * mean[3];
            let estimate = Estimate { mean, covariance };
            self.follower = Some(Follower::new(&model, estimate, row.turning(), row.time));
            begins = Some(row.sensor);
        }
        let Some(follower) = &mut self.follower else { return learnt };
        for tracklet in tracklets.iter().filter(|one| Some(one.report.radar) != begins) {
            let report = tracklet.report.corrected(&known.errors[tracklet.report.radar]);
            let radar = &radars[report.radar];
            let up =
                if report.height.is_finite() { report.height - radar.position[2] } else { 0.0 };
            let ground = (report.range * report.range - up * up).max(0.0).sqrt();
            let (sine, cosine) = report.azimuth.sin_cos();
            let mut z = [radar.position[0] + ground * sine, radar.position[1] + ground * cosine];
            let noise = tracklet.own.unwrap_or_else(|| radar.noise_at(z, up));
            let mut noise = noise.plus(tracklet.added);
            follower.predict(&model, report.time, radar.scan_period);
            let estimate = follower.estimate();
            // a late plot is moved along with the velocity to the time of the filter
            let late = follower.time - report.time;
            if late > 0.0 {
                let p = &estimate.covariance;
                z[0] += late * estimate.mean[2];
                z[1] += late * estimate.mean[3];
                noise.xx += late * late * p[(2, 2)];
                noise.xy += late * late * p[(2, 3)];
                noise.yy += late * late * p[(3, 3)];
            }
            let y = [z[0] - estimate.mean[0], z[1] - estimate.mean[1]];
            let p = &estimate.covariance;
            let own = Plane { xx: p[(0, 0)], xy: p[(0, 1)], yy: p[(1, 1)] };
            let both = own.plus(noise);
            let square = (0.5 * both.inverse().form(y)).min(SURPRISE);
            self.surprise += MEMORY * (square - self.surprise);
            self.square += MEMORY * (0.5 * (both.xx + both.yy) - self.square);
            follower.correct(&model, z, noise);
            if tracklet.own.is_some() {
                continue;
            }
            let estimate = follower.estimate();
            let plot = TargetPlot {
                report: tracklet.report,
                target: self.number as i64,
                turn_probability: follower.turn_probability(),
            };
            let velocity = [estimate.mean[2], estimate.mean[3]];
            let covariance = std::array::from_fn(|i| estimate.covariance[(i / 4, i % 4)]);
            let (confirmed, position) = (true, [estimate.mean[0], estimate.mean[1]]);
            let (innovation, innovation_covariance) = ([f64::NAN; 2], [f64::NAN; 4]);
            learnt.push(Update {
                plot,
                confirmed,
                position,
                velocity,
                covariance,
                innovation,
                innovation_covariance,
                other: None,
            });
        }
        learnt
    }

    /// Returns position and velocity at a time, from the positions of these tracks.
    pub fn at(&self, time: f64, tracks: &[Positions]) -> Option<Estimate<4>> {
        // that of the slowest sensor
        let period = tracks.iter().map(|track| track.period).fold(0.0, f64::max);
        let mut follower = self.follower?;
        follower.predict(&ImmModel::default(), time, period);
        // clocks that are slow report plots that are later than the picture
        let back = (time - follower.time).min(0.0);
        let mut estimate = carried(follower.estimate(), follower.turn_probability(), back);
        let surprise = self.surprise.max(1.0);
        estimate.covariance *= surprise;
        estimate.covariance.fixed_view_mut::<2, 2>(0, 0).add_assign(lasting(tracks));
        // the sum may be indefinite if the known errors are older than the last row
        let whole = estimate.covariance + self.added;
        if Cholesky::new(whole).is_some() {
            estimate.covariance = whole;
        }
        // a turn that is not yet detected moves plots by half of what it adds to the velocity over time
        let velocity = (surprise - 1.0) * self.square / (period * period);
        estimate.covariance[(2, 2)] += velocity;
        estimate.covariance[(3, 3)] += velocity;
        Some(estimate)
    }
}
