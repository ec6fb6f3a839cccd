//! Alarms for radars whose plots have suddenly ceased to fit the tracks. Until it is known whether the errors
//! of a radar have changed, its plots that no track has taken may belong to targets that have a track.
//!
//! A change within the gates is found when blocks of plots are complete, after about three scans. By then
//! plots outside the gates would have made second tracks. Therefore a radar is noticed as soon as too many of
//! its latest plots are far off. Cost O(1) a plot.

use serde::{Deserialize, Serialize};

/// Normalised squared innovation that is exceeded with the probability `SHARE`.
const FAR: f64 = 4.605;
const SHARE: f64 = 0.1;
/// Number of plots that are examined, unless there are more in a scan.
const WATCHED: usize = 16;
/// Number of standard errors by which the share of far plots must be too large, and the least such share:
/// noise that is a little larger than stated gives fewer.
const ERRORS: f64 = 4.5;
const LEAST: f64 = 0.3;
/// Scans until the radar is trusted again.
const HELD: f64 = 4.0;

/// The latest plots of a radar, and the time until which no track is confirmed by its plots.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Alarm {
    /// Whether each plot is far off, and the number of plots since the last examination.
    far: Vec<bool>,
    new: usize,
    until: f64,
}

impl Default for Alarm {
    fn default() -> Self {
        Self { far: Vec::new(), new: 0, until: f64::NEG_INFINITY }
    }
}

impl Alarm {
    /// Adds the normalised squared innovation of a plot.
    pub fn see(&mut self, square: f64) {
        self.far.push(square > FAR);
        self.new += 1;
    }

    /// Examines the plots of a scan and those before.
    pub fn look(&mut self, time: f64, period: f64) {
        let last = self.far.len().saturating_sub(self.new.max(WATCHED));
        self.far.drain(..last);
        let count = self.far.len() as f64;
        let most = LEAST.max(SHARE + ERRORS * (SHARE * (1.0 - SHARE) / count).sqrt());
        let far = self.far.iter().filter(|far| **far).count() as f64;
        if self.new > 0 && self.far.len() >= WATCHED && far >= most * count {
            self.until = time + HELD * period;
        }
        self.new = 0;
    }

    /// Whether no track is to be confirmed by the plots of this radar.
    pub fn holds(&self, time: f64) -> bool {
        time < self.until
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn held(squares: impl Iterator<Item = f64>) -> Vec<bool> {
        let mut alarm = Alarm::default();
        squares.for_each(|square| alarm.see(square));
        alarm.look(10.0, 5.0);
        [10.0, 29.9, 30.0].map(|time| alarm.holds(time)).to_vec()
    }

    #[test]
    fn a_radar_whose_plots_are_far_off() {
        // too many are seven of sixteen, or thirty of a hundred
        let of = |count: usize, far: usize| {
            held((0..count).map(move |i| if i < far { 9.0 } else { 1.0 }))
        };
        assert_eq!(of(16, 7), [true, true, false]);
        assert_eq!(of(16, 6), [false; 3]);
        assert_eq!(of(15, 15), [false; 3]);
        assert_eq!(of(100, 30), [true, true, false]);
        assert_eq!(of(100, 29), [false; 3]);
    }

    #[test]
    fn plots_of_earlier_scans_count_where_there_are_few() {
        let mut alarm = Alarm::default();
        for scan in 0..4 {
            for _ in 0..4 {
                alarm.see(9.0);
            }
            alarm.look(f64::from(scan), 1.0);
            assert_eq!(alarm.holds(f64::from(scan)), scan == 3);
        }
        for scan in 4..9 {
            alarm.look(f64::from(scan), 1.0);
        }
        assert!(!alarm.holds(8.0));
        assert!(!Alarm::default().holds(f64::NEG_INFINITY));
    }
}
