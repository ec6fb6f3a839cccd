//! Results of a call: the rows, and the track of each plot.

use crate::tracker::plot::PlotStatus;
use crate::tracker::rows::row::{Resumed, Row, Rows};

/// Collects rows, tracks that were resumed, and the tracks of the plots that were given in the present call.
pub(super) struct Sink<'a> {
    pub rows: Vec<Row>,
    pub resumed: Vec<Resumed>,
    pub claims: &'a mut [Claim],
    /// Index of the first plot of the present call among all plots so far.
    pub first: usize,
    /// Whether rows of tentative tracks are collected, too.
    pub tentative: bool,
}

/// The track of a plot and the first plot of this track, or why the plot was not used.
pub(super) type Claim = Result<(u64, usize), PlotStatus>;

impl Rows for Sink<'_> {
    fn wants(&self, _: bool) -> bool {
        true
    }

    fn push(&mut self, row: &Row) {
        if let Some(plot) = row.plot.and_then(|plot| plot.checked_sub(self.first)) {
            self.claims[plot] = Ok((row.track as u64, row.first_plot));
        }
        if self.tentative || row.confirmed {
            self.rows.push(*row);
        }
    }

    fn resume(&mut self, one: Resumed) {
        self.resumed.push(one);
    }
}

impl Sink<'_> {
    /// Notes why a plot is not used, if it was given in the present call.
    pub fn refuse(&mut self, plot: usize, status: PlotStatus) {
        if let Some(plot) = plot.checked_sub(self.first) {
            self.claims[plot] = Err(status);
        }
    }
}
