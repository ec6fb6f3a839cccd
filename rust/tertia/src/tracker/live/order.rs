//! The plots of a call that can be used.

use super::super::noise::copies::print;
use super::super::plot::{Plot, PlotStatus, Plots, keep_followed};
use super::Tracker;

impl Tracker {
    /// Returns times and indices of the plots that can be used, in the order of time. If they come live, their
    /// times were judged, and some were `refused`. `index` returns the index of a plot among all that were given.
    pub(in super::super) fn order<P: Plots + ?Sized>(
        &mut self,
        plots: &P,
        (refused, index): (Option<&[usize]>, impl Fn(usize) -> usize),
        statuses: &mut Vec<PlotStatus>,
    ) -> Vec<(f64, usize)> {
        let mut order = Vec::with_capacity(plots.len());
        statuses.reserve(plots.len());
        let mut prints = Vec::with_capacity(plots.len());
        for i in 0..plots.len() {
            let plot = plots.get(i);
            let radar = &self.settings.radars[plot.radar];
            let late = plot.time < self.time - radar.scan_period;
            let geometry = self.settings.geometry(plot.radar);
            let is_ahead = refused.is_some_and(|refused| refused.binary_search(&i).is_ok());
            let fault = plot
                .fault(radar, geometry)
                .or(late.then_some(PlotStatus::Late))
                .or(is_ahead.then_some(PlotStatus::ClockError));
            if fault.is_none() {
                order.push((plot.time, i));
            }
            prints.push(print(&plot, plots.measured(i), &self.settings));
            statuses.push(fault.unwrap_or(Plot::unused(geometry)));
        }
        order.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (copies, settings) = (&mut self.repeats.copies, &self.settings);
        order.retain(|&(time, i)| {
            let status = copies.status(prints[i], (time, plots.radar(i), index(i)), settings);
            statuses[i] = status.unwrap_or(statuses[i]);
            status.is_none()
        });
        if refused.is_none() {
            self.refuse_strays(&mut order, statuses);
        }
        if self.settings.has_reports() {
            order.retain(|&(_, i)| {
                let is_old = self.repeats.is_old(&plots.get(i), &self.settings);
                if is_old {
                    statuses[i] = PlotStatus::Duplicate;
                }
                !is_old
            });
        }
        order
    }

    /// Refuses single plots long after the others: a plot with a wrong clock would end all tracks. A second
    /// plot at about the same time shows that there was a gap.
    fn refuse_strays(&mut self, order: &mut Vec<(f64, usize)>, statuses: &mut [PlotStatus]) {
        let silence = self.silence();
        let refuse = |index: usize| statuses[index] = PlotStatus::ClockError;
        keep_followed(order, self.time, &mut self.stray, silence, refuse);
    }
}
