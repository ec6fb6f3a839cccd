//! Rows: the states of tracks that a tracker reports.

use super::estimate::Estimate;
use super::track::Track;
use crate::base::plane::Plane;
use crate::flightplan::Status;

/// The state of a track after a plot, or after a scan without one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// s
    pub time: f64,
    /// Number of the track.
    pub track: u64,
    /// Index of the radar.
    pub radar: usize,
    /// Index of the plot, in the order of all plots ever given; none where it was missed.
    pub plot: Option<usize>,
    /// Position and velocity.
    pub estimate: Estimate<4>,
    /// Plot less prediction; nan for a missed detection.
    pub innovation: [f64; 2],
    /// Its covariance.
    pub innovation_covariance: Plane,
    /// Probability that the target turns.
    pub turn_probability: f64,
    /// Height, m; nan where none was reported.
    pub height: f64,
    /// Vertical rate, up, m/s; nan as the height.
    pub vertical_rate: f64,
    /// Reply of the transponder; negative where there is none.
    pub identity: i64,
    /// Whether the track is confirmed.
    pub confirmed: bool,
    /// Index of its plan.
    pub plan: Option<usize>,
    /// How it came to that, or why it has none.
    pub plan_status: Status,
    /// Whether it follows that.
    pub conforms: bool,
}

impl Row {
    pub(super) fn of(track: &Track, radar: usize, plot: Option<usize>) -> Self {
        let reported = track.vertical.filter(|vertical| vertical.reported);
        let vertical = reported.map(|vertical| (vertical.height, vertical.vertical_rate));
        let none = ([f64::NAN; 2], Plane { xx: f64::NAN, xy: f64::NAN, yy: f64::NAN });
        let (innovation, innovation_covariance) =
            if plot.is_some() { track.innovation } else { none };
        let (height, vertical_rate) = vertical.unwrap_or((f64::NAN, f64::NAN));
        Self {
            time: track.time,
            track: track.number,
            radar,
            plot,
            estimate: track.widened(),
            innovation,
            innovation_covariance,
            turn_probability: track.filter.turn_probability(),
            height,
            vertical_rate,
            identity: track.identity().unwrap_or(-1),
            confirmed: track.is_confirmed(),
            plan: track.plan(),
            plan_status: track.plan_status(),
            conforms: track.filter.guide().is_some_and(|guide| guide.conforms),
        }
    }
}

/// Receives the rows of a tracker.
pub trait Rows {
    /// Whether it takes rows of confirmed or of tentative tracks.
    fn wants(&self, confirmed: bool) -> bool;
    /// Takes one more row.
    fn push(&mut self, row: &Row);
}

impl Rows for Vec<Row> {
    fn wants(&self, _: bool) -> bool {
        true
    }

    fn push(&mut self, row: &Row) {
        self.push(*row);
    }
}
