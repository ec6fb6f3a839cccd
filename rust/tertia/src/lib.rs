//! One estimate with an error bar that can be believed, from measurements that are redundant and
//! sometimes wrong.
//!
//! `error, moments, distribution, angle <- screening <- bearing`, with [`batch`] and [`missing`] for
//! their callers: a module uses those to its left only. Kernels take slices and fill the caller's
//! outputs.
//!
//! | kernel | cost of a sample of N | extra memory |
//! |---|---|---|
//! | [`screening::mask`] | O(N), one to two reads | N/85 bytes |
//! | [`screening::statistics`] | O(N), two reads, two writes | none |
//! | [`screening::LeaveOneOutRule::screen`] | O(N) a pass | N where values are flagged |
//! | [`screening::KSigmaRule::screen`] | O(N) | N where values are flagged |
//! | [`screening::BurstRule::detect`] | O(N · longest burst) | 6 N |
//! | [`screening::unwrap`] | O(N) | N |
//! | [`bearing::Estimator::estimate`] | that of its screening | that of its screening |

mod angle;
pub mod batch;
pub mod bearing;
mod distribution;
mod error;
mod matrix;
pub mod missing;
mod moments;
pub mod screening;
pub mod weights;

pub use error::{Error, Result};
pub use moments::Moments;
