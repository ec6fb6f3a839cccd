//! Positions from arrival times at receivers whose clocks are not synchronised.
//!
//! [`align`] and [`group`] find which arrivals belong to the same emission. [`solve`] estimates all unknowns
//! together: emission times, positions of moving emitters, clocks, the propagation speed, positions of
//! receivers and path errors. Errors follow Student's t distribution. The emission times are eliminated one
//! by one; the matrix of the remaining unknowns is a skyline matrix with low columns. A step costs about
//! N (K D)^2 plus the sum of the squares of the column heights.

mod arrange;
mod group;
mod layout;
mod linear;
mod mend;
mod normal;
mod problem;
mod scene;
mod side;
mod solve;
mod start;
mod starts;

pub use arrange::{Heard, arrange};
pub use group::{Alignment, Line, align, group};
pub use scene::{Arrival, Scene, Solution, Undetermined};
pub use side::solve;
