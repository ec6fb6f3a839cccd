//! The part of a scan that one thread processes, and its results.

use super::claim::{Around, Claim, Spread, reach};
use super::cluster::Cluster;
use super::prefetch::TOGETHER;
use crate::association::{Assigner, Pair, is_inside};
use crate::base::batch::{SHARES_PER_THREAD, for_each_part};
use crate::tracker::noise::outliers::Stray;
use crate::tracker::plot::Measured;
use crate::tracker::rows::row::Row;
use crate::tracker::settings::Settings;
use crate::tracker::track::Track;
use std::hint::black_box;

mod columns;
mod doubt;
mod view;

use columns::Columns;
use view::Given;
pub(in crate::tracker) use view::{Rates, View};

/// Index that stands for no result, or for no row.
const NOTHING: u32 = u32::MAX;
/// Corners of an empty box.
const NOWHERE: ([f64; 2], [f64; 2]) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);

/// A part of the work, which one thread does at a time, and its buffers.
#[derive(Default)]
pub(in crate::tracker) struct Share {
    claims: Vec<Claim>,
    claimed: Vec<u32>,
    /// Radars and indices of plots near a track.
    near: Vec<(u32, u32)>,
    /// The same before it is known which of them are free and due.
    inside: Vec<(u32, u32)>,
    /// Where each radar may have seen a track: lower left and upper right corner.
    boxes: Vec<([f64; 2], [f64; 2])>,
    pairs: Vec<Pair>,
    columns: Columns,
    /// The plot chosen for each claim of a group.
    choice: Vec<Option<u32>>,
    /// Whether each claim of a group was settled by hypotheses.
    settled: Vec<bool>,
    /// Clusters of the current component, and of all components that are settled.
    clusters: Vec<Cluster>,
    closed: Vec<Cluster>,
    assigner: Assigner,
    given: Vec<Given>,
    /// Plots of sensors of positions that tracks would take and have not taken.
    wanted: Vec<u32>,
    rows: Vec<Row>,
}

impl Share {
    /// Claims the free plots near any state of a track.
    pub fn look(
        &mut self,
        (index, track): (usize, &Track),
        times: (f64, f64),
        settings: &Settings,
        around: Around<'_>,
        spread: &Spread,
        free: impl Fn(u32) -> bool,
    ) {
        self.near.clear();
        self.find(track, times, settings, around, spread, &free);
        for leaf in track.alternatives() {
            self.find(&leaf.track, times, settings, around, spread, &free);
        }
        if let Some(state) = track.forked() {
            self.find(state, times, settings, around, spread, &free);
        }
        self.claim(index);
    }

    /// Adds the free plots near a state of a track, sorted by radar and index.
    fn find(
        &mut self,
        track: &Track,
        times: (f64, f64),
        settings: &Settings,
        Around { grid, plots, times: of_plots }: Around<'_>,
        spread: &Spread,
        free: impl Fn(u32) -> bool,
    ) {
        let Self { near, inside, boxes, .. } = self;
        boxes.clear();
        let (mut low, mut high) = NOWHERE;
        let known = (track.height(), track.unseen(settings));
        for radar in 0..settings.radars.len() {
            let found = reach(track, radar, times, known, settings, spread);
            let (own_low, own_high) = found.map_or(NOWHERE, |(centre, half)| {
                ([0, 1].map(|i| centre[i] - half[i]), [0, 1].map(|i| centre[i] + half[i]))
            });
            low = [0, 1].map(|i| f64::min(low[i], own_low[i]));
            high = [0, 1].map(|i| f64::max(high[i], own_high[i]));
            boxes.push((own_low, own_high));
        }
        if low[0] > high[0] {
            return;
        }
        let (found, mut end) = (near.len(), 0);
        grid.ranges(low, high, &mut |range| {
            let entries = &grid.all()[range];
            if inside.len() < end + entries.len() {
                inside.resize(end + entries.len(), (0, 0));
            }
            // most entries are outside: their plots are not read, and the loop has no branches
            for entry in entries {
                let (low, high) = boxes[entry.tag as usize];
                inside[end] = (entry.tag, entry.index);
                end += usize::from(is_inside(entry.point, low, high));
            }
        });
        let is_due = |radar: usize, plot: u32| {
            let (time, period) = (of_plots[plot as usize], settings.radars[radar].scan_period);
            settings.geometry(radar).is_position() || track.is_due_at(time, radar, period)
        };
        let found_now = inside[..end].iter().copied();
        near.extend(found_now.filter(|&(radar, i)| free(i) && is_due(radar as usize, i)));
        if track.may_refuse(settings) {
            // each plot is a wait for memory, and waits together take no longer than one
            near[found..].iter().for_each(|&(_, i)| _ = black_box(plots[i as usize].touched()));
            let mut index = 0;
            near.retain(|&(_, i)| {
                index += 1;
                index <= found || !track.refuses(&plots[i as usize], settings)
            });
        }
        if near.len() > 1 {
            near.sort_unstable();
            near.dedup();
        }
    }

