//! What tentative tracks stand on: their plots, and how dense false ones were thought to be.

use super::{Stage, Track};
use crate::tracker::clutter::Clutter;
use crate::tracker::noise::Noise;
use crate::tracker::plot::Measured;
use crate::tracker::settings::{Confirmation, Settings};
use crate::tracker::weighed::Weighed;
use serde::{Deserialize, Serialize};

/// The plots of a tentative track from the second one on.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Basis(Vec<Weighed>);

impl Track {
    /// Adds a plot that was weighed against false plots, which have this density on average. Before it may confirm
    /// the track, all are weighed again where false plots have turned out to be denser.
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

    /// The plots of a tentative track after the first, if that has been counted as false.
    pub fn later_plots(&self) -> &[Weighed] {
        self.basis.0.get(1..).filter(|_| self.is_counted).unwrap_or_default()
    }

    /// A confirmed track stands on its estimate.
    pub(super) fn stand_alone(&mut self) {
        self.basis = Basis::default();
        self.suspicion = None;
    }
}

impl Basis {
    /// Weighs the plots against the density as it is known now, if that is higher. Returns by how much less
    /// likely a target is, as a logarithm.
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
