//! Groups whose plots are uncertain: joint events, and the states of tracks that follow from them.

use super::{Share, View};
use crate::association::Pair;
use crate::association::event::{Event, Limits, Unresolved};
use crate::association::events::events;
use crate::tracker::assignment::claim::Claim;
use crate::tracker::assignment::cluster::Cluster;
use crate::tracker::filter::resolution::Separation;
use crate::tracker::settings::mht::Mht;
use crate::tracker::track::Track;
use crate::tracker::track::tree::{Leaf, Tree};

mod grow;
#[cfg(test)]
mod tests;

/// What a track takes in an event.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Taken {
    Nothing,
    Plot(u32),
    /// A plot in the guard gate.
    Guarded(u32),
    /// A plot that also belongs to another row of the part, with the index of this row.
    Shared(u32, usize),
}

impl Taken {
    fn plot(self) -> Option<u32> {
        match self {
            Self::Nothing => None,
            Self::Plot(plot) | Self::Guarded(plot) | Self::Shared(plot, _) => Some(plot),
        }
    }
}

/// A state of a track, and the gains of plots in this state, by column.
struct Scored {
    id: u32,
    gains: Vec<(u32, f64)>,
}

/// A hypothesis after an event.
struct Survivor {
    weight: f64,
    /// Index of the hypothesis from which it follows.
    parent: usize,
    taken: Vec<Taken>,
}

/// Tracks that compete, their hypotheses, and the hypotheses that may follow.
pub(in crate::tracker) struct Doubt {
    /// Claims of these tracks, by index in the group.
    rows: Vec<usize>,
    /// Places of these tracks in the cluster.
    members: Vec<usize>,
    states: Vec<Vec<Scored>>,
    cluster: Cluster,
    survivors: Vec<Survivor>,
    limits: Mht,
}

impl Share {
    /// Returns the parts of a group that have more than one likely event, or had more than one
    /// hypothesis before; removes their pairs.
    pub fn doubt(
        &mut self,
        group: &[Claim],
        tracks: &mut [&mut Track],
        view: View<'_>,
        limits: Mht,
    ) -> Vec<Doubt> {
        if let [claim] = group
            && tracks[claim.track as usize].tree.is_none()
            && self.is_certain(limits.cut)
        {
            return Vec::new();
        }
        let mut states = self.states(group, tracks, view);
        self.fetch(group, tracks, view);
        let mut doubts = Vec::new();
        for rows in self.parts(group, tracks, &states, view) {
            let own = rows.iter().map(|&row| std::mem::take(&mut states[row])).collect();
            doubts.extend(self.doubt_of((rows, own), group, tracks, view, limits));
        }
        for doubt in &doubts {
            self.pairs.retain(|pair| !doubt.rows.contains(&(pair.row as usize)));
        }
        doubts
    }

    /// Whether the plot of the only track of a group is certain, or it is certain that it has none.
    fn is_certain(&self, cut: f64) -> bool {
        let (mut best, mut second) = (0.0, f64::NEG_INFINITY);
        for pair in self.pairs.iter().filter(|pair| pair.gain.is_finite()) {
            if pair.gain > best {
                (best, second) = (pair.gain, best);
            } else {
                second = f64::max(second, pair.gain.max(0.0));
            }
        }
        second < best - cut
    }

    /// All states of the tracks of a group, predicted to the time of their plots, with the gains of
    /// the plots.
    fn states(
        &mut self,
        group: &[Claim],
        tracks: &mut [&mut Track],
        View { plots, claimed, deferred, settings, rates, .. }: View<'_>,
    ) -> Vec<Vec<Scored>> {
        let radar = plots[group[0].root as usize].radar;
        let station = &settings.radars[radar];
        let odds = rates.odds[radar];
        let mut states = Vec::with_capacity(group.len());
        for (row, claim) in group.iter().enumerate() {
            let track = &mut *tracks[claim.track as usize];
            let own = self.pairs.iter().filter(|pair| pair.row as usize == row);
            let gains = own.map(|pair| (pair.column, pair.gain)).collect();
            let id = track.tree.as_ref().map_or(0, |tree| tree.own.id);
            let mut scored = vec![Scored { id, gains }];
            let time = track.time;
            for Leaf { branch, track: leaf, .. } in track.alternatives_mut() {
                leaf.predict(time, settings.pace(radar), settings);
                let mut gains = Vec::new();
                for &plot in claim.plots(claimed).filter(|&&i| !deferred[i as usize]) {
                    let measured = &plots[plot as usize];
                    if !leaf.is_due(measured, station) {
                        continue;
                    }
                    if let Some(gain) = leaf.score(measured, odds, settings) {
                        gains.push((self.columns.number(plot), gain));
                    }
                }
                scored.push(Scored { id: branch.id, gains });
            }
            states.push(scored);
        }
        states
    }

