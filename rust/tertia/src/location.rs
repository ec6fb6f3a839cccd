//! Location: estimates a position at one instant from ranges, azimuths, elevations, range differences
//! and times of arrival of several stations, some of which may be wrong.
//!
//! Azimuths are clockwise from north; positions are local east, north and up in metres. With the
//! whitened residuals `r_i = (z_i − h_i(p)) / σ_i`, the estimate minimises `Σ ρ(r_i)`. For least
//! squares, ρ is half the square; the robust method uses Tukey's biweight, from a start that faults do
//! not spoil. Times of arrival have the time of emission as an additional unknown. Range differences
//! whose errors have a common part are converted into arrivals, with the arrival at the first station
//! at zero. For arrivals, ρ is `−ln` of the density of normal noise and rare faults.
//!
//! The parts, in an order in which each uses only those above it:
//!
//! | part | content |
//! |---|---|
//! | `descent` | Gauss–Newton and Newton steps, of one instant or of several side by side; minima |
//! | `search` | starting points, and the search for the minimum that explains an instant best |
//! | `solver` | location of an instant, from its measurements to position and covariance |
//! | `regions` | regions around positions, and protection levels |
//! | `few_bearings` | the density of positions from two to four bearings |
//! | `batch` | sizes of errors and frequency of outliers, from all instants together |
//! | `medium` | speed of the signals, wind, and the side of the stations on which the targets are |
//! | `accuracy` | the covariance that positions would have |

// indices are those of the formulas
#![allow(clippy::needless_range_loop)]

mod accuracy;
mod batch;
mod descent;
mod few_bearings;
mod medium;
mod regions;
mod search;
mod solver;

pub use batch::contradiction::Contradiction;
pub use batch::explained::{Cause, Explanation};
pub use batch::mixture::Mixture;
use descent::lane;
pub use few_bearings::concentration::{Decay, STEPS, Weights};
pub use few_bearings::posterior::{Bearings, Posterior, Summary, pooled};
pub use medium::Medium;
pub use medium::speed::Speed;
pub use medium::wind::Wind;
pub use regions::contour::Outline;
pub use regions::protection::Protection;
pub use regions::region::{Located, Spread};
pub use search::fix::{Fix, Instant, Method, Output, Status};
pub use solver::{Locator, Workspace};

/// Number of instants that are located side by side.
pub const BLOCK: usize = lane::LANES;
