//! Registration: the noise and the biases of radars, from the tracks of each radar alone and of all
//! radars together. Positions are east and north in metres; azimuths are clockwise from north.
//!
//! | part | what | cost |
//! |---|---|---|
//! | `lines` | mean squares of plots about short straight lines in their own track | O(N log N) |
//! | `noise` | standard deviations of range and azimuth over time, from these mean squares | O(N log N) |
//! | `row`, `common` | states of the radars' tracks at common instants | O(N log N + M K) |
//! | `bias` | biases of range and azimuth from the differences of these states | O(M K⁴) |
//! | `correction` | the states with biases removed and covariances scaled to the noise found | O(M K) |

mod bias;
mod calibration;
mod common;
mod correction;
mod lines;
mod noise;
mod row;

pub use bias::{Biases, Site, biases};
pub use calibration::{Calibration, Run, calibrate};
pub use common::{Common, common};
pub use correction::correct;
pub use lines::{Line, PolarPlot, lines};
pub use noise::{Level, Noise, noise, stretch_of};
pub use row::{Row, Table};
