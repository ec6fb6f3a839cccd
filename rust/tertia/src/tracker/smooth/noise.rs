//! Covariances of the plots of tracks with the noise that the plots themselves show.

use crate::base::plane::Plane;
use crate::tracker::noise::lasting::Common;
use crate::tracker::noise::{Noise, SMOOTHING};
use crate::tracker::plot::individual::Individual;
use crate::tracker::plot::{Measured, Source};
use crate::tracker::settings::Settings;
use std::collections::HashMap;

/// Time in which plots of a track count for each other, s.
const NEAR: f64 = 30.0;

/// A plot of a track in the plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlacedPlot {
    /// Number of the track.
    pub track: u64,
    /// Index of the sensor.
    pub sensor: usize,
    /// Time, s.
    pub time: f64,
    /// East and north, m.
    pub position: [f64; 2],
    /// Covariance by the stated noise, m².
    pub covariance: Plane,
    /// Velocity of the target, m/s.
    pub velocity: [f64; 2],
}

/// Returns the covariance of each plot by the noise that the plots show, if this is larger than the stated
/// noise, and the part of it that successive plots have in common. The plots are in the order of time. Reports
/// of positions have the noise of their targets if it differs between them.
///
/// Cost O(plots).
pub fn shown_covariances(settings: &Settings, plots: &[PlacedPlot]) -> Vec<[Plane; 2]> {
    let mut noise: Vec<Noise> = settings.radars.iter().map(Noise::new).collect();
    for plot in plots {
        let &PlacedPlot { track, sensor: radar, time, position, covariance, .. } = plot;
        let is_report = settings.geometry(radar).is_position();
        let source = if is_report { Source::Placed(covariance) } else { Source::Polar };
        let measured = Measured { time, radar, position, source, ..Measured::default() };
        noise[radar].saw(track, &measured, settings);
    }
    let mut found: Vec<Plane> =
        plots.iter().map(|plot| shown(plot, &noise[plot.sensor], settings)).collect();
    use_individual(settings, plots, &noise, &mut found);
    let common = common(plots, &noise);
    let covariances = plots.iter().zip(found).zip(common);
    let each = covariances.map(|((plot, own), common)| {
        let [own, moved] = moved(plot, own, &noise[plot.sensor]);
        [own, moved.plus(common)]
    });
    each.collect()
}

/// Returns the covariances of the errors that tracks have in common with the plots at about the same time. Plots count
/// by their information.
fn common(plots: &[PlacedPlot], noise: &[Noise]) -> Vec<Plane> {
    let shares: Vec<f64> = noise.iter().map(|own| own.quality().common).collect();
    let mut found = vec![Plane::default(); plots.len()];
    if shares.iter().all(|share| *share == 0.0) {
        return found;
    }
    let mut add = |order: &mut dyn Iterator<Item = usize>| {
        let mut tracks: HashMap<u64, (f64, f64, Common)> = HashMap::new();
        for i in order {
            let PlacedPlot { track, sensor, time, covariance: own, .. } = plots[i];
            let (last, total, errors) =
                tracks.entry(track).or_insert((time, 0.0, Common::default()));
            let weight = 1.0 / (own.xx + own.yy);
            *total = *total * (-(time - *last).abs() / NEAR).exp() + weight;
            *last = time;
            errors.add(own.scaled(shares[sensor]), weight / *total);
            found[i] = found[i].plus(errors.covariance().scaled(0.5));
        }
    };
    add(&mut (0..plots.len()));
    add(&mut (0..plots.len()).rev());
    found
}

/// The covariance by the noise of all plots.
fn shown(plot: &PlacedPlot, noise: &Noise, settings: &Settings) -> Plane {
    if settings.geometry(plot.sensor).is_position() {
        return plot.covariance.scaled(noise.quality().ratio);
    }
    let [along, across] = noise.factors(SMOOTHING);
    let origin = settings.radars[plot.sensor].position;
    let away = [0, 1].map(|i| plot.position[i] - origin[i]);
    stretched(plot.covariance, away, [along.sqrt(), across.sqrt()])
}

