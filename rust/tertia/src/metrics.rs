//! Information content of a record of errors: how long errors last, and intervals of its figures.
//!
//! | part | what | cost |
//! |---|---|---|
//! | `lasting` | number of independent errors that a record is worth | O(N m) for each of about 300 models |
//! | `indicator` | correlation of indicators, such as 'inside a region' | O(1) |
//! | `interval` | intervals of means, shares and quantiles | O(1) |

mod indicator;
mod interval;
mod lasting;

pub use indicator::{chi_square_quantile, indicator_powers};
pub use interval::{Worth, mean_interval, rank_interval, share_interval};
pub use lasting::{Lasting, POWERS, lasting};
