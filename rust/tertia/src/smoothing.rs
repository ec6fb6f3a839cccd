//! Smoothing of one target over time, by local polynomials or with a motion model of white jerk.
//!
//! [`Polynomial`] fits a polynomial to the instants around each instant. [`smooth`] is the fixed-interval
//! smoother of position, velocity and acceleration; [`fit_process_noise`] estimates the intensity of the
//! process noise.

pub(crate) mod adjoint;
mod alike;
mod components;
mod diffuse;
mod expected;
mod faults;
mod fit;
mod information;
mod interleaved;
mod lasting;
mod levels;
mod model;
mod motion;
mod noise;
mod opening;
mod oscillation;
mod polynomial;
mod quick;
mod record;
mod repeats;
mod results;
mod rows;
mod search;
mod seen;
mod smoother;
mod stays;
mod stencil;
mod track;
mod unresolved;
mod wandering;
mod whitener;
mod whitening;

pub(crate) use fit::{Family, Part, likeliest, likeliest_of, likeliest_part, relative_error};
pub use fit::{ProcessNoiseFit, fit_process_noise};
pub use motion::ProcessNoise;
pub use noise::{NoiseFit, Options, smooth_with_noise};
pub use polynomial::{Degree, Fit, Output, Polynomial};
pub use record::Record;
pub use repeats::{repeated, repeated_readings};
pub use results::{Smoothed, Summary};
pub(crate) use smoother::likelihood;
pub use smoother::{Workspace, smooth};
pub use track::{Prior, Track, Velocities};
pub(crate) use unresolved::add_unresolved;
pub use whitener::Noise;
