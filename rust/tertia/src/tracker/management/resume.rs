//! Tracks that are continued under their old number: after a gap, by their identity, or after a
//! manoeuvre that left all gates.

use super::ended_tracks::{Ended, REMEMBERED, Spot, Stretch};
use crate::association::Grid;
use crate::sensors::{Identities, IdentityKind};
use crate::tracker::noise::Noise;
use crate::tracker::rows::row::Resumed;
use crate::tracker::settings::Settings;
use crate::tracker::track::{SOONEST, Track};
use std::cell::OnceCell;

/// Largest acceleration of an aircraft, m/s²: 4 g.
const ACCELERATION: f64 = 40.0;
/// Scans after which a track without identity is no longer continued, and the same if many plots
/// are outliers: several outliers in succession end tracks, most of all in turns.
const SCANS: f64 = 5.5;
const SCANS_OF_OUTLIERS: f64 = 13.0;
/// Longest time without any plot of the aircraft, in scans.
const LINK: f64 = 2.5;
/// Largest number of scans within which a young track is lost by a wrong plot among its first ones.
const SCANS_OF_YOUNG: f64 = 3.5;
/// Largest factor by which the speed changes.
const FASTER: f64 = 1.2;
/// Margin for errors of positions and velocities, in standard deviations.
const SIGMAS: f64 = 3.0;

/// Gives new tracks, by number, the numbers of the older tracks that they continue, which end.
/// Returns these tracks in the same order. Cost O(tracks), and for each new track O(tracks that have
/// not been seen since it began).
pub(in crate::tracker) fn resume(
    tracks: &mut [Track],
    ended: &mut Ended,
    begun: &[u64],
    (settings, noise): (&Settings, &[Noise]),
) -> Vec<Resumed> {
    let mut resumed = Vec::new();
    let Candidates { places, mut silent, others } = Candidates::of(tracks, begun, settings);
    let mut named = Named { others, ..Named::default() };
    // tentative tracks stay as they are
    let hops = OnceCell::new();
    for &number in begun {
        let Ok(at) = places.binary_search_by_key(&number, |(number, _)| *number) else { continue };
        let place = places[at].1;
        let new = &tracks[place];
        let (end, own) = (Spot::first(new, settings), new.identities());
        let paths = Paths { ended: &ended.stretches, tracks, hops: &hops, settings, noise };
        let may = |old: &&Track| continues((new, &end), old, &paths);
        let same = |old: &Track| old.identities().same(&own) == Some(true);
        // most tracks have another identity
        let of_others = |other: &Identities| own.same(other) == Some(false);
        let live = silent.iter().filter(|(identities, _)| !of_others(identities));
        let live = live.map(|&(_, i)| &tracks[i]).filter(may);
        let mut found: Vec<&Track> = live.chain(ended.tracks.iter().filter(may)).collect();
        if found.iter().any(|old| same(old)) {
            // if another track has replied with this identity since, no older track is continued
            let is_doubled = tracks.iter().any(|other| {
                other.number != number
                    && other.is_confirmed()
                    && same(other)
                    && other.seen >= new.first.time
            });
            found.retain(|old| same(old) && !is_doubled);
            found.sort_by(|a, b| b.seen.total_cmp(&a.seen));
            found.truncate(1);
        }
        let old = if let [old] = found[..] { Some(old.number) } else { None };
        let past = match old {
            Some(old) => match ended.tracks.iter().position(|track| track.number == old) {
                Some(gone) => ended.tracks.remove(gone),
                None => {
                    let at = silent.iter().position(|&(_, i)| tracks[i].number == old);
                    tracks[silent.remove(at.expect("it is one")).1].retire()
                }
            },
            None => match named.twin(new, tracks, settings) {
                Some(at) => tracks[at].retire(),
                None => continue,
            },
        };
        let (new, old) = (number as i64, past.number as i64);
        resumed.push(Resumed { new, old, first: end.time, last: tracks[place].time });
        tracks[place].go_on(&past, settings);
        named.renamed.push(place);
    }
    resumed
}

/// Confirmed tracks with identities that targets do not share.
#[derive(Default)]
struct Named {
    /// Indices of the tracks that keep their number, and of new ones that have taken over another
    /// number.
    others: Vec<usize>,
    renamed: Vec<usize>,
    /// Identities of the former, sorted, once they are needed.
    sorted: OnceCell<Vec<((usize, i64), usize)>>,
}

