//! Positions from arrival times at receivers whose clocks nobody synchronised.
//!
//! [`align`] and [`group`] find which arrivals belong to the same emission. [`solve`] estimates all
//! at once: emission times, positions of moving identities, clocks, the speed of propagation, places
//! of receivers and errors of paths, with Student's errors. Emissions are eliminated one by one, the
//! rest has a matrix of low columns. A step costs about N (K D)^2 plus the sum of the squares of the
//! column heights.

mod arrange;
mod group;
mod layout;
mod linear;
mod mend;
mod normal;
mod problem;
mod scene;
mod solve;
mod start;

pub use arrange::{Heard, arrange};
pub use group::{Alignment, Line, align, group};
pub use scene::{Arrival, Scene, Solution, Undetermined};
pub use solve::solve;
