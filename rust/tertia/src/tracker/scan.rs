//! One scan: which plots belong to which tracks.

use super::Row;
use super::clutter::Clutter;
use super::plot::{Fate, Measured};
use super::settings::Settings;
use super::track::Track;
use crate::association::{Assigner, Grid, Pair};
use std::f64::consts::PI;

/// Seconds that a plot may be before or after its beam's usual time, as a share of a scan.
const BEAM: f64 = 0.1;

/// A track that may have been seen by a radar, and the plots that may be of it.
#[derive(Clone, Copy, Debug)]
struct Claim {
    track: usize,
    /// The first of its plots, by which it is joined to others.
    root: usize,
    start: usize,
    end: usize,
}

/// The buffers of a scan.
#[derive(Default)]
pub(super) struct Scan {
    plots: Vec<Measured>,
    /// Plots that may not be taken any more.
    taken: Vec<bool>,
    deferred: Vec<bool>,
    /// The plots of each radar, and their index.
    grids: Vec<(Grid, Vec<usize>)>,
    claims: Vec<Claim>,
    /// Plots of the claims.
    claimed: Vec<usize>,
    /// The lowest plot that this one is joined to.
    joined: Vec<usize>,
    /// The highest.
    last: Vec<usize>,
    pairs: Vec<Pair>,
    columns: Vec<usize>,
    assigner: Assigner,
}

/// What plots can do to the tracks.
pub(super) struct Sky<'a> {
    pub settings: &'a Settings,
    pub tracks: &'a mut Vec<Track>,
    pub clutter: &'a mut [Clutter],
    pub next_number: &'a mut u64,
    pub rows: &'a mut Vec<Row>,
}

impl Scan {
    /// Gives plots, sorted by time, to tracks, and begins tracks with the others. Plots that compete
    /// with one that is not before `hold` wait, but for those before `oldest`: they are returned in
    /// `plots`.
    pub fn process(
        &mut self,
        sky: &mut Sky<'_>,
        plots: &mut Vec<Measured>,
        [oldest, hold]: [f64; 2],
        mut tell: impl FnMut(usize, Fate),
    ) {
        self.load(sky, plots);
        for confirmed in [true, false] {
            self.claim(sky, confirmed);
            self.join();
            self.defer(oldest, hold);
            self.settle(sky, confirmed, &mut tell);
        }
        self.begin(sky, hold, &mut tell);
        plots.clear();
        for (plot, _) in self.plots.iter().zip(&self.deferred).filter(|(_, deferred)| **deferred) {
            plots.push(*plot);
        }
    }

    fn load(&mut self, sky: &mut Sky<'_>, plots: &[Measured]) {
        self.plots.clear();
        self.plots.extend_from_slice(plots);
        self.taken.clear();
        self.taken.resize(plots.len(), false);
        self.deferred.clear();
        self.deferred.resize(plots.len(), false);
        let radars = &sky.settings.radars;
        self.grids.resize_with(radars.len(), Default::default);
        let mut points = vec![Vec::new(); radars.len()];
        for (_, indices) in &mut self.grids {
            indices.clear();
        }
        for (i, plot) in plots.iter().enumerate() {
            points[plot.radar].push(plot.position);
            self.grids[plot.radar].1.push(i);
            sky.clutter[plot.radar].saw(radars[plot.radar].distance(plot.position));
        }
        for ((grid, _), (points, radar)) in self.grids.iter_mut().zip(points.iter().zip(radars)) {
            let far = radar.azimuth_sigma * radar.range_max.min(1e5);
            let cell = 7.0 * (radar.range_sigma + far) + 500.0;
            grid.fill(points, cell).expect("plots are finite");
        }
    }

    /// Finds the plots near each track.
    fn claim(&mut self, sky: &Sky<'_>, confirmed: bool) {
        self.claims.clear();
        self.claimed.clear();
        let (Some(first), Some(last)) = (self.plots.first(), self.plots.last()) else { return };
        let (begin, end) = (first.time, last.time);
        for (index, track) in sky.tracks.iter().enumerate() {
            if track.is_confirmed() != confirmed {
                continue;
            }
            for (radar, (grid, indices)) in self.grids.iter().enumerate() {
                if grid.is_empty() {
                    continue;
                }
                let Some((centre, half)) = reach(track, radar, begin, end, sky.settings) else {
                    continue;
                };
                let start = self.claimed.len();
                grid.within(centre, half, &mut |i| {
                    let plot = indices[i];
                    let free = !self.taken[plot] && !self.deferred[plot];
                    if free && track.is_due(&self.plots[plot], &sky.settings.radars[radar]) {
                        self.claimed.push(plot);
                    }
                });
                let end = self.claimed.len();
                if end > start {
                    self.claimed[start..].sort_unstable();
                    self.claims.push(Claim { track: index, root: 0, start, end });
                }
            }
        }
    }

