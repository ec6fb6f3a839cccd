//! Targets that turn so sharply that they leave all gates: plots that no track has taken, near
//! tracks that radars have missed.

use crate::association::Grid;
use crate::tracker::clutter::Clutter;
use crate::tracker::noise::Noise;
use crate::tracker::plot::Measured;
use crate::tracker::rows::row::{Row, Rows};
use crate::tracker::settings::Settings;
use crate::tracker::track::Track;
use crate::tracker::track::fork::Surprise;

/// Share of outliers from which a plot far from its target is taken for an outlier.
const OUTLIERS: f64 = 0.01;

/// What is known about plots.
#[derive(Clone, Copy)]
pub(in crate::tracker) struct Known<'a> {
    pub settings: &'a Settings,
    pub clutter: &'a [Clutter],
    pub noise: &'a [Noise],
}

/// Gives remaining plots to confirmed tracks whose targets may have turned sharply. Returns pairs
/// of plots and numbers of tracks. Cost O(tracks), and for each missed track O(plots near it).
pub(in crate::tracker) fn follow<R: Rows>(
    (known, tracks, rows): (Known<'_>, &mut [Track], &mut R),
    around: (&Grid, &[Measured]),
    (taken, deferred): (&mut [bool], &[bool]),
) -> Vec<(usize, u64)> {
    let plots = around.1;
    let mut given = Vec::new();
    let free = |plot: usize| !taken[plot] && !deferred[plot];
    for of_plot in near(known, tracks, around, free).chunk_by(|a, b| a.0 == b.0) {
        let i = of_plot[0].0;
        let Some((surprise, k, predicted)) = best(known, tracks, &plots[i], of_plot) else {
            continue;
        };
        let (track, plot) = (&mut tracks[k], &plots[i]);
        *track = predicted;
        let outliers = &known.noise[plot.radar].outliers;
        if track.take_or_fork(plot, &surprise, outliers, known.settings) {
            track.credit(surprise.gain, 0.0, plot.radar, known.settings);
            taken[i] = true;
            rows.push(&Row::of(track, plot.radar, Some(plot.index)));
            given.push((i, track.number));
        }
    }
    given
}

/// Free plots and the tracks to which they may belong, sorted.
fn near(
    known: Known<'_>,
    tracks: &[Track],
    (grid, plots): (&Grid, &[Measured]),
    free: impl Fn(usize) -> bool,
) -> Vec<(usize, usize)> {
    let (settings, mut near) = (known.settings, Vec::new());
    let Some(end) = plots.last().map(|plot| plot.time) else { return near };
    for (k, track) in tracks.iter().enumerate() {
        if !track.is_confirmed() || !track.is_overdue(end) {
            continue;
        }
        let Some(sharp) = track.sharpest(settings) else { continue };
        let (place, half) = track.sharp_reach(end, sharp, settings);
        let corner = |sign: f64| place.map(|x| x + sign * half);
        grid.between(corner(-1.0), corner(1.0), &mut |i| {
            let plot = &plots[i];
            let is_polar = !settings.geometry(plot.radar).is_position();
            if is_polar && free(i) && may_be(track, plot, known) {
                near.push((i, k));
            }
        });
    }
    near.sort_unstable();
    near
}

fn may_be(track: &Track, plot: &Measured, known: Known<'_>) -> bool {
    plot.time > track.seen
        && track.is_due(plot, &known.settings.radars[plot.radar])
        && !track.refuses(plot, known.settings)
        && known.noise[plot.radar].outliers.share() < OUTLIERS
}

/// The likeliest of the tracks near a plot, if it is likelier than a false plot.
fn best(
    known: Known<'_>,
    tracks: &[Track],
    plot: &Measured,
    of_plot: &[(usize, usize)],
) -> Option<(Surprise, usize, Track)> {
    let (settings, radar) = (known.settings, plot.radar);
    let odds = settings.odds(radar, known.clutter[radar].density(&settings.radars[radar]));
    let found = of_plot.iter().filter_map(|&(_, k)| {
        let track = &tracks[k];
        // the track may have taken another plot meanwhile
        let sharp = track.sharpest(settings).filter(|_| may_be(track, plot, known))?;
        let mut track = track.clone();
        track.predict(plot.time, settings.pace(radar), settings);
        Some((track.sharp_score(plot, (sharp, odds), settings)?, k, track))
    });
    let likelier = found.filter(|(surprise, ..)| surprise.gain > 0.0);
    likelier.max_by(|a, b| a.0.gain.total_cmp(&b.0.gain).then(b.1.cmp(&a.1)))
}
