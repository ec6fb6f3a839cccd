//! Plots of radars, and the reasons why plots are not used.

pub(super) mod clock;
pub(super) mod geometry;
pub(super) mod individual;
pub(super) mod level;

use crate::base::exponential::exp;
use crate::base::plane::Plane;
use crate::sensors::{Detection, Identities, Radar};
use geometry::{Geometry, Polar};
use individual::{Individual, key};
use level::Level;
use serde::{Deserialize, Serialize};
use std::cmp::Ordering;

/// Largest time, s (3000 years), beyond which the resolution of times is too coarse; largest range
/// or height, m.
const LATEST: f64 = 1e11;
const FARTHEST: f64 = 1e9;
/// Codes of tracks without a final number are larger than all others.
const FIRST_PROVISIONAL: i64 = 1 << 40;

/// A position that a sensor reports, or from which it measures an azimuth.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// East and north, m.
    pub position: [f64; 2],
    /// Covariance; nan if the covariance of the sensor applies.
    pub covariance: Plane,
    /// Velocity to the east and north, m/s; nan if there is none.
    pub velocity: [f64; 2],
    /// Covariance of the velocity; nan if that of the sensor applies.
    pub velocity_covariance: Plane,
}

impl Report {
    /// A report of a position alone.
    pub fn of(position: [f64; 2], covariance: Plane) -> Self {
        let none = f64::NAN;
        let velocity_covariance = Plane { xx: none, xy: none, yy: none };
        Self { position, covariance, velocity: [none; 2], velocity_covariance }
    }

    /// The velocity with its covariance, or with that of its sensor; none if there is no valid
    /// velocity.
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

    /// All numbers of the report.
    fn numbers(&self) -> [f64; 10] {
        let ([x, y], Plane { xx, xy, yy }) = (self.position, self.covariance);
        let [vx, vy] = self.velocity;
        let Plane { xx: uu, xy: uv, yy: vv } = self.velocity_covariance;
        [x, y, xx, xy, yy, vx, vy, uu, uv, vv]
    }
}

/// Returns the covariance, or that of the standard deviation `sigma` if it is not given; none if
/// the result is not positive definite.
pub(super) fn stated(covariance: Plane, sigma: f64) -> Option<Plane> {
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
    /// Time, s.
    pub time: f64,
    /// Range, m.
    pub range: f64,
    /// Azimuth, rad, clockwise from north.
    pub azimuth: f64,
    /// Index of the radar.
    pub radar: usize,
    /// Height, m; nan if there is none.
    pub height: f64,
    /// Replies of the transponder.
    pub identities: Identities,
    /// Channels that detected the plot; none if they are not known.
    pub detection: Option<Detection>,
    /// Report of a sensor of positions, in place of range and azimuth.
    pub report: Option<Report>,
}

impl Plot {
    /// Whether its numbers are finite and possible.
    fn is_valid(&self) -> bool {
        let finite = self.time.is_finite() && self.range.is_finite() && self.azimuth.is_finite();
        let far = self.time.abs() > LATEST || self.range > FARTHEST || self.height.abs() > FARTHEST;
        finite && !far && self.range > 0.0 && !self.height.is_infinite()
    }

    /// Why the plot cannot be used; none if it can.
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

    /// Status of a plot without a fault, until a track takes it or another reason is found.
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

    /// Orders plots by time, then by radar and all other contents, so that the order does not
    /// depend on when the plots arrived.
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

    /// East and north with their covariance; none if the plot is invalid or straight above the
    /// radar.
    pub fn to_cartesian(&self, radar: &Radar) -> Option<([f64; 2], Plane)> {
        let radar = radar.detecting(self.detection);
        let position = radar.position_of(self.range, self.azimuth, self.height);
        let position = position.filter(|_| self.is_valid())?;
        Some((position, radar.noise_at(position, self.height - radar.position[2])))
    }
}

/// Plots that are stored elsewhere, so that none need be copied.
pub trait Plots {
    /// Number of plots.
    fn len(&self) -> usize;
    /// The plot of this index.
    fn get(&self, index: usize) -> Plot;
    /// Index of the radar of this plot.
    fn radar(&self, index: usize) -> usize {
        self.get(index).radar
    }
    /// Height of this plot, m; nan if there is none.
    fn height(&self, index: usize) -> f64 {
        self.get(index).height
    }
    /// Range and azimuth of this plot as they were measured, without corrections.
    fn measured(&self, index: usize) -> [f64; 2] {
        let plot = self.get(index);
        [plot.range, plot.azimuth]
    }
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
    /// It repeats the one before it or the last position of its target, or is a second plot of its target.
    Duplicate,
    /// It comes alone, long after the others.
    ClockError,
    /// It belongs to a track without a final number, whose first plot has this index.
    Provisional(usize),
    /// It is a position whose accuracy is not known.
    NoQuality,
    /// It is an azimuth that belongs to no track, or that may belong to several tracks.
    Unassociated,
    /// It is of a target elsewhere, seen by way of a reflector or a side lobe.
    Reflection,
    /// It was combined with others of its target, and has the status of the plot with this index.
    Combined(usize),
}