    /// Joins the plots that the same claims want.
    fn join(&mut self) {
        self.joined.clear();
        self.joined.extend(0..self.plots.len());
        for claim in &self.claims {
            let plots = &self.claimed[claim.start..claim.end];
            for pair in plots.windows(2) {
                unite(&mut self.joined, pair[0], pair[1]);
            }
        }
        self.last.clear();
        self.last.extend(0..self.plots.len());
        for i in 0..self.plots.len() {
            let root = root(&mut self.joined, i);
            self.last[root] = i;
        }
        for claim in &mut self.claims {
            claim.root = root(&mut self.joined, self.claimed[claim.start]);
        }
        self.claims.sort_unstable_by_key(|claim| (claim.root, claim.start));
    }

    /// Lets plots wait that compete with one that is not before `hold`. Older ones than `oldest` do
    /// not: with them a target could be among the plots twice.
    fn defer(&mut self, oldest: f64, hold: f64) {
        for i in 0..self.plots.len() {
            let last = self.last[root(&mut self.joined, i)];
            let waits = self.plots[i].time >= oldest && self.plots[last].time >= hold;
            self.deferred[i] |= !self.taken[i] && waits;
        }
    }

    /// Gives the plots to those that claim them, in the order of time.
    fn settle(&mut self, sky: &mut Sky<'_>, confirmed: bool, tell: &mut impl FnMut(usize, Fate)) {
        let claims = std::mem::take(&mut self.claims);
        for group in claims.chunk_by(|a, b| a.root == b.root) {
            self.settle_group(sky, group, confirmed, tell);
        }
        self.claims = claims;
    }

    fn settle_group(
        &mut self,
        sky: &mut Sky<'_>,
        group: &[Claim],
        confirmed: bool,
        tell: &mut impl FnMut(usize, Fate),
    ) {
        self.pairs.clear();
        self.columns.clear();
        for (row, claim) in group.iter().enumerate() {
            let deferred = &self.deferred;
            let wanted = self.claimed[claim.start..claim.end].iter().filter(|&&i| !deferred[i]);
            let track = &mut sky.tracks[claim.track];
            let radar = self.plots[claim.root].radar;
            let expected = track.expected_by(radar).map_or(f64::NEG_INFINITY, |e| e.time);
            let off = |&&i: &&usize| (self.plots[i].time - expected).abs();
            let Some(&first) = wanted.clone().min_by(|a, b| off(a).total_cmp(&off(b))) else {
                continue;
            };
            let station = &sky.settings.radars[radar];
            let others = sky.clutter[radar].density(station);
            track.predict(self.plots[first].time, station.period, sky.settings);
            for &plot in wanted {
                let Some(gain) = track.score(&self.plots[plot], others, sky.settings) else {
                    continue;
                };
                let column = self.columns.iter().position(|&c| c == plot);
                let column = column.unwrap_or_else(|| {
                    self.columns.push(plot);
                    self.columns.len() - 1
                });
                self.pairs.push(Pair { row: row as u32, column: column as u32, gain });
            }
        }
        let Self { assigner, pairs, columns, .. } = self;
        let choice = assigner.assign(pairs, group.len(), columns.len());
        for (row, (claim, column)) in group.iter().zip(choice).enumerate() {
            if let Some(column) = column {
                let plot = columns[*column as usize];
                self.taken[plot] = true;
                let track = &mut sky.tracks[claim.track];
                if !confirmed {
                    // the score is that against a miss, the evidence that against a false plot
                    let radar = &sky.settings.radars[self.plots[plot].radar];
                    let own = |pair: &&Pair| pair.row == row as u32 && pair.column == *column;
                    let gain = pairs.iter().find(own).map_or(0.0, |pair| pair.gain);
                    track.credit(gain + (1.0 - radar.detection_probability).ln());
                }
                track.correct(&self.plots[plot], sky.settings);
                if !confirmed && track.is_confirmed() {
                    let (radar, time) = track.begun;
                    sky.clutter[radar].discount(time, sky.settings.radars[radar].period);
                }
                tell(self.plots[plot].index, Fate::Track(track.number));
                sky.rows.push(Row::of(track, self.plots[plot].radar, Some(self.plots[plot].index)));
            }
        }
        if confirmed {
            let missed: Vec<usize> =
                (0..group.len()).filter(|&row| choice[row].is_none()).collect();
            for row in missed {
                self.guard(sky, &group[row], tell);
            }
        }
    }

