//! Combines the plots of targets that are larger than the resolution of a sensor: such a target gives several
//! plots in a scan, anywhere on it.
//!
//! The plots of a scan are divided among the tracks near them; those that no track is near are combined if one
//! target can have given all of them. A track learns how its plots are spread about their mean (Koch 2008,
//! without the coupling of spread and noise of the motion). Plots that are combined count as one plot in their
//! mean, whose covariance contains the spread of a single plot: which parts of the target were seen may stay
//! the same from scan to scan. For the same reason the rows of the track contain the spread.

use crate::association::Grid;
use crate::base::plane::Plane;
use crate::sensors::SPREAD;
use crate::tracker::plot::{Measured, Moving, PlotStatus, Source};
use crate::tracker::settings::Settings;
use crate::tracker::track::Track;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};

/// Largest variance along an axis of a plot about the centre of a target, as a share of the squared extent.
const LARGEST: f64 = 1.0 / 12.0;
/// Number of plots, less one per scan, that this prior is worth, and number over which a spread is averaged.
const PRIOR: f64 = 3.0;
const MEMORY: f64 = 100.0;
/// Squared normalised distance within which a plot may be of a track, and of noise in standard deviations by
/// which two plots of a target may be farther apart than its extent.
const GATE: f64 = 12.0;
const ERRORS: f64 = 3.0;
/// Longest time between two plots of one target in a scan, as a share of the scan.
const SOON: f64 = 0.1;
/// Number of tracks from which on the shapes of ended ones are removed now and then.
const MANY: usize = 64;

/// How the plots of a target are spread about its centre.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Shape {
    /// Number of plots, less one per scan with several plots.
    weight: f64,
    /// Sum of squares about the mean of each scan, or of single plots about the prediction, less what is
    /// expected without any extent, m².
    scatter: Plane,
}

impl Shape {
    /// Covariance of a plot about the centre of its target.
    fn spread(&self, extent: f64) -> Plane {
        let squared = extent * extent;
        let prior = PRIOR * SPREAD * squared;
        let sum = self.scatter.plus(Plane { xx: prior, xy: 0.0, yy: prior });
        limited(sum.scaled(1.0 / (PRIOR + self.weight)), LARGEST * squared)
    }

    fn learn(&mut self, weight: f64, scatter: Plane) {
        let kept = (-weight / MEMORY).exp();
        self.weight = kept * self.weight + weight;
        self.scatter = self.scatter.scaled(kept).plus(scatter);
    }
}

/// Returns a matrix with the same axes and variances between 0 and `most`.
fn limited(p: Plane, most: f64) -> Plane {
    let (mean, off) = (0.5 * (p.xx + p.yy), 0.5 * (p.xx - p.yy));
    let half = f64::hypot(off, p.xy);
    let [large, small] = [mean + half, mean - half].map(|variance| variance.clamp(0.0, most));
    let share = if half > 0.0 { 0.5 * (large - small) / half } else { 0.0 };
    let mean = 0.5 * (large + small);
    Plane { xx: mean + share * off, xy: share * p.xy, yy: mean - share * off }
}

/// The shapes of the targets of tracks.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Shapes(BTreeMap<u64, Shape>);

/// Plots that were combined, and what they say about the shape of their target: a weight and a scatter.
#[derive(Debug)]
struct Group {
    plots: Vec<Measured>,
    shape: (f64, Plane),
}

/// The plots that were combined in a scan.
#[derive(Debug, Default)]
pub(in crate::tracker) struct Groups {
    /// By the index of the plot that stands for all of a group.
    groups: BTreeMap<usize, Group>,
    /// Indices of plots that came after their track had been given other plots of the same scan.
    pub late: Vec<usize>,
}

impl Groups {
    /// Passes the status of a plot on to the plots that were combined with it, and what they say about the shape
    /// of their target to its track.
    pub fn pass_on(
        &self,
        plot: usize,
        status: PlotStatus,
        shapes: &mut Shapes,
        report: &mut impl FnMut(usize, PlotStatus),
    ) {
        let Some(group) = self.groups.get(&plot) else { return };
        for other in group.plots.iter().filter(|other| other.index != plot) {
            report(other.index, PlotStatus::Combined(plot));
        }
        if let PlotStatus::Track(number) = status {
            let (weight, scatter) = group.shape;
            shapes.0.entry(number).or_default().learn(weight, scatter);
        }
    }

