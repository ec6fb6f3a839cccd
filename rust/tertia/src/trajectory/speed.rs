//! Effect of an error of the propagation speed and of an unknown wind, the same at all instants, on the
//! covariance.

use super::bias::{Biases, add_covariance, smoothed, weights};
use super::failure::Failure;
use super::found::{Found, Setting};
use super::measured::Measured;
use super::survey::{errors, shifts};
use crate::location::Speed;
use crate::sensors::{KINDS, Kind};
use crate::smoothing::ProcessNoise;
use nalgebra::DMatrix;

/// Adds to the covariance of the states (N, 3D, 3D) the effect of an error of the propagation speed; `sigma`
/// is its standard deviation relative to the speed. O(N K).
pub(super) fn add_error<const D: usize, const N: usize>(
    setting: &mut Setting<'_, D, N>,
    found: &Found<D, N>,
    (sigma, biases): (f64, Option<&Biases>),
    motion: ProcessNoise,
    covariance: &mut [f64],
) -> Result<(), Failure> {
    let record = setting.record;
    let mut values = found.measured.values.clone();
    let (speed, k) = (Speed { share: sigma, ..Speed::EXACT }, record.receivers());
    for instant in values.chunks_exact_mut(record.width()) {
        speed.apply(&mut instant[..KINDS * k], k);
    }
    let measured = Measured::<D>::new(record, values);
    let (weight, _) = weights(record, found, &found.lasting(record));
    let (response, spread) =
        shifts(record, found, &errors(record, found, &measured), &weight, biases);
    let means = smoothed(setting, &[response], &spread, motion)?;
    add_covariance::<N>(&means, &DMatrix::identity(1, 1), covariance);
    Ok(())
}

/// Adds to the covariance of the states (N, 3D, 3D) the effect of an unknown wind; `wind` is its covariance
/// in units of the propagation speed. To first order, the wind changes the arrival time at a station by a
/// term that depends only on the position of the station, and by a term common to all stations, which is
/// absorbed by the emission time. O(N K).
pub(super) fn add_wind<const D: usize, const N: usize>(
    setting: &mut Setting<'_, D, N>,
    found: &Found<D, N>,
    (wind, biases): (&[[f64; 2]; 2], Option<&Biases>),
    motion: ProcessNoise,
    covariance: &mut [f64],
) -> Result<(), Failure> {
    let record = setting.record;
    let k = record.receivers();
    let (weight, _) = weights(record, found, &found.lasting(record));
    let (mut responses, mut spread) = (Vec::new(), Vec::new());
    for axis in 0..2 {
        let sigma = wind[axis][axis].sqrt();
        let mut values = found.measured.values.clone();
        for (t, instant) in values.chunks_exact_mut(record.width()).enumerate() {
            let size = k * D;
            let places = &record.stations[(t * size) % record.stations.len()..][..size];
            let own = &mut instant[Kind::Arrival as usize * k..][..k];
            for (i, value) in own.iter_mut().enumerate() {
                *value += sigma * (places[i * D + axis] - places[axis]);
            }
        }
        let measured = Measured::<D>::new(record, values);
        let (response, inverse) =
            shifts(record, found, &errors(record, found, &measured), &weight, biases);
        responses.push(response);
        spread = inverse;
    }
    let means = smoothed(setting, &responses, &spread, motion)?;
    let correlation = DMatrix::from_fn(2, 2, |a, b| {
        wind[a][b] / (wind[a][a] * wind[b][b]).sqrt().max(f64::MIN_POSITIVE)
    });
    add_covariance::<N>(&means, &correlation, covariance);
    Ok(())
}
