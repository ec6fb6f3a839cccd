//! Fusion of the plots of several radars into one track, and of the estimates of several sensors into one.
//!
//! Source: Panasyuk, Pudovkin, Rogachev 2018, (1) to (13), for K radars and with the misprints
//! corrected. In addition, there are weights that are robust against radars whose noise is larger
//! than stated. All radars measure the same angle in the same frame at common times.

mod belief;
mod biases;
mod centre;
mod clusters;
mod effects;
mod estimates;
mod fused;
mod hypotheses;
mod independent;
mod intersection;
mod joint;
mod levels;
mod matrix;
mod mixture;
mod repeats;
mod robust;
mod rules;
mod scalar;

pub use biases::{SeriesBiases, series_biases};
pub use centre::{Centre, RadarReport};
pub use effects::STEPS as EFFECT_STEPS;
pub use estimates::{Fusing, fusing};
pub use fused::{Agreement, Estimates, FusedEstimate, Weighting};
pub use rules::{Beliefs, Rule};
pub use scalar::Scalar;
