//! Turns scans of plots into tracks (Glagovskiy, Lavina, Rudelson 2014, with improvements).
//!
//! [`Tracker::track`] takes plots of several radars in the order of time. In every scan, the confirmed tracks
//! take plots first, by the assignment with the largest likelihood, then the tentative tracks do; each
//! remaining plot starts a tentative track. Radars see a target at different times, each once per scan.
//!
//! Main modules, where those on the right use those on the left: `estimate <- kinematics, lean <- delay;
//! motion <- bank <- circles; level, geometry <- plot, differences <- quality; mht <- association; geometry,
//! plans, association, motion, quality <- settings, velocities <- plan, curve, prospects <- window, circles
//! <- filter <- resolution, sight, moving; plan <- correlation; doubles, extent, fixed, patches, tally,
//! weighed <- clutter; height, identity, beams, filter, moving, correlation, existence, tree, suspicion,
//! outliers, clutter <- track <- cluster, row, claim, schedule, reflections, ended, azimuths; outliers,
//! turning <- noise <- strays <- resume <- share <- scan, repeats, shapes <- live <- ending, kept, control,
//! found, late <- lag; plot <- clock <- lag`; `kinematics, motion, noise, agility <- smooth` beside them.
//!
//! A plot costs O(1) as long as the number of targets within a gate does not grow; memory is O(tracks).

mod agility;
mod ahead;
mod association;
mod azimuths;
mod bank;
mod beams;
mod circles;
mod claim;
mod clock;
mod cluster;
mod clutter;
mod columns;
mod common;
mod control;
mod copies;
mod correlation;
mod curve;
mod delay;
mod differences;
mod doubles;
mod ended;
mod ending;
mod estimate;
mod existence;
mod extent;
mod filter;
mod fixed;
mod follower;
mod found;
mod geometry;
mod groups;
mod height;
mod identity;
mod individual;
mod kept;
mod kinematics;
mod lag;
mod late;
mod lean;
mod level;
mod live;
mod mht;
mod motion;
mod moving;
mod noise;
mod origins;
mod outliers;
mod patches;
mod plan;
mod plans;
mod plot;
mod prospects;
mod quality;
mod reflections;
mod repeats;
mod resolution;
mod resume;
mod rivals;
mod row;
mod scan;
mod schedule;
mod settings;
mod shapes;
mod share;
mod sharp;
mod sight;
mod smooth;
mod speed;
mod strays;
mod suspicion;
mod swerve;
mod table;
mod tally;
mod track;
mod tree;
mod turning;
mod velocities;
mod weighed;
mod window;

pub use crate::base::plane::Plane;
pub use crate::sensors::Radar;
pub use association::Association;
pub use clock::ClockDoubt;
pub use columns::{COLUMNS, Column, Values};
pub use control::{Command, Refusal};
pub use estimate::Estimate;
pub(crate) use follower::Follower;
pub use geometry::Geometry;
pub use identity::CODES_OF_MANY;
pub use lag::LagTracker;
pub use level::Heights;
pub use live::Tracker;
pub use mht::Mht;
pub use motion::{ImmModel, Motion, WindowModel};
pub use plans::Plans;
pub use plot::{Plot, PlotStatus, Plots, Report};
pub use row::{Resumed, Row, Rows};
pub use settings::{Confirmation, Settings};
pub use smooth::{
    Manoeuvre, Movement, PlacedPlot, SmoothedRow, Times, TrackPlot, height_offset,
    shown_covariances, smooth_tracks,
};
pub use table::{Data, Table};
