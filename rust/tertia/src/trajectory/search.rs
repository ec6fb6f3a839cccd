//! Search for the path that fits all measurements except outliers.

mod crossings;
mod damping;
pub(super) mod found;
mod outliers;
pub(super) mod sought;
