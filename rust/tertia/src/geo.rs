//! The earth: WGS 84, local frames that are tangent to it, and the system plane for the tracks of several
//! radars.
//!
//! In this module latitudes and longitudes are in radians, heights in metres above the ellipsoid, and
//! azimuths in radians clockwise from true north. Geocentric positions are earth-centred, earth-fixed x,
//! y, z.
//!
//! `ellipsoid <- local <- plane <- frame; local, plane <- view`
//!
//! | part | what | cost |
//! |---|---|---|
//! | [`ellipsoid`] | geodetic and geocentric coordinates | O(1) |
//! | [`LocalFrame`] | east, north, up; range and azimuth with a height | O(1) |
//! | [`SystemPlane`] | oblique stereographic plane, as used by system tracks of category 62 | O(1) |
//! | [`View`] | plots of a radar in the system plane, with their derivatives | O(1) |
//! | [`Frame`] | conversion of states and their covariances from one frame to another | O(1) |
//! | [`states`] | polar states of position, velocity and acceleration | O(1) |
//! | [`Atmosphere`] | pressure altitudes and heights above the ellipsoid | O(1) |
//!
//! # Trap
//! A height above sea level is not a height above the ellipsoid: they differ by the undulation of the geoid,
//! which is 45 m in Central Europe.

mod atmosphere;
pub mod ellipsoid;
mod frame;
mod local;
mod plane;
pub mod states;
mod view;

pub use atmosphere::Atmosphere;
pub use ellipsoid::Geodetic;
pub use frame::Frame;
pub use local::LocalFrame;
pub use plane::SystemPlane;
pub use view::{Seen, View};
