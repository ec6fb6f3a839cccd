//! Search for the path that fits all measurements except outliers.

pub(super) mod asynchronous;
mod crossings;
mod damping;
pub(super) mod fit;
mod outliers;
