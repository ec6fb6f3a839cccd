//! Registration: the noise and the biases of radars, from the tracks of each radar alone and of all
//! radars together. Positions are east and north in metres; azimuths are clockwise from north.
//!
//! | part | what | cost |
//! |---|---|---|
//! | `lines` | mean squares of plots about short straight lines in their track | O(N log N) |
//! | `noise` | standard deviations of range and azimuth over time, from these mean squares | O(N log N) |
//! | `row`, `common` | states of the radars' tracks at common instants | O(N log N + M K) |
//! | `sighting`, `block` | information of plots of one target by several radars about errors | O(n K²) |
//! | `clusters` | by how much blocks overstate what is known, as errors of a target last | O(q³) a target |
//! | `targets` | plots of targets, corrected and placed | O(n) |
//! | `sums` | information of many blocks | O(q²) a block |
//! | `recording` | the errors of the radars from all blocks of a recording | O(N log N + N K²) |
//! | `live` | the errors scan by scan, from a few dozen targets | O(K³) a scan |
//! | `gaussian` | estimates of the errors with their covariance, and how they drift | O(K³) |
//! | `roster` | the tracks by number | O(1) a row |
//! | `followed` | a track, and the effect of the errors on its covariance | O(R²) a row of R radars |
//! | `settled` | how velocities and azimuths without such errors reduce that effect | O(R) a row |
//! | `vote` | sudden changes that are larger than the gates, by the tracks that miss their plots | O(V²) |
//! | `alarm` | radars whose last plots do not fit their tracks | O(1) a plot |
//! | `watch` | noise that has grown suddenly, by the last innovations | O(1) a plot |
//! | `start` | errors far larger than expected, from the tracks of each radar at one instant | O(C² N) |
//! | `correction` | states with biases removed and covariances scaled to the noise found | O(M K) |

mod alarm;
mod block;
mod calibration;
mod change;
mod clusters;
mod correction;
mod effect;
mod exchange;
mod followed;
mod gaussian;
mod history;
mod lines;
mod live;
mod noise;
mod parallax;
mod recording;
mod row;
mod sighting;
mod start;
mod states;
mod sums;
mod targets;
mod tracks;
mod unaffected;
mod vote;
mod watch;

pub use calibration::{Calibration, Run, calibrate};
pub use correction::correct;
pub use exchange::{Changed, Other, Update, Updates};
pub use lines::{Line, PolarPlot, lines};
pub use live::Registrar;
pub use noise::{Level, Noise, noise, stretch_of};
pub use recording::{Periods, Prior, Registered, register};
pub use row::{Row, Table};
pub use sighting::{ERRORS, Errors, KINDS, Place, Report};
pub use start::{Alone, Start, start};
pub use states::{States, common_states};
pub use targets::TargetPlot;
pub(crate) use unaffected::restrain;