impl Named {
    /// Another track of the same target as a new one, if both take its plots by turns: the target
    /// turned so sharply that some of its plots were outside all gates. Cost O(log tracks), after
    /// O(tracks log tracks) once.
    fn twin(&self, new: &Track, tracks: &[Track], settings: &Settings) -> Option<usize> {
        // hypotheses take care of such tracks
        if settings.limits().is_some() || names(new, settings).next().is_none() {
            return None;
        }
        let sorted = self.sorted.get_or_init(|| {
            let each = |&at: &usize| names(&tracks[at], settings).map(move |name| (name, at));
            let mut sorted: Vec<_> = self.others.iter().flat_map(each).collect();
            sorted.sort_unstable();
            sorted
        });
        let mut found = self.renamed.clone();
        for name in names(new, settings) {
            let first = sorted.partition_point(|(other, _)| *other < name);
            let same = sorted[first..].iter().take_while(|(other, _)| *other == name);
            found.extend(same.map(|(_, at)| *at));
        }
        found.sort_unstable();
        let end = Spot::first(new, settings);
        // a track that has ended has no time at which it was seen
        let is_twin = |old: &Track| old.seen.is_finite() && takes_turns((new, &end), old, settings);
        found.into_iter().find(|&at| is_twin(&tracks[at]))
    }
}

/// Kinds and numbers of those identities of a track that targets do not share.
fn names(track: &Track, settings: &Settings) -> impl Iterator<Item = (usize, i64)> {
    let own = track.identities();
    let kinds = [
        (IdentityKind::Address, own.icao_address.into()),
        (IdentityKind::Number, own.identity),
        (IdentityKind::Callsign, own.callsign),
    ];
    let is_own = |(kind, number): (IdentityKind, i64)| number >= 0 && !settings.is_shared(kind);
    kinds
        .map(|one| is_own(one).then_some(one.1))
        .into_iter()
        .enumerate()
        .filter_map(|(kind, number)| Some((kind, number?)))
}

/// Whether two tracks have the same identity, which targets do not share, are near each other, and
/// were not both seen by any radar in one scan.
fn takes_turns((new, end): (&Track, &Spot), old: &Track, settings: &Settings) -> bool {
    let is_same = match new.identities().compare(&old.identities()) {
        Some((kind, is_same)) => is_same && !settings.is_shared(kind),
        None => false,
    };
    let mut apart = (0..settings.radars.len()).filter_map(|radar| {
        let [a, b] = [new, old].map(|track| track.expected_by(radar));
        a.zip(b)
            .map(|(a, b)| (a.seen - b.seen).abs() > SOONEST * settings.radars[radar].scan_period)
    });
    // at least one radar must have seen both
    if !is_same || !apart.next().is_some_and(|first| first) || !apart.all(|other| other) {
        return false;
    }
    let (place, p) = old.position_at(end.time);
    let away = f64::hypot(end.position[0] - place[0], end.position[1] - place[1]);
    let errors = SIGMAS * (p.xx + p.yy + end.variance).sqrt();
    away <= settings.max_speed * (new.time - end.time) + errors
}

/// Tracks that may be of one target.
#[derive(Default)]
struct Candidates {
    /// Numbers and indices of the new tracks, sorted by number.
    places: Vec<(u64, usize)>,
    /// Identities and indices of the confirmed tracks that have not been seen since the last of the
    /// new tracks began.
    silent: Vec<(Identities, usize)>,
    /// Indices of all confirmed tracks that are not new.
    others: Vec<usize>,
}

impl Candidates {
    fn of(tracks: &[Track], begun: &[u64], settings: &Settings) -> Self {
        let mut found = Self::default();
        if begun.is_empty() {
            return found;
        }
        let mut sorted = begun.to_vec();
        sorted.sort_unstable();
        for (i, track) in tracks.iter().enumerate().filter(|(_, track)| track.is_confirmed()) {
            match sorted.binary_search(&track.number) {
                Ok(_) => found.places.push((track.number, i)),
                Err(_) => found.others.push(i),
            }
        }
        found.places.sort_unstable();
        // hypotheses take care of such tracks
        if settings.limits().is_some() {
            found.others.clear();
        }
        let began = found.places.iter().map(|&(_, i)| tracks[i].first.time);
        let last = began.fold(f64::NEG_INFINITY, f64::max);
        let seen = |track: &Track| track.forked().map_or(track.seen, |other| other.seen);
        let is_silent = |i: &usize| seen(&tracks[*i]).min(tracks[*i].seen) < last;
        let silent = found.others.iter().copied().filter(is_silent);
        found.silent = silent.map(|i| (tracks[i].identities(), i)).collect();
        found
    }
}

