//! Sensors, as typed objects.

use crate::arrays::value_error;
use pyo3::prelude::*;
use tertia::sensors;

/// A radar, checked.
#[pyclass(frozen, module = "tertia._core")]
pub struct Radar(pub sensors::Radar);

#[pymethods]
impl Radar {
    /// Channels are primary, secondary and mode S, each with its detection probability, standard
    /// deviations of range and azimuth, and false plots in a scan.
    #[new]
    #[pyo3(signature = (
        *, position, range_sigma, azimuth_sigma, scan_period, max_range, detection_probability, resolution=None,
        channels=None
    ))]
    #[allow(clippy::too_many_arguments)] // the settings, by name
    fn new(
        position: [f64; 3],
        range_sigma: f64,
        azimuth_sigma: f64,
        scan_period: f64,
        max_range: f64,
        detection_probability: f64,
        resolution: Option<[f64; 2]>,
        channels: Option<[Option<[f64; 4]>; 3]>,
    ) -> PyResult<Self> {
        let radar = sensors::Radar {
            position,
            range_sigma,
            azimuth_sigma,
            scan_period,
            max_range,
            detection_probability,
            resolution,
            ways: None,
        };
        radar.check().map_err(value_error)?;
        let Some(channels) = channels else { return Ok(Self(radar)) };
        radar.with_channels(channels.map(|own| own.map(channel))).map(Self).map_err(value_error)
    }
}

/// A channel by its numbers.
fn channel([p, range_sigma, azimuth_sigma, clutter_per_scan]: [f64; 4]) -> sensors::Channel {
    let sigmas = [range_sigma, azimuth_sigma];
    sensors::Channel { detection_probability: p, sigmas, clutter_per_scan }
}