    /// Fetches the clusters of the tracks.
    fn fetch(&mut self, group: &[Claim], tracks: &[&mut Track], view: View<'_>) {
        for claim in group {
            let track = &tracks[claim.track as usize];
            if track.tree.is_some() && self.cluster_of(track).is_none() {
                self.clusters.extend(view.cells.take(track.number));
            }
        }
    }

    fn cluster_of(&self, track: &Track) -> Option<usize> {
        self.clusters.iter().position(|cluster| cluster.members.contains(&track.number))
    }

    /// Parts of a group whose rows compete for plots in their gates or depend on one another. Rows
    /// without plots and without other states are left out.
    fn parts(
        &self,
        group: &[Claim],
        tracks: &[&mut Track],
        states: &[Vec<Scored>],
        view: View<'_>,
    ) -> Vec<Vec<usize>> {
        let mut part: Vec<usize> = (0..group.len()).collect();
        let unite = |part: &mut Vec<usize>, a: usize, b: usize| {
            let (a, b) = (part[a], part[b]);
            part.iter_mut().filter(|own| **own == a.max(b)).for_each(|own| *own = a.min(b));
        };
        let mut of_column: Vec<Option<usize>> = vec![None; self.columns.len()];
        let mut of_cluster: Vec<Option<usize>> = vec![None; self.clusters.len()];
        for (row, claim) in group.iter().enumerate() {
            for &(column, gain) in states[row].iter().flat_map(|state| &state.gains) {
                if gain > 0.0 && gain.is_finite() {
                    let first = *of_column[column as usize].get_or_insert(row);
                    unite(&mut part, first, row);
                }
            }
            if let Some(cluster) = self.cluster_of(tracks[claim.track as usize]) {
                let first = *of_cluster[cluster].get_or_insert(row);
                unite(&mut part, first, row);
            }
        }
        let radar = &view.settings.radars[view.plots[group[0].root as usize].radar];
        if radar.resolution.is_some() {
            let own = |row: usize| &tracks[group[row].track as usize].estimate;
            for second in 1..group.len() {
                for first in 0..second {
                    if Separation::of(own(first), own(second), radar).is_some() {
                        unite(&mut part, first, second);
                    }
                }
            }
        }
        let rows_of = |first: usize| (0..group.len()).filter(|&row| part[row] == first).collect();
        let firsts = (0..group.len()).filter(|&row| part[row] == row);
        let parts: Vec<Vec<usize>> = firsts.map(rows_of).collect();
        let counts = |rows: &Vec<usize>| {
            rows.iter().any(|&row| states[row].len() > 1 || !states[row][0].gains.is_empty())
        };
        parts.into_iter().filter(counts).collect()
    }

    /// The likely events of a part; none if there is only one event and there was only one
    /// hypothesis before.
    fn doubt_of(
        &mut self,
        (rows, states): (Vec<usize>, Vec<Vec<Scored>>),
        group: &[Claim],
        tracks: &[&mut Track],
        view: View<'_>,
        limits: Mht,
    ) -> Option<Doubt> {
        let track = |row: usize| &*tracks[group[row].track as usize];
        let mut cluster: Option<Cluster> = None;
        for &row in &rows {
            let track = track(row);
            if cluster.as_ref().is_some_and(|cluster| cluster.members.contains(&track.number)) {
                continue;
            }
            let found = self.cluster_of(track).map(|at| self.clusters.remove(at));
            let own = found.unwrap_or_else(|| Cluster::of(track));
            cluster = Some(match cluster {
                Some(cluster) => cluster.times(&own, &limits),
                None => own,
            });
        }
        let cluster = cluster?;
        let place =
            |row: &usize| cluster.members.iter().position(|number| *number == track(*row).number);
        let members: Vec<usize> = rows.iter().filter_map(place).collect();
        let was_certain = cluster.hypotheses.len() == 1;
        let mut doubt = Doubt { rows, members, states, cluster, survivors: Vec::new(), limits };
        let merges = self.survive(&mut doubt, group, tracks, view);
        (doubt.survivors.len() > 1 || !was_certain || merges).then_some(doubt)
    }