    /// Takes the likeliest plot that is left in the guard gate.
    fn guard(&mut self, sky: &mut Sky<'_>, claim: &Claim, tell: &mut impl FnMut(usize, Fate)) {
        let track = &mut sky.tracks[claim.track];
        let radar = self.plots[claim.root].radar;
        let others = sky.clutter[radar].density(&sky.settings.radars[radar]);
        let free = |&&plot: &&usize| !self.taken[plot] && !self.deferred[plot];
        let left = self.claimed[claim.start..claim.end].iter().filter(free);
        let scores = left.filter_map(|&plot| {
            let (score, accelerated) =
                track.guarded_score(&self.plots[plot], others, sky.settings)?;
            Some((score, plot, accelerated))
        });
        let best = scores.max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)));
        let Some((_, plot, accelerated)) = best.filter(|best| best.0 > 0.0) else { return };
        self.taken[plot] = true;
        if accelerated {
            track.take_guarded(&self.plots[plot], sky.settings);
        } else {
            track.correct(&self.plots[plot], sky.settings);
        }
        tell(self.plots[plot].index, Fate::Track(track.number));
        sky.rows.push(Row::of(track, self.plots[plot].radar, Some(self.plots[plot].index)));
    }

    /// Begins tracks with the plots that are left, and counts them.
    fn begin(&mut self, sky: &mut Sky<'_>, hold: f64, tell: &mut impl FnMut(usize, Fate)) {
        let mut unused = vec![0; sky.settings.radars.len()];
        for (i, plot) in self.plots.iter().enumerate() {
            self.deferred[i] |= !self.taken[i] && plot.time >= hold;
            if self.taken[i] || self.deferred[i] {
                continue;
            }
            unused[plot.radar] += 1;
            let false_plots = sky.clutter[plot.radar].plots(&sky.settings.radars[plot.radar]);
            let track = Track::new(*sky.next_number, plot, false_plots, sky.settings);
            *sky.next_number += 1;
            tell(plot.index, Fate::Track(track.number));
            sky.rows.push(Row::of(&track, plot.radar, Some(plot.index)));
            sky.tracks.push(track);
        }
        let settled = || self.plots.iter().zip(&self.deferred).filter(|(_, d)| !**d);
        let (Some((first, _)), Some((last, _))) = (settled().next(), settled().next_back()) else {
            return;
        };
        for (radar, count) in unused.into_iter().enumerate() {
            let period = sky.settings.radars[radar].period;
            sky.clutter[radar].count(count, [first.time, last.time], period);
        }
    }
}

/// Where plots of the track may be, from `begin` to `end`; none where the radar does not come.
fn reach(
    track: &Track,
    radar: usize,
    begin: f64,
    end: f64,
    settings: &Settings,
) -> Option<([f64; 2], [f64; 2])> {
    let station = &settings.radars[radar];
    let (time, slack) = match track.expected_by(radar) {
        Some(expected) => {
            // near the radar the beam comes earlier or later
            let moved = settings.speed_max * (begin - expected.seen).max(station.period);
            let swing = (moved / (PI * station.distance(track.estimate.position()))).min(0.5);
            let late = (settings.patience + swing) * station.period;
            // the scan in which the radar comes between begin and end
            let scans = ((begin - late - expected.time) / station.period).ceil().max(0.0);
            let time = expected.time + scans * station.period;
            if time > end + late {
                return None;
            }
            (time.clamp(begin, end), (BEAM + swing) * station.period)
        }
        None => (0.5 * (begin + end), 0.5 * (end - begin)),
    };
    let (centre, covariance) = track.position_at(time);
    let noise = station.noise_at(centre, track.height() - station.position[2]);
    let speed = track.estimate.mean[2].abs() + track.estimate.mean[3].abs();
    let (wide, margin) = track.reach(time, settings);
    let more = margin + speed * slack;
    // no target is farther than it can have flown
    let flown = 2.0 * settings.speed_max * (time - track.seen).abs().max(station.period);
    let half = |variance: f64, noise: f64| {
        let most = flown + (settings.guard * noise).sqrt();
        ((settings.guard * (variance + noise + wide)).sqrt() + more).min(most)
    };
    let half = [half(covariance.xx, noise.xx), half(covariance.yy, noise.yy)];
    let nearest = station.distance(centre) - half[0] - half[1];
    (nearest <= station.range_max).then_some((centre, half))
}

fn root(joined: &mut [usize], mut i: usize) -> usize {
    while joined[i] != i {
        joined[i] = joined[joined[i]];
        i = joined[i];
    }
    i
}

fn unite(joined: &mut [usize], a: usize, b: usize) {
    let (a, b) = (root(joined, a), root(joined, b));
    joined[a.max(b)] = a.min(b);
}