    /// Replaces combined plots that wait for the next scan by the plots themselves.
    pub fn divide(mut self, waiting: &mut Vec<Measured>) {
        if self.groups.is_empty() {
            return;
        }
        let mut plots = Vec::with_capacity(waiting.len());
        for plot in waiting.drain(..) {
            match self.groups.remove(&plot.index) {
                Some(group) => plots.extend(group.plots),
                None => plots.push(plot),
            }
        }
        plots.sort_by(|a, b| a.time.total_cmp(&b.time));
        *waiting = plots;
    }
}

impl Shapes {
    /// Combines the plots of each extended target in a scan. Cost O(plots log plots), if there are O(1) tracks
    /// near a plot, plus O(P²) for P simultaneous plots that no track is near.
    pub fn combine(
        &self,
        plots: &mut Vec<Measured>,
        tracks: &[Track],
        settings: &Settings,
    ) -> Groups {
        let mut found = Groups::default();
        if !settings.has_extents() {
            return found;
        }
        let is_extended = |plot: &Measured| settings.radars[plot.radar].extent > 0.0;
        let own: Vec<Measured> = plots.iter().copied().filter(is_extended).collect();
        plots.retain(|plot| !is_extended(plot));
        let noise: Vec<Plane> = own.iter().map(|plot| noise_of(plot, settings)).collect();
        let nearest = self.nearest((&own, &noise), tracks, settings);
        for group in grouped((&own, &noise), &nearest, settings) {
            let (first, track) = (group[0], nearest[group[0]].map(|track| &tracks[track]));
            if track.is_some_and(|track| has_seen(track, &own[first], settings)) {
                found.late.extend(group.iter().map(|&i| own[i].index));
                continue;
            }
            let shape = track.and_then(|track| self.0.get(&track.number)).copied();
            let spread = shape.unwrap_or_default().spread(settings.radars[own[first].radar].extent);
            let (plot, scatter) = combined(&group, (&own, &noise), spread);
            plots.push(plot);
            let shape = match track {
                Some(track) if group.len() == 1 && track.is_confirmed() => {
                    (1.0, excess(track, &own[first], noise[first]))
                }
                _ => (group.len() as f64 - 1.0, scatter),
            };
            let members = group.into_iter().map(|i| own[i]).collect();
            found.groups.insert(plot.index, Group { plots: members, shape });
        }
        plots.sort_by(|a, b| a.time.total_cmp(&b.time).then(a.index.cmp(&b.index)));
        found
    }

    /// Returns for each plot the index of the track to which it belongs most likely; none if no track is near.
    /// Confirmed tracks come first.
    fn nearest(
        &self,
        (plots, noise): (&[Measured], &[Plane]),
        tracks: &[Track],
        settings: &Settings,
    ) -> Vec<Option<usize>> {
        let mut best: Vec<Option<((bool, f64), usize)>> = vec![None; plots.len()];
        let (Some(first), Some(last)) = (plots.first(), plots.last()) else { return Vec::new() };
        let (middle, slack) =
            (0.5 * (first.time + last.time), 0.5 * (last.time - first.time).max(0.0));
        let most = noise.iter().fold(0.0, |most, r| r.xx.max(r.yy).max(most));
        let extent = longest(settings);
        let points: Vec<_> = plots.iter().map(|plot| plot.position).collect();
        let grid = Grid::new(&points, extent + most.sqrt()).expect("plots are finite");
        for (index, track) in tracks.iter().enumerate() {
            let shape = self.0.get(&track.number).copied().unwrap_or_default();
            let (centre, p) = track.position_at(middle);
            let more = p.plus(shape.spread(extent));
            let speed = track.estimate.mean[2].abs() + track.estimate.mean[3].abs();
            let half = [more.xx, more.yy].map(|v| (GATE * (v + most)).sqrt() + 2.0 * speed * slack);
            grid.within(centre, half, &mut |i| {
                let plot = &plots[i];
                let (at, p) = track.position_at(plot.time);
                let spread = shape.spread(settings.radars[plot.radar].extent);
                let s = p.plus(noise[i]).plus(spread);
                let y = [0, 1].map(|axis| plot.position[axis] - at[axis]);
                let distance = s.inverse().form(y);
                let rank = (!track.is_confirmed(), distance + s.determinant().ln());
                if distance < GATE && best[i].is_none_or(|(before, _)| rank < before) {
                    best[i] = Some((rank, index));
                }
            });
        }
        best.into_iter().map(|one| one.map(|(_, track)| track)).collect()
    }

