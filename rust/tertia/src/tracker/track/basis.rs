//! What tentative tracks are based on: their plots, and the density of false plots that was assumed
//! for each.

use super::{Stage, Track};
use crate::tracker::clutter::weighed::Weighed;
use crate::tracker::clutter::{Clutter, Held};
use crate::tracker::noise::Noise;
use crate::tracker::plot::Measured;
use crate::tracker::settings::{Confirmation, Settings};
use serde::{Deserialize, Serialize};

/// The plots of a tentative track, once there are two of them.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Basis(Vec<Weighed>);

impl Track {
    /// Adds a plot that was compared with false plots of this mean density. Before the plot may
    /// confirm the track, all its plots are compared again wherever the density of false plots has
    /// turned out to be higher.
    pub fn stand(
        &mut self,
        plot: &Measured,
        density: f64,
        (clutter, noise): (&[Clutter], &[Noise]),
        settings: &Settings,
    ) {
        let Stage::Tentative { hits, plots, evidence, .. } = self.stage else { return };
        if self.basis.0.is_empty() {
            self.basis.0.push(Weighed::new(&self.first, self.believed));
        }
        self.basis.0.push(Weighed::new(plot, plot.rivals(density)));
        let is_likely = match settings.confirmation {
            Confirmation::Plots(..) => evidence >= 0.0,
            Confirmation::Existence(least) => self.existence.probability() >= least,
        };
        if hits + 1 < plots || !is_likely {
            return;
        }
        // outliers may have turned out to be many
        if plots == settings.confirmation.plots() && noise[plot.radar].outliers.are_many() {
            self.require_more();
        }
        let noise = self.first_noise(settings);
        let stays =
            !self.moved && plot.is_bare() && !self.is_away((plot.position, noise), settings);
        let loss = self.basis.weigh(clutter, stays, settings);
        let ratio = (-loss).exp();
        if let Stage::Tentative { evidence, least, .. } = &mut self.stage {
            *evidence -= loss;
            *least *= ratio;
        }
        self.existence.favour(ratio);
    }

    /// Adds its plots to those of tentative tracks, weighted with the probability that they are
    /// false. A single plot says nothing about this probability. Cost O(plots).
    pub fn hold(&self, (clutter, held): (&[Clutter], &mut [Held]), settings: &Settings) {
        let is_false =
            if self.basis.0.is_empty() { 1.0 } else { 1.0 - self.existence.probability() };
        for (is_first, plot) in self.counted() {
            let (own, held) = (&clutter[plot.radar], &mut held[plot.radar]);
            let radar = &settings.radars[plot.radar];
            own.add(held, radar, &plot, is_false);
            if is_first {
                own.add_place(held, radar, (plot.time, self.there));
            }
        }
    }

    /// Counts its plots as false, as the track was never confirmed; later plots of a fixed echo are
    /// not counted. Cost O(plots).
    pub fn count(&self, clutter: &mut [Clutter], settings: &Settings) {
        let (first, radars) = (&self.first, &settings.radars);
        if !self.is_shared {
            clutter[first.radar].drop(&radars[first.radar], first.position);
        }
        for (is_first, plot) in self.counted() {
            let (radar, own) = (&radars[plot.radar], &mut clutter[plot.radar]);
            if is_first {
                own.count_place(radar, (plot.time, self.there));
            }
            if is_first || !own.has_source(radar, plot.position) {
                own.count(radar, &plot);
            }
        }
    }

    /// Its plots; none if its first one does not count: a second plot of a target, a reflection or
    /// a fixed echo. The first one belongs to another track if it is shared.
    fn counted(&self) -> impl Iterator<Item = (bool, Weighed)> + '_ {
        let is_single = self.basis.0.is_empty();
        let single = is_single.then(|| Weighed::new(&self.first, self.believed));
        let all = single.into_iter().chain(self.basis.0.iter().copied());
        let is_own =
            |(is_first, _): &(bool, Weighed)| self.is_counted && !(*is_first && self.is_shared);
        all.enumerate().map(|(i, plot)| (i == 0, plot)).filter(is_own)
    }

    /// Drops the plots and the suspicion: a confirmed track is based on its estimate.
    pub(super) fn stand_alone(&mut self) {
        self.basis = Basis::default();
        self.suspicion = None;
    }
}

impl Basis {
    /// Compares the plots with the density of false plots as it is known now, where that is higher.
    /// Returns the logarithm of the factor by which a target has become less likely.
    fn weigh(&mut self, clutter: &[Clutter], stays: bool, settings: &Settings) -> f64 {
        let mut loss = 0.0;
        for i in 0..self.0.len() {
            let plot = self.0[i];
            let (clutter, radar) = (&clutter[plot.radar], &settings.radars[plot.radar]);
            let is_own = |own: &&Weighed| {
                own.radar == plot.radar && clutter.is_same_patch(own.position, plot.position)
            };
            let own = self.0.iter().filter(is_own).count() as f64;
            let known = clutter.known_since(radar, &plot, (own, stays));
            if let Some(known) = known.filter(|known| *known > plot.density) {
                loss += (known / plot.density).ln();
                self.0[i].density = known;
            }
        }
        loss
    }
}
