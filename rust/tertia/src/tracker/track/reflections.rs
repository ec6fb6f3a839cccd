//! Finds plots that may come from a target elsewhere, whose replies also reach the radar by way of a building
//! or through a side lobe of the antenna (Stevens, Secondary Surveillance Radar, 1988).

use super::suspicion::{EXTENT, Reflection};
use super::{SOONEST, Track};
use crate::base::plane::Plane;
use crate::sensors::{Identities, IdentityKind};
use crate::tracker::noise::duplicates::Near;
use crate::tracker::plot::{Measured, Source};
use crate::tracker::replies::identity::rarity;
use crate::tracker::settings::Settings;
use std::f64::consts::TAU;

/// Prior mean number of reflections of a target per scan of a radar.
const SHARE: f64 = 0.01;
/// Largest factor by which equal heights are likelier for one target than for two: aircraft fly at
/// the same levels.
const LEVELS: f64 = 30.0;
/// Largest distance of a reflector from its radar, m.
const FARTHEST: f64 = 30e3;
/// Likelihood ratio of its range above which a plot counts as that of a side lobe.
const BESIDE: f64 = 10.0;
/// Standard deviations by which the plot of a side lobe may seem nearer than its target.
const SIGMAS: f64 = 3.0;
/// Number of scans by which the last plot of a target may be earlier than the last passage of the beam over
/// the target, and the additional scans if the plot of that passage has yet to be assigned.
const EARLY: f64 = 0.25;
const UNASSIGNED: f64 = 1.0;
/// Cosine of the largest angle between two directions that count as the same, 1°.
const BEHIND: f64 = 0.999_847_7;
/// Number of plots below which a tentative track may itself be the reflection.
const ENOUGH: usize = 2;

/// The possible reflections in a scan, sorted by plot.
#[derive(Default)]
pub(in crate::tracker) struct Reflections {
    all: Vec<Reflection>,
    /// Identities and indices of the plots that no confirmed track has taken, and of those taken by a
    /// confirmed track that may be a reflection.
    names: Vec<((u8, i64), usize)>,
    /// Plots of confirmed tracks that may be reflections, and the numbers of these tracks.
    doubted: Vec<(usize, u64)>,
    /// Numbers of confirmed tracks that may be reflections because a plot nearer to the radar has the same
    /// identity.
    farther: Vec<u64>,
}

impl Reflections {
    /// Returns the reflections that this plot may be.
    pub fn of(&self, plot: usize) -> &[Reflection] {
        let own = &self.all[self.all.partition_point(|one| one.plot < plot)..];
        &own[..own.partition_point(|one| one.plot == plot)]
    }

    /// Notes the plot of a confirmed track that may be a reflection.
    pub fn doubt(&mut self, plot: usize, track: u64) {
        self.doubted.push((plot, track));
    }

    /// Forgets the plots of the last scan.
    pub fn clear(&mut self) {
        self.doubted.clear();
    }

    /// Updates the evidence on confirmed tracks that may be reflections. Cost O(tracks + plots of
    /// the tracks that may be reflections).
    pub fn weigh(&mut self, plots: &[Measured], (tracks, settings): (&mut [Track], &Settings)) {
        self.doubted.sort_unstable_by_key(|&(plot, track)| (track, plot));
        self.farther.sort_unstable();
        if self.doubted.is_empty() && self.farther.is_empty() {
            return;
        }
        for track in tracks.iter_mut().filter(|track| track.is_confirmed()) {
            let first = self.doubted.partition_point(|one| one.1 < track.number);
            let number = track.number;
            let own = self.doubted[first..].iter().take_while(|one| one.1 == number);
            for &(plot, _) in own {
                track.doubt(&plots[plot], self.of(plot), settings);
            }
            if self.farther.binary_search(&track.number).is_ok() {
                track.begin_to_doubt();
            }
        }
    }

