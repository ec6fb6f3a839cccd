//! Plots of radars, and why one is not used.

use super::geometry::Geometry;
use super::level::Level;
use crate::base::exponential::exp;
use crate::base::plane::Plane;
use crate::sensors::{Detection, Identities, Radar};
use serde::{Deserialize, Serialize};
use std::cmp::Ordering;

/// Largest time, s (3000 years), beyond which the resolution of seconds is lost, and range, m.
const LATEST: f64 = 1e11;
const FARTHEST: f64 = 1e9;
/// Codes of tracks without a final number are above all others.
const FIRST_PROVISIONAL: i64 = 1 << 40;

/// A position that a sensor reports, or from which it measures an azimuth.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// East and north, m.
    pub position: [f64; 2],
    /// Covariance; not numbers where the sensor says what it is.
    pub covariance: Plane,
    /// East and north, m/s; not numbers where there is none.
    pub velocity: [f64; 2],
    /// Its covariance, as that of the position.
    pub velocity_covariance: Plane,
}

impl Report {
    /// A position alone.
    pub fn of(position: [f64; 2], covariance: Plane) -> Self {
        let none = f64::NAN;
        let velocity_covariance = Plane { xx: none, xy: none, yy: none };
        Self { position, covariance, velocity: [none; 2], velocity_covariance }
    }

    /// Its velocity, with its covariance or that of its sensor; none where it has none.
    fn moving(&self, sigma: f64) -> Option<Moving> {
        let noise = stated(self.velocity_covariance, sigma)?;
        let holds = self.velocity.iter().all(|v| v.is_finite());
        holds.then_some(Moving { velocity: self.velocity, noise })
    }

    /// Its velocity and the covariance of it, if it has both.
    pub fn stated_velocity(&self) -> Option<([f64; 2], Plane)> {
        let Moving { velocity, noise } = self.moving(f64::NAN)?;
        Some((velocity, noise))
    }

    /// All its numbers.
    fn numbers(&self) -> [f64; 10] {
        let ([x, y], Plane { xx, xy, yy }) = (self.position, self.covariance);
        let [vx, vy] = self.velocity;
        let Plane { xx: uu, xy: uv, yy: vv } = self.velocity_covariance;
        [x, y, xx, xy, yy, vx, vy, uu, uv, vv]
    }
}

/// A covariance, or that of this standard deviation where it is not given; none where neither is one.
fn stated(covariance: Plane, sigma: f64) -> Option<Plane> {
    let Plane { xx, xy, yy } = covariance;
    let own = if xx.is_nan() && xy.is_nan() && yy.is_nan() {
        Plane { xx: sigma * sigma, xy: 0.0, yy: sigma * sigma }
    } else {
        covariance
    };
    let holds = own.xx > 0.0 && own.xx.is_finite() && own.determinant() > 0.0;
    holds.then_some(own)
}

/// A plot of a radar, or a position.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Plot {
    /// s
    pub time: f64,
    /// m
    pub range: f64,
    /// rad, clockwise from north
    pub azimuth: f64,
    /// Index of the radar.
    pub radar: usize,
    /// m; nan where there is none
    pub height: f64,
    /// Replies of the transponder.
    pub identities: Identities,
    /// By what it was detected; none where that is not known.
    pub detection: Option<Detection>,
    /// What a sensor of positions reports, in place of range and azimuth.
    pub report: Option<Report>,
}

impl Plot {
    /// Whether its numbers are finite and possible.
    fn is_valid(&self) -> bool {
        let finite = self.time.is_finite() && self.range.is_finite() && self.azimuth.is_finite();
        let far = self.time.abs() > LATEST || self.range > FARTHEST || self.height.abs() > FARTHEST;
        finite && !far && self.range > 0.0 && !self.height.is_infinite()
    }

    /// Why it cannot be used, if so.
    pub(super) fn fault(&self, radar: &Radar, geometry: &Geometry) -> Option<PlotStatus> {
        if let Geometry::Position([sigma, _]) = geometry {
            return self.report_fault(*sigma);
        }
        if geometry.is_azimuth() {
            return self.azimuth_fault();
        }
        match () {
            () if !self.is_valid() => Some(PlotStatus::Invalid),
            () if self.range > geometry.max_range(radar) => Some(PlotStatus::OutOfRange),
            () if geometry.is_above(radar, self.range, self.height) => Some(PlotStatus::AtSensor),
            () => None,
        }
    }

    fn azimuth_fault(&self) -> Option<PlotStatus> {
        let near = |x: f64| x.abs() <= FARTHEST;
        let place = self.report.is_some_and(|report| report.position.into_iter().all(near));
        let holds = place && self.azimuth.is_finite() && self.time.abs() <= LATEST;
        (!holds).then_some(PlotStatus::Invalid)
    }

    /// What becomes of it unless something else is said.
    pub(super) fn unused(geometry: &Geometry) -> PlotStatus {
        if geometry.is_azimuth() { PlotStatus::Unassociated } else { PlotStatus::Invalid }
    }

