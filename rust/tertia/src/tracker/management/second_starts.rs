//! Starts second tracks from the first plots of tracks that a plot of another radar may have led astray: if
//! radars are not aligned, their alternating plots of one target do not form a path that a target can fly.

use crate::association::Grid;
use crate::tracker::plot::Measured;
use crate::tracker::settings::Settings;
use crate::tracker::track::Track;

/// Time after the first plot within which the next plot of the radar is looked for, in scans.
const SCANS: f64 = 1.5;

/// First plots of tentative tracks that only other radars have seen since.
#[derive(Default)]
pub(in crate::tracker) struct Origins {
    /// Indices of the tracks; none once another track was started from the same first plot.
    tracks: Vec<Option<usize>>,
    /// Grid of their first plots, with the radar of each.
    grid: Grid,
}

impl Origins {
    /// Finds the first plots in question among all tracks. Cost O(tracks).
    pub fn of(tracks: &[Track], settings: &Settings) -> Self {
        let mut origins = Self::default();
        if settings.radars.len() == 1 || settings.confirmation.plots() < 3 {
            return origins;
        }
        let is_astray = |&index: &usize| may_be_astray(&tracks[index], settings);
        origins.tracks.extend((0..tracks.len()).filter(is_astray).map(Some));
        if origins.tracks.is_empty() {
            return origins;
        }
        let firsts = origins.tracks.iter().flatten().map(|&index| &tracks[index].first);
        let (points, radars): (Vec<_>, Vec<_>) =
            firsts.map(|first| (first.position, first.radar as u32)).unzip();
        let longest = settings.radars.iter().map(|radar| radar.scan_period).fold(0.0, f64::max);
        let cell = 2.0 * SCANS * settings.max_speed * longest;
        origins.grid.fill_tagged(&points, |at| radars[at], cell).expect("plots are finite");
        origins
    }

    /// Starts a track from the first plot of another track to this plot of the same radar, which that track
    /// has not taken. There are `false_plots` in a scan and `density` false plots per square metre; `others`
    /// is the logarithm of the factor by which other plots, such as second plots, make false tracks more
    /// frequent. None if no target can have come from a first plot.
    pub fn track(
        &mut self,
        number: u64,
        plot: &Measured,
        tracks: &[Track],
        (false_plots, density, others): (f64, f64, f64),
        settings: &Settings,
    ) -> Option<Track> {
        if self.tracks.is_empty() {
            return None;
        }
        let radar = &settings.radars[plot.radar];
        let reach = SCANS * settings.max_speed * radar.scan_period;
        let corner = |sign: f64| plot.position.map(|x| x + sign * reach);
        let odds = settings.odds(plot.radar, density);
        let mut best: Option<(f64, usize, Track)> = None;
        self.grid.entries(corner(-1.0), corner(1.0), &mut |entry| {
            let at = entry.index as usize;
            let Some(index) = self.tracks[at].filter(|_| entry.tag as usize == plot.radar) else {
                return;
            };
            let (other, [x, y]) = (&tracks[index], entry.point);
            let apart = f64::hypot(plot.position[0] - x, plot.position[1] - y);
            let flown = settings.max_speed * (plot.time - other.first.time);
            if apart > flown.min(reach) || !may_be_astray(other, settings) {
                return;
            }
            let mut track = Track::new(number, &other.first, false_plots, settings);
            if !track.is_due(plot, radar) || track.refuses(plot, settings) {
                return;
            }
            track.predict(plot.time, settings.pace(plot.radar), settings);
            let gain = track.score(plot, odds, settings).unwrap_or(0.0);
            if gain > best.as_ref().map_or(0.0, |best| best.0) {
                best = Some((gain, at, track));
            }
        });
        let (gain, at, mut track) = best?;
        self.tracks[at] = None;
        track.credit(gain, others, plot.radar, settings);
        track.correct(plot, settings);
        track.first = *plot;
        Some(track)
    }
}

/// Whether other radars alone have seen the target of a tentative track since its first plot.
fn may_be_astray(track: &Track, settings: &Settings) -> bool {
    let first = &track.first;
    !track.is_confirmed()
        && track.seen > first.time
        && !settings.geometry(first.radar).is_position()
        && track.expected_by(first.radar).is_some_and(|own| own.seen == first.time)
}
