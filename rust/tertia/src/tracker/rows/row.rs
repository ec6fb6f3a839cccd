//! Rows: the states of tracks that a tracker reports.

use crate::base::plane::Plane;
use crate::flightplan::Status;
use crate::sensors::Identities;
use crate::tracker::motion::estimate::Estimate;
use crate::tracker::track::Track;
use serde::{Deserialize, Serialize};
use std::cmp::Ordering;

/// The state of a track after a plot, or after a scan without one.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// Time, s.
    pub time: f64,
    /// Number of the track; 2^40 or more if it is not final.
    pub track: i64,
    /// Index of the first plot of the track.
    pub first_plot: usize,
    /// Index of the radar.
    pub radar: usize,
    /// Index of the plot among all plots ever given; none for a missed detection.
    pub plot: Option<usize>,
    /// Position and velocity.
    pub estimate: Estimate<4>,
    /// Innovation: plot less prediction, m; nan for a missed detection.
    pub innovation: [f64; 2],
    /// Covariance of the innovation.
    pub innovation_covariance: Plane,
    /// Probability that the target turns.
    pub turn_probability: f64,
    /// Probability that the speed of the target changes.
    pub speed_change_probability: f64,
    /// Probability that the choice of plots is right, among the hypotheses that are kept.
    pub association_probability: f64,
    /// Probability that the track is of a target.
    pub existence_probability: f64,
    /// Height, m; nan if none was reported.
    pub height: f64,
    /// Vertical rate, positive upward, m/s; nan if no height was reported.
    pub vertical_rate: f64,
    /// Replies of the transponder.
    pub identities: Identities,
    /// Whether the plot also belongs to another track.
    pub merged: bool,
    /// Whether the track is confirmed.
    pub confirmed: bool,
    /// Index of the flight plan.
    pub plan: Option<usize>,
    /// How the plan was assigned to the track, or why the track has none.
    pub plan_status: Status,
    /// Whether the track follows its plan.
    pub conforms: bool,
    /// Whether the row is final, whatever plots come late.
    pub is_final: bool,
}

impl Row {
    pub(in crate::tracker) fn of(track: &Track, radar: usize, plot: Option<usize>) -> Self {
        let vertical = track.reported().map(|vertical| (vertical.height, vertical.vertical_rate));
        let none = ([f64::NAN; 2], Plane { xx: f64::NAN, xy: f64::NAN, yy: f64::NAN });
        let (innovation, innovation_covariance) =
            if plot.is_some() { track.innovation } else { none };
        let (height, vertical_rate) = vertical.unwrap_or((f64::NAN, f64::NAN));
        Self {
            time: track.time,
            track: track.number as i64,
            first_plot: track.first.index,
            radar,
            plot,
            estimate: track.widened(),
            innovation,
            innovation_covariance,
            turn_probability: track.filter.turn_probability(),
            speed_change_probability: track.filter.speed_change_probability(),
            association_probability: track.association_probability(),
            existence_probability: track.existence_probability(),
            height,
            vertical_rate,
            identities: track.shown_identities(),
            merged: plot.is_some() && track.merged,
            confirmed: track.is_confirmed(),
            plan: track.plan(),
            plan_status: track.plan_status(),
            conforms: track.filter.guide().is_some_and(|guide| guide.conforms),
            is_final: true,
        }
    }

    /// Reads numbers in all parts of the row, so that it is loaded into the cache.
    #[inline(always)]
    pub(in crate::tracker) fn touched(&self) -> f64 {
        let Self { time, estimate, innovation, existence_probability, height, .. } = self;
        let (middle, last) = (estimate.covariance[(0, 1)], estimate.covariance[(3, 3)]);
        time + middle + last + innovation[0] + existence_probability + height
    }

    /// Orders rows by time, then by track and radar.
    pub(in crate::tracker) fn by_time(&self, other: &Self) -> Ordering {
        let own = (self.track, self.radar);
        self.time.total_cmp(&other.time).then(own.cmp(&(other.track, other.radar)))
    }

    /// Whether both rows are the same to the last bit.
    pub(in crate::tracker) fn is_same(&self, other: &Self) -> bool {
        let numbers = |row: &Self| {
            let Plane { xx, xy, yy } = row.innovation_covariance;
            let [a, b] = row.innovation;
            let (turns, exists) = (row.turn_probability, row.existence_probability);
            let (speed, chosen) = (row.speed_change_probability, row.association_probability);
            let [height, rate] = [row.height, row.vertical_rate];
            [row.time, a, b, xx, xy, yy, turns, speed, chosen, exists, height, rate]
        };
        let same = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits());
        let (mine, others) = (&self.estimate, &other.estimate);
        let whole = |row: &Self| {
            let plan = (row.plan, row.plan_status);
            (row.track, row.radar, row.plot, row.identities, plan)
        };
        let flags = |row: &Self| (row.confirmed, row.conforms, row.merged);
        whole(self) == whole(other)
            && flags(self) == flags(other)
            && same(&numbers(self), &numbers(other))
            && same(mine.mean.as_slice(), others.mean.as_slice())
            && same(mine.covariance.as_slice(), others.covariance.as_slice())
    }
}

/// A new track that was given the number of an older one of the same target.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Resumed {
    /// Number that the new track had before.
    pub new: i64,
    /// Number of the older track.
    pub old: i64,
    /// Time of the first plot of the new track, s.
    pub first: f64,
    /// Time of its confirmation, s.
    pub last: f64,
}

/// Receives the rows of a tracker.
pub trait Rows {
    /// Whether rows of confirmed tracks, or of tentative ones, are wanted.
    fn wants(&self, confirmed: bool) -> bool;
    /// Takes one more row.
    fn push(&mut self, row: &Row);
    /// Takes note of a track that was resumed: earlier rows with its new number are of the old track.
    fn resume(&mut self, _: Resumed) {}
}

impl Rows for Vec<Row> {
    fn wants(&self, _: bool) -> bool {
        true
    }

    fn push(&mut self, row: &Row) {
        self.push(*row);
    }
}
