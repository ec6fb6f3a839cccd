//! Plots that may be of a target elsewhere: its replies also reach the radar by way of a building, or by a
//! side lobe of the antenna (Stevens, Secondary Surveillance Radar, 1988, chapters on reflections and on
//! interrogation and reply by side lobes).

use super::doubles::Near;
use super::identity::rarity;
use super::plot::{Measured, Source};
use super::settings::Settings;
use super::track::{SOONEST, Track};
use crate::base::plane::Plane;
use crate::sensors::{Identities, IdentityKind};
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// Reflections of a target in a scan of a radar, before any plot.
const SHARE: f64 = 0.01;
/// How much likelier equal heights are of one target than of two, at most: aircraft fly at the same levels.
const LEVELS: f64 = 30.0;
/// Largest distance of a reflector from its radar, m.
const FARTHEST: f64 = 30e3;
/// Standard deviation of this distance by the extent of a reflector, m and as a share.
const EXTENT: f64 = 60.0;
const SLANTED: f64 = 0.01;
/// Standard deviations by which a side lobe may seem nearer than its target.
const SIGMAS: f64 = 3.0;
/// Scans by which a radar may have seen a target earlier than when its beam passed it last, and more if the plot
/// of that scan is yet to be assigned.
const EARLY: f64 = 0.25;
const UNASSIGNED: f64 = 1.0;
/// Scans by which a target at the same range as its side lobe must have begun before it.
const BEFORE: f64 = 1.5;
/// By how much the logarithm of the odds may fall by one plot.
const STEP: f64 = -4.0;
/// Logarithm of the probability that a target is not seen where its reflection is.
const UNSEEN: f64 = -3.0;
/// Plots of a tentative track from which on others may be its reflections.
const ENOUGH: usize = 2;

/// What a plot is if it is the reflection of a target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Reflection {
    plot: usize,
    /// Distance of the reflector from the radar, 0 for a side lobe, and its variance, m and m².
    distance: f64,
    variance: f64,
    /// Logarithm of the odds of a reflection against another target, before others are known.
    log_odds: f64,
    /// Whether the radar has seen the target elsewhere in this scan: the plot is not of itself.
    is_seen: bool,
    /// Whether the target may be the reflection instead: it is not confirmed, and nearer by no more than errors,
    /// or has too few plots.
    is_unsure: bool,
    /// First plot of the target, s, where the plot may be of a side lobe: either may be of that if both are new.
    since: f64,
}

/// The possible reflections of a scan, by plot.
#[derive(Default)]
pub(super) struct Reflections {
    all: Vec<Reflection>,
    /// Identities of plots that no confirmed track has.
    names: Vec<((u8, i64), usize)>,
}

/// Whether a track is the reflection of a target.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Suspicion {
    radar: usize,
    /// Mean distance of the reflector by so many plots, and its variance.
    distance: f64,
    variance: f64,
    plots: f64,
    /// Logarithm of the odds of a reflection, and the largest by any plot alone.
    log_odds: f64,
    most: f64,
}

impl Reflection {
    /// Whether it is likelier than another target, although the target may be the reflection instead.
    pub fn is_mutual(&self) -> bool {
        self.is_unsure && self.is_likely()
    }

    fn is_likely(&self) -> bool {
        self.is_seen && self.log_odds > 0.0
    }

    /// Whether it is of the target, rather than of a track that began at this time.
    pub fn is_of_target(&self, begin: f64, period: f64) -> bool {
        !self.is_unsure && self.since < begin - BEFORE * period
    }
}

impl Reflections {
    /// Those that may be the plot.
    pub fn of(&self, plot: usize) -> &[Reflection] {
        let own = &self.all[self.all.partition_point(|one| one.plot < plot)..];
        &own[..own.partition_point(|one| one.plot == plot)]
    }

    /// Finds those among the plots that confirmed tracks have left. Cost O(plots), and O(tracks log plots) where
    /// any of these has an identity.
    pub fn find(
        &mut self,
        Near { plots, .. }: Near<'_>,
        (taken, deferred): (&[bool], &[bool]),
        (tracks, settings): (&[Track], &Settings),
    ) {
        let Self { all, names } = self;
        all.clear();
        names.clear();
        let polar = |plot: &Measured| !settings.geometry(plot.radar).is_position();
        for (i, plot) in plots.iter().enumerate() {
            if !taken[i] && !deferred[i] && plot.identities.is_some() && polar(plot) {
                names.extend(each(&settings.identities(plot).0).map(|name| (name, i)));
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
                    all.extend(of_target((i, &plots[i]), (name.0, track), settings));
                }
            }
        }
        all.sort_by(|a, b| a.plot.cmp(&b.plot).then(a.distance.total_cmp(&b.distance)));
    }
}

