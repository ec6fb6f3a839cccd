//! Sensors: measurements of stations, their dependence on the position of a target, and the properties of
//! radars and their plots.

// indices are written as in the formulas
#![allow(clippy::needless_range_loop)]

mod channel;
mod identity;
mod measurement;
mod radar;

pub use channel::{Channel, Detection, Way};
pub(crate) use identity::both;
pub use identity::{Identities, IdentityKind, callsign_number, callsign_text};
pub use measurement::predict;
pub(crate) use measurement::{Kind, Measurement, Row, SMALL_TANGENT, TERMS, read, relative};
#[cfg(test)]
pub(crate) use radar::radar_of;
pub(crate) use radar::{HEIGHT_SIGMA, LEAST_ACROSS, SPREAD};
pub use radar::{Radar, Ways};

/// Number of kinds of measurements. In the rows of an instant their order is: ranges, azimuths, elevations,
/// range differences (range of each station minus that of the first), and times of arrival, in metres.
pub const KINDS: usize = 5;
