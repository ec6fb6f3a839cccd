//! Targets that a position sensor reports repeatedly: old positions that are reported again, the interval
//! between reports, and parts of the plots in which each target is reported once.

use super::copies::{self, Copies};
use crate::tracker::plot::geometry::Geometry;
use crate::tracker::plot::{Plot, Plots, stated};
use crate::tracker::settings::Settings;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, HashMap};
use std::f64::consts::SQRT_2;

/// Errors of positions that are expected, in standard deviations.
const ERRORS: f64 = 3.0;
/// Time between the two positions from which the speed of a target is known, s: at least this, if the sensor
/// reports more often.
const LEVER: f64 = 3.0;
/// Time for which the last position of a target is kept, s, and number of targets from which on old ones are
/// removed.
const KEPT: f64 = 600.0;
const MANY: usize = 64;
/// Least number of plots in a part, as a share of the number of tracks: each part visits all tracks.
const SHARE: usize = 8;
/// Time for which a plot waits for later plots that compete with it, as a share of the shortest scan.
pub(in crate::tracker) const WAITING: f64 = 0.125;
/// Duration of a part of the plots, in which each target is reported once, as a share of the interval between
/// reports.
pub(in crate::tracker) const ONCE: f64 = 1.0 - 2.0 * WAITING;
/// Share of the reports that follow sooner than the estimated interval, and the step of its logarithm.
const SOON: f64 = 0.25;
const STEP: f64 = 0.1;
/// Shortest interval between reports, s.
const SHORTEST: f64 = 1e-3;

/// Times of plots, in order, and their indices.
type Timed<'a> = &'a [(f64, usize)];

/// A target of a sensor: the kind of its identity, its identity, and the sensor.
type Name = (u8, i64, usize);

/// Returns the identity and the sensor of a report; none if its identity is not known, or is shared by many.
fn name(plot: &Plot) -> Option<Name> {
    copies::name(plot).map(|(kind, identity)| (kind, identity, plot.radar))
}

/// Where a target was.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Place {
    position: [f64; 2],
    time: f64,
}

/// The last new position of a target, and one before it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Reported {
    before: Option<Place>,
    last: Place,
}

impl Reported {
    /// How far the target must have moved since its last position, m, even if it has braked as hard as it
    /// can; 0 if it may have stopped, or if its speed is not known.
    fn moved(&self, time: f64, sigma: f64, settings: &Settings) -> f64 {
        let Some(before) = self.before else { return 0.0 };
        let [from, to] = [before.position, self.last.position];
        let (flown, duration) =
            (f64::hypot(to[0] - from[0], to[1] - from[1]), self.last.time - before.time);
        let braking = settings.guard_acceleration.into_iter().fold(0.0, f64::max);
        // its mean speed at least, and what it may have braked before its last position
        let mean = (flown - ERRORS * SQRT_2 * sigma) / duration;
        let speed = mean - 0.5 * braking * duration;
        // faster than targets are: the positions are not all of this target
        if !(speed > 0.0 && flown <= settings.max_speed * duration) {
            return 0.0;
        }
        let since = (time - self.last.time).min(speed / braking);
        (speed - 0.5 * braking * since) * since
    }

    fn take(&mut self, place: Place) {
        if self.before.is_none_or(|before| self.last.time - before.time >= LEVER) {
            self.before = Some(self.last);
        }
        self.last = place;
    }
}

/// The last positions of the targets of position sensors, and the last plots of all sensors.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Repeats {
    pub copies: Copies,
    targets: BTreeMap<Name, Reported>,
}

impl Repeats {
    /// Whether a report, which comes after those before it, has exactly the last position of its target
    /// although the target cannot be there any more.
    pub fn is_old(&mut self, plot: &Plot, settings: &Settings) -> bool {
        let (Some(report), Some(name)) = (&plot.report, name(plot)) else { return false };
        let place = Place { position: report.position, time: plot.time };
        let Some(target) = self.targets.get_mut(&name) else {
            self.forget(plot.time);
            self.targets.insert(name, Reported { before: None, last: place });
            return false;
        };
        if place.time <= target.last.time {
            return false;
        }
        if place.position != target.last.position {
            target.take(place);
            return false;
        }
        let Geometry::Position([own, _]) = settings.geometry(plot.radar) else { return false };
        let sigma = stated(report.covariance, *own).map_or(0.0, |r| r.xx.max(r.yy).sqrt());
        let moved = target.moved(plot.time, sigma, settings);
        // a velocity that is reported with it is that of a target that has stopped
        let is_slow = f64::hypot(report.velocity[0], report.velocity[1])
            * (plot.time - target.last.time)
            < 0.5 * moved;
        moved > ERRORS * sigma && !is_slow
    }