/// Replaces the covariances of reports by those of their targets where the noise differs between targets: the
/// mean of those that the reports before and after show.
fn use_individual(
    settings: &Settings,
    plots: &[PlacedPlot],
    noise: &[Noise],
    covariances: &mut [Plane],
) {
    let mut single = vec![Individual::default(); noise.len()];
    let is_report = |plot: &PlacedPlot| {
        settings.geometry(plot.sensor).is_position() && settings.radars[plot.sensor].extent == 0.0
    };
    let reports: Vec<_> = (0..plots.len()).filter(|&i| is_report(&plots[i])).collect();
    let follow = |single: &mut [Individual], i: usize, sign: f64| {
        let plot = &plots[i];
        let (single, noise) = (&mut single[plot.sensor], &noise[plot.sensor]);
        let (quality, key) = (noise.quality(), (0, plot.track as i64));
        let ratios = (quality.ratio, noise.reports.ratio());
        let own = (single.noise(Some(key), covariances[i]), quality.clock);
        single.saw(key, (sign * plot.time, plot.position), own, ratios);
        single.noise(Some(key), covariances[i])
    };
    for &i in &reports {
        follow(&mut single, i, 1.0);
    }
    if !single.iter().any(Individual::differs) {
        return;
    }
    let mut both = single.clone();
    [&mut single, &mut both].into_iter().flatten().for_each(Individual::restart);
    let mut found: Vec<Plane> = reports.iter().map(|&i| follow(&mut single, i, 1.0)).collect();
    for (own, &i) in found.iter_mut().zip(&reports).rev() {
        *own = own.plus(follow(&mut both, i, -1.0)).scaled(0.5);
    }
    reports.into_iter().zip(found).for_each(|(i, own)| covariances[i] = own);
}

/// Returns the covariance with the errors of times, and the part of it that successive plots have in common.
fn moved(plot: &PlacedPlot, own: Plane, noise: &Noise) -> [Plane; 2] {
    let quality = noise.quality();
    let [u, v] = plot.velocity;
    let moved = Plane { xx: u * u, xy: u * v, yy: v * v };
    [own.plus(moved.scaled(quality.clock)), moved.scaled(quality.lasting)]
}

/// The covariance of errors that are multiplied by these factors along and across a direction.
fn stretched(covariance: Plane, direction: [f64; 2], [along, across]: [f64; 2]) -> Plane {
    let length = direction[0].hypot(direction[1]);
    let [e, n] = direction.map(|x| x / length);
    let Plane { xx, xy, yy } = covariance;
    let both = ((yy - xx) * e * n + xy * (e * e - n * n)) * along * across;
    let own = covariance.form([e, n]) * along * along;
    let other = covariance.form([n, -e]) * across * across;
    Plane {
        xx: own * e * e + other * n * n - 2.0 * both * e * n,
        xy: (own - other) * e * n + both * (e * e - n * n),
        yy: own * n * n + other * e * e + 2.0 * both * e * n,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_within;

    #[test]
    fn errors_are_multiplied_along_and_across() {
        let plane = Plane { xx: 5.0, xy: -1.0, yy: 3.0 };
        let same = stretched(plane, [0.6, 0.8], [1.0, 1.0]);
        assert_within(1e-14, same.xx, 5.0);
        assert_within(1e-14, same.xy, -1.0);
        assert_within(1e-14, same.yy, 3.0);
        let more = stretched(plane, [3.0, 4.0], [2.0, 3.0]);
        assert_within(1e-14, more.form([0.6, 0.8]), 4.0 * plane.form([0.6, 0.8]));
        assert_within(1e-14, more.form([0.8, -0.6]), 9.0 * plane.form([0.8, -0.6]));
        assert_within(1e-14, more.determinant(), 36.0 * plane.determinant());
    }
}
