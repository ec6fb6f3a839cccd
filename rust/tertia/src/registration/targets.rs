//! Plots of targets, and how their radars see them.

use super::block::Unknowns;
use super::sighting::{Errors, Report, Sighting};
use crate::sensors::Radar;
use serde::{Deserialize, Serialize};

/// Duration of a block in scans of the slowest radar.
const SCANS: f64 = 2.2;
/// Time for which errors of reported positions last, s.
const LASTING: f64 = 300.0;
/// Mean square of an unknown height relative to the largest squared height.
const MEAN_SQUARE: f64 = 1.0 / 3.0;

/// A plot of a target.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TargetPlot {
    /// The plot.
    pub report: Report,
    /// Number of the target.
    pub target: i64,
    /// Probability that the target turns.
    pub turn_probability: f64,
}

/// Properties of the radars.
pub(super) struct Ways<'a> {
    pub radars: &'a [Radar],
    /// Whether ranges without a height are slant.
    pub slant: &'a [bool],
}

/// Duration of a block, s.
pub(super) fn scans(radars: &[Radar]) -> f64 {
    SCANS * radars.iter().map(|radar| radar.scan_period).fold(0.0, f64::max)
}

/// Numbers the unknown errors.
pub(super) fn numbered(prior: &[Errors]) -> Unknowns {
    let mut next = 0;
    let mut number = |sigma: f64| {
        (sigma > 0.0).then(|| {
            next += 1;
            (next - 1, sigma)
        })
    };
    prior.iter().map(|own| own.map(&mut number)).collect()
}

/// Calls `act` with radar, error, column and standard deviation of each unknown.
pub(super) fn for_each(unknowns: &Unknowns, mut act: impl FnMut(usize, usize, usize, f64)) {
    for (k, own) in unknowns.iter().enumerate() {
        for (j, unknown) in own.iter().enumerate() {
            if let Some((column, sigma)) = *unknown {
                act(k, j, column, sigma);
            }
        }
    }
}

impl Ways<'_> {
    /// Returns corrected plots in order of time. A plot without a height is placed at the mean height of the
    /// others or, if there is none, at an assumed height.
    pub fn sightings(
        &self,
        plots: &[TargetPlot],
        errors: &[Errors],
        factor: &[[f64; 2]],
    ) -> Vec<Sighting> {
        let heights = plots.iter().map(|plot| plot.report.height).filter(|own| own.is_finite());
        let (sum, count) = heights.fold((0.0, 0.0), |(sum, count), own| (sum + own, count + 1.0));
        let mean = sum / count;
        let ranges = plots.iter().filter(|plot| plot.report.range.is_finite());
        let highest = ranges.map(|plot| plot.report.highest()).fold(f64::INFINITY, f64::min);
        let mut found: Vec<Sighting> = plots
            .iter()
            .filter_map(|plot| {
                let k = plot.report.radar;
                let report = plot.report.corrected(&errors[k]);
                let is_slant = mean.is_nan() && self.slant[k] && report.place.is_none();
                let highest = is_slant.then_some(highest);
                let assumed = highest.map_or(mean, |highest| (MEAN_SQUARE * highest).sqrt());
                let height = if report.height.is_finite() { report.height } else { assumed };
                let mut own = Sighting::new(&report, height, &self.radars[k], factor[k])?;
                own.highest = highest;
                Some(own)
            })
            .collect();
        found.sort_by(|a, b| a.time.total_cmp(&b.time));
        if found.iter().any(|one| one.is_placed) {
            keep_middle(&mut found, self.radars);
        }
        found
    }
}

/// Keeps one of the positions that a sensor reports in a block, near its middle. The errors of reported
/// positions last, so all blocks of a target within `LASTING` have together the information of one.
fn keep_middle(sightings: &mut Vec<Sighting>, radars: &[Radar]) {
    let middle = f64::midpoint(sightings[0].time, sightings[sightings.len() - 1].time);
    let wider = (LASTING / scans(radars)).max(1.0).sqrt();
    let mut kept: Vec<Option<Sighting>> = vec![None; radars.len()];
    for one in sightings.iter().filter(|one| one.is_placed) {
        let nearest = kept[one.radar].map_or(f64::INFINITY, |kept| (kept.time - middle).abs());
        if (one.time - middle).abs() < nearest {
            let mut nearer = *one;
            nearer.sigma = one.sigma.map(|own| wider * own);
            kept[one.radar] = Some(nearer);
        }
    }
    sightings.retain(|one| !one.is_placed);
    sightings.extend(kept.into_iter().flatten());
    sightings.sort_by(|a, b| a.time.total_cmp(&b.time));
}