    /// Removes targets that have not been reported for long, now and then.
    fn forget(&mut self, time: f64) {
        if self.targets.len() >= MANY && self.targets.len().is_power_of_two() {
            self.targets.retain(|_, target| time - target.last.time <= KEPT);
        }
    }
}

/// The interval between reports of a target by one position sensor, as its tracks show it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Interval {
    pub stated: f64,
    seconds: f64,
}

impl Interval {
    pub fn new(stated: f64) -> Self {
        Self { stated, seconds: stated }
    }

    /// Updates the interval by the time between two reports of a target. Copies of a report, which have the same
    /// time, are not reports of their own.
    pub fn saw(&mut self, seconds: f64) {
        if seconds < SHORTEST {
            return;
        }
        let step = if seconds < self.seconds { SOON - 1.0 } else { SOON };
        self.seconds = (self.seconds * (STEP * step).exp()).min(self.stated);
    }

    /// Whether targets report so often that several reports would be in one part of the plots.
    pub fn is_shorter(&self) -> bool {
        self.seconds < ONCE * self.stated
    }

    /// The interval, s; infinite unless it is much shorter than stated.
    pub fn seconds(&self) -> f64 {
        if self.is_shorter() { self.seconds } else { f64::INFINITY }
    }
}

/// Divides plots, given as times and indices in the order of time, into those from time `from` that are
/// processed next and the rest. These are the plots before `until`. The part ends sooner if reports of a target
/// follow in a shorter `interval` or, where all sensors report positions, if any target is reported again:
/// states are more accurate if reports of a target are processed one after another. In that case its end is
/// returned, too.
pub(in crate::tracker) fn next_part<'a, P: Plots + ?Sized>(
    (plots, rest): (&P, Timed<'a>),
    [from, until]: [f64; 2],
    (tracks, settings, interval): (usize, &Settings, f64),
) -> (Timed<'a>, Timed<'a>, Option<f64>) {
    let least = tracks.div_ceil(SHARE);
    let enough = rest.get(least).map_or(until, |(time, _)| *time);
    let end = enough.max(from + ONCE * interval);
    let found = reported_again((plots, rest), until.min(end), (least, settings));
    let end = found.or((end < until).then_some(end));
    let (now, later) =
        rest.split_at(rest.partition_point(|(time, _)| *time < end.unwrap_or(until)));
    (now, later, end)
}

/// Time before `until` at which a target is reported again, after at least `least` plots, if all sensors report
/// positions.
fn reported_again<P: Plots + ?Sized>(
    (plots, rest): (&P, Timed<'_>),
    until: f64,
    (least, settings): (usize, &Settings),
) -> Option<f64> {
    let is_radar = |sensor: usize| {
        let geometry = settings.geometry(sensor);
        !geometry.is_position() && !geometry.is_azimuth()
    };
    if (0..settings.radars.len()).any(is_radar) {
        return None;
    }
    let mut seen: HashMap<Name, f64> = HashMap::new();
    let mut before = 0;
    for (count, &(time, i)) in rest.iter().enumerate().take_while(|(_, (time, _))| *time < until) {
        if count > 0 && rest[count - 1].0 < time {
            before = count;
        }
        let Some(name) = name(&plots.get(i)) else { continue };
        let first = *seen.entry(name).or_insert(time);
        if first < time && before >= least {
            return Some(time);
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_interval_is_estimated_where_it_is_much_shorter_than_stated() {
        for (seconds, used) in [(0.1, 0.1), (0.6, 0.6), (0.9, f64::INFINITY), (2.0, f64::INFINITY)]
        {
            let mut interval = Interval::new(1.0);
            for report in 0..200 {
                // each tenth report is missing
                interval.saw(if report % 10 == 0 { 2.0 * seconds } else { seconds });
                // copies of a report
                interval.saw(0.0);
            }
            assert_eq!(interval.is_shorter(), used.is_finite());
            assert!(used.is_infinite() || (interval.seconds() / used - 1.0).abs() < 0.1);
        }
    }
}
