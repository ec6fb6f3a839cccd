//! Simulation of aircraft along routes, and of the times at which the beam of a radar passes them.
//!
//! East and north are the real and imaginary parts of complex numbers. A factor of `exp(−i a)` rotates
//! clockwise by a, a factor of −i to the right. Random numbers come from the caller.
//!
//! | part | what | cost |
//! |---|---|---|
//! | `wander` | a smooth random process | O(1) per step |
//! | `flight` | a point mass that flies a route by banking | O(1) per step |
//! | `traffic` | positions and velocities of flights between their samples | O(1) |
//! | `beam` | times at which a rotating beam passes each flight | O(1) per passage |

mod beam;
mod flight;
mod traffic;
mod wander;

pub use beam::{Beam, meetings};
pub use flight::{Flight, Passing, Pilot, Route, Sample};
pub use nalgebra::Complex;
pub use traffic::{State, Traffic};
pub use wander::{Process, Wander};
