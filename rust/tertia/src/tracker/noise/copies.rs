//! Plots that come more than once, as from two network lines: they are no measurements of their own.
//!
//! A line may stamp its own times. The beam of a radar has left a target by then, and no target gives exactly the
//! same range and azimuth twice in a turn. Reports are copies if they have the same time, or if another sensor has
//! just reported exactly the same position.

use crate::tracker::plot::{Plot, PlotStatus};
use crate::tracker::settings::Settings;
use serde::{Deserialize, Serialize};

/// Share of a scan within which a plot of a radar may come again.
const OF_SCAN: f64 = 0.5;
/// Longest time by which a second receiver stamps a message later, s.
const LATER: f64 = 0.5;
/// Least number of plots that are kept, and places for each of the plots that may come again: of two plots with
/// one place, the later one is kept.
const LEAST: usize = 1024;
const ROOM: usize = 8;
/// Multiplier that mixes bits (MurmurHash3, 64-bit finaliser).
const MIXING: u64 = 0xFF51_AFD7_ED55_8CCD;

/// Returns the kind of the identity of a report and the identity; none if it is not known, or is shared by many.
pub(in crate::tracker) fn name(plot: &Plot) -> Option<(u8, i64)> {
    let own = &plot.identities;
    let kinds = [i64::from(own.icao_address), own.identity, own.callsign];
    (0..).zip(kinds).find(|(_, identity)| *identity >= 0)
}

/// What a plot states apart from its time, mixed; 0 for azimuths, which may be equal.
pub(in crate::tracker) fn print(plot: &Plot, measured: [f64; 2], settings: &Settings) -> u64 {
    let geometry = settings.geometry(plot.radar);
    if geometry.is_azimuth() {
        return 0;
    }
    let mix = |seed: u64, bits: u64| {
        let mixed = (seed ^ bits).wrapping_mul(MIXING);
        mixed ^ (mixed >> 32)
    };
    let all = |numbers: [u64; 6]| numbers.into_iter().fold(1, mix);
    match plot.report.filter(|_| geometry.is_position()) {
        Some(report) => {
            let (kind, identity) = name(plot).unwrap_or((u8::MAX, -1));
            let [x, y] = report.position.map(f64::to_bits);
            all([x, y, u64::from(kind), identity as u64, 0, 1])
        }
        None => {
            let [range, azimuth] = measured.map(f64::to_bits);
            let own = &plot.identities;
            let codes = (own.icao_address as u64) << 16 ^ own.mode_3a as u64;
            let names = own.identity as u64 ^ (own.callsign as u64).rotate_left(32);
            all([range, azimuth, plot.height.to_bits(), names, codes, 2 + plot.radar as u64])
        }
    }
}

/// A plot that was seen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Seen {
    print: u64,
    time: f64,
    sensor: usize,
    index: usize,
}

/// The last plots, each at a place that follows from its print; their number is a power of two.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Copies {
    seen: Vec<Seen>,
    /// Number of plots since `begin`, s.
    count: usize,
    begin: f64,
}

impl Copies {
    /// The status of a plot with this print, time, sensor and index if it is the copy of an earlier one. Plots come
    /// in the order of time. Cost O(1).
    #[inline]
    pub fn status(
        &mut self,
        print: u64,
        (time, sensor, index): (f64, usize, usize),
        settings: &Settings,
    ) -> Option<PlotStatus> {
        if print == 0 {
            return None;
        }
        let scan = OF_SCAN * settings.radars[sensor].scan_period;
        self.count += 1;
        if (time - self.begin).abs() > scan.max(LATER) {
            (self.count, self.begin) = (1, time);
        }
        if self.seen.len() < ROOM * self.count {
            self.grow();
        }
        let own = Seen { print, time, sensor, index };
        let place = self.place(print);
        let other = std::mem::replace(&mut self.seen[place], own);
        let since = (time - other.time).abs();
        let status = match () {
            () if other.print != print => None,
            () if !settings.geometry(sensor).is_position() => {
                (since <= scan).then_some(PlotStatus::Duplicate)
            }
            () if sensor != other.sensor => (since <= LATER).then_some(PlotStatus::Duplicate),
            () => (since == 0.0).then_some(PlotStatus::Combined(other.index)),
        };
        if status.is_some() {
            self.seen[place] = other;
        }
        status
    }

    fn place(&self, print: u64) -> usize {
        print as usize & (self.seen.len() - 1)
    }

    /// Doubles the number of places.
    fn grow(&mut self) {
        let room = LEAST.max(2 * self.seen.len());
        for own in std::mem::replace(&mut self.seen, vec![Seen::default(); room]) {
            let place = self.place(own.print);
            self.seen[place] = own;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensors::radar_of;
    use crate::tracker::Motion;

    #[test]
    fn copies_are_found_among_many_plots_within_half_a_scan() {
        let settings = Settings::new(vec![radar_of([50.0, 1e-3])], Motion::Cv(1.0));
        let half = 0.5 * settings.radars[0].scan_period;
        let mut copies = Copies::default();
        let mut count = |from: u64, time: f64| {
            let mut of = |k: u64| {
                copies.status((from + k).wrapping_mul(MIXING) >> 9, (time, 0, 0), &settings)
            };
            (1..=1000).filter(|&k| of(k) == Some(PlotStatus::Duplicate)).count()
        };
        assert_eq!(count(0, 0.0), 0);
        // a few were at the places of others
        assert!(count(0, 0.9 * half) > 800);
        assert_eq!((count(5000, 1.1 * half), count(0, 2.2 * half)), (0, 0));
    }
}
