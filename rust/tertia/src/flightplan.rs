//! Flight plans: routes of straight legs and fly-by turns, and how tracks relate to them.
//!
//! Positions are east and north in metres. Courses and angles of turns are mathematical: radians,
//! counter-clockwise, from east. Cross-track distances are positive to the right of the course. Legs count from 0,
//! and the turn of a leg is the one at its end; that of the last leg goes straight on.
//!
//! | part | what | cost |
//! |---|---|---|
//! | `turn` | one fly-by turn: start, arc, end, projections, the zone where it is flown | O(1) |
//! | `capture` | the arc from where an aircraft is to its next leg, and when it will start it | O(1) |
//! | `route` | the whole path: positions, projections, times over | O(legs) |
//! | `plan` | a route and who flies it | |
//! | `monitor` | whether a track still follows its plan | O(1); blocked, O(legs) |
//! | `correlation` | which plan a track flies | O(legs) a plan and sighting |
//! | `times_over` | times over the waypoints ahead, from the speed flown so far | O(1) a sighting |

mod capture;
mod correlation;
mod monitor;
mod plan;
mod plane;
mod route;
mod times_over;
mod turn;

pub(crate) use capture::hazard;
pub use capture::{Capture, capture, capture_in_wind, lead_in_wind, lead_ratio};
pub use correlation::{Decision, Link, Sighting, Status, decide, mean_scores, score};
pub(crate) use correlation::{along, expected, is_due};
pub use monitor::{Monitor, Verdict};
pub use plan::Plan;
pub use route::{Projection, Route};
pub use times_over::{SpeedHistory, TimeOver, speed_histories};
pub use turn::Turn;