impl Suspicion {
    /// By the first plot; none where another target is likelier.
    pub fn of<'a>(
        plot: &Measured,
        reflections: impl Iterator<Item = &'a Reflection>,
    ) -> Option<Self> {
        let seen = reflections.filter(|one| one.is_likely());
        let one = seen.max_by(|a, b| a.log_odds.total_cmp(&b.log_odds))?;
        let Reflection { distance, variance, log_odds, .. } = *one;
        Some(Self { radar: plot.radar, distance, variance, plots: 1.0, log_odds, most: log_odds })
    }

    /// Whether a reflection is likelier than another target.
    pub fn holds(&self) -> bool {
        self.log_odds > 0.0
    }

    /// Weighs one more plot: a reflector stays where it is.
    pub fn weigh<'a>(
        &mut self,
        plot: &Measured,
        reflections: impl Iterator<Item = &'a Reflection>,
    ) {
        if !self.holds() || !plot.identities.is_some() {
            return;
        }
        let own = reflections.filter(|_| plot.radar == self.radar);
        let weighed = own.map(|one| (self.square(one), one));
        let Some((square, one)) = weighed.min_by(|a, b| a.0.total_cmp(&b.0)) else {
            self.log_odds += UNSEEN;
            return;
        };
        if one.is_seen {
            let log_odds = self.log_odds + (0.5 - 0.5 * square).max(STEP);
            self.most = self.most.max(one.log_odds);
            self.log_odds = log_odds.min(self.most);
            self.plots += 1.0;
            self.distance += (one.distance - self.distance) / self.plots;
            self.variance += (one.variance - self.variance) / self.plots;
        }
    }

    /// Normalised square of the difference in distance.
    fn square(&self, one: &Reflection) -> f64 {
        let extent = EXTENT + SLANTED * self.distance.abs();
        let variance = one.variance + self.variance / self.plots + extent * extent;
        (one.distance - self.distance).powi(2) / variance
    }
}

/// Kinds and numbers of identities.
fn each(own: &Identities) -> impl Iterator<Item = (u8, i64)> + use<> {
    let Identities { icao_address, identity, callsign, mode_3a } = *own;
    let all = [icao_address.into(), identity, callsign, mode_3a.into()];
    (0..).zip(all).filter(|(_, number)| *number >= 0)
}

/// The kinds in this order.
const KINDS: [IdentityKind; 4] =
    [IdentityKind::Address, IdentityKind::Number, IdentityKind::Callsign, IdentityKind::Code];

/// The plot as a reflection of a target with an identity of this kind; none where it cannot be one.
fn of_target(
    (index, plot): (usize, &Measured),
    (kind, track): (u8, &Track),
    settings: &Settings,
) -> Option<Reflection> {
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
    let Path { distance, variance, side_lobe, turned } = Path::of(plot, (place, p), settings);
    let more = if track.is_confirmed() { 0.0 } else { UNASSIGNED };
    if age > (turned + EARLY + more) * radar.scan_period {
        return None;
    }
    let error = SIGMAS * variance.sqrt() + EXTENT;
    if !(-error..=FARTHEST + error).contains(&distance) {
        return None;
    }
    let [x, y] = [0, 1].map(|i| plot.position[i] - place[i]);
    let flown = settings.max_speed * age.abs() + SIGMAS * (p.xx + p.yy).sqrt();
    let is_seen = age.abs() < SOONEST * radar.scan_period || f64::hypot(x, y) > flown;
    let is_unsure = track.hits().is_some_and(|hits| hits < ENOUGH || distance < error);
    let same = rarity(kind, &reply, settings) * height.min(LEVELS);
    let log_odds = (SHARE * (1.0 + side_lobe) * same).ln();
    let since = if distance < error { track.first.time } else { f64::NEG_INFINITY };
    Some(Reflection { plot: index, distance, variance, log_odds, is_seen, is_unsure, since })
}

/// The way from a radar to a target by a reflector on the ground.
struct Path {
    /// Distance of the reflector from the radar, and its variance.
    distance: f64,
    variance: f64,
    /// Likelihood ratio of the range of the plot: of a side lobe, which sees the target at its range, against
    /// another target.
    side_lobe: f64,
    /// How far the beam has turned since it passed the target, as a share of a scan.
    turned: f64,
}

impl Path {
    /// By which a plot is of the target at `place`: its slant range is the distance of the reflector and the
    /// slant range from there, (R − d)² = d² − 2 d a cos Δ + a² + h².
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
        // 0 where the plot is at the place of the target
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

    /// East and north at an azimuth.
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

    fn reflection(distance: f64, log_odds: f64) -> Reflection {
        let (is_seen, is_unsure, since) = (true, false, f64::NEG_INFINITY);
        let (plot, variance) = (0, 1e4);
        Reflection { plot, distance, variance, log_odds, is_seen, is_unsure, since }
    }

    fn after(log_odds: f64, plots: &[Option<f64>]) -> bool {
        let plot = Measured { identities: Identities::of(1), ..Measured::default() };
        let first = reflection(5e3, log_odds);
        let mut own = Suspicion::of(&plot, [first].iter()).unwrap();
        for distance in plots {
            let found = distance.map(|distance| reflection(distance, log_odds));
            own.weigh(&plot, found.iter());
        }
        own.holds()
    }

    #[test]
    fn a_reflector_stays_where_it_is() {
        let moving: Vec<_> = (1..6).map(|k| Some(5e3 + 400.0 * f64::from(k))).collect();
        assert!(after(7.0, &[Some(5.1e3); 30]));
        assert!(after(7.0, &moving[..1]) && !after(7.0, &moving));
        // a target that is not seen where it should be is no reason for a reflection
        assert!(after(7.0, &[None, None]) && !after(7.0, &[None; 3]));
        let plot = Measured::default();
        assert!(Suspicion::of(&plot, [reflection(5e3, -1.0)].iter()).is_none());
    }

    #[test]
    fn a_side_lobe_is_of_the_target_that_began_before() {
        let own = Reflection { since: 10.0, ..reflection(0.0, 3.0) };
        assert!(own.is_of_target(20.0, 4.0) && !own.is_of_target(14.0, 4.0));
        let unsure = Reflection { is_unsure: true, ..own };
        assert!(!unsure.is_of_target(20.0, 4.0) && unsure.is_mutual());
    }
}
