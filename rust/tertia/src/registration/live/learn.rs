//! Learning the errors of radars from rows of tracks, and the effect of the errors on the rows.

use super::{FORGOTTEN, Registrar};
use crate::base::batch::for_each_row;
use crate::base::error::Result;
use crate::registration::block::Unknowns;
use crate::registration::effect::Blocks;
use crate::registration::exchange::{Changed, Update, Updates};
use crate::registration::followed::{self, Followed};
use crate::registration::sighting::{Errors, Report, Sighting};
use crate::registration::targets::scans;
use crate::registration::unaffected::Settled;
use crate::sensors::Radar;
use pulp::{Arch, Simd, WithSimd};
use std::hint::black_box;
use std::num::NonZero;

/// Number of rows whose tracks are read together before they are needed: with thousands of tracks, each read
/// waits for memory, and waits together take no longer than one.
const TOGETHER: usize = 16;
/// Time for a row of a target, ns, and the largest time that is stated for all: with a longer one, the work
/// could be stopped half done.
const FOLLOWED_NS: f64 = 300.0;
const STOPPABLE_NS: f64 = 1e8;

impl Registrar {
    /// Learns, up to a time, from the rows of tracks, which are changed in place, and from plots that no
    /// confirmed track has taken. `used` are, for each radar, the standard deviations of range and azimuth with
    /// which the tracks were made, and those that the tracker has found for errors that last. Returns by how
    /// much each track is to move, at the time of its last row. Tracks that were never confirmed are dropped
    /// unless their numbers are in `alive`, which is sorted.
    pub fn learn<U: Changed>(
        &mut self,
        updates: &mut U,
        loose: &[Report],
        used: &[[[f64; 2]; 2]],
        (time, alive): (f64, Option<&[i64]>),
    ) -> Vec<(i64, f64, [f64; 4])> {
        let (mut applied, moved) = self.begin(updates, time);
        followed::use_noise(&mut applied, used);
        let (unknowns, errors) = (self.unknowns(), self.blocks(self.exceeded()));
        Arch::new().dispatch(Rows {
            registrar: self,
            updates,
            applied: &applied,
            unknowns: &unknowns,
            moved: &moved,
            errors: &errors,
        });
        self.tracks.close();
        self.forget(time, alive);
        let tracks = self.shift(&moved);
        self.end(loose, time);
        self.deviate(used, time);
        tracks
    }

    /// Learns from rows alone, without innovations and without plots that no confirmed track has taken; the
    /// rows of each target are together and in order of time. Returns what the errors add to the covariance
    /// of each of these targets, and by how much all targets move, at the times of their last rows. The
    /// results do not depend on the number of threads. The cost is that of [`Registrar::learn`].
    ///
    /// # Errors
    /// None occur; the type is that of work on threads.
    #[allow(clippy::type_complexity)] // two columns
    pub(crate) fn learn_targets(
        &mut self,
        targets: &[Vec<Update>],
        time: f64,
        n_threads: Option<NonZero<usize>>,
    ) -> Result<(Vec<(i64, [f64; 16])>, Vec<(i64, f64, [f64; 4])>)> {
        let rows = InOrder::new(targets);
        let cost = FOLLOWED_NS * rows.count() as f64;
        let (applied, moved) = self.begin(&rows, time);
        let (unknowns, errors) = (self.unknowns(), self.blocks(self.relaxed()));
        let mut runs: Vec<_> = Vec::with_capacity(targets.len());
        for rows in targets {
            let Some(first) = rows.first().map(|first| &first.plot) else { continue };
            let (place, is_new) = self.place(first.target, || first.report.time);
            runs.push((place, first.target, &rows[..], is_new));
        }
        self.tracks.close();
        runs.sort_unstable_by_key(|(place, ..)| *place);
        let mut added: Vec<_> = runs.iter().map(|(_, target, ..)| (*target, [0.0; 16])).collect();
        let mut runs = runs.into_iter().peekable();
        let mut work = Vec::with_capacity(added.len());
        for (place, track) in self.tracks.places_mut().enumerate() {
            if let Some((.., rows, is_new)) = runs.next_if(|(own, ..)| *own == place) {
                work.push((track, rows, is_new));
            }
        }
        let (radars, delays) = (&self.radars[..], &self.delays[..]);
        let known = Applied { radars, delays, noise: &applied, unknowns: &unknowns };
        let follow = |(): &mut (), ((track, rows, is_new), out): (_, &mut (i64, _))| {
            out.1 = Arch::new().dispatch(OfTarget { track, rows, is_new, known, errors: &errors });
            Ok(())
        };
        let work = work.into_iter().zip(&mut added);
        for_each_row(work, cost.min(STOPPABLE_NS), n_threads, || (), follow)
            .map_err(|failed| failed.error)?;
        added.sort_unstable_by_key(|(target, _)| *target);
        self.forget(time, None);
        let moved = self.shift(&moved);
        self.end(&[], time);
        Ok((added, moved))
    }

    /// Drops tracks that have had no row for long, and those that were never confirmed and whose numbers are
    /// not in `alive`, which is sorted.
    fn forget(&mut self, time: f64, alive: Option<&[i64]>) {
        let longest = FORGOTTEN * scans(&self.radars);
        let mut numbers = alive.unwrap_or_default().iter().peekable();
        self.tracks.retain(|number, track| {
            while numbers.next_if(|own| **own < number).is_some() {}
            let is_alive =
                alive.is_none() || track.was_confirmed() || numbers.peek() == Some(&&number);
            is_alive && time - track.row_time <= longest
        });
    }