    fn report_fault(&self, sigma: f64) -> Option<PlotStatus> {
        let near = |x: f64| x.abs() <= FARTHEST;
        let report = self.report.filter(|report| report.position.into_iter().all(near));
        match report {
            Some(_) if self.time.is_nan() || self.time.abs() > LATEST => Some(PlotStatus::Invalid),
            Some(_) if self.height.abs() > FARTHEST => Some(PlotStatus::Invalid),
            Some(report) => {
                stated(report.covariance, sigma).is_none().then_some(PlotStatus::NoQuality)
            }
            None => Some(PlotStatus::Invalid),
        }
    }

    /// Whether this is the same plot again, in the plane.
    pub(super) fn repeats(&self, other: &Self, radar: &Radar) -> bool {
        let place = |plot: &Self| radar.position_of(plot.range, plot.azimuth, plot.height);
        let source = self.radar == other.radar && self.identities == other.identities;
        let same = self.report == other.report && place(self) == place(other);
        self.time == other.time && source && same
    }

    /// The order of time, then that of all else: by what plots are, not by when they came.
    pub(super) fn by_content(&self, other: &Self) -> Ordering {
        let numbers = |plot: &Self| [plot.range, plot.azimuth, plot.height];
        let times = self.time.total_cmp(&other.time).then(self.radar.cmp(&other.radar));
        let reported = |plot: &Self| plot.report.map_or([0.0; 10], |report| report.numbers());
        let pairs = numbers(self).into_iter().zip(numbers(other));
        let more = reported(self).into_iter().zip(reported(other));
        let order = pairs.chain(more).fold(times, |order, (a, b)| order.then(a.total_cmp(&b)));
        order
            .then(self.identities.cmp(&other.identities))
            .then(self.detection.cmp(&other.detection))
    }

    /// East and north with their covariance; none where the plot is invalid or straight above the
    /// radar.
    pub fn to_cartesian(&self, radar: &Radar) -> Option<([f64; 2], Plane)> {
        let radar = radar.detecting(self.detection);
        let position = radar.position_of(self.range, self.azimuth, self.height);
        let position = position.filter(|_| self.is_valid())?;
        Some((position, radar.noise_at(position, self.height - radar.position[2])))
    }
}

/// Plots as they are kept elsewhere, so that none are copied.
pub trait Plots {
    /// Number of plots.
    fn len(&self) -> usize;
    /// The plot of this index.
    fn get(&self, index: usize) -> Plot;
    /// Whether there are none.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

impl Plots for [Plot] {
    fn len(&self) -> usize {
        self.len()
    }

    #[inline]
    fn get(&self, index: usize) -> Plot {
        self[index]
    }
}

/// The track of a plot, or why it was not used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PlotStatus {
    /// It belongs to this track.
    Track(u64),
    /// A number is not finite or too large, or the range is not positive.
    Invalid,
    /// It is older than plots that were processed before.
    Late,
    /// It is straight above the radar.
    AtSensor,
    /// It is beyond the range of the radar.
    OutOfRange,
    /// It repeats the one before it.
    Duplicate,
    /// It comes alone, long after the others.
    ClockError,
    /// It belongs to a track without a final number: index of the first plot of that.
    Provisional(usize),
    /// A position whose accuracy is not known.
    NoQuality,
    /// An azimuth of no track, or of tracks that it does not tell apart.
    Unassociated,
    /// It is of a target elsewhere, by way of a reflector or a side lobe.
    Reflection,
}

impl PlotStatus {
    /// That of a plot of a track, which may be a reflection.
    pub(super) fn of(track: u64, is_reflection: bool) -> Self {
        if is_reflection { Self::Reflection } else { Self::Track(track) }
    }

    /// The number of the track, or a negative number: why the plot was not used.
    pub fn code(self) -> i64 {
        match self {
            Self::Track(number) => number as i64,
            Self::Invalid => -1,
            Self::Late => -2,
            Self::AtSensor => -3,
            Self::OutOfRange => -4,
            Self::ClockError => -5,
            Self::Duplicate => -6,
            Self::Provisional(first) => FIRST_PROVISIONAL + first as i64,
            Self::NoQuality => -7,
            Self::Unassociated => -8,
            Self::Reflection => -9,
        }
    }
}

/// The velocity of a target as it was measured, and its covariance.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Moving {
    pub velocity: [f64; 2],
    pub noise: Plane,
}

/// How the position of a plot is known.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) enum Source {
    /// By range and azimuth in the plane, with the noise of its radar there.
    #[default]
    Polar,
    /// With this covariance.
    Placed(Plane),
    /// With this covariance, and a velocity.
    Moving(Plane, Moving),
    /// By slant range and azimuth without a height, which has this mean and variance before its track
    /// is known.
    Slant { polar: [f64; 2], prior: [f64; 2] },
}

impl Source {
    /// The covariance that the position came with.
    pub fn placed(&self) -> Option<Plane> {
        match *self {
            Self::Placed(noise) | Self::Moving(noise, _) => Some(noise),
            Self::Polar | Self::Slant { .. } => None,
        }
    }
}

