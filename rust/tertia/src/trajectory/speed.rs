//! What an error of the speed of the signals, the same at all instants, adds to the covariance.

use super::bias::{add_covariance, smoothed, weights};
use super::failure::Failure;
use super::found::{Found, Setting};
use super::measured::Measured;
use super::survey::shifts;
use crate::location::Speed;
use crate::sensors::KINDS;
use crate::smoothing::ProcessNoise;
use nalgebra::DMatrix;

/// Adds to the covariance of the states (N, 3D, 3D) what an error of this standard deviation, a share of
/// the speed, adds. O(N K).
pub(super) fn add_error<const D: usize, const N: usize>(
    setting: &mut Setting<'_, D, N>,
    found: &Found<D, N>,
    sigma: f64,
    motion: ProcessNoise,
    covariance: &mut [f64],
) -> Result<(), Failure> {
    let record = setting.record;
    let mut values = found.measured.values.clone();
    Speed { share: sigma, sigma: 0.0 }.apply(&mut values, record.width() / KINDS);
    let measured = Measured::<D>::new(record, values);
    let (weight, _) = weights(record, found, &found.lasting(record));
    let (response, spread) = shifts(record, found, &measured, &weight);
    let means = smoothed(setting, &[response], &spread, motion)?;
    add_covariance::<N>(&means, &DMatrix::identity(1, 1), covariance);
    Ok(())
}