    /// Returns the place of a track, which starts at this time if it is new, and whether it is new.
    #[inline(always)]
    pub(super) fn place(&mut self, target: i64, time: impl FnOnce() -> f64) -> (usize, bool) {
        self.tracks.place(target, time)
    }

    /// Follows a row of a track, whose gain propagates the errors of the radars.
    #[inline(always)]
    pub(super) fn carry(
        &mut self,
        update: &Update,
        (place, is_new): (usize, bool),
        applied: &[[[f64; 2]; 2]],
        unknowns: &Unknowns,
    ) -> &Followed {
        let report = &update.plot.report;
        let known =
            Applied { radars: &self.radars, delays: &self.delays, noise: applied, unknowns };
        let seen = known.seen(update);
        if let Some(seen) = &seen {
            self.watch(update, seen, applied[report.radar][1]);
        }
        let track = self.tracks.at(place);
        let known =
            Applied { radars: &self.radars, delays: &self.delays, noise: applied, unknowns };
        known.follow(track, update, seen, is_new);
        track
    }
}

/// Data with which rows of tracks are followed.
#[derive(Clone, Copy)]
struct Applied<'a> {
    radars: &'a [Radar],
    /// Standard deviations of the differences between the delays of targets.
    delays: &'a [f64],
    /// Noise of the plots, with and without the uncertainty of the errors.
    noise: &'a [[[f64; 2]; 2]],
    unknowns: &'a Unknowns,
}

impl Applied<'_> {
    /// Returns the plot of a row in the plane.
    #[inline(always)]
    fn seen(&self, update: &Update) -> Option<Sighting> {
        let report = &update.plot.report;
        let mut seen = Sighting::new(report, report.height, &self.radars[report.radar], [1.0; 2])?;
        seen.is_late = self.delays[report.radar] > 0.0;
        Some(seen)
    }

    /// Follows a row of a track.
    #[inline(always)]
    fn follow(&self, track: &mut Followed, update: &Update, seen: Option<Sighting>, is_new: bool) {
        let report = &update.plot.report;
        let interval = self.radars[report.radar].scan_period.max(report.time - track.row_time);
        track.advance(report.time);
        if let Some(seen) = seen {
            let (velocity, own) = (update.velocity, &self.unknowns[report.radar]);
            // the noise with which the gain of the track was made
            let sigma = self.noise[report.radar].map(|noise| seen.noise(noise));
            if is_new {
                let stated = (&update.covariance, update.confirmed);
                track.begin(&seen, sigma, stated, velocity, own);
            } else {
                let reported = update.used_velocity();
                let state = (&update.covariance, reported);
                track.correct(&seen, sigma, state, velocity, own, interval);
            }
            if update.confirmed {
                track.see(report.time, report.radar, update.position, velocity);
            }
        } else if let Some(row) = update.used_azimuth() {
            track.settle(&Settled::by_azimuth(&update.covariance, row));
        }
        track.limit(&update.covariance);
    }
}

/// Follows the rows of one target, and returns what the errors add to its covariance.
struct OfTarget<'a> {
    track: &'a mut Followed,
    rows: &'a [Update],
    is_new: bool,
    known: Applied<'a>,
    errors: &'a Blocks,
}

impl WithSimd for OfTarget<'_> {
    type Output = [f64; 16];

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> [f64; 16] {
        let Self { track, rows, mut is_new, known, errors } = self;
        for row in rows {
            known.follow(track, row, known.seen(row), is_new);
            is_new = false;
        }
        track.added(errors)
    }
}

/// Rows of targets in order of time; rows of the same time keep their order.
struct InOrder<'a>(Vec<&'a Update>);

impl<'a> InOrder<'a> {
    fn new(targets: &'a [Vec<Update>]) -> Self {
        let mut rows: Vec<_> =
            targets.iter().flatten().map(|row| (row.plot.report.time, row)).collect();
        rows.sort_by(|a, b| a.0.total_cmp(&b.0));
        Self(rows.into_iter().map(|(_, row)| row).collect())
    }
}

impl Updates for InOrder<'_> {
    fn count(&self) -> usize {
        self.0.len()
    }

    fn target(&self, row: usize) -> i64 {
        self.0[row].plot.target
    }

    fn get(&self, row: usize) -> Update {
        self.0[row].clone()
    }
}

/// Follows the rows of a scan one after the other, moves each, and adds the effect of the errors to its
/// covariance.
struct Rows<'a, U> {
    registrar: &'a mut Registrar,
    updates: &'a mut U,
    applied: &'a [[[f64; 2]; 2]],
    unknowns: &'a Unknowns,
    moved: &'a [Errors],
    errors: &'a Blocks,
}

impl<U: Changed> WithSimd for Rows<'_, U> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { registrar, updates, .. } = self;
        let count = updates.count();
        let mut places = [(0, false); TOGETHER];
        for first in (0..count).step_by(TOGETHER) {
            let rows = first..count.min(first + TOGETHER);
            for (place, row) in places.iter_mut().zip(rows.clone()) {
                *place = registrar.place(updates.target(row), || updates.get(row).plot.report.time);
            }
            for &(place, _) in &places[..rows.len()] {
                black_box(registrar.tracks.at(place).touched());
            }
            for (place, row) in places.into_iter().zip(rows) {
                let update = updates.get(row);
                let track = registrar.carry(&update, place, self.applied, self.unknowns);
                updates.change(row, &track.moved(self.moved), &track.added(self.errors));
            }
        }
    }
}
