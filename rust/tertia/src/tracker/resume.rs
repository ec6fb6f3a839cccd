//! Tracks that go on under their number: after a gap, by their identity, or after a manoeuvre that no
//! gate has followed.

use super::settings::Settings;
use super::track::Track;

/// Seconds for which an ended track may be resumed by its identity.
const REMEMBERED: f64 = 600.0;
/// Largest acceleration of an aircraft, m/s²: 4 g.
const ACCELERATION: f64 = 40.0;
/// Scans without a plot after which a track without identity is not resumed, and for which it is
/// remembered.
const SCANS: f64 = 5.5;
const SCANS_REMEMBERED: f64 = 15.0;
/// Largest change of speed, as a share.
const FASTER: f64 = 1.2;
/// Margin for errors of position and velocity, in standard deviations.
const SIGMAS: f64 = 3.0;

/// Gives new tracks the numbers of those that they continue, which end. Returns pairs of numbers: that
/// of a new track, and the one that it has now. Cost O(tracks), and for each new track that of the
/// tracks that have not been seen since it began.
pub(super) fn resume(
    tracks: &mut [Track],
    ended: &mut Vec<Track>,
    begun: &[u64],
    settings: &Settings,
) -> Vec<(u64, u64)> {
    let mut renamed = Vec::new();
    let (places, mut silent) = candidates(tracks, begun, settings);
    for &number in begun {
        let Ok(at) = places.binary_search_by_key(&number, |(number, _)| *number) else { continue };
        let place = places[at].1;
        let new = &tracks[place];
        let may = |old: &&Track| continues(new, old, settings);
        let same = |old: &Track| old.identity().is_some() && old.identity() == new.identity();
        let live = silent.iter().map(|&i| &tracks[i]).filter(may);
        let mut found: Vec<&Track> = live.chain(ended.iter().filter(may)).collect();
        if found.iter().any(|old| same(old)) {
            // another track that answers so now is no part of this one's past
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
        let [old] = found[..] else { continue };
        let old = old.number;
        renamed.push((number, old));
        let past = match ended.iter().position(|track| track.number == old) {
            Some(gone) => ended.remove(gone),
            None => {
                let at = silent.iter().position(|&i| tracks[i].number == old).expect("it is one");
                tracks[silent.remove(at)].retire()
            }
        };
        tracks[place].go_on(&past, settings);
    }
    renamed
}

/// Numbers and indices of the new tracks, by number, and indices of the confirmed tracks that have not
/// been seen since the last of them began.
fn candidates(
    tracks: &[Track],
    begun: &[u64],
    settings: &Settings,
) -> (Vec<(u64, usize)>, Vec<usize>) {
    if begun.is_empty() {
        return (Vec::new(), Vec::new());
    }
    let mut sorted = begun.to_vec();
    sorted.sort_unstable();
    let is_new = |track: &Track| sorted.binary_search(&track.number).is_ok();
    let all = || tracks.iter().enumerate();
    let mut places: Vec<(u64, usize)> =
        all().filter(|(_, track)| is_new(track)).map(|(i, track)| (track.number, i)).collect();
    places.sort_unstable();
    let last = places.iter().map(|&(_, i)| tracks[i].first.time).fold(f64::NEG_INFINITY, f64::max);
    // hypotheses know the tracks that are in doubt
    let is_sure = settings.limits().is_none();
    let is_silent =
        |track: &Track| is_sure && track.is_confirmed() && track.seen < last && !is_new(track);
    (places, all().filter(|(_, track)| is_silent(track)).map(|(i, _)| i).collect())
}

/// Whether a new track may be the same target as an older one.
fn continues(new: &Track, old: &Track, settings: &Settings) -> bool {
    let (time, there) = (new.first.time, new.first.position);
    let radar = &settings.radars[new.first.radar];
    let gap = time - old.seen;
    if gap <= 0.0 {
        return false;
    }
    let is_same = match (new.identity(), old.identity()) {
        (Some(new), Some(old)) if new != old => return false,
        (new, old) => new.is_some() && new == old,
    };
    let longest = match is_same {
        true if settings.has_addresses() => REMEMBERED,
        true => 2.0 * settings.coasting as f64 * old.period(),
        false => SCANS * old.period(),
    };
    if gap > longest {
        return false;
    }
    let (place, p) = old.position_at(time);
    let r = radar.noise_at(there, f64::NAN);
    let away = f64::hypot(there[0] - place[0], there[1] - place[1]);
    let errors = SIGMAS * (p.xx + p.yy + r.xx + r.yy).sqrt();
    let flown = 2.0 * settings.max_speed * gap;
    if is_same {
        return away <= flown + errors;
    }
    let turned = |old: &Track| {
        let (a, b) = (&new.estimate, &old.estimate);
        let change = f64::hypot(a.mean[2] - b.mean[2], a.mean[3] - b.mean[3]);
        let variance = |i: usize| a.covariance[(i, i)] + b.covariance[(i, i)];
        let sigma = (variance(2) + variance(3)).sqrt();
        change <= ACCELERATION * (new.time - old.seen) + SIGMAS * sigma
    };
    let last = [0, 1].map(|i| old.position_at(old.seen).0[i] - there[i]);
    let speed = f64::hypot(old.estimate.mean[2], old.estimate.mean[3]);
    let reached = f64::hypot(last[0], last[1]) <= FASTER * speed * gap + errors;
    reached && away <= 0.5 * ACCELERATION * gap * gap + errors && turned(old)
}

/// Remembers a track that has ended, if it may be resumed.
pub(super) fn remember(ended: &mut Vec<Track>, track: &Track) {
    if track.is_confirmed() && track.number > 0 {
        ended.push(track.clone());
    }
}

/// Forgets those of long ago.
pub(super) fn forget(ended: &mut Vec<Track>, time: f64) {
    ended.retain(|track| {
        let scans = SCANS_REMEMBERED * track.period();
        time - track.seen <= if track.identity().is_some() { REMEMBERED } else { scans }
    });
}