/// Whether a new track may be of the same target as an older one.
fn continues((new, end): (&Track, &Spot), old: &Track, paths: &Paths<'_>) -> bool {
    let settings = paths.settings;
    let kind = match new.identities().compare(&old.identities()) {
        Some((_, false)) => return false,
        Some((kind, true)) => kind,
        None => {
            if leads_back(new, old, end, settings) {
                return true;
            }
            // with many outliers, its last plot may have been one
            let [longest, _] = paths.longest(old);
            let other = old.forked().filter(|_| longest > SCANS * old.period());
            return std::iter::once(old).chain(other).any(|state| {
                let gap = end.time - state.seen;
                gap > 0.0
                    && gap <= longest
                    && is_near(state, end, gap)
                    && turned(new, state)
                    && paths.lead(state, &Spot::last(state), end)
                    && (gap <= SCANS * old.period() || paths.are_alone(new, old, (end, gap)))
            });
        }
    };
    let gap = end.time - old.seen;
    if gap <= 0.0 {
        return false;
    }
    let longest = match settings.is_shared(kind) {
        true => 2.0 * settings.coasting as f64 * old.period(),
        false => REMEMBERED,
    };
    let (place, p) = old.position_at(end.time);
    let away = f64::hypot(end.position[0] - place[0], end.position[1] - place[1]);
    let errors = SIGMAS * (p.xx + p.yy + end.variance).sqrt();
    gap <= longest && away <= 2.0 * settings.max_speed * gap + errors
}

/// Whether a new track leads back to where an old one began, which was lost soon after because one
/// of its few plots was an outlier or a false plot.
fn leads_back(new: &Track, old: &Track, end: &Spot, settings: &Settings) -> bool {
    let is_soon = |from: f64, to: f64, scans: f64| to > from && to - from <= scans * old.period();
    is_soon(old.first.time, old.seen, SCANS_OF_YOUNG) && is_soon(old.seen, end.time, SCANS) && {
        let begin = Spot::first(old, settings);
        let (place, p) = new.position_at(begin.time);
        let away = f64::hypot(begin.position[0] - place[0], begin.position[1] - place[1]);
        away <= SIGMAS * (p.xx + p.yy + begin.variance).sqrt()
    }
}

/// Whether an aircraft may be at this distance from an old track after this time: any path is
/// longer than the straight line. This test costs least and excludes most tracks.
fn is_near(old: &Track, end: &Spot, gap: f64) -> bool {
    let mean = &old.estimate.mean;
    let fastest = FASTER * (mean[2].abs() + mean[3].abs());
    let [east, north] = [0, 1].map(|i| (end.position[i] - mean[i]).abs());
    let errors = end.variance + old.estimate.covariance[(0, 0)] + old.estimate.covariance[(1, 1)];
    let behind = (old.time - old.seen).abs();
    east.max(north) <= 2.0 * fastest * (gap + behind) + 4.0 * SIGMAS * errors.sqrt()
}

/// Whether an aircraft may have turned from the old velocity into the new one.
fn turned(new: &Track, old: &Track) -> bool {
    let velocity = |track: &Track| [2, 3].map(|i| track.estimate.mean[i]);
    let (a, b) = (velocity(new), velocity(old));
    let variance = |i: usize| new.estimate.covariance[(i, i)] + old.estimate.covariance[(i, i)];
    let errors = SIGMAS * (variance(2) + variance(3)).sqrt();
    let change = f64::hypot(a[0] - b[0], a[1] - b[1]);
    let (a, b) = (f64::hypot(a[0], a[1]), f64::hypot(b[0], b[1]));
    let is_as_fast = a <= FASTER * b + errors && b <= FASTER * a + errors;
    is_as_fast && change <= ACCELERATION * (new.time - old.seen) + errors
}

/// Plots by which an aircraft may have got from one track to another.
struct Paths<'a> {
    /// Stretches of tracks that have ended.
    ended: &'a [Stretch],
    tracks: &'a [Track],
    /// These and the stretches of tentative tracks, once they are needed.
    hops: &'a OnceCell<Hops>,
    settings: &'a Settings,
    noise: &'a [Noise],
}