    /// Finds the likeliest events of all hypotheses; returns whether there are rows that the radar
    /// may not have resolved.
    fn survive(
        &mut self,
        doubt: &mut Doubt,
        group: &[Claim],
        tracks: &[&mut Track],
        view: View<'_>,
    ) -> bool {
        let Mht { max_hypotheses, cut, .. } = doubt.limits;
        let limits = Limits { count: max_hypotheses, cut };
        // many hypotheses have the same states of these tracks
        let mut known: Vec<(Vec<u32>, Vec<Event>)> = Vec::new();
        let mut survivors = Vec::new();
        let mut merges = false;
        for (parent, hypothesis) in doubt.cluster.hypotheses.iter().enumerate() {
            let ids: Vec<u32> = doubt.members.iter().map(|&i| hypothesis.states[i]).collect();
            let at = known.iter().position(|(other, _)| *other == ids).unwrap_or_else(|| {
                let pairs = doubt.pairs(&ids);
                let close = self.unresolved(doubt, &ids, group, tracks, view);
                merges |= !close.is_empty();
                let found = events(&pairs, ids.len(), &close, limits, &mut self.assigner);
                known.push((ids, found));
                known.len() - 1
            });
            survivors.extend(known[at].1.iter().map(|event| {
                let taken = |(row, column): (usize, &Option<u32>)| {
                    let Some(c) = *column else { return Taken::Nothing };
                    let plot = self.columns.plot(c);
                    let same = |other: &usize| *other != row && event.columns[*other] == *column;
                    let other = (0..event.columns.len()).find(same);
                    other.map_or(Taken::Plot(plot), |other| Taken::Shared(plot, other))
                };
                let taken = event.columns.iter().enumerate().map(taken).collect();
                Survivor { weight: hypothesis.weight + event.gain, parent, taken }
            }));
        }
        doubt.survivors = survivors;
        doubt.prune();
        merges
    }

    /// Pairs of rows that the radar may not have resolved, in these states, and the gain of a
    /// common plot.
    fn unresolved(
        &self,
        doubt: &Doubt,
        ids: &[u32],
        group: &[Claim],
        tracks: &[&mut Track],
        view: View<'_>,
    ) -> Vec<Unresolved> {
        let View { plots, claimed, deferred, settings, rates, .. } = view;
        let number = plots[group[0].root as usize].radar;
        let radar = &settings.radars[number];
        if radar.resolution.is_none() {
            return Vec::new();
        }
        let odds = rates.odds[number];
        let state = |i: usize| tracks[group[doubt.rows[i]].track as usize].state(ids[i]);
        let mut found = Vec::new();
        for (second, &row) in doubt.rows.iter().enumerate() {
            for first in 0..second {
                let (a, b) = (state(first), state(second));
                let Some(pair) = Separation::of(&a.estimate, &b.estimate, radar) else { continue };
                let gain = |&plot: &u32| {
                    let measured = &plots[plot as usize];
                    let due = a.is_due(measured, radar) && b.is_due(measured, radar);
                    let column = self.columns.of(plot)?;
                    let gain = a.shared_score(b, measured, odds, settings).filter(|_| due)?;
                    Some((column, gain))
                };
                let wanted = group[row].plots(claimed).filter(|&&i| !deferred[i as usize]);
                found.push(Unresolved {
                    first: first as u32,
                    second: second as u32,
                    resolved: pair.resolved(),
                    missed: pair.missed(radar),
                    shared: wanted.filter_map(gain).collect(),
                });
            }
        }
        found
    }

