//! Assigns the plots of one scan to tracks.
//!
//! Tracks that compete for plots of one radar form a group; groups with a track in common form a component.
//! Components are independent of one another, so several threads settle them, and a track is in the cache for
//! the plots of all its radars. Results are written in the order of the groups.

use super::assignment::claim::{Around, Claim, Spread, is_near};
use super::assignment::cluster::{Cells, Clusters};
use super::assignment::groups::{root, sort, unite};
use super::assignment::prefetch::Ahead;
use super::assignment::share::{Rates, Share, Shares, View};
use super::clutter::{self, Clutter};
use super::management::due_flights::Schedule;
use super::management::ended_tracks::Ended;
use super::management::hard_turns::{self, Known};
use super::management::outlying_plots;
use super::management::resume::resume;
use super::management::second_starts::Origins;
use super::noise::Noise;
use super::noise::duplicates::{self, Doubles, Near, Seconds};
use super::plot::{Measured, PlotStatus};
use super::rows::row::{Row, Rows};
use super::settings::Settings;
use super::track::Track;
use super::track::reflections::Reflections;
use crate::association::Grid;
use crate::sensors::Radar;

/// Marks an index that is not assigned yet.
const NOWHERE: u32 = u32::MAX;

/// Probability that a tentative track consists of false plots above which its last plot starts another track
/// as well.
const DOUBTED: f64 = 0.5;

/// Buffers of a scan, used again for the next one.
#[derive(Default)]
pub(super) struct Scan {
    plots: Vec<Measured>,
    /// Whether each plot already has a track, or is left out.
    taken: Vec<bool>,
    /// Probability that the track which has taken the plot consists of false plots.
    doubted: Vec<f64>,
    deferred: Vec<bool>,
    spread: Spread,
    /// Whether each plot is left out as a second plot of its target, for radars that make many such plots.
    left_out: Vec<bool>,
    /// Smallest number and smallest index of the tracks that may claim plots now.
    first: (u64, usize),
    /// Grid of the plots of all radars.
    grid: Grid,
    points: Vec<[f64; 2]>,
    times: Vec<f64>,
    cell: f64,
    /// Plots that no confirmed track has taken, and (`around`) a grid of them.
    left: Vec<u32>,
    around: Grid,
    claims: Vec<Claim>,
    sorted: Vec<Claim>,
    /// Claimed plots; each claim refers to a contiguous part of them.
    claimed: Vec<u32>,
    /// Parent of each plot in its group, as a union-find structure: the root is the lowest plot of the group.
    joined: Vec<u32>,
    /// Highest plot of each group, stored at its root.
    last: Vec<u32>,
    /// Counters for sorting by counting; before that, the parents of groups in their components.
    counts: Vec<u32>,
    /// Number of each component, stored at its root.
    order: Vec<u32>,
    /// Index of each track among those that claim plots.
    places: Vec<u32>,
    /// Second plots of targets: where they may be, and how dense.
    seconds: Seconds,
    reflections: Reflections,
    /// Density of other plots at each plot: second plots and outliers of confirmed tracks, and the excess of
    /// false plots along routes.
    others: Vec<f64>,
    shares: Shares,
}

/// What a scan uses and changes: settings, state of the tracker, and rows.
pub(super) struct Sky<'a, R> {
    pub settings: &'a Settings,
    pub tracks: &'a mut Vec<Track>,
    pub clusters: &'a mut Clusters,
    /// Ended tracks that may be resumed.
    pub ended: &'a mut Ended,
    pub clutter: &'a mut [Clutter],
    pub doubles: &'a mut [Doubles],
    pub noise: &'a mut [Noise],
    pub next_number: &'a mut u64,
    pub rows: &'a mut R,
    pub threads: usize,
}

