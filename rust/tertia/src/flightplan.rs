//! Flight plans: routes of straight legs and fly-by turns, and their relation to tracks.
//!
//! Positions are east and north in metres. Courses and angles of turns are mathematical: radians,
//! counter-clockwise from east. Cross-track distances are positive to the right of the course. Legs count
//! from 0, and the turn of a leg is the one at its end; that of the last leg continues straight ahead.
//!
//! | part | what | cost |
//! |---|---|---|
//! | `turn` | one fly-by turn: start, arc, end, projections, the zone in which it is flown | O(1) |
//! | `capture` | the arc from the position of an aircraft to its next leg, and when the turn starts | O(1) |
//! | `route` | the whole path: positions, projections, times over | O(legs) |
//! | `plan` | a route and the identities of the aircraft that flies it | |
//! | `monitor` | whether a track still follows its plan | O(1); blocked, O(legs) |
//! | `correlation` | which plan a track follows | O(legs) per plan and sighting |
//! | `times_over` | times over the waypoints ahead, from the speed flown so far | O(1) per sighting |

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