impl Paths<'_> {
    /// Longest time since a track was seen, and longest time without any plot of its aircraft, s.
    fn longest(&self, old: &Track) -> [f64; 2] {
        let is_many = |(radar, noise): (usize, &Noise)| {
            old.expected_by(radar).is_some() && noise.outliers.are_many()
        };
        let many = self.noise.iter().enumerate().any(is_many);
        let scans = if many { [SCANS_OF_OUTLIERS; 2] } else { [SCANS, LINK] };
        scans.map(|scans| scans * old.period())
    }

    /// Whether no other confirmed track is so near that it may be that of the aircraft instead.
    fn are_alone(&self, new: &Track, old: &Track, (end, gap): (&Spot, f64)) -> bool {
        let speed = f64::hypot(old.estimate.mean[2], old.estimate.mean[3]);
        let is_other = |track: &&Track| {
            track.is_confirmed() && track.number != new.number && track.number != old.number
        };
        self.tracks.iter().filter(is_other).all(|track| {
            let [x, y] = track.position_at(end.time).0;
            f64::hypot(x - end.position[0], y - end.position[1]) > FASTER * speed * gap
        })
    }

    fn hops(&self) -> &Hops {
        self.hops.get_or_init(|| Hops::new(self.ended, self.tracks, self.settings))
    }

    /// Whether a path leads from where a track was last seen to where another begins, with plots
    /// about as often as a radar sees an aircraft. Cost O(stretches nearby) for each stretch that
    /// is reached, after O(stretches) once.
    fn lead(&self, old: &Track, begin: &Spot, end: &Spot) -> bool {
        let longest = self.longest(old)[1];
        let speed = f64::hypot(old.estimate.mean[2], old.estimate.mean[3]);
        let hop = |a: &Spot, b: &Spot| {
            let time = b.time - a.time;
            // most spots are too late, or too far away whatever the errors are
            if !(time > 0.0 && time <= longest) {
                return false;
            }
            let [east, north] = [0, 1].map(|i| b.position[i] - a.position[i]);
            let errors = SIGMAS * (a.variance + b.variance).sqrt();
            let most = FASTER * speed * time + errors;
            if east.abs().max(north.abs()) > most {
                return false;
            }
            // half the angle of the sharpest turn
            let half = (0.5 * ACCELERATION * time / speed.max(1.0)).min(std::f64::consts::PI);
            let least = speed * time * (half.sin() / half) / FASTER;
            (least - errors..=most).contains(&f64::hypot(east, north))
        };
        let straight = |b: &Spot| {
            hop(begin, b) && {
                let (place, p) = old.position_at(b.time);
                let time = b.time - begin.time;
                let errors = SIGMAS * (p.xx + p.yy + b.variance).sqrt();
                let away = f64::hypot(b.position[0] - place[0], b.position[1] - place[1]);
                away <= 0.5 * ACCELERATION * time * time + errors
            }
        };
        let identities = old.identities();
        let mut reached = Vec::new();
        let mut now: Vec<Option<Spot>> = vec![None];
        while let Some(from) = now.pop() {
            let goes = |b: &Spot| match &from {
                None => straight(b),
                Some(last) => hop(last, b),
            };
            if goes(end) {
                return true;
            }
            let (last, hops) = (from.as_ref().unwrap_or(begin), self.hops());
            let errors = SIGMAS * (last.variance + hops.variance).sqrt();
            let half = [FASTER * speed * longest + errors; 2];
            hops.grid.within(last.position, half, &mut |i| {
                let one = hops.get(i, self.ended);
                let is_same = one.identities.same(&identities);
                let mine = is_same.unwrap_or(!one.identities.is_some());
                if mine && one.last.time < end.time && !reached.contains(&i) && goes(&one.first) {
                    reached.push(i);
                    now.push(Some(one.last));
                }
            });
        }
        false
    }
}

/// Stretches that paths may use, searched by the places where they begin.
struct Hops {
    /// Stretches of tentative tracks; in the indices, those of tracks that have ended come before
    /// them.
    tentative: Vec<Stretch>,
    grid: Grid,
    /// Largest variance of their first plots.
    variance: f64,
}

impl Hops {
    fn new(ended: &[Stretch], tracks: &[Track], settings: &Settings) -> Self {
        let others = tracks.iter().filter(|track| !track.is_confirmed());
        let tentative: Vec<_> = others.map(|track| Stretch::of(track, settings)).collect();
        let firsts = || ended.iter().chain(&tentative).map(|one| one.first);
        let points: Vec<_> = firsts().map(|first| first.position).collect();
        let variance = firsts().map(|first| first.variance).fold(0.0, f64::max);
        let periods = settings.radars.iter().map(|radar| radar.scan_period);
        let cell = settings.max_speed * periods.fold(0.0, f64::max);
        let grid = Grid::new(&points, cell).expect("plots are finite");
        Self { tentative, grid, variance }
    }

    /// The stretch with this index; those that have `ended` come first.
    fn get<'a>(&'a self, index: usize, ended: &'a [Stretch]) -> &'a Stretch {
        ended.get(index).unwrap_or_else(|| &self.tentative[index - ended.len()])
    }
}
