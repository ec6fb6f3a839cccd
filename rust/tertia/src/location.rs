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
//! | part | content |
//! |---|---|
//! | `fix` | arguments and results of the location of one instant |
//! | `record` | the measurements of an instant |
//! | `candidates` | starting points, each computed from a minimal set of measurements |
//! | `arrivals` | starting points from times of arrival |
//! | `descent` | Gauss–Newton and Newton steps with Levenberg damping |
//! | `block`, `lanes`, `total` | the same for several instants side by side |
//! | `starts` | costs of starting points, several side by side |
//! | `doubt` | effect on the covariance of measurements that may be faults |
//! | `growth` | growth of the covariance if residuals are too large for the stated sigmas |
//! | `contradiction` | by how much all instants together contradict the stated sigmas |
//! | `unchecked` | kinds of measurement whose errors the residuals hardly show |
//! | `modes`, `mixture` | outliers in a batch of instants with few redundant measurements |
//! | `normals` | error ellipses of mixtures of normal distributions |
//! | `evidence` | likelihood of the measurements for given sizes of the sigmas |
//! | `alone` | size of the errors of a single instant that contradicts the stated sigmas |
//! | `faulty` | frequency of outliers in a batch |
//! | `profile` | covariances where the cost is not a parabola |
//! | `solver` | location of an instant, from its measurements to the results |
//! | `minimum` | a minimum of the cost, and the points that belong to it |
//! | `search` | start, robust steps, other minima |
//! | `mirror` | the plane of the stations and its sides |
//! | `side` | the side of the stations on which the targets are |
//! | `accuracy` | the covariance that positions would have |
//! | `summary` | covariance, σ, dilution of precision |
//! | `lenth` | the estimators of Lenth (1981), for azimuths only |
//! | `posterior`, `quadtree`, `concentration` | the density of positions from two to four bearings |
//! | `region`, `contour`, `radial` | regions around positions, their outlines, radii |
//! | `speed` | the speed of the signals if it is not known exactly |
//! | `wind` | the wind if it carries the signals |
//! | `medium` | speed and wind together |
//! | `protection` | protection levels |

// indices are those of the formulas
#![allow(clippy::needless_range_loop)]

mod accuracy;
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
mod minimum;
mod mirror;
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
mod side;
mod solver;
mod speed;
mod starts;
mod steady;
mod summary;
mod total;
mod unchecked;
mod wind;

pub use concentration::{Decay, STEPS, Weights};
pub use contour::Outline;
pub use contradiction::Contradiction;
pub use fix::{Fix, Instant, Method, Output, Status};
pub use medium::Medium;
pub use mixture::Mixture;
pub use posterior::{Bearings, Posterior, Summary, pooled};
pub use protection::Protection;
pub use region::{Located, Spread};
pub use solver::{Locator, Workspace};
pub use speed::Speed;
pub use wind::Wind;

/// Number of instants that are located side by side.
pub const BLOCK: usize = lane::LANES;
