//! Turns scans of plots into tracks (Glagovskiy, Lavina, Rudelson 2014, with improvements).
//!
//! [`Tracker::track`] takes plots of several radars in the order of time. In every scan, the confirmed tracks
//! take plots first, by the assignment with the largest likelihood, then the tentative tracks do; each
//! remaining plot starts a tentative track. Radars see a target at different times, each once per scan.
//!
//! The parts, in an order in which each uses only those above it:
//!
//! | part | content |
//! |---|---|
//! | `plot` | plots, their geometry, the prior of heights, the times at which plots come |
//! | `motion` | models of motion, alone and mixed (IMM); states, and how they are predicted |
//! | `errors` | how far positions that sensors report are from what is stated; their delays |
//! | `settings` | settings, methods of assignment, flight plans |
//! | `filter` | the filter of a track: its models, windows, flight plans, azimuths, plots that were merged |
//! | `replies` | identities and heights that targets report |
//! | `noise` | noise of the sensors, outliers, and plots that repeat others |
//! | `clutter` | density of false plots, fixed echoes |
//! | `smooth` | tracks smoothed over all their plots |
//! | `track` | one track: what it is based on, its stage, what it takes and what it misses |
//! | `rows` | results: rows and tables |
//! | `assignment` | which tracks compete for which plots, and who gets them |
//! | `management` | new tracks, lost tracks, targets that left their gates |
//! | `scan` | the plots of one scan |
//! | `live` | the tracker: scan after scan |
//! | `lag` | the tracker with late plots |
//!
//! A plot costs O(1) as long as the number of targets within a gate does not grow; memory is O(tracks).

mod assignment;
mod clutter;
mod errors;
mod filter;
mod lag;
mod live;
mod management;
mod motion;
mod noise;
mod plot;
mod replies;
mod rows;
mod scan;
mod settings;
mod smooth;
mod track;

pub use crate::base::plane::Plane;
pub use crate::sensors::Radar;
pub(crate) use filter::follower::Follower;
pub use lag::LagTracker;
pub use live::Tracker;
pub use live::control::{Command, Refusal};
pub use motion::estimate::Estimate;
pub use motion::{ImmModel, Motion, WindowModel};
pub use plot::clock::ClockDoubt;
pub use plot::geometry::Geometry;
pub use plot::level::Heights;
pub use plot::{Plot, PlotStatus, Plots, Report};
pub use replies::identity::CODES_OF_MANY;
pub use rows::columns::{COLUMNS, Column, Values};
pub use rows::row::{Resumed, Row, Rows};
pub use rows::table::{Data, Table};
pub use settings::association::Association;
pub use settings::mht::Mht;
pub use settings::plans::Plans;
pub use settings::{Confirmation, Settings};
pub use smooth::{
    Manoeuvre, Movement, PlacedPlot, SmoothedRow, Times, TrackPlot, height_offset,
    shown_covariances, smooth_tracks,
};
