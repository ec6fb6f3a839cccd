//! What all threads see of a scan, and what each gives back.

use crate::tracker::cluster::Cells;
use crate::tracker::clutter::Clutter;
use crate::tracker::doubles::Seconds;
use crate::tracker::noise::Noise;
use crate::tracker::outliers::Stray;
use crate::tracker::plot::Measured;
use crate::tracker::reflections::Reflections;
use crate::tracker::settings::Settings;

/// A plot that was given to a track.
#[derive(Clone, Copy, Debug)]
pub(in crate::tracker) struct Given {
    /// Its place: the claim's rank, those of the guard gate after all others of the group.
    pub(super) place: u32,
    pub plot: u32,
    pub track: u64,
    /// Whether the track is confirmed by this plot.
    pub begun: bool,
    /// Radar of a plot before that was an outlier, as this one shows.
    pub outlier: Option<usize>,
    /// Another one that was no plot of the track.
    pub stray: Option<Stray>,
    /// Whether the plot may be of a fixed echo.
    pub is_still: bool,
    /// Whether the track is a reflection, more likely than not.
    pub is_reflection: bool,
    /// Whether it may be one after all.
    pub is_doubted: bool,
    /// Index of the row, if there is one.
    pub(super) row: u32,
}

/// What all threads see of a scan.
#[derive(Clone, Copy)]
pub(in crate::tracker) struct View<'a> {
    pub plots: &'a [Measured],
    /// Plots of the claims.
    pub claimed: &'a [u32],
    /// Which plots wait.
    pub deferred: &'a [bool],
    /// The density of second plots and outliers of confirmed tracks where each plot is.
    pub others: &'a [f64],
    /// Where those of others may be.
    pub seconds: &'a Seconds,
    pub reflections: &'a Reflections,
    pub settings: &'a Settings,
    pub clutter: &'a [Clutter],
    pub noise: &'a [Noise],
    /// Clusters of tracks whose states depend on one another.
    pub cells: &'a Cells,
}
