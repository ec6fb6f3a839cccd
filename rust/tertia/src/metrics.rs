//! How much a record of errors says: how long errors last, and intervals of figures of the record.
//!
//! | part | what | cost |
//! |---|---|---|
//! | `lasting` | how many independent errors a record is worth | O(N m) for each of about 300 models |
//! | `indicator` | correlation of what is inside a region | O(1) |
//! | `interval` | intervals of means, shares and quantiles | O(1) |

mod indicator;
mod interval;
mod lasting;

pub use indicator::{chi_square_quantile, indicator_powers};
pub use interval::{Worth, mean_interval, rank_interval, share_interval};
pub use lasting::{Lasting, POWERS, lasting};
