//! Flight plans: routes of straight legs and fly-by turns, what a track has to do with them.
//!
//! Positions are east and north in metres. Courses and angles of turns are mathematical: radians,
//! counter-clockwise, from east. Offsets are positive to the right of the course. Legs count from 0,
//! and the turn of a leg is the one at its end; that of the last leg goes straight on.
//!
//! | part | what | cost |
//! |---|---|---|
//! | `turn` | one fly-by turn: start, arc, end, projections, the zone where it is flown | O(1) |
//! | `capture` | the arc from where an aircraft is to its next leg, and when it will start it | O(1) |
//! | `route` | the whole way: positions, projections, passing times | O(legs) |
//! | `monitor` | whether a track still follows its plan | O(1); blocked, O(legs) |
//! | `correlation` | which plan a track belongs to | O(legs) a plan and sighting |
//! | `refinement` | passing times by what has been flown so far | O(1) a sighting |

mod capture;
mod correlation;
mod monitor;
mod plane;
mod refinement;
mod route;
mod turn;

pub(crate) use capture::hazard;
pub use capture::{Capture, capture, capture_in_wind, lead_in_wind, lead_ratio, start_hazard};
pub use correlation::{Decision, Link, Sighting, Status, decide, mean_scores, score};
pub use monitor::{Monitor, Verdict};
pub use refinement::{Passing, Refinement};
pub use route::{Projection, Route};
pub use turn::Turn;
