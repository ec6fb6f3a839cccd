//! Sensors: what a station measures of a target, and how that changes with the position; what a plot
//! of a radar says of one.

// indices are those of the formulas
#![allow(clippy::needless_range_loop)]

mod channel;
mod identity;
mod measurement;
mod radar;

pub use channel::{Channel, Detection, Way};
pub(crate) use identity::both;
pub use identity::{Identities, IdentityKind, callsign_number, callsign_text};
pub use measurement::predict;
pub(crate) use measurement::{Kind, Measurement, Row, SMALL_TANGENT, TERMS, read};
pub(crate) use radar::HEIGHT_SIGMA;
#[cfg(test)]
pub(crate) use radar::radar_of;
pub use radar::{Radar, Ways};

/// Kinds of measurements, in the order of an instant's rows: ranges, azimuths, elevations, the
/// differences of each station's range and that of the first, and arrivals: times of arrival, in
/// metres.
pub const KINDS: usize = 5;
