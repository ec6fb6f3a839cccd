//! How far from straight flight the models of a track expect its target to be a few seconds later.

use super::ImmModel;
use super::estimate::Estimate;
use serde::{Deserialize, Serialize};

/// Acceleration along the course in changes of speed, in standard deviations.
const SPEEDS: f64 = 3.0;

/// The strongest deviation from straight flight among the models of a track.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Swerve {
    /// Density of the white acceleration, m²/s³.
    noise: f64,
    /// Variance of a lasting acceleration, m²/s⁴, and expected acceleration, m/s².
    variance: f64,
    expected: f64,
}

impl Swerve {
    /// With white acceleration alone.
    pub fn white(sigma: f64, period: f64) -> Self {
        Self { noise: sigma * sigma * period, ..Self::default() }
    }

    /// With turns, which begin with the probability `begins` per scan.
    pub fn turning(model: &ImmModel, turn: &Estimate<5>, begins: f64, period: f64) -> Self {
        let m = &turn.mean;
        let squared = m[2] * m[2] + m[3] * m[3];
        let rate = turn.covariance[(4, 4)] + begins * model.turn_rate_sigma.powi(2);
        Self {
            noise: model.turn_sigma.powi(2) * period,
            variance: squared * rate,
            expected: (squared.sqrt() * m[4].abs()).max(SPEEDS * model.acceleration_sigma),
        }
    }

    /// Variance of the position, along any axis, after some seconds.
    #[inline]
    pub fn variance(&self, t: f64) -> f64 {
        let t = t.abs();
        t * t * t * (self.noise / 3.0 + 0.25 * t * self.variance)
    }

    /// Expected distance of the target from straight flight after some seconds.
    #[inline]
    pub fn expected(&self, t: f64) -> f64 {
        0.5 * self.expected * t * t
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_within;
    use nalgebra::{SMatrix, SVector};

    #[test]
    fn a_turn_leads_away_from_straight_flight() {
        let mut covariance = SMatrix::<f64, 5, 5>::zeros();
        covariance[(4, 4)] = 4e-4;
        let turn = Estimate { mean: SVector::from([0.0, 0.0, 300.0, -400.0, -0.1]), covariance };
        let model = ImmModel { turn_sigma: 2.0, turn_rate_sigma: 0.03, ..ImmModel::default() };
        let found = Swerve::turning(&model, &turn, 0.1, 4.0);
        // 50 m/s² for two seconds
        assert_within(1e-14, found.expected(2.0), 100.0);
        let rate = 500.0_f64.powi(2) * (4e-4 + 0.1 * 9e-4);
        assert_within(1e-14, found.variance(2.0), 16.0 * 8.0 / 3.0 + 4.0 * rate);
        // in straight flight there may be changes of speed
        let straight = Estimate { mean: SVector::from([0.0, 0.0, 300.0, 0.0, 0.0]), ..turn };
        assert_within(1e-14, Swerve::turning(&model, &straight, 0.1, 4.0).expected(2.0), 3.0);
        assert_within(1e-14, Swerve::white(1.0, 4.0).variance(3.0), 36.0);
    }
}