impl Scan {
    /// Assigns plots, sorted by time, to tracks, and starts tracks with the others. Plots at or after `hold`,
    /// and plots from `oldest` on that compete with them, are deferred and returned in `plots`.
    pub fn process<R: Rows>(
        &mut self,
        sky: &mut Sky<'_, R>,
        plots: &mut Vec<Measured>,
        [oldest, hold]: [f64; 2],
        mut report: impl FnMut(usize, PlotStatus),
    ) {
        self.load(sky, plots);
        self.leave_out(sky, &mut report);
        self.first = (0, 0);
        self.reflections.clear();
        self.take(sky, true, [oldest, hold], &mut report);
        let known = Known { settings: sky.settings, clutter: sky.clutter, noise: sky.noise };
        let sought = (known, &mut sky.tracks[..], &mut *sky.rows);
        let free = (&mut self.taken[..], &self.deferred[..]);
        let given = hard_turns::follow(sought, (&self.grid, &self.plots), free);
        for (plot, track) in given {
            report(self.plots[plot].index, PlotStatus::Track(track));
        }
        let near = Near { grid: &self.grid, plots: &self.plots, left_out: &self.left_out };
        let used = (&self.taken[..], &self.deferred[..]);
        self.seconds.find(near, used, sky.doubles, sky.settings);
        let radars = &sky.settings.radars;
        let counted = (&mut *sky.clutter, &radars[..]);
        clutter::note((near.plots, hold), used, &self.seconds, counted, sky.threads);
        self.others.clear();
        self.others.extend_from_slice(self.seconds.of_confirmed());
        self.reflections.find(near, used, (sky.tracks, sky.settings));
        self.reflections.weigh(&self.plots, (sky.tracks, sky.settings));
        let tracks = (&mut sky.tracks[..], sky.settings);
        outlying_plots::find(near, used, tracks, (sky.noise, sky.clutter), &mut self.others);
        let mut schedule = Schedule::at(self.plots.first(), sky.tracks, sky.settings);
        schedule.crowd((&self.plots, used.0), (sky.clutter, sky.settings), &mut self.others);
        self.leave();
        let mut origins = Origins::of(sky.tracks, sky.settings);
        loop {
            self.take(sky, false, [oldest, hold], &mut report);
            // older tracks have already had their choice
            self.first = (*sky.next_number, sky.tracks.len());
            if !self.begin(sky, (&schedule, &mut origins), hold, &mut report) {
                break;
            }
        }
        clutter::pass((&self.plots, &self.deferred), sky.clutter, &sky.settings.radars);
        plots.clear();
        let waiting = self.plots.iter().zip(&self.deferred).filter(|(_, deferred)| **deferred);
        plots.extend(waiting.map(|(plot, _)| *plot));
    }

    /// Assigns plots to the confirmed or to the tentative tracks, until none of them would take another plot.
    fn take<R: Rows>(
        &mut self,
        sky: &mut Sky<'_, R>,
        confirmed: bool,
        [oldest, hold]: [f64; 2],
        report: &mut impl FnMut(usize, PlotStatus),
    ) {
        let mut again = true;
        while again {
            self.claim(sky, confirmed);
            let cells = if confirmed { sky.clusters.open() } else { Cells::default() };
            self.join(&cells, sky.tracks);
            self.defer(oldest, hold);
            again = self.settle(sky, &cells, confirmed, report);
            if let Some(limits) = sky.settings.limits().filter(|_| confirmed) {
                let back = self.shares.clusters();
                sky.clusters.close(cells, back, sky.tracks, (sky.settings, &limits));
            }
        }
    }

    fn load<R>(&mut self, sky: &mut Sky<'_, R>, plots: &mut Vec<Measured>) {
        std::mem::swap(&mut self.plots, plots);
        let plots = &self.plots;
        self.taken.clear();
        self.taken.resize(plots.len(), false);
        self.doubted.clear();
        self.doubted.resize(plots.len(), 0.0);
        self.deferred.clear();
        self.deferred.resize(plots.len(), false);
        self.spread = Spread::of(plots);
        let radars = &sky.settings.radars;
        self.points.clear();
        self.points.extend(plots.iter().map(|plot| plot.position));
        self.times.clear();
        self.times.extend(plots.iter().map(|plot| plot.time));
        for plot in plots {
            sky.clutter[plot.radar].saw(&radars[plot.radar], plot.position);
        }
        let cell = radars.iter().map(Radar::at_worst).map(|radar| {
            let far = radar.azimuth_sigma * radar.max_range.min(1e5);
            7.0 * (radar.range_sigma + far) + 500.0
        });
        let radar = |i: usize| plots[i].radar as u32;
        self.cell = cell.fold(0.0, f64::max);
        self.grid.fill_tagged(&self.points, radar, self.cell).expect("plots are finite");
    }

