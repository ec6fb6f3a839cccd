//! What rows of tracks say of the errors of radars, and what the errors add to the rows.

use super::Registrar;
use crate::registration::block::Unknowns;
use crate::registration::exchange::{Changed, Given, Learnt, Update};
use crate::registration::followed::{self, Blocks, Followed};
use crate::registration::sighting::{Errors, Report, Sighting};
use pulp::{Arch, Simd, WithSimd};
use std::hint::black_box;

/// Rows whose tracks are read together before they are needed: with thousands of tracks each is a wait for
/// memory, and waits together take no longer than one.
const TOGETHER: usize = 16;

impl Registrar {
    /// Learns from the rows of tracks and from plots that no confirmed track has, until a time. `used` are the
    /// standard deviations of range and azimuth of each radar that the tracks were made with, and those that
    /// the tracker has found for errors that last.
    pub fn learn(
        &mut self,
        updates: &[Update],
        loose: &[Report],
        used: &[[[f64; 2]; 2]],
        time: f64,
    ) -> Learnt {
        let mut given = Given::new(updates);
        let tracks = self.learn_rows(&mut given, loose, used, (time, None));
        Learnt { rows: given.changes, tracks }
    }

    /// The same of rows wherever they are, which are changed there; returns by how much each track is to
    /// move, at the time of its last row. Of the tracks that were never confirmed, those that are not
    /// among the numbers `alive`, in order, are forgotten.
    pub fn learn_rows<U: Changed>(
        &mut self,
        updates: &mut U,
        loose: &[Report],
        used: &[[[f64; 2]; 2]],
        (time, alive): (f64, Option<&[i64]>),
    ) -> Vec<(i64, f64, [f64; 4])> {
        let (mut applied, moved) = self.begin(updates, time);
        followed::use_noise(&mut applied, used);
        let (unknowns, errors) = (self.unknowns(), self.blocks());
        Arch::new().dispatch(Rows {
            registrar: self,
            updates,
            applied: &applied,
            unknowns: &unknowns,
            moved: &moved,
            errors: &errors,
        });
        if let Some(alive) = alive {
            self.forget_others(alive);
        }
        let tracks = self.shift(&moved);
        self.end(loose, time);
        tracks
    }

    /// Forgets tracks that were never confirmed and are not among these numbers, which are in order.
    fn forget_others(&mut self, alive: &[i64]) {
        let mut alive = alive.iter().peekable();
        self.tracks.retain(|number, track| {
            while alive.next_if(|own| *own < number).is_some() {}
            track.was_confirmed() || alive.peek() == Some(&number)
        });
    }

    /// Follows a row of a track: its gains carry the errors of the radars on.
    #[inline(always)]
    pub(super) fn carry(
        &mut self,
        update: &Update,
        applied: &[[[f64; 2]; 2]],
        unknowns: &Unknowns,
    ) -> &Followed {
        let report = &update.plot.report;
        let radar = &self.radars[report.radar];
        let seen = Sighting::new(report, report.height, radar, [1.0; 2]);
        if let Some(seen) = &seen {
            self.watch(update, seen, applied[report.radar][1]);
        }
        let mut first = false;
        let track = self.tracks.entry(update.plot.target).or_insert_with(|| {
            first = true;
            Box::new(Followed::new(report.time))
        });
        track.advance(report.time);
        if let Some(seen) = seen {
            let (velocity, own) = (update.velocity, &unknowns[report.radar]);
            // the noise that the gain of the track was made with
            let sigma = applied[report.radar].map(|noise| seen.noise(noise));
            if first {
                let stated = (&update.covariance, update.confirmed);
                track.begin(&seen, sigma, stated, velocity, own);
            } else {
                track.correct(&seen, sigma, &update.covariance, velocity, own);
            }
            if update.confirmed {
                track.see(report.time, report.radar, update.position, velocity);
            }
        }
        track.limit(&update.covariance);
        track
    }
}

/// The rows of a scan, one after the other: by how much each moves, and what the errors add to its covariance.
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
        let count = self.updates.count();
        for first in (0..count).step_by(TOGETHER) {
            let rows = first..count.min(first + TOGETHER);
            for row in rows.clone() {
                let track = self.registrar.tracks.get(&self.updates.target(row));
                black_box(track.map(|track| track.touched()));
            }
            for row in rows {
                let update = self.updates.get(row);
                let track = self.registrar.carry(&update, self.applied, self.unknowns);
                self.updates.change(row, &track.moved(self.moved), &track.added(self.errors));
            }
        }
    }
}
