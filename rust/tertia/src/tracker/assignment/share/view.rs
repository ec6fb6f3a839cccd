//! What all threads see of a scan, and what each thread returns.

use crate::tracker::assignment::cluster::Cells;
use crate::tracker::clutter::Clutter;
use crate::tracker::noise::Noise;
use crate::tracker::noise::duplicates::Seconds;
use crate::tracker::noise::outliers::Stray;
use crate::tracker::plot::Measured;
use crate::tracker::settings::Settings;
use crate::tracker::track::reflections::Reflections;

/// A plot that was given to a track.
#[derive(Clone, Copy, Debug)]
pub(in crate::tracker) struct Given {
    /// Place in the order of results: the rank of its claim; plots from the guard gate come after
    /// all others of the group.
    pub(super) place: u32,
    pub plot: u32,
    pub track: u64,
    /// Whether the track is confirmed by this plot.
    pub begun: bool,
    /// Radar of an earlier plot, which this plot shows to have been an outlier.
    pub outlier: Option<usize>,
    /// An earlier plot that was not taken, which this plot shows to have been an outlier.
    pub stray: Option<Stray>,
    /// Whether the plot may be of a fixed echo.
    pub is_still: bool,
    /// Whether the track is more likely a reflection than not.
    pub is_reflection: bool,
    /// Whether it may be one after all.
    pub is_doubted: bool,
    /// Probability that the track consists of false plots; 0 for confirmed tracks.
    pub false_probability: f64,
    /// Index of the row, if there is one.
    pub(super) row: u32,
}

/// False plots of each radar, which do not change while plots are assigned.
pub(in crate::tracker) struct Rates {
    /// Density, 1/m².
    pub density: Vec<f64>,
    /// Logarithm of the odds of a target rather than a false plot, before a plot is compared with the prediction.
    pub odds: Vec<f64>,
}

impl Rates {
    pub fn of(clutter: &[Clutter], settings: &Settings) -> Self {
        let of_each = clutter.iter().zip(&settings.radars);
        let density: Vec<_> = of_each.map(|(own, radar)| own.density(radar)).collect();
        let odds = (0..density.len()).map(|radar| settings.odds(radar, density[radar])).collect();
        Self { density, odds }
    }
}

/// What all threads see of a scan.
#[derive(Clone, Copy)]
pub(in crate::tracker) struct View<'a> {
    pub plots: &'a [Measured],
    /// Plots of the claims.
    pub claimed: &'a [u32],
    /// Whether each plot is deferred.
    pub deferred: &'a [bool],
    /// Density of second plots and outliers of confirmed tracks at each plot.
    pub others: &'a [f64],
    /// Where second plots of other plots may be.
    pub seconds: &'a Seconds,
    pub reflections: &'a Reflections,
    pub settings: &'a Settings,
    pub clutter: &'a [Clutter],
    pub rates: &'a Rates,
    pub noise: &'a [Noise],
    /// Clusters of tracks whose states depend on one another.
    pub cells: &'a Cells,
}