    /// Indexes the plots that no confirmed track has taken. Only a few remain in dense traffic, and tentative
    /// tracks search over larger areas, so this grid has larger cells.
    fn leave(&mut self) {
        let Self { plots, taken, deferred, points, cell, left, around, .. } = self;
        let free = |&i: &u32| !taken[i as usize] && !deferred[i as usize];
        left.clear();
        left.extend((0..plots.len() as u32).filter(free));
        let some = left.iter().map(|&i| i as usize);
        let radar = |i: usize| plots[i].radar as u32;
        around.fill_some((points, some), radar, 2.0 * *cell).expect("plots are finite");
    }

    /// Leaves out second plots of targets, for radars that make many such plots.
    fn leave_out<R>(&mut self, sky: &Sky<'_, R>, report: &mut impl FnMut(usize, PlotStatus)) {
        let Self { grid, plots, left_out, .. } = self;
        duplicates::leave_out((grid, plots), sky.doubles, sky.settings, left_out);
        for (i, plot) in plots.iter().enumerate().filter(|(i, _)| left_out[*i]) {
            self.taken[i] = true;
            report(plot.index, PlotStatus::Duplicate);
        }
    }

    /// Lets all confirmed or all tentative tracks claim the free plots near them.
    fn claim<R>(&mut self, sky: &Sky<'_, R>, confirmed: bool) {
        let Self { plots, times, taken, deferred, spread, claims, claimed, shares, .. } = self;
        let (oldest, from) = self.first;
        claims.clear();
        claimed.clear();
        let (Some(first), Some(last)) = (plots.first(), plots.last()) else { return };
        let (begin, end) = (first.time, last.time);
        let settings = sky.settings;
        let grid = if confirmed { &self.grid } else { &self.around };
        let around = Around { grid, plots, times };
        let free = |plot: u32| !taken[plot as usize] && !deferred[plot as usize];
        let look = |share: &mut Share, first: usize, tracks: &[Track]| {
            for (index, track) in (from + first..).zip(tracks) {
                if track.is_confirmed() == confirmed && track.number >= oldest {
                    share.look((index, track), (begin, end), settings, around, spread, free);
                }
            }
        };
        shares.look(sky.threads, &sky.tracks[from..], look);
        shares.collect(claims, claimed);
    }

    /// Joins the plots of each claim into groups, and sorts the claims by component and group.
    fn join(&mut self, cells: &Cells, tracks: &[Track]) {
        let Self { plots, claims, sorted, claimed, joined, last, counts, order, .. } = self;
        joined.clear();
        joined.extend(0..plots.len() as u32);
        for claim in claims.iter() {
            for pair in claimed[claim.start as usize..claim.end as usize].windows(2) {
                unite(joined, pair[0], pair[1]);
            }
        }
        last.clear();
        last.extend(0..plots.len() as u32);
        for i in 0..plots.len() as u32 {
            let root = root(joined, i);
            last[root as usize] = i;
        }
        for claim in claims.iter_mut() {
            claim.root = root(joined, claimed[claim.start as usize]);
        }
        // groups with a track in common form one component
        counts.clear();
        counts.extend_from_slice(joined);
        for pair in claims.windows(2).filter(|pair| pair[0].track == pair[1].track) {
            unite(counts, pair[0].root, pair[1].root);
        }
        // so do groups with tracks whose states depend on one another
        if !cells.is_empty() {
            let mut roots = vec![NOWHERE; cells.len()];
            for claim in claims.iter() {
                let track = &tracks[claim.track as usize];
                let Some(cluster) = cells.of(track.number) else { continue };
                if roots[cluster] == NOWHERE {
                    roots[cluster] = claim.root;
                }
                unite(counts, claim.root, roots[cluster]);
            }
        }
        // components are numbered in the order of their first tracks, so that memory is read in order
        order.clear();
        order.resize(plots.len(), NOWHERE);
        let mut next = 0;
        for claim in claims.iter_mut() {
            let number = &mut order[root(counts, claim.root) as usize];
            if *number == NOWHERE {
                *number = next;
                next += 1;
            }
            claim.component = *number;
        }
        sort(claims, sorted, counts, plots.len(), |claim| claim.root);
        for (rank, claim) in sorted.iter_mut().enumerate() {
            claim.rank = rank as u32;
        }
        sort(sorted, claims, counts, plots.len(), |claim| claim.component);
    }

