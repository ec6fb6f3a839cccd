//! Plots that have been compared with false plots.

use crate::sensors::Detection;
use crate::tracker::plot::Measured;
use serde::{Deserialize, Serialize};

/// A plot, and the density of false plots with which it has been compared, 1/m².
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Weighed {
    pub radar: usize,
    pub time: f64,
    pub position: [f64; 2],
    pub detection: Option<Detection>,
    pub density: f64,
}

impl Weighed {
    pub fn new(plot: &Measured, density: f64) -> Self {
        let &Measured { radar, time, position, detection, .. } = plot;
        Self { radar, time, position, detection, density }
    }
}