    /// Finds possible reflections among the plots that no confirmed track has taken and those of confirmed
    /// tracks that may be reflections. Cost O(plots), and O(tracks log plots) if any of these plots has an
    /// identity.
    pub fn find(
        &mut self,
        Near { plots, .. }: Near<'_>,
        (taken, deferred): (&[bool], &[bool]),
        (tracks, settings): (&[Track], &Settings),
    ) {
        let Self { all, names, doubted, farther } = self;
        all.clear();
        names.clear();
        farther.clear();
        let polar = |plot: &Measured| !settings.geometry(plot.radar).is_position();
        let left = (0..plots.len()).filter(|&i| !taken[i] && !deferred[i]);
        for i in left.chain(doubted.iter().map(|(plot, _)| *plot)) {
            if plots[i].identities.is_some() && polar(&plots[i]) {
                names.extend(each(&settings.identities(&plots[i]).0).map(|name| (name, i)));
            }
        }
        if names.is_empty() {
            return;
        }
        names.sort_unstable();
        for track in tracks.iter().filter(|track| !track.is_reflection()) {
            for name in each(&track.identities()) {
                let first = names.partition_point(|(other, _)| *other < name);
                for &(_, i) in names[first..].iter().take_while(|(other, _)| *other == name) {
                    match of_target((i, &plots[i]), (name.0, track), settings) {
                        Some(Found::Reflection(one)) => all.push(one),
                        Some(Found::Farther) => farther.push(track.number),
                        None => (),
                    }
                }
            }
        }
        all.sort_unstable_by_key(|one| (one.plot, one.track));
    }
}

/// Returns the kind and the number of each identity that is known.
fn each(own: &Identities) -> impl Iterator<Item = (u8, i64)> + use<> {
    let Identities { icao_address, identity, callsign, mode_3a } = *own;
    let all = [icao_address.into(), identity, callsign, mode_3a.into()];
    (0..).zip(all).filter(|(_, number)| *number >= 0)
}

/// Kinds of identities in the order of `each`.
const KINDS: [IdentityKind; 4] =
    [IdentityKind::Address, IdentityKind::Number, IdentityKind::Callsign, IdentityKind::Code];

/// Relation between a plot and a track with the same identity.
enum Found {
    /// The plot may be a reflection of the target of the track.
    Reflection(Reflection),
    /// The track may be a reflection of the target of the plot, as it is farther from the radar.
    Farther,
}

/// Returns the relation between a plot and a track with the same identity of this kind; none if neither can
/// be a reflection of the other.
fn of_target(
    (index, plot): (usize, &Measured),
    (kind, track): (u8, &Track),
    settings: &Settings,
) -> Option<Found> {
    let (kind, own) = (KINDS[usize::from(kind)], track.identities());
    let reply = settings.identities(plot).0;
    if own.compare(&reply) != Some((kind, true)) || own.contradicts(&reply) {
        return None;
    }
    let radar = &settings.radars[plot.radar];
    let age = plot.time - track.expected_by(plot.radar)?.seen;
    if age.abs() > (1.0 + EARLY + UNASSIGNED) * radar.scan_period {
        return None;
    }
    let height = track.height_ratio(plot);
    if height < 1.0 {
        return None;
    }
    let (place, p) = track.position_at(plot.time);
    let Path { distance, variance, side_lobe, turned, is_behind } =
        Path::of(plot, (place, p), settings);
    let more = if track.is_confirmed() { 0.0 } else { UNASSIGNED };
    if age > (turned + EARLY + more) * radar.scan_period {
        return None;
    }
    let error = SIGMAS * variance.sqrt() + EXTENT;
    if distance < -error {
        return track.is_confirmed().then_some(Found::Farther);
    }
    if distance > FARTHEST + error || (distance > error && is_behind) {
        return None;
    }
    let [x, y] = [0, 1].map(|i| plot.position[i] - place[i]);
    let flown = settings.max_speed * age.abs() + SIGMAS * (p.xx + p.yy).sqrt();
    let is_seen = age.abs() < SOONEST * radar.scan_period || f64::hypot(x, y) > flown;
    let is_unsure = track.hits().is_some_and(|hits| hits < ENOUGH || distance < error);
    let same = rarity(kind, &reply, settings) * height.min(LEVELS);
    let log_odds = (SHARE * (1.0 + side_lobe) * same).ln();
    let since = if distance < error { track.first.time } else { f64::NEG_INFINITY };
    let (plot, track) = (index, track.number);
    let is_beside = side_lobe > BESIDE;
    let one = Reflection {
        plot,
        track,
        distance,
        variance,
        log_odds,
        is_seen,
        is_unsure,
        since,
        is_beside,
    };
    Some(Found::Reflection(one))
}

