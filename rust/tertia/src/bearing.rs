//! Estimation of one bearing with its standard deviation from a sample of measured bearings.
//!
//! Source: Manoilov, Pysarchuk, Pavliuk 2006, stages 1 to 3.2 and (M5)–(M7), as printed
//! ([`Method::Paper`]) and corrected ([`Method::Corrected`]). [`Method::Robust`] is the default of the
//! Python API.
//!
//! Order of the modules:
//! `modes <- acceleration, independent, sticky, information; blocks, start <- slow <- hypotheses`
//! `estimate, rules, hypotheses <- workspace <- paper, robust`
//! `maxima, robust <- stated <- groups <- estimator`

// indices are those of the formulas
#![allow(clippy::needless_range_loop)]

mod acceleration;
mod blocks;
mod estimate;
mod estimator;
mod groups;
mod hypotheses;
mod independent;
mod information;
mod maxima;
mod modes;
mod paper;
mod robust;
mod rules;
mod slow;
mod start;
mod stated;
mod sticky;
mod workspace;

pub use blocks::BlockOutput;
pub use estimate::Estimate;
pub use estimator::Estimator;
pub use rules::{Known, Method, PaperRule, RobustRule, VarianceTest};
pub use workspace::Workspace;
