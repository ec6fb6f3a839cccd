//! Location: a position at one instant from ranges, azimuths, elevations, range differences and
//! times of arrival of several stations, some of them wrong.
//!
//! Azimuths turn clockwise from north; positions are local east, north and up in metres. With the
//! whitened residuals `r_i = (z_i − h_i(p)) / σ_i` the estimate minimises `Σ ρ(r_i)`, where ρ is
//! half the square, or Tukey's biweight from a start that survives faults. Times of arrival have one
//! unknown more, the emission, and so have range differences whose errors have a common part: they
//! are read as arrivals, that of the first station at zero. Their ρ is `−ln` of the density of
//! normal noise and rare faults.
//!
//! | part | what |
//! |---|---|
//! | `fix` | what is asked of an instant, and what comes out |
//! | `record` | the measurements of an instant |
//! | `candidates` | points that as many measurements as there are coordinates agree on |
//! | `arrivals` | where times of arrival say that their emission was |
//! | `descent` | Gauss–Newton with Levenberg's safeguard |
//! | `block`, `lanes`, `total` | the same for several instants side by side |
//! | `starts` | what points to start from cost, several side by side |
//! | `doubt` | what measurements that may be faults add to the covariance |
//! | `growth` | what residuals add to it that are too large |
//! | `contradiction` | the same for all instants together |
//! | `modes`, `mixture` | the same where there are outliers among few redundant measurements |
//! | `normals` | ellipses of mixtures of normal errors |
//! | `evidence` | how likely measurements are, with sigmas of one size or another |
//! | `alone` | how large the sigmas are of one instant that has outliers |
//! | `profile` | where the cost is no parabola |
//! | `solver` | the way of an instant |
//! | `search` | start, robust steps, other minima |
//! | `summary` | covariance, σ, dilution of precision |
//! | `lenth` | the estimators of Lenth (1981), for azimuths alone |
//! | `posterior`, `quadtree`, `concentration` | the density of positions of a few bearings |
//! | `region`, `contour`, `radial` | regions around positions, their outlines, radii |
//! | `speed` | the speed of the signals, where it is not known exactly |
//! | `wind` | the wind, where signals are carried by it |
//! | `medium` | both together |
//! | `protection` | protection levels |

// indices are those of the formulas
#![allow(clippy::needless_range_loop)]

mod alone;
mod arrivals;
mod block;
mod candidates;
mod concentration;
mod contour;
mod contradiction;
mod descent;
mod doubt;
mod evidence;
mod faulty;
mod fix;
mod growth;
mod lane;
mod lanes;
mod lenth;
mod medium;
mod mixture;
mod modes;
mod normals;
mod posterior;
mod profile;
mod protection;
mod quadtree;
mod radial;
mod record;
mod region;
mod search;
mod solver;
mod speed;
mod starts;
mod summary;
mod total;
mod wind;

pub use concentration::{Decay, STEPS, Weights};
pub use contour::Outline;
pub use contradiction::Contradiction;
pub use fix::{Fix, Instant, Method, Output, Status};
pub use medium::Medium;
pub use mixture::Mixture;
pub use posterior::{Bearings, Density, Posterior, Summary, pooled};
pub use protection::Protection;
pub use region::{Located, Spread};
pub use solver::{Locator, Workspace};
pub use speed::Speed;
pub use wind::Wind;

/// Instants that are located side by side.
pub const BLOCK: usize = lane::LANES;
