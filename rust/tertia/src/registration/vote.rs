//! Sudden changes of a radar's errors that are larger than the gates, by a vote of the tracks whose plots are
//! missing.
//!
//! A track that the radar saw before votes for its distances to the plots near it that no track has taken. If
//! most of the tracks agree, the errors of the radar have changed; the targets would not all move alike. Cost
//! O(tracks) if no radar misses many of its tracks; else O(V²) for V votes, of 200 tracks at most.

use super::effect::Effect;
use super::followed::Followed;
use super::sighting::Report;
use crate::base::angle::median;
use crate::sensors::Radar;

/// Scans of the radar within which a track has its plot, or misses it.
const WINDOW: f64 = 1.3;
/// Scans within which the radar has seen a track that it covers.
const COVERED: f64 = 6.0;
/// Share of the tracks that have a plot if nothing has changed, and least number of covered tracks.
const SEEN: f64 = 0.75;
const TRACKS: usize = 6;
/// Largest number of tracks that vote.
const VOTERS: usize = 200;
/// Least number of tracks that agree, and their least share of those that miss a plot.
const FEWEST: usize = 4;
const AGREEING: f64 = 0.5;
/// Largest changes of the range, in metres, and of the azimuth, in radians: of a radar whose errors change, and
/// of one that is replaced or turned, as from magnetic to true north.
const FAR: f64 = 2500.0;
const WIDE: f64 = 0.035;
const REPLACED: f64 = 0.5;
/// Largest number of times that as many votes as for the change of a replaced radar agree by chance.
const CHANCE: f64 = 1e-6;
/// Largest distance of votes that agree, in standard deviations of a plot.
const AGREED: f64 = 3.9;
/// Least change, in standard deviations of a plot: smaller changes stay within the gates, and plots are
/// missed for other reasons.
const LEAST: f64 = 2.0;

/// Returns for each radar whether it misses enough of the tracks that it covers for a vote.
pub(super) fn suspects<'a>(
    tracks: impl Iterator<Item = &'a Followed>,
    radars: &[Radar],
    time: f64,
) -> Vec<bool> {
    let limits: Vec<[f64; 2]> = radars.iter().map(|radar| limits(radar, time)).collect();
    let earliest = limits.iter().map(|[covered, _]| *covered).fold(f64::INFINITY, f64::min);
    let mut counts = vec![[0; 2]; radars.len()];
    for track in tracks.filter(|track| track.time >= earliest) {
        for &Effect { radar, time: last, .. } in &track.parts {
            let [covered, since] = limits[radar];
            counts[radar][0] += usize::from(last >= covered);
            counts[radar][1] += usize::from(last >= since);
        }
    }
    counts.into_iter().map(|[covered, seen]| is_suspect(covered, seen)).collect()
}

/// Times since which a radar has seen the tracks that it covers, and the tracks that it does not miss.
fn limits(radar: &Radar, time: f64) -> [f64; 2] {
    [COVERED, WINDOW].map(|scans| time - scans * radar.scan_period)
}

fn is_suspect(covered: usize, seen: usize) -> bool {
    covered >= TRACKS && seen as f64 <= SEEN * covered as f64
}

/// Returns the changes of the range (m) and the azimuth (rad) of radar `k` at this time, if they have
/// changed. `loose` are the plots that no confirmed track has taken, corrected for the known errors.
pub(super) fn vote<'a>(
    tracks: impl Iterator<Item = &'a Followed>,
    loose: &[Report],
    (k, radar): (usize, &Radar),
    time: f64,
) -> Option<[f64; 2]> {
    let [covered, since] = limits(radar, time);
    let covered: Vec<&Followed> = tracks.filter(|track| track.seen_by(k) >= covered).collect();
    let missing: Vec<&&Followed> =
        covered.iter().filter(|track| track.seen_by(k) < since).collect();
    if !is_suspect(covered.len(), covered.len() - missing.len()) {
        return None;
    }
    let near =
        loose.iter().filter(|plot| plot.radar == k && plot.time >= since && plot.time <= time);
    let seen: Vec<Seen> = near.map(|plot| Seen::new(plot, radar)).collect();
    let voters = &missing[..missing.len().min(VOTERS)];
    elected(voters, &seen, radar, WIDE).or_else(|| elected(voters, &seen, radar, REPLACED)).filter(
        |moved| {
            let sigma = [radar.range_sigma, radar.azimuth_sigma];
            (0..2).any(|axis| moved[axis].abs() > LEAST * sigma[axis])
        },
    )
}

/// Returns the change, of the azimuth by at most `widest`, for which enough of the tracks vote.
fn elected(voters: &[&&Followed], seen: &[Seen], radar: &Radar, widest: f64) -> Option<[f64; 2]> {
    let mut votes: Vec<(usize, [f64; 2])> = Vec::new();
    for plot in seen {
        let tracks = voters.iter().enumerate();
        votes.extend(tracks.filter_map(|(i, track)| Some((i, plot.off(track, widest)?))));
    }
    // the votes of a track one after the other
    votes.sort_by_key(|(track, _)| *track);
    let sigma = [radar.range_sigma, radar.azimuth_sigma];
    let agreeing = |centre: &[f64; 2]| {
        let near = |vote: &[f64; 2]| {
            (0..2).all(|axis| (vote[axis] - centre[axis]).abs() < AGREED * sigma[axis])
        };
        let mut found: Vec<(usize, [f64; 2])> =
            votes.iter().filter(|(_, vote)| near(vote)).copied().collect();
        found.dedup_by_key(|(track, _)| *track);
        found
    };
    let best = votes.iter().map(|(_, centre)| agreeing(centre)).max_by_key(Vec::len)?;
    let enough = FEWEST.max((AGREEING * voters.len() as f64).ceil() as usize);
    let middle = |axis: usize| {
        let mut all: Vec<f64> = best.iter().map(|(_, vote)| vote[axis]).collect();
        median(&mut all)
    };
    let is_clear = widest <= WIDE || {
        let cell = AGREED * AGREED * sigma[0] * sigma[1] / (FAR * widest);
        by_chance(votes.len(), best.len(), voters.len(), cell) < CHANCE
    };
    (best.len() >= enough && is_clear).then(|| [middle(0), middle(1)])
}

