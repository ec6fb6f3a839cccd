//! Which flights are due: new targets may belong to them.

use crate::flightplan::{along, expected, is_due};
use crate::tracker::clutter::Clutter;
use crate::tracker::filter::prospects::{Expected, Flying, There};
use crate::tracker::plot::Measured;
use crate::tracker::settings::Settings;
use crate::tracker::settings::association::Association;
use crate::tracker::track::Track;
use crate::tracker::track::correlation::contradicts;

/// Share of new targets that have a plan.
const SHARE: f64 = 0.5;

/// Plans of flights that may be under way, and what they say about the plots of a scan.
#[derive(Default)]
pub(in crate::tracker) struct Schedule {
    due: Vec<usize>,
    /// Those of them that no track has.
    free: Vec<usize>,
    /// Density of false plots at each plot relative to the mean, at least 1, and the probability
    /// that a false plot there is one of those along routes.
    crowds: Vec<[f64; 2]>,
}

impl Schedule {
    /// The schedule at the time of a plot; empty if plans have no influence on initiation. Cost
    /// O(tracks + plans).
    pub fn at(first: Option<&Measured>, tracks: &[Track], settings: &Settings) -> Self {
        let is_used = settings.initiation
            && settings.motion.takes_plans()
            && !matches!(settings.association, Association::Paper(_));
        let Some(plot) = first.filter(|_| is_used) else { return Self::default() };
        let mut is_free = vec![true; settings.plans.len()];
        tracks.iter().filter_map(Track::plan).for_each(|plan| is_free[plan] = false);
        let is_due = |&number: &usize| {
            settings.plans.get(number).is_some_and(|plan| is_due(&plan.route, plot.time))
        };
        let due: Vec<_> = (0..is_free.len()).filter(is_due).collect();
        let is_free =
            |number: &&usize| is_free[**number] && settings.plans.available(**number).is_some();
        let free = due.iter().filter(is_free).copied().collect();
        Self { due, free, crowds: Vec::new() }
    }

    /// Adds to the density of other plots the excess of false plots along routes over the mean, at
    /// plots that are not `taken`. Cost O(plots plans).
    pub fn crowd(
        &mut self,
        (plots, taken): (&[Measured], &[bool]),
        (clutter, settings): (&[Clutter], &Settings),
        others: &mut [f64],
    ) {
        if self.due.is_empty() {
            return;
        }
        self.crowds.clear();
        for ((plot, &taken), others) in plots.iter().zip(taken).zip(others) {
            if taken {
                self.crowds.push([1.0, 0.0]);
                continue;
            }
            let (own, radar) = (&clutter[plot.radar], &settings.radars[plot.radar]);
            let plans = self.due.iter().filter_map(|&number| settings.plans.get(number));
            let density: f64 = plans.map(|plan| along(&plan.route, plot.position)).sum();
            let share = own.on_routes();
            let routed = share * own.area(radar) * density / self.due.len() as f64;
            let crowd = 1.0 - share + routed;
            *others += plot.rivals(own.density(radar)) * (crowd - 1.0).max(0.0);
            self.crowds.push([crowd.max(1.0), routed / crowd]);
        }
    }

    /// What the plans say about a plot that no track has taken. Until a scan of such plots has been
    /// seen, they say nothing about targets, as false plots may be where flights are due. Cost
    /// O(plans).
    ///
    /// The crowding keeps the mean of the ratio over false plots at 1 or less, as far as that mean
    /// is known.
    pub fn expected(
        &self,
        index: usize,
        plot: &Measured,
        clutter: &[Clutter],
        settings: &Settings,
    ) -> Option<Expected> {
        let &[crowd, routed] = self.crowds.get(index)?;
        let (clutter, radar) = (&clutter[plot.radar], &settings.radars[plot.radar]);
        let each = clutter.area(radar) / self.free.len() as f64;
        let mut due = 0.0;
        let mut flights = Vec::new();
        for &number in &self.free {
            let Some(plan) = settings.plans.get(number) else { continue };
            let Some(own) = expected(&plan.route, plot.time, plot.position) else { continue };
            due += each * own.density / crowd;
            if !contradicts(plan, &plot.identities) {
                let (probability, square) = (each * own.density, own.square);
                flights.push(Flying { plan: number, probability, square, velocity: own.velocity });
            }
        }
        let there = There { due, routed };
        let Some(crowding) = clutter.crowding().filter(|_| !self.free.is_empty()) else {
            return Some(Expected { ratio: 1.0, there, crowding: 1.0, flights: Vec::new() });
        };
        let weight = SHARE / crowding;
        let planned: f64 = flights.iter().map(|flight| weight * flight.probability).sum();
        let ratio = 1.0 - SHARE + planned;
        flights.iter_mut().for_each(|flight| flight.probability *= weight / ratio);
        Some(Expected { ratio, there, crowding, flights })
    }
}
