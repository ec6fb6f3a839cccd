//! One bearing with its standard deviation from a sample of measured bearings.
//!
//! Source: Manoilov, Pysarchuk, Pavliuk 2006, stages 1 to 3.2 and (M5)–(M7), as printed
//! ([`Method::Paper`]) and corrected ([`Method::Corrected`]); [`Method::Robust`] is the default of
//! the Python API.
//!
//! `rules, blocks <- workspace <- paper, robust <- estimator`

mod blocks;
mod estimator;
mod paper;
mod robust;
mod rules;
mod workspace;

pub use blocks::BlockOutput;
pub use estimator::{Estimate, Estimator};
pub use rules::{Method, PaperRule, RobustRule, VarianceTest};
pub use workspace::Workspace;