    /// Defers plots that compete with a plot at or after `hold`, unless they are older than `oldest`: if
    /// those were deferred too, the next scan could contain two plots of one target.
    fn defer(&mut self, oldest: f64, hold: f64) {
        for i in 0..self.plots.len() {
            if !self.taken[i] && self.plots[i].time >= oldest {
                let last = self.last[root(&mut self.joined, i as u32) as usize] as usize;
                self.deferred[i] |= self.plots[last].time >= hold;
            }
        }
    }

    /// Assigns the plots to the tracks that claim them, group by group in the order of time. Returns whether
    /// plots of position sensors are left that tracks would take as well.
    fn settle<R: Rows>(
        &mut self,
        sky: &mut Sky<'_, R>,
        cells: &Cells,
        confirmed: bool,
        report: &mut impl FnMut(usize, PlotStatus),
    ) -> bool {
        if self.claims.is_empty() {
            return false;
        }
        let Self { plots, taken, deferred, claims, claimed, places, shares, .. } = self;
        // tracks in the order of the components
        places.clear();
        places.resize(sky.tracks.len(), NOWHERE);
        let mut count = 0;
        for claim in claims.iter_mut() {
            let place = &mut places[claim.track as usize];
            if *place == NOWHERE {
                *place = count;
                count += 1;
            }
            claim.track = *place;
        }
        let mut tracks: Vec<Option<&mut Track>> = (0..count).map(|_| None).collect();
        for (track, place) in sky.tracks.iter_mut().zip(&*places) {
            if *place != NOWHERE {
                tracks[*place as usize] = Some(track);
            }
        }
        let mut tracks: Vec<&mut Track> = tracks.into_iter().flatten().collect();
        let (settings, clutter, noise) = (sky.settings, &*sky.clutter, &*sky.noise);
        let rates = Rates::of(clutter, settings);
        let view = View {
            plots,
            claimed,
            deferred,
            others: &self.others,
            seconds: &self.seconds,
            reflections: &self.reflections,
            settings,
            clutter,
            rates: &rates,
            noise,
            cells,
        };
        let limits = settings.limits().filter(|_| confirmed);
        let with_rows = sky.rows.wants(confirmed);
        let same = |a: &Claim, b: &Claim| a.component == b.component;
        shares.settle(sky.threads, claims, &mut tracks, same, |share, claims, tracks| {
            let mut ahead = Ahead::default();
            for component in claims.chunk_by(same) {
                ahead.read(component.len(), claims, tracks, (plots, claimed));
                for group in component.chunk_by(|a, b| a.root == b.root) {
                    share.group(group, tracks, view);
                    let doubts = limits.map(|limits| share.doubt(group, tracks, view, limits));
                    share.assign();
                    for doubt in doubts.into_iter().flatten() {
                        share.decide(doubt, group, tracks, view, with_rows);
                    }
                    if settings.geometry(plots[group[0].root as usize].radar).is_position() {
                        share.note_wanted();
                    }
                    share.correct(group, tracks, view, (confirmed, with_rows));
                    if confirmed {
                        share.guard(group, tracks, view);
                    }
                }
                share.finish();
            }
        });
        let begun = if confirmed { Vec::new() } else { shares.confirmed() };
        let resumed = resume(sky.tracks, sky.ended, &begun, (settings, noise));
        resumed.iter().for_each(|one| sky.rows.resume(*one));
        let place = |new: u64| resumed.binary_search_by_key(&(new as i64), |one| one.new);
        let mut advanced = false;
        shares.report(claims.len(), |given, row| {
            let track = place(given.track).map_or(given.track, |at| resumed[at].old as u64);
            // a plot that two tracks share is reported for the first of them
            if !std::mem::replace(&mut taken[given.plot as usize], true) {
                advanced = true;
                let status = PlotStatus::of(track, given.is_reflection);
                report(plots[given.plot as usize].index, status);
            }
            let sensor = plots[given.plot as usize].radar;
            if settings.starts_again(sensor) {
                self.doubted[given.plot as usize] = given.false_probability;
            }
            if let Some(radar) = given.outlier {
                sky.noise[radar].outliers.took();
            }
            if confirmed && given.is_doubted {
                self.reflections.doubt(given.plot as usize, track);
            }
            if given.is_still {
                let plot = &plots[given.plot as usize];
                sky.clutter[plot.radar].stays(&settings.radars[plot.radar], plot);
            }
            if let Some(stray) = given.stray {
                sky.noise[stray.radar].outliers.strayed(&stray);
            }
            if let Some(row) = row.filter(|row| row.confirmed) {
                let plot = &plots[given.plot as usize];
                let noise = &mut sky.noise[plot.radar];
                noise.saw(track, plot, settings);
                if row.identities.is_some() {
                    noise.unidentified.saw(!plot.identities.is_some());
                }
            }
            match row {
                Some(row) if track != given.track => {
                    let past = sky.tracks.iter().find(|past| past.number == track);
                    let first_plot = past.map_or(row.first_plot, |past| past.first.index);
                    sky.rows.push(&Row { track: track as i64, first_plot, ..*row });
                }
                Some(row) => sky.rows.push(row),
                None => (),
            }
        });
        // if no plot was taken, another pass would change nothing: hypotheses would leave the same plots
        // again
        advanced && shares.are_wanted()
    }