    /// Gives the tracks of extended targets the spread of plots about the centres of these.
    pub fn show(&self, tracks: &mut [Track], settings: &Settings) {
        let extent = longest(settings);
        for track in tracks.iter_mut().filter(|_| extent > 0.0) {
            let shape = self.0.get(&track.number);
            track.extent = shape.map_or(track.extent, |shape| shape.spread(extent));
        }
    }

    /// Removes the shapes of tracks that have ended, now and then.
    pub fn forget(&mut self, tracks: &[Track]) {
        if self.0.len() > MANY + 2 * tracks.len() {
            let alive: BTreeSet<u64> = tracks.iter().map(|track| track.number).collect();
            self.0.retain(|number, _| alive.contains(number));
        }
    }
}

/// Gives plots that were combined with another one the status of that one; `first` is the index of the first
/// plot.
pub(in crate::tracker) fn resolve(statuses: &mut [PlotStatus], first: usize) {
    for i in 0..statuses.len() {
        if let PlotStatus::Combined(plot) = statuses[i] {
            statuses[i] = plot.checked_sub(first).map_or(statuses[i], |own| statuses[own]);
        }
    }
}

/// Length of the largest targets that any sensor sees, m.
fn longest(settings: &Settings) -> f64 {
    settings.radars.iter().fold(0.0, |most, radar| radar.extent.max(most))
}

/// Whether the radar of a plot has given the track other plots in the same scan: calls may end while the beam
/// passes a target.
fn has_seen(track: &Track, plot: &Measured, settings: &Settings) -> bool {
    let soon = SOON * settings.radars[plot.radar].scan_period;
    let seen =
        track.expected_by(plot.radar).filter(|_| !settings.geometry(plot.radar).is_position());
    seen.is_some_and(|expected| (plot.time - expected.seen).abs() < soon)
}

/// Square of the distance of a plot from the prediction of its track, less that of a target without extent.
fn excess(track: &Track, plot: &Measured, noise: Plane) -> Plane {
    let (at, p) = track.position_at(plot.time);
    let [u, v] = [0, 1].map(|axis| plot.position[axis] - at[axis]);
    Plane { xx: u * u, xy: u * v, yy: v * v }.plus(p.plus(noise).scaled(-1.0))
}

/// Noise of a plot at its own place, m².
fn noise_of(plot: &Measured, settings: &Settings) -> Plane {
    let radar = settings.radars[plot.radar].detecting(plot.detection);
    match plot.source {
        Source::Placed(noise) | Source::Moving(noise, _) => noise,
        Source::Polar => radar.noise_at(plot.position, plot.height - radar.position[2]),
        Source::Slant { polar, prior: [height, variance] } => {
            let placed = settings.geometry(plot.radar).placed(radar, &polar, height);
            let [u, v] = placed.by_height;
            placed.noise.plus(Plane { xx: u * u, xy: u * v, yy: v * v }.scaled(variance))
        }
    }
}

/// Divides plots, in the order of time, into groups that one target may have given: the plots nearest to one
/// track, or plots that no track is near and that are no farther apart than the extent of a target allows.
fn grouped(
    (plots, noise): (&[Measured], &[Plane]),
    nearest: &[Option<usize>],
    settings: &Settings,
) -> Vec<Vec<usize>> {
    let periods = settings.radars.iter().map(|radar| radar.scan_period);
    let longest = SOON * periods.fold(0.0, f64::max);
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for (i, plot) in plots.iter().enumerate() {
        let radar = &settings.radars[plot.radar];
        let recent =
            groups.iter().rev().take_while(|group| plot.time - plots[group[0]].time <= longest);
        let count = recent.count();
        let from = groups.len() - count;
        let apart = |k: usize| [0, 1].map(|axis| plot.position[axis] - plots[k].position[axis]);
        let may_be_one = |k: usize| {
            let (other, y) = (&plots[k], apart(k));
            let squared = y[0] * y[0] + y[1] * y[1];
            let error = noise[i].plus(noise[k]).form(y) / squared.max(f64::MIN_POSITIVE);
            let is_near = squared.sqrt() <= radar.extent + ERRORS * error.sqrt();
            (is_near || nearest[i].is_some()) && !plot.identities.contradicts(&other.identities)
        };
        let mut best: Option<(f64, usize)> = None;
        for (at, group) in groups.iter().enumerate().skip(from) {
            let first = &plots[group[0]];
            let is_same = first.radar == plot.radar && nearest[group[0]] == nearest[i];
            let is_soon = plot.time - first.time <= SOON * radar.scan_period;
            if is_same && is_soon && group.iter().all(|&k| may_be_one(k)) {
                let sum = group
                    .iter()
                    .map(|&k| apart(k))
                    .fold([0.0; 2], |s, y| [s[0] + y[0], s[1] + y[1]]);
                let distance = f64::hypot(sum[0], sum[1]) / group.len() as f64;
                if best.is_none_or(|(least, _)| distance < least) {
                    best = Some((distance, at));
                }
            }
        }
        match best {
            Some((_, at)) => groups[at].push(i),
            None => groups.push(vec![i]),
        }
    }
    groups
}