impl PlotStatus {
    /// Status of a plot of a track, which may be a reflection.
    pub(super) fn of(track: u64, is_reflection: bool) -> Self {
        if is_reflection { Self::Reflection } else { Self::Track(track) }
    }

    /// The number of the track, or a negative number that says why the plot was not used.
    pub fn code(self) -> i64 {
        match self {
            Self::Track(number) => number as i64,
            Self::Invalid => -1,
            Self::Late => -2,
            Self::AtSensor => -3,
            Self::OutOfRange => -4,
            Self::ClockError => -5,
            // the status of a combined plot is that of another one
            Self::Duplicate | Self::Combined(_) => -6,
            Self::Provisional(first) => FIRST_PROVISIONAL + first as i64,
            Self::NoQuality => -7,
            Self::Unassociated => -8,
            Self::Reflection => -9,
        }
    }
}

/// The measured velocity of a target, and its covariance.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Moving {
    pub velocity: [f64; 2],
    pub noise: Plane,
}

/// How the position of a plot is known.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) enum Source {
    /// From range and azimuth in the plane; the covariance is that of the radar at this place.
    #[default]
    Polar,
    /// Given with this covariance.
    Placed(Plane),
    /// Given with this covariance, together with a velocity.
    Moving(Plane, Moving),
    /// From slant range and azimuth without a height, which has this prior mean and variance until
    /// the track of the plot is known.
    Slant { polar: Polar, prior: [f64; 2] },
}

impl Source {
    /// The covariance that was given with the position.
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
    /// Index among all plots that were passed to the tracker.
    pub index: usize,
    pub time: f64,
    pub radar: usize,
    pub position: [f64; 2],
    pub source: Source,
    pub height: f64,
    pub identities: Identities,
    /// Channels that detected the plot, if its radar has such channels.
    pub detection: Option<Detection>,
    /// Logarithm of the factor by which targets are likelier than false plots to be detected by
    /// these channels and at this place, compared with all plots of the radar.
    pub gain: f64,
}

impl Measured {
    /// Reads numbers in all parts of the plot, so that it is loaded into the cache.
    #[inline(always)]
    pub fn touched(&self) -> f64 {
        self.time + self.height + self.gain
    }

    /// Whether the plot may come from something other than a target: it has neither a reply nor a
    /// height.
    #[inline]
    pub fn is_bare(&self) -> bool {
        let replied = self.detection.is_some_and(|own| own != Detection::Psr);
        !replied && !self.height.is_finite() && !self.identities.is_some()
    }

    /// Density of false plots with which this plot competes: the `density` of all false plots,
    /// divided by the factor e^`gain` by which targets are likelier than false plots to make such
    /// plots.
    #[inline]
    pub fn rivals(&self, density: f64) -> f64 {
        if self.gain == 0.0 { density } else { density * exp(-self.gain) }
    }

    /// Brings a valid plot into the plane; `stretch` is that of the radar, `level` the heights of
    /// the traffic.
    #[inline]
    pub fn new(
        index: usize,
        plot: &Plot,
        (radar, geometry): (&Radar, &Geometry),
        stretch: f64,
        level: &Level,
    ) -> Self {
        let &Plot { time, range, azimuth, radar: number, height, identities, report, .. } = plot;
        let polar = || Polar::new(range, azimuth);
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
            own.slant(polar(), (radar, geometry), level);
        } else if !on_earth {
            let ground = radar.ground_squared(range, height).unwrap_or(0.0);
            own.position = radar.position_at(ground, azimuth, stretch);
        } else if let Some(seen) = geometry.see(radar, &polar(), height) {
            (own.position, own.source) = (seen.position, Source::Placed(seen.noise));
        } else {
            // the height is impossible at this range and is not used
            own.height = f64::NAN;
            own.slant(polar(), (radar, geometry), level);
        }
        own
    }

    /// Adds the variances of rounded coordinates to the covariance of a reported position, and multiplies it by
    /// this ratio, and by that of its target.
    #[inline]
    pub fn widen(&mut self, (rounded, ratio): ([f64; 2], f64), individual: &Individual) {
        if let Source::Placed(noise) | Source::Moving(noise, _) = &mut self.source {
            let [xx, yy] = rounded;
            let noise_of_all = noise.plus(Plane { xx, xy: 0.0, yy });
            *noise = individual.noise(key(&self.identities), noise_of_all.scaled(ratio));
        }
    }

    fn slant(&mut self, polar: Polar, (radar, geometry): (&Radar, &Geometry), level: &Level) {
        let prior = level.prior(geometry.site(radar), polar.range);
        self.position = geometry.placed(radar, &polar, prior[0]).position;
        self.source = Source::Slant { polar, prior };
    }
}

/// Number of plots that show that a silence of more than `LONG` times the limit is real, if plots
/// from before the silence came in the same call.
const RESUMED: usize = 5;
const LONG: f64 = 40.0;

/// Keeps the times, in their order, that follow the ones before or the time `after` within
/// `silence`, or that come with others after a longer silence; returns the last one. A single time
/// after a longer silence is refused and becomes the next `stray`, unless it lies within `silence`
/// of the previous `stray`. A few times after a very long silence are refused as well, if times
/// from before it came in the same call: then there was no such silence.
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