    /// Claims the plots that were found near a track, separately for each radar.
    fn claim(&mut self, track: usize) {
        for own in self.near.chunk_by(|a, b| a.0 == b.0) {
            let start = self.claimed.len();
            self.claimed.extend(own.iter().map(|&(_, plot)| plot));
            self.claims.push(Claim::new(track, start, self.claimed.len()));
        }
    }

    /// Predicts the tracks of a group to the time of their plots, and scores the pairs of tracks
    /// and plots.
    pub fn group(&mut self, group: &[Claim], tracks: &mut [&mut Track], view: View<'_>) {
        let View { plots, claimed, deferred, settings, rates, .. } = view;
        self.pairs.clear();
        self.columns.clear(plots.len());
        self.choice.clear();
        self.choice.resize(group.len(), None);
        self.settled.clear();
        self.settled.resize(group.len(), false);
        let radar = plots[group[0].root as usize].radar;
        let station = &settings.radars[radar];
        let odds = rates.odds[radar];
        for (row, claim) in group.iter().enumerate() {
            let wanted = claim.plots(claimed).filter(|&&i| !deferred[i as usize]);
            let track = &mut *tracks[claim.track as usize];
            let expected = track.expected_by(radar).map_or(f64::NEG_INFINITY, |e| e.time);
            let off = |&&i: &&u32| (plots[i as usize].time - expected).abs();
            let Some(&first) = wanted.clone().min_by(|a, b| off(a).total_cmp(&off(b))) else {
                continue;
            };
            track.predict(plots[first as usize].time, settings.pace(radar), settings);
            for &plot in wanted {
                let is_sure = track.tree.is_none() && track.forked().is_none();
                if !is_sure && !track.is_due(&plots[plot as usize], station) {
                    continue;
                }
                let Some(gain) = track.best_score(&plots[plot as usize], odds, settings) else {
                    continue;
                };
                let column = self.columns.number(plot);
                self.pairs.push(Pair { row: row as u32, column, gain });
            }
        }
    }

    /// Chooses a plot for each claim.
    pub fn assign(&mut self) {
        let Self { pairs, columns, choice, assigner, .. } = self;
        if let [own] = &mut choice[..] {
            // no other track claims these plots
            let mut best = 0.0;
            for pair in pairs.iter().filter(|pair| pair.gain.is_finite()) {
                if pair.gain > best {
                    (best, *own) = (pair.gain, Some(columns.plot(pair.column)));
                }
            }
        } else {
            let found = assigner.assign(pairs, choice.len(), columns.len());
            for (own, column) in choice.iter_mut().zip(found) {
                *own = column.map(|column| columns.plot(column));
            }
        }
        for &plot in choice.iter().flatten() {
            columns.take(plot);
        }
    }

    /// Notes the plots of sensors of positions that tracks would also have taken: a target may
    /// report several times before each radar has seen it once.
    pub fn note_wanted(&mut self) {
        for pair in self.pairs.iter().filter(|pair| pair.gain > 0.0) {
            let plot = self.columns.plot(pair.column);
            if !self.columns.is_taken(plot) {
                self.wanted.push(plot);
            }
        }
    }