/// Combines the plots of a group, each of which has this spread about the centre of the target. Returns the
/// combined plot, with the largest index of all, and the scatter of the plots about their mean less that of
/// their noise.
fn combined(
    group: &[usize],
    (plots, noise): (&[Measured], &[Plane]),
    spread: Plane,
) -> (Measured, Plane) {
    let count = group.len() as f64;
    let share = 1.0 / count;
    let own = || group.iter().map(|&i| &plots[i]);
    let mean = |value: &dyn Fn(&Measured) -> f64| own().map(value).sum::<f64>() * share;
    let mut plot = plots[group[0]];
    plot.index = own().map(|plot| plot.index).fold(0, usize::max);
    let all = group.iter().fold(Plane::default(), |sum, &i| sum.plus(noise[i]));
    let place = all.scaled(share * share).plus(spread);
    let moving = own().filter_map(|plot| match plot.source {
        Source::Moving(_, moving) => Some(moving),
        _ => None,
    });
    plot.source = match mean_velocity(moving) {
        Some(moving) => Source::Moving(place, moving),
        None => Source::Placed(place),
    };
    let mut scatter = Plane::default();
    if group.len() > 1 {
        plot.time = mean(&|plot| plot.time);
        plot.position = [0, 1].map(|axis| mean(&|plot| plot.position[axis]));
        plot.identities = own().fold(plot.identities, |known, plot| known.or(&plot.identities));
        plot.height = own().map(|plot| plot.height).find(|h| h.is_finite()).unwrap_or(f64::NAN);
        for one in own() {
            let [u, v] = [0, 1].map(|axis| one.position[axis] - plot.position[axis]);
            scatter = scatter.plus(Plane { xx: u * u, xy: u * v, yy: v * v });
        }
        scatter = scatter.plus(all.scaled(share - 1.0));
    }
    (plot, scatter)
}

/// The mean of the velocities of the parts of a target, whose errors may be common to all of them.
fn mean_velocity(parts: impl Iterator<Item = Moving>) -> Option<Moving> {
    let (mut sum, mut count) = (None::<Moving>, 0.0);
    for part in parts {
        count += 1.0;
        sum = Some(sum.map_or(part, |sum| Moving {
            velocity: [0, 1].map(|axis| sum.velocity[axis] + part.velocity[axis]),
            noise: sum.noise.plus(part.noise),
        }));
    }
    let mean = |sum: Moving| Moving {
        velocity: sum.velocity.map(|v| v / count),
        noise: sum.noise.scaled(1.0 / count),
    };
    sum.map(mean)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_within;

    #[test]
    fn variances_are_limited_along_their_own_axes() {
        // variances of 9 and -1 along axes turned by 30 degrees
        let (c, s) = (0.75_f64.sqrt(), 0.5);
        let turned = |a: f64, b: f64| Plane {
            xx: a * c * c + b * s * s,
            xy: (a - b) * s * c,
            yy: a * s * s + b * c * c,
        };
        for (most, [a, b]) in [(100.0, [9.0, 0.0]), (4.0, [4.0, 0.0])] {
            let (found, expected) = (limited(turned(9.0, -1.0), most), turned(a, b));
            assert!(
                (found.xx - expected.xx).abs() < 1e-12 && (found.yy - expected.yy).abs() < 1e-12
            );
            assert!((found.xy - expected.xy).abs() < 1e-12);
        }
        let round = Plane { xx: 2.0, xy: 0.0, yy: 2.0 };
        assert_eq!(limited(round, 3.0), round);
    }

    #[test]
    fn a_shape_becomes_that_of_its_plots() {
        let mut shape = Shape::default();
        assert_within(1e-12, shape.spread(120.0).xx, 600.0);
        for _ in 0..400 {
            shape.learn(2.0, Plane { xx: 2.0 * 100.0, xy: 0.0, yy: 2.0 * 25.0 });
        }
        let spread = shape.spread(120.0);
        assert_within(0.2, spread.xx, 100.0);
        assert!(spread.yy < 45.0 && spread.xy == 0.0);
    }
}