/// The path from a radar to a target by way of a reflector on the ground.
struct Path {
    /// Distance of the reflector from the radar, and its variance.
    distance: f64,
    variance: f64,
    /// Likelihood ratio of the range of the plot: a side lobe, which sees the target at the range of the
    /// target, against another target.
    side_lobe: f64,
    /// How far the beam has turned since it passed the target, as a share of a scan.
    turned: f64,
    /// Whether the plot is in the same direction from the radar as the target.
    is_behind: bool,
}

impl Path {
    /// Returns the path by which a plot is a reflection of the target at `place`: the slant range R of the
    /// plot is the distance d of the reflector plus the slant range from there to the target,
    /// `(R − d)² = d² − 2 d a cos Δ + a² + h²`.
    fn of(plot: &Measured, (place, p): ([f64; 2], Plane), settings: &Settings) -> Self {
        let radar = &settings.radars[plot.radar];
        let [east, north, up] = radar.position;
        let polar = |[x, y]: [f64; 2]| {
            let range = f64::hypot(x - east, y - north).max(1.0);
            ([(x - east) / range, (y - north) / range], range)
        };
        let ((u, g), (v, a)) = (polar(plot.position), polar(place));
        let (cosine, sine) = (u[0] * v[0] + u[1] * v[1], u[0] * v[1] - u[1] * v[0]);
        let (height, unsure) = match plot.source {
            Source::Slant { prior: [height, variance], .. } => (height, variance),
            _ => (if plot.height.is_finite() { plot.height - up } else { 0.0 }, 0.0),
        };
        let slant = f64::hypot(g, height);
        // this would be 0 if the plot were at the place of the target
        let base = (slant - a * cosine).max(1.0);
        let distance = 0.5 * (g - a) * (g + a) / base;
        let seen = radar.detecting(plot.detection);
        let r = seen.noise_at(plot.position, plot.height - up);
        let along = |c: Plane, w: [f64; 2]| c.form(w);
        let across = |c: Plane, [x, y]: [f64; 2]| c.form([y, -x]);
        let by_height = unsure * (height / g).powi(2);
        let ranges = (g * (1.0 - distance / slant) / base).powi(2) * (along(r, u) + by_height)
            + ((a - distance * cosine) / base).powi(2) * along(p, v);
        let azimuths =
            (distance * sine / base).powi(2) * ((a / g).powi(2) * across(r, u) + across(p, v));
        let both = along(r, u) + along(p, v);
        let density = (-0.5 * (g - a).powi(2) / both).exp() / (TAU * both).sqrt();
        Self {
            distance,
            variance: ranges + azimuths,
            side_lobe: FARTHEST * density,
            is_behind: cosine > BEHIND,
            turned: sine.atan2(cosine).rem_euclid(TAU) / TAU,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_within;
    use crate::sensors::radar_of;
    use crate::tracker::motion::Motion;

    const NONE: Plane = Plane { xx: 0.0, xy: 0.0, yy: 0.0 };

    /// Position at this range and azimuth, east and north.
    fn at(range: f64, azimuth: f64) -> [f64; 2] {
        [range * azimuth.sin(), range * azimuth.cos()]
    }

    fn way(reflector: [f64; 2], target: [f64; 2], height: f64) -> Path {
        let [distance, azimuth] = reflector;
        let [east, north] = at(distance, azimuth);
        let leg = f64::hypot(target[0] - east, target[1] - north);
        let slant = distance + f64::hypot(leg, height);
        let ground = (slant * slant - height * height).sqrt();
        let position = at(ground, azimuth);
        let plot = Measured { position, height, ..Measured::default() };
        let settings = Settings::new(vec![radar_of([50.0, 1e-3])], Motion::Cv(1.0));
        Path::of(&plot, (target, NONE), &settings)
    }

    #[test]
    fn a_path_leads_back_to_its_reflector() {
        let target = at(4e4, 1.0);
        for (distance, azimuth) in [(2e3, 2.5), (9e3, 5.0), (5e3, 1.3)] {
            for height in [0.0, 1e3, 1e4] {
                let found = way([distance, azimuth], target, height);
                assert_within(1e-9, found.distance / distance, 1.0);
                assert_within(1e-12, found.turned, (azimuth - 1.0) / TAU);
            }
        }
        // at the range of the target, and beyond
        assert!(way([0.0, 2.5], target, 1e3).side_lobe > 100.0);
        assert!(way([2e3, 2.5], target, 1e3).side_lobe < 1e-9);
    }
}