    /// Starts tracks with the remaining plots. Returns whether some plots were left because they may be of
    /// targets whose tracks were just started: several sensors, or a position sensor alone, may report a
    /// target repeatedly.
    fn begin<R: Rows>(
        &mut self,
        sky: &mut Sky<'_, R>,
        (schedule, origins): (&Schedule, &mut Origins),
        hold: f64,
        report: &mut impl FnMut(usize, PlotStatus),
    ) -> bool {
        let mut left = false;
        let mut now = vec![false; self.plots.len()];
        for (i, plot) in self.plots.iter().enumerate() {
            self.deferred[i] |= !self.taken[i] && plot.time >= hold;
            let radar = &sky.settings.radars[plot.radar];
            let clutter = &sky.clutter[plot.radar];
            let doubt = std::mem::take(&mut self.doubted[i]);
            let is_shared = doubt > DOUBTED && !clutter.is_denser(radar, plot.position);
            if self.taken[i] && !is_shared || self.deferred[i] {
                continue;
            }
            let [density, false_plots] =
                [clutter.density(radar), clutter.plots(radar)].map(|all| plot.rivals(all));
            let begun = |i: usize| now[i];
            if is_near(plot, (&self.around, &self.plots), begun, &self.spread, sky.settings) {
                left = true;
                continue;
            }
            (self.taken[i], now[i]) = (true, !is_shared);
            // second plots and outliers start false tracks, too, where there are any
            let second = self.seconds.of_others(i, |other| self.taken[other]);
            let more = 1.0 + (self.others[i] + second) / density;
            let rare = (false_plots * more, clutter.density(radar), more.ln());
            let number = *sky.next_number;
            let mut track = origins
                .track(number, plot, sky.tracks, rare, sky.settings)
                .unwrap_or_else(|| Track::new(number, plot, rare.0, sky.settings));
            if let Some(expected) = schedule.expected(i, plot, sky.clutter, sky.settings) {
                track.expect(expected, sky.settings);
            }
            if sky.noise[plot.radar].outliers.are_many() {
                track.require_more();
            }
            *sky.next_number += 1;
            let is_double = self.seconds.of_confirmed()[i] + second > density;
            track.believed = density;
            track.suspect(plot, self.reflections.of(i), sky.settings);
            let is_other = is_double || track.is_reflection();
            track.is_counted = !is_other && !clutter.is_fixed(radar, plot);
            if is_shared {
                track.share_first(doubt);
            }
            if track.is_counted && !is_shared {
                sky.clutter[plot.radar].weigh(radar, plot.position);
            }
            let own = PlotStatus::of(track.number, track.is_reflection());
            if !is_shared {
                report(plot.index, if is_double { PlotStatus::Duplicate } else { own });
            }
            if sky.rows.wants(false) {
                sky.rows.push(&Row::of(&track, plot.radar, Some(plot.index)));
            }
            sky.tracks.push(track);
        }
        left
    }
}
