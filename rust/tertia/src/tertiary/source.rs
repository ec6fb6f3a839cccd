//! What is learnt of the tracker of a sensor from all its tracks.

use super::family::Evidence;
use crate::sensors::Radar;
use serde::{Deserialize, Serialize};

/// Number of gaps from which the usual one is known, after which half are forgotten, and the share of gaps
/// that are at most the usual one.
const FEWEST: u32 = 30;
const MOST: u32 = 1000;
const USUAL: f64 = 0.1;

/// What is learnt of the tracker of a sensor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Source {
    pub evidence: Evidence,
    /// Numbers of gaps between rows of one, two, three and more scans.
    gaps: [u32; 4],
}

impl Source {
    /// Adds a gap between two rows of a track, in scans.
    pub fn see(&mut self, scans: f64) {
        self.gaps[(scans.round() as usize).clamp(1, self.gaps.len()) - 1] += 1;
        if self.gaps.iter().sum::<u32>() > MOST {
            self.gaps = self.gaps.map(|count| count / 2);
        }
    }

    /// Returns the number of scans from row to row, if the sensor detects the target: more than one if the
    /// tracker leaves out rows.
    fn scans(&self) -> f64 {
        let all: u32 = self.gaps.iter().sum();
        if all < FEWEST {
            return 1.0;
        }
        let (mut shorter, mut scans) = (0, 1);
        for (count, k) in self.gaps.iter().zip(1..) {
            shorter += count;
            scans = k;
            if f64::from(shorter) >= USUAL * f64::from(all) {
                break;
            }
        }
        f64::from(scans)
    }
}

/// Returns the sensors with the time between the rows of their tracks as period.
pub(super) fn paced(radars: &[Radar], sources: &[Source]) -> Vec<Radar> {
    let all = radars.iter().zip(sources);
    all.map(|(radar, source)| Radar {
        scan_period: source.scans() * radar.scan_period,
        ..radar.clone()
    })
    .collect()
}

/// Returns the sensors with this noise of range and azimuth.
pub(super) fn with_noise(radars: &[Radar], noise: &[[f64; 2]]) -> Vec<Radar> {
    let all = radars.iter().zip(noise);
    all.map(|(radar, &[range_sigma, azimuth_sigma])| Radar {
        range_sigma,
        azimuth_sigma,
        ..radar.clone()
    })
    .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tracker_that_leaves_out_rows() {
        let (mut every, mut second) = (Source::default(), Source::default());
        for k in 0..40 {
            // some plots are missing
            let missed = if k % 4 == 0 { 1.0 } else { 0.0 };
            every.see(1.02 + missed);
            second.see(1.95 + missed);
        }
        assert_eq!((every.scans(), second.scans()), (1.0, 2.0));
        let mut new = Source::default();
        new.see(3.0);
        assert_eq!(new.scans(), 1.0);
    }
}