    /// Corrects the tracks by their plots.
    pub fn correct(
        &mut self,
        group: &[Claim],
        tracks: &mut [&mut Track],
        view: View<'_>,
        (confirmed, with_rows): (bool, bool),
    ) {
        let View { plots, settings, others, seconds, reflections, rates, .. } = view;
        let mut own = 0;
        for (row, claim) in group.iter().enumerate() {
            let pairs = &self.pairs[own..]; // sorted by row
            let end = pairs.iter().take_while(|pair| pair.row as usize <= row).count();
            own += end;
            let Some(plot) = self.choice[row].filter(|_| !self.settled[row]) else { continue };
            let measured = &plots[plot as usize];
            let number = |row: usize| tracks[group[row].track as usize].number;
            let is_older = |other: &usize| number(*other) < number(row);
            let is_first = |plot: usize| {
                let taker = self.choice.iter().position(|c| *c == Some(plot as u32));
                taker.as_ref().is_some_and(is_older)
            };
            let second = if confirmed { 0.0 } else { seconds.of_others(plot as usize, is_first) };
            let track = &mut *tracks[claim.track as usize];
            let radar = &settings.radars[measured.radar];
            let stray = track.gone_on(measured, settings);
            let outlier = track.decide(measured, settings);
            if track.is_due(measured, radar) {
                let taken = |pair: &&Pair| self.columns.plot(pair.column) == plot;
                let gain = pairs[..end].iter().find(taken).map_or(0.0, |pair| pair.gain);
                let density = rates.density[measured.radar];
                let other = || (others[plot as usize] + second) / measured.rivals(density);
                let others = if confirmed { 0.0 } else { (1.0 + other()).ln() };
                let gain = track.evidence_of(measured, gain, density, settings);
                track.credit(gain, others, measured.radar, settings);
                track.stand(measured, density, (view.clutter, view.noise), settings);
            }
            if !confirmed {
                let reflections = reflections.of(plot as usize);
                track.wait_for(reflections);
                track.suspect(measured, reflections, settings);
            }
            track.correct(measured, settings);
            let with_row = with_rows || track.is_confirmed();
            let begun = !confirmed && track.is_confirmed();
            let place = group[0].rank + claim.rank;
            self.give(place, plot, track, measured, with_row, (begun, outlier, stray));
        }
    }

    /// Gives tracks without a plot the likeliest remaining plot in the guard gate.
    pub fn guard(&mut self, group: &[Claim], tracks: &mut [&mut Track], view: View<'_>) {
        let View { plots, claimed, deferred, settings, rates, noise, .. } = view;
        for row in 0..group.len() {
            if self.choice[row].is_some() || self.settled[row] {
                continue;
            }
            let claim = &group[row];
            let track = &mut *tracks[claim.track as usize];
            let radar = plots[claim.root as usize].radar;
            let (density, odds) = (rates.density[radar], rates.odds[radar]);
            let free = |&&plot: &&u32| !deferred[plot as usize] && !self.columns.is_taken(plot);
            let scores = claim.plots(claimed).filter(free).filter_map(|&plot| {
                let measured = &plots[plot as usize];
                track.guarded_score(measured, odds, settings).map(|surprise| (surprise, plot))
            });
            let best = scores.max_by(|a, b| a.0.gain.total_cmp(&b.0.gain).then(b.1.cmp(&a.1)));
            let Some((surprise, plot)) = best.filter(|best| best.0.gain > 0.0) else {
                continue;
            };
            let measured = &plots[plot as usize];
            let evidence = track.evidence_of(measured, surprise.gain, density, settings);
            let outliers = &noise[radar].outliers;
            if !track.take_or_fork(measured, &surprise, outliers, settings) {
                continue;
            }
            self.choice[row] = Some(plot);
            self.columns.take(plot);
            track.credit(evidence, 0.0, radar, settings);
            let place = group[0].rank + claim.rank + group.len() as u32;
            self.give(place, plot, track, measured, true, (false, None, None));
        }
    }

    fn give(
        &mut self,
        place: u32,
        plot: u32,
        track: &Track,
        measured: &Measured,
        with_row: bool,
        (begun, outlier, stray): (bool, Option<usize>, Option<Stray>),
    ) {
        let row = if with_row { self.rows.len() as u32 } else { NOTHING };
        if with_row {
            self.rows.push(Row::of(track, measured.radar, Some(measured.index)));
        }
        let (number, is_still) = (track.number, !track.moved && track.is_confirmed());
        let (is_reflection, is_doubted) = (track.is_reflection(), track.is_doubted());
        self.given.push(Given {
            place,
            plot,
            track: number,
            begun,
            outlier,
            stray,
            is_still,
            is_reflection,
            is_doubted,
            false_probability: track.false_probability(),
            row,
        });
    }

    /// Clears the results.
    fn clear(&mut self) {
        self.claims.clear();
        self.claimed.clear();
        self.given.clear();
        self.wanted.clear();
        self.rows.clear();
        self.closed.clear();
    }
}

/// All shares.
#[derive(Default)]
pub(in crate::tracker) struct Shares {
    shares: Vec<Share>,
    /// The share of the result for each place, and the index of the result in this share.
    places: Vec<(u32, u32)>,
}

