//! Passage of time: counts the scans in which radars missed targets, and ends tracks.

use super::Tracker;
use crate::base::batch::for_each_part;
use crate::tracker::clutter::{Clutter, Held};
use crate::tracker::rows::row::{Row, Rows};
use crate::tracker::settings::Settings;
use crate::tracker::track::Track;

/// Number of tracks in each part of the work of threads. As it is fixed, sums do not depend on the number of
/// threads.
const TOGETHER: usize = 1024;

/// For a part of the tracks: which of them continue, and the plots of the tentative ones that do.
#[derive(Default)]
struct Survey {
    is_alive: Vec<bool>,
    held: Vec<Held>,
}

impl Survey {
    /// Determines which tracks continue, and adds up the plots of the tentative ones. Cost O(tracks + their
    /// plots).
    fn look(&mut self, tracks: &[Track], clutter: &[Clutter], settings: &Settings) {
        self.held.resize_with(clutter.len(), Held::default);
        for track in tracks {
            let is_alive = track.is_alive(settings);
            if is_alive && !track.is_confirmed() {
                track.hold((clutter, &mut self.held), settings);
            }
            self.is_alive.push(is_alive);
        }
    }
}

impl Tracker {
    /// Counts the missed detections until `end`, and gives out a row for each one of a confirmed track.
    pub(in crate::tracker) fn finish<R: Rows>(&mut self, end: f64, rows: &mut R, threads: usize) {
        if end <= self.time {
            // all were counted, and plots may not be so late that there would be more
            return;
        }
        let settings = &self.settings;
        let missed = in_parts(&mut self.tracks, threads, |tracks, rows: &mut Vec<Row>| {
            for track in tracks {
                track.miss_alternatives(end, settings);
                track.miss(end, settings, |track, radar| {
                    if track.is_confirmed() {
                        rows.push(Row::of(track, radar, None));
                    }
                });
            }
        });
        missed.iter().flatten().for_each(|row| rows.push(row));
        self.time = end;
    }

    /// Removes the tracks that have ended. Their plots are counted as false plots if they were never
    /// confirmed; the plots of tentative tracks that continue are counted anew.
    pub(in crate::tracker) fn bury(&mut self, threads: usize) {
        let Self { tracks, ended, settings, clutter, time, .. } = self;
        let known = &*clutter;
        let found = in_parts(tracks, threads, |tracks, own: &mut Survey| {
            own.look(tracks, known, settings);
        });
        let before = tracks.len();
        let mut is_alive = found.iter().flat_map(|part| &part.is_alive);
        tracks.retain(|track| {
            let is_alive = is_alive.next() == Some(&true);
            if !is_alive {
                ended.remember(track, settings);
                if !track.is_confirmed() {
                    track.count(clutter, settings);
                }
            }
            is_alive
        });
        for (sensor, own) in clutter.iter_mut().enumerate() {
            let parts = found.iter().map(|part| part.held[sensor]);
            own.hold(parts.fold(Held::default(), |sum, part| sum.with(&part)));
        }
        if tracks.len() < before {
            ended.forget(*time);
        }
        settings.plans.free(|number| {
            tracks.iter().all(|track| track.number != number) && !ended.may_resume(number, *time)
        });
    }
}

/// Calls `look` for each part of the tracks, and returns the results in the order of the parts.
fn in_parts<T: Default + Send>(
    tracks: &mut [Track],
    threads: usize,
    look: impl Fn(&mut [Track], &mut T) + Sync,
) -> Vec<T> {
    let mut found = Vec::new();
    found.resize_with(tracks.len().div_ceil(TOGETHER), T::default);
    let parts = tracks.chunks_mut(TOGETHER).zip(&mut found).collect();
    for_each_part(threads, parts, |(tracks, own)| look(tracks, own));
    found
}