    /// Corrects the tracks of a part in all its hypotheses, and shows the states of the best one.
    pub fn decide(
        &mut self,
        mut doubt: Doubt,
        group: &[Claim],
        tracks: &mut [&mut Track],
        view: View<'_>,
        with_rows: bool,
    ) {
        self.guard_all(&mut doubt, group, tracks, view);
        doubt.prune();
        let best: Vec<Taken> = doubt.survivors[0].taken.clone();
        let grown = doubt.grow(group, tracks, view);
        let mut cluster = doubt.hypotheses(&grown);
        let mut varies = vec![true; cluster.members.len()];
        let radar = view.plots[group[0].root as usize].radar;
        for ((&row, &member), (states, taken)) in
            doubt.rows.iter().zip(&doubt.members).zip(grown.states.into_iter().zip(best))
        {
            let probability = cluster.probability(member, 0);
            let mut states = states.into_iter();
            let Some(Leaf { branch: own, track: shown, .. }) = states.next() else { continue };
            let likely = |leaf: Leaf<Track>| {
                let probability = cluster.probability(member, leaf.branch.id);
                Leaf { probability, ..leaf }
            };
            let others: Vec<Leaf<Track>> = states.map(likely).collect();
            varies[member] = !others.is_empty();
            let claim = &group[row];
            let track = &mut *tracks[claim.track as usize];
            *track = shown;
            track.tree = varies[member].then(|| Box::new(Tree { own, others, probability }));
            self.choice[row] = taken.plot();
            taken.plot().into_iter().for_each(|plot| self.columns.take(plot));
            self.settled[row] = true;
            let Some(plot) = taken.plot() else { continue };
            let after = if matches!(taken, Taken::Guarded(..)) { group.len() } else { 0 };
            let place = group[0].rank + claim.rank + after as u32;
            let measured = &view.plots[plot as usize];
            debug_assert_eq!(measured.radar, radar);
            self.give(
                place,
                plot,
                track,
                measured,
                with_rows || track.is_confirmed(),
                (false, None, None),
            );
        }
        if varies.contains(&false) {
            cluster.keep(&varies);
        }
        if !cluster.members.is_empty() {
            self.clusters.push(cluster);
        }
    }

    /// Gives tracks without a plot the likeliest remaining plot in the guard gate, in each
    /// hypothesis.
    fn guard_all(
        &self,
        doubt: &mut Doubt,
        group: &[Claim],
        tracks: &[&mut Track],
        View { plots, claimed, deferred, settings, rates, .. }: View<'_>,
    ) {
        let radar = plots[group[0].root as usize].radar;
        let station = &settings.radars[radar];
        let odds = rates.odds[radar];
        for survivor in &mut doubt.survivors {
            for (i, &row) in doubt.rows.iter().enumerate() {
                if survivor.taken[i] != Taken::Nothing {
                    continue;
                }
                let id = doubt.cluster.hypotheses[survivor.parent].states[doubt.members[i]];
                let state = tracks[group[row].track as usize].state(id);
                let scored = doubt.states[i].iter().find(|state| state.id == id);
                let is_gated = |plot: u32| {
                    let gains = scored.map_or(&[][..], |state| &state.gains);
                    gains.iter().any(|&(c, gain)| self.columns.plot(c) == plot && gain > 0.0)
                };
                let free = |&&plot: &&u32| {
                    !deferred[plot as usize]
                        && !self.columns.is_taken(plot)
                        && !survivor.taken.iter().any(|taken| taken.plot() == Some(plot))
                        && !is_gated(plot)
                        && state.is_due(&plots[plot as usize], station)
                };
                let candidates = group[row].plots(claimed).filter(free);
                let scores = candidates.filter_map(|&plot| {
                    let measured = &plots[plot as usize];
                    let surprise = state.guarded_score(measured, odds, settings)?;
                    Some((surprise.gain, plot))
                });
                let best = scores.max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)));
                if let Some((score, plot)) = best.filter(|best| best.0 > 0.0) {
                    survivor.taken[i] = Taken::Guarded(plot);
                    survivor.weight += score;
                }
            }
        }
    }

    /// Ends a component: its clusters are settled.
    pub fn finish(&mut self) {
        self.closed.append(&mut self.clusters);
    }
}

impl Doubt {
    /// The pairs of rows and plots for these states, one per row.
    fn pairs(&self, ids: &[u32]) -> Vec<Pair> {
        let rows = self.states.iter().zip(ids).enumerate();
        let own = rows.filter_map(|(row, (states, id))| {
            Some((row as u32, states.iter().find(|state| state.id == *id)?))
        });
        own.flat_map(|(row, state)| {
            state.gains.iter().map(move |&(column, gain)| Pair { row, column, gain })
        })
        .collect()
    }

    /// Keeps the best survivors, within the limits.
    fn prune(&mut self) {
        let Self { survivors, limits, .. } = self;
        survivors.sort_by(|a, b| b.weight.total_cmp(&a.weight));
        let best = survivors.first().map_or(0.0, |first| first.weight);
        survivors.retain(|survivor| survivor.weight >= best - limits.cut);
        survivors.truncate(limits.max_hypotheses);
        survivors.iter_mut().for_each(|survivor| survivor.weight -= best);
    }
}
