//! One estimate with an error bar that can be believed, from measurements that are redundant and
//! sometimes wrong.
//!
//! ```
//! // which of ten values are wrong, by leaving each one out
//! let y = [12.4, 11.8, 40.0, 12.1, 12.9, 11.5, 12.6, 12.2, 12.0, 11.9];
//! let mut outlier = [false; 10];
//! tertia::screening::mask(&y, 2.5, &mut outlier)?;
//! assert_eq!(outlier.iter().position(|&wrong| wrong), Some(2));
//! # Ok::<(), tertia::Error>(())
//! ```
//!
//! # Contents
//!
//! | module | what for |
//! |---|---|
//! | [`screening`] | which measurements of a sample are anomalous; tests with exact thresholds |
//! | [`bearing`] | one bearing with its standard deviation of a record |
//! | [`weights`] | estimates fused by their covariances, and how well the weights are known |
//! | [`geo`] | the earth: local frames, the system plane, plots of radars in it |
//! | [`location`] | a position of ranges, azimuths, elevations and range differences |
//! | [`kalman`] | angle, rate and acceleration along a series: filter, smoother, steady state |
//! | [`smoothing`] | local polynomials; position, velocity and acceleration of all plots |
//! | [`fusion`] | one track of several radars; one estimate of several of the same instant |
//! | [`association`] | which plot belongs to which track: gates, scores, assignment |
//! | [`flightplan`] | paths of flight plans, and how tracks relate to them |
//! | [`registration`] | noise and biases of radars, from their tracks |
//! | [`tracker`] | tracks of scans of plots |
//! | [`tertiary`] | tracks of several sensors fused into one picture |
//! | [`asterix`] | records of ASTERIX as columns of numbers |
//! | [`simulate`] | flights along routes, and when the beam of a radar passes them |
//! | [`batch`], [`missing`] | rows on threads; nan left out |
//!
//! Two programs are in `examples`: `bearing` (screening and one bearing) and `tracker`.
//!
//! # Order
//!
//! `base <- screening <- bearing <- weights <- geo <- location <- kalman <- smoothing <-
//! fusion <- association <- flightplan <- registration <- tracker <- tertiary`: a module uses those to its
//! left only. [`simulate`], [`metrics`] and [`asterix`] stand outside. [`batch`] and [`missing`] are for callers.
//! Kernels take slices and fill the caller's outputs.
//!
//! # Costs
//!
//! | kernel | cost of a sample of N | extra memory |
//! |---|---|---|
//! | [`screening::mask`] | O(N), one to two reads | N/85 bytes |
//! | [`screening::statistics`] | O(N), two reads, two writes | none |
//! | [`screening::LeaveOneOutRule::screen`] | O(N) a pass | N where values are flagged |
//! | [`screening::KSigmaRule::screen`] | O(N) | N where values are flagged |
//! | [`screening::BurstRule::detect`] | O(N · longest burst) | 6 N |
//! | [`screening::unwrap_about_median`] | O(N) | N |
//! | [`bearing::Estimator::estimate`] | that of its screening | that of its screening |
//!
//! | kernel for K sensors in m dimensions | cost | buffers |
//! |---|---|---|
//! | [`weights::Quantity`] | O(K m³), of derivatives and covariances of weights O(K m⁴) | O(K m²) |
//! | the same, simulated by T draws | O(T K m³) | O(K m²) |
//! | [`fusion::Fusing`] | O(K m³); with cross covariances O(K³ m³) | O(K m²); O(K² m²) |
//!
//! | kernel | cost | extra memory |
//! |---|---|---|
//! | [`location::Locator::locate`], M measurements | O(M) a step | O(M) |
//! | [`kalman::Series::run`] | O(steps) | none |
//! | [`kalman::smooth`] | O(steps) | 35 numbers a step |
//! | [`smoothing::Polynomial`], window W | O(N W); O(N) per tap with equal steps | W |
//! | [`smoothing::smooth`], D axes | O(N D³) | 9 D² + 9 D numbers an instant |
//! | [`fusion::Centre`], K radars, a step | O(K²); robust O(K), matrix rules O(K³) | O(K²) |
//!
//! | kernel for T tracks, N plots and P pairs of them | cost | extra memory |
//! |---|---|---|
//! | [`association::Grid`], to build; a query | O(N); O(1) and what is found | O(N) |
//! | [`association::gate::pairs`] | O(T + N + P) | O(T + N) |
//! | [`association::Assigner::assign`] | O(T + N + P log P) where few pairs compete | O(T + N + P) |
//! | [`flightplan::Route`], N waypoints | O(N) a position, O(1) in a turn that is known | O(N) |
//! | [`tracker::Tracker::track`] | O(T + P log P) where few plots compete | O(T) |
//!
//! | kernel for N errors of m axes | cost | extra memory |
//! |---|---|---|
//! | [`metrics::lasting`] | O(N m) for each of 8 models of 10 + 3 ln N lengths | O(N m) |
//! | [`metrics::mean_interval`], `share_interval`, `rank_interval` | O(models) a step | none |

pub mod association;
pub mod asterix;
mod base;
pub mod bearing;
pub mod flightplan;
pub mod fusion;
pub mod geo;
pub mod kalman;
pub mod location;
pub mod metrics;
pub mod registration;
pub mod screening;
pub mod sensors;
pub mod simulate;
pub mod smoothing;
pub mod tertiary;
pub mod tracker;
pub mod trajectory;
pub mod weights;

pub use base::error::{Error, Result, require_finite};
pub use base::moments::Moments;
pub use base::{batch, interrupt, missing};
