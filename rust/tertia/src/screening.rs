//! Screening: finds the outliers of a sample.
//!
//! Sources: Manoilov, Pysarchuk, Pavliuk 2006, equations (M1)–(M4); Motylev 2010, (R1)–(R3);
//! Fisch, Eckley, Fearnhead 2022 for points and bursts.
//!
//! `summary, others <- leave_one_out <- mask;  summary, others <- k_sigma, bursts, moving,
//! hypothesis`

mod bursts;
mod hypothesis;
mod k_sigma;
mod leave_one_out;
mod mask;
mod moving;
mod others;
mod summary;

pub use crate::base::angle::{require_period, unwrap_about_median};
pub use bursts::{BurstRule, BurstWorkspace};
pub(crate) use hypothesis::extreme_variance_pvalue;
pub use hypothesis::{
    OutlierTest, Test, cochran, critical_value, false_alarm_probability, grubbs, t_test,
    thompson_tau, z_test,
};
pub use k_sigma::{KSigmaRule, Replacement};
pub use leave_one_out::{Direction, LeaveOneOutRule, Statistics};
pub use mask::mask;
pub use moving::{MovingRule, MovingWorkspace};
pub use others::statistics;
pub use summary::Summary;