/// Bound on the number of votes with which, by chance, at least `agreeing` of the tracks agree, if each vote
/// agrees with another with the probability `cell` (Chernoff).
fn by_chance(votes: usize, agreeing: usize, tracks: usize, cell: f64) -> f64 {
    let (count, others) = (votes as f64, (tracks as f64 - 1.0).max(1.0));
    let p = (count / tracks as f64 * cell).min(0.5);
    let q = (agreeing as f64 - 1.0) / others;
    if q <= p {
        return count;
    }
    let part = |a: f64, b: f64| if a > 0.0 { a * (a / b).ln() } else { 0.0 };
    count * (-others * (part(q, p) + part(1.0 - q, 1.0 - p))).exp()
}

/// A plot in the polar coordinates of its radar.
struct Seen {
    time: f64,
    range: f64,
    /// Sine and cosine of the azimuth.
    direction: [f64; 2],
    /// Position of the radar, and height of the plot above it.
    site: [f64; 2],
    up: f64,
}

impl Seen {
    fn new(plot: &Report, radar: &Radar) -> Self {
        let [x, y, z] = radar.position;
        let up = if plot.height.is_finite() { plot.height - z } else { 0.0 };
        let direction = plot.azimuth.sin_cos().into();
        Self { time: plot.time, range: plot.range, direction, site: [x, y], up }
    }

    /// Returns range and azimuth of the plot less those of a track at its time; none if they are too far
    /// apart.
    fn off(&self, track: &Followed, widest: f64) -> Option<[f64; 2]> {
        let ahead = self.time - track.time;
        let [east, north] =
            [0, 1].map(|i| track.position[i] + ahead * track.velocity[i] - self.site[i]);
        let [sine, cosine] = self.direction;
        let (along, across) = (east * sine + north * cosine, east * cosine - north * sine);
        // tested by the tangent: most tracks are farther to the side
        let is_near = across.abs() < widest * along;
        if !is_near {
            return None;
        }
        let range = self.range - (east * east + north * north + self.up * self.up).sqrt();
        (range.abs() < FAR).then(|| [range, -across.atan2(along)])
    }
}

#[cfg(test)]
mod tests {
    use super::super::sighting::tests::radar;
    use super::*;

    /// Ten tracks on a line; the radar has seen this number of them, and plots of the others half a degree to
    /// the side.
    fn scene(seen: usize) -> (Vec<Followed>, Vec<Report>) {
        let (mut tracks, mut loose) = (Vec::new(), Vec::new());
        for i in 0..10 {
            let (azimuth, range) = (0.5 + 0.1 * f64::from(i), 4e4 + 3e3 * f64::from(i));
            let position = [range * azimuth.sin(), range * azimuth.cos()];
            let last = if (i as usize) < seen { 40.0 } else { 35.0 };
            let mut track = Followed::new(last);
            track.see(last, 0, position, [0.0; 2]);
            tracks.push(track);
            if i as usize >= seen {
                let (range, azimuth) = (range + 100.0, azimuth + 0.5_f64.to_radians());
                loose.push(Report {
                    radar: 0,
                    time: 39.5,
                    range,
                    azimuth,
                    height: f64::NAN,
                    place: None,
                });
            }
        }
        (tracks, loose)
    }

    fn voted(seen: usize) -> Option<[f64; 2]> {
        let (tracks, loose) = scene(seen);
        vote(tracks.iter(), &loose, (0, &radar([0.0; 3], 50.0, 0.08)), 41.0)
    }

    #[test]
    fn a_radar_that_has_moved() {
        for seen in [0, 4] {
            let [range, azimuth] = voted(seen).unwrap();
            assert!((range - 100.0).abs() < 1e-6);
            assert!((azimuth - 0.5_f64.to_radians()).abs() < 1e-9);
        }
    }

    #[test]
    fn missing_plots_are_no_change() {
        // most tracks have their plots, or the tracks that miss one do not agree
        assert_eq!(voted(8), None);
        let (tracks, mut loose) = scene(0);
        for (i, plot) in loose.iter_mut().enumerate() {
            plot.range += 400.0 * i as f64;
        }
        let radar = radar([0.0; 3], 50.0, 0.08);
        assert_eq!(vote(tracks.iter(), &loose, (0, &radar), 41.0), None);
        assert_eq!(vote(tracks.iter(), &[], (0, &radar), 41.0), None);
        // the plots are where they should be: they were missed for another reason
        let (_, mut loose) = scene(0);
        for plot in &mut loose {
            plot.range -= 60.0;
            plot.azimuth -= 0.45_f64.to_radians();
        }
        assert_eq!(vote(tracks.iter(), &loose, (0, &radar), 41.0), None);
    }
}