/// A plot in the plane.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Measured {
    /// Index among the plots that were given.
    pub index: usize,
    pub time: f64,
    pub radar: usize,
    pub position: [f64; 2],
    pub source: Source,
    pub height: f64,
    pub identities: Identities,
    /// By what it was detected, where its radar has channels for that.
    pub detection: Option<Detection>,
    /// Logarithm of how much likelier targets make such plots than false ones come so, by comparison
    /// with all plots of the radar.
    pub gain: f64,
}

impl Measured {
    /// Numbers all over it, so that it is in the cache.
    #[inline(always)]
    pub fn touched(&self) -> f64 {
        self.time + self.height + self.gain
    }

    /// Whether something that is no target of its own may make it: it has neither reply nor height.
    #[inline]
    pub fn is_bare(&self) -> bool {
        let replied = self.detection.is_some_and(|own| own != Detection::Psr);
        !replied && !self.height.is_finite() && !self.identities.is_some()
    }

    /// The density of false plots that are detected as this one, as if targets made all their plots so,
    /// where that of all is `density`.
    #[inline]
    pub fn rivals(&self, density: f64) -> f64 {
        if self.gain == 0.0 { density } else { density * exp(-self.gain) }
    }

    /// A plot that can be used, in the plane; `stretch` is that of the radar, `level` that of the
    /// traffic.
    #[inline]
    pub fn new(
        index: usize,
        plot: &Plot,
        (radar, geometry): (&Radar, &Geometry),
        stretch: f64,
        level: &Level,
    ) -> Self {
        let &Plot { time, range, azimuth, radar: number, height, identities, report, .. } = plot;
        let polar = [range, azimuth];
        let mut own = Self { index, time, radar: number, height, identities, ..Self::default() };
        own.detection = radar.known(plot.detection);
        let (radar, stretch) = match radar.way(own.detection) {
            None => (radar, stretch),
            Some(_) => (radar.detecting(own.detection), radar.detecting(own.detection).stretch()),
        };
        if let (Geometry::Position([sigma, of_velocity]), Some(report)) = (geometry, report) {
            let noise = stated(report.covariance, *sigma).unwrap_or_default();
            let moving = report.moving(*of_velocity);
            own.position = report.position;
            own.source = moving.map_or(Source::Placed(noise), |own| Source::Moving(noise, own));
            return own;
        }
        let on_earth = matches!(geometry, Geometry::Earth(..));
        if height.is_nan() && geometry.is_slant(level.is_known()) {
            own.slant(polar, (radar, geometry), level);
        } else if !on_earth {
            let ground = radar.ground_squared(range, height).unwrap_or(0.0);
            own.position = radar.position_at(ground, azimuth, stretch);
        } else if let Some(seen) = geometry.see(radar, polar, height) {
            (own.position, own.source) = (seen.position, Source::Placed(seen.noise));
        } else {
            // the height is impossible at this range: it is not used
            own.height = f64::NAN;
            own.slant(polar, (radar, geometry), level);
        }
        own
    }

    fn slant(&mut self, polar: [f64; 2], (radar, geometry): (&Radar, &Geometry), level: &Level) {
        let prior = level.prior(geometry.site(radar), polar[0]);
        self.position = geometry.placed(radar, polar, prior[0]).position;
        self.source = Source::Slant { polar, prior };
    }
}

/// Plots after a silence that is so many times as long as one that tells show that there was one, where
/// others came before it at the same time.
const RESUMED: usize = 5;
const LONG: f64 = 40.0;

/// Keeps times, in their order, that come within a silence `after` the ones before, or with others;
/// returns the last. A single one after a longer silence is refused, and is the next `stray`; so are few
/// that come together with plots before the silence: there was none.
pub(super) fn keep_followed(
    order: &mut Vec<(f64, usize)>,
    after: f64,
    stray: &mut f64,
    silence: f64,
    mut refuse: impl FnMut(usize),
) -> f64 {
    let (mut before, mut kept, mut begin) = (after, 0, 0);
    while begin < order.len() {
        let is_last = |&i: &usize| order[i].0 - order[i - 1].0 > silence;
        let end = (begin + 1..order.len()).find(is_last).unwrap_or(order.len());
        let (first, last, count) = (order[begin].0, order[end - 1].0, end - begin);
        let follows = first - before <= silence || before == f64::NEG_INFINITY;
        let is_far = kept > 0 && first - before > LONG * silence;
        let is_resumed = match count {
            1 => !is_far && (first - *stray).abs() <= silence,
            _ => !is_far || count >= RESUMED.min(kept),
        };
        if follows || is_resumed {
            order.copy_within(begin..end, kept);
            kept += count;
            before = last;
        } else {
            *stray = last;
            order[begin..end].iter().for_each(|(_, index)| refuse(*index));
        }
        begin = end;
    }
    order.truncate(kept);
    before
}
