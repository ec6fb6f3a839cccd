//! Rules by which the tracks of one target are fused.

use super::compare::shared;
use crate::base::error::Result;
use crate::fusion::{Estimates, FusedEstimate, Weighting, fusing};
use crate::sensors::Radar;
use crate::tracker::Estimate;
use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};

/// Range at which the accuracies of radars are compared for fixed weights, m.
const USUAL_RANGE: f64 = 100e3;

/// Rules by which the tracks of one target are fused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Rule {
    /// The plots behind the tracks are reconstructed and filtered.
    Tracklets,
    /// The best linear combination of the states with common process noise (Bar-Shalom, Campo 1986).
    Matrix,
    /// Covariance intersection.
    Intersection,
    /// Fixed weights from the accuracy of the sensors.
    Static,
    /// Equal weights.
    Equal,
    /// Weights from the last corrections, component by component.
    Paper,
}

/// State of the track of one sensor at the common instant.
pub(super) struct Part {
    pub sensor: usize,
    pub estimate: Estimate<4>,
    /// Correction of the state by the last row.
    pub correction: [f64; 4],
}

impl Rule {
    /// Fuses the states of several sensors; for rules that fuse states.
    pub(super) fn fuse(
        self,
        parts: &[Part],
        radars: &[Radar],
        correlation: [f64; 2],
    ) -> Result<Estimate<4>> {
        let count = parts.len();
        let weighting = match self {
            Self::Intersection => Weighting::Intersection,
            Self::Equal => Weighting::Equal,
            Self::Paper => Weighting::Paper,
            Self::Static => Weighting::Static(
                parts
                    .iter()
                    .map(|part| {
                        let radar = &radars[part.sensor];
                        radar.range_sigma.hypot(USUAL_RANGE * radar.azimuth_sigma).powi(-2)
                    })
                    .collect(),
            ),
            Self::Matrix | Self::Tracklets => Weighting::Matrix,
        };
        let mut cross = Vec::new();
        if weighting == Weighting::Matrix && correlation != [0.0; 2] {
            cross = vec![0.0; 16 * count * count];
            for (a, first) in parts.iter().enumerate() {
                for (b, second) in parts.iter().enumerate().skip(a + 1) {
                    let (p, q) = (&first.estimate.covariance, &second.estimate.covariance);
                    let Some(block) = shared(p, q, correlation) else { continue };
                    for (i, j) in (0..4).flat_map(|i| (0..4).map(move |j| (i, j))) {
                        cross[(a * count + b) * 16 + 4 * i + j] = block[(i, j)];
                        cross[(b * count + a) * 16 + 4 * j + i] = block[(i, j)];
                    }
                }
            }
        }
        let states: Vec<f64> = parts.iter().flat_map(|part| part.estimate.mean.data.0[0]).collect();
        let covariances: Vec<f64> =
            parts.iter().flat_map(|part| part.estimate.covariance.data.0).flatten().collect();
        let corrections: Vec<f64> = parts.iter().flat_map(|part| part.correction).collect();
        let (mut mean, mut covariance, mut bias) = ([0.0; 4], [0.0; 16], [0.0; 4]);
        let mut weights = vec![0.0; 16 * count];
        let mut out = FusedEstimate {
            mean: &mut mean,
            covariance: &mut covariance,
            weights: &mut weights,
            bias_sigma: &mut bias,
        };
        let estimates = Estimates {
            values: &states,
            covariances: &covariances,
            cross: (!cross.is_empty()).then_some(&cross[..]),
            corrections: Some(&corrections),
        };
        fusing(count, 4, weighting, None).fuse(&estimates, &mut out)?;
        let covariance = SMatrix::from_row_slice(&covariance);
        Ok(Estimate { mean: SVector::from(mean), covariance })
    }
}