impl Shares {
    /// Removes and returns the clusters of all shares.
    pub fn clusters(&mut self) -> impl Iterator<Item = Cluster> {
        self.shares.iter_mut().flat_map(|share| share.closed.drain(..))
    }

    fn ready(&mut self, threads: usize) -> &mut [Share] {
        let count = if threads > 1 { threads * SHARES_PER_THREAD } else { 1 };
        self.shares.resize_with(count, Share::default);
        self.shares.iter_mut().for_each(Share::clear);
        &mut self.shares
    }

    /// Calls `look` for each share with its tracks and the index of the first of them.
    pub fn look(
        &mut self,
        threads: usize,
        tracks: &[Track],
        look: impl Fn(&mut Share, usize, &[Track]) + Sync,
    ) {
        let shares = self.ready(threads);
        let size = tracks.len().div_ceil(shares.len()).max(1);
        let parts: Vec<_> = tracks.chunks(size).enumerate().zip(shares).collect();
        for_each_part(threads, parts, |((index, tracks), share)| look(share, index * size, tracks));
    }

    /// The claims of all shares, one after the other.
    pub fn collect(&self, claims: &mut Vec<Claim>, claimed: &mut Vec<u32>) {
        for share in &self.shares {
            let offset = claimed.len() as u32;
            claimed.extend_from_slice(&share.claimed);
            claims.extend(share.claims.iter().map(|claim| Claim {
                start: claim.start + offset,
                end: claim.end + offset,
                ..*claim
            }));
        }
    }

    /// Calls `work` with the claims of each share and their tracks; claims for which `same` holds
    /// stay together. Claims and tracks are sorted accordingly.
    pub fn settle(
        &mut self,
        threads: usize,
        claims: &mut [Claim],
        tracks: &mut [&mut Track],
        same: impl Fn(&Claim, &Claim) -> bool,
        work: impl Fn(&mut Share, &[Claim], &mut [&mut Track]) + Sync,
    ) {
        let shares = self.ready(threads);
        let size = claims.len().div_ceil(shares.len()).max(1);
        let mut parts = Vec::with_capacity(shares.len());
        let (mut claims, mut tracks) = (claims, tracks);
        for share in shares {
            let mut count = size.min(claims.len());
            while 0 < count && count < claims.len() && same(&claims[count - 1], &claims[count]) {
                count += 1;
            }
            let (mine, rest) = claims.split_at_mut(count);
            let first = mine.iter().map(|claim| claim.track).min().unwrap_or(0);
            let end = mine.iter().map(|claim| claim.track + 1).max().unwrap_or(0);
            mine.iter_mut().for_each(|claim| claim.track -= first);
            let (own, others) = tracks.split_at_mut((end - first) as usize);
            parts.push((&*mine, own, share));
            (claims, tracks) = (rest, others);
        }
        for_each_part(threads, parts, |(claims, tracks, share)| work(share, claims, tracks));
    }

    /// Numbers of the tracks that were confirmed, sorted.
    pub fn confirmed(&self) -> Vec<u64> {
        let given = self.shares.iter().flat_map(|share| &share.given);
        let mut numbers: Vec<u64> =
            given.filter(|given| given.begun).map(|given| given.track).collect();
        numbers.sort_unstable();
        numbers
    }

    /// Whether plots of sensors of positions are left that tracks would take.
    pub fn are_wanted(&self) -> bool {
        self.shares.iter().any(|share| !share.wanted.is_empty())
    }

    /// Calls `report` with every assigned plot and its row, in the order of groups.
    pub fn report(&mut self, claims: usize, mut report: impl FnMut(&Given, Option<&Row>)) {
        self.places.clear();
        self.places.resize(2 * claims, (NOTHING, NOTHING));
        for (index, share) in self.shares.iter().enumerate() {
            for (i, given) in share.given.iter().enumerate() {
                self.places[given.place as usize] = (index as u32, i as u32);
            }
        }
        for places in self.places.chunks(TOGETHER) {
            let found = || places.iter().filter_map(|&(index, i)| self.at(index, i));
            // rows are in the order of components: each is a cache miss, and misses that overlap
            // take no longer than one
            found().for_each(|(_, row)| _ = black_box(row.map(Row::touched)));
            found().for_each(|(given, row)| report(given, row));
        }
    }

    /// A result and its row; none if there is no such result.
    fn at(&self, share: u32, index: u32) -> Option<(&Given, Option<&Row>)> {
        let share = self.shares.get(share as usize)?;
        let given = &share.given[index as usize];
        Some((given, share.rows.get(given.row as usize)))
    }
}
