//! Effect of an error of the propagation speed and of an unknown wind, the same at all instants, on the
//! covariance.

use super::bias::Biases;
use super::survey::{add_effects, errors};
use crate::location::Speed;
use crate::sensors::{KINDS, Kind};
use crate::smoothing::ProcessNoise;
use crate::trajectory::measured::Measured;
use crate::trajectory::path::failure::Failure;
use crate::trajectory::search::fit::{Found, Setting};
use nalgebra::DMatrix;

/// Adds to the covariance of the states (N, 3D, 3D) the effect of an error of the propagation speed; `sigma`
/// is its standard deviation relative to the speed. O(N K).
pub(in crate::trajectory) fn add_error<const D: usize, const N: usize>(
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
    let errors = errors(record, found, &Measured::new(record, values));
    add_effects(setting, found, (std::iter::once(errors), biases), motion, None, covariance)
}

/// Adds to the covariance of the states (N, 3D, 3D) the effect of an unknown wind; `wind` is its covariance
/// in units of the propagation speed. To first order, the wind changes the arrival time at a station by a
/// term that depends only on the position of the station, and by a term common to all stations, which is
/// absorbed by the emission time. O(N K).
pub(in crate::trajectory) fn add_wind<const D: usize, const N: usize>(
    setting: &mut Setting<'_, D, N>,
    found: &Found<D, N>,
    (wind, biases): (&[[f64; 2]; 2], Option<&Biases>),
    motion: ProcessNoise,
    covariance: &mut [f64],
) -> Result<(), Failure> {
    let record = setting.record;
    let k = record.receivers();
    let errors = (0..2).map(|axis: usize| {
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
        errors(record, found, &Measured::new(record, values))
    });
    let correlation = DMatrix::from_fn(2, 2, |a, b| {
        wind[a][b] / (wind[a][a] * wind[b][b]).sqrt().max(f64::MIN_POSITIVE)
    });
    add_effects(setting, found, (errors, biases), motion, Some(correlation), covariance)
}
